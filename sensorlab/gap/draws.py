"""Records that a simulator with effects draws."""

import numpy as np

from sensorid import Parameter, as_hypotheses, simulate
from sensorlab.gap.effects import Jumps, signature_of
from sensorlab.gap.lowpass import low_pass_of, low_pass_of_white
from sensorlab.gap.members import Simulator, members
from sensorlab.gap.shapes import is_at_half


def simulate_effects(simulator, scene, trials=1, seed=0, first=0):
    """Records of a simulator with effects.

    Parameters
    ----------
    simulator : Simulator, or sequence of Hypothesis
    scene : Scene
        Gives the length and the columns; its missing samples will be missing.
    trials, seed, first : int
        As for `simulate`.

    Returns
    -------
    Trials
        As `simulate` draws them, then altered. Models and jumps are part of the noise,
        signatures are added to the sum, readings come last.
    """
    if not isinstance(simulator, Simulator):
        simulator = Simulator(as_hypotheses(simulator))
    inside = members(simulator, scene)
    drawn = simulate(inside, scene.dt, len(scene.y), trials, seed, first)
    for trial, y in enumerate(drawn.error):
        rng = np.random.default_rng(
            np.random.SeedSequence(seed, spawn_key=(first + trial, 1)))
        number = drawn.hypothesis[trial]
        member, (_, effects) = inside[number], simulator.pairs[number]
        if member.has_jumps:
            theta = drawn.theta[trial, :len(member.parameters)]
            low_pass = (low_pass_of_white if member.is_louder_before else low_pass_of)(
                member, theta)
            add_jumps(y, Jumps(*(part[0] for part in member.jumps(theta[None]))), rng,
                      low_pass, scene.dt)
        for one in effects:
            if one.effect.columns:
                value = {symbol: p.quantile(rng.random()) if isinstance(p, Parameter)
                         else p for symbol, p in one.values.items()}
                phase = value.get("phase")
                if phase is not one.values.get("phase") and is_at_half(
                        scene, value["frequency"]):
                    value["phase"] = np.pi * round(abs(phase) / np.pi)    # a sign
                y += signature_of(scene, one, value)
    for number, (_, effects) in enumerate(simulator.pairs):
        # a converter has its codes before these are rounded to whole ones, and all is
        # read before it is interpolated, or averaged, but for a mean that is rounded
        readings = sorted((one for one in effects if one.effect.reading),
                          key=lambda one: (not one.variant, one.effect.comes_last,
                                           "codes" not in one.values))
        if not readings:
            continue
        own = drawn.hypothesis == number
        read = drawn.error[own] + scene.known
        for one in readings:
            one.effect.reading(scene, read, **one.values)
        drawn.error[own] = read - scene.known
    drawn.error[:, np.isnan(scene.y)] = np.nan
    return drawn


def add_jumps(y, jumps, rng, low_pass=None, dt=1.0):
    """Outliers, levels, bursts of noise and steps added to y in place; levels, steps,
    and noise that is before it, pass a `LowPass`.
    """
    level = np.zeros(len(y) + 1)    # it begins at rest
    if jumps.rate > 0.0:
        at = rng.random(len(y)) < jumps.rate
        y[at] += np.sqrt(jumps.variance) * rng.standard_normal(at.sum())
    if jumps.half > 0.0:
        change = rng.random(len(y)) < jumps.begin
        second = (rng.integers(2) + np.cumsum(change)) % 2
        level[1:] += jumps.half * (2.0 * second - 1.0)
        level[0] = level[1]
    if jumps.step > 0.0:
        at = np.flatnonzero(rng.random(len(y)) < jumps.begin)
        size = np.zeros(len(y))
        size[at] = np.sqrt(jumps.step) * rng.standard_normal(len(at))
        level[1:] += size if jumps.before else np.cumsum(size)
    if jumps.louder > 0.0:
        out = level[1:] if jumps.before else y
        for part in _bursts(len(y), jumps, rng):
            out[part] += np.sqrt(jumps.louder) * rng.standard_normal(len(y[part]))
    y += (low_pass.passed(level[:, None], dt)[:, 0] if low_pass else level)[1:]


def _bursts(N, jumps, rng):
    """Slices of N samples at which the second level is, one after another."""
    at, second = 0, rng.random() < jumps.share
    while at < N:
        end = at + rng.geometric(jumps.end if second else jumps.begin)
        if second:
            yield slice(at, end)
        at, second = end, not second
