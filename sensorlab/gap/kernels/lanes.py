"""Nodes side by side: threads, lanes, and the steps that every recursion takes."""

import functools
import os
from concurrent.futures import ThreadPoolExecutor

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
        now, last = rise[at, i], rise[at, max(i - 1, 0)]
        if anew or now != last or last != rise[at, max(i - 2, 0)]:
            for s in range(own.shape[2]):
                parts[2, s, g] = own[2, at, s] + now * own[6, at, s] + (
                    now - last) * own[8, at, s]
                parts[3, s, g] = own[3, at, s] + now * own[7, at, s] + (
                    now - last) * own[9, at, s]


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


DUSTED = 64    # samples after which that is asked again


@njit(**INSIDE)
def without_dust(x):
    """Numbers of states (.,) that have nearly decayed are 0: see `sensorid.DUST`."""
    for k in range(len(x)):
        if abs(x[k]) < DUST:
            x[k] = 0.0
