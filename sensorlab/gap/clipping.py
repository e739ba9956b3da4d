"""What clipped samples may have been: they are not missing at random."""

import functools

import numpy as np
from numba import njit

from sensorid import INSIDE
from sensorlab.gap.kernels import KERNEL, row_products

ORDER = 16       # of the autoregressive process that a record is taken for
SWEEPS = 30      # over all clipped samples, each with a process fitted anew
LEAST = 8 * ORDER    # samples that tell a process
SMALLEST = 1e-12     # of the variance of a record, that cannot be predicted
FAR = 1e6        # standard deviations: as far out, a draw is at the limit
KEPT = 4         # records


def unclipped(y, low, high):
    """A record (N,) with values beyond the limits where it lies on one, or beyond.

    They are drawn, always in the same way, from the law of an autoregressive process
    given all other samples and that they lie beyond; of a process that is fitted to
    the record so filled up (M. Tanner, W. Wong, "The calculation of posterior
    distributions by data augmentation", J. Am. Stat. Assoc. 82, 1987). NaN, missing,
    stays NaN; so does what is clipped in a record too short for that.
    """
    return _unclipped(np.ascontiguousarray(y).tobytes(), low, high).copy()


@functools.lru_cache(KEPT)
def _unclipped(y, low, high):
    y = np.frombuffer(y)
    side = (y >= high).astype(int) - (y <= low)
    missing, result = np.isnan(y), np.where(side, np.nan, y)
    inside = ~np.isnan(result)
    if np.sum(inside) < LEAST:
        return result
    at, middle = np.flatnonzero(~inside), result[inside].mean()
    x = np.where(side > 0, high, low) - middle
    x[inside] = result[inside] - middle
    x[missing] = np.interp(np.flatnonzero(missing), np.flatnonzero(inside), x[inside])
    limit = np.where(side > 0, high, low)[at] - middle
    for seed in range(SWEEPS):
        rows = np.lib.stride_tricks.sliding_window_view(x, ORDER + 1)[:, ::-1]
        gram = row_products(rows.T, rows.T)
        a = np.linalg.lstsq(gram[1:, 1:], gram[1:, 0])[0]
        c = np.append(1.0, -a)
        variance = max(c @ gram @ c, SMALLEST * gram[0, 0]) / len(rows)
        _sweep(x, at, side[at], limit, c, np.sqrt(variance), seed)
    result = np.where(inside, y, np.where(
        side > 0, np.maximum(x + middle, high), np.minimum(x + middle, low)))
    result[missing | ~np.isfinite(result)] = np.nan
    return result


@njit(**KERNEL)
def _sweep(x, at, side, limit, c, sigma, seed):
    """Draw the samples `at` of x (N,) anew, one after another, each given all others:
    beyond its limit on a side, or anywhere if that is 0. The innovations of x are c
    (ORDER + 1,) times the samples up to each, of standard deviation sigma; the first
    samples are seen from behind, for the law is the same there.
    """
    np.random.seed(seed)
    N, order = len(x), len(c) - 1
    for k in range(len(at)):
        i = at[k]
        ahead = -1 if i < order else 1
        weight = slope = 0.0
        for j in range(order + 1):
            own = i + ahead * j
            if 0 <= own < N:
                e = 0.0
                for back in range(order + 1):
                    e += c[back] * x[own - ahead * back]
                weight += c[j] * c[j]
                slope += c[j] * e
        sd, mean = sigma / np.sqrt(weight), x[i] - slope / weight
        if side[k] == 0:
            x[i] = mean + sd * np.random.standard_normal()
        else:
            x[i] = mean + side[k] * sd * _beyond(side[k] * (limit[k] - mean) / sd)


@njit(nogil=True, **INSIDE)
def _beyond(least):
    """A draw of the standard normal law above some value, by rejection (C. Robert,
    "Simulation of truncated normal variables", Stat. Comput. 5, 1995).
    """
    if not least < FAR:
        return least
    if least <= 0.0:
        while True:
            z = np.random.standard_normal()
            if z >= least:
                return z
    rate = 0.5 * (least + np.sqrt(least * least + 4.0))
    while True:
        z = least - np.log(1.0 - np.random.random()) / rate
        if np.random.random() <= np.exp(-0.5 * (z - rate)**2):
            return z
