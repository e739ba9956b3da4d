"""The mixture filter of two levels, of few states, unrolled."""

from itertools import accumulate

import numpy as np
from numba import njit

from sensorid import INSIDE, LOG_2PI
from sensorlab.gap.kernels.lanes import KERNEL, LANES
from sensorlab.gap.kernels.told import (
    STRETCH, exponential, lanes_of_group, odd_and_log_score, probabilities_beside,
    write)

UNROLLED_LEVELS = 4    # states that it has at most: of more LLVM makes no vectors

# First come the rows of the states: Phi, Q, h (n each); x (n), P (n x n, of which the
# lower half is kept) and P h (n) of either level. A path leads from one level to one:
# those to the first, from either, then those to the second.
ROWS = dict(
    value=1,                 # NaN where none is seen
    noise=1,                 # R
    nu=2, f=2,               # innovation of each level and its variance
    chance=4,                # of each path
    offset=2, louder=2,      # what a level adds to the value and to R
    weight=2,                # probabilities of the levels
    e=4, per_f=4, prior=4,   # of each path: innovation, one over its variance, chance,
    here=4,                  # share of the density over the least exponent
    least=1, mass=1,         # this exponent and the density
    share=4, seen_per_f=4,   # of each path: of its level; 1 / f where there is a value
    exponents=1, product=1)  # sum and product of the samples so far
# behind: the first level as it will be; how far the two paths to a level are apart
(NOISE, NU, F, CHANCE, OFFSET, LOUDER, WEIGHT, E, PER_F, PRIOR, HERE, LEAST, MASS,
 SHARE, SEEN_PER_F, EXPONENTS, PRODUCT, MADE) = accumulate(ROWS.values())
TOLD = SHARE - E    # rows of which a sample is told


@njit(**INSIDE)
def _value_row(n):
    return 7 * n + 2 * n * n


@njit(**KERNEL)
def filter_levels(first, last, states, y, H, own, r, jump, second, out, total):
    """Groups of `mixtures.mixture_filters` of a level without outliers, of states that
    have no pair. Probabilities have samples for lanes.
    """
    N, M, n, rows = y.shape[1], own.shape[1], np.int64(len(states)), out.shape[2]
    v = _value_row(n)
    node = np.empty((v + MADE + n * (n + 2)) * LANES)
    told, past = np.empty((rows, STRETCH)), np.empty((LANES, TOLD + 1, STRETCH))
    never, of_kind = np.zeros((4, STRETCH)), (1, 4, STRETCH)
    one, other = np.int64(0), np.int64(1)    # levels
    score, beyond = np.empty(STRETCH), np.empty(STRETCH)
    for group in range(first, last):
        record, at, number, tell = lanes_of_group(group, LANES, M, out)
        log_f = np.zeros(LANES)
        node[:] = 0.0
        for g in range(LANES):
            for s in range(n):
                node[s * LANES + g] = own[0, at[g], s]
                node[(n + s) * LANES + g] = own[2, at[g], s]
                for level in range(2):
                    node[(5 * n + level * n * n + s * n + s) * LANES + g] = own[
                        4, at[g], s]
            starts, ends, half, louder, _, _ = jump[at[g]]
            begins = second[record[g], at[g]]
            law = (1.0 - starts, ends, starts, 1.0 - ends, -half, half, 0.0, louder,
                   1.0 - begins, begins)
            for k in range(len(law)):
                node[(v + CHANCE + k) * LANES + g] = law[k]
            node[(v + PRODUCT) * LANES + g] = 1.0
        for i in range(N):
            for g in range(LANES):
                node[v * LANES + g] = y[record[g], i]
            if i == 0 or r.shape[1] > 1:
                for g in range(LANES):
                    node[(v + NOISE) * LANES + g] = r[at[g], i]
            for s in range(n):    # in the same array: it can be no other's
                for g in range(LANES):
                    node[(2 * n + s) * LANES + g] = H[i, s]
            _predict(states, one, node)
            _observe(n, one, node)
            _predict(states, other, node)
            _observe(n, other, node)
            _take_path(v, one, one, node)
            _take_path(v, one, other, node)
            _take_path(v, other, one, node)
            _take_path(v, other, other, node)
            _weigh_paths(v, node)
            _share_levels(v, node)
            _merge_states(n, one, node)
            _merge_covariances(n, one, node)
            _merge_states(n, other, node)
            _merge_covariances(n, other, node)
            _go_on(n, node)
            if i % 8 == 7 or i == N - 1:    # one logarithm for many samples
                for g in range(LANES):
                    log_f[g] -= np.log(node[(v + PRODUCT) * LANES + g])
                    node[(v + PRODUCT) * LANES + g] = 1.0
            j = i % STRETCH
            for g in range(tell):
                for k in range(TOLD):
                    past[g, k, j] = node[(v + E + k) * LANES + g]
                past[g, TOLD, j] = node[(v + WEIGHT) * LANES + g]
            for g in range(tell if j == STRETCH - 1 or i == N - 1 else 0):
                e, per_f, prior, here = (past[g, :4], past[g, 4:8], past[g, 8:12],
                                         past[g, 12:16])
                probabilities_beside(never, prior, per_f.reshape(of_kind), e, score,
                                     beyond, told)
                if rows > 2:
                    odd_and_log_score(here, never, past[g, MASS - E],
                                      past[g, LEAST - E], past[g, TOLD], told)
                write(told, y[record[g]], i - j, out[record[g], at[g]])
        for g in range(number):
            total[record[g], at[g]] = -log_f[g] - node[(v + EXPONENTS) * LANES + g]


@njit(**INSIDE)
def _lower(n, s, t):
    """Where an element of a symmetric matrix is, whose lower half is kept."""
    return s * n + t if s >= t else t * n + s


@njit(**INSIDE)
def _predict(states, level, node):
    """Covariance of a level at a sample, Eq. (5)."""
    n, P = len(states), 5 * len(states) + level * len(states)**2
    for g in range(LANES):
        for s in range(n):
            for t in range(s + 1):
                k = s * n + t
                new = (node[s * LANES + g] * node[(P + k) * LANES + g]
                       * node[t * LANES + g])
                if s == t:
                    new += node[(n + s) * LANES + g]
                node[(P + k) * LANES + g] = new


@njit(**INSIDE)
def _observe(n, level, node):
    """State of a level at a sample, its innovation and the variance of this, Eqs. (6)
    to (8).
    """
    h, x, P, Ph, v = (2 * n, (3 + level) * n, 5 * n + level * n * n,
                      (5 + level) * n + 2 * n * n, _value_row(n))
    for g in range(LANES):
        nu, f = node[v * LANES + g], node[(v + NOISE) * LANES + g]
        for s in range(n):
            own, new = 0.0, node[s * LANES + g] * node[(x + s) * LANES + g]
            for t in range(n):
                own += (node[(P + _lower(n, s, t)) * LANES + g]
                        * node[(h + t) * LANES + g])
            node[(Ph + s) * LANES + g], node[(x + s) * LANES + g] = own, new
            f += node[(h + s) * LANES + g] * own
            nu -= node[(h + s) * LANES + g] * new
        node[(v + NU + level) * LANES + g] = nu if nu == nu else 0.0
        node[(v + F + level) * LANES + g] = f


@njit(**INSIDE)
def _take_path(v, to, start, node):
    """What a path from one level to one makes of a sample."""
    path = 2 * to + start
    for g in range(LANES):
        e = (node[(v + NU + start) * LANES + g]
             - node[(v + OFFSET + to) * LANES + g])
        per_f = 1.0 / (node[(v + F + start) * LANES + g]
                       + node[(v + LOUDER + to) * LANES + g])
        node[(v + E + path) * LANES + g] = e
        node[(v + PER_F + path) * LANES + g] = per_f
        node[(v + PRIOR + path) * LANES + g] = (
            node[(v + WEIGHT + start) * LANES + g]
            * node[(v + CHANCE + path) * LANES + g])
        node[(v + HERE + path) * LANES + g] = 0.5 * per_f * e * e


@njit(**INSIDE)
def _weigh_paths(v, node):
    """Shares of the paths in the density of a sample."""
    for g in range(LANES):
        a, b = node[(v + HERE) * LANES + g], node[(v + HERE + 1) * LANES + g]
        c, d = node[(v + HERE + 2) * LANES + g], node[(v + HERE + 3) * LANES + g]
        to_first, to_second = a if a < b else b, c if c < d else d
        least = to_first if to_first < to_second else to_second
        node[(v + LEAST) * LANES + g] = least
        for path in range(4):
            node[(v + HERE + path) * LANES + g] = (
                node[(v + PRIOR + path) * LANES + g]
                * np.sqrt(node[(v + PER_F + path) * LANES + g])
                * exponential(least - node[(v + HERE + path) * LANES + g]))


@njit(**INSIDE)
def _share_levels(v, node):
    """Probabilities of the levels after a sample, and that a path is the one that led
    to its level; where nothing is seen, as before.
    """
    for g in range(LANES):
        value = node[v * LANES + g]
        seen = 1.0 if value == value else 0.0
        mass = node[(v + HERE) * LANES + g] + node[(v + HERE + 1) * LANES + g] + node[
            (v + HERE + 2) * LANES + g] + node[(v + HERE + 3) * LANES + g]
        node[(v + MASS) * LANES + g] = mass
        node[(v + EXPONENTS) * LANES + g] += seen * (
            node[(v + LEAST) * LANES + g] + 0.5 * LOG_2PI)
        node[(v + PRODUCT) * LANES + g] *= seen * mass + (1.0 - seen)
        for to in range(2):
            path = 2 * to
            one = node[(v + HERE + path) * LANES + g] / mass
            one = one if seen > 0.0 else node[(v + PRIOR + path) * LANES + g]
            other = node[(v + HERE + path + 1) * LANES + g] / mass
            other = other if seen > 0.0 else node[(v + PRIOR + path + 1) * LANES + g]
            both = one + other + 1e-200
            node[(v + WEIGHT + to) * LANES + g] = both if both > 1e-12 else 1e-12
            node[(v + SHARE + path) * LANES + g] = one / both
            node[(v + SHARE + path + 1) * LANES + g] = 1.0 - one / both
        for path in range(4):
            node[(v + SEEN_PER_F + path) * LANES + g] = (
                seen * node[(v + PER_F + path) * LANES + g])


@njit(**INSIDE)
def _merge_states(n, level, node):
    """The state of a level after a sample, from the two that have led there: of the
    first where it waits for the second. How far they are apart is kept for its
    covariance.
    """
    v = _value_row(n)
    x, Ph, made = 3 * n, 5 * n + 2 * n * n, v + MADE
    apart, one, other, new_x = made + n + n * n, 2 * level, 2 * level + 1, (
        4 * n if level else made)
    for g in range(LANES):
        gain = (node[(v + SEEN_PER_F + one) * LANES + g]
                * node[(v + E + one) * LANES + g])
        gains = (node[(v + SEEN_PER_F + other) * LANES + g]
                 * node[(v + E + other) * LANES + g])
        for s in range(n):
            new = (node[(x + n + s) * LANES + g]
                   + node[(Ph + n + s) * LANES + g] * gains)
            off = (node[(x + s) * LANES + g]
                   + node[(Ph + s) * LANES + g] * gain - new)
            node[(new_x + s) * LANES + g] = (
                new + node[(v + SHARE + one) * LANES + g] * off)
            node[(apart + s) * LANES + g] = off


@njit(**INSIDE)
def _merge_covariances(n, level, node):
    """The covariance of a level after a sample, one Gaussian for two."""
    v = _value_row(n)
    P, Ph, made, one, other = (5 * n, 5 * n + 2 * n * n, v + MADE + n, 2 * level,
                               2 * level + 1)
    apart, new_P = made + n * n, P + n * n if level else made
    for g in range(LANES):
        share = node[(v + SHARE + one) * LANES + g]
        rest = node[(v + SHARE + other) * LANES + g]
        shrink = node[(v + SEEN_PER_F + one) * LANES + g]
        shrinks = node[(v + SEEN_PER_F + other) * LANES + g]
        for s in range(n):
            off = rest * node[(apart + s) * LANES + g]
            a = shrink * node[(Ph + s) * LANES + g]
            b = shrinks * node[(Ph + n + s) * LANES + g]
            for t in range(s + 1):
                k = s * n + t
                first = node[(P + k) * LANES + g] - (
                    a * node[(Ph + t) * LANES + g])
                second = node[(P + n * n + k) * LANES + g] - (
                    b * node[(Ph + n + t) * LANES + g])
                node[(new_P + k) * LANES + g] = second + share * (
                    first - second + off * node[(apart + t) * LANES + g])


@njit(**INSIDE)
def _go_on(n, node):
    """Both levels as they are after a sample."""
    made = _value_row(n) + MADE
    for g in range(LANES):
        for s in range(n):
            node[(3 * n + s) * LANES + g] = node[(made + s) * LANES + g]
            for t in range(s + 1):
                node[(5 * n + s * n + t) * LANES + g] = node[
                    (made + n + s * n + t) * LANES + g]
