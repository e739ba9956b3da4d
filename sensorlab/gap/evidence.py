"""Evidence of a hypothesis, Eq. (11), by adaptive importance sampling.

One evidence, two engines: `identify` zooms a grid, exact for the few parameters of a
hypothesis; effects add parameters until a grid of them is too large, so that
`integrate` draws nodes from laws that learn where the posterior is. A test holds the
one against the other.
"""

from typing import Callable, NamedTuple

import numpy as np
from numba import njit
from scipy.special import ndtr, ndtri
from scipy.stats import chi2, multivariate_t
from scipy.stats.qmc import LatinHypercube

from sensorid import (
    GROUP, INSIDE, LOG_2PI, at_quantiles, brief, free_columns, middles, tempered)
from sensorlab.gap.effects import LONG_RECORD
from sensorlab.gap.filters import explained, in_parts, parts_at
from sensorlab.gap.kernels import (
    KERNEL, LANES, MOST_LANES, drive, groups, in_threads, load, observe_covariance,
    observe_state, turn, turn_covariance, update_covariance, update_state)

log_sum = np.logaddexp.reduce    # of few: that of SciPy takes twenty times as long


class Sample(NamedTuple):
    """A weighted sample of a posterior."""

    theta: np.ndarray           # (M, p)
    x: np.ndarray               # (M, d) the coordinates of `integrate`
    log_weight: np.ndarray      # (M,) ln prior / proposal
    log_likelihood: np.ndarray  # (M, E), of E rival explanations
    log_evidence: np.ndarray    # (E,)

    __repr__ = brief

    @property
    def weight(self):
        """Posterior weights over all explanations, (M,)."""
        return normalized(self.log_weight + log_sum(self.log_likelihood, axis=1))

    @property
    def error(self):
        """Standard deviations (E,) of the log evidences by chance of the nodes, nats.
        """
        log_weight = self.log_weight[:, None] + self.log_likelihood
        w = np.exp(log_weight - log_weight.max(0))
        share = (w**2).sum(0) / w.sum(0)**2
        return np.sqrt(np.maximum(share - 1.0 / len(w), 0.0))

    @property
    def mean(self):
        """Posterior mean (p,)."""
        return self.weight @ self.theta

    @property
    def likeliest(self):
        """Theta (p,) of the largest likelihood without a further explanation."""
        return self.theta[self.log_likelihood[:, 0].argmax()]

    def sd(self, about=None):
        """Root mean square distance (p,) from the mean, or from a value (p,)."""
        about = self.mean if about is None else about
        return np.sqrt(self.weight @ (self.theta - about)**2)

    @property
    def law(self):
        """Mean (d,) and covariance (d, d) in the coordinates of `integrate`."""
        return moments(self.weight, self.x)

    def nodes(self, count, explanation=None):
        """Theta (count, p) at even quantiles of the weights, of one explanation or all.
        """
        w = self.weight if explanation is None else normalized(
            self.log_weight + self.log_likelihood[:, explanation])
        at = np.searchsorted(np.cumsum(w), middles(count))
        return self.theta[np.minimum(at, len(w) - 1)]


def normalized(log_weight):
    """Weights that sum to 1."""
    w = np.exp(log_weight - log_weight.max())
    return w / w.sum()


def moments(w, x):
    """Mean (d,) and covariance (d, d) of points x (M, d) of weights w."""
    return w @ x, np.atleast_2d(np.cov(x.T, aweights=w, ddof=0))


ROUND = 2 * GROUP         # points of a round; the bank takes whole groups
MAX_ROUNDS = 18
ENOUGH_POINTS = 60.0      # effective ones at which the evidence is good to 0.13 nat
ROUNDS_TO_CLIMB = 1       # in which no mode was found, where none is guessed
MISSED_NATS = 2.0         # that a mode is above all points of a sample that missed it
HOPELESS_NATS = 3.0       # below a rival: what the mean evidence would hardly notice
FLATTER = 0.3             # power of the likelihood that draws tails
NOTHING = -1e100          # log-likelihood where a filter breaks down


def effort(scene):
    """Share of the points that a record of this length is worth: of a long one, what
    differs differs by more.
    """
    N = len(scene.y)
    return 1.0 if N <= LONG_RECORD else 0.5 if N <= 10 * LONG_RECORD else 0.25


class _Points(NamedTuple):
    """Points of a sample and what is known there."""

    x: np.ndarray                 # (M, d)
    theta: np.ndarray             # (M, p)
    moved: np.ndarray             # (M,) ln prior there over that of what was mapped
    log_likelihood: np.ndarray    # (M, E)

    @property
    def total(self):
        """Log-likelihood over all explanations, (M,)."""
        return self.log_likelihood[:, 0] if self.log_likelihood.shape[1] == 1 else (
            log_sum(self.log_likelihood, axis=1))

    @property
    def log_posterior(self):
        """Up to a constant, (M,)."""
        return self.total + self.moved - 0.5 * (self.x**2).sum(1)

    def log_weight(self, proposals):
        """ln prior over the mixture of all proposals (count, log density), (M,)."""
        log_q = log_sum([np.log(n) + law(self.x) for n, law in proposals], axis=0)
        return self.moved + _log_normal(self.x) - log_q

    def joined(self, others):
        return _Points(*map(np.concatenate, zip(self, others)))


def _log_normal(x):
    """Log density of N(0, I) at x (M, d)."""
    return -0.5 * (x * x).sum(1) - 0.5 * x.shape[1] * LOG_2PI


def integrate(log_likelihood, parameters, guesses=(), move=None, floor=-np.inf,
              seed=0, effort=1.0, tails=0):
    """Evidence and posterior sample by adaptive multiple importance sampling.

    Parameters
    ----------
    log_likelihood : function of theta (M, p)
        Gives (M, E): log-likelihoods of E rival explanations, whose sum is sampled.
    parameters : tuple of Parameter
        One with a `log_ratio` is drawn from another law than its prior.
    guesses : sequence of (d,) and (d, d) array, optional
        Means and covariances that the d free parameters may have, in the coordinates
        where the prior is standard normal.
    move : OnsetLaw, optional
        A function of theta (M, p) that gives theta mapped to where the mass is, and the
        log of the prior density there over that of what is mapped, (M,); the posterior
        of what it has mapped is about the prior.
    floor : float
        An evidence this low need not be known well.
    seed : int
    effort : float
        Share of ENOUGH_POINTS at which it is done, and of ROUND down to a GROUP.
    tails : int
        Further rounds, from a flatter posterior: a long tail, which hardly adds to the
        evidence, does to standard deviations.

    Returns
    -------
    Sample

    Notes
    -----
    J.-M. Cornuet, J.-M. Marin, A. Mira, C. Robert, "Adaptive multiple importance
    sampling", Scand. J. Stat. 39, 2012. Coordinates in which the prior is N(0, I) have
    no edges. Early proposals follow a guess that hit, or else the tempered posterior.
    """
    sought = [c for c, p in enumerate(parameters) if hasattr(p, "log_ratio")]

    def located(x):
        theta, moved = at_quantiles(parameters, ndtr(x)), np.zeros(len(x))
        for column in sought:
            moved += parameters[column].log_ratio(theta[:, column])
        if move is not None:
            theta, more = move(theta)
            moved += more
        ll = log_likelihood(theta)
        return _Points(x, theta, moved, np.where(np.isfinite(ll), ll, NOTHING))

    d = len(free_columns(parameters))
    if d == 0:
        one = located(np.zeros((1, 0)))
        return Sample(one.theta, one.x, one.moved, one.log_likelihood,
                      one.log_likelihood[0])
    rng, flat = np.random.default_rng(seed), [] if move is None else [
        free_columns(parameters).index(move.column)]
    guesses = [_flattened(*law, flat) for law in guesses]
    few, enough = max(round(effort * ROUND), GROUP), effort * ENOUGH_POINTS
    x, proposals = _first_points(d, guesses, few, rng)
    points, modes, missed = located(x), [], True
    patience = round(ROUNDS_TO_CLIMB / effort) - bool(guesses)    # a climb costs many
    for attempt in range(MAX_ROUNDS):
        log_weight = points.log_weight(proposals)
        effective = 1.0 / np.sum(normalized(points.total + log_weight)**2)
        found = effective >= min(5.0 * (d + 1), 0.5 * enough)
        below = floor - log_sum(points.total + log_weight)
        near = _that_hit(guesses, points)
        # an evidence is a mean likelihood, and no more than its peak, which is near a
        # guess that tells of all, or a mode
        low = bool(modes or any(_tells_of_all(law, flat) for law in near)) and (
            points.total.max() + d < floor - HOPELESS_NATS)
        hopeless = low or below > HOPELESS_NATS and effective >= 2.0 * (d + 1) or (
            below > 3.0 * HOPELESS_NATS and attempt > patience + 2)
        if effective >= enough or hopeless:
            break
        first = patience + bool(guesses and near)
        if attempt in (first, first + 1) and missed and not found:
            start, height = _highest(points, modes)
            modes.append(_flattened(*climb(
                lambda x: located(x).log_posterior, start, flat), flat))
            top = located(modes[-1][0][None]).log_posterior[0]
            # a second one may be missed, too; the best of a round is not at the top
            missed = top > height + MISSED_NATS + 0.5 * chi2.ppf(1.0 / few, d)
            law = modes[-1]
        else:
            law = _flattened(*_next_law(points, log_weight, effective, found,
                                        modes or near), flat)
        x, density = _drawn(*law, few, rng)
        proposals.append((few, density))
        points = points.joined(located(x))
    for _ in range(tails):
        share = normalized(FLATTER * points.total + points.log_weight(proposals))
        x, density = _drawn(*_flattened(*moments(share, points.x), flat), few, rng)
        proposals.append((few, density))
        points = points.joined(located(x))
    log_weight = points.log_weight(proposals)
    return Sample(points.theta, points.x, log_weight, points.log_likelihood, log_sum(
        points.log_likelihood + log_weight[:, None], axis=0))


def _flattened(mean, cov, flat):
    """A normal law in which some axes are as in the prior N(0, I)."""
    mean, cov = mean.copy(), cov.copy()
    mean[flat], cov[flat], cov[:, flat] = 0.0, 0.0, 0.0
    cov[flat, flat] = 1.0
    return mean, cov


def _tells_of_all(law, flat):
    """Does a guess tell more than the prior N(0, I) of every axis that is not flat?"""
    mean, cov = law
    as_before = (mean == 0.0) & (cov == np.eye(len(mean))).all(1)
    as_before[flat] = False
    return not as_before.any()


def _first_points(d, guesses, few, rng):
    """Points of a Latin hypercube of the prior, and of guesses if there are any; the
    proposals that they come from.
    """
    count = few // 4 if guesses else ROUND
    x = [ndtri(LatinHypercube(d, rng=rng).random(count))]
    proposals = [(count, _log_normal)]
    for law in guesses:
        more, density = _drawn(*law, few, rng)
        x.append(more)
        proposals.append((few, density))
    return np.vstack(x), proposals


def _drawn(mean, cov, count, rng):
    """Points from a Student t somewhat wider than a law, and its density."""
    # by standard deviations: one parameter may be known a million times as well
    eye = np.eye(len(mean))
    wider = 1.2 * cov + 1e-12 * eye
    sd = np.sqrt(np.diag(wider))
    law = multivariate_t(np.zeros(len(mean)), wider / np.outer(sd, sd) + 1e-6 * eye,
                         df=5)
    x = mean + sd * law.rvs(count, random_state=rng).reshape(count, len(mean))
    return x, lambda x: np.reshape(law.logpdf((x - mean) / sd), len(x)) - np.log(
        sd).sum()


def _highest(points, modes):
    """The most probable point away from modes that are known, and how probable."""
    height = points.log_posterior
    for mode, _ in modes:
        height[((points.x - mode)**2).sum(1) < 1.0] = -np.inf
    return points.x[height.argmax()], height.max()


NEAR = 3.0    # times the standard deviations of a guess, on average over all axes


def _that_hit(guesses, points):
    """Those guesses that the most probable point is near."""
    best = points.x[points.log_posterior.argmax()]
    return [(mean, cov) for mean, cov in guesses if (best - mean) @ np.linalg.solve(
        cov + 1e-12 * np.eye(len(mean)), best - mean) < NEAR**2 * len(mean)]


def _next_law(points, log_weight, effective, found, laws):
    """Mean and covariance of what the points know of the posterior, or, as long as they
    know little, of the nearest of some laws about them, or of a tempered posterior.
    """
    d = points.x.shape[1]
    w = normalized(points.total + log_weight)
    if not found and not laws:
        w = tempered(log_weight, points.total, 5.0 * (d + 1))[1]
    mean, cov = moments(w, points.x)
    if not found and laws:    # few points tell little of their own spread
        near = min(laws, key=lambda law: ((law[0] - mean)**2).sum())
        cov = (effective * cov + (d + 1) * near[1]) / (effective + d + 1)
    return mean, cov


MAX_CLIMB = 48    # steps
FAR = 1.0         # standard deviations, on average over all axes, from where it was
                  # taken: there a curvature is taken again, which costs d / 4 times as
                  # many points as a slope
DERIVATIVE_STEP = 1e-2    # in standard deviations of the prior: wide enough to pass
                          # over the roughness that a mixture filter has
DAMPING = np.concatenate([[0.0], np.geomspace(1.0, 1e6, 13)])


def climb(log_posterior, x, flat=()):
    """Mode (d,) uphill from x, and the covariance (d, d) of the normal law there; axes
    that are `flat` are left as they are.

    Newton's steps, each of them at several dampings at once (D. Marquardt, J. SIAM 11,
    1963); `log_posterior` takes (M, d), its prior is N(0, I).
    """
    start, moves = x, np.setdiff1d(np.arange(len(x)), flat)

    def heights_at(x):
        whole = np.tile(start, (len(x), 1))
        whole[:, moves] = x
        return log_posterior(whole)

    def is_far():
        return np.sum(width * (axes.T @ (x - taken))**2) > len(x) * FAR**2
    x = start[moves]
    taken, (height, slope, width, axes) = x, _curvature(heights_at, x)
    for step in range(MAX_CLIMB):
        if step:
            if is_far():
                taken, (height, slope, width, axes) = x, _curvature(heights_at, x)
            else:
                height, slope = _slope(heights_at, x)
        push = axes.T @ slope
        tries = x + (push / (width + DAMPING[:, None])) @ axes.T
        heights = heights_at(tries)
        if heights.max() < height + 0.1:
            break
        x = tries[heights.argmax()]
    if is_far():
        *_, width, axes = _curvature(heights_at, x)
    mode, cov = start.copy(), np.eye(len(start))
    mode[moves], cov[np.ix_(moves, moves)] = x, axes @ np.diag(1.0 / width) @ axes.T
    return mode, cov


def _slope(log_posterior, x):
    """Log posterior at x and its derivatives (d,)."""
    shift = DERIVATIVE_STEP * np.eye(len(x))
    lp = log_posterior(x + np.vstack([np.zeros((1, len(x))), shift, -shift]))
    up, down = lp[1:].reshape(2, -1)
    return lp[0], (up - down) / (2.0 * DERIVATIVE_STEP)


def _curvature(log_posterior, x):
    """`_slope`, and widths (d,) and axes (d, d) of minus the second derivatives."""
    d = len(x)
    shift = DERIVATIVE_STEP * np.eye(d)
    i, j = np.tril_indices(d, -1)
    both = shift[i] + shift[j]
    lp = log_posterior(x + np.vstack([np.zeros((1, d)), shift, -shift, both]))
    up, down = lp[1:1 + 2 * d].reshape(2, d)
    curvature = np.diag(2.0 * lp[0] - up - down)
    # to one side only, as to both it would take twice as many points
    curvature[i, j] = curvature[j, i] = up[i] + up[j] - lp[0] - lp[1 + 2 * d:]
    width, axes = np.linalg.eigh(curvature / DERIVATIVE_STEP**2)
    # the prior alone curves by 1
    return lp[0], (up - down) / (2.0 * DERIVATIVE_STEP), np.maximum(
        np.abs(width), 1.0), axes


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

    Drawn is a bin, then a sample in it; with the probability STRAY_SHARE any sample.
    """
    bins, stray, k, onset = np.exp(peak - peak.max()), u < STRAY_SHARE, 0, 0.0
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
    share = bins[k] * inside[int(np.ceil(onset)) - 1 - k * ONSET_BIN]
    return onset, np.log((1.0 - STRAY_SHARE) * share * len(gain) + STRAY_SHARE)


def draw_onsets(y, h, own, pair, rise, early, late, u, least, most):
    """Onsets of a change of noise, in samples, at quantiles u (M,) of their law, and
    the log of their density over that of a uniform law from least to most.

    The filter of the noise of variance early (M,) up to a sample and that of the noise
    of variance late (M,) from there on nearly give the likelihood of every onset at
    once. A law to draw from need not be exact: gains are kept once they have settled,
    and what may be an outlier or follows a gap counts little. y (N,) is a record less
    all constants, h (n,) observes the states, whose noises rise (M, 1) from there on.
    """
    onset, density = np.zeros((2, len(u)))
    # as many on any machine, since gains are kept once those of all lanes have settled;
    # what a law needs is as long as the record
    lanes = LANES if len(y) > LONG_RECORD else min(
        MOST_LANES, LANES * groups(len(u), LANES))
    in_threads(_draw_onset_groups, groups(len(u), lanes), lanes, y, h, own, pair, rise,
               early, late, u, least, most, onset, density)
    return onset, density


@njit(**KERNEL)
def _draw_onset_groups(first, last, lanes, y, h, own, pair, rise, early, late, u, least,
                       most, onset, density):
    """Groups of `draw_onsets`."""
    (M, n), N = own.shape[1:], len(y)
    for group in range(first, last):
        start, number = group * lanes, min(lanes, M - group * lanes)
        node = np.minimum(start + np.arange(lanes), M - 1)
        parts, P = np.empty((6, n, lanes)), np.empty((n, n, lanes))
        odds = np.zeros((N, lanes))
        for changed in range(2):
            load(own, pair, node, parts, P)
            if changed:
                drive(own, node, rise, 0, True, parts)
            _add_scores(y, h, pair, parts, P, (late if changed else early)[node],
                        changed - 0.5, odds)
        peak = np.full(((most - least - 1) // ONSET_BIN + 1, lanes), -np.inf)
        for i in range(1, most):
            for g in range(lanes):
                odds[i, g] += odds[i - 1, g]
        for i in range(least, most):
            at = (i - least) // ONSET_BIN
            for g in range(lanes):
                peak[at, g] = max(peak[at, g], odds[i, g])
        for g in range(number):
            onset[start + g], density[start + g] = _draw_onset(
                odds[least:most, g], peak[:, g], u[start + g])
            onset[start + g] += least


@njit(**INSIDE)
def _add_scores(y, h, pair, parts, P, r, factor, odds):
    """ln f + nu^2/f of every sample times a factor, added to odds (N, lanes), of
    filters abreast of white noise of variance r (lanes,).
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
                least[g] = np.sqrt(WILD_SQUARE * f[g])
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


class OnsetLaw(NamedTuple):
    """How `integrate` draws the onset of a change of noise."""

    moved: Callable    # theta (M, p) with its onset at the quantile of its law that it
                       # has in the prior, and ln prior over that law (M,)
    column: int        # of the onset in theta

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
        early, late = (parts_at(h, scene, at_onset(theta, when))
                       for when in (scene.duration, 0.0))
        rise = late.rise[:, :1].copy() if len(late.rise) else np.zeros((len(theta), 1))
        onset, density = draw_onsets(
            rest, early.h, early.own, early.pair, rise, early.r[:, 0].copy(),
            late.r[:, -1].copy(), (theta[:, at] - low) / (high - low), least, most)
        return at_onset(theta, onset * scene.dt), -density
    return OnsetLaw(moved, at)
