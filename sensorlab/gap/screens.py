"""Screens: what the normal scores of a filter alone say of outliers, of bursts, of a
change of noise and of noise that follows a column, and what few nodes say of a level or
of a change of drive. Where they see nothing, or far less than of others, the filters
that would tell exactly need not run.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp, ndtr, ndtri

from sensorid import LOG_2PI, mesh, middles, side_by_side
from sensorlab.gap.filters import log_likelihoods, predict
from sensorlab.gap.kernels.lanes import KERNEL, LANES
from sensorlab.gap.kernels.mixtures import smoothed
from sensorlab.gap.linear import part_of
from sensorlab.gap.values import NORMAL_MEDIAN

FEW = -2.0        # ln B below which a screen has the last word
ONSETS = 2048     # at most, that are tried
RATIOS = 33       # values of a parameter that are tried
STRENGTHS = 13    # of the noise of states, that are tried
FINE = 1.0    # nats that the scale of the other samples may be off
SCALES = np.geomspace(0.5, 1.05, 25)    # of the other samples, where some are outliers
DRIVES = "sigma_w", "sigma_m"    # what drives the states of a hypothesis
DRIVEN = 1.0, 0.5, 0.25    # times as strongly, where a level explains some of it
QUIET_SCALES = np.geomspace(0.5, 1.0, 4)    # of the samples outside bursts
OF_BURSTS = 5     # values of each of their parameters that are tried
PARTS = 2**14     # of a record, at most, each of which is in a burst or not
OF_COLUMN = 512   # parts of its range


def screened(effect, scene, z, variance):
    """About ln B of an effect from normal scores z (N,) of innovations of that
    variance; NaN where no screen knows the effect.

    What else the filter knows is taken to stay as it is, but for the scale of the
    noise.
    """
    screen = SCREENS.get(effect.name)
    if screen is None or np.isnan(variance):
        return np.nan
    gain = screen(scene, effect.parameters(scene), z, variance)
    # two more parameters: as for an account, no more than by Akaike's correction
    return float(min(logsumexp(gain) - np.log(gain.size), gain.max() - 2.0))


class Louder(NamedTuple):
    """What normal scores tell of white noise that follows a column, or the time."""

    about: float    # ln B
    ratio: float    # likeliest
    off: float      # standard deviation of its logarithm
    rest: float     # times as strong as the filter has it, where x is `about`


def room_of_noise(h, theta):
    """How many times as strong, at least and at most, as at theta (p,) the ranges of a
    hypothesis let its white noise be.
    """
    for (_, symbol), p, value in zip(h.keys, h.parameters, theta):
        if symbol == "sigma_v" and value > 0.0:
            return p.low / value, p.high / value
    return 1.0, 1.0


def noise_with(h, one, z, room):
    """`Louder` of an effect of a hypothesis, `Found` with its ratio free, from normal
    scores as `screened` has them, with `room_of_noise`; by Laplace's method.
    """
    scene = h.scene
    prior, *known = one.values.values()
    x, seen, known = scene.along(one.column), ~np.isnan(z), {
        p.symbol: p.low for p in known}
    many, edges = np.histogram(x[seen], OF_COLUMN, (x.min(), x.max()))
    square, _ = np.histogram(x[seen], edges, weights=z[seen]**2)
    middle, low, high = 0.5 * (edges[1:] + edges[:-1]), *np.log([prior.low, prior.high])

    def fitted(square):
        """Scale of the noise, and twice the log-likelihood less, a sample."""
        scale = np.clip(np.sqrt(square.sum() / many.sum()), *room)
        return scale, square.sum() / many.sum() / scale**2 + 2.0 * np.log(scale)

    def of(log_ratio):
        """Strengths, and what is `fitted` beside them."""
        times = one.effect.drive(scene, x=middle, variant=one.variant, ratio=np.exp(
            log_ratio), **known)
        return times, *fitted(square / times**2)
    _, even = fitted(square)

    def gain(log_ratio):
        times, _, uneven = of(log_ratio)
        return 0.5 * many.sum() * (even - uneven) - many @ np.log(times)
    best = minimize_scalar(lambda at: -gain(at), bounds=(low, high), method="bounded").x
    most, apart = gain(best), 1e-2
    bent = (2.0 * most - gain(best - apart) - gain(best + apart)) / apart**2
    off = 1.0 / np.sqrt(max(bent, 1e-9))
    return Louder(float(most + min(np.log(np.sqrt(2.0 * np.pi) * off / (high - low)),
                                   -1.0)), float(np.exp(best)), float(off),
                  float(of(best)[1]))


def usual_variance(z, log_score):
    """Variance of most innovations, of these normal scores and log densities (N,); NaN
    where the filter foretells none.
    """
    near = np.abs(z) < 5.0
    return np.exp(-np.median(2.0 * log_score[near] + z[near]**2) - LOG_2PI) if (
        near.any()) else np.nan


def _change_of_noise(scene, priors, z, variance):
    """ln of mean gains of the likelihood over that of even noise, by onset (K,): about
    the likeliest ratio, which a long record knows far better than any row of values.
    """
    seen, (onset, ratio) = ~np.isnan(z), priors
    first, last = np.searchsorted(scene.time, [onset.low, onset.high])
    at = np.unique(np.linspace(first, last, ONSETS).astype(int))
    early = np.append(0.0, np.cumsum(np.where(seen, z, 0.0)**2))[at]
    before, count = np.append(0, np.cumsum(seen))[at], seen.sum()
    total, after = np.nansum(z**2), count - before
    with np.errstate(divide="ignore", invalid="ignore"):    # a side may show no sample
        best = np.sqrt((total - early) * before / (after * early))
        width = np.sqrt(np.pi * (1.0 / before + 1.0 / after)) / np.log(
            ratio.high / ratio.low)
    best = np.clip(np.nan_to_num(best, nan=1.0), ratio.low, ratio.high)
    even = (early + (total - early) / best**2) / total
    return -0.5 * count * np.log(even) - after * np.log(best) + np.log(
        np.minimum(width, 1.0))


def _outliers(scene, priors, z, variance):
    """Gains (rates, sigmas) of the log-likelihood over that without outliers."""
    seen = np.abs(z[~np.isnan(z)])
    edges = np.concatenate([np.linspace(0.0, 8.0, 401), np.geomspace(8.1, 1e4, 200)])
    count, _ = np.histogram(seen, edges)
    square = (0.5 * (edges[1:] + edges[:-1])[count > 0])**2
    count = count[count > 0]
    rate, sigma = (p.quantile(middles(RATIOS)) for p in priors)
    wide = sigma**2 / variance

    def gains(scale):
        own, other = scale**2, scale**2 + wide[:, None]
        bulk = np.exp(-0.5 * square / own) / scale
        tail = np.exp(-0.5 * square / other) / np.sqrt(other)
        law = (1.0 - rate[:, None, None]) * bulk + rate[:, None, None] * tail
        return np.log(law + 1e-300) @ count
    scale = np.sqrt(square @ count / count.sum())
    return _at_best_scale(gains, SCALES, count.sum()) - count @ (
        -0.5 * square / scale**2 - np.log(scale))


def _at_best_scale(gains, scales, count):
    """The largest `gains` at scales of the noise, ever finer about the best, as finely
    as a record of so many samples knows it.
    """
    every, apart = [gains(scale) for scale in scales], scales[1] / scales[0]
    best = scales[np.argmax([gain.max() for gain in every])]
    while count * np.log(apart)**2 > FINE:
        near, apart = best * apart**np.array([-0.5, 0.5]), apart**0.5
        own = [gains(scale) for scale in near]
        if max(gain.max() for gain in own) > np.max(every):
            best = near[int(own[1].max() > own[0].max())]
        every += own
    return np.max(every, 0)


def _bursts(scene, priors, z, variance):
    """Gains (quiets, durations, sigmas) of the log-likelihood over that of even noise.
    """
    values = [p.quantile(middles(OF_BURSTS)) for p in priors]
    return _at_best_scale(lambda scale: _gains_of_bursts(
        scene, values, z, variance, [scale])[0], QUIET_SCALES, np.sum(~np.isnan(z)))


def _gains_of_bursts(scene, values, z, variance, scales=QUIET_SCALES):
    """The same for all scales of the samples outside bursts, the first axis."""
    quiet, duration, sigma = values
    parts = _Parts.of(z)
    begin, end = (parts.chance(scene.dt, t) for t in mesh(quiet, duration).T)
    gain = np.zeros((len(scales), len(sigma), len(begin)))
    for own, scale in zip(gain, scales):
        for one, s in zip(own, sigma):
            _sum_histories(*parts.laws(scale, s**2 / variance), begin, end,
                           np.empty((0, 0)), one)
    return gain.reshape(*gain.shape[:2], len(quiet), -1).transpose(0, 2, 3, 1)


class _Parts(NamedTuple):
    """Normal scores, by parts of a record."""

    square: np.ndarray    # (P,) sums
    count: np.ndarray     # (P,) of samples seen
    width: int            # samples of a part

    @classmethod
    def of(cls, z):
        width = -(-len(z) // PARTS)
        begin = np.arange(0, len(z), width)
        return cls(np.add.reduceat(np.nan_to_num(z)**2, begin),
                   np.add.reduceat(~np.isnan(z) * 1.0, begin), width)

    def chance(self, dt, mean):
        """That what lasts for a mean time, s, ends in a part."""
        return -np.expm1(-self.width * dt / mean)

    def laws(self, scale, wide):
        """Log-likelihoods (P,), over those of even noise, without and with a burst that
        adds a variance, at a scale of the noise outside.
        """
        even = self.square.sum() / self.count.sum()
        return [-0.5 * (self.count * np.log(v / even) + self.square * (
            1.0 / v - 1.0 / even)) for v in (scale**2 * even, scale**2 * even + wide)]


@njit(**KERNEL)
def _sum_histories(first, second, begin, end, told, gain):
    """Sums over all histories of a level that is one of two, whose log-likelihoods by
    part are first and second (P,): their logarithms are added to gain (K,).

    begin and end (K,) are the chances that the second level begins and ends, a part;
    told (K or 0, P) gets the probability that it is there by all parts so far.
    """
    p, product = begin / (begin + end), np.ones(len(begin))
    for part in range(len(first)):
        odds = np.exp(min(second[part] - first[part], 80.0))
        for k in range(len(p)):
            before = p[k] * (1.0 - end[k]) + (1.0 - p[k]) * begin[k]
            mass = 1.0 - before + before * odds
            p[k] = before * odds / mass
            product[k] *= mass
        for k in range(len(told)):
            told[k, part] = p[k]
        if part % 4 == 3 or part == len(first) - 1:    # of few, none is too large
            for k in range(len(p)):
                gain[k] += np.log(product[k])
                product[k] = 1.0
    gain += first.sum()


SHARP = 4.0         # nats from one strength to the next, if these are too far apart
FINEST = 0.5**10    # steps of the strengths
LITTLE = 1.0    # ln B by a screen of a change of drive, or of a level, below which its
                # filters, which take long, need not run: others have more


class Told(NamedTuple):
    """What a screen tells of a change of what drives a hypothesis's states."""

    about: float       # ln B
    onset: int         # likeliest sample
    quantile: float    # of the prior, of the likeliest ratio


def change_of_drive(effect, scene, member, signatures, theta):
    """`Told` of an effect, at theta (p,), from the scores of filters whose states are
    driven this strongly or that from the first sample to the last.
    """
    onset, ratio = effect.parameters(scene)
    first, last = np.searchsorted(scene.time, [onset.low, onset.high])
    at = np.unique(np.linspace(first, last, ONSETS).astype(int))
    h = member.with_effect(effect)

    def scored(number):
        strength = ratio.quantile(0.5 + number / STRENGTHS)
        score = predict(h, scene, signatures, np.append(
            theta, [onset.low, strength])[None]).log_score[0, 0]
        so_far = np.append(0.0, np.cumsum(np.nan_to_num(score)))
        return so_far[at], so_far[-1]
    some, apart = np.arange(STRENGTHS) - STRENGTHS // 2, 1.0
    known = dict(zip(some.tolist(), side_by_side(scored, some)))
    while apart > FINEST and (known[0][1] - SHARP > min(
            known[apart][1], known[-apart][1])):    # a long record knows it better
        apart /= 2.0
        known.update(zip((-apart, apart), side_by_side(scored, [-apart, apart])))
    number = np.sort(list(known))
    early, whole = map(np.array, zip(*(known[k] for k in number)))
    width, own = np.log(np.gradient(number) / STRENGTHS), np.flatnonzero(number == 0.0)

    def told(begin, even):
        """`Told` of a drive that is as in `begin` of the strengths first, beside one
        that is `even`.
        """
        gain = (width[begin, None] + early[begin])[:, None] + (
            width[:, None] + whole[:, None] - early)
        before, after, first = np.unravel_index(gain.argmax(), gain.shape)
        top = gain[before, after, first] - width[begin[before]] - width[after]
        return Told(float(min(logsumexp(gain) - np.log(len(at)) - even,
                              top - whole[begin].max() - 2.0)), int(at[first]), float(
            np.clip(0.5 + (number[after] - number[begin[before]]) / STRENGTHS,
                    0.5 / STRENGTHS, 1.0 - 0.5 / STRENGTHS)))
    # where the simulator's own strength may not move, it is the first of the two
    return max(told(np.arange(len(number)), logsumexp(width + whole)), told(
        own, width[own[0]] + whole[own[0]]))


LEVEL_NODES = 4    # values of each parameter of a level that are tried
CLOSER = 3         # times that parts about the best are tried
CLOSER_NATS = 20.0    # by which the last must have been better for the next
HEAD = 10**5       # samples of a longer record that tell where more values are tried
TRIED = LANES      # of them, on the whole of it


def change_of_level(effect, scene, member, signatures, theta):
    """About ln B of an effect with jumps, from its filter at some values of its
    parameters, then about the best of them, beside a member at theta (p,) whose states
    are driven less.
    """
    h, priors = member.with_effect(effect), effect.parameters(scene)
    driven = [symbol in DRIVES for _, symbol in member.keys]
    if not any(driven):    # the white noise has taken all
        driven = [symbol == "sigma_v" for _, symbol in member.keys]

    def up_to(samples):
        seen, known = part_of(scene, signatures, slice(samples))
        return seen, known, log_likelihoods(member, seen, known, theta[None])
    whole = up_to(len(scene.y))
    head = whole if member.onsets or len(scene.y) <= HEAD else up_to(HEAD)

    def gains(part, at):
        seen, known, even = part
        own = [p.quantile(column) for p, column in zip(priors, at.T[1:])]
        return log_likelihoods(h, seen, known, np.column_stack(
            [theta * np.where(driven, at[:, :1], 1.0), *own])) - even

    def closer_to(best, gains, first=0):
        """ln of the sum of gains about the best values so far, the largest gain, the
        values there, and the number of the last of ever smaller parts that had it.
        """
        worth, highest = -np.inf, -np.inf
        for closer in range(first, CLOSER):
            strength, *u = best
            apart = 3.0**-closer * finer    # a strong one is at home in a small part
            at = mesh(strength * 2.0**apart, *(v + apart / LEVEL_NODES for v in u))
            near = gains(at)
            worth = max(worth, logsumexp(along(near, apart)) - p * (
                closer + 1.0) * np.log(3.0))
            rise, highest = near.max() - highest, near.max()
            if rise < CLOSER_NATS:
                break
            best, first = at[near.argmax()], closer
        return worth, highest, best, first

    def of_head(at):
        """As many as the whole has, if all of it is like its head."""
        return len(scene.y) / HEAD * gains(head, at)

    def of_whole(at):
        """Of those that have most in the head."""
        result, own = np.full(len(at), -np.inf), np.argsort(-of_head(at))[:TRIED]
        result[own] = gains(whole, at[own])
        return result

    def along(gain, strengths):
        return gain.reshape(len(strengths), -1).max(0)
    p, finer = len(priors), np.arange(-1, 2) / 3.0
    at = mesh(DRIVEN, *p * [middles(LEVEL_NODES)])
    gain = gains(head, at)
    best, gain = at[gain.argmax()], along(gain, DRIVEN)
    if head is whole:
        worth, highest, *_ = closer_to(best, lambda at: gains(whole, at))
    else:
        *_, best, first = closer_to(best, of_head)
        worth, highest, *_ = closer_to(best, of_whole, first)
    gain[gain.argmax()] = worth
    return float(min(logsumexp(gain) - p * np.log(LEVEL_NODES), highest - 2.0))


def law_of_outliers(scene, effect, z, variance):
    """Probability (N,) that samples of these normal scores are outliers; mean (2,) and
    covariance (2, 2) of rate and sigma in coordinates where their prior is N(0, I).
    """
    u = middles(RATIOS)
    priors = effect.parameters(scene)
    gain = _outliers(scene, priors, z, variance)
    x = mesh(*2 * [ndtri(u)])
    w = np.exp(gain - logsumexp(gain)).ravel()
    mean, cov = w @ x, np.cov(x.T, aweights=w, ddof=0) + np.eye(2) / RATIOS
    rate, sigma = (p.quantile(ndtr(m)) for p, m in zip(priors, mean))
    own = (np.nanmedian(np.abs(z)) / NORMAL_MEDIAN)**2
    other = own + sigma**2 / variance
    with np.errstate(over="ignore"):
        odds = (1.0 - rate) / rate * np.sqrt(other / own) * np.exp(
            -0.5 * z**2 * (1.0 / own - 1.0 / other))
    return np.nan_to_num(1.0 / (1.0 + odds)), mean, cov


def law_of_bursts(scene, effect, z, variance):
    """Probability (N,) that samples of these normal scores are in a burst of noise;
    mean (3,) and covariance (3, 3) of its parameters in coordinates where their prior
    is N(0, I).
    """
    u = middles(OF_BURSTS)
    values = [p.quantile(u) for p in effect.parameters(scene)]
    gain = _gains_of_bursts(scene, values, z, variance)
    scale, *best = np.unravel_index(gain.argmax(), gain.shape)
    x = mesh(*3 * [ndtri(u)])
    w = logsumexp(gain, axis=0).ravel()
    w = np.exp(w - logsumexp(w))
    mean, cov = w @ x, np.cov(x.T, aweights=w, ddof=0) + np.eye(3) / OF_BURSTS
    quiet, duration, sigma = (v[k] for v, k in zip(values, best))
    parts = _Parts.of(z)
    begin, end = (parts.chance(scene.dt, np.array([t])) for t in (quiet, duration))
    told = np.empty((1, len(parts.count)))
    _sum_histories(*parts.laws(QUIET_SCALES[scale], sigma**2 / variance), begin, end,
                   told, np.zeros(1))
    loud = np.repeat(smoothed(told[0], begin[0], end[0]), parts.width)[:len(z)]
    return loud, mean, cov


SCREENS = dict(noise_step=_change_of_noise, outliers=_outliers, noise_bursts=_bursts)
LAWS = dict(outliers=law_of_outliers, noise_bursts=law_of_bursts)    # of odd samples
