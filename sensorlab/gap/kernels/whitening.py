"""Filters without jumps at one node: gains, which no record changes, whitened records,
and the way back.
"""

import numpy as np
from numba import njit

from sensorid import INSIDE
from sensorlab.gap.kernels.lanes import (
    DUSTED, KERNEL, groups, in_rows, in_threads, lanes_for, observe_state, turn,
    turn_covariance, without_dust)

ROUNDING = 1e-16    # of the largest variance of an innovation


@njit(**KERNEL)
def plain_gains(H, own, pair, rise, r, gap, gain, f):
    """Of a filter without jumps what no record changes, in place: gain (N, n), by which
    the innovation of a sample moves the states, and its variance f (N,).

    H (N or 1, n) observes n states; own (10, n), pair (n,), rise (0 or N,) and r (1 or
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
            more = rise[i] - rise[max(i - 1, 0)]
            for s in range(n):
                q[s] = own[2, s] + rise[i] * own[6, s] + more * own[8, s]
                c[s] = own[3, s] + rise[i] * own[7, s] + more * own[9, s]
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
                without_dust(x.ravel())


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
                without_dust(x.ravel())


@njit(**INSIDE)
def _in_lanes(turned, lanes):
    """The factors (2, n) of a node in so many lanes, (2, n, lanes)."""
    result = np.empty((*turned.shape, lanes))
    for k in range(2):
        for s in range(turned.shape[1]):
            for g in range(lanes):
                result[k, s, g] = turned[k, s]
    return result
