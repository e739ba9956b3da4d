"""Kernels of the gap: recursions of sums of one-state processes, side by side.

ABREAST nodes, or pairs of a record and a node, lie side by side in the last axis of all
arrays, a length that is known when the loops are compiled. The steps that every such
recursion takes stand first, once for all of them; h (n,) observes the states; of a
covariance the lower half is kept. (The bank of `sensorid` writes its own steps out:
built of these it takes twice as long, see tests/bench_gap.py.)

Processes of a band are complex, in pairs of conjugates, and a kernel is compiled for
them apart. What is predicted of a sample is real, but their covariance and f stay
complex: rounding errors would grow if the imaginary part of f were dropped.

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

from sensorid import JIT, LOG_2PI

KERNEL = dict(JIT, nogil=True)
ABREAST = 8


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


def groups(count):
    """How many groups so many nodes or pairs make."""
    return (count + ABREAST - 1) // ABREAST


@njit(**JIT)
def predict_covariance(a, q, h, P, Ph, f):
    """P (n, n, ABREAST) one step on, its product Ph (n, ABREAST) with h, and h P h'
    added to f (ABREAST,), Eqs. (6), (8).
    """
    n = len(a)
    for s in range(n):
        for g in range(ABREAST):
            Ph[s, g] = 0.0
        for t in range(s + 1):
            for g in range(ABREAST):
                P[s, t, g] *= a[s, g] * a[t, g]
        for g in range(ABREAST):
            P[s, s, g] += q[s, g]
        for t in range(s):
            for g in range(ABREAST):
                Ph[s, g] += h[t] * P[s, t, g]
                Ph[t, g] += h[s] * P[s, t, g]
        for g in range(ABREAST):
            Ph[s, g] += h[s] * P[s, s, g]
    for s in range(n):
        for g in range(ABREAST):
            f[g] += h[s] * Ph[s, g]


@njit(**JIT)
def update_covariance(P, Ph, weight):
    """P less Ph weight Ph'; the weight (ABREAST,) is 1/f, 0 where nothing is seen."""
    n = len(Ph)
    for s in range(n):
        for t in range(s + 1):
            for g in range(ABREAST):
                P[s, t, g] -= Ph[s, g] * Ph[t, g] * weight[g]


@njit(**JIT)
def predict_state(a, h, x, nu):
    """x (n, ABREAST) one step on; what h sees of it leaves nu (ABREAST,), Eq. (7)."""
    n = len(a)
    for s in range(n):
        for g in range(ABREAST):
            x[s, g] *= a[s, g]
            nu[g] -= (h[s] * x[s, g]).real


@njit(**JIT)
def update_state(x, Ph, gain):
    """x with Ph gain added, Eq. (4); the gain (ABREAST,) is nu times the weight."""
    n = len(Ph)
    for s in range(n):
        for g in range(ABREAST):
            x[s, g] += Ph[s, g] * gain[g]


def mixture_filters(y, H, modes, r, outlier, jump, out):
    """Log-likelihoods (R, M) of records under filters with outliers and two levels.

    y (R, N); H (N, n) observes n independent processes; modes (3, M, n) their factors,
    noise variances and initial variances; r (M, 1 or N). outlier (M, 2) = rate,
    variance; jump (M, 2) = probability of a change of level, half the distance of the
    levels (0: one level). out (R, M, 4 or 0, N) gets of every sample the predictive
    probabilities below and above it, that of its being an outlier, and its log density;
    where nothing jumps, its normal score in place of the first.

    One Gaussian per level is kept (interacting multiple models; Blom and Bar-Shalom,
    "The interacting multiple model algorithm", IEEE Trans. Autom. Control 33, 1988).
    """
    total = np.empty((len(y), modes.shape[1]))
    levels = 2 if jump[:, 1].max() > 0.0 else 1
    kinds = 2 if outlier[:, 0].max() > 0.0 else 1
    in_threads(_filter_mixtures, groups(total.size), levels, kinds, y, H, modes, r,
               outlier, jump, out, total)
    return total


@njit(**KERNEL)
def _filter_mixtures(first, last, levels, kinds, y, H, modes, r, outlier, jump, out,
                     total):
    """Groups of `mixture_filters`."""
    N, rows = y.shape[1], out.shape[2]
    M, n = modes.shape[1:]
    pairs = len(y) * M
    for group in range(first, last):
        record, node = np.empty(ABREAST, np.int64), np.empty(ABREAST, np.int64)
        scalar = modes.dtype
        A, Q = np.empty((n, ABREAST), scalar), np.empty((n, ABREAST), scalar)
        rate, wider = np.empty(ABREAST), np.empty(ABREAST)
        change, offset = np.empty(ABREAST), np.empty(ABREAST)
        x = np.zeros((levels, n, ABREAST), scalar)
        P = np.zeros((levels, n, n, ABREAST), scalar)
        Ph = np.empty((levels, n, ABREAST), scalar)
        apart = np.empty((n, ABREAST), scalar)
        weight = np.full((levels, ABREAST), 1.0 / levels)
        prior, share = weight.copy(), np.ones((levels, ABREAST))
        seen, nu = np.empty(ABREAST), np.empty((levels, ABREAST))
        f = np.empty(ABREAST, scalar)
        per_f = np.empty((levels, kinds, ABREAST), scalar)
        half, term = np.empty(per_f.shape), np.empty(per_f.shape)
        mass = np.empty(ABREAST)
        least, wild = np.empty(ABREAST), np.zeros((levels, ABREAST))
        gain, shrink = np.empty(ABREAST, scalar), np.empty(ABREAST, scalar)
        log_f, product = np.zeros(ABREAST), np.ones(ABREAST)
        number = min(ABREAST, pairs - group * ABREAST)
        for g in range(ABREAST):
            pair = min(group * ABREAST + g, pairs - 1)
            record[g], node[g] = pair // M, pair % M
            rate[g], wider[g] = outlier[node[g], 0], outlier[node[g], 1]
            change[g], offset[g] = jump[node[g], 0], jump[node[g], 1]
            for s in range(n):
                A[s, g], Q[s, g] = modes[0, node[g], s], modes[1, node[g], s]
                for level in range(levels):
                    P[level, s, s, g] = modes[2, node[g], s]
        for i in range(N):
            if levels == 2:
                _mix_levels(change, weight, prior, share, apart, x, P)
            for g in range(ABREAST):
                value = y[record[g], i]
                seen[g] = 0.0 if np.isnan(value) else 1.0
                for level in range(levels):
                    nu[level, g] = (value if seen[g] > 0.0 else 0.0) - (
                        2 * level - 1) * (levels - 1) * offset[g]
                least[g] = np.inf
            for level in range(levels):
                for g in range(ABREAST):
                    f[g] = r[node[g], min(i, r.shape[1] - 1)]
                predict_covariance(A, Q, H[i], P[level], Ph[level], f)
                predict_state(A, H[i], x[level], nu[level])
                for kind in range(kinds):
                    for g in range(ABREAST):
                        k = 1.0 / (f[g] + kind * wider[g])
                        per_f[level, kind, g] = k
                        term[level, kind, g] = prior[level, g] * np.sqrt(k.real) * (
                            rate[g] if kind else 1.0 - rate[g])
                        half[level, kind, g] = 0.5 * k.real * (
                            nu[level, g] * nu[level, g])
                        least[g] = min(least[g], half[level, kind, g])
            mass[:] = 0.0
            for level in range(levels):
                for kind in range(kinds):
                    for g in range(ABREAST):
                        if half[level, kind, g] > least[g]:
                            term[level, kind, g] *= np.exp(
                                least[g] - half[level, kind, g])
                    for g in range(ABREAST):
                        mass[g] += term[level, kind, g]
            for g in range(ABREAST):
                log_f[g] += seen[g] * (least[g] + 0.5 * LOG_2PI)
                product[g] *= seen[g] * mass[g] + (1.0 - seen[g])
            if i % 8 == 7 or i == N - 1:    # one logarithm for many samples
                for g in range(ABREAST):
                    log_f[g] -= np.log(product[g])
                    product[g] = 1.0
            for level in range(levels):
                for g in range(ABREAST):
                    own = term[level, 0, g]
                    k, less = per_f[level, 0, g], per_f[level, 0, g]
                    if kinds == 2:
                        own += term[level, 1, g]
                        wild[level, g] = term[level, 1, g] / own if own > 0.0 else 0.0
                        apart_k = k - per_f[level, 1, g]
                        k -= wild[level, g] * apart_k
                        less = k - wild[level, g] * (1.0 - wild[level, g]) * (
                            apart_k * nu[level, g])**2
                    weight[level, g] = max(own / mass[g], 1e-12) if (
                        seen[g] > 0.0) else prior[level, g]
                    gain[g], shrink[g] = seen[g] * k * nu[level, g], seen[g] * less
                update_state(x[level], Ph[level], gain)
                update_covariance(P[level], Ph[level], shrink)
            for g in range(number * rows // 4):
                if seen[g] > 0.0:
                    out[record[g], node[g], 3, i] = (
                        np.log(mass[g]) - least[g] - 0.5 * LOG_2PI)
                    if levels * kinds == 1:
                        out[record[g], node[g], 0, i] = nu[0, g] * np.sqrt(
                            per_f[0, 0, g].real)
                        continue
                    below, above, odd = _sample_law(g, rate, prior, weight, wild, per_f,
                                                    nu)
                    out[record[g], node[g], 0, i] = below
                    out[record[g], node[g], 1, i] = above
                    out[record[g], node[g], 2, i] = odd
        for g in range(number):
            total[record[g], node[g]] = -log_f[g]


@njit(**JIT)
def _mix_levels(change, weight, prior, share, apart, x, P):
    """What each of two levels is before a sample: part of it was the other before."""
    n = len(apart)
    for level in range(2):
        for g in range(ABREAST):
            stay = weight[level, g] * (1.0 - change[g])
            prior[level, g] = stay + weight[1 - level, g] * change[g]
            share[level, g] = stay / prior[level, g]
    for s in range(n):
        for g in range(ABREAST):
            apart[s, g] = x[0, s, g] - x[1, s, g]
            x[0, s, g] -= (1.0 - share[0, g]) * apart[s, g]
            x[1, s, g] += (1.0 - share[1, g]) * apart[s, g]
        for t in range(s + 1):
            for g in range(ABREAST):
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
            e = nu[level, g] * np.sqrt(0.5 * per_f[level, kind, g].real)
            below += part * math.erfc(-e)
            above += part * math.erfc(e)
    return below, above, odd


def adjoint(y, observed, modes, r):
    """C^-1 y of every column, and s' C^-1 s of a step s at every sample.

    y (C, N); modes (3, M, n) factors, noise variances and initial variances, r (M, 1 or
    N). Returns w (M, C, N), steps (M, N) and log_det (M,): P. De Jong, J. Penzer,
    "Diagnosing shocks in time series", J. Am. Stat. Assoc. 93, 1998, with the output
    shifted for good as the shock.
    """
    M = modes.shape[1]
    w, steps, log_det = np.empty((M, *y.shape)), np.empty((M, y.shape[1])), np.empty(M)
    in_threads(_go_there_and_back, groups(M), y, observed, modes, r, w, steps, log_det)
    return w, steps, log_det


@njit(**KERNEL)
def _go_there_and_back(first, last, y, observed, modes, r, w, steps, log_det):
    """Groups of `adjoint`."""
    C, N = y.shape
    M, n = modes.shape[1:]
    h = np.ones(n)
    for group in range(first, last):
        node = np.minimum(group * ABREAST + np.arange(ABREAST), M - 1)
        a, q = np.empty((n, ABREAST), modes.dtype), np.empty((n, ABREAST), modes.dtype)
        P = np.zeros((n, n, ABREAST), modes.dtype)
        x, Ph = np.zeros((C, n, ABREAST), modes.dtype), np.empty_like(a)
        f, nu, log_f = np.empty_like(a[0]), np.empty(ABREAST), np.zeros(ABREAST)
        weight, gain = np.empty((N, ABREAST), modes.dtype), np.empty((C, N, ABREAST))
        K = np.empty((N, n, ABREAST), modes.dtype)
        for s in range(n):
            for g in range(ABREAST):
                a[s, g], q[s, g] = modes[0, node[g], s], modes[1, node[g], s]
                P[s, s, g] = modes[2, node[g], s]
        for i in range(N):
            for g in range(ABREAST):
                f[g] = r[node[g], min(i, r.shape[1] - 1)]
            predict_covariance(a, q, h, P, Ph, f)
            for g in range(ABREAST):
                weight[i, g] = observed[i] / f[g]
                log_f[g] += observed[i] * np.log(f[g].real)
                for s in range(n):
                    K[i, s, g] = a[s, g] * Ph[s, g] * weight[i, g]
            update_covariance(P, Ph, weight[i])
            for c in range(C):
                nu[:] = y[c, i]
                predict_state(a, h, x[c], nu)
                for g in range(ABREAST):
                    gain[c, i, g] = nu[g] * weight[i, g].real
                update_state(x[c], Ph, gain[c, i])
        shocks = _go_back(a, K, weight, gain)
        for g in range(min(ABREAST, M - group * ABREAST)):
            log_det[node[g]] = log_f[g]
            for i in range(N):
                steps[node[g], i] = shocks[i, g]
            for c in range(C):
                for i in range(N):
                    w[node[g], c, i] = gain[c, i, g]


@njit(**JIT)
def _go_back(a, K, weight, gain):
    """The way back of `adjoint`: gain (C, N, lanes) becomes C^-1 y; returned is
    s' C^-1 s (N, lanes).
    """
    C, N = gain.shape[:2]
    n = len(a)
    R = np.zeros((C, n, ABREAST), a.dtype)
    D = np.zeros((n + 1, n + 1, ABREAST), a.dtype)
    kD, kDk = np.empty((n + 1, ABREAST), a.dtype), np.empty(ABREAST, a.dtype)
    steps = np.empty((N, ABREAST))
    L = np.ones((n + 1, ABREAST), a.dtype)    # the last factor is that of the shift
    for s in range(n):
        for g in range(ABREAST):
            L[s, g] = a[s, g]
    for i in range(N - 1, -1, -1):
        for c in range(C):
            for s in range(n):
                for g in range(ABREAST):
                    gain[c, i, g] -= (K[i, s, g] * R[c, s, g]).real
            for s in range(n):
                for g in range(ABREAST):
                    R[c, s, g] = gain[c, i, g] + a[s, g] * R[c, s, g]
        # D = h h' / f + L' D L with L = diag(a, 1) - (K, 0) h'
        kD[:] = 0.0
        for t in range(n + 1):
            for s in range(n):
                for g in range(ABREAST):
                    kD[t, g] += D[t, s, g] * K[i, s, g]
        for g in range(ABREAST):
            kDk[g] = weight[i, g]
            for s in range(n):
                kDk[g] += K[i, s, g] * kD[s, g]
        for s in range(n + 1):
            for t in range(n + 1):
                for g in range(ABREAST):
                    D[s, t, g] = (L[s, g] * L[t, g] * D[s, t, g] - L[s, g] * kD[s, g]
                                  - L[t, g] * kD[t, g] + kDk[g])
        for g in range(ABREAST):
            steps[i, g] = D[n, n, g].real
    return steps


def row_products(rows, columns):
    """rows @ columns.T, in the order of its own for any number of threads."""
    result = np.zeros((len(rows), len(columns)))
    in_threads(_multiply_rows, len(rows), np.ascontiguousarray(rows),
               np.ascontiguousarray(columns), result)
    return result


@njit(**KERNEL)
def _multiply_rows(first, last, rows, columns, result):
    total = np.zeros(8)
    for m in range(first, last):
        for begin in range(0, rows.shape[1], 2048):    # what a cache holds of columns
            end = min(begin + 2048, rows.shape[1])
            whole = end - (end - begin) % 8
            for c in range(len(columns)):
                total[:] = 0.0
                for i in range(begin, whole, 8):
                    for lane in range(8):
                        total[lane] += rows[m, i + lane] * columns[c, i + lane]
                rest = total.sum()
                for i in range(whole, end):
                    rest += rows[m, i] * columns[c, i]
                result[m, c] += rest


@njit(**JIT)
def spectrum(a, q, turn):
    """Spectrum of a sum of one-state processes at turn = |1 - exp(-i w)|^2."""
    S = 0.0
    for s in range(len(a)):
        S += (q[s] / ((1.0 - a[s])**2 + a[s] * turn)).real
    return S
