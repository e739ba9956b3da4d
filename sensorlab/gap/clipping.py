"""Limits at which samples are clipped, and what they may have been: they are not
missing at random.
"""

import functools

import numpy as np
from numba import njit
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr

from sensorid import INSIDE
from sensorlab.gap.codes import (
    most_likely_mixture, normal_shares, uneven_codes)
from sensorlab.gap.kernels.arithmetic import row_products
from sensorlab.gap.kernels.lanes import KERNEL
from sensorlab.gap.values import COARSE, NOISY, TELLING, less_rounding, unpredicted


# ---- limits

TAIL = 4              # values next to the last one, of which the fullest counts
FEWEST_CODES = 4      # of a lattice: how often three are met, a normal law may explain


def limits_of(y, lsb, noise):
    """Limits, infinite where there is none, and the samples (N,) that lie on one: the
    last value is met far more often than a tail allows. Few counts have no tail.

    What both ends tell adds up: where each is half as sure as one alone must be, both
    are limits.
    """
    seen = y[~np.isnan(y)]
    clipped = np.zeros(len(y), bool)
    if np.ptp(seen) < (FEWEST_CODES - 1.5) * lsb:
        return [-np.inf, np.inf], clipped
    ends = [float(sign * np.max(sign * seen)) for sign in (-1.0, 1.0)]
    nats = [_sure(end, seen, lsb, noise) for end in ends]
    limits = [-np.inf, np.inf]
    for k, end in enumerate(ends):
        if nats[k] > ABRUPT or min(nats) > 0.5 * ABRUPT:
            limits[k] = end
            clipped |= y == end
    return limits, clipped


ABRUPT = 14.0    # nats, by which a record is unlikely to end as it does


def _sure(end, seen, lsb, noise):
    """Nats by which an end of a record (N,) is rather a limit than the end of a tail;
    infinite where it is far fuller.
    """
    others = seen[seen != end]
    count, least = len(seen) - len(others), 3 if lsb < COARSE * noise else 3 * TAIL
    if count < least or not _is_near(end, others, lsb):
        return 0.0
    # on a lattice, a few far out may meet on one value: what is next to it counts
    apart = np.abs(end - seen)
    near = [*np.unique(apart)[1:TAIL + 1], *(
        k * lsb for k in range(1, TAIL + 1) if lsb)]
    before = max((np.sum(np.abs(apart - v) <= 0.5 * lsb) for v in near), default=0)
    # where others do not come again, none does by chance; it may stick once
    alone = not lsb and np.sum(np.diff(seen == end)) > 3 and (
        2 * len(np.unique(others)) > len(others))
    if alone or count >= least + 2.0 * before + 6.0 * np.sqrt(before) or (
            lsb > 0.0 and lsb >= COARSE * noise and _piles_up(apart / lsb)):
        return np.inf
    return _abruptness(apart, lsb) if lsb and not uneven_codes(others, lsb)[0] else 0.0


def _abruptness(apart, lsb):
    """Nats by which the last code of a lattice is rather a limit than one after which
    others were never met by chance; 0 if that code does not hold those. Samples are
    `apart` (N,) from it.

    Any mixture of normal laws may be that of the record, each as wide as the noise
    there. Where a limit is, what they have beyond is on that code. A
    record that is folded, or begins again at its other end, ends as abruptly, but that
    code is then not as full.
    """
    noise = _noise_near_end(apart, lsb) / lsb
    if noise < 1.0 / NOISY:
        return 0.0
    beyond = int(np.ceil(SPAN * noise))
    code = np.round(apart / lsb).astype(int)
    count = np.bincount(code[code <= MOST_INSIDE * noise])
    all_codes = normal_shares(beyond + len(count), noise, beyond)
    ends = all_codes[beyond:]
    clipped = np.vstack([all_codes[:beyond + 1].sum(0), ends[1:]])
    goes_on = _log_likelihood(np.append(np.zeros(beyond), count), all_codes)
    limited, ended = _log_likelihood(count, clipped), _log_likelihood(count, ends)
    return limited - goes_on if ended - limited < BETTER else 0.0


def _noise_near_end(apart, lsb):
    """Standard deviation of what is not foretold of samples, `apart` (N,) from an end,
    and least where those are foretold to be nearest to it.
    """
    left = unpredicted(apart[:TELLING])
    if left is None:
        return 0.0
    foretold = apart[:TELLING][-len(left):] - left
    near = foretold <= np.quantile(foretold, NEAREST)
    return less_rounding(min(np.std(left), np.sqrt(np.mean(left[near]**2))), lsb)


NEAREST = 0.25    # of the samples


def _log_likelihood(count, share):
    """Of Poisson counts (n,) under the most likely mixture of laws that have shares
    (n, k) of them, but for what is the same under any.
    """
    law = most_likely_mixture(count, share)
    return float(count @ np.log(law) - law.sum())


SPAN = 8.0           # standard deviations that a noise has
MOST_INSIDE = 20.0   # of them: of what is farther inside nothing is beyond
BETTER = np.log(100.0)    # nats by which a law that ends must fit better than a limit


APART = 5.0    # standard deviations of the noise: what is farther out was never clipped


def _is_near(end, others, lsb):
    """Do other values of a record come near its end? If not, that is what a logger
    writes where it has no value.
    """
    noise = np.sqrt(np.mean(np.diff(others)**2) / 2.0) if len(others) > 1 else 0.0
    return np.abs(end - others).min(initial=np.inf) <= max(APART * noise, 1.5 * lsb)


FEWEST_NEXT, MOST_NEXT = 4, 8    # codes next to the last one, that foretell it
PILED = 4.0    # standard deviations by which there is more than they foretell


def _piles_up(apart):
    """Is the last code of a lattice met more often than those next to it foretell?
    Samples are so many codes `apart` (N,) from it.

    Roots of counts have one variance, or more if codes are of uneven width (F. J.
    Anscombe, Biometrika 35, 1948); up to the fullest code a parabola foretells them, or
    a line if they are few.
    """
    near = np.round(apart[apart < 2 * MOST_NEXT]).astype(int)
    count = np.bincount(near, minlength=FEWEST_NEXT)
    root, own = np.sqrt(count + 0.375), np.arange(
        1, min(MOST_NEXT, count[1:].argmax() + 1) + 1)
    if len(own) < FEWEST_NEXT:
        return False
    powers = np.vander(own, 3 if len(own) > FEWEST_NEXT + 1 else 2, increasing=True)
    inverse = np.linalg.inv(powers.T @ powers)
    fit = inverse @ (powers.T @ root[own])
    off = root[own] - powers @ fit
    variance = max(0.25, off @ off / (len(own) - len(fit)))
    return root[0] - max(fit[0], np.sqrt(0.375)) > PILED * np.sqrt(
        variance * (1.0 + inverse[0, 0]))


def latent_law(y, ends, lsb):
    """Mean and standard deviation that the values of a record most likely had before
    they were clipped at two ends and rounded to a lattice, if they are normal.
    """
    half, y = 0.5 * lsb, y[~np.isnan(y)]
    inside = y[(y > ends[0]) & (y < ends[1])]
    clipped = [(sign, end, np.sum(sign * (y - end) >= 0.0))
               for sign, end in zip((-1.0, 1.0), ends) if np.isfinite(end)]
    start = inside if len(inside) > 1 and np.ptp(inside) else y
    value, count = np.unique(inside, return_counts=True)

    def misfit(at):
        mean, sigma = at[0], np.exp(at[1])
        z = np.abs(value - mean) / sigma
        if half:
            law = np.log(ndtr(half / sigma - z) - ndtr(-half / sigma - z) + TINY)
        else:
            law = -0.5 * z * z - at[1]
        return -count @ law - sum(
            number * log_ndtr((sign * (mean - end) + half) / sigma)
            for sign, end, number in clipped)
    mean, log_sigma = minimize(misfit, [start.mean(), np.log(start.std())],
                               method="Nelder-Mead").x
    return float(mean), float(np.exp(log_sigma))


TINY = 1e-300    # a probability that has a logarithm


# ---- what clipped samples may have been

ORDER = 16       # of the autoregressive process that a record is taken for
SWEEPS = 30      # over all clipped samples, each with a process fitted anew
LEAST = 8 * ORDER    # samples that tell a process
SMALLEST = 1e-12     # of the variance of a record, that cannot be predicted
FAR = 1e6        # standard deviations: as far out, a draw is at the limit
KEPT = 4         # records


def unclipped(y, low, high, lsb=0.0):
    """A record (N,) with values beyond the limits where it lies on one, or beyond; if
    it was rounded to multiples of lsb, a limit stands for what is half of it inside.

    They are drawn, always in the same way, from the law of an autoregressive process
    given all other samples and that they lie beyond; of a process that is fitted to
    the record so filled up (M. Tanner, W. Wong, "The calculation of posterior
    distributions by data augmentation", J. Am. Stat. Assoc. 82, 1987). NaN, missing,
    stays NaN; so does what is clipped in a record too short for that.
    """
    return _unclipped(np.ascontiguousarray(y).tobytes(), low, high, lsb).copy()


@functools.lru_cache(KEPT)
def _unclipped(y, low, high, lsb):
    y = np.frombuffer(y)
    side = (y >= high).astype(int) - (y <= low)
    missing, result = np.isnan(y), np.where(side, np.nan, y)
    inside = ~np.isnan(result)
    if np.sum(inside) < LEAST:
        return result
    at, middle = np.flatnonzero(~inside), result[inside].mean()
    end = np.select([side > 0, side < 0], [high, low], middle) - middle
    x = np.where(inside, result - middle, end)
    x[missing] = np.interp(np.flatnonzero(missing), np.flatnonzero(inside), x[inside])
    limit = (end - 0.5 * lsb * side)[at]
    for seed in range(SWEEPS):
        rows = np.lib.stride_tricks.sliding_window_view(x, ORDER + 1)[:, ::-1]
        gram = row_products(rows.T, rows.T)
        a = np.linalg.lstsq(gram[1:, 1:], gram[1:, 0])[0]
        c = np.append(1.0, -a)
        variance = max(c @ gram @ c, SMALLEST * gram[0, 0]) / len(rows)
        _sweep(x, at, side[at], limit, c, np.sqrt(variance), seed)
    beyond = side * (x - end)
    if lsb:
        beyond = lsb * np.round(beyond / lsb)
    result = np.where(inside, y, end + middle + side * np.maximum(beyond, 0.0))
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
