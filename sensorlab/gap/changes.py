"""When a noise changes: the law of onsets that nodes of an evidence are drawn from."""

from typing import Callable, NamedTuple

import numpy as np
from numba import njit

from sensorid import INSIDE, brief
from sensorlab.gap.effects import LONG_RECORD
from sensorlab.gap.kernels.lanes import (
    KERNEL, LANES, MOST_LANES, drive, groups, in_rows, in_threads, load,
    observe_covariance, observe_state, turn, turn_covariance, update_covariance,
    update_state)
from sensorlab.gap.linear import explained
from sensorlab.gap.parts import in_parts, parts_at

SETTLES = 64            # samples in which gains may have settled, for a law of onsets
STRAY_SHARE = 0.1       # probability of an onset anywhere at all
ONSET_BIN = 16          # samples whose likeliest onset stands for all of them at first
WILD_SQUARE = 25.0      # squared standard score of what may be an outlier


@njit(**INSIDE)
def _draw_one(mass, u):
    """Number at the quantile u of a law, and the quantile within it."""
    k = 0
    while k < len(mass) - 1 and u > mass[k]:
        u -= mass[k]
        k += 1
    return k, min(max(u / mass[k], 1e-6), 1.0)


@njit(**INSIDE)
def _draw_onset(gain, peak, u):
    """Onset, in samples, at the quantile u of a law of these log odds, and the log of
    its density over a uniform one; `peak` is the largest gain of every bin.

    Drawn is a bin, then a sample in it; with the probability STRAY_SHARE any sample,
    and always where filters broke down.
    """
    highest = peak.max()
    if not np.isfinite(highest):
        return max(u, 1e-9) * len(gain), 0.0
    bins, stray, k, onset = np.exp(peak - highest), u < STRAY_SHARE, 0, 0.0
    bins /= bins.sum()
    if stray:
        onset = max(u / STRAY_SHARE, 1e-9) * len(gain)
        k = int(np.ceil(onset) - 1) // ONSET_BIN
    else:
        k, u = _draw_one(bins, (u - STRAY_SHARE) / (1.0 - STRAY_SHARE))
    inside = np.exp(gain[k * ONSET_BIN:(k + 1) * ONSET_BIN] - peak[k])
    inside /= inside.sum()
    if not stray:
        at, u = _draw_one(inside, u)
        onset = k * ONSET_BIN + at + u
    share = bins[k] * inside[int(np.ceil(onset)) - 1 - k * ONSET_BIN] if (
        bins[k] > 0.0) else 0.0
    return onset, np.log((1.0 - STRAY_SHARE) * share * len(gain) + STRAY_SHARE)


def draw_onsets(y, h, own, pair, rise, r, wild, u, least, most):
    """Onsets of a change of noise, in samples, at quantiles u (M,) of their law, and
    the log of their density over that of a uniform law from least to most.

    The filter of the noise as it is before, up to a sample, and that of the noise as it
    is after, from there on, nearly give the likelihood of every onset at once. A law to
    draw from need not be exact: gains are kept once they have settled, and what may be
    an outlier or follows a gap counts little. y (N,) is a record less all constants, h
    (n,) observes the states, own (2, 10, M, n), whose noises rise (2, M, 1), in white
    noise of variance r (2, M), were it always as before, and as after; squares of
    standard scores are `wild` (2, M) at most.
    """
    onset, density = np.zeros((2, len(u)))
    h, u, r, wild = in_rows(h, u, r, wild)
    # as many on any machine, since gains are kept once those of all lanes have settled;
    # what a law needs is as long as the record
    lanes = LANES if len(y) > LONG_RECORD else min(
        MOST_LANES, LANES * groups(len(u), LANES))
    in_threads(_draw_onset_groups, groups(len(u), lanes), lanes, y, h, own, pair, rise,
               r, wild, u, least, most, onset, density)
    return onset, density


@njit(**KERNEL)
def _draw_onset_groups(first, last, lanes, y, h, own, pair, rise, r, wild, u,
                       least, most, onset, density):
    """Groups of `draw_onsets`."""
    (M, n), N = own.shape[2:], len(y)
    for group in range(first, last):
        start, number = group * lanes, min(lanes, M - group * lanes)
        node = np.minimum(start + np.arange(lanes), M - 1)
        parts, P = np.empty((6, n, lanes)), np.empty((n, n, lanes))
        odds = np.zeros((N, lanes))
        for changed in range(2):
            load(own[changed], pair, node, parts, P)
            drive(own[changed], node, rise[changed], 0, True, parts)
            _add_scores(y, h, pair, parts, P, r[changed][node], wild[changed][node],
                        changed - 0.5, odds)
        peak = np.full(((most - least - 1) // ONSET_BIN + 1, lanes), -np.inf)
        for i in range(1, most):
            for g in range(lanes):
                odds[i, g] += odds[i - 1, g]
        for i in range(least, most):
            at = (i - least) // ONSET_BIN
            for g in range(lanes):
                if np.isnan(odds[i, g]):
                    odds[i, g] = -np.inf
                peak[at, g] = max(peak[at, g], odds[i, g])
        for g in range(number):
            onset[start + g], density[start + g] = _draw_onset(
                odds[least:most, g], peak[:, g], u[start + g])
            onset[start + g] += least


@njit(**INSIDE)
def _add_scores(y, h, pair, parts, P, r, wild, factor, odds):
    """ln f + nu^2/f of every sample times a factor, added to odds (N, lanes), of
    filters abreast of white noise of variance r (lanes,); nu^2/f is `wild` (lanes,) at
    most.
    """
    n, lanes = len(h), len(r)
    x, Ph, gain = np.zeros((n, lanes)), np.empty((n, lanes)), np.empty(lanes)
    f, nu, weight, log_f = r.copy(), np.empty(lanes), np.empty(lanes), np.empty(lanes)
    least, before, settled = np.empty(lanes), np.zeros(lanes), False
    for i in range(len(y)):
        if not settled:
            for g in range(lanes):
                f[g] = r[g]
            turn_covariance(parts, pair, P)
            observe_covariance(parts, pair, h, P, Ph, f)
            for g in range(lanes):
                weight[g], log_f[g] = 1.0 / f[g], np.log(f[g])
                least[g] = np.sqrt(wild[g] * f[g])
            update_covariance(P, Ph, weight)
            if i % SETTLES == SETTLES - 1:
                settled = True
                for g in range(lanes):
                    settled = settled and abs(f[g] - before[g]) < 1e-9 * f[g]
                    before[g] = f[g]
        turn(parts, pair, x)
        seen = not np.isnan(y[i])
        for g in range(lanes):
            nu[g] = y[i] if seen else 0.0
        if seen:
            observe_state(h, x, nu)
            for g in range(lanes):
                nu[g] = min(max(nu[g], -least[g]), least[g])
                gain[g] = nu[g] * weight[g]
                odds[i, g] += factor * (log_f[g] + nu[g] * gain[g])
            update_state(x, Ph, gain)


def wild_squares(r, rise):
    """Squares of standard scores (2, M) from which a sample may be an outlier, or else
    of the louder of two noises, of which r and rise (2, M) are as for `draw_onsets`.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        louder = np.fmax(r[::-1] / r, (1.0 + rise[::-1]) / (1.0 + rise))
    return WILD_SQUARE * np.maximum(louder, 1.0)


class OnsetLaw(NamedTuple):
    """How `integrate` draws the onset of a change of noise."""

    moved: Callable    # theta (M, p) with its onset at the quantile of its law that it
                       # has in the prior, and ln prior over that law (M,)
    flat: tuple        # column of the onset in theta: of what has been mapped, its
                       # posterior is about the prior

    __repr__ = brief

    def __call__(self, theta):
        return self.moved(theta)


def onset_law(h, scene, signatures):
    """`OnsetLaw` of a hypothesis; None if no noise changes in it."""
    if not h.onsets or not h.parameters[h.keys.index(h.onsets[0])].free:
        return None
    at = h.keys.index(h.onsets[0])
    low, high = h.parameters[at].low, h.parameters[at].high
    least, most = round(low / scene.dt), min(round(high / scene.dt), len(scene.y) - 1)

    def at_onset(theta, onset):
        theta = theta.copy()
        theta[..., at] = onset
        return theta

    def moved(theta):
        return map(np.concatenate, zip(*map(part_moved, in_parts(h, scene, theta))))
    mean = np.array([p.mean for p in h.parameters])
    rest = scene.y - explained(h, scene, signatures, at_onset(mean, scene.duration))

    def part_moved(theta):
        one, other = both = [parts_at(h, scene, at_onset(theta, when))
                             for when in (scene.duration, 0.0)]
        rise = np.array([part.rise[:, :1] if len(part.rise) else np.zeros(
            (len(theta), 1)) for part in both])
        r = np.array([one.r[:, 0], other.r[:, -1]])
        onset, density = draw_onsets(
            rest, one.h, np.array([part.own for part in both]), one.pair, rise, r,
            wild_squares(r, rise[..., 0]), (theta[:, at] - low) / (high - low), least,
            most)
        return at_onset(theta, onset * scene.dt), -density
    return OnsetLaw(moved, (at,))
