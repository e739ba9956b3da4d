"""The simulator that an account implies."""

import numpy as np

from sensorid import Parameter
from sensorlab.gap.effects import Effect, Found, fixed, known_values, signature_of
from sensorlab.gap.linear import estimated
from sensorlab.gap.members import Simulator
from sensorlab.gap.standins import stand_in


def as_simulated(acc, scene, theta, widths=None):
    """The most probable hypothesis of an account, and its effects, with numbers for
    parameters, as a `Simulator`; of several theta (M, p), all are equally probable.

    `widths` (p,) turns them into ranges theta -+ width, but for when something begins.
    Of a record that is clipped the bias counts, as the limits stand still: it is that
    of the scene.
    """
    thetas = np.atleast_2d(theta)
    sized = with_sizes(acc, scene, thetas)
    return Simulator(*zip(*(_with_numbers(acc, one, widths, own)
                            for one, own in zip(thetas, sized))))


def _ones(scene, x, psi):
    return [("", np.ones((len(scene.y), 1)))]


LEVEL = Effect("level", columns=_ones)


def in_place(simulator, acc, scene):
    """The simulator of an account with a constant, so that its records lie where that
    of the scene does, of which the mean was taken off: what coarse counts or limits do
    hangs on it, and signatures have a mean of their own.
    """
    if not (any(r.placed for r in acc.readings) and acc.signatures
            and acc.bases[acc.best].bias_sigma):    # without, it lies where it does
        return simulator
    seen, effects = ~np.isnan(scene.y), []
    for own in simulator.effects:
        mean = sum(np.mean(signature_of(scene, one, known_values(one))[seen])
                   for one in own if one.effect.columns)
        effects.append((*own, Found(LEVEL, values=dict(size=-mean))))
    return simulator._replace(effects=tuple(effects))


def _with_numbers(acc, theta, widths, sized):
    """The hypothesis and the effects of `as_simulated` at one theta (p,)."""
    base = acc.bases[acc.best].hypothesis
    placed = any(r.placed for r in acc.readings)
    widths = np.zeros(len(theta)) if widths is None else widths
    scaled = acc.member.in_units(theta)
    h = base._replace(bias_sigma=0.0 if placed else base.bias_sigma, parameters=tuple(
        around(p, v, w) for p, v, w in zip(base.parameters, scaled, widths)))
    for one in acc.member.effects:
        if one.effect.factor:    # what makes a bias larger is in the base already
            h = h._replace(bias_sigma=h.bias_sigma * min(
                acc.member.value(theta, one.key, "factor"), 1.0))
    known = {key: around(p, v, w if key not in acc.member.onsets else 0.0)
             for key, p, v, w in zip(acc.member.keys, acc.member.parameters, scaled,
                                     widths)}
    inside = [one._replace(values={symbol: known[one.key, symbol]
                                   for symbol in one.values})
              for one in acc.member.effects
              if not (one.effect.reading or one.effect.factor)]
    return h, (*inside, *sized, *(r.found for r in acc.readings if r.does_something))


SAME = 1e-12    # relative: a number of which weights have made a mean
NEAREST = 0.05    # of a value: to zero, if a prior does not hold it


def around(p, value, width):
    """A parameter known to +- width, within its prior if the value is."""
    if not p.free and np.isclose(value, p.low, rtol=SAME, atol=0.0):
        return p    # but for rounding
    if p.low <= value <= p.high:
        return Parameter(p.symbol, max(value - width, p.low),
                         min(value + width, p.high))
    width = min(width, (1.0 - NEAREST) * abs(value))
    return Parameter(p.symbol, value - width, value + width)


def with_sizes(acc, scene, thetas):
    """Lists of the signatures of an account, as `Found`, with their least-squares sizes
    at each theta.
    """
    if not acc.signatures:
        return [[]] * len(thetas)
    masked, hypotheses = stand_in(scene, acc)
    plain = hypotheses[acc.best]
    at = np.array([acc.member.matching(plain, theta) for theta in thetas])
    return [_sized(acc.signatures, iter(sizes)) for sizes in estimated(
        plain, masked, acc.signatures, at).size[0]]


def _sized(signatures, sizes):
    """Signatures as `Found` with the sizes of their columns, one after another."""
    result = []
    for s in signatures:
        size = np.array([next(sizes) for _ in range(s.columns.shape[1])])
        if s.is_held:
            norm = max(np.hypot(*size), 1e-300)
            size *= np.clip(norm, *s.held) / norm
        values = {**s.found.values, s.found.effect.size: np.hypot(*size)
                  if len(size) == 2 else size[0]}
        if len(size) == 2:
            values["phase"] = np.arctan2(-size[1], size[0])
        result.append(s.found._replace(values=fixed(**values)))
    return result
