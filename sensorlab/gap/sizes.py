"""Numbers and sizes as text, with their units."""

import numpy as np


def number(x, digits=4):
    """A number with so many significant digits, without an exponent where one reads as
    well without.

    Examples
    --------
    >>> number(1234.5678), number(0.00012345, 2), number(1.5e-9)
    ('1235', '0.00012', '1.5e-09')
    """
    if not np.isfinite(x) or x and not 1e-4 <= abs(x) < 1e6:
        return f"{x:.{digits}g}"
    decimals = digits - 1 - int(np.floor(np.log10(abs(x)))) if x else 0
    text = f"{round(x, decimals):.{max(decimals, 0)}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def measured(mean, sd):
    """A value to the digits that its standard deviation leaves it, as text.

    Examples
    --------
    >>> measured(122.93, 34.2), measured(0.4, 0.0)
    ('123 +- 34', '0.4')
    """
    if not sd or not np.isfinite(sd):
        return number(mean)
    digits = 2 + int(np.floor(np.log10(max(abs(mean), sd))) - np.floor(np.log10(sd)))
    return f"{number(mean, digits)} +- {number(sd, 2)}"


def percent(share):
    """A share as text, never rounded to none or all of it."""
    if 0.995 <= share < 1.0:
        return "> 99 %"
    return "< 1 %" if 0.0 < share < 0.005 else f"{100.0 * share:.0f} %"


def chance(p):
    """A p-value as text."""
    return f"{p:.2g}" if p > 1e-12 else "< 1e-12"


def odds(log_bayes):
    """How much more probable a cause makes the record than none does, as text."""
    if log_bayes > np.log(1e99):
        return "> 1e99 : 1"
    if log_bayes > np.log(1e6):
        return f"1e{log_bayes / np.log(10.0):.0f} : 1"
    if log_bayes < 0.0:
        return f"1 : {number(np.exp(min(-log_bayes, 700.0)), 2)}"
    return f"{number(np.exp(log_bayes), 2)} : 1"


# ---- sizes

SECONDS = ("onset", "duration", "quiet", "tau", "dwell", "vertex", "tau_m", "tau_n",
           "window")
OF_THE_RECORD = ("size", "amplitude", "sigma", "sigma_v", "sigma_m", "sigma_n", "lsb",
                 "limits", "codes", "value")


def unit_of(symbol, unit, column=""):
    """Unit of a parameter of an effect or of a hypothesis in a record in `unit`."""
    if symbol in SECONDS or symbol in ("about", "per") and not column:
        return "s"
    if symbol in OF_THE_RECORD:
        return unit
    return dict(frequency="Hz", cutoff="Hz", phase="rad", slope=f"{unit}/s",
                curvature=f"{unit}/s^2",
                sigma_w=f"{unit} per sample", rate="of the samples",
                coefficient=f"{unit} per unit of {column or 'its column'}",
                per=f"of {column}").get(symbol, "")


def sizes(found, unit, dt):
    """Sizes of effects that were found, in a record in `unit` sampled at dt, as text.
    """
    texts = [(one.name, ", ".join(filter(None, (
        one.variant, values_text(one.values, unit, one.column, dt))))) for one in found]
    return "; ".join(f"{name}: {text}" if len(texts) > 1 else text
                     for name, text in texts if text)


def values_text(values, unit, column="", dt=None):
    """Values (mean, sd) by symbol as text; with dt, what a wrong factor may be."""
    parts = []
    for symbol, (mean, sd) in values.items():
        if isinstance(mean, str):
            parts.append(f"{symbol} {mean}")
            continue
        if mean is None:    # a phase
            parts.append("unevenly" if "order" in values else "at random")
            continue
        if isinstance(mean, list):
            shown = _shown(symbol, mean)
        else:
            shown = measured(mean, sd)
        parts.append(f"{symbol} {shown} {unit_of(symbol, unit, column)}".rstrip())
        if dt and symbol == "factor":
            name, _ = values.get("parameter", ("", 0.0))
            parts.append(_said_of(name.split(".")[-1], mean, sd, dt))
    return ", ".join(filter(None, parts))


def _shown(symbol, values):
    """A list of values of a reading as text."""
    if symbol == "limits":
        return " to ".join(number(x, LIMIT_DIGITS) for x in values)
    if symbol == "codes":
        _, width = np.transpose(values)
        return f"{len(values)} of width {number(width.min())} to {number(width.max())}"
    return f"{len(values)} of them"


def _said_of(symbol, factor, sd, dt):
    """What a wrong factor of a parameter is, or usually is."""
    if symbol == "limits":    # a record only lies beyond
        return "or more"
    if unit_of(symbol, "u") in NO_UNIT:
        return ""
    return looks_like(factor, sd, None if symbol == "lsb" else dt)


LIMIT_DIGITS = 10               # a full scale is known by all of them
NO_UNIT = "s", "Hz", "rad"      # of the record, that could be another
FACTORS = {    # so many times a number in the first unit is one in the second
    9.80665: ("g", "m/s^2"), 1e3 / 9.80665: ("m/s^2", "mg"), 57.29578: ("rad", "deg"),
    3600.0: ("per second", "per hour"), 206264.806: ("rad/s", "deg/h"),
    60.0: ("per root second", "per root hour"), 1000.0: ("the unit", "milli of it")}
NEAR = 0.005    # relative: a factor this near to a known one may be it


def looks_like(factor, sd, dt=None):
    """What a wrong factor usually is; with dt, of a standard deviation."""
    if factor == 0.0:
        return "the record has none"
    named = [(value, f"{one} taken for {other}", f"{other} taken for {one}")
             for value, (one, other) in FACTORS.items()]
    if dt:
        named += [(1.0 / dt, *2 * ["the sampling rate"]), (dt**-0.5, *2 * [
            "root of the rate: a density taken for a per-sample sigma, or the other "
            "way round"])]
    known = [pair for value, text, inverse in named if abs(np.log(value)) > 0.2
             for pair in ((value, text), (1.0 / value, inverse))]
    v, text = min(known, key=lambda one: abs(np.log(factor / one[0])))
    if abs(factor - v) < max(3.0 * sd, NEAR * v) and sd < 0.2 * v:
        return f"about {v:.4g}: {text}"
    return ""
