"""The mixture filter of outliers, of few states, unrolled."""

import numpy as np
from numba import njit

from sensorid import INSIDE, LOG_2PI
from sensorlab.gap.kernels.lanes import KERNEL, LANES
from sensorlab.gap.kernels.told import (
    STRETCH, exponential, lanes_of_group, odd_and_log_score, probabilities_beside,
    write)

UNROLLED_OUTLIERS = 6    # states that it has at most, none in pairs


@njit(**KERNEL)
def filter_outliers(first, last, states, y, H, own, r, outlier, out, total):
    """Groups of `mixtures.mixture_filters` of outliers alone. Probabilities have
    samples for lanes.
    """
    N, M, n, rows = y.shape[1], own.shape[1], np.int64(len(states)), out.shape[2]
    value, kept, of_kind = 4 * n + n * n, 4 * n + n * n + 4, (1, STRETCH)
    node, told = np.empty((value + 12) * LANES), np.empty((rows, STRETCH))
    past = np.empty((LANES, 6, *of_kind))
    rate, always = np.empty(of_kind), np.ones(of_kind)
    score, beyond = np.empty(STRETCH), np.empty(STRETCH)
    for group in range(first, last):
        record, at, number, tell = lanes_of_group(group, LANES, M, out)
        log_f = np.zeros(LANES)
        for g in range(LANES):
            for s in range(n):
                node[s * LANES + g] = own[0, at[g], s]
                node[(n + s) * LANES + g] = own[2, at[g], s]
                node[(2 * n + s) * LANES + g] = 0.0
                for t in range(n):
                    node[(3 * n + s * n + t) * LANES + g] = (
                        own[4, at[g], s] if s == t else 0.0)
            for k in range(2):
                node[(value + 2 + k) * LANES + g] = outlier[at[g], k]
            node[(kept + 6) * LANES + g], node[(kept + 7) * LANES + g] = 0.0, 1.0
        for i in range(N):
            for g in range(LANES):
                node[value * LANES + g] = y[record[g], i]
            if i == 0 or r.shape[1] > 1:
                for g in range(LANES):
                    node[(value + 1) * LANES + g] = r[at[g], i]
            _outliers_unrolled(H, i, n, node)
            if i % 8 == 7 or i == N - 1:    # one logarithm for many samples
                for g in range(LANES):
                    log_f[g] -= np.log(node[(kept + 7) * LANES + g])
                    node[(kept + 7) * LANES + g] = 1.0
            j = i % STRETCH
            for g in range(tell):
                for k in range(6 if rows > 2 else 3):
                    past[g, k, 0, j] = node[(kept + k) * LANES + g]
            for g in range(tell if j == STRETCH - 1 or i == N - 1 else 0):
                e, near, here, wild = past[g, 0], past[g, 3, 0], past[g, 4], past[g, 5]
                rate[:] = outlier[at[g], 0]
                probabilities_beside(rate, always, past[g, 1:3], e, score, beyond,
                                     told)
                if rows > 2:
                    odd_and_log_score(here, wild, here[0], near, always[0], told)
                write(told, y[record[g]], i - j, out[record[g], at[g]])
        for g in range(number):
            total[record[g], at[g]] = -log_f[g] - node[(kept + 6) * LANES + g]


@njit(**INSIDE)
def _outliers_unrolled(H, i, n, node):
    """A sample of a filter of outliers of n states in all lanes: unrolled, and in one
    array, as `sensorid._gain_unrolled` is.

    node has rows of LANES: Phi, Q and x (n) of states, P (n x n) and P h (n); value,
    NaN where none is seen, R, and rate and variance of outliers; innovation, 1 / f of
    either kind, least exponent, density over it, share of outliers; the sum of the
    exponents so far and the product of the densities.
    """
    x, P, Ph, value = 2 * n, 3 * n, 3 * n + n * n, 4 * n + n * n
    r, rates, wider, kept = value + 1, value + 2, value + 3, value + 4
    for g in range(LANES):
        nu = node[value * LANES + g]
        seen = 1.0 if nu == nu else 0.0
        nu = nu if nu == nu else 0.0
        for s in range(n):
            for t in range(s + 1):
                new = (node[s * LANES + g] * node[(P + s * n + t) * LANES + g]
                       * node[t * LANES + g])
                if s == t:
                    new += node[(n + s) * LANES + g]
                node[(P + s * n + t) * LANES + g] = new
                node[(P + t * n + s) * LANES + g] = new
        f = node[r * LANES + g]
        for s in range(n):
            own, new = 0.0, node[s * LANES + g] * node[(x + s) * LANES + g]
            for t in range(n):
                own += node[(P + s * n + t) * LANES + g] * H[i, t]
            node[(Ph + s) * LANES + g], node[(x + s) * LANES + g] = own, new
            f += H[i, s] * own
            nu -= H[i, s] * new
        nu *= seen
        k, odd_k = 1.0 / f, 1.0 / (f + node[wider * LANES + g])
        rate = node[rates * LANES + g]
        # no sample is as far out for an outlier
        near = 0.5 * odd_k * nu * nu
        odd = rate * np.sqrt(odd_k)
        both = odd + (1.0 - rate) * np.sqrt(k) * exponential(near - 0.5 * k * nu * nu)
        share = odd / both
        apart = k - odd_k
        told = nu, k, odd_k, near, both, share
        for row in range(6):
            node[(kept + row) * LANES + g] = told[row]
        node[(kept + 6) * LANES + g] += seen * (near + 0.5 * LOG_2PI)
        node[(kept + 7) * LANES + g] *= seen * both + (1.0 - seen)
        mean = seen * (k - share * apart)
        shrink = mean - seen * share * (1.0 - share) * (apart * nu)**2
        for s in range(n):
            node[(x + s) * LANES + g] += node[(Ph + s) * LANES + g] * mean * nu
            for t in range(s + 1):
                new = node[(P + s * n + t) * LANES + g] - (
                    node[(Ph + s) * LANES + g] * node[(Ph + t) * LANES + g] * shrink)
                node[(P + s * n + t) * LANES + g] = new
                node[(P + t * n + s) * LANES + g] = new


# ---- a level that is one of two
