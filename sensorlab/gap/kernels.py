"""Kernels of the gap: recursions of sums of processes of one state or two, side by
side.

Nodes, or pairs of a record and a node, lie side by side in the lanes of all arrays,
their last axis: the more, the less the loops around them cost. Inner loops take the
number of lanes from an array: one over 16 that are known to be 16 would be unrolled,
not vectorised. The steps that every such recursion takes stand first, once for all of
them; h (n,) observes the states; of a covariance the lower half is kept. A state is
eight numbers, as `filters.Parts` has them: its factor a, and b of the other state of
its pair; variance q of its noise, and covariance c with that of the other; both of the
state at first; q and c from a sample `later` on. pair (n,) is the number of the other
state, or its own. (The bank of `sensorid` has steps of its own, which end where gains
have converged: tests/bench_gap.py has both.)

Kernels do the groups first ... last - 1 and are called through `in_threads`: a parallel
loop of Numba is compiled twice, which a first call would wait for, and its threads spin
while they wait. Arrays are copied by loops: the messages of a failed assignment take
longer to compile than most kernels.
"""

import functools
import math
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import get_num_threads, njit

from sensorid import DUST, JIT, LOG_2PI

KERNEL = dict(JIT, nogil=True)
LANES = 16         # a multiple of it is vectorised as a whole
MOST_LANES = 64


@functools.cache
def _pool():
    return ThreadPoolExecutor(os.cpu_count())


os.register_at_fork(after_in_child=_pool.cache_clear)    # threads stay behind


def in_threads(kernel, count, *arguments):
    """kernel(first, last, *arguments) for ranges that make up 0 ... count - 1, each in
    a thread.
    """
    threads = min(get_num_threads(), count)
    ends = [count * k // threads for k in range(threads + 1)]
    if threads == 1:
        return kernel(0, count, *arguments)
    list(_pool().map(lambda k: kernel(ends[k], ends[k + 1], *arguments),
                     range(threads)))


def lanes_for(count, most=MOST_LANES):
    """Lanes, `most` at most, that leave groups for every thread where so many nodes or
    pairs are to be done.
    """
    rounds = -(-count // (most * get_num_threads()))
    return LANES * -(-count // (LANES * rounds * get_num_threads()))


def groups(count, lanes):
    """How many groups of so many lanes so many nodes or pairs make."""
    return -(-count // lanes)


@njit(**JIT)
def turn(a, b, pair, x):
    """Phi x in place, x (n, lanes); Phi has a on its diagonal, b beside it."""
    for s in range(len(pair)):
        t = pair[s]
        if t == s:
            for g in range(x.shape[1]):
                x[s, g] *= a[s, g]
        elif t > s:
            for g in range(x.shape[1]):
                old = x[s, g]
                x[s, g] = a[s, g] * old + b[s, g] * x[t, g]
                x[t, g] = a[t, g] * x[t, g] + b[t, g] * old


@njit(**JIT)
def turn_covariance(a, b, pair, P):
    """Phi P Phi' in place, P (n, n, lanes), of which the lower half is kept."""
    n = len(pair)
    for s in range(n):
        t = pair[s]
        if t == s:
            for k in range(n):
                if pair[k] != k:
                    high, low = max(k, s), min(k, s)
                    for g in range(P.shape[2]):
                        P[high, low, g] *= a[s, g]
                elif k <= s:
                    for g in range(P.shape[2]):
                        P[s, k, g] *= a[s, g] * a[k, g]
        elif t > s:
            for k in range(n):
                if k == s or k == t:
                    continue
                one, two = P[max(k, s), min(k, s)], P[max(k, t), min(k, t)]
                for g in range(P.shape[2]):
                    old = one[g]
                    one[g] = a[s, g] * old + b[s, g] * two[g]
                    two[g] = a[t, g] * two[g] + b[t, g] * old
            for g in range(P.shape[2]):
                first, both, second = P[s, s, g], P[t, s, g], P[t, t, g]
                P[s, s, g] = a[s, g]**2 * first + b[s, g] * (
                    2.0 * a[s, g] * both + b[s, g] * second)
                P[t, t, g] = a[t, g]**2 * second + b[t, g] * (
                    2.0 * a[t, g] * both + b[t, g] * first)
                P[t, s, g] = both * (a[s, g] * a[t, g] + b[s, g] * b[t, g]) + (
                    a[s, g] * b[t, g] * first + a[t, g] * b[s, g] * second)


@njit(**JIT)
def load(own, pair, node, parts, P):
    """The first numbers of the nodes of all lanes, parts (6, n, lanes), and the
    covariance P (n, n, lanes) at first.
    """
    n = own.shape[2]
    for s in range(n):
        for t in range(n):
            for g in range(parts.shape[2]):
                P[s, t, g] = 0.0
        for g in range(parts.shape[2]):
            for k in range(6):
                parts[k, s, g] = own[k, node[g], s]
            P[s, s, g] = parts[4, s, g]
            if pair[s] != s:
                P[s, pair[s], g] = parts[5, s, g]


@njit(**JIT)
def drive(own, node, later, i, parts):
    """The noises of the states of all lanes at sample i, which change at `later` (M,).
    """
    for s in range(own.shape[2]):
        for g in range(parts.shape[2]):
            k = 6 if i >= later[node[g]] else 2
            parts[2, s, g], parts[3, s, g] = own[k, node[g], s], own[k + 1, node[g], s]


@njit(**JIT)
def predict_covariance(parts, pair, h, P, Ph, f):
    """P (n, n, lanes) one step on, its product Ph (n, lanes) with h, and h P h' added
    to f (lanes,), Eqs. (6), (8).
    """
    a, b, q, c = parts[0], parts[1], parts[2], parts[3]
    n = len(pair)
    turn_covariance(a, b, pair, P)
    for s in range(n):
        for g in range(len(f)):
            Ph[s, g] = 0.0
        for g in range(len(f)):
            P[s, s, g] += q[s, g]
        if pair[s] < s:
            for g in range(len(f)):
                P[s, pair[s], g] += c[s, g]
        for t in range(s):
            for g in range(len(f)):
                Ph[s, g] += h[t] * P[s, t, g]
                Ph[t, g] += h[s] * P[s, t, g]
        for g in range(len(f)):
            Ph[s, g] += h[s] * P[s, s, g]
    for s in range(n):
        for g in range(len(f)):
            f[g] += h[s] * Ph[s, g]


@njit(**JIT)
def update_covariance(P, Ph, weight):
    """P less Ph weight Ph'; the weight (lanes,) is 1/f, 0 where nothing is seen."""
    n = len(Ph)
    for s in range(n):
        for t in range(s + 1):
            for g in range(len(weight)):
                P[s, t, g] -= Ph[s, g] * Ph[t, g] * weight[g]


@njit(**JIT)
def predict_state(parts, pair, h, x, nu):
    """x (n, lanes) one step on; what h sees of it leaves nu (lanes,), Eq. (7)."""
    turn(parts[0], parts[1], pair, x)
    for s in range(len(pair)):
        for g in range(len(nu)):
            nu[g] -= h[s] * x[s, g]


@njit(**JIT)
def update_state(x, Ph, gain):
    """x with Ph gain added, Eq. (4); the gain (lanes,) is nu times the weight."""
    n = len(Ph)
    for s in range(n):
        for g in range(len(gain)):
            x[s, g] += Ph[s, g] * gain[g]


@njit(**KERNEL)
def plain_gains(H, own, pair, later, r, gap, gain, f):
    """Of a filter without jumps what no record changes, in place: gain (N, n), by which
    the innovation of a sample moves the states, and its variance f (N,).

    H (N, n) observes n states; own (8, n), pair (n,), later (0 or 1,) and r (1 or N,)
    are the parts of one node; nothing is seen in a gap (N,).
    """
    (N, n), q, c = H.shape, own[2], own[3]
    a, b, P = own[0].copy().reshape(n, 1), own[1].copy().reshape(n, 1), np.zeros((
        n, n, 1))
    for s in range(n):
        P[s, s, 0] = own[4, s]
        if pair[s] < s:
            P[s, pair[s], 0] = own[5, s]
    Ph = np.empty(n)
    for i in range(N):
        if len(later) and i == later[0]:
            q, c = own[6], own[7]
        turn_covariance(a, b, pair, P)
        for s in range(n):
            P[s, s, 0] += q[s]
            Ph[s] = H[i, s] * P[s, s, 0]
            if pair[s] < s:
                P[s, pair[s], 0] += c[s]
            for t in range(s):
                Ph[s] += H[i, t] * P[s, t, 0]
                Ph[t] += H[i, s] * P[s, t, 0]
        total = r[min(i, len(r) - 1)]
        for s in range(n):
            total += H[i, s] * Ph[s]
        f[i] = total
        for s in range(n):
            gain[i, s] = 0.0 if gap[i] else Ph[s] / total
            for t in range(s + 1):
                P[s, t, 0] -= gain[i, s] * Ph[t]


def whiten(y, H, turned, pair, gain, per_sigma):
    """Normal scores (R, N) of records y (R, N) with the same gaps under a filter of
    these gains (N, n), one over the standard deviations per_sigma (N,), and turned
    (2, n), the first two numbers of its states.
    """
    z, lanes = np.empty_like(y), lanes_for(len(y))
    if len(y) == 1:
        _whiten_one(y[0], H, turned, pair, gain, per_sigma, z[0])
    else:
        in_threads(_whiten_groups, groups(len(y), lanes), lanes, y, H, turned, pair,
                   gain, per_sigma, z)
    return z


@njit(**KERNEL)
def _whiten_one(y, H, turned, pair, gain, per_sigma, z):
    """`whiten` of one record, without the cost of lanes."""
    (N, n), (a, b) = H.shape, turned
    x, before = np.zeros(n), np.empty(n)
    for i in range(N):
        nu = y[i]
        before[:] = x
        for s in range(n):
            x[s] = a[s] * before[s] + b[s] * before[pair[s]]
            nu -= H[i, s] * x[s]
        if not np.isnan(nu):
            for s in range(n):
                x[s] += gain[i, s] * nu
        z[i] = nu * per_sigma[i]


@njit(**KERNEL)
def _whiten_groups(first, last, lanes, y, H, turned, pair, gain, per_sigma, z):
    """Groups of records of `whiten`."""
    (R, N), n = y.shape, H.shape[1]
    for group in range(first, last):
        begin = group * lanes
        number = min(lanes, R - begin)
        x, nu, (a, b) = np.zeros((n, number)), np.empty(number), _in_lanes(
            turned, number)
        for i in range(N):
            turn(a, b, pair, x)
            for g in range(number):
                nu[g] = y[begin + g, i]
            for s in range(n):
                for g in range(len(nu)):
                    nu[g] -= H[i, s] * x[s, g]
            if not np.isnan(y[begin, i]):
                for s in range(n):
                    for g in range(len(nu)):
                        x[s, g] += gain[i, s] * nu[g]
            for g in range(number):
                z[begin + g, i] = nu[g] * per_sigma[i]


def whiten_back(u, first, H, turned, pair, gain, per_sigma):
    """The transpose of `whiten`: what it makes of records that are 0 up to the sample
    `first`, times u (R, N - first), is these records times the result, of that shape.
    """
    result, lanes = np.empty_like(u), lanes_for(len(u))
    if len(u) == 1:
        _whiten_one_back(u[0], first, H, turned, pair, gain, per_sigma, result[0])
    else:
        in_threads(_whiten_groups_back, groups(len(u), lanes), lanes, u, first, H,
                   turned, pair, gain, per_sigma, result)
    return result


@njit(**KERNEL)
def _whiten_one_back(u, first, H, turned, pair, gain, per_sigma, result):
    """`whiten_back` of one record, without the cost of lanes."""
    n, (a, b) = H.shape[1], turned
    x, after = np.zeros(n), np.empty(n)
    for i in range(first + len(u) - 1, first - 1, -1):
        nu = u[i - first] * per_sigma[i]
        for s in range(n):
            nu += gain[i, s] * x[s]
        for s in range(n):
            after[s] = x[s] - H[i, s] * nu
        for s in range(n):
            x[s] = a[s] * after[s] + b[pair[s]] * after[pair[s]]
        result[i - first] = nu


@njit(**KERNEL)
def _whiten_groups_back(begin, end, lanes, u, first, H, turned, pair, gain, per_sigma,
                        result):
    """Groups of records of `whiten_back`."""
    (R, count), n = u.shape, H.shape[1]
    for group in range(begin, end):
        row = group * lanes
        number = min(lanes, R - row)
        x, nu, (a, b) = np.zeros((n, number)), np.empty(number), _in_lanes(
            turned, number)
        for s in range(n):    # of Phi'
            b[s] = turned[1, pair[s]]
        for i in range(first + count - 1, first - 1, -1):
            for g in range(number):
                nu[g] = u[row + g, i - first] * per_sigma[i]
            for s in range(n):
                for g in range(len(nu)):
                    nu[g] += gain[i, s] * x[s, g]
            for s in range(n):
                for g in range(len(nu)):
                    x[s, g] -= H[i, s] * nu[g]
            turn(a, b, pair, x)
            for g in range(number):
                result[row + g, i - first] = nu[g]


@njit(**JIT)
def _in_lanes(turned, lanes):
    """The factors (2, n) of a node in so many lanes, (2, n, lanes)."""
    result = np.empty((*turned.shape, lanes))
    for k in range(2):
        for s in range(turned.shape[1]):
            for g in range(lanes):
                result[k, s, g] = turned[k, s]
    return result


def mixture_filters(y, H, own, pair, later, r, outlier, jump, out):
    """Log-likelihoods (R, M) of records under filters with outliers and two levels.

    y (R, N); H (N, n) observes n states; own (8, M, n), pair (n,), later (M or 0,) and
    r (M, 1 or N) are the parts of `filters.Parts`; outlier (M, 2) = rate,
    variance; jump (M, 2) = probability of a change of level, half the distance of the
    levels (0: one level). out (R, M, 0, 2 or 4, N) gets of every sample the predictive
    probabilities below and above it, that of its being an outlier, and its log density;
    where nothing jumps, its normal score in place of the first.

    One Gaussian per level is kept (interacting multiple models; Blom and Bar-Shalom,
    "The interacting multiple model algorithm", IEEE Trans. Autom. Control 33, 1988).
    """
    total = np.empty((len(y), own.shape[1]))
    levels = 2 if jump[:, 1].max() > 0.0 else 1
    kinds = 2 if outlier[:, 0].max() > 0.0 else 1
    lanes = lanes_for(total.size)
    in_threads(_filter_mixtures, groups(total.size, lanes), lanes, levels, kinds, y, H,
               own, pair, later, r, outlier, jump, out, total)
    return total


@njit(**KERNEL)
def _filter_mixtures(first, last, lanes, levels, kinds, y, H, own, pair, later, r,
                     outlier, jump, out, total):
    """Groups of `mixture_filters`."""
    N, rows = y.shape[1], out.shape[2]
    M, n = own.shape[1:]
    count = len(y) * M
    for group in range(first, last):
        record, node = np.empty(lanes, np.int64), np.empty(lanes, np.int64)
        parts = np.empty((6, n, lanes))
        rate, wider = np.empty(lanes), np.empty(lanes)
        change, offset = np.empty(lanes), np.empty(lanes)
        x, P = np.zeros((levels, n, lanes)), np.zeros((levels, n, n, lanes))
        Ph, apart = np.empty((levels, n, lanes)), np.empty((n, lanes))
        weight = np.full((levels, lanes), 1.0 / levels)
        prior, share = weight.copy(), np.ones((levels, lanes))
        seen, nu, f = np.empty(lanes), np.empty((levels, lanes)), np.empty(lanes)
        per_f, half = (np.empty((levels, kinds, lanes)),
                       np.empty((levels, kinds, lanes)))
        term, mass = np.empty((levels, kinds, lanes)), np.empty(lanes)
        least, wild = np.empty(lanes), np.zeros((levels, lanes))
        gain, shrink = np.empty(lanes), np.empty(lanes)
        log_f, product = np.zeros(lanes), np.ones(lanes)
        number = min(lanes, count - group * lanes)
        for g in range(lanes):
            both = min(group * lanes + g, count - 1)
            record[g], node[g] = both // M, both % M
            rate[g], wider[g] = outlier[node[g], 0], outlier[node[g], 1]
            change[g], offset[g] = jump[node[g], 0], jump[node[g], 1]
        for level in range(levels):
            load(own, pair, node, parts, P[level])
        for i in range(N):
            if len(later):
                drive(own, node, later, i, parts)
            if levels == 2:
                _mix_levels(change, weight, prior, share, apart, x, P)
            for g in range(len(f)):
                value = y[record[g], i]
                seen[g] = 0.0 if np.isnan(value) else 1.0
                for level in range(levels):
                    nu[level, g] = (value if seen[g] > 0.0 else 0.0) - (
                        2 * level - 1) * (levels - 1) * offset[g]
                least[g] = np.inf
            for level in range(levels):
                for g in range(len(f)):
                    f[g] = r[node[g], min(i, r.shape[1] - 1)]
                predict_covariance(parts, pair, H[i], P[level], Ph[level], f)
                predict_state(parts, pair, H[i], x[level], nu[level])
                for kind in range(kinds):
                    for g in range(len(f)):
                        k = 1.0 / (f[g] + kind * wider[g])
                        per_f[level, kind, g] = k
                        term[level, kind, g] = prior[level, g] * np.sqrt(k) * (
                            rate[g] if kind else 1.0 - rate[g])
                        half[level, kind, g] = 0.5 * k * nu[level, g] * nu[level, g]
                        least[g] = min(least[g], half[level, kind, g])
            mass[:] = 0.0
            for level in range(levels):
                for kind in range(kinds):
                    for g in range(len(f)):
                        if half[level, kind, g] > least[g]:
                            term[level, kind, g] *= np.exp(
                                least[g] - half[level, kind, g])
                    for g in range(len(f)):
                        mass[g] += term[level, kind, g]
            for g in range(len(f)):
                log_f[g] += seen[g] * (least[g] + 0.5 * LOG_2PI)
                product[g] *= seen[g] * mass[g] + (1.0 - seen[g])
            if i % 8 == 7 or i == N - 1:    # one logarithm for many samples
                for g in range(len(f)):
                    log_f[g] -= np.log(product[g])
                    product[g] = 1.0
            for level in range(levels):
                for g in range(len(f)):
                    here = term[level, 0, g]
                    k, less = per_f[level, 0, g], per_f[level, 0, g]
                    if kinds == 2:
                        here += term[level, 1, g]
                        wild[level, g] = term[level, 1, g] / here if here > 0.0 else 0.0
                        apart_k = k - per_f[level, 1, g]
                        k -= wild[level, g] * apart_k
                        less = k - wild[level, g] * (1.0 - wild[level, g]) * (
                            apart_k * nu[level, g])**2
                    weight[level, g] = max(here / mass[g], 1e-12) if (
                        seen[g] > 0.0) else prior[level, g]
                    gain[g], shrink[g] = seen[g] * k * nu[level, g], seen[g] * less
                update_state(x[level], Ph[level], gain)
                update_covariance(P[level], Ph[level], shrink)
            for g in range(number if rows else 0):
                if seen[g] > 0.0:
                    if rows == 4:
                        out[record[g], node[g], 3, i] = (
                            np.log(mass[g]) - least[g] - 0.5 * LOG_2PI)
                    if levels * kinds == 1:
                        out[record[g], node[g], 0, i] = nu[0, g] * np.sqrt(
                            per_f[0, 0, g])
                        continue
                    below, above, odd = _sample_law(g, rate, prior, weight, wild, per_f,
                                                    nu)
                    out[record[g], node[g], 0, i] = below
                    out[record[g], node[g], 1, i] = above
                    if rows == 4:
                        out[record[g], node[g], 2, i] = odd
        for g in range(number):
            total[record[g], node[g]] = -log_f[g]


@njit(**JIT)
def _mix_levels(change, weight, prior, share, apart, x, P):
    """What each of two levels is before a sample: part of it was the other before."""
    n = len(apart)
    for level in range(2):
        for g in range(apart.shape[1]):
            stay = weight[level, g] * (1.0 - change[g])
            prior[level, g] = stay + weight[1 - level, g] * change[g]
            share[level, g] = stay / prior[level, g]
    for s in range(n):
        for g in range(apart.shape[1]):
            apart[s, g] = x[0, s, g] - x[1, s, g]
            x[0, s, g] -= (1.0 - share[0, g]) * apart[s, g]
            x[1, s, g] += (1.0 - share[1, g]) * apart[s, g]
        for t in range(s + 1):
            for g in range(apart.shape[1]):
                more = P[0, s, t, g] - P[1, s, t, g]
                both = apart[s, g] * apart[t, g]
                P[0, s, t, g] -= (1.0 - share[0, g]) * (more - share[0, g] * both)
                P[1, s, t, g] += (1.0 - share[1, g]) * (more + share[1, g] * both)


@njit(**JIT)
def _sample_law(g, rate, prior, weight, wild, per_f, nu):
    """Predictive probabilities below and above a sample, and that it is an outlier."""
    below = above = odd = 0.0
    for level in range(len(per_f)):
        odd += weight[level, g] * wild[level, g]
        for kind in range(per_f.shape[1]):
            part = 0.5 * prior[level, g] * (rate[g] if kind else 1.0 - rate[g])
            e = nu[level, g] * np.sqrt(0.5 * per_f[level, kind, g])
            tail = part * math.erfc(abs(e))
            rest = 2.0 * part - tail
            below += rest if e > 0.0 else tail
            above += tail if e > 0.0 else rest
    return below, above, odd


def adjoint(y, observed, h, own, pair, later, r):
    """C^-1 y of every column, and s' C^-1 s of a step s at every sample.

    y (C, N); h (n,) observes the states; own, pair, later and r as for
    `mixture_filters`.
    Returns w (C, M, N), steps (M, N) and log_det (M,): P. De Jong, J. Penzer,
    "Diagnosing shocks in time series", J. Am. Stat. Assoc. 93, 1998, with the output
    shifted for good as the shock.
    """
    (C, N), M = y.shape, own.shape[1]
    w, steps, log_det = np.empty((C, M, N)), np.empty((M, N)), np.empty(M)
    lanes = lanes_for(M)
    in_threads(_go_there_and_back, groups(M, lanes), lanes, y, observed, h, own, pair,
               later, r, w, steps, log_det)
    return w, steps, log_det


STRETCH = 1024    # samples of the way there that are kept for the way back


@njit(**KERNEL)
def _go_there_and_back(first, last, lanes, y, observed, h, own, pair, later, r, w,
                       steps, log_det):
    """Groups of `adjoint`. The way there is gone twice: once to its end, and again from
    where each stretch begins, before that stretch is gone back.
    """
    C, N = y.shape
    M, n = own.shape[1:]
    shifted, to_itself = np.append(h, 1.0), np.append(pair, n)    # and the shift
    stretches = (N + STRETCH - 1) // STRETCH
    for group in range(first, last):
        node = np.minimum(group * lanes + np.arange(lanes), M - 1)
        parts, back = np.empty((6, n, lanes)), np.ones((2, n + 1, lanes))
        P, x = np.zeros((n, n, lanes)), np.zeros((C, n, lanes))
        kept_P, kept_x = (np.empty((stretches, n, n, lanes)),
                          np.empty((stretches, C, n, lanes)))
        noise, weight = np.empty((STRETCH, lanes)), np.empty((STRETCH, lanes))
        K, gain = np.empty((STRETCH, n, lanes)), np.empty((C, STRETCH, lanes))
        R, D = np.zeros((C, n, lanes)), np.zeros((n + 1, n + 1, lanes))
        log_f, product = np.zeros(lanes), np.ones(lanes)
        shocks = np.empty((STRETCH, lanes))
        load(own, pair, node, parts, P)
        for s in range(n):    # of Phi'
            for g in range(lanes):
                back[0, s, g], back[1, s, g] = parts[0, s, g], parts[1, pair[s], g]
        for way in range(2 * stretches):
            there = way < stretches
            k = way if there else 2 * stretches - 1 - way
            begin = k * STRETCH
            count = min(STRETCH, N - begin)
            if there:
                _copy(P, kept_P[k])
                _copy(x, kept_x[k])
            else:
                _copy(kept_P[k], P)
                _copy(kept_x[k], x)
            for i in range(count):
                for g in range(lanes):
                    noise[i, g] = r[node[g], min(begin + i, r.shape[1] - 1)]
            _go_there(y[:, begin:begin + count], observed[begin:begin + count], noise,
                      h, own, node, later, begin, parts, pair, P, x, K, weight, gain)
            _without_dust(x)
            if there:
                for i in range(count):
                    for g in range(lanes):
                        product[g] *= noise[i, g]
                    if i % 8 == 7 or i == count - 1:
                        for g in range(lanes):
                            log_f[g] += np.log(product[g])
                            product[g] = 1.0
                continue
            _go_back(count, shifted, back, to_itself, K, weight, gain, R, D, shocks)
            _without_dust(R)
            for g in range(min(lanes, M - group * lanes)):
                for i in range(count):
                    steps[node[g], begin + i] = shocks[i, g]
                    for c in range(C):
                        w[c, node[g], begin + i] = gain[c, i, g]
        for g in range(min(lanes, M - group * lanes)):
            log_det[node[g]] = log_f[g]


@njit(**JIT)
def _copy(source, target):
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            for g in range(source.shape[2]):
                target[i, j, g] = source[i, j, g]


@njit(**JIT)
def _without_dust(x):
    """States (C, n, lanes) that have nearly decayed are 0: see `sensorid.DUST`."""
    for c in range(x.shape[0]):
        for s in range(x.shape[1]):
            for g in range(x.shape[2]):
                if abs(x[c, s, g]) < DUST:
                    x[c, s, g] = 0.0


@njit(**JIT)
def _go_there(y, observed, noise, h, own, node, later, begin, parts, pair, P, x, K,
              weight, gain):
    """A stretch of the way there of `adjoint` from the sample `begin` on: K = Phi P h
    / f, weight 1 / f, 0 where nothing is seen, and gain nu / f of every sample; noise
    (., lanes) becomes f, 1 where nothing is seen.
    """
    (C, N), n = y.shape, len(h)
    Ph, nu = np.empty((n, x.shape[2])), np.empty(x.shape[2])
    for i in range(N):
        if len(later):
            drive(own, node, later, begin + i, parts)
        predict_covariance(parts, pair, h, P, Ph, noise[i])
        for g in range(len(nu)):
            weight[i, g] = observed[i] / noise[i, g]
            noise[i, g] = observed[i] * noise[i, g] + (1.0 - observed[i])
            for s in range(n):
                K[i, s, g] = Ph[s, g] * weight[i, g]
        turn(parts[0], parts[1], pair, K[i])
        update_covariance(P, Ph, weight[i])
        for c in range(C):
            nu[:] = y[c, i]
            predict_state(parts, pair, h, x[c], nu)
            for g in range(len(nu)):
                gain[c, i, g] = nu[g] * weight[i, g]
            update_state(x[c], Ph, gain[c, i])


@njit(**JIT)
def _go_back(N, h, back, pair, K, weight, gain, R, D, steps):
    """A stretch of N samples of the way back of `adjoint`: gain (C, ., lanes) becomes
    C^-1 y; steps (., lanes) becomes s' C^-1 s; R and D are what comes after. The last
    of the n + 1 states is the shift; back (2, n + 1, lanes) are factors of Phi'.
    """
    C, n = R.shape[:2]
    kD, kDk = np.empty((n + 1, R.shape[2])), np.empty(R.shape[2])
    for i in range(N - 1, -1, -1):
        for c in range(C):
            for s in range(n):
                for g in range(len(kDk)):
                    gain[c, i, g] -= K[i, s, g] * R[c, s, g]
            turn(back[0, :n], back[1, :n], pair[:n], R[c])
            for s in range(n):
                for g in range(len(kDk)):
                    R[c, s, g] += h[s] * gain[c, i, g]
        # D = h h' / f + L' D L with L = Phi - K h', of the shift 1 and 0
        kD[:] = 0.0
        for t in range(n + 1):
            for s in range(n):
                high, low = max(s, t), min(s, t)
                for g in range(len(kDk)):
                    kD[t, g] += D[high, low, g] * K[i, s, g]
        for g in range(len(kDk)):
            kDk[g] = weight[i, g]
            for s in range(n):
                kDk[g] += K[i, s, g] * kD[s, g]
        turn(back[0], back[1], pair, kD)
        turn_covariance(back[0], back[1], pair, D)
        for s in range(n + 1):
            for t in range(s + 1):
                for g in range(len(kDk)):
                    D[s, t, g] += (h[s] * h[t] * kDk[g] - h[t] * kD[s, g]
                                   - h[s] * kD[t, g])
        for g in range(len(kDk)):
            steps[i, g] = D[n, n, g]


def row_products(rows, columns):
    """rows @ columns.T, each product in an order of its own for any number of threads.
    """
    result = np.zeros((len(rows), len(columns)))
    arguments = np.ascontiguousarray(rows), np.ascontiguousarray(columns), result
    if rows.size * len(columns) < LITTLE:
        _multiply_rows(0, len(rows), *arguments)
    else:
        in_threads(_multiply_rows, len(rows), *arguments)
    return result


LITTLE = 10**6    # products that take less time than to wake a thread
CACHED = 2048    # samples of rows and columns that a cache holds


@njit(**KERNEL)
def _multiply_rows(first, last, rows, columns, result):
    """Two rows and four columns at a time: what is loaded is used more than once."""
    C, N = columns.shape
    for begin in range(0, N, CACHED):
        part = slice(begin, min(begin + CACHED, N))
        for c in range(0, C, 4):
            four = [columns[min(c + k, C - 1), part] for k in range(4)]
            for m in range(first, last, 2):
                both = _eight_products(rows[m, part], rows[min(m + 1, last - 1), part],
                                       four[0], four[1], four[2], four[3])
                for row in range(min(2, last - m)):
                    for k in range(min(4, C - c)):
                        result[m + row, c + k] += both[row][k]


SUMS = dict(KERNEL, fastmath={"contract", "reassoc"})    # in the order of the lanes


@njit(**SUMS)
def dot(a, b):
    """Sum of a times b."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@njit(**SUMS)
def _eight_products(r, q, a, b, c, d):
    """Sums of r and of q times each of four columns."""
    ra = rb = rc = rd = qa = qb = qc = qd = 0.0
    for i in range(len(r)):
        ra += r[i] * a[i]
        rb += r[i] * b[i]
        rc += r[i] * c[i]
        rd += r[i] * d[i]
        qa += q[i] * a[i]
        qb += q[i] * b[i]
        qc += q[i] * c[i]
        qd += q[i] * d[i]
    return (ra, rb, rc, rd), (qa, qb, qc, qd)


@njit(**JIT)
def spectrum(a, q, turn):
    """Spectrum of a sum of one-state processes at turn = |1 - exp(-i w)|^2."""
    S = 0.0
    for s in range(len(a)):
        S += (q[s] / ((1.0 - a[s])**2 + a[s] * turn)).real
    return S
