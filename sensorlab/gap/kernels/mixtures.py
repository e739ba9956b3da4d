"""Mixture filters: of records with outliers, and with a level, of the value or of the
noise, that is one of two.

Lanes, and the steps of every recursion, are those of `lanes`.
"""

import numpy as np
from numba import njit
from scipy.special import logsumexp

from sensorid import INSIDE
from sensorlab.gap.kernels.arithmetic import exponentials
from sensorlab.gap.kernels.lanes import (
    KERNEL, LANES, drive, groups, in_rows, in_threads, lanes_for, load,
    observe_covariance, observe_state, turn, turn_covariance, update_covariance,
    update_state)
from sensorlab.gap.kernels.levels import UNROLLED_LEVELS, filter_levels
from sensorlab.gap.kernels.outliers import UNROLLED_OUTLIERS, filter_outliers
from sensorlab.gap.kernels.steps import filter_steps
from sensorlab.gap.kernels.told import (
    add_log_density, lanes_of_group, odd_and_log_score, probabilities_beside,
    weigh_kinds, weigh_updates)

HEAD = 4000        # samples of a long record that mostly tell at which level it begins
SURE_NATS = 30.0    # by which one of the two is the likelier there
AT_ONCE = 4 * 10**5    # samples of records of which everything is told at once


def mixture_filters(y, H, own, pair, rise, r, outlier, jump, out):
    """Log-likelihoods (R, M) of records under filters with outliers and two levels, or
    a level that steps.

    y (R, N); H (N, n) observes n states; own (11, M, n), pair (n,), rise (M or 0, N)
    and r (M, 1 or N) are the parts of `parts.Parts`; outlier (M, 2) = rate,
    variance; jump (M, 6) = probabilities that the second level begins and that it ends,
    half the distance of the levels, variance that the second adds to the noise, that of
    a step, which then begins (the last three 0: one level), and for how many samples
    one is felt that is an outlier, 0 if it stays. out (R, K, 0, 2 or 5, N) gets of
    every sample, by the first K nodes, the predictive probabilities below and above it,
    that of its being an outlier, its log density and the probability of the second
    level, or of a recent step; where nothing jumps, its normal score in place of the
    first.

    One Gaussian per level is kept: after each sample, the two that have led to a level
    are merged (generalized pseudo-Bayes of second order; Chang and Athans, "State
    estimation for discrete systems with switching parameters", IEEE Trans. Aerosp.
    Electron. Syst. 14, 1978). Where levels are apart, a bias is another beneath each,
    and one record begins at either: two filters, which are never merged. Of steps, see
    `steps`.
    """
    parts = H, own, pair, rise, r, outlier, jump
    total = _mixed(y, *parts, out)
    if not outlier[:, 0].any():
        return total
    begin, odd, rest = _begin(y), np.arange(len(y)), y
    for count in range(1, MOST_ODD + 1):    # and the next, if it lies away as well
        odd = odd[odd_at_first(rest)]
        rest = y[odd]
        for first in np.unique(begin[odd]):
            here, away = begin[odd] == first, slice(first, first + count)
            some = odd[here]
            rest[here, away] = np.nan
            beside = np.full((len(some), *out.shape[1:]), np.nan)
            others = _log_of_outliers(away, y[some], *parts) + _mixed(
                rest[here], *parts, beside)
            share = np.exp(others - np.logaddexp(total[some], others))
            _weigh_first(away, beside, share[:, :out.shape[1]], some, out)
            total[some] = np.logaddexp(total[some], others)
    return total


ODD_AT_FIRST = 5.0    # median deviations of its neighbours, from which on it may be one
NEIGHBOURS = 8        # that tell where they lie
MOST_ODD = 4          # of these at once
KNOWN = 64            # samples that tell what a first one is beside them


def odd_at_first(y):
    """Numbers of those records (R, N) whose first sample lies away from the next ones:
    a filter that knows no level yet takes it for that, and cannot think again.
    """
    at = _begin(y)[:, None] + np.arange(1 + NEIGHBOURS)
    near = np.take_along_axis(y, np.minimum(at, y.shape[1] - 1), 1)
    seen = np.flatnonzero((at[:, -1] < y.shape[1]) & ~np.isnan(near).any(1))
    first, near = near[seen, 0], near[seen, 1:]
    middle = np.median(near, axis=1)
    spread = np.median(np.abs(near - middle[:, None]), axis=1)
    return seen[np.abs(first - middle) > ODD_AT_FIRST * spread]


def _begin(y):
    """Numbers (R,) of the first samples of records (R, N) that are not missing."""
    return np.argmax(~np.isnan(y), axis=1)


def _log_of_outliers(away, y, H, own, pair, rise, r, outlier, *rest):
    """Log densities (R, M) of the first samples of records y (R, N), a slice `away`, as
    outliers, beside what the next ones tell, and that they are.
    """
    known = slice(away.start + KNOWN)
    noise = np.broadcast_to(r, (len(r), y.shape[1]))[:, known].copy()
    y, H = y[:, known], H[known]
    nothing = np.empty((len(y), len(outlier), 0, y.shape[1]))
    without = np.where(np.arange(y.shape[1]) >= away.stop, y, np.nan)
    unseen = _mixed(without, H, own, pair, rise, noise, outlier, *rest, nothing)
    noise[:, away] += outlier[:, 1:]
    seen = _mixed(y, H, own, pair, rise, noise, outlier, *rest, nothing)
    with np.errstate(divide="ignore"):    # some nodes may have none
        return (away.stop - away.start) * np.log(outlier[:, 0]) + seen - unseen


def _weigh_first(away, beside, share, odd, out):
    """Make what is told `out` (R, K, rows, N) of records number `odd` that where their
    first samples `away` are outliers, `beside` them, by the `share` (O, K) that this
    has.
    """
    if not out.shape[2]:
        return
    share, own = share[:, :, None, None], out[odd]
    told = np.where(np.isnan(beside), own, (1.0 - share) * own + share * beside)
    if out.shape[2] > 2:
        told[:, :, 2, away] += share[:, :, 0] * (1.0 - told[:, :, 2, away])
    out[odd] = told


def _mixed(y, H, own, pair, rise, r, outlier, jump, out):
    """`mixture_filters` but for a first sample that is an outlier."""
    second = jump[:, 0] / np.maximum(jump[:, 0] + jump[:, 1], 1e-300)
    parts = H, own, pair, rise, r, outlier, jump
    if not jump[:, 2].any():
        return _filtered(y, *parts, np.tile(second, (len(y), 1)), out)
    log_prior = np.log(np.column_stack([1.0 - second, second]))
    if not out.shape[2]:
        return logsumexp(_of_begins(y, parts, log_prior), axis=2)
    if y.shape[1] <= 4 * HEAD:
        return _told_of_begins(y, parts, log_prior, out)
    return _told_of_likelier(y, parts, log_prior, out)


def _told_of_begins(y, parts, log_prior, out):
    """`_mixed` of records that begin at either level, by filters of both."""
    R, (told, _, N), M = len(y), out.shape[1:], len(log_prior)
    total, at_once = np.empty((R, M)), max(AT_ONCE // N, 1)
    for first in range(0, R, at_once):
        some = slice(first, first + at_once)
        beside = np.full((len(y[some]), 2 * told, 5, N), np.nan)
        total[some] = logsumexp(_of_either(y[some], parts, log_prior, beside), axis=2)
        _weigh_begins(beside, np.diff(log_prior[:told], axis=1)[:, 0], out[some])
    return total


def _told_of_likelier(y, parts, log_prior, out):
    """The same of long records, by filters of the likelier level alone where the head
    of a record is sure of it at all nodes.
    """
    (R, told, rows, N), M = out.shape, len(log_prior)
    beside = np.full((R, 2 * told, 5, HEAD), np.nan)
    either = _of_either(y[:, :HEAD], _head(parts), log_prior, beside)
    level, sure = either.argmax(2), (np.ptp(either, axis=2) >= SURE_NATS).all(1)
    own, others = np.flatnonzero(sure), np.flatnonzero(~sure)
    total, here = np.empty((R, M)), np.full((len(own), told, rows, N), np.nan)
    if len(own):
        total[own] = _filtered(y[own], *parts, level[own] * 1.0, here) + log_prior[
            np.arange(M), level[own]]
        begun = np.full((len(own), told, rows, HEAD), np.nan)
        _weigh_begins(beside[own], np.diff(log_prior[:told], axis=1)[:, 0], begun)
        here[..., :HEAD] = begun
        out[own] = here
    if len(others):
        here = np.full((len(others), told, rows, N), np.nan)
        total[others] = _told_of_begins(y[others], parts, log_prior, here)
        out[others] = here
    return total


def _of_begins(y, parts, log_prior):
    """Log-likelihoods (R, M, 2) of records that begin at either level, and that they
    do; of one long record, most nodes are sure by its head of one.
    """
    if len(y) > 1 or y.shape[1] <= 4 * HEAD:
        return _of_either(y, parts, log_prior)
    result = _of_either(y[:, :HEAD], _head(parts), log_prior)
    likelier, behind = result[0].argmax(1), np.ptp(result[0], axis=1)
    left = [(node, level) for node, level in np.ndindex(len(log_prior), 2)
            if level == likelier[node] or behind[node] < SURE_NATS]
    at = tuple(np.transpose(left))
    result[:] = -np.inf
    result[0][at] = _from(left, y, parts)[0] + log_prior[at]
    return result


def _head(parts):
    """What filters of the head of a record need."""
    H, own, pair, rise, r, *rest = parts
    return H[:HEAD], own, pair, rise[:, :HEAD], r[:, :HEAD], *rest


def _of_either(y, parts, log_prior, out=None):
    """`_of_begins` by filters of both."""
    every = list(np.ndindex(log_prior.shape))
    return _from(every, y, parts, out).reshape(-1, *log_prior.shape) + log_prior


def _from(begins, y, parts, out=None):
    """Log-likelihoods (R, B) at some nodes of records that begin at some level, for
    pairs of both; `out` as for `mixture_filters`, of these.
    """
    H, own, pair, rise, r, outlier, jump = parts
    node, level = np.transpose(begins)
    if out is None:
        out = np.empty((len(y), len(node), 0, y.shape[1]))
    return _filtered(y, H, own[:, node], pair, rise[node] if len(rise) else rise,
                     r[node], outlier[node], jump[node], np.tile(
                         level * 1.0, (len(y), 1)), out)


@njit(**KERNEL)
def _weigh_begins(told, log_odds, out):
    """What is told (R, 2 K, 5, N) of records by pairs of filters, of which one is
    right, the second one with these odds (K,) a priori, as one: out (R, K, rows, N).
    """
    R, K, rows, N = out.shape
    for r in range(R):
        for k in range(K):
            odds = log_odds[k]
            for i in range(N):
                one, other = told[r, 2 * k, :, i], told[r, 2 * k + 1, :, i]
                if np.isnan(one[3]):
                    continue
                first, second = 1.0 / (1.0 + np.exp(odds)), 1.0 / (1.0 + np.exp(-odds))
                for row in range(2):
                    out[r, k, row, i] = first * one[row] + second * other[row]
                odds += other[3] - one[3]
                if rows > 2:
                    most = max(one[3], other[3])
                    out[r, k, 3, i] = most + np.log(first * np.exp(
                        one[3] - most) + second * np.exp(other[3] - most))
                    first, second = 1.0 / (1.0 + np.exp(odds)), 1.0 / (
                        1.0 + np.exp(-odds))
                    for row in (2, 4):
                        out[r, k, row, i] = first * one[row] + second * other[row]


def _filtered(y, H, own, pair, rise, r, outlier, jump, second, out):
    """`mixture_filters` of records that begin at the second level with these
    probabilities (R, M).
    """
    y, own, r = in_rows(y, own, r)
    total = np.empty((len(y), own.shape[1]))
    louder = not len(rise) and own[6:10].any()    # before a low-pass
    levels = 2 if louder or jump[:, 2:4].max() > 0.0 else 1
    kinds = 2 if outlier[:, 0].max() > 0.0 else 1
    n, away, some = len(pair), abs(pair - np.arange(len(pair))).max(), groups(
        total.size, LANES)
    if jump[:, 4].any():
        lanes = lanes_for(total.size, 2 * LANES)    # of every age
        in_threads(filter_steps, groups(total.size, lanes), lanes, kinds, y, H, own,
                   pair, rise, r, outlier, jump, out, total)
    elif (levels, kinds) == (1, 2) and n <= UNROLLED_OUTLIERS and not len(
            rise) and not away:
        in_threads(filter_outliers, some, (0,) * n, y, H, own, r, outlier, out, total)
    elif (levels, kinds) == (2, 1) and n <= UNROLLED_LEVELS and not len(
            rise) and not away and not own[6:].any():
        in_threads(filter_levels, some, (0,) * n, y, H, own, r, jump, second, out,
                   total)
    else:
        lanes = lanes_for(total.size) if total.size > LANES // 2 else total.size
        in_threads(_filter_mixtures, groups(total.size, lanes), lanes, levels, kinds, y,
                   H, own, pair, rise, r, outlier, jump, second, out, total)
    return total


@njit(**KERNEL)
def _filter_mixtures(first, last, lanes, levels, kinds, y, H, own, pair, rise, r,
                     outlier, jump, second, out, total):
    """Groups of `mixture_filters`. The second level has lanes of its own, after those
    of the first; so has every path from one level to one: those to the first, from
    either, then those to the second.
    """
    N, rows, (M, n) = y.shape[1], out.shape[2], own.shape[1:]
    of_level, of_path = levels * lanes, levels * levels * lanes
    for group in range(first, last):
        record, nodes, number, tell = lanes_of_group(group, lanes, M, out)
        node = np.empty(of_path, np.int64)
        rate, wider, chance, offset, louder = (
            np.empty(of_path), np.empty(of_path), np.ones(of_path), np.zeros(of_path),
            np.zeros(of_path))
        weight, push = np.ones(of_level), np.zeros((n, lanes))
        for g in range(of_path):
            at = node[g] = nodes[g % lanes]
            rate[g], wider[g] = outlier[at, 0], outlier[at, 1]
            if levels == 2:
                to, start, change = g // of_level, g // lanes % 2, jump[at]
                chance[g] = change[start] if to != start else 1.0 - change[start]
                begins = second[record[g % lanes], at]
                weight[g % of_level] = begins if start else 1.0 - begins
                offset[g], louder[g] = (2 * to - 1) * change[2], to * change[3]
                for s in range(n):    # of a low-pass, where the level changes
                    push[s, g % lanes] = 2.0 * change[2] * own[10, at, s]
                    offset[g] += (to - start) * H[0, s] * push[s, g % lanes]
        parts, P = np.empty((6, n, of_path)), np.empty((n, n, of_path))
        load(own, pair, node, parts, P)
        x, Ph, noise = (np.zeros((n, of_path)), np.empty((n, of_path)),
                        np.empty(of_path))
        of_kinds = kinds, of_path
        per_f, half, term = np.empty(of_kinds), np.empty(of_kinds), np.empty(of_kinds)
        prior, here, share, wild = (np.empty(of_path), np.empty(of_path),
                                    np.empty(of_path), np.zeros(of_path))
        e, v, gain, shrink, seen = (np.empty(of_path), np.empty(of_path),
                                    np.empty(of_path), np.empty(of_path),
                                    np.empty(of_path))
        less, power, least = np.empty(of_path), np.empty(of_path), np.empty(of_path)
        value, mass, log_f, product = (np.empty(lanes), np.empty(lanes),
                                       np.zeros(lanes), np.ones(lanes))
        bits = power.view(np.int64)
        # the same by path, or by the level that it leads to
        by_path, to_level = (levels * levels, lanes), (levels, of_level)
        seen_of, here_of, share_of, prior_of = (
            seen.reshape(by_path), here.reshape(by_path), share.reshape(by_path),
            prior.reshape(by_path))
        prior_to, chance_to = prior.reshape(to_level), chance.reshape(to_level)
        half_of, least_of, weight_of = (
            half.reshape(kinds, *by_path), least.reshape(by_path),
            weight.reshape(levels, lanes))
        x_of, P_of = x.reshape(n, *by_path), P.reshape(n, n, *by_path)
        apart, new = np.empty((n, levels, lanes)), np.empty((levels, lanes))
        rate_of, wild_of, e_of, per_f_of = (
            rate.reshape(by_path), wild.reshape(by_path), e.reshape(by_path),
            per_f.reshape(kinds, *by_path))
        told = np.zeros((rows, tell))
        for i in range(N):
            h = H[i]
            if len(rise):
                drive(own, node, rise, i, i == 0, parts)
            elif levels == 2 and i < 2:    # it was quiet before the first sample
                _drive_paths(own, node, lanes, i > 0, parts)
            for g in range(lanes):
                value[g] = y[record[g], i]
            for path in range(levels * levels):
                for g in range(lanes):
                    seen_of[path, g] = 0.0 if np.isnan(value[g]) else 1.0
            if i == 0 or r.shape[1] > 1:
                for g in range(of_path):
                    noise[g] = r[node[g], i] + louder[g]
            for path in range(levels * levels):
                for g in range(lanes):
                    e_of[path, g] = 0.0 if np.isnan(value[g]) else value[g]
            for g in range(of_path):
                e[g] -= offset[g]
                v[g] = noise[g]
            turn_covariance(parts, pair, P)
            observe_covariance(parts, pair, h, P, Ph, v)
            turn(parts, pair, x)
            observe_state(h, x, e)
            for to in range(levels):
                for g in range(of_level):
                    prior_to[to, g] = weight[g] * chance_to[to, g]
            weigh_kinds(prior, rate, wider, e, v, per_f, half, term)
            # no sample is as far out for an outlier
            _least_of_paths(half_of[kinds - 1], least_of)
            for kind in range(kinds if levels == 2 else kinds - 1):
                for g in range(of_path):
                    less[g] = least[g] - half[kind, g]
                exponentials(less, power, bits)
                for g in range(of_path):
                    term[kind, g] *= less[g]
            for g in range(of_path):
                here[g] = term[0, g] + (term[1, g] if kinds == 2 else 0.0)
            for g in range(lanes):
                mass[g] = here[g]
            for path in range(1, levels * levels):
                for g in range(lanes):
                    mass[g] += here_of[path, g]
            add_log_density(seen, mass, least, i % 8 == 7 or i == N - 1, log_f, product)
            weigh_updates(term, here, per_f, e, wild, gain, shrink)
            for g in range(of_path):
                gain[g] *= seen[g]
                shrink[g] *= seen[g]
            update_state(x, Ph, gain)
            update_covariance(P, Ph, shrink)
            if levels == 2:
                _share_paths(here_of, prior_of, seen, mass, share_of, weight_of)
                _merge_paths(share_of, push, apart, new, x_of, P_of)
            if tell and levels * kinds == 1:
                for g in range(tell):
                    told[0, g] = e[g] * np.sqrt(per_f[0, g])
            elif tell:
                probabilities_beside(rate_of, prior_of, per_f_of, e_of, less, power,
                                     told)
            if tell and rows > 2:
                odd_and_log_score(here_of, wild_of, mass, least, weight, told)
            for g in range(tell):
                for row in range(rows if seen[g] > 0.0 else 0):
                    out[record[g], node[g], row, i] = told[row, g]
        for g in range(number):
            total[record[g], node[g]] = -log_f[g]


@njit(**INSIDE)
def _drive_paths(own, node, lanes, from_second, parts):
    """The noises of the states of all paths (4 lanes), where that of the second level
    is louder before a low-pass; paths from it were loud a sample before, or not yet.
    """
    for g in range(4 * lanes):
        to, start, at = g // (2 * lanes), g // lanes % 2 * from_second, node[g]
        for s in range(own.shape[2]):
            for k in range(2, 4):
                parts[k, s, g] = own[k, at, s] + to * own[4 + k, at, s] + (
                    to - start) * own[6 + k, at, s]


@njit(**INSIDE)
def _least_of_paths(half, least):
    """The least of each lane over its paths (paths, lanes), in all of them."""
    paths, lanes = half.shape
    for path in range(paths):
        for g in range(lanes):
            other = half[path, g]
            least[0, g] = other if path == 0 or other < least[0, g] else least[0, g]
    for path in range(1, paths):
        for g in range(lanes):
            least[path, g] = least[0, g]


@njit(**INSIDE)
def _share_paths(here, prior, seen, mass, share, weight):
    """Probabilities (2, lanes) of the levels after a sample, and that a path (4, lanes)
    is the one that led to its level; where nothing is seen, as before.
    """
    for path in range(4):
        for g in range(len(mass)):
            part = here[path, g] / mass[g]
            share[path, g] = part if seen[g] > 0.0 else prior[path, g]
    for to in range(2):
        first, second = 2 * to, 2 * to + 1
        for g in range(len(mass)):
            both = share[first, g] + share[second, g] + 1e-200
            weight[to, g] = both if both > 1e-12 else 1e-12
            share[first, g] /= both
        for g in range(len(mass)):
            share[second, g] = 1.0 - share[first, g]


@njit(**INSIDE)
def _merge_paths(share, push, apart, new, x, P):
    """One Gaussian of each level after a sample, from the two paths that have led
    there, on both that start from it: x (n, 4, lanes) and P (n, n, 4, lanes); the way
    up adds a push (n, lanes).

    apart (n, 2, lanes) becomes the difference of the two states.
    """
    n, _, lanes = x.shape
    for s in range(n):
        for to in range(2):
            first, second = 2 * to, 2 * to + 1
            for g in range(lanes):
                other = x[s, second, g] - (1 - to) * push[s, g]
                apart[s, to, g] = x[s, first, g] + to * push[s, g] - other
                new[to, g] = other + share[first, g] * apart[s, to, g]
        for to in range(2):
            for g in range(lanes):
                x[s, to, g] = new[to, g]
                x[s, 2 + to, g] = new[to, g]
        for t in range(s + 1):
            for to in range(2):
                first, second = 2 * to, 2 * to + 1
                for g in range(lanes):
                    other = P[s, t, second, g]
                    new[to, g] = other + share[first, g] * (
                        P[s, t, first, g] - other + share[second, g] * (
                            apart[s, to, g] * apart[t, to, g]))
            for to in range(2):
                for g in range(lanes):
                    P[s, t, to, g] = new[to, g]
                    P[s, t, 2 + to, g] = new[to, g]


@njit(**KERNEL)
def smoothed(so_far, begin, end):
    """Probabilities (N,) of a second level by all samples, from those by the samples so
    far, NaN where none is seen; chances that it begins and ends, a sample.
    """
    result, before = so_far.copy(), begin / (begin + end)
    for i in range(len(result)):
        if np.isnan(result[i]):
            result[i] = before * (1.0 - end) + (1.0 - before) * begin
        before = result[i]
    for i in range(len(result) - 2, -1, -1):
        here = result[i]
        there = here * (1.0 - end) + (1.0 - here) * begin    # by the samples so far
        stays = (1.0 - end) * result[i + 1] / there
        result[i] = here * (stays + end * (1.0 - result[i + 1]) / (1.0 - there))
    return result
