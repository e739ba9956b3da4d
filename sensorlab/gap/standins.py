"""What stands in for jumps where all must be Gaussian: a mask for sure outliers, a
process for a level of two values, a variance for bursts.
"""

import functools

import numpy as np
from scipy.stats import binom

from sensorlab.gap.backward import solve
from sensorlab.gap.effects import Effect, Found, fixed
from sensorlab.gap.filters import predict
from sensorlab.gap.kernels.mixtures import smoothed
from sensorlab.gap.linear import estimated
from sensorlab.gap.lowpass import low_pass_of
from sensorlab.gap.processes import beside, join


def on_second(seen, jumps):
    """Probability (N,) that samples have the second level, by all of them."""
    return smoothed(seen.second[0, 0], jumps.begin[0], jumps.end[0])


def level_as_noise(scene, filt, change, half):
    return beside(filt, [1.0 - 2.0 * change], [half])


def steps_as_walk(scene, filt, sigma_w):
    return join(filt, (1.0, sigma_w, 0.0))


def _louder_at_times(scene, filt, variance, share):
    return filt._replace(Psi=np.sqrt(filt.Psi**2 + share * variance))


LEVEL_AS_NOISE = Effect("level_as_noise", model=level_as_noise, elementwise=True)
STEPS_AS_WALK = Effect("steps_as_walk", model=steps_as_walk, elementwise=True)


def _louder_before(scene, more, share):
    return np.sqrt(1.0 + more * share)


def _with_louder(scene, filt, more, share):
    return filt._replace(Psi=filt.Psi * _louder_before(scene, more, share))


def _bursts(member, theta, jumps, share):
    """What stands for bursts of noise, of a hypothesis at theta (p,), that are there
    with a probability (N,): variance of the output, or of the white noise before a
    low-pass, as a part of what that has.
    """
    if jumps.before[0]:
        return Found(Effect(
            "louder_at_times", model=functools.partial(_with_louder, share=share),
            drive=functools.partial(_louder_before, share=share), of_white=True,
            elementwise=True), values=fixed(
                more=jumps.louder[0] / member.white(theta[None])[0]**2))
    always, on_average = (functools.partial(_louder_at_times, share=part)
                          for part in (share, share.mean()))
    return Found(Effect("louder_at_times", model=always, on_average=on_average,
                        elementwise=True, comes_last=True), values=fixed(
                            variance=jumps.louder[0]))


def gaussian(scene, acc):
    """Scene and hypotheses without jumps: what sure outliers move is masked, a level of
    two values becomes the Markov process of its covariance, steps become a walk, bursts
    a variance at their times.
    """
    return _gaussian(scene, acc, _seen(scene, acc)) if acc.member.has_jumps else (
        scene, acc.hypotheses)


def _seen(scene, acc):
    """What the filter with jumps of an account makes of its record, as `Predicted`."""
    return predict(acc.member, scene, acc.signatures, acc.theta[None])


def _gaussian(scene, acc, seen):
    """`gaussian` of an account that has jumps, by what its filter has `seen`."""
    masked = scene._replace(y=np.where(seen.odd[0, 0] > 0.5, np.nan, scene.y))
    plain, own = [], acc.member.jumps(acc.theta[None])
    bursts = _bursts(acc.member, acc.theta, own, on_second(seen, own)) if (
        own.louder[0]) else None
    for h in acc.hypotheses:    # one that cannot be may not know what jumps
        effects = tuple(one for one in h.effects if not one.effect.jumps)
        if own.half[0] > 0.0:
            effects += (Found(LEVEL_AS_NOISE, values=fixed(change=own.begin[0],
                                                           half=own.half[0])),)
        if own.step[0] > 0.0 and not own.before[0]:
            effects += (Found(STEPS_AS_WALK, values=fixed(sigma_w=own.sigma_w[0])),)
        if bursts:
            effects += (bursts,)
        plain.append(h._replace(effects=effects))
    return masked, tuple(plain)


CLUSTER = 16         # samples, in which outliers may come together
BY_CHANCE = 1e-3    # that as many do somewhere in a record
SURE = 0.98         # which of two levels a sample has
MOSTLY = 0.5        # of the samples, if the level is known


def stand_in(scene, acc):
    """Scene and hypotheses without jumps in which another effect is sized: those that
    `gaussian` gives, but a level that is known is taken away. Noise of its covariance
    would hide what is slow.
    """
    return stand_ins(scene, acc)[1]


def stand_ins(scene, acc):
    """A list of those in which signatures are sought, and, as `stand_in` gives it, that
    for all others.

    For signatures, outliers in clusters that independent ones do not make are back, as
    one may explain all of them at once. A level that is known was taken for the other
    one where a signature is large beside it, so they are sought in its noise, too.
    """
    if not acc.member.has_jumps:
        return [(scene, acc.hypotheses)], (scene, acc.hypotheses)
    seen, jumps = _seen(scene, acc), acc.member.jumps(acc.theta[None])
    plain, hypotheses = _gaussian(scene, acc, seen)
    together = plain if jumps.before[0] else _with_clusters(scene, plain, jumps.rate[0])
    level = _level(seen, jumps, low_pass_of(acc.member, acc.theta), scene.dt
                   ) if jumps.half[0] else None
    if level is None:
        return [(together, hypotheses)], (plain, hypotheses)
    less = tuple(h._replace(effects=tuple(
        one for one in h.effects if one.effect is not LEVEL_AS_NOISE))
        for h in hypotheses)
    without = [(own._replace(y=own.y - level), less) for own in (together, plain)]
    return [(together, hypotheses), without[0]], without[1]


def _level(seen, jumps, low_pass, dt):
    """The level (N,) of two values, as it passes a `LowPass`, if there is one, NaN
    where it is not sure; None if it seldom is.
    """
    second = on_second(seen, jumps)
    sure = np.maximum(second, 1.0 - second) > SURE
    if sure.mean() < MOSTLY:
        return None
    level = np.where(second > 0.5, jumps.half[0], -jumps.half[0])
    return np.where(sure, low_pass.passed(level[:, None], dt)[:, 0] if low_pass
                    else level, np.nan)


def _with_clusters(scene, masked, rate):
    """A scene with samples back that are masked as outliers of a rate."""
    window, odd = np.ones(CLUSTER), np.isnan(masked.y) & ~np.isnan(scene.y)
    many = np.convolve(odd, window, "same") > binom.isf(
        BY_CHANCE / len(odd), CLUSTER, rate)
    near = np.convolve(many, window, "same") > 0.5
    return masked._replace(y=np.where(near, scene.y, masked.y))


def solved_by(acc, scene):
    """`Solved` of the most probable hypothesis of an account, at its theta; of what
    stands in for jumps, where it has some.
    """
    plain, hypotheses = stand_in(scene, acc)
    h = hypotheses[acc.best]
    return solve(h, plain, acc.signatures, acc.member.matching(h, acc.theta)[None])


def bias_of(acc, scene):
    """Expectation and standard deviation of the bias of a record, u."""
    masked, hypotheses = stand_in(scene, acc)
    plain = hypotheses[acc.best]
    told = estimated(plain, masked, acc.signatures,
                     acc.member.matching(plain, acc.theta)[None])
    return float(told.size[0, 0, -1]), float(np.sqrt(told.covariance[0, 0, -1, -1]))
