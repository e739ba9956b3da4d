"""Filter of a level that steps at random.

One sample rarely proves a step: which is the last one is decided once later samples
have told. So one Gaussian is kept for every age that the last step may have, ages that
are alike together, the more of them the longer ago (P. Fearnhead, Z. Liu, "On-line
inference for multiple changepoint problems", J. R. Stat. Soc. B 69, 2007, keep every
age, or drop the unlikely ones). Lanes, and the steps of every recursion, are those of
`lanes`.
"""

import numpy as np
from numba import njit

from sensorid import INSIDE
from sensorlab.gap.kernels.arithmetic import exponentials
from sensorlab.gap.kernels.lanes import (
    KERNEL, drive, load, observe_covariance, observe_state, turn, turn_covariance,
    update_covariance, update_state)
from sensorlab.gap.kernels.told import (
    add_log_density, lanes_of_group, odd_and_log_score, probabilities_beside,
    weigh_kinds, weigh_updates)

OLD = 6            # the oldest age; a younger one, k, has the steps of some 2^k samples
RECENT = 2**OLD    # samples since a step, about, until it has that age
LEAST_SHARE = 1e-12    # of an age: what comes to it must be more than rounding


@njit(**KERNEL)
def filter_steps(first, last, lanes, kinds, y, H, own, pair, rise, r, outlier, jump,
                 out, total):
    """Groups of `mixtures.mixture_filters` of a level that steps at random, with
    outliers or without. Every age has lanes of its own, after those of the younger one.
    """
    N, rows, (M, n), ages = y.shape[1], out.shape[2], own.shape[1:], OLD + 1
    of_age, by_age = ages * lanes, (ages, lanes)
    for group in range(first, last):
        record, nodes, number, tell = lanes_of_group(group, lanes, M, out)
        node, along = np.empty(of_age, np.int64), np.empty((n, lanes))
        rate, wider, begin, step = (np.empty(of_age), np.empty(of_age), np.empty(lanes),
                                    np.empty(lanes))
        for g in range(of_age):
            at = node[g] = nodes[g % lanes]
            rate[g], wider[g] = outlier[at, 0], outlier[at, 1]
            begin[g % lanes], step[g % lanes] = jump[at, 0], jump[at, 4]
            for s in range(n):
                along[s, g % lanes] = own[10, at, s]
        parts, P = np.empty((6, n, of_age)), np.empty((n, n, of_age))
        load(own, pair, node, parts, P)
        here, wild, less, power, gain, shrink = (
            np.empty(of_age), np.zeros(of_age), np.empty(of_age), np.empty(of_age),
            np.empty(of_age), np.empty(of_age))
        for g in range(of_age):
            wild[g] = 1.0 if 2**(g // lanes) <= jump[node[g], 5] else 0.0
        x, Ph, nu, f, noise = (np.zeros((n, of_age)), np.empty((n, of_age)),
                               np.empty(of_age), np.empty(of_age), np.empty(of_age))
        per_f, half, term = (np.empty((kinds, of_age)), np.empty((kinds, of_age)),
                             np.empty((kinds, of_age)))
        bits, prior = power.view(np.int64), np.empty(by_age)
        weight = np.full(by_age, LEAST_SHARE)
        weight[-1] = 1.0
        value, seen, mass, least, log_f, product = (
            np.empty(lanes), np.empty(lanes), np.empty(lanes), np.empty(lanes),
            np.zeros(lanes), np.ones(lanes))
        x_of, P_of, here_of, prior_of = (x.reshape((n, *by_age)), P.reshape(
            (n, n, *by_age)), here.reshape(by_age), prior.ravel())
        rate_of, wild_of = rate.reshape(by_age), wild.reshape(by_age)
        nu_of, gain_of, shrink_of = (nu.reshape(by_age), gain.reshape(by_age),
                                     shrink.reshape(by_age))
        half_of, per_f_of = half.reshape((kinds, *by_age)), per_f.reshape(
            (kinds, *by_age))
        mean, spread = np.empty((n, lanes)), np.empty((n, n, lanes))
        told = np.zeros((rows, tell))
        for i in range(N):
            h = H[i]
            if len(rise):
                drive(own, node, rise, i, i == 0, parts)
            for g in range(lanes):
                value[g] = y[record[g], i]
                seen[g] = 0.0 if np.isnan(value[g]) else 1.0
                value[g] = value[g] if seen[g] > 0.0 else 0.0
            if i == 0 or r.shape[1] > 1:
                for g in range(of_age):
                    noise[g] = r[node[g], i]
            _grow_older(i, weight, begin, x_of, P_of, prior, mean, spread)
            for age in range(ages):
                for g in range(lanes):
                    nu_of[age, g] = value[g]
            for g in range(of_age):
                f[g] = noise[g]
            turn_covariance(parts, pair, P)
            _step(step, along, P_of)
            observe_covariance(parts, pair, h, P, Ph, f)
            turn(parts, pair, x)
            observe_state(h, x, nu)
            weigh_kinds(prior_of, rate, wider, nu, f, per_f, half, term)
            for g in range(lanes):
                least[g] = half_of[0, 0, g]
            for kind in range(kinds):
                for age in range(ages):
                    for g in range(lanes):
                        other = half_of[kind, age, g]
                        least[g] = other if other < least[g] else least[g]
            for kind in range(kinds):
                for age in range(ages):
                    for g in range(lanes):
                        less[age * lanes + g] = least[g] - half_of[kind, age, g]
                exponentials(less, power, bits)
                for g in range(of_age):
                    term[kind, g] *= less[g]
            for g in range(of_age):
                here[g] = term[0, g] + (term[1, g] if kinds == 2 else 0.0)
            for g in range(lanes):
                mass[g] = 0.0
            for age in range(ages):
                for g in range(lanes):
                    mass[g] += here_of[age, g]
            add_log_density(seen, mass, least, i % 8 == 7 or i == N - 1, log_f, product)
            weigh_updates(term, here, per_f, nu, wild, gain, shrink)
            for age in range(ages):
                for g in range(lanes):
                    gain_of[age, g] *= seen[g]
                    shrink_of[age, g] *= seen[g]
            update_state(x, Ph, gain)
            update_covariance(P, Ph, shrink)
            for age in range(ages):
                for g in range(lanes):
                    share = here_of[age, g] / mass[g] if seen[g] > 0.0 else (
                        prior[age, g])
                    weight[age, g] = share if share > LEAST_SHARE else LEAST_SHARE
            if tell:
                probabilities_beside(rate_of, prior, per_f_of, nu_of, less, power, told)
            if tell and rows > 2:
                odd_and_log_score(here_of, wild_of, mass, least, weight[OLD], told)
            for g in range(tell):
                for row in range(rows if seen[g] > 0.0 else 0):
                    out[record[g], node[g], row, i] = told[row, g]
        for g in range(number):
            total[record[g], node[g]] = -log_f[g]


@njit(**INSIDE)
def _step(variance, along, P):
    """The covariance (n, n, ages, lanes) of the youngest age with that of a step, by
    which the states move `along` (n, lanes).
    """
    n, lanes = along.shape
    for s in range(n):
        for t in range(s + 1):
            for g in range(lanes):
                P[s, t, 0, g] += variance[g] * along[s, g] * along[t, g]


@njit(**INSIDE)
def _grow_older(i, weight, begin, x, P, prior, mean, spread):
    """States x (n, ages, lanes) and P (n, n, ages, lanes) of the ages at sample i,
    before it is predicted, and their probabilities `prior` (ages, lanes).

    With the probability `begin` (lanes,) a step comes, whichever age the last one had:
    all Gaussians together are the youngest one. What was of an age k is of the next
    from every sample on that 2^k divides, as in a binary counter: one Gaussian joins
    that of the next age, those of younger ages have that to themselves. mean (n, lanes)
    and spread (n, n, lanes) are room to work in; loops over ages, of which the number
    is known, are unrolled within those over lanes.
    """
    n, _, lanes = x.shape
    for s in range(n):
        for g in range(lanes):
            total = 0.0
            for age in range(OLD):
                total += weight[age, g] * (x[s, age, g] - x[s, OLD, g])
            mean[s, g] = total
        for t in range(s + 1):
            for g in range(lanes):
                total = weight[OLD, g] * P[s, t, OLD, g] - mean[s, g] * mean[t, g]
                for age in range(OLD):
                    total += weight[age, g] * (P[s, t, age, g] + (
                        x[s, age, g] - x[s, OLD, g]) * (x[t, age, g] - x[t, OLD, g]))
                spread[s, t, g] = total
    for s in range(n):
        for g in range(lanes):
            mean[s, g] += x[s, OLD, g]
    last, share = 0, prior[0]    # share of the older of two, until prior[0] is due
    while last < OLD - 1 and i % 2**(last + 1) == 0:
        last += 1
    for g in range(lanes):
        both = weight[last, g] + weight[last + 1, g]
        share[g] = weight[last + 1, g] / both
        weight[last + 1, g] = both
    for s in range(n):
        for t in range(s + 1):
            for g in range(lanes):
                other = P[s, t, last, g]
                P[s, t, last + 1, g] = other + share[g] * (
                    P[s, t, last + 1, g] - other + (1.0 - share[g]) * (
                        x[s, last + 1, g] - x[s, last, g]) * (
                        x[t, last + 1, g] - x[t, last, g]))
            for age in range(last, 0, -1):
                for g in range(lanes):
                    P[s, t, age, g] = P[s, t, age - 1, g]
            for g in range(lanes):
                P[s, t, 0, g] = spread[s, t, g]
    for s in range(n):
        for g in range(lanes):
            other = x[s, last, g]
            x[s, last + 1, g] = other + share[g] * (x[s, last + 1, g] - other)
        for age in range(last, 0, -1):
            for g in range(lanes):
                x[s, age, g] = x[s, age - 1, g]
        for g in range(lanes):
            x[s, 0, g] = mean[s, g]
    for g in range(lanes):
        for age in range(OLD, 0, -1):
            own = weight[age - 1 if age <= last else age, g]
            prior[age, g] = own * (1.0 - begin[g])
        prior[0, g] = begin[g]
