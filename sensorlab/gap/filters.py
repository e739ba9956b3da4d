"""Filters of a hypothesis with effects: likelihood, innovations, and the backward pass.

Signatures and the bias are constants of a wide prior. Where all is Gaussian the bank of
`sensorid` gives the likelihood, and one backward pass serves every further signature.
Outliers and a level of two values take a filter of their own, one Gaussian a level.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange
from scipy.special import ndtri

from sensorid import JIT, LOG_2PI, Modes, bank, brief, filter_bank, modes
from sensorlab.gap.effects import Found

ABREAST = 8    # pairs of a record and a node that go through a filter side by side


@njit(parallel=True, **JIT)
def _mixture_filters(y, H, a, q, p0, r, outlier, jump, out):
    """Log-likelihoods (R, M) of records under filters with outliers and two levels.

    y (R, N); H (N, n) observes n independent processes with factors a, noise variances
    q and initial variances p0 (M, n); r (M, 1 or N). outlier (M, 2) = rate, variance;
    jump (M, 2) = probability of a change of level, half the distance of the levels
    (0: one level). out (R, M, 4 or 0, N) gets of every sample the predictive
    probabilities below and above it, that of its being an outlier, and its log density;
    where nothing jumps, its normal score in place of the first.

    One Gaussian per level is kept (interacting multiple models; Blom and Bar-Shalom,
    "The interacting multiple model algorithm", IEEE Trans. Autom. Control 33, 1988).
    """
    R, N = y.shape
    M, n = a.shape
    rows, pairs = out.shape[2], R * M
    levels = 2 if jump[:, 1].max() > 0.0 else 1
    kinds = 2 if outlier[:, 0].max() > 0.0 else 1
    total = np.empty((R, M))
    for group in prange((pairs + ABREAST - 1) // ABREAST):
        record, node = np.empty(ABREAST, np.int64), np.empty(ABREAST, np.int64)
        A, Q = np.empty((n, ABREAST)), np.empty((n, ABREAST))
        rate, wider = np.empty(ABREAST), np.empty(ABREAST)
        change, offset = np.empty(ABREAST), np.empty(ABREAST)
        x, P = np.zeros((levels, n, ABREAST)), np.zeros((levels, n, n, ABREAST))
        Ph, apart = np.empty((levels, n, ABREAST)), np.empty((n, ABREAST))
        weight = np.full((levels, ABREAST), 1.0 / levels)
        prior, share = weight.copy(), np.ones((levels, ABREAST))
        seen, nu, f = np.empty(ABREAST), np.empty((levels, ABREAST)), np.empty(ABREAST)
        per_f, half = np.empty((2, levels, kinds, ABREAST))
        term, mass = np.empty((levels, kinds, ABREAST)), np.empty(ABREAST)
        least, wild = np.empty(ABREAST), np.zeros((levels, ABREAST))
        gain, shrink = np.empty(ABREAST), np.empty(ABREAST)
        log_f, product = np.zeros(ABREAST), np.ones(ABREAST)
        number = min(ABREAST, pairs - group * ABREAST)
        for g in range(ABREAST):
            pair = min(group * ABREAST + g, pairs - 1)
            record[g], node[g] = pair // M, pair % M
            rate[g], wider[g] = outlier[node[g]]
            change[g], offset[g] = jump[node[g]]
            for s in range(n):
                A[s, g], Q[s, g] = a[node[g], s], q[node[g], s]
                for level in range(levels):
                    P[level, s, s, g] = p0[node[g], s]
        for i in range(N):
            if levels == 2:
                for level in range(2):
                    for g in range(ABREAST):
                        stay = weight[level, g] * (1.0 - change[g])
                        prior[level, g] = stay + weight[1 - level, g] * change[g]
                        share[level, g] = stay / prior[level, g]
                for s in range(n):
                    for g in range(ABREAST):
                        apart[s, g] = x[0, s, g] - x[1, s, g]
                        x[0, s, g] -= (1.0 - share[0, g]) * apart[s, g]
                        x[1, s, g] += (1.0 - share[1, g]) * apart[s, g]
                    for t in range(s + 1):
                        for g in range(ABREAST):
                            more = P[0, s, t, g] - P[1, s, t, g]
                            both = apart[s, g] * apart[t, g]
                            P[0, s, t, g] -= (1.0 - share[0, g]) * (
                                more - share[0, g] * both)
                            P[1, s, t, g] += (1.0 - share[1, g]) * (
                                more + share[1, g] * both)
            for g in range(ABREAST):
                value = y[record[g], i]
                seen[g] = 0.0 if np.isnan(value) else 1.0
                for level in range(levels):
                    nu[level, g] = (value if seen[g] > 0.0 else 0.0) - (
                        2 * level - 1) * (levels - 1) * offset[g]
                least[g] = np.inf
            for level in range(levels):
                for g in range(ABREAST):
                    f[g] = r[node[g], min(i, r.shape[1] - 1)]
                for s in range(n):
                    for g in range(ABREAST):
                        x[level, s, g] *= A[s, g]
                        nu[level, g] -= H[i, s] * x[level, s, g]
                        Ph[level, s, g] = 0.0
                    for t in range(s + 1):
                        for g in range(ABREAST):
                            P[level, s, t, g] *= A[s, g] * A[t, g]
                    for g in range(ABREAST):
                        P[level, s, s, g] += Q[s, g]
                    for t in range(s):
                        for g in range(ABREAST):
                            Ph[level, s, g] += H[i, t] * P[level, s, t, g]
                            Ph[level, t, g] += H[i, s] * P[level, s, t, g]
                    for g in range(ABREAST):
                        Ph[level, s, g] += H[i, s] * P[level, s, s, g]
                for s in range(n):
                    for g in range(ABREAST):
                        f[g] += H[i, s] * Ph[level, s, g]
                for kind in range(kinds):
                    for g in range(ABREAST):
                        k = 1.0 / (f[g] + kind * wider[g])
                        per_f[level, kind, g] = k
                        term[level, kind, g] = prior[level, g] * np.sqrt(k) * (
                            rate[g] if kind else 1.0 - rate[g])
                        half[level, kind, g] = 0.5 * k * nu[level, g] * nu[level, g]
                        least[g] = min(least[g], half[level, kind, g])
            mass[:] = 0.0
            for level in range(levels):
                for kind in range(kinds):
                    for g in range(ABREAST):
                        if half[level, kind, g] > least[g]:
                            term[level, kind, g] *= np.exp(
                                least[g] - half[level, kind, g])
                    for g in range(ABREAST):
                        mass[g] += term[level, kind, g]
            for g in range(ABREAST):
                log_f[g] += seen[g] * (least[g] + 0.5 * LOG_2PI)
                product[g] *= seen[g] * mass[g] + 1.0 - seen[g]
            if i % 8 == 7 or i == N - 1:    # one logarithm for many samples
                for g in range(ABREAST):
                    log_f[g] -= np.log(product[g])
                    product[g] = 1.0
            for level in range(levels):
                for g in range(ABREAST):
                    own = term[level, 0, g]
                    k, less = per_f[level, 0, g], per_f[level, 0, g]
                    if kinds == 2:
                        own += term[level, 1, g]
                        wild[level, g] = term[level, 1, g] / own if own > 0.0 else 0.0
                        apart_k = k - per_f[level, 1, g]
                        k -= wild[level, g] * apart_k
                        less = k - wild[level, g] * (1.0 - wild[level, g]) * (
                            apart_k * nu[level, g])**2
                    weight[level, g] = max(own / mass[g], 1e-12) if (
                        seen[g] > 0.0) else prior[level, g]
                    gain[g], shrink[g] = seen[g] * k * nu[level, g], seen[g] * less
                for s in range(n):
                    for g in range(ABREAST):
                        x[level, s, g] += Ph[level, s, g] * gain[g]
                    for t in range(s + 1):
                        for g in range(ABREAST):
                            P[level, s, t, g] -= (
                                Ph[level, s, g] * Ph[level, t, g] * shrink[g])
            for g in range(number * rows // 4):
                if seen[g] == 0.0:
                    continue
                at = out[record[g], node[g], :, i]
                at[3] = np.log(mass[g]) - least[g] - 0.5 * LOG_2PI
                at[:3] = 0.0
                if levels * kinds == 1:
                    at[0] = nu[0, g] * np.sqrt(per_f[0, 0, g])
                    continue
                for level in range(levels):
                    at[2] += weight[level, g] * wild[level, g]
                    for kind in range(kinds):
                        part = 0.5 * prior[level, g] * (
                            rate[g] if kind else 1.0 - rate[g])
                        e = nu[level, g] * np.sqrt(0.5 * per_f[level, kind, g])
                        at[0] += part * math.erfc(-e)
                        at[1] += part * math.erfc(e)
        for g in range(number):
            total[record[g], node[g]] = -log_f[g]
    return total


@njit(parallel=True, **JIT)
def _adjoint(y, observed, a, q, p0, r):
    """C^-1 y of every column, and s' C^-1 s of a step s at every sample.

    y (C, N); a, q, p0 (M, n), r (M, 1 or N). Returns w (M, C, N), steps (M, N) and
    log_det (M,): P. De Jong, J. Penzer, "Diagnosing shocks in time series", J. Am.
    Stat. Assoc. 93, 1998, with the output shifted for good as the shock.
    """
    C, N = y.shape
    M, n = a.shape
    w, steps, log_det = np.zeros((M, C, N)), np.zeros((M, N)), np.zeros(M)
    for node in prange(M):
        K, weight = np.zeros((N, n)), np.zeros(N)
        P, x, g = np.zeros((n, n)), np.zeros((C, n)), np.zeros(n)
        for s in range(n):
            P[s, s] = a[node, s]**2 * p0[node, s] + q[node, s]
        for i in range(N):
            f = r[node, min(i, r.shape[1] - 1)]
            for s in range(n):
                g[s] = P[s, :].sum()
                f += g[s]
            weight[i] = observed[i] / f
            if observed[i] > 0.0:
                log_det[node] += np.log(f)
            for s in range(n):
                K[i, s] = a[node, s] * g[s] * weight[i]
                for t in range(n):
                    P[s, t] = a[node, s] * a[node, t] * (
                        P[s, t] - g[s] * g[t] * weight[i])
                P[s, s] += q[node, s]
            for c in range(C):
                nu = y[c, i]
                for s in range(n):
                    nu -= x[c, s]
                w[node, c, i] = nu * weight[i]
                for s in range(n):
                    x[c, s] = a[node, s] * x[c, s] + K[i, s] * nu
        R, D, kD = np.zeros((C, n)), np.zeros((n + 1, n + 1)), np.zeros(n + 1)
        for i in range(N - 1, -1, -1):
            for c in range(C):
                for s in range(n):
                    w[node, c, i] -= K[i, s] * R[c, s]
                for s in range(n):
                    R[c, s] = w[node, c, i] + a[node, s] * R[c, s]
            # D = h h' / f + L' D L with L = diag(a, 1) - (K, 0) h'
            for t in range(n + 1):
                kD[t] = 0.0
                for s in range(n):
                    kD[t] += D[t, s] * K[i, s]
            kDk = 0.0
            for s in range(n):
                kDk += K[i, s] * kD[s]
            for s in range(n + 1):
                a_s = a[node, s] if s < n else 1.0
                for t in range(n + 1):
                    a_t = a[node, t] if t < n else 1.0
                    D[s, t] = (a_s * a_t * D[s, t] - a_s * kD[s] - a_t * kD[t]
                               + kDk + weight[i])
            steps[node, i] = D[n, n]
    return w, steps, log_det


@njit(parallel=True, **JIT)
def row_products(rows, columns):
    """rows @ columns.T, without a second set of threads that would get in the way."""
    M, N = rows.shape
    result = np.zeros((M, len(columns)))
    for m in prange(M):
        for begin in range(0, N, 2048):    # what a cache holds of all columns
            end = min(begin + 2048, N)
            whole = end - (end - begin) % 8
            for c in range(len(columns)):
                total = np.zeros(8)
                for i in range(begin, whole, 8):
                    for lane in range(8):
                        total[lane] += rows[m, i + lane] * columns[c, i + lane]
                rest = total.sum()
                for i in range(whole, end):
                    rest += rows[m, i] * columns[c, i]
                result[m, c] += rest
    return result


class Signature(NamedTuple):
    """An effect that has been found, as columns, with the prior of its size."""

    found: Found
    columns: np.ndarray    # (N, k)
    sd: float              # of its size, a priori: wide

    __repr__ = brief


class Predicted(NamedTuple):
    """What a mixture filter makes of R records at M nodes."""

    log_likelihood: np.ndarray    # (R, M)
    z: np.ndarray                 # (R, M, N) normal scores of the samples
    odd: np.ndarray               # (R, M, N) probability of an outlier
    log_score: np.ndarray         # (R, M, N) ln of the predictive density

    __repr__ = brief


def processes(h, scene, theta):
    """The one-state processes that a hypothesis is the sum of at theta (M, p)."""
    own = modes(bank(h, scene.dt, theta))
    if own is None:
        raise ValueError(f"{h.name} is no sum of independent one-state processes: "
                         "only such hypotheses can be diagnosed")
    return own


def constants(h, signatures):
    """Prior variances of the bias and of the sizes of all signature columns."""
    return np.concatenate([[h.bias_sigma**2], *(
        np.full(s.columns.shape[1], s.sd**2) for s in signatures)])


def with_constants(h, scene, signatures, theta):
    """`Modes` with the bias and the sizes of signatures as further processes, and what
    observes them, (N, n).
    """
    own, M = processes(h, scene, theta), len(theta)
    variance = constants(h, signatures)
    k = len(variance)
    H = np.column_stack([np.ones((len(scene.y), own.a.shape[1] + 1)),
                         *(s.columns for s in signatures)])
    return Modes(np.hstack([own.a, np.ones((M, k))]),
                 np.hstack([own.q, np.zeros((M, k))]),
                 np.hstack([own.p0, np.tile(variance, (M, 1))]), own.r), H


def filtered(h, scene, signatures, theta, y, rows):
    """Log-likelihoods (R, M) of records y (R, N) like that of the scene, and what
    `_mixture_filters` writes of their samples, (R, M, rows, N).
    """
    own, H = with_constants(h, scene, signatures, theta)
    jumps = h.jumps(theta)
    out = np.full((len(y), len(theta), rows, y.shape[1]), np.nan)
    return _mixture_filters(y, H, *own, np.column_stack(jumps[:2]),
                            np.column_stack(jumps[2:]), out), out


def predict(h, scene, signatures, theta, y=None):
    """`Predicted` of the record of a scene, or of others like it, y (R, N)."""
    total, out = filtered(h, scene, signatures, theta,
                          scene.y[None] if y is None else y, 4)
    z = out[:, :, 0]
    if h.has_jumps:
        z = normal_score(z, out[:, :, 1])
    return Predicted(total, np.clip(z, -SCORE_LIMIT, SCORE_LIMIT), out[:, :, 2],
                     out[:, :, 3])


SCORE_LIMIT = 37.0    # standard deviations: no normal score of double precision lies
                      # further out


def normal_score(below, above):
    """Normal score of a value with these probabilities below and above it."""
    with np.errstate(divide="ignore"):
        return np.where(below < above, ndtri(below), -ndtri(above))


def log_likelihoods(h, scene, signatures, theta):
    """ln f(Y / theta) (M,): through the bank, unless there are jumps."""
    if h.has_jumps:
        return filtered(h, scene, signatures, theta, scene.y[None], 0)[0][0]
    columns = [scene.y, *(c for s in signatures for c in s.columns.T)]
    variance = constants(h, signatures)
    gram = products(h, scene, columns, theta)
    return marginal(gram.products, gram.log_det, gram.count, np.append(
        variance[1:], variance[0])).log_likelihood


class Marginal(NamedTuple):
    """A likelihood with constants integrated out, and what is known of them."""

    log_likelihood: np.ndarray    # (M,)
    size: np.ndarray              # (M, c) expectations of the constants
    covariance: np.ndarray        # (M, c, c)


def marginal(gram, log_det, count, variance):
    """`Marginal` from products (M, 1 + c, 1 + c) of a record and c columns, whose
    constants are N(0, variance).
    """
    root, c = np.sqrt(variance), len(variance)
    inner = np.eye(c) + root[:, None] * gram[:, 1:, 1:] * root
    covariance = root[:, None] * np.linalg.inv(inner) * root
    size = (covariance @ gram[:, 1:, :1])[..., 0]
    chi2 = gram[:, 0, 0] - (gram[:, 1:, 0] * size).sum(1)
    return Marginal(-0.5 * (count * LOG_2PI + log_det + np.linalg.slogdet(inner)[1]
                            + chi2), size, covariance)


class Gram(NamedTuple):
    """Products c' C^-1 d of columns, the last of them ones, at M nodes."""

    count: int
    log_det: np.ndarray     # (M,)
    products: np.ndarray    # (M, c + 1, c + 1)


def products(h, scene, columns, theta):
    """`Gram` of columns, of which there are few."""
    # of one size: a sum must not lose the smaller of two columns
    size = np.array([np.sqrt(np.nansum(column**2) / len(column)) or 1.0
                     for column in columns])
    c = len(columns)
    pairs = [(i, j) for i in range(c) for j in range(i)]
    sums, cross = polarized(h, scene, np.array(columns) / size[:, None], pairs, theta)
    result = np.empty((len(theta), c + 1, c + 1))
    result[:, c, c] = sums.information
    for i in range(c):
        result[:, i, i] = sums.chi2[i]
        result[:, i, c] = result[:, c, i] = sums.score[i]
    for product, (i, j) in zip(cross, pairs):
        result[:, i, j] = result[:, j, i] = product
    size = np.append(size, 1.0)
    return Gram(sums.count, sums.log_det, result * size[:, None] * size)


def polarized(h, scene, rows, pairs, theta):
    """`Sums` of rows (c, N) and products r' C^-1 s of pairs of them (P, M), by
    2 r's = (r + s)'(r + s) - r'r - s's: the bank gives squares only.
    """
    both = [rows[i] + rows[j] for i, j in pairs]
    rows = np.where(np.isnan(scene.y), np.nan, np.array([*rows, *both]))
    sums = next(filter_bank(bank(h, scene.dt, theta), rows, [len(scene.y)]))
    cross = [0.5 * (chi2 - sums.chi2[i] - sums.chi2[j])
             for chi2, (i, j) in zip(sums.chi2[len(rows) - len(pairs):], pairs)]
    return sums, np.array(cross).reshape(len(pairs), len(theta))


class Solved(NamedTuple):
    """What all signatures need of a record: C^-1 (y - fit) at M nodes."""

    base: np.ndarray       # (M,) log-likelihood without a further signature
    residual: np.ndarray   # (M, N) C^-1 y less what bias and signatures explain
    w: np.ndarray          # (M, c, N) C^-1 of the columns known already
    cov: np.ndarray        # (M, c, c) of their sizes
    steps: np.ndarray      # (M, N)
    size: np.ndarray       # (M, c) sizes of the columns known already

    __repr__ = brief


def solve(h, scene, signatures, theta):
    """`Solved` of a hypothesis without jumps."""
    y = np.where(np.isnan(scene.y), 0.0, scene.y)
    observed = 1.0 - np.isnan(scene.y)
    X = np.vstack([y, np.ones_like(y), *(s.columns.T for s in signatures)])
    w, steps, log_det = _adjoint(X, observed, *processes(h, scene, theta))
    M, c, N = w.shape
    gram = row_products(w.reshape(-1, N), X).reshape(M, c, c)
    known = marginal(gram, log_det, observed.sum(), constants(h, signatures))
    residual = w[:, 0] - np.einsum("mj,mji->mi", known.size, w[:, 1:])
    return Solved(known.log_likelihood, residual, w[:, 1:], known.covariance, steps,
                  known.size)
