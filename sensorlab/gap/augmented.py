"""The simulator with what was found."""

import numpy as np

from sensorid import Parameter, simulate
from sensorlab.gap.clipping import latent_law
from sensorlab.gap.effects import known_values
from sensorlab.gap.implied import around, as_simulated
from sensorlab.gap.known import offset_of
from sensorlab.gap.members import Simulator
from sensorlab.gap.readings import SMOOTH, as_read
from sensorlab.gap.standins import bias_of


def augmented(d):
    """The `Simulator` of a diagnosis with the effects that were found: ranges have the
    posterior's mean and standard deviation, the phase of a line is that of any record,
    what happened at some time is there or not, from nothing to the size found; when and
    for how long, and readings, are numbers.
    """
    to, sample, theta = d.final.member.in_units, d.final.sample, d.after.theta
    # a uniform range of this half-width has that standard deviation
    width = np.sqrt(3.0) * sample._replace(theta=to(sample.theta)).sd(to(theta))
    ((h, effects),) = as_simulated(d.final, d.scene, theta, width).pairs
    effects = with_ranges(d, effects)
    offset = offset_of(d.scene, d.known)
    base = d.final.bases[d.final.best].hypothesis
    bias_sigma = max(h.bias_sigma or base.bias_sigma, abs(offset))
    if not base.bias_given:    # nobody has said how large it may be
        mean, sd = bias_of(d.final, as_read(d.scene, d.final.readings))
        bias_sigma = float(np.hypot(offset + mean, sd))
    h = _before_rounding(d, h)._replace(bias_sigma=bias_sigma, bias_given=True)
    return Simulator((h,), (tuple(map(_at_any_phase, (
        *d.known, *map(_there_or_not, effects)))),))


LATENTS = 32    # simulated records that tell how far values of a hypothesis lie apart


def _before_rounding(d, h):
    """A hypothesis, its noises by one factor as strong together as what was rounded to
    counts so coarse that rounding adds no white noise, if nothing else was found.
    """
    lsb = max((r.cell for r in d.final.readings if r.coarse or r.opaque), default=0.0)
    if not lsb or any(not one.effect.reading for one in d.found):
        return h
    _, sigma = latent_law(d.scene.y + d.scene.known, (-np.inf, np.inf), lsb)
    if lsb < SMOOTH * sigma:
        return h
    number = h._replace(bias_sigma=0.0, parameters=tuple(
        p._replace(low=p.mean, high=p.mean) for p in h.parameters))
    drawn = simulate([number], d.scene.dt, len(d.scene.y), LATENTS).error
    factor = sigma / float(np.sqrt(np.mean(np.var(drawn, axis=1))))
    return h._replace(parameters=tuple(
        p._replace(low=factor * p.low, high=factor * p.high)
        if p.symbol.startswith("sigma") else p for p in h.parameters))


def with_ranges(d, effects):
    """Effects of a simulator, of which those that were found and are columns times a
    size have their parameters in ranges, if they do not begin at some time.
    """
    result, found = list(effects), [one for one in d.found if one.effect.columns]
    at = [k for k, one in enumerate(effects) if one.effect.columns]
    for k, one in zip(at[len(at) - len(found):], found):    # the simulator's come first
        if one.effect.begins:
            continue
        least = 0.0 if one.effect.size == "amplitude" else -np.inf
        within = [*one.effect.parameters(d.scene), Parameter(
            one.effect.size, least, np.inf)]
        result[k] = result[k]._replace(values={**result[k].values, **{
            p.symbol: around(p, mean, np.sqrt(3.0) * sd)
            for p in within for mean, sd in [one.values[p.symbol]]}})
    return result


def _at_any_phase(one):
    """A line as another record has it, which begins at some other time."""
    if one.effect.search != "frequency":
        return one
    return one._replace(values={**one.values, "phase": ANY_PHASE})


ANY_PHASE = Parameter("phase", -np.pi, np.pi)


def _there_or_not(one):
    """What happened in a record at some time, as another record has it: of any size up
    to its own, or a noise that changes by any ratio up to its own, as that is known.
    """
    if one.effect.drive and not one.column:
        ratio = one.values["ratio"]
        return one._replace(values={**one.values, "ratio": Parameter(
            "ratio", min(ratio.low, 1.0), max(ratio.high, 1.0), True)})
    if not one.effect.begins:
        return one
    symbol = one.effect.size
    size = known_values(one)[symbol]
    values = {**one.values, symbol: Parameter(symbol, min(size, 0.0), max(size, 0.0))}
    if "phase" in values:
        values["phase"] = ANY_PHASE
    return one._replace(values=values)
