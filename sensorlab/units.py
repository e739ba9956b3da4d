"""Units as the field writes them, and our parameters as data sheets quote them.

White noise has two conventions that differ by the root of two. The angle random walk N
of IEEE Std 952, the density of Kalibr and the Allan deviation at 1 s belong to a
spectrum over positive and negative frequencies: sigma_v = N / sqrt(dt). The noise
density D of a spectrum analyser, and of most data sheets of MEMS sensors, is spread
over positive frequencies alone, up to half the rate: sigma_v = D sqrt(rate / 2), so
D = sqrt(2) N.
"""

import functools
import re
from typing import Callable, NamedTuple

import numpy as np

from sensorlab.gap.sizes import measured
from sensorlab.tables import Table

# mg is a thousandth of the standard gravity (ISO 80000-3), not a milligram
DEFINITIONS = """\
radian = [angle] = rad
degree = 0.017453292519943295 * radian = deg = ° = degrees
arcsecond = degree / 3600 = arcsec
second = [time] = s = sec
minute = 60 * second = min
hour = 3600 * second = h = hr
hertz = 1 / second = Hz
meter = [length] = m
gravity = 9.80665 * meter / second ** 2 = g
degree_per_second = degree / second = dps
count = [count] = counts = LSB
nano- = 1e-9 = n-
micro- = 1e-6 = u- = µ- = μ-
milli- = 1e-3 = m-
kilo- = 1e3 = k-"""

ROOT = re.compile(r"(?:sqrt|√)\s*\(?\s*([A-Za-zµμ°]+)\s*\)?")
# a number, then units, with exponents of one digit: 9**9**9 must not be computed
WRITTEN = re.compile(r"\s*(?:[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)?"
                     r"(?:[A-Za-z°µμ²³\s()*/]"
                     r"|(?<=[A-Za-z°µμ)])\s*(?:\^|\*\*)\s*-?\d(?:\.\d+)?)*")
LONGEST = 200    # characters
SI = {"rad/s": "gyroscope", "m/s^2": "accelerometer"}


@functools.cache
def registry():
    """The pint registry of these units, or a sentence on what to install."""
    try:
        import pint
    except ImportError:
        raise ValueError("units need pint: pip install pint") from None
    units = pint.UnitRegistry(None)
    for line in DEFINITIONS.splitlines():
        units.define(line)
    return units


def quantity(text):
    """A quantity such as "0.05 deg/s/sqrt(Hz)"; a unit alone stands for 1 of it.

    Raises
    ------
    ValueError
        If it is no text of a finite number and units that are known.

    Examples
    --------
    >>> quantity("1 mg").to("m/s^2").magnitude
    0.00980665
    """
    units = registry()
    plain = ROOT.sub(r"\1**0.5", text) if isinstance(text, str) else ""
    if len(plain) <= LONGEST and WRITTEN.fullmatch(plain):
        try:
            found = units.Quantity(plain)
            if np.isfinite(float(found.magnitude)):
                return found
        except Exception:    # pint and the tokenizer below it raise many kinds
            pass
    raise ValueError(f"{text!r} is no quantity: a number and a unit are needed, such as"
                     " 0.05 deg/s/sqrt(Hz), 30 ug/sqrt(Hz), 0.3 deg/sqrt(h), 10 deg/h, "
                     "m/s^2 or mg (milli-g)")


def alike(one, other):
    """Do two quantities measure the same thing?"""
    return quantity(one).dimensionality == quantity(other).dimensionality


def factor(old, new):
    """What numbers in the unit `old` are multiplied by to be in the unit `new`.

    Examples
    --------
    >>> round(factor("deg/sqrt(h)", "deg/s/sqrt(Hz)") * 60, 12)
    1.0
    """
    if not alike(old, new):
        raise ValueError(f"{old} cannot be given in {new}: "
                         "they measure different things")
    return float((quantity(old) / quantity(new)).to_base_units().magnitude)


def kind_of(unit):
    """"gyroscope" or "accelerometer", whichever has records in this unit.

    Raises
    ------
    ValueError
        If it is the unit of neither.
    """
    for si, kind in SI.items():
        if alike(unit, si):
            return kind
    raise ValueError(f"unit {unit!r} is neither an angular rate nor an acceleration: "
                     "deg/s, rad/s, deg/h, m/s^2, g or mg is needed")


# ---- how the field quotes a parameter

class Quote(NamedTuple):
    """How the field quotes a parameter: so many units of the record times `per`."""

    names: tuple        # of a gyroscope, of an accelerometer
    formula: str
    factor: Callable    # of dt, s: what the parameter is multiplied by
    per: str            # what the unit of the record is multiplied by
    units: tuple        # as the field writes it: of a gyroscope, of an accelerometer


def _same(dt):
    return 1.0


_SD = Quote(("standard deviation of the process",) * 2, "sigma_m", _same, "",
            ("deg/h", "mg"))
_TIME = Quote(("correlation time",) * 2, "tau_m", _same, "s", ("s", "s"))

QUOTES = dict(
    sigma_v=Quote(("angle random walk", "velocity random walk"),
                  "N = sigma_v sqrt(dt)", np.sqrt, "*s**0.5",
                  ("deg/sqrt(h)", "m/s/sqrt(h)")),
    sigma_w=Quote(("rate random walk", "acceleration random walk"),
                  "K = sigma_w / sqrt(dt)", lambda dt: dt**-0.5, "/s**0.5",
                  ("deg/h/sqrt(h)", "mg/sqrt(h)")),
    sigma_m=_SD, sigma_n=_SD._replace(formula="sigma_n"),
    tau_m=_TIME, tau_n=_TIME._replace(formula="tau_n"),
    slope=Quote(("rate ramp", "acceleration ramp"), "R = slope", _same, "/s",
                ("deg/h/h", "mg/h")))


class Quoted(NamedTuple):
    """A parameter as the field quotes it."""

    symbol: str
    name: str
    formula: str
    mean: float
    sd: float
    unit: str


def quoted(parameters, dt, unit, report=()):
    """Parameters as the field quotes them.

    Parameters
    ----------
    parameters : sequence of (symbol, mean, sd)
        Per sample, as our models have them; symbols that no one quotes are passed over.
    dt : float
    unit : str
        Of the record: an angular rate or an acceleration.
    report : sequence of str
        Units to be used instead of the usual ones, wherever they fit.

    Returns
    -------
    tuple of Quoted

    Raises
    ------
    ValueError
        If the unit is another.
    """
    which, found = list(SI.values()).index(kind_of(unit)), []
    for symbol, mean, sd in parameters:
        if symbol in QUOTES:
            q = QUOTES[symbol]
            fitting = [r for r in report if alike(r, _own(q, unit))]
            shown = fitting[-1] if fitting else q.units[which]
            times = q.factor(dt) * factor(_own(q, unit), shown)
            found.append(Quoted(symbol, q.names[which], q.formula, mean * times,
                                sd * times, shown))
    return tuple(found)


def fits(report, unit):
    """Can a parameter of a record in this unit be quoted in a unit to report in?"""
    return any(alike(report, _own(q, unit)) for q in QUOTES.values())


def check_report(unit, report):
    """Refuse a unit to report in that no parameter can be quoted in.

    Raises
    ------
    ValueError
        If there is one.
    """
    usual = quoted([(symbol, 1.0, 0.0) for symbol in QUOTES], 1.0, unit)
    for r in report:
        if not fits(r, unit):
            raise ValueError(f"{r} fits no parameter of this sensor; they are "
                             + ", ".join(dict.fromkeys(f"{q.name} in {q.unit}"
                                                       for q in usual)))


def _own(q, unit):
    """Unit of a quote before it is given as the field writes it."""
    return q.per if q.per == "s" else f"({unit}){q.per}"


def quote_table(found):
    """What `quoted` gives as a `Table`."""
    return Table(("as data sheets quote it", "value", "formula"), tuple(
        (q.name, f"{measured(q.mean, q.sd)} {q.unit}", q.formula) for q in found))


# ---- data sheets say more than our models

def white_from_density(density, rate):
    """sigma_v per sample from a one-sided noise density, u/sqrt(Hz), at a rate, Hz."""
    return density * np.sqrt(0.5 * rate)


def low_pass_time(bandwidth):
    """Time constant, s, of the first-order low-pass of a -3 dB bandwidth, Hz."""
    return 1.0 / (2.0 * np.pi * bandwidth)


# Allan deviation of flicker noise over its B, IEEE Std 952-1997, Annex C
FLOOR = np.sqrt(2.0 * np.log(2.0) / np.pi)


def flicker_sigma(floor, dt, duration):
    """sigma of the effect bias_instability from the lowest Allan deviation that flicker
    noise alone has, for records of this duration, s.

    B = floor / sqrt(2 ln 2 / pi) = sigma sqrt(pi / (decades ln 10)).
    """
    decades = np.floor(max(np.log10(0.1 * duration / dt), 0.0)) + 1.0
    return floor / FLOOR * np.sqrt(decades * np.log(10.0) / np.pi)
