"""Where the posterior of a hypothesis may be, as the account of another knows it, or as
spectra, scores and screens tell.
"""

import functools

import numpy as np
from scipy.special import ndtr, ndtri

from sensorid import Parameter, free_columns
from sensorlab.gap.evidence import effort, integrate
from sensorlab.gap.filters import log_likelihoods, predict
from sensorlab.gap.linear import part_of
from sensorlab.gap.scales import column_of_scale
from sensorlab.gap.screens import (
    LAWS, STRENGTHS, change_of_drive, noise_with, room_of_noise, usual_variance)
from sensorlab.gap.spectra import posterior_law
from sensorlab.gap.standins import level_as_noise, on_second, steps_as_walk


def guesses_from(past, number, h, scene, signatures):
    """Pairs of mean (d,) and covariance (d, d) that the free parameters of a hypothesis
    may have in the coordinates of `integrate`: as they were, or as spectra tell.
    """
    other, sample = past.hypotheses[number], past.samples[number]
    keys = [h.keys[c] for c in free_columns(h.parameters)]
    if not keys:
        return ()
    before = free_columns(other.parameters)
    known = {other.keys[b]: axis for axis, b in enumerate(before) if any(
        key == other.keys[b] and _is_same(p, other.parameters[b])
        for key, p in zip(h.keys, h.parameters))}
    mean, cov = sample.law if before else (np.zeros(0), np.zeros((0, 0)))
    axes = list(known.values())
    kept = _spread(keys, list(known), mean[axes], cov[np.ix_(axes, axes)])
    result = [kept] if known else []
    for one in h.effects:
        if one.effect.relative_to and one.key not in [own.key for own in other.effects]:
            return [*result, _louder_with(one, h, keys, scene, signatures, other,
                                          sample, kept)]
    at = column_of_scale(h)
    if at is not None and h.keys[at] not in known:    # over what is likeliest
        return [*result, _near_values({h.keys[at]: (1.0, len(scene.y)**-0.5)}, h, keys)]
    driven = h.driven
    if driven and driven.key not in [one.key for one in other.effects] and any(
            (driven.key, symbol) in keys for symbol in driven.values):
        return [*result, _before_change(h, keys, scene, signatures, other, sample)]
    changed = [(one.key, symbol) for one in h.effects if one.effect.search == "onset"
               for symbol in one.values]    # a spectrum tells nothing of these
    if not set(keys) & set(changed) <= set(known) or (
            len(keys) == len(known) == len(before)
            and len(signatures) == len(past.signatures)):
        return result
    # where what is new is weak, all else is as it was; where not, its spectrum tells
    theta = sample.likeliest
    twin, its_other = _as_processes(h), _as_processes(other)
    odd, law = _odd(h, scene, signatures, other, theta)
    told = posterior_law(
        twin, scene._replace(y=np.where(odd > 0.5, np.nan, scene.y)), signatures,
        its_other, other.matching(its_other, theta),
        {key: mean[axis] for key, axis in known.items()})
    free = [twin.keys[c] for c in free_columns(twin.parameters)]
    of = [axis for axis, key in enumerate(free) if key not in changed]
    mean, cov = told
    return [*result, _spread(keys, [free[axis] for axis in of], mean[of], cov[np.ix_(
        of, of)], _spread(keys, *law, kept))]


def _before_change(h, keys, scene, signatures, other, sample):
    """The law of the free parameters `keys` of a hypothesis whose states are driven
    differently from some sample on: what the record up to there tells another, which
    has no such change.
    """
    change = change_of_drive(
        h.driven.effect, scene, other, signatures,
        sample.likeliest)
    early, known = part_of(scene, signatures, slice(change.onset))
    free = [other.keys[c] for c in free_columns(other.parameters)]
    told = integrate(
        lambda theta: log_likelihoods(other, early, known, theta)[:, None],
        other.parameters, effort=effort(scene)).law if free else (
        np.zeros(0), np.zeros((0, 0)))
    ratio, x = (h.driven.key, "ratio"), ndtri(change.quantile)
    near = np.array([x]), np.array([[np.exp(x * x) * 2.0 * np.pi / STRENGTHS**2]])
    return _spread(keys, free, *told, _spread(keys, [ratio], *near)
                   if ratio in keys else None)


def _louder_with(one, h, keys, scene, signatures, other, sample, kept):
    """The law of the free parameters `keys` of a hypothesis in which an effect makes
    the white noise follow a column, or the time: what the scores of another tell, which
    has no such effect, all else as `kept`.
    """
    seen = predict(other, scene, signatures, sample.likeliest[None])
    told = noise_with(h, one, seen.z[0, 0], room_of_noise(other, sample.likeliest))
    likeliest = dict(zip(other.keys, sample.likeliest))
    own = {(one.key, "ratio"): (told.ratio, told.off)}
    own.update((key, (told.rest * likeliest[key], told.off)) for key in keys
               if key[1] == "sigma_v" and key in likeliest)
    return _near_values(own, h, keys, kept)


def _near_values(own, h, keys, rest=None):
    """The law of the free parameters `keys` of a hypothesis, of which some are near
    values that are known, pairs of that and of how well its logarithm is, by key; the
    rest as for `_spread`.
    """
    priors = dict(zip(h.keys, h.parameters))
    near = np.array([[_coordinate(priors[key], value * np.exp(
        step * min(off, ANYWHERE))) for step in (-1.0, 0.0, 1.0)]
                     for key, (value, off) in own.items()])
    return _spread(keys, list(own), near[:, 1], np.diag(
        (0.5 * (near[:, 2] - near[:, 0]))**2 + NARROWEST**2), rest)


COORDINATES = np.linspace(-4.0, 4.0, 801)    # of a prior
ANYWHERE = 99.0     # e-folds, more than any prior is wide
NARROWEST = 0.01    # standard deviation of one, of a law from which nodes are moved


def _coordinate(prior, value):
    """Where a prior that is N(0, 1) has a value; about, and not far out."""
    return np.interp(value, prior.quantile(ndtr(COORDINATES)), COORDINATES)


def _spread(keys, own, mean, cov, rest=None):
    """The law of some parameters as one of all of them, independent of those of the
    rest, which are as in the law `rest`, or standard normal.
    """
    whole, square = (np.zeros(len(keys)), np.eye(len(keys))) if rest is None else (
        part.copy() for part in rest)
    at = [keys.index(key) for key in own]
    whole[at] = mean
    square[at], square[:, at] = 0.0, 0.0
    square[np.ix_(at, at)] = cov
    return whole, square


@functools.cache
def _as_process(effect):
    """A level of two values, or one that steps, as a process of its covariance."""
    def model(scene, filt, **values):
        jumps = effect.jumps(scene.dt, **values)
        if np.any(jumps.step):
            return steps_as_walk(scene, filt, jumps.sigma_w)
        return level_as_noise(scene, filt, jumps.begin, jumps.half)
    return effect._replace(model=model, jumps=None, elementwise=True)


def _as_processes(h):
    """A hypothesis without outliers and bursts, its levels as processes."""
    return h._replace(effects=tuple(
        one._replace(effect=_as_process(one.effect)) if one.effect.jumps else one
        for one in h.effects if one.name not in LAWS))


def _odd(h, scene, signatures, other, theta):
    """Probability (N,) that samples are outliers, or in a burst, if a hypothesis has
    such; keys, mean and covariance of their free parameters if another, which is at
    theta (p,), has none.
    """
    nothing = (), np.zeros(0), np.zeros((0, 0))
    known = [one.key for one in other.effects]
    odd, own = np.zeros(len(scene.y)), [one for one in h.effects if one.name in LAWS]
    if not own:
        return odd, nothing
    seen = predict(other, scene, signatures, theta[None])
    if other.has_jumps:
        odd = _unless_most(_not_usual(other, seen, theta))
    z = np.where(odd > 0.5, np.nan, seen.z[0, 0])
    variance, new = usual_variance(z, seen.log_score[0, 0]), [
        one for one in own if one.key not in known]
    if np.isnan(variance) or not new:
        return odd, nothing
    (one,) = new
    if one.variant in one.effect.before:    # it moves innovations as white noise does
        variance = other.white(theta[None])[0]**2
    more, mean, cov = LAWS[one.name](scene, one.effect, z, variance)
    free = [axis for axis, p in enumerate(one.values.values()) if p.free]
    return np.maximum(odd, _unless_most(more)), (
        [(one.key, list(one.values)[axis]) for axis in free],
        np.asarray(mean)[free], np.asarray(cov)[np.ix_(free, free)])


def _unless_most(odd):
    """Probabilities (N,) that samples are odd; 0 if most are: the rest would tell too
    little.
    """
    return odd if np.mean(odd > 0.5) <= 0.5 else np.zeros(len(odd))


def _not_usual(h, seen, theta):
    """Probability (N,) that samples are outliers or in a burst, of a hypothesis with
    jumps at theta (p,).
    """
    jumps, odd = h.jumps(theta[None]), np.nan_to_num(seen.odd[0, 0])
    return np.maximum(odd, on_second(seen, jumps)) if jumps.louder[0] else odd


def _is_same(p, q):
    """Are two priors one, so that their coordinates are?"""
    return p is q or type(p) is type(q) is Parameter and p == q
