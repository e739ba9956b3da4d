"""Filters of a hypothesis with effects: likelihood, innovations and their scores.

Where all is Gaussian they are linear; outliers and a level of two values take a filter
of their own, one Gaussian a level.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from sensorid import LOG_2PI, brief
from sensorlab.gap.kernels.mixtures import mixture_filters
from sensorlab.gap.linear import estimated, filter_at, with_constants
from sensorlab.gap.parts import in_parts


class Predicted(NamedTuple):
    """What a mixture filter makes of R records at M nodes."""

    log_likelihood: np.ndarray    # (R, M)
    z: np.ndarray                 # (R, M, N) normal scores of the samples
    odd: np.ndarray               # (R, M, N) probability of an outlier
    log_score: np.ndarray         # (R, M, N) ln of the predictive density
    second: np.ndarray = None     # (R, M, N) probability of the second level, or that
                                  # a step was some 15 samples ago at most

    __repr__ = brief


def filtered(h, scene, signatures, theta, y):
    """Log-likelihoods (R, M) of records y (R, N) like that of the scene: through the
    bank, unless there are jumps, or the states are driven unevenly.
    """
    parts = in_parts(h, scene, theta)
    if len(parts) > 1:
        return np.hstack([filtered(h, scene, signatures, part, y) for part in parts])
    if _is_plain(h, y) and not h.driven:
        return estimated(h, scene, signatures, theta, y).log_likelihood
    own, H = with_constants(h, scene, signatures, theta)
    (R, N), M = y.shape, len(theta)
    return h.log_joint(theta) + _through_mixtures(
        h, own, H, theta, y, np.empty((R, M, 0, N)))


def _is_plain(h, y):
    """Are records filtered without jumps, and miss the same samples?"""
    gap = np.isnan(y)
    return not h.has_jumps and bool((gap == gap[0]).all())


def _through_mixtures(h, own, H, theta, y, out):
    jumps = h.jumps(theta)
    own, H = _with_one_level(own, H)
    if own.louder is not None:
        jumps = jumps._replace(louder=own.louder)
    return mixture_filters(
        y, H, own.own, own.pair, own.rise, own.r, np.column_stack(jumps[:2]),
        np.column_stack([*jumps[2:-1], _felt(h, theta) * jumps.before]), out)


FELT = 4.0    # time constants of a low-pass for which an outlier before it is seen


def _felt(h, theta):
    """Samples (M,) for which an outlier before a low-pass is felt behind it."""
    low_pass, _ = h.low_pass_of_levels
    return 1.0 + (FELT / h.scene.dt * h.value(theta, low_pass.key, "tau")
                  if low_pass else np.zeros(len(theta)))


def _with_one_level(own, H):
    """The same filter with one state for all levels that only their noise moves, or a
    jump, as a bias and a random walk, and without states that are nothing.

    Records tell the sum of these levels. How far each of them is in it, as paths are
    merged, would be ever less known, till rounding hides what is known of the sum.
    """
    every = np.arange(len(own.pair))
    alone = own.pair == every
    level = np.flatnonzero(alone & (own.own[0] == 1.0).all(0) & (H == 1.0).all(0))
    left = ~alone | own.own[2:].any((0, 1))
    left[0] |= not left.any()
    one = own.own.copy()
    if len(level):
        one[2:, :, level[0]] = one[2:][:, :, level].sum(-1)
        left[level[1:]], left[level[0]] = False, True
    number = np.cumsum(left) - 1
    return own._replace(
        own=np.ascontiguousarray(one[:, :, left]), pair=number[own.pair[left]]
    ), np.ascontiguousarray(H[:, left])


def predict(h, scene, signatures, theta, y=None, whole=True, known=None):
    """`Predicted` of the record of a scene, or of others like it, y (R, N); if not the
    `whole`, without what is known of single samples beside their scores, and without
    the log-likelihood where nothing jumps. `known` is the `Filter` of the only node, if
    it is.
    """
    y = scene.y[None] if y is None else y
    M = len(theta)
    if _is_plain(h, y):
        gap = np.isnan(y[0])
        if known is not None and np.array_equal(gap, known.gap):
            every = [known]
        else:
            parts = with_constants(h, scene, signatures, theta)
            every = [filter_at(*parts, node, gap) for node in range(M)]
        z = np.stack([one.whitened(y) for one in every], 1)
        if not whole:
            return Predicted(None, _within_limits(z), None, None)
        log_f = np.array([one.log_f for one in every])
        log_score = z * z
        log_score += log_f + LOG_2PI
        log_score *= -0.5
        return Predicted(np.nansum(log_score, axis=2), _within_limits(z),
                         np.broadcast_to(np.nan, z.shape), log_score)
    return predict_first(h, scene, signatures, theta, y, whole, M)


def predict_first(h, scene, signatures, theta, y, whole=True, count=1):
    """`Predicted` of records y (R, N) by filters with jumps: the log-likelihood at all
    nodes, all else at the first ones.
    """
    own, H = with_constants(h, scene, signatures, theta)
    out = np.full((len(y), count, 5 if whole else 2, y.shape[1]), np.nan)
    total = _through_mixtures(h, own, H, theta, y, out)
    z = normal_score(out[:, :, 0], out[:, :, 1]) if h.has_jumps else out[:, :, 0]
    return Predicted(total, _within_limits(z), *(
        (out[:, :, k] for k in (2, 3, 4)) if whole else (None, None)))


def _within_limits(z):
    return np.clip(z, -SCORE_LIMIT, SCORE_LIMIT, out=z)


SCORE_LIMIT = 37.0    # standard deviations: no normal score of double precision lies
                      # further out


def normal_score(below, above):
    """Normal score of a value with these probabilities below and above it."""
    with np.errstate(divide="ignore"):
        score = ndtri(np.minimum(below, above))
    return np.clip(np.where(below < above, score, -score), -SCORE_LIMIT, SCORE_LIMIT)


def log_likelihoods(h, scene, signatures, theta):
    """ln f(Y / theta) (M,) of the record of a scene."""
    return filtered(h, scene, signatures, theta, scene.y[None])[0]
