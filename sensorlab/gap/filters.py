"""Filters of a hypothesis with effects: likelihood, innovations, and the backward pass.

Signatures and the bias are constants of a wide prior. Where all is Gaussian the bank of
`sensorid` gives the likelihood, and one backward pass serves every further signature.
Outliers and a level of two values take a filter of their own, one Gaussian a level.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from sensorid import LOG_2PI, Bank, Modes, bank, brief, filter_bank, modes
from sensorlab.gap.effects import Found
from sensorlab.gap.kernels import (
    adjoint, mixture_filters, plain_filters, row_products)


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
    return _modes_of(h, bank(h, scene.dt, theta))


def _modes_of(h, b):
    """`Modes` of a hypothesis with this bank."""
    own = modes(b)
    if own is None:
        raise ValueError(f"{h.name} is no sum of independent one-state processes: "
                         "only such hypotheses can be diagnosed; give a ramp as an "
                         "effect of a random walk")
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


def filtered(h, scene, signatures, theta, y):
    """Log-likelihoods (R, M) of records y (R, N) like that of the scene."""
    own, H = with_constants(h, scene, signatures, theta)
    (R, N), M = y.shape, len(theta)
    if _is_plain(h, y):
        return plain_filters(y, H, np.array(own[:3]), own.r, np.empty((R, M, 0)),
                             np.empty((M, 0)))
    return _through_mixtures(h, own, H, theta, y, np.empty((R, M, 0, N)))


def _is_plain(h, y):
    """Are records filtered without jumps, and miss the same samples?"""
    gap = np.isnan(y)
    return not h.has_jumps and bool((gap == gap[0]).all())


def _through_mixtures(h, own, H, theta, y, out):
    jumps = h.jumps(theta)
    return mixture_filters(y, H, np.array(own[:3]), own.r, np.column_stack(jumps[:2]),
                           np.column_stack(jumps[2:]), out)


def predict(h, scene, signatures, theta, y=None):
    """`Predicted` of the record of a scene, or of others like it, y (R, N)."""
    y = scene.y[None] if y is None else y
    own, H = with_constants(h, scene, signatures, theta)
    (R, N), M = y.shape, len(theta)
    if _is_plain(h, y):
        z, log_f = np.empty((R, M, N)), np.empty((M, N))
        total = plain_filters(y, H, np.array(own[:3]), own.r, z, log_f)
        log_score = z * z
        log_score += log_f + LOG_2PI
        log_score *= -0.5
        return Predicted(total, _within_limits(z), np.broadcast_to(np.nan, z.shape),
                         log_score)
    out = np.full((R, M, 4, N), np.nan)
    total = _through_mixtures(h, own, H, theta, y, out)
    z = normal_score(out[:, :, 0], out[:, :, 1]) if h.has_jumps else out[:, :, 0]
    return Predicted(total, _within_limits(z), out[:, :, 2], out[:, :, 3])


def _within_limits(z):
    return np.clip(z, -SCORE_LIMIT, SCORE_LIMIT, out=z)


SCORE_LIMIT = 37.0    # standard deviations: no normal score of double precision lies
                      # further out


def normal_score(below, above):
    """Normal score of a value with these probabilities below and above it."""
    with np.errstate(divide="ignore"):
        score = np.where(below < above, ndtri(below), -ndtri(above))
    return np.clip(score, -SCORE_LIMIT, SCORE_LIMIT)


def log_likelihoods(h, scene, signatures, theta):
    """ln f(Y / theta) (M,): through the bank, unless there are jumps."""
    if h.has_jumps:
        return filtered(h, scene, signatures, theta, scene.y[None])[0]
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
    sums, cross = polarized(bank(h, scene.dt, theta), scene,
                            np.array(columns) / size[:, None], pairs)
    result = np.empty((len(theta), c + 1, c + 1))
    result[:, c, c] = sums.information
    for i in range(c):
        result[:, i, i] = sums.chi2[i]
        result[:, i, c] = result[:, c, i] = sums.score[i]
    for product, (i, j) in zip(cross, pairs):
        result[:, i, j] = result[:, j, i] = product
    size = np.append(size, 1.0)
    return Gram(sums.count, sums.log_det, result * size[:, None] * size)


def polarized(b, scene, rows, pairs):
    """`Sums` of a bank and rows (c, N), and products r' C^-1 s of pairs of them (P, M),
    by 2 r's = (r + s)'(r + s) - r'r - s's: the bank gives squares only.
    """
    count, gap, every = len(rows), np.isnan(scene.y), rows
    if pairs or gap.any():
        every = np.empty((count + len(pairs), len(gap)))
        every[:count] = rows
        for row, (i, j) in zip(every[count:], pairs):
            np.add(rows[i], rows[j], out=row)
        every[:, gap] = np.nan
    sums = next(filter_bank(b, every, [len(gap)]))
    cross = [0.5 * (chi2 - sums.chi2[i] - sums.chi2[j])
             for chi2, (i, j) in zip(sums.chi2[count:], pairs)]
    return sums, np.array(cross)


class Solved(NamedTuple):
    """What all signatures need of a record: C^-1 (y - fit) at M nodes."""

    base: np.ndarray       # (M,) log-likelihood without a further signature
    residual: np.ndarray   # (M, N) C^-1 y less what bias and signatures explain
    w: np.ndarray          # (M, c, N) C^-1 of the columns known already
    cov: np.ndarray        # (M, c, c) of their sizes
    steps: np.ndarray      # (M, N)
    size: np.ndarray       # (M, c) sizes of the columns known already
    own: Modes             # of the hypothesis
    bank: Bank

    __repr__ = brief


def solve(h, scene, signatures, theta):
    """`Solved` of a hypothesis without jumps."""
    y = np.where(np.isnan(scene.y), 0.0, scene.y)
    observed = 1.0 - np.isnan(scene.y)
    X = np.vstack([y, np.ones_like(y), *(s.columns.T for s in signatures)])
    b = bank(h, scene.dt, theta)
    own = _modes_of(h, b)
    w, steps, log_det = adjoint(X, observed, np.array(own[:3]), own.r)
    M, c, N = w.shape
    gram = row_products(w.reshape(-1, N), X).reshape(M, c, c)
    known = marginal(gram, log_det, observed.sum(), constants(h, signatures))
    residual = w[:, 0] - np.einsum("mj,mji->mi", known.size, w[:, 1:])
    return Solved(known.log_likelihood, residual, w[:, 1:], known.covariance, steps,
                  known.size, own, b)
