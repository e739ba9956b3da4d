"""Evidence of a hypothesis by adaptive importance sampling."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange
from scipy.special import logsumexp, ndtr, ndtri

from sensorid import GROUP, JIT, LOG_2PI, at_quantiles, free_columns
from sensorlab.gap.filters import ABREAST, _value, _with_constants


class Sample(NamedTuple):
    """A weighted sample of a posterior."""

    theta: np.ndarray           # (M, p)
    x: np.ndarray               # (M, d) the coordinates of `integrate`
    log_weight: np.ndarray      # (M,) ln prior / proposal
    log_likelihood: np.ndarray  # (M, E), of E rival explanations
    log_evidence: np.ndarray    # (E,)

    @property
    def weight(self):
        """Posterior weights over all explanations, (M,)."""
        w = self.log_weight + logsumexp(self.log_likelihood, axis=1)
        w = np.exp(w - w.max())
        return w / w.sum()


POINTS = 2 * GROUP    # of a round; the bank takes whole groups
ROUNDS = 18       # at most
ENOUGH = 60.0     # effective points at which the evidence is good to 0.13 nat
LOST = 4          # rounds after which a mode is climbed if none has been found
MISSED = 2.0      # nats that a mode is above all points of a sample that missed it
STEP = 1e-2       # of numerical derivatives, in standard deviations of the prior: wide
                  # enough to pass over the roughness that a mixture filter has


HOPELESS = 3.0    # nats below a rival: what the mean evidence would hardly notice


def _log_t(x, mean, chol, nu=5.0):
    """Log density of a multivariate Student t, up to a constant of d and nu."""
    e = np.linalg.inv(chol) @ (x - mean).T
    d = len(mean)
    return (-0.5 * (nu + d) * np.log1p((e * e).sum(0) / nu)
            - np.log(np.diag(chol)).sum()
            + math.lgamma(0.5 * (nu + d)) - math.lgamma(0.5 * nu)
            - 0.5 * d * np.log(nu * np.pi))


def integrate(log_likelihood, parameters, guess=None, move=None, floor=-np.inf,
              seed=0):
    """Evidence and posterior sample by adaptive multiple importance sampling.

    Parameters
    ----------
    log_likelihood : function of theta (M, p)
        Gives (M, E): log-likelihoods of E rival explanations, whose sum is sampled.
    parameters : tuple of Parameter
    guess : (k,) and (k, k) array, optional
        Mean and covariance that the first k free parameters may have, in the
        coordinates where the prior is standard normal.
    move : function of theta (M, p), optional
        Gives theta mapped to where the mass is, and the log of the prior density there
        over that of what is mapped, (M,).
    floor : float
        An evidence this low need not be known well.
    seed : int

    Returns
    -------
    Sample

    Notes
    -----
    J.-M. Cornuet, J.-M. Marin, A. Mira, C. Robert, "Adaptive multiple importance
    sampling", Scand. J. Stat. 39, 2012. Coordinates in which the prior is N(0, I) have
    no edges. Early proposals follow the tempered posterior.
    """
    def located(x):
        theta, moved = at_quantiles(parameters, ndtr(x)), np.zeros(len(x))
        if move is not None:
            theta, moved = move(theta)
        # where a filter breaks down nothing is explained
        ll = log_likelihood(theta)
        return theta, moved, np.where(np.isfinite(ll), ll, -1e100)

    def log_posterior(x):
        _, moved, ll = located(x)
        return logsumexp(ll, axis=1) + moved - 0.5 * (x * x).sum(1)
    d = len(free_columns(parameters))
    if d == 0:
        x = np.zeros((1, 0))
        theta, moved, ll = located(x)
        return Sample(theta, x, moved, ll, ll[0])
    rng = np.random.default_rng(seed)
    # Latin hypercube of the prior: few where a whole guess may do better
    first = POINTS if guess is None or len(guess[0]) < d else POINTS // 4
    strata = np.array([rng.permutation(first) for _ in range(d)]).T
    x = ndtri((strata + rng.random(strata.shape)) / first)
    parts = [(first, lambda x: -0.5 * (x * x).sum(1) - 0.5 * d * LOG_2PI)]

    def propose(mean, cov):
        chol = np.linalg.cholesky(1.2 * cov + 1e-12 * np.eye(d))
        parts.append((POINTS, lambda x: _log_t(x, mean, chol)))
        return mean + (rng.standard_normal((POINTS, d)) @ chol.T
                       / np.sqrt(rng.chisquare(5, (POINTS, 1)) / 5))

    def log_weights():
        log_q = logsumexp([np.log(n) + density(x) for n, density in parts], axis=0)
        return moved - 0.5 * (x * x).sum(1) - 0.5 * d * LOG_2PI - log_q
    if guess is not None:
        k = len(guess[0])
        mean, cov = np.zeros(d), np.eye(d)
        mean[:k], cov[:k, :k] = guess
        x = np.vstack([x, propose(mean, cov)])
    theta, moved, ll = located(x)
    climbed, missed = [], True
    for attempt in range(ROUNDS):
        log_w = log_weights()
        total = logsumexp(ll, axis=1)

        def tempered(beta):
            w = np.exp(beta * (total - total.max()) + log_w - log_w.max())
            return w / w.sum(), w.sum()**2 / (w @ w)
        w, effective = tempered(1.0)
        found = effective >= 5.0 * (d + 1)
        below = floor - logsumexp(total + log_w)
        if effective >= ENOUGH or found and below > HOPELESS or (
                attempt > LOST + 1 and below > 3.0 * HOPELESS):
            break
        if attempt in (LOST, LOST + 1) and missed and not found:
            height = total + moved - 0.5 * (x * x).sum(1)
            for mode, _ in climbed:    # where one was missed, a second one may be, too
                height[((x - mode)**2).sum(1) < 1.0] = -np.inf
            climbed.append(climb(log_posterior, x[height.argmax()]))
            missed = log_posterior(climbed[-1][0][None])[0] > height.max() + MISSED
            new = propose(*climbed[-1])
        else:
            low, beta = 0.0, 1.0
            if not found and not climbed:
                for _ in range(30):
                    middle = 0.5 * (low + beta)
                    low, beta = ((middle, beta) if tempered(middle)[1] > 5.0 * (d + 1)
                                 else (low, middle))
                w = tempered(low)[0]
            mean, cov = w @ x, np.atleast_2d(np.cov(x.T, aweights=w, ddof=0))
            if not found and climbed:    # few points tell little of their own spread
                near = min(climbed, key=lambda m: ((m[0] - mean)**2).sum())
                cov = (effective * cov + (d + 1) * near[1]) / (effective + d + 1)
            new = propose(mean, cov)
        x = np.vstack([x, new])
        theta, moved, ll = (np.concatenate(pair) for pair in zip(
            (theta, moved, ll), located(new)))
    log_w = log_weights()
    return Sample(theta, x, log_w, ll, logsumexp(ll + log_w[:, None], axis=0))


CLIMB = 12    # steps at most
DAMPING = np.concatenate([[0.0], np.geomspace(1.0, 1e6, 13)])


def climb(log_posterior, x):
    """Mode (d,) uphill from x, and the covariance (d, d) of the normal law there.

    Newton's steps, each of them at several dampings at once (D. Marquardt, J. SIAM 11,
    1963); `log_posterior` takes (M, d), its prior is N(0, I).
    """
    d = len(x)
    shift = STEP * np.eye(d)
    pairs = [(i, j) for i in range(d) for j in range(i)]
    stencil = np.vstack([np.zeros((1, d)), shift, -shift, *(
        [one * shift[i] + two * shift[j] for one in (1, -1) for two in (1, -1)]
        for i, j in pairs)])
    for _ in range(CLIMB):
        lp = log_posterior(x + stencil)
        up, down, cross = lp[1:1 + d], lp[1 + d:1 + 2 * d], lp[1 + 2 * d:]
        curvature = np.diag(2.0 * lp[0] - up - down)
        for (i, j), (a, b, c, e) in zip(pairs, cross.reshape(-1, 4)):
            curvature[i, j] = curvature[j, i] = 0.25 * (b + c - a - e)
        width, axes = np.linalg.eigh(curvature / STEP**2)
        width = np.maximum(np.abs(width), 1.0)    # the prior alone curves by 1
        slope = axes.T @ (up - down) / (2.0 * STEP)
        tries = x + (slope / (width + DAMPING[:, None])) @ axes.T
        height = log_posterior(tries)
        if height.max() < lp[0] + 0.1:
            break
        x = tries[height.argmax()]
    return x, axes @ np.diag(1.0 / width) @ axes.T


STRAY = 0.1     # probability of an onset anywhere at all, in `onset_law`
BIN = 16        # samples whose likeliest onset stands for all until one is drawn
WILD = 25.0     # squared standard score from which on a sample may be an outlier


@njit(**JIT)
def _draw_one(mass, u):
    """Number at the quantile u of a law, and the quantile within it."""
    k = 0
    while k < len(mass) - 1 and u > mass[k]:
        u -= mass[k]
        k += 1
    return k, min(max(u / mass[k], 1e-6), 1.0)


@njit(**JIT)
def _draw_onset(gain, peak, u):
    """Onset, in samples, at the quantile u of a law of these log odds, and the log of
    its density over 1 / N; `peak` is the largest gain of every bin.

    Drawn is a bin, then a sample in it; with the probability STRAY any sample.
    """
    bins, stray, k, onset = np.exp(peak - peak.max()), u < STRAY, 0, 0.0
    bins /= bins.sum()
    if stray:
        onset = max(u / STRAY, 1e-9) * len(gain)
        k = int(np.ceil(onset) - 1) // BIN
    else:
        k, u = _draw_one(bins, (u - STRAY) / (1.0 - STRAY))
    inside = np.exp(gain[k * BIN:(k + 1) * BIN] - peak[k])
    inside /= inside.sum()
    if not stray:
        at, u = _draw_one(inside, u)
        onset = k * BIN + at + u
    share = bins[k] * inside[int(np.ceil(onset)) - 1 - k * BIN]
    return onset, np.log((1.0 - STRAY) * share * len(gain) + STRAY)


@njit(parallel=True, **JIT)
def _draw_onsets(y, H, a, q, p0, r, ratio, u):
    """Onsets of a change of noise, in samples, at quantiles u (M,) of their law, and
    the log of their density over 1 / N; ABREAST nodes side by side.

    The filter of the early noise, of variance r (M,), up to a sample and that of the
    late one, of variance r ratio^2, from there on nearly give the likelihood of every
    onset 1 ... N - 1 at once.
    """
    M, n, N = len(a), a.shape[1], len(y)
    onset, density, bins = np.empty(M), np.zeros(M), (N - 2) // BIN + 1
    for group in prange((M + ABREAST - 1) // ABREAST):
        first, number = group * ABREAST, min(ABREAST, M - group * ABREAST)
        A, Q = np.zeros((n, ABREAST)), np.zeros((n, ABREAST))
        P, x = np.empty((n, n, ABREAST)), np.empty((n, ABREAST))
        Ph = np.empty((n, ABREAST))
        noise, f, nu = np.ones(ABREAST), np.empty(ABREAST), np.empty(ABREAST)
        last, log_f, weight = np.zeros((3, ABREAST))
        gain = np.zeros((N, ABREAST))
        for late in range(2):
            P[:], x[:] = 0.0, 0.0
            for g in range(number):
                node = first + g
                noise[g] = r[node] * (ratio[node]**2 if late else 1.0)
                for s in range(n):
                    A[s, g], Q[s, g] = a[node, s], q[node, s]
                    P[s, s, g] = p0[node, s]
            for i in range(N):
                for g in range(ABREAST):
                    nu[g] = y[i]
                f[:] = noise
                for s in range(n):
                    for g in range(ABREAST):
                        x[s, g] *= A[s, g]
                        nu[g] -= H[i, s] * x[s, g]
                        Ph[s, g] = Q[s, g] * H[i, s]
                    for t in range(n):
                        for g in range(ABREAST):
                            P[s, t, g] *= A[s, g] * A[t, g]
                            Ph[s, g] += P[s, t, g] * H[i, t]
                    for g in range(ABREAST):
                        P[s, s, g] += Q[s, g]
                        f[g] += H[i, s] * Ph[s, g]
                if np.isnan(y[i]):
                    continue
                for g in range(ABREAST):
                    if abs(f[g] - last[g]) > 1e-6 * f[g]:
                        # a law to draw from need not be exact
                        last[g], log_f[g] = f[g], np.log(f[g])
                    square = nu[g] * nu[g] / f[g]
                    gain[i, g] += (late - 0.5) * (log_f[g] + min(square, WILD))
                    weight[g] = 1.0 / f[g] if square < WILD else 0.0
                for s in range(n):
                    for g in range(ABREAST):
                        x[s, g] += Ph[s, g] * nu[g] * weight[g]
                    for t in range(n):
                        for g in range(ABREAST):
                            P[s, t, g] -= Ph[s, g] * Ph[t, g] * weight[g]
        peak = np.full((bins, ABREAST), -np.inf)
        for i in range(N - 1):
            for g in range(ABREAST):
                gain[i, g] += gain[i - 1, g] if i else 0.0
                peak[i // BIN, g] = max(peak[i // BIN, g], gain[i, g])
        for g in range(number):
            onset[first + g], density[first + g] = _draw_onset(
                gain[:N - 1, g], peak[:, g], u[first + g])
    return onset, density


def onset_law(h, scene, signatures):
    """How `integrate` draws the onset of a change of noise; None if there is none."""
    symbols = [p.symbol for p in h.parameters]
    if "noise_step.onset" not in symbols:
        return None
    at = symbols.index("noise_step.onset")
    low, high = h.parameters[at].low, h.parameters[at].high
    if low == high:
        return None

    def moved(theta):
        """Theta with its onset at the quantile of that law that it has in the prior."""
        early = theta.copy()
        early[:, at] = scene.duration
        v, H = _with_constants(h, scene, signatures, early)
        onset, density = _draw_onsets(
            scene.y, H, v.a, v.q, v.p0, v.r[:, 0], _value(h, theta, "noise_step.ratio"),
            (theta[:, at] - low) / (high - low))
        theta = theta.copy()
        theta[:, at] = onset * scene.dt
        return theta, -density
    return moved
