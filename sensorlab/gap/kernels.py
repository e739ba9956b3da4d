"""Kernels of the gap: recursions of sums of processes of one state or two, side by
side.

Nodes, or pairs of a record and a node, lie side by side in the lanes of all arrays,
their last axis: the more, the less the loops around them cost. Inner loops take the
number of lanes from an array: one over 16 that are known to be 16 would be unrolled,
not vectorised, nor is `min` or `max` of two numbers; a step that calls another, and
a view of a row, count references, which takes as long as a step of few lanes. The steps
that every such recursion takes stand first, once for all of
them; h (n,) observes the states; of a covariance the lower half is kept. A state is
eight numbers, as `filters.Parts` has them: its factor a, and b of the other state of
its pair; variance q of its noise, and covariance c with that of the other; both of the
state at first; what is added to q and c, `rise` times, at each sample. pair (n,) is
the number of the other state, or its own. (The bank of `sensorid` has steps of its own,
which end where gains have converged: tests/bench_gap.py has both.)

Kernels do the groups first ... last - 1 and are called through `in_threads`: a parallel
loop of Numba is compiled twice, which a first call would wait for, and its threads spin
while they wait. Arrays are copied by loops: the messages of a failed assignment take
longer to compile than most kernels.
"""

import functools
import math
import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numba import get_num_threads, njit

from sensorid import DUST, INSIDE, JIT

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


def in_rows(*arrays):
    """Arrays laid out row by row: for each other layout a kernel is compiled anew."""
    return tuple(map(np.ascontiguousarray, arrays))


def lanes_for(count, most=MOST_LANES):
    """Lanes, `most` at most, that leave groups for every thread where so many nodes or
    pairs are to be done.
    """
    rounds = -(-count // (most * get_num_threads()))
    return LANES * -(-count // (LANES * rounds * get_num_threads()))


def groups(count, lanes):
    """How many groups of so many lanes so many nodes or pairs make."""
    return -(-count // lanes)


@njit(**INSIDE)
def turn(parts, pair, x):
    """Phi x in place, x (n, lanes); of the parts (2 or more, n, lanes), Phi has the
    first on its diagonal, the second beside it.
    """
    for s in range(len(pair)):
        t = pair[s]
        if t == s:
            for g in range(x.shape[1]):
                x[s, g] *= parts[0, s, g]
        elif t > s:
            for g in range(x.shape[1]):
                old = x[s, g]
                x[s, g] = parts[0, s, g] * old + parts[1, s, g] * x[t, g]
                x[t, g] = parts[0, t, g] * x[t, g] + parts[1, t, g] * old


@njit(**INSIDE)
def turn_covariance(parts, pair, P):
    """Phi P Phi' in place, P (n, n, lanes), of which the lower half is kept."""
    n = len(pair)
    for s in range(n):
        t = pair[s]
        if t == s:
            for k in range(n):
                if pair[k] != k:
                    high, low = max(k, s), min(k, s)
                    for g in range(P.shape[2]):
                        P[high, low, g] *= parts[0, s, g]
                elif k <= s:
                    for g in range(P.shape[2]):
                        P[s, k, g] *= parts[0, s, g] * parts[0, k, g]
        elif t > s:
            for k in range(n):
                if k == s or k == t:
                    continue
                i, j, other_i, other_j = max(k, s), min(k, s), max(k, t), min(k, t)
                for g in range(P.shape[2]):
                    one, other = P[i, j, g], P[other_i, other_j, g]
                    P[i, j, g] = parts[0, s, g] * one + parts[1, s, g] * other
                    P[other_i, other_j, g] = (
                        parts[0, t, g] * other + parts[1, t, g] * one)
            for g in range(P.shape[2]):
                a, b, c, d = (parts[0, s, g], parts[1, s, g], parts[0, t, g],
                              parts[1, t, g])
                first, both, second = P[s, s, g], P[t, s, g], P[t, t, g]
                P[s, s, g] = a * a * first + b * (2.0 * a * both + b * second)
                P[t, t, g] = c * c * second + d * (2.0 * c * both + d * first)
                P[t, s, g] = both * (a * c + b * d) + (a * d * first + c * b * second)


@njit(**INSIDE)
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


@njit(**INSIDE)
def drive(own, node, rise, i, anew, parts):
    """The noises of the states of all lanes at sample i, by `rise` (M, N), anew or
    where they are others than at the sample before.
    """
    for g in range(parts.shape[2]):
        at = node[g]
        if anew or rise[at, i] != rise[at, i - 1]:
            for s in range(own.shape[2]):
                parts[2, s, g] = own[2, at, s] + rise[at, i] * own[6, at, s]
                parts[3, s, g] = own[3, at, s] + rise[at, i] * own[7, at, s]


@njit(**INSIDE)
def observe_covariance(parts, pair, h, P, Ph, f):
    """P (n, n, lanes), turned, with the noise of a step, its product Ph (n, lanes) with
    h, and h P h' added to f (lanes,), Eqs. (6), (8).
    """
    n = len(pair)
    for s in range(n):
        for g in range(len(f)):
            P[s, s, g] += parts[2, s, g]
            Ph[s, g] = h[s] * P[s, s, g]
        if pair[s] < s:
            for g in range(len(f)):
                P[s, pair[s], g] += parts[3, s, g]
        for t in range(s):
            for g in range(len(f)):
                Ph[s, g] += h[t] * P[s, t, g]
                Ph[t, g] += h[s] * P[s, t, g]
    for s in range(n):
        for g in range(len(f)):
            f[g] += h[s] * Ph[s, g]


@njit(**INSIDE)
def update_covariance(P, Ph, weight):
    """P less Ph weight Ph'; the weight (lanes,) is 1/f, 0 where nothing is seen."""
    n = len(Ph)
    for s in range(n):
        for t in range(s + 1):
            for g in range(len(weight)):
                P[s, t, g] -= Ph[s, g] * Ph[t, g] * weight[g]


@njit(**INSIDE)
def observe_state(h, x, nu):
    """What h sees of x (n, lanes), turned, leaves nu (lanes,), Eq. (7)."""
    for s in range(len(h)):
        for g in range(len(nu)):
            nu[g] -= h[s] * x[s, g]


@njit(**INSIDE)
def update_state(x, Ph, gain):
    """x with Ph gain added, Eq. (4); the gain (lanes,) is nu times the weight."""
    n = len(Ph)
    for s in range(n):
        for g in range(len(gain)):
            x[s, g] += Ph[s, g] * gain[g]


ROUNDING = 1e-16    # of the largest variance of an innovation


@njit(**KERNEL)
def plain_gains(H, own, pair, rise, r, gap, gain, f):
    """Of a filter without jumps what no record changes, in place: gain (N, n), by which
    the innovation of a sample moves the states, and its variance f (N,).

    H (N or 1, n) observes n states; own (8, n), pair (n,), rise (0 or N,) and r (1 or
    N,) are the parts of one node; nothing is seen in a gap (N,).
    """
    (N, n), q, c = gain.shape, own[2].copy(), own[3].copy()
    turned, P = own[:2].copy().reshape(2, n, 1), np.zeros((n, n, 1))
    for s in range(n):
        P[s, s, 0] = own[4, s]
        if pair[s] < s:
            P[s, pair[s], 0] = own[5, s]
    Ph, largest = np.empty(n), 0.0
    for i in range(N):
        if len(rise):
            for s in range(n):
                q[s] = own[2, s] + rise[i] * own[6, s]
                c[s] = own[3, s] + rise[i] * own[7, s]
        h = H[min(i, len(H) - 1)]
        turn_covariance(turned, pair, P)
        for s in range(n):
            P[s, s, 0] += q[s]
            Ph[s] = h[s] * P[s, s, 0]
            if pair[s] < s:
                P[s, pair[s], 0] += c[s]
            for t in range(s):
                Ph[s] += h[t] * P[s, t, 0]
                Ph[t] += h[s] * P[s, t, 0]
        total = r[min(i, len(r) - 1)]
        for s in range(n):
            total += h[s] * Ph[s]
        largest, blind = max(largest, total), gap[i]
        if total <= 0.0:    # next to no noise: P is rounding, and teaches nothing
            total, blind = ROUNDING * largest, True
        f[i] = total
        for s in range(n):
            gain[i, s] = 0.0 if blind else Ph[s] / total
            for t in range(s + 1):
                P[s, t, 0] -= gain[i, s] * Ph[t]


def whiten(y, H, turned, pair, gain, per_sigma):
    """Normal scores (R, N) of records y (R, N) with the same gaps under a filter of
    these gains (N, n), one over the standard deviations per_sigma (N,), and turned
    (2, n), the first two numbers of its states.
    """
    y, = in_rows(y)
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
    (N, n), (a, b) = gain.shape, turned
    x = np.zeros(n)
    for i in range(N):
        nu, h = y[i], H[min(i, len(H) - 1)]
        _turn_one(a, b, pair, x)
        for s in range(n):
            nu -= h[s] * x[s]
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
        x, nu, parts = np.zeros((n, number)), np.empty(number), _in_lanes(
            turned, number)
        for i in range(N):
            turn(parts, pair, x)
            for g in range(number):
                nu[g] = y[begin + g, i]
            observe_state(H[min(i, len(H) - 1)], x, nu)
            if not np.isnan(y[begin, i]):
                for s in range(n):
                    for g in range(len(nu)):
                        x[s, g] += gain[i, s] * nu[g]
            for g in range(number):
                z[begin + g, i] = nu[g] * per_sigma[i]
            if i % DUSTED == 0:
                _without_dust(x.ravel())


@njit(**INSIDE)
def _turn_one(a, b, pair, x):
    """`turn` of one lane."""
    for s in range(len(pair)):
        t = pair[s]
        if t == s:
            x[s] *= a[s]
        elif t > s:
            old = x[s]
            x[s] = a[s] * old + b[s] * x[t]
            x[t] = a[t] * x[t] + b[t] * old


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
    n, a, b = H.shape[1], turned[0], turned[1][pair]    # of Phi'
    x = np.zeros(n)
    for i in range(first + len(u) - 1, first - 1, -1):
        nu, h = u[i - first] * per_sigma[i], H[min(i, len(H) - 1)]
        for s in range(n):
            nu += gain[i, s] * x[s]
        for s in range(n):
            x[s] -= h[s] * nu
        _turn_one(a, b, pair, x)
        result[i - first] = nu


@njit(**KERNEL)
def _whiten_groups_back(begin, end, lanes, u, first, H, turned, pair, gain, per_sigma,
                        result):
    """Groups of records of `whiten_back`."""
    (R, count), n = u.shape, H.shape[1]
    for group in range(begin, end):
        row = group * lanes
        number = min(lanes, R - row)
        x, nu, parts = np.zeros((n, number)), np.empty(number), _in_lanes(
            turned, number)
        for s in range(n):    # of Phi'
            parts[1, s] = turned[1, pair[s]]
        for i in range(first + count - 1, first - 1, -1):
            for g in range(number):
                nu[g] = u[row + g, i - first] * per_sigma[i]
            for s in range(n):
                for g in range(len(nu)):
                    nu[g] += gain[i, s] * x[s, g]
            h = H[min(i, len(H) - 1)]
            for s in range(n):
                for g in range(len(nu)):
                    x[s, g] -= h[s] * nu[g]
            turn(parts, pair, x)
            for g in range(number):
                result[row + g, i - first] = nu[g]
            if i % DUSTED == 0:
                _without_dust(x.ravel())


@njit(**INSIDE)
def _in_lanes(turned, lanes):
    """The factors (2, n) of a node in so many lanes, (2, n, lanes)."""
    result = np.empty((*turned.shape, lanes))
    for k in range(2):
        for s in range(turned.shape[1]):
            for g in range(lanes):
                result[k, s, g] = turned[k, s]
    return result


class Shock(NamedTuple):
    """What is added to the output from a sample on: what states give that nothing
    drives, from values that they have then.
    """

    turned: np.ndarray    # (2, m) the first two numbers of the states
    pair: np.ndarray      # (m,)
    h: np.ndarray         # (m,) what observes them
    begun: np.ndarray     # (k, m) their values at that sample, of k such shocks


STEP = Shock(np.array([[1.0], [0.0]]), np.zeros(1, int), np.ones(1), np.ones((1, 1)))


def adjoint(y, observed, h, own, pair, rise, r, shock=STEP):
    """C^-1 y of every column, and s' C^-1 s of k shocks s, by default of a step, from
    every sample on.

    y (C, N); h (n,) observes the states; own, pair, rise and r as for
    `mixture_filters`.
    Returns w (C, M, N), shocks (k, M, N) and log_det (M,): P. De Jong, J. Penzer,
    "Diagnosing shocks in time series", J. Am. Stat. Assoc. 93, 1998, with what is added
    to the output as the shock.
    """
    (C, N), M = y.shape, own.shape[1]
    w, log_det = np.empty((C, M, N)), np.empty(M)
    squares, lanes = np.empty((len(shock.begun), M, N)), lanes_for(M)
    y, h = in_rows(y, h)
    in_threads(_go_there_and_back, groups(M, lanes), lanes, y, observed, h, own, pair,
               rise, r, *shock, w, squares, log_det)
    return w, squares, log_det


STRETCH = 1024    # samples of the way there that are kept for the way back


@njit(**KERNEL)
def _go_there_and_back(first, last, lanes, y, observed, h, own, pair, rise, r, turned,
                       beside, seen, begun, w, squares, log_det):
    """Groups of `adjoint`. The way there is gone twice: once to its end, and again from
    where each stretch begins, before that stretch is gone back.
    """
    C, N = y.shape
    M, n = own.shape[1:]
    m = len(seen)
    all_h, all_pair = np.append(h, seen), np.append(pair, n + beside)
    stretches = (N + STRETCH - 1) // STRETCH
    for group in range(first, last):
        node = np.minimum(group * lanes + np.arange(lanes), M - 1)
        parts, back = np.empty((6, n, lanes)), np.empty((2, n + m, lanes))
        P, x = np.zeros((n, n, lanes)), np.zeros((n, C, lanes))
        kept_P, kept_x = (np.empty((stretches, n, n, lanes)),
                          np.empty((stretches, n, C, lanes)))
        noise, weight = np.empty((STRETCH, lanes)), np.empty((STRETCH, lanes))
        K, gain = np.empty((STRETCH, n, lanes)), np.empty((C, STRETCH, lanes))
        R, D = np.zeros((n, C, lanes)), np.zeros((n + m, n + m, lanes))
        log_f, product = np.zeros(lanes), np.ones(lanes)
        there_of, back_of = np.empty((2, n, C * lanes)), np.empty((2, n, C * lanes))
        shocks = np.empty((len(begun), STRETCH, lanes))
        load(own, pair, node, parts, P)
        for s in range(m):
            for g in range(lanes):
                back[0, n + s, g], back[1, n + s, g] = turned[0, s], turned[
                    1, beside[s]]
        for s in range(n):    # of Phi'
            for g in range(lanes):
                back[0, s, g], back[1, s, g] = parts[0, s, g], parts[1, pair[s], g]
                for c in range(C):
                    for k in range(2):
                        there_of[k, s, c * lanes + g] = parts[k, s, g]
                        back_of[k, s, c * lanes + g] = back[k, s, g]
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
                      h, own, node, rise, begin, parts, there_of, pair, P, x, K,
                      weight, gain)
            _without_dust(x.ravel())
            if there:
                for i in range(count):
                    for g in range(lanes):
                        product[g] *= noise[i, g]
                    if i % 8 == 7 or i == count - 1:
                        for g in range(lanes):
                            log_f[g] += np.log(product[g])
                            product[g] = 1.0
                continue
            _go_back(count, all_h, back, back_of, all_pair, K, weight, gain, R, D,
                     begun, shocks)
            _without_dust(R.ravel())
            for g in range(min(lanes, M - group * lanes)):
                for i in range(count):
                    for s in range(len(begun)):
                        squares[s, node[g], begin + i] = shocks[s, i, g]
                    for c in range(C):
                        w[c, node[g], begin + i] = gain[c, i, g]
        for g in range(min(lanes, M - group * lanes)):
            log_det[node[g]] = log_f[g]


@njit(**INSIDE)
def _copy(source, target):
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            for g in range(source.shape[2]):
                target[i, j, g] = source[i, j, g]


DUSTED = 64    # samples after which that is asked again


@njit(**INSIDE)
def _without_dust(x):
    """Numbers of states (.,) that have nearly decayed are 0: see `sensorid.DUST`."""
    for k in range(len(x)):
        if abs(x[k]) < DUST:
            x[k] = 0.0


@njit(**INSIDE)
def _go_there(y, observed, noise, h, own, node, rise, begin, parts, of_columns, pair,
              P, x, K, weight, gain):
    """A stretch of the way there of `adjoint` from the sample `begin` on: K = Phi P h
    / f, weight 1 / f, 0 where nothing is seen, and gain nu / f of every sample; noise
    (., lanes) becomes f, 1 where nothing is seen. Columns lie side by side, as lanes
    do: x (n, C, lanes), and their parts `of_columns` (2, n, C lanes).
    """
    (C, N), n, lanes = y.shape, len(h), P.shape[2]
    Ph, turned, f, w = (np.empty((n, lanes)), np.empty((n, lanes)), np.empty(lanes),
                        np.empty(lanes))
    nu, all_x = np.empty((C, lanes)), x.reshape(n, C * lanes)
    all_nu = nu.ravel()
    for i in range(N):
        if len(rise):
            drive(own, node, rise, begin + i, i == 0, parts)
        for g in range(lanes):
            f[g] = noise[i, g]
        turn_covariance(parts, pair, P)
        observe_covariance(parts, pair, h, P, Ph, f)
        for g in range(lanes):
            w[g] = observed[i] / f[g]
            weight[i, g] = w[g]
            noise[i, g] = observed[i] * f[g] + (1.0 - observed[i])
        for s in range(n):
            for g in range(lanes):
                turned[s, g] = Ph[s, g] * w[g]
        turn(parts, pair, turned)
        for s in range(n):
            for g in range(lanes):
                K[i, s, g] = turned[s, g]
        update_covariance(P, Ph, w)
        for c in range(C):
            for g in range(lanes):
                nu[c, g] = y[c, i]
        turn(of_columns, pair, all_x)
        observe_state(h, all_x, all_nu)
        for c in range(C):
            for g in range(lanes):
                gain[c, i, g] = nu[c, g] * w[g]
            for s in range(n):
                for g in range(lanes):
                    x[s, c, g] += Ph[s, g] * gain[c, i, g]


@njit(**INSIDE)
def _go_back(N, h, back, of_columns, pair, K, weight, gain, R, D, begun, shocks):
    """A stretch of N samples of the way back of `adjoint`: gain (C, ., lanes) becomes
    C^-1 y; shocks (k, ., lanes) become s' C^-1 s; R (n, C, lanes) and D are what comes
    after. The last of the n + m states are those of the shocks, begun (k, m); back (2,
    n + m, lanes) are factors of Phi', those `of_columns` (2, n, C lanes).
    """
    (n, C, lanes), m = R.shape, begun.shape[1]
    kD, kDk, all_R = np.empty((n + m, lanes)), np.empty(lanes), R.reshape(n, C * lanes)
    few = pair[:n]
    for i in range(N - 1, -1, -1):
        for c in range(C):
            for s in range(n):
                for g in range(lanes):
                    gain[c, i, g] -= K[i, s, g] * R[s, c, g]
        turn(of_columns, few, all_R)
        for c in range(C):
            for s in range(n):
                for g in range(lanes):
                    R[s, c, g] += h[s] * gain[c, i, g]
        # D = h h' / f + L' D L with L = Phi - K h', K 0 of shocks
        for t in range(n + m):
            for g in range(lanes):
                kD[t, g] = 0.0
            for s in range(n):
                high, low = max(s, t), min(s, t)
                for g in range(lanes):
                    kD[t, g] += D[high, low, g] * K[i, s, g]
        for g in range(lanes):
            kDk[g] = weight[i, g]
        for s in range(n):
            for g in range(lanes):
                kDk[g] += K[i, s, g] * kD[s, g]
        turn(back, pair, kD)
        turn_covariance(back, pair, D)
        for s in range(n + m):
            for t in range(s + 1):
                for g in range(lanes):
                    D[s, t, g] += (h[s] * h[t] * kDk[g] - h[t] * kD[s, g]
                                   - h[s] * kD[t, g])
        for k in range(len(begun)):
            for g in range(lanes):
                shocks[k, i, g] = 0.0
            for s in range(m):
                for t in range(s + 1):
                    both = begun[k, s] * begun[k, t] * (1.0 if s == t else 2.0)
                    for g in range(lanes):
                        shocks[k, i, g] += both * D[n + s, n + t, g]


WHOLE = 1.5 * 2.0**52    # a number that is added to it is rounded to the last bit
PER_LN_2 = 1.0 / math.log(2.0)
LN_2 = 0.6931471803691238, 1.9082149292705877e-10    # in two parts, the first short


@njit(**INSIDE)
def exponentials(x, power, bits):
    """exp of x (lanes,) up to 0 in place, to 1e-15 of it, below -708 as there: that of
    a library takes one number at a time. Powers of two are made in `power` (lanes,), of
    which `bits` are whole numbers in the same place.
    """
    for g in range(len(x)):
        x[g] = x[g] if x[g] > -708.0 else -708.0    # of `max` there are no vectors
        power[g] = x[g] * PER_LN_2 + WHOLE
    for g in range(len(x)):
        n = power[g] - WHOLE
        r = (x[g] - n * LN_2[0]) - n * LN_2[1]
        high = 1 / 5040 + r * (1 / 40320 + r * (1 / 362880 + r * (1 / 3628800 + r * (
            1 / 39916800 + r * (1 / 479001600 + r * (1 / 6227020800))))))
        x[g] = 1.0 + r * (1.0 + r * (1 / 2 + r * (1 / 6 + r * (1 / 24 + r * (
            1 / 120 + r * (1 / 720 + r * high))))))
    for g in range(len(x)):
        bits[g] = (bits[g] + 1023) << 52    # 2^n
    for g in range(len(x)):
        x[g] *= power[g]


def row_products(rows, columns):
    """rows @ columns.T, each product in an order of its own for any number of threads.
    """
    result = np.zeros((len(rows), len(columns)))
    arguments = *in_rows(rows, columns), result
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


SUMS = dict(INSIDE, nogil=True, fastmath={"contract", "reassoc"})    # in the order of
                                                                     # the lanes


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


@njit(**INSIDE)
def spectrum(a, q, turn):
    """Spectrum of a sum of one-state processes at turn = |1 - exp(-i w)|^2."""
    S = 0.0
    for s in range(len(a)):
        S += (q[s] / ((1.0 - a[s])**2 + a[s] * turn)).real
    return S
