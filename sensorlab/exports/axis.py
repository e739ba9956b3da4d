"""One axis of a sensor in SI units, as other programs may have it."""

from typing import NamedTuple

import numpy as np

from sensorid import ShapingFilter, model_allan_variance
from sensorlab.gap.effects import Found, Jumps, Scene, fixed
from sensorlab.gap.members import Simulator, members
from sensorlab.gap.parts import LOUDER
from sensorlab.gap.processes import BEFORE_LOW_PASS, beside, join
from sensorlab.units import SI, factor, kind_of


FORGOTTEN = 1e-3    # a process of a smaller factor counts as white noise


class Process(NamedTuple):
    """x_i = a x_{i-1} + N(0, drive^2) from N(0, start^2), part of the error."""

    a: float
    drive: float
    start: float


class Axis(NamedTuple):
    """A model file in rad/s or m/s^2, its ranges at their mean."""

    kind: str             # "gyroscope" or "accelerometer"
    name: str             # of the hypothesis and its effects
    dt: float             # s
    bias: float           # standard deviation of the constant part
    filt: ShapingFilter   # what is drawn
    jumps: Jumps
    lsb: float
    limits: tuple         # infinite where there is none
    strange: tuple        # of str: what of the model is not here

    @property
    def unit(self):
        return next(si for si, kind in SI.items() if kind == self.kind)

    @property
    def second_order(self):
        """A filter of the same covariance: jumps and rounding become noise."""
        own, more = self.jumps, self.lsb**2 / 12.0
        more += own.rate * own.variance
        if own.louder:
            more += own.share * own.louder
        filt = self.filt._replace(Psi=np.sqrt(
            self.filt.Psi.max(keepdims=True)**2 + more))
        if own.step:
            filt = join(filt, (1.0, own.sigma_w, 0.0))
        return beside(filt, [1.0 - 2.0 * own.begin], [own.half]) if own.half else filt

    def allan_variance(self, m):
        """Expected Allan variance at averaging times of m samples."""
        return model_allan_variance(self.second_order, m)

    @property
    def parts(self):
        """Standard deviation of the white noise per sample and a tuple of Process: the
        error is their sum.

        Raises
        ------
        ValueError
            If it is no sum of one-state processes.
        """
        filt = self.second_order
        Phi, Q = filt.Phi[0], filt.Gamma[0] @ filt.Gamma[0].T
        if any(np.any(M != np.diag(np.diag(M))) for M in (Phi, Q, filt.P0)) or (
                filt.m0.any()):
            raise ValueError(f"{self.name} is no sum of white noise and one-state "
                             "processes: only --to numpy has it")
        h2 = filt.H[0]**2
        found = [Process(float(a), float(np.sqrt(q)), float(np.sqrt(p))) for a, q, p in
                 zip(np.diag(Phi), np.diag(Q) * h2, np.diag(filt.P0) * h2)]
        white = filt.Psi[0]**2 + sum(p.drive**2 for p in found if p.a < FORGOTTEN)
        return float(np.sqrt(white)), tuple(
            p for p in found if p.a >= FORGOTTEN and (p.drive or p.start))


def axis(model, unit=None, duration=3600.0):
    """An `Axis` from a `Model`.

    Parameters
    ----------
    model : Model
        With one hypothesis, such as `identify --save-model` and `diagnose --out` write.
    unit : str, optional
        Of the model, if it does not say it.
    duration : float
        Length, s, of the records that it is of: bias_instability depends on it.

    Raises
    ------
    ValueError
        If there are several hypotheses, or the unit is no rate and no acceleration.
    """
    if len(model.simulator.hypotheses) > 1:
        raise ValueError("the model has several hypotheses: "
                         + ", ".join(h.name for h in model.simulator.hypotheses)
                         + "; export takes one, such as identify --save-model writes")
    if not (np.isfinite(duration) and duration >= 2.0 * model.dt):
        raise ValueError(f"a duration of {duration:g} s holds no two samples")
    if model.unit == "u" and unit is None:
        raise ValueError("the model does not say its unit: give it with --unit")
    if model.unit != "u" and unit not in (None, model.unit):
        raise ValueError(f"the model is in {model.unit}, not in {unit}: "
                         "leave --unit out")
    unit = unit or model.unit
    kind = kind_of(unit)
    si = factor(unit, next(u for u, k in SI.items() if k == kind))
    scene = Scene(np.zeros(round(duration / model.dt)), model.dt, {})
    ((h, effects),) = model.simulator.pairs
    (member,) = members(Simulator((h,), (tuple(
        one for one in effects if not one.column),)), scene)
    member = _without_jumps_before(member)
    theta = np.array([p.mean for p in member.parameters])
    jumps = Jumps(*(float(part[0]) for part in member.jumps(theta[None])))
    readings = {symbol: value for one in effects if one.name in READ
                for symbol, value in one.values.items()}
    return Axis(
        kind, "+".join([h.model.__name__, *(one.name for one in effects)]), model.dt,
        si * h.bias_sigma, _scaled(member.filter(model.dt, theta), si),
        jumps._replace(variance=si**2 * jumps.variance, half=si * jumps.half,
                       louder=si**2 * jumps.louder, step=si**2 * jumps.step),
        si * readings.get("lsb", 0.0),
        tuple(si * np.array(readings.get("limits", [-np.inf, np.inf]))),
        (*_strange(effects), *_ranges(member)))


def _without_jumps_before(member):
    """A hypothesis with white noise of the same variance in place of what jumps before
    a low-pass.
    """
    theta = np.array([[p.mean for p in member.parameters]])
    own = Jumps(*(float(part[0]) for part in member.jumps(theta)))
    if not own.before:
        return member
    plus = own.begin * own.step if own.step else own.share * own.louder
    return member._replace(effects=(
        Found(LOUDER, values=fixed(times=1.0, plus=plus)), *(
            one for one in member.effects if one.variant != BEFORE_LOW_PASS)))


READ = "quantization", "saturation"    # of all readings, what programs know


def _scaled(filt, si):
    """A shaping filter in another unit, its states driven as where that is loudest."""
    loudest = max(filt.Gamma[:1], filt.Gamma[-1:], key=np.linalg.norm)
    return filt._replace(Gamma=si * loudest, Psi=si * filt.Psi, m0=si * filt.m0,
                         P0=si**2 * filt.P0)


def _ranges(member):
    """What is lost of the ranges of parameters, in words."""
    free = list(dict.fromkeys(p.symbol for p in member.parameters if p.free))
    if free:
        yield f"the ranges of {', '.join(free)}: each is at its mean"


def _strange(effects):
    """What of a model goes to no program, in words."""
    for one in effects:
        if one.effect.columns or one.column:
            yield f"{one.name} is left out: {one.effect.equation}"
        elif one.effect.drive:
            yield f"{one.name}: where it is loudest counts for the whole"
        elif one.variant == BEFORE_LOW_PASS:
            yield (f"{one.name} {one.variant}: white noise of the same variance stands "
                   "for them")
        elif one.effect.reading and one.name not in READ:
            yield f"{one.name} is left out"
