"""Limits at which samples are clipped, and what they may have been: they are not
missing at random.
"""

import functools

import numpy as np
from numba import njit
from scipy.optimize import minimize
from scipy.special import log_ndtr, ndtr, ndtri

from sensorid import INSIDE
from sensorlab.gap.codes import uneven_codes
from sensorlab.gap.kernels.arithmetic import row_products
from sensorlab.gap.kernels.lanes import KERNEL
from sensorlab.gap.values import COARSE, TELLING, less_rounding, unpredicted


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
    ends, full, nats = [], [], []
    for sign in (-1.0, 1.0):
        end = sign * np.max(sign * seen)
        # on a lattice, a few far out may meet on one value: what is next to it counts
        near = [*sign * np.unique(sign * seen)[-TAIL - 1:-1], *(
            end - sign * k * lsb for k in range(1, TAIL + 1) if lsb)]
        before = max((np.sum(np.abs(y - v) <= 0.5 * lsb) for v in near), default=0)
        least = 3 if lsb < COARSE * noise else 3 * TAIL
        at_end = y == end
        count = np.sum(at_end)
        # where others do not come again, none does by chance; it may stick once
        others = seen[seen != end]
        alone = not lsb and count >= least and np.sum(np.diff(at_end)) > 3 and (
            2 * len(np.unique(others)) > len(others))
        apart = np.abs(end - seen)
        near = _is_near(end, seen, lsb)
        ends.append(float(end))
        full.append(near and (
            alone or count >= least + 2.0 * before + 6.0 * np.sqrt(before)
            or lsb >= COARSE * noise and lsb > 0.0 and count >= least
            and _piles_up(apart / lsb)))
        nats.append(_abruptness(apart, lsb) if near and lsb and count >= least
                    and not uneven_codes(others, lsb)[0] else 0.0)
    limits = [-np.inf, np.inf]
    for k, end in enumerate(ends):
        if full[k] or nats[k] > ABRUPT or min(nats) > 0.5 * ABRUPT:
            limits[k] = end
            clipped |= y == end
    return limits, clipped


ABRUPT = 14.0        # nats, by which a record is unlikely to end as it does
SPAN = 8.0           # standard deviations that a noise has


def _abruptness(apart, lsb):
    """Nats, at least, by which a record is unlikely to have nothing beyond the last
    code of a lattice. Samples are `apart` (N,) from it.
    """
    left = unpredicted(apart[:TELLING])
    noise = 0.0 if left is None else less_rounding(np.std(left), lsb)
    return max(_by_number(apart, lsb, noise),
               _by_what_is_foretold(apart, lsb, noise, left)) if noise else 0.0


def _by_number(apart, lsb, noise):
    """Nats by which there are so many samples on the last code of a lattice that there
    ought to be others beyond; 0 if that code cannot hold those. Samples are `apart`
    (N,) from it.

    What cannot be predicted is normal, of standard deviation s at least. If n of N
    samples are on the code, it lies D s at most above what is predicted, the normal
    quantile of 1 - n / N, and beyond it r n are to be expected at least, r the sum of
    exp(-D x - x^2 / 2), x in units of s; a code may be half as wide again. That n are
    on it and none beyond has at most the probability (1 + r)^-n, whatever was to be
    expected there. Those others must be on it, too: a record that is folded, or begins
    again at its other end, ends as abruptly.
    """
    on = apart < 0.5 * lsb
    count = on[0] + np.sum(on[1:] & ~on[:-1])    # what is slow rests there
    if not count:
        return 0.0
    x = lsb / noise * (np.arange(1, int(SPAN * noise / lsb) + 2) + 0.5)
    above = -ndtri(0.5 * count / len(apart))
    beyond = np.exp(-above * x - 0.5 * x**2).sum()
    holds = beyond < 0.5 or _holds_more(apart / lsb, beyond)    # half does not tell
    return count * np.log1p(beyond) if holds else 0.0


def _holds_more(apart, beyond):
    """May the last code of a lattice hold so many times its own samples more? Samples
    are so many codes `apart` (N,) from it.
    """
    root, foretold, sd = _foretold(apart, 1)
    return root > np.sqrt(1.0 + beyond) * foretold - TOO_FEW * sd


FINE = 2.0    # times the noise, at most, is a code where it does not hide what is slow


def _by_what_is_foretold(apart, lsb, noise, left):
    """Nats by which samples on the last code of a lattice, by what is foretold of each,
    belong beyond; 0 if that code cannot hold those. Samples are `apart` (N,) from it,
    of which those before leave `left`.

    Where the noise is normal, of standard deviation s about what those before foretell,
    a sample that is on the code or beyond is beyond with a known probability p: that
    none of those is there has that of the product of 1 - p. A code may be half as wide
    again.
    """
    if lsb > FINE * noise:
        return 0.0
    last = apart[:TELLING][-len(left):]
    away = (last - left)[last < 0.5 * lsb] / noise
    beyond = np.exp(log_ndtr(-lsb / noise - away) - log_ndtr(0.5 * lsb / noise - away))
    holds = _holds_more(apart / lsb, np.mean(beyond / (1.0 - beyond)))
    return -np.log1p(-beyond).sum() if holds else 0.0


APART = 5.0    # standard deviations of the noise: what is farther out was never clipped


def _is_near(end, seen, lsb):
    """Do other values of a record come near its end? If not, that is what a logger
    writes where it has no value.
    """
    others = seen[seen != end]
    noise = np.sqrt(np.mean(np.diff(others)**2) / 2.0) if len(others) > 1 else 0.0
    return np.abs(end - others).min(initial=np.inf) <= max(APART * noise, 1.5 * lsb)


TOO_FEW = 2.0    # standard deviations by which there are less than that
FEWEST_NEXT, MOST_NEXT = 4, 8    # codes next to the last one, that foretell it
PILED = 4.0    # standard deviations by which there is more than they foretell


def _piles_up(apart):
    """Is the last code of a lattice met more often than those next to it foretell?
    Samples are so many codes `apart` (N,) from it.
    """
    told = _foretold(apart, FEWEST_NEXT)
    if told is None:
        return False
    root, foretold, sd = told
    return root - foretold > PILED * sd


def _foretold(apart, fewest):
    """Root of the count of the last code of a lattice; what those next to it foretell,
    and the standard deviation of the difference; None if these are less than the
    fewest.

    Samples are so many codes `apart` (N,) from it. Roots of counts have one variance,
    or more if codes are of uneven width (F. J. Anscombe, Biometrika 35, 1948); up to
    the fullest code a parabola foretells them, or a line if they are few.
    """
    near = np.round(apart[apart < 2 * MOST_NEXT]).astype(int)
    count = np.bincount(near, minlength=FEWEST_NEXT)
    root, own = np.sqrt(count + 0.375), np.arange(
        1, min(MOST_NEXT, count[1:].argmax() + 1) + 1)
    if len(own) < fewest:
        return None
    powers = np.vander(own, 3 if len(own) > FEWEST_NEXT + 1 else min(len(own), 2),
                       increasing=True)
    inverse = np.linalg.inv(powers.T @ powers)
    fit = inverse @ (powers.T @ root[own])
    off = root[own] - powers @ fit
    variance = max(0.25, off @ off / max(len(own) - len(fit), 1))
    return root[0], max(fit[0], np.sqrt(0.375)), np.sqrt(
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
        return -count @ law - sum(number * log_ndtr(sign * (mean - end) / sigma)
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
