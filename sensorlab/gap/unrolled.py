"""Mixture filters of few states, unrolled: of outliers, and of two levels.

All numbers of a group are rows of lanes in one array, and the loops over states, whose
number is the length of a tuple, have known lengths: LLVM unrolls these, if they are
short, and makes vectors of the loop around them. That must be long enough not to be
unrolled itself. What a kernel calls gets numbers, of states and of a level: it becomes
part of the kernel, where they are known, and is compiled once: for every number that
stands there, or is the length of a tuple, it would be again, for an np.int64 it is not.
(What moves a covariance of four states gets the tuple: otherwise LLVM gives it up.)
"""

import math
from itertools import accumulate

import numpy as np
from numba import njit
from numpy.polynomial.chebyshev import cheb2poly, chebfit
from scipy.special import erfcx

from sensorid import INSIDE, LOG_2PI
from sensorlab.gap.kernels import KERNEL, LANES

UNROLLED = 6           # states that a filter of outliers has at most, none in pairs;
UNROLLED_LEVELS = 4    # that one of two levels has: of more LLVM makes no vectors
STRETCH = 64           # samples whose probabilities are told at once


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
def _write(told, y, begin, out):
    """What is told of the samples (rows, STRETCH) from one on, where they are seen, in
    the rows of a record y (N,) in `out` (rows, N).
    """
    for row in range(len(told)):
        for i in range(begin, min(begin + STRETCH, len(y))):
            if not np.isnan(y[i]):
                out[row, i] = told[row, i - begin]


# ---- outliers alone

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
                _write(told, y[record[g]], i - j, out[record[g], at[g]])
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

# First come the rows of the states: Phi, Q, what Phi has before and behind its
# diagonal, what Q has before it, h (n each); x (n), P (n x n, of which the lower half
# is kept) and P h (n) of either level. A path leads from one level to one: those to the
# first, from either, then those to the second.
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
# behind: the first level as it will be, and before that what a chain makes of P; how
# far the two paths to a level are apart
(NOISE, NU, F, CHANCE, OFFSET, LOUDER, WEIGHT, E, PER_F, PRIOR, HERE, LEAST, MASS,
 SHARE, SEEN_PER_F, EXPONENTS, PRODUCT, MADE) = accumulate(ROWS.values())
TOLD = SHARE - E    # rows of which a sample is told


@njit(**INSIDE)
def _value_row(n):
    return 10 * n + 2 * n * n


@njit(**KERNEL)
def filter_levels(first, last, states, chain, y, H, own, pair, r, jump, second, out,
                  total):
    """Groups of `mixtures.mixture_filters` of a level without outliers; a `chain` that
    is not None has pairs of neighbours. Probabilities have samples for lanes.
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
                if pair[s] != s:
                    node[((2 if pair[s] < s else 3) * n + s) * LANES + g] = own[
                        1, at[g], s]
                if pair[s] < s:
                    node[(4 * n + s) * LANES + g] = own[3, at[g], s]
                for level in range(2):
                    k = 8 * n + level * n * n + s * n
                    node[(k + pair[s]) * LANES + g] = own[5, at[g], s]
                    node[(k + s) * LANES + g] = own[4, at[g], s]
            starts, ends, half, louder, _ = jump[at[g]]
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
                    node[(5 * n + s) * LANES + g] = H[i, s]
            if chain is not None:
                _turn(states, one, node)
            _predict(states, one, chain, node)
            _observe(n, one, chain, node)
            if chain is not None:
                _turn(states, other, node)
            _predict(states, other, chain, node)
            _observe(n, other, chain, node)
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
                _write(told, y[record[g]], i - j, out[record[g], at[g]])
        for g in range(number):
            total[record[g], at[g]] = -log_f[g] - node[(v + EXPONENTS) * LANES + g]


@njit(**INSIDE)
def _lower(n, s, t):
    """Where an element of a symmetric matrix is, whose lower half is kept."""
    return s * n + t if s >= t else t * n + s


@njit(**INSIDE)
def _turn(states, level, node):
    """Phi P of a level of a chain, where the first level will be."""
    n, P = len(states), 8 * len(states) + level * len(states)**2
    turned = _value_row(n) + MADE
    for g in range(LANES):
        for s in range(n):
            for t in range(n):
                new = (node[s * LANES + g]
                       * node[(P + _lower(n, s, t)) * LANES + g])
                if s > 0:
                    new += (node[(2 * n + s) * LANES + g]
                            * node[(P + _lower(n, s - 1, t)) * LANES + g])
                if s < n - 1:
                    new += (node[(3 * n + s) * LANES + g]
                            * node[(P + _lower(n, s + 1, t)) * LANES + g])
                node[(turned + s * n + t) * LANES + g] = new


@njit(**INSIDE)
def _predict(states, level, chain, node):
    """Covariance of a level at a sample, Eq. (5), after `_turn` if it is a chain."""
    n, P = len(states), 8 * len(states) + level * len(states)**2
    turned = _value_row(n) + MADE
    for g in range(LANES):
        for s in range(n):
            for t in range(s + 1):
                k = s * n + t
                if chain is None:
                    new = (node[s * LANES + g] * node[(P + k) * LANES + g]
                           * node[t * LANES + g])
                else:
                    new = node[(turned + k) * LANES + g] * node[t * LANES + g]
                    if t > 0:
                        new += (node[(turned + k - 1) * LANES + g]
                                * node[(2 * n + t) * LANES + g])
                    if t < n - 1:
                        new += (node[(turned + k + 1) * LANES + g]
                                * node[(3 * n + t) * LANES + g])
                    if t == s - 1:
                        new += node[(4 * n + s) * LANES + g]
                if s == t:
                    new += node[(n + s) * LANES + g]
                node[(P + k) * LANES + g] = new


@njit(**INSIDE)
def _observe(n, level, chain, node):
    """State of a level at a sample, its innovation and the variance of this, Eqs. (6)
    to (8).
    """
    h, x, P, Ph, v = (5 * n, (6 + level) * n, 8 * n + level * n * n,
                      (8 + level) * n + 2 * n * n, _value_row(n))
    for g in range(LANES):
        nu, f, before = node[v * LANES + g], node[(v + NOISE) * LANES + g], 0.0
        for s in range(n):
            own, old = 0.0, node[(x + s) * LANES + g]
            new = node[s * LANES + g] * old
            if chain is not None:
                if s > 0:
                    new += node[(2 * n + s) * LANES + g] * before
                if s < n - 1:
                    new += node[(3 * n + s) * LANES + g] * node[(x + s + 1) * LANES + g]
                before = old
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
    x, Ph, made = 6 * n, 8 * n + 2 * n * n, v + MADE
    apart, one, other, new_x = made + n + n * n, 2 * level, 2 * level + 1, (
        7 * n if level else made)
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
    P, Ph, made, one, other = (8 * n, 8 * n + 2 * n * n, v + MADE + n, 2 * level,
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
            node[(6 * n + s) * LANES + g] = node[(made + s) * LANES + g]
            for t in range(s + 1):
                node[(8 * n + s * n + t) * LANES + g] = node[
                    (made + n + s * n + t) * LANES + g]
