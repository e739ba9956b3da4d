"""Evidence of a hypothesis, Eq. (11), by adaptive importance sampling.

One evidence, two engines: `identify` zooms a grid, exact for the few parameters of a
hypothesis; effects add parameters until a grid of them is too large, so that
`integrate` draws nodes from laws that learn where the posterior is. A test holds the
one against the other.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import chi2, multivariate_t
from scipy.stats.qmc import LatinHypercube

from sensorid import (
    GROUP, LOG_2PI, at_quantiles, brief, free_columns, middles, tempered)
from sensorlab.gap.effects import LONG_RECORD


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


def or_nothing(log_likelihood):
    """Log-likelihoods, NOTHING where they are not finite."""
    return np.where(np.isfinite(log_likelihood), log_likelihood, NOTHING)


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
    move : OnsetLaw or ScaleLaw, optional
        A function of theta (M, p) that gives theta mapped to where the mass is, and the
        log of the prior density there over that of what is mapped, (M,); its `flat` are
        the columns in which the posterior of what is mapped is about the prior.
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
        return _Points(x, theta, moved, or_nothing(ll))

    def heights_at(x):
        return located(x).log_posterior

    d = len(free_columns(parameters))
    if d == 0:
        one = located(np.zeros((1, 0)))
        return Sample(one.theta, one.x, one.moved, one.log_likelihood,
                      one.log_likelihood[0])
    rng, flat = np.random.default_rng(seed), [] if move is None else [
        free_columns(parameters).index(column) for column in move.flat]
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
            start, height, law = _to_climb(heights_at, points, modes, near)
            modes.append(_flattened(*climb(heights_at, start, flat, law), flat))
            top = heights_at(modes[-1][0][None])[0]
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


def _to_climb(heights_at, points, modes, laws):
    """Where to climb from, away from modes that are known: the most probable point, or
    the mean of the nearest of some laws if that is higher; its height, and that law, or
    None.
    """
    def is_new(x):
        return np.all([((x - mode)**2).sum(-1) > 1.0 for mode, _ in modes], axis=0)
    height = np.where(is_new(points.x), points.log_posterior, -np.inf)
    start, height = points.x[height.argmax()], height.max()
    law = min(laws, key=lambda law: ((law[0] - start)**2).sum(), default=None)
    if law and is_new(law[0]):
        middle = heights_at(law[0][None])[0]
        if middle > height:
            start, height = law[0], middle
    return start, height, law


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
                  # taken: there a curvature is taken again
NARROWEST = 1e-12    # variance, of the prior's
DERIVATIVE_STEP = 1e-2    # in standard deviations of the prior: wide enough to pass
                          # over the roughness that a mixture filter has
DAMPING = np.concatenate([[0.0], np.geomspace(1.0, 1e6, 13)])
HIGHER = 0.1      # nats, that are worth a step
HIGHER_BY_LAW = 0.5    # nats: that a law promises as much in vain does not disprove it


def climb(log_posterior, x, flat=(), law=None):
    """Mode (d,) uphill from x, and the covariance (d, d) of the normal law there; axes
    that are `flat` are left as they are.

    Newton's steps, each of them at several dampings at once (D. Marquardt, J. SIAM 11,
    1963); `log_posterior` takes (M, d), its prior is N(0, I). The curvature is that of
    a `law`, a mean and a covariance, if there is one, as long as it keeps half of what
    it promises: to take it costs d / 4 times as many points as a slope.
    """
    start, moves = x, np.setdiff1d(np.arange(len(x)), flat)

    def heights_at(x):
        whole = np.tile(start, (len(x), 1))
        whole[:, moves] = x
        return log_posterior(whole)

    def is_far():
        return np.sum(width * (axes.T @ (x - taken))**2) > len(x) * FAR**2
    x, taken, width = start[moves], None, None
    if law:
        width, axes = np.linalg.eigh(law[1][np.ix_(moves, moves)])
        width = 1.0 / np.clip(width, NARROWEST, 1.0)
    for _ in range(MAX_CLIMB):
        if width is None or taken is not None and is_far():
            taken, (height, slope, width, axes) = x, _curvature(heights_at, x)
        else:
            height, slope = _slope(heights_at, x)
        push = axes.T @ slope
        tries = x + (push / (width + DAMPING[:, None])) @ axes.T
        heights = heights_at(tries)
        gain, promised = heights.max() - height, 0.5 * np.sum(push**2 / width)
        x = tries[heights.argmax()] if gain > HIGHER else x
        if taken is None and gain < 0.5 * promised - HIGHER_BY_LAW:
            width = None    # it is not the law of what is here
        elif gain <= HIGHER:
            break
    if width is None or taken is not None and is_far():
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
