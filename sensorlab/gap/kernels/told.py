"""What mixture filters tell of a sample: how likely each kind of noise and each level
are, and how far out the sample lies.
"""

import math

import numpy as np
from numba import njit
from numpy.polynomial.chebyshev import cheb2poly, chebfit
from scipy.special import erfcx

from sensorid import INSIDE, LOG_2PI

STRETCH = 64    # samples whose probabilities are told at once


def _series_of_tail(degree=14):
    """Coefficients, the highest first, of erfcx(a) / t, t = 1 / (1 + a / 4), in powers
    of 2 t - 1: to 1e-10 of it.
    """
    x = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    t = 0.5 * (x + 1.0)
    series = cheb2poly(chebfit(x, erfcx(4.0 / t - 4.0) / t, degree))
    return tuple(series[::-1].tolist())


TAIL = _series_of_tail()


@njit(**INSIDE)
def exponential(x):
    """exp of a number from -708 to 0 to 1e-12 of it, for vectors, by the 1024th power
    of its series; of less, as of -708.
    """
    x = (x if x > -708.0 else -708.0) / 1024.0
    e = 1.0 + x * (1.0 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x * (
        1 / 720 + x * (1 / 5040 + x * (1 / 40320 + x * (1 / 362880 + x * (
            1 / 3628800 + x * (1 / 39916800 + x * (1 / 479001600))))))))))))
    for _ in range(10):
        e *= e
    return e


@njit(**INSIDE)
def tail(score):
    """Probability of a normal score beyond one that is not negative, to 1e-9 of it: the
    function of a library takes one number at a time.
    """
    a = score * math.sqrt(0.5)
    t, series = 1.0 / (1.0 + 0.25 * a), 0.0
    for k in range(len(TAIL)):
        series = series * (2.0 * t - 1.0) + TAIL[k]
    # beyond, numbers are too small to be fast
    e = exponential(-a * a if a < 26.4 else -26.4 * 26.4)
    return 0.5 * t * series * e * (1.0 if a < 26.4 else 0.0)


@njit(**INSIDE)
def probabilities_beside(rate, prior, per_f, e, score, beyond, told):
    """Predictive probabilities below and above a sample, the first rows of told
    (2 or 5, lanes), over paths (paths, lanes or more) and kinds.
    """
    paths, lanes = len(rate), told.shape[1]
    for row in range(2):
        for g in range(lanes):
            told[row, g] = 0.0
    for kind in range(len(per_f)):
        for path in range(paths):
            for g in range(lanes):
                score[g] = np.abs(e[path, g]) * np.sqrt(per_f[kind, path, g])
            for g in range(lanes):
                beyond[g] = tail(score[g])
            for g in range(lanes):
                score[g] = prior[path, g] * (
                    rate[path, g] if kind else 1.0 - rate[path, g])
                beyond[g] *= score[g]
            for g in range(lanes):
                near, positive = score[g] - beyond[g], e[path, g] > 0.0
                told[0, g] += near if positive else beyond[g]
                told[1, g] += beyond[g] if positive else near


@njit(**INSIDE)
def weigh_kinds(prior, rate, wider, e, v, per_f, half, term):
    """Of usual samples and of outliers, the first axis of per_f, half and term (kinds,
    lanes), if there are two kinds: one over the variance of the innovation e, what its
    exponent lacks to 0, and the density but for the exponential.
    """
    for kind in range(len(per_f)):
        for g in range(len(e)):
            k = 1.0 / (v[g] + kind * wider[g])
            per_f[kind, g] = k
            half[kind, g] = 0.5 * k * e[g] * e[g]
        for g in range(len(e)):
            term[kind, g] = prior[g] * np.sqrt(per_f[kind, g]) * (
                rate[g] if kind else 1.0 - rate[g])


@njit(**INSIDE)
def add_log_density(seen, mass, least, due, log_f, product):
    """The log density of a sample, where it is seen, added to log_f (lanes,); most of
    it waits in `product` until one logarithm is `due` for many samples.
    """
    for g in range(len(mass)):
        log_f[g] += seen[g] * (least[g] + 0.5 * LOG_2PI)
        product[g] *= seen[g] * mass[g] + (1.0 - seen[g])
    if due:
        for g in range(len(mass)):
            log_f[g] -= np.log(product[g])
            product[g] = 1.0


@njit(**INSIDE)
def weigh_updates(term, here, per_f, e, wild, gain, shrink):
    """By what a sample that is seen moves states and shrinks covariances, (lanes,), and
    its probability of an outlier: those of both kinds as one Gaussian.
    """
    for g in range(len(e)):
        k, shrink[g] = per_f[0, g], per_f[0, g]
        if len(per_f) == 2:
            wild[g] = term[1, g] / here[g] if here[g] > 0.0 else 0.0
            apart = k - per_f[1, g]
            k -= wild[g] * apart
            shrink[g] = k - wild[g] * (1.0 - wild[g]) * (apart * e[g])**2
        gain[g] = k * e[g]


@njit(**INSIDE)
def odd_and_log_score(here, wild, mass, least, weight, told):
    """The other rows of told: probability of an outlier, log density, and probability
    of the second level.
    """
    for g in range(told.shape[1]):
        odd = 0.0
        for path in range(len(here)):
            odd += here[path, g] * wild[path, g]
        told[2, g] = odd / mass[g]
        told[3, g] = np.log(mass[g]) - least[g] - 0.5 * LOG_2PI
        told[4, g] = 1.0 - weight[g]


@njit(**INSIDE)
def lanes_of_group(group, lanes, M, out):
    """Numbers of the record and of the node, of M, of every lane of a group; how many
    lanes are in use, and how many of them `out` is told of: their nodes come first.
    """
    R, begin, told = len(out), group * lanes, out.shape[1] if out.shape[2] else 0
    both = np.minimum(begin + np.arange(lanes), R * M - 1)
    number = min(lanes, R * M - begin)
    return both % R, both // R, number, min(number, max(R * told - begin, 0))


@njit(**INSIDE)
def write(told, y, begin, out):
    """What is told of the samples (rows, STRETCH) from one on, where they are seen, in
    the rows of a record y (N,) in `out` (rows, N).
    """
    for row in range(len(told)):
        for i in range(begin, min(begin + STRETCH, len(y))):
            if not np.isnan(y[i]):
                out[row, i] = told[row, i - begin]


# ---- outliers alone
