"""C^-1 y of columns at many nodes, there and back, and what a shock at every sample has
of it.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from sensorid import INSIDE
from sensorlab.gap.kernels.lanes import (
    KERNEL, drive, groups, in_rows, in_threads, lanes_for, load, observe_covariance,
    observe_state, turn, turn_covariance, update_covariance, without_dust)


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
            without_dust(x.ravel())
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
            without_dust(R.ravel())
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
