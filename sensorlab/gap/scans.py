"""Scans: scores of thousands of signatures by one backward pass, each kind in its way:
steps at every onset, sinusoids at every frequency, pulses of every duration.

A scan of a long record has millions of scores a node: it is a function that gives those
of one node, so that they need not all be there at a time, and gains alone if asked to.
"""

import itertools

import numpy as np
from numba import njit
from scipy.fft import next_fast_len
from scipy.signal import find_peaks

from sensorid import side_by_side
from sensorlab.gap.catalogue import MIN_CYCLES, MIN_PULSE
from sensorlab.gap.effects import LONG_RECORD
from sensorlab.gap.evidence import normalized
from sensorlab.gap.kernels import KERNEL, spectrum
from sensorlab.gap.signatures import (
    Scores, blocks, information, joined, least_squares, mean_bayes, scores_at)


def _onset_scores(scene, family, solved):
    def of_node(k, gains_alone=False):
        size, J = np.empty((2, len(scene.y) - 1))
        _step_sizes(k, *solved[1:5], size, J)
        return Scores(scene.time[1:], (size * size * J)[None], size[None],
                      1.0 / np.sqrt(J)[None], 1)
    return of_node


@njit(**KERNEL)
def _step_sizes(node, residual, w, cov, steps, size, information):
    """Least-squares size of a step at samples 1 ... N - 1, and its information, each
    (N - 1,), at one node of the parts of `Solved`.
    """
    C, M, N = w.shape
    number, cross = 0.0, np.zeros(C)
    least = 1e-9 * steps[node].max()    # after the last sample seen there is none
    for i in range(N - 1, 0, -1):
        number += residual[node, i]
        J = steps[node, i]
        for c in range(C):
            cross[c] += w[c, node, i]
        for c in range(C):
            for d in range(C):
                J -= cross[c] * cov[node, c, d] * cross[d]
        J = max(J, 1e-6 * steps[node, i] + least)
        size[i - 1], information[i - 1] = number / J, J


@njit(**KERNEL)
def _line_information(first, last, turn, count, a, q, r, J):
    """Information (M, m) of sinusoids added to J: count / 2 over the spectrum of the
    model, averaged over the two levels that its white noise r (M, 1 or N) may have.

    turn (m,) = |1 - exp(-i w)|^2.
    """
    for node in range(first, last):
        low, high = r[node, 0], r[node, -1]
        share = (r[node].mean() - low) / (high - low) if high != low else 0.0
        for j in range(len(turn)):
            S = spectrum(a[node], q[node], turn[j])
            J[node, j] += 0.5 * count * (
                (1.0 - share) / (S + low) + share / (S + high))


PADDING = 4    # frequencies per 1 / T, at least


EXACT_CYCLES = 20    # in a record: below, its ends count, and the spectrum of a walk
                     # is no measure of the information


def _frequency_scores(scene, family, solved):
    """Of the information below EXACT_CYCLES, in a long record that of whole cycles and
    between them by interpolation; above by the spectrum.
    """
    N = len(scene.y)
    n = next_fast_len(PADDING * N, real=True)
    first, split = (-(-cycles * n // N) for cycles in (MIN_CYCLES, EXACT_CYCLES))
    frequency = np.fft.rfftfreq(n, scene.dt)[first:-PADDING]
    slow, fast = slice(split - first), slice(split - first, None)
    exact = frequency[slow]
    if N > LONG_RECORD:
        exact = np.union1d(np.arange(MIN_CYCLES + 1, EXACT_CYCLES) / scene.duration,
                           exact[[0, -1]])
    J = [information(scene, block.columns, solved)
         for block in blocks(scene, family, exact)]
    J = _interpolated(frequency[slow], exact, np.concatenate(J, axis=1))
    turn = 2.0 - 2.0 * np.cos(2.0 * np.pi * frequency[fast] * scene.dt)
    count = np.sum(~np.isnan(scene.y))

    def of_node(k, gains_alone=False):
        line = np.fft.rfft(solved.residual[k:k + 1], n)[:, first:-PADDING]
        number = np.stack([line[:, slow].real, -line[:, slow].imag], axis=-1)
        square = line[:, fast].real**2
        square += line[:, fast].imag**2
        del line
        spectral = np.zeros_like(square)
        for share, own in solved.spectra:
            _line_information(0, 1, turn, share[k] * count, *(
                np.ascontiguousarray(part[k:k + 1])
                for part in (own.a, own.q, own.r)), spectral)
        below = least_squares(frequency[slow], number, J[k:k + 1])
        if gains_alone:
            square /= spectral
            return Scores(frequency, np.append(below.gain, square, 1), None, None, 2)
        return joined([below, Scores(
            frequency[fast], square / spectral, np.sqrt(square) / spectral,
            1.0 / np.sqrt(spectral), 2)])
    return of_node


def _interpolated(x, at, value):
    """Values (M, len(x), ...) at x from those (M, len(at), ...) at some of them."""
    if len(at) == len(x):
        return value
    k = np.searchsorted(at, x).clip(1, len(at) - 1)
    share = ((x - at[k - 1]) / (at[k] - at[k - 1])).reshape(-1, 1, 1)
    return (1.0 - share) * value[:, k - 1] + share * value[:, k]


DURATION_STEP = 1.6    # ratio of one duration of a pulse to the next
KNOTS = 0.0, 0.05, 0.5, 0.95, 1.0    # of all onsets, where the information of a pulse
                                     # is exact
PARTS = 4              # of its duration, by which onsets are apart
LIKELY = 32            # pulses whose information is exact wherever they are
EDGES = 12             # onsets of steps that may be edges of a pulse


def _pulse_scores(scene, family, solved):
    """Pulses of any duration, which begin a fourth of it apart at most, and those
    between two likely edges, which a walk shows to a few samples.

    Between two knots their information is taken to be the larger of both, so that no
    gain is too large; that of the likely ones is exact.
    """
    N = len(scene.y)
    lengths = np.unique(np.round(np.exp(np.arange(
        np.log(MIN_PULSE), np.log(N / 2.0), np.log(DURATION_STEP)))).astype(int))
    knots = [np.unique(np.round(1 + np.array(KNOTS) * (N - n - 2)).astype(int))
             for n in lengths]
    exact = [(i * scene.dt, n * scene.dt) for n, at in zip(lengths, knots) for i in at]
    squares = np.concatenate([information(scene, block.columns, solved)[..., 0, 0]
                              for block in blocks(scene, family, exact)], axis=1)
    squares = np.split(squares, np.cumsum([len(at) for at in knots])[:-1], axis=1)
    steps = np.maximum(lengths // PARTS, 1)
    ends = np.cumsum([0, *(len(range(1, N - n, step)) for n, step in zip(
        lengths, steps))])
    parts = list(zip(lengths, steps, knots, squares, itertools.pairwise(ends)))

    def psi_at(k):
        part = np.searchsorted(ends, k, "right") - 1
        return np.column_stack([1 + (k - ends[part]) * steps[part],
                                lengths[part]]) * scene.dt

    def numbers(k, part, number, J):
        n, step, at, square, _ = part
        _pulse_numbers(solved.residual[k], n, step, at, square[k], number, J)

    def mean_gain(part):
        number, J, total = np.zeros((3, np.diff(part[-1])[0]))
        for k in range(len(solved.base)):
            numbers(k, part, number, J)
            total += number * number / J
        return total
    mean = np.concatenate(side_by_side(mean_gain, parts))
    likely = np.argpartition(-mean, min(LIKELY, len(mean) - 1))[:LIKELY]
    between = _between_edges(scene, solved)
    found = scores_at(scene, family, solved, [*map(tuple, psi_at(likely)), *(
        (onset * scene.dt, n * scene.dt) for onset, n in between)])
    count = len(likely)
    less = np.array([_share(solved.residual, *pulse, 1.0 / sd**2)
                     for pulse, sd in zip(between, found.sd[:, count:].T)])
    found.gain[:, count:] = np.maximum(found.gain[:, count:] + 2.0 * np.log(less), 0.0)
    total = ends[-1] + len(found.psi) - count
    likely = np.append(likely, np.arange(ends[-1], total))

    def of_node(k, gains_alone=False):
        number, J = np.ones((2, total))
        for part in parts:
            own = slice(*part[-1])
            numbers(k, part, number[own], J[own])
        if gains_alone:
            number *= number
            number /= J
            number[likely] = found.gain[k]
            return Scores(None, number[None], None, None, 1)
        psi = np.vstack([psi_at(np.arange(ends[-1])), np.reshape(
            found.psi[count:], (-1, 2))])
        gain, size, sd = number * number / J, number / J, 1.0 / np.sqrt(J)
        gain[likely], size[likely], sd[likely] = (
            of[k] for of in (found.gain, found.size, found.sd))
        return Scores(psi, gain[None], size[None], sd[None], 1)
    return of_node


def _between_edges(scene, solved):
    """(first sample, samples) of pulses between the likeliest onsets of steps of
    opposite sign.
    """
    N, step_at = len(scene.y), _onset_scores(scene, None, solved)
    gain, size = np.zeros((2, N - 1))    # sums over nodes
    for k in range(len(solved.base)):
        steps = step_at(k)
        gain += steps.gain[0]
        size += steps.size[0]
    peaks, how = find_peaks(gain, prominence=len(solved.base))
    peaks = np.sort(peaks[np.argsort(-how["prominences"])[:EDGES]])
    return [(i + 1, j - i) for i, j in itertools.combinations(peaks.tolist(), 2)
            if size[i] * size[j] < 0.0 and MIN_PULSE <= j - i <= N // 2]


def _share(residual, onset, n, J):
    """What a pulse stands for, of the cell that one of the grid of its duration stands
    for: its peak may be narrower.

    Where an edge moves by few samples, the information J (M,) is about the same.
    """
    area, reach = 1.0, max(n // (2 * PARTS), 1)
    number, J = residual[:, onset:onset + n].mean(0).sum(), J.mean()
    for edge in onset, onset + n:
        low, high = max(edge - reach, 0), min(edge + reach, residual.shape[1])
        sums = np.cumsum(residual[:, low:high].mean(0))
        moved = sums - sums[edge - low - 1]
        near = number - moved if edge == onset else number + moved
        area *= np.exp(np.minimum(0.5 * (near**2 - number**2) / J, 50.0)).sum()
    return min(area / (max(n // PARTS, 1) * n * np.log(DURATION_STEP)), 1.0)


@njit(**KERNEL)
def _pulse_numbers(residual, n, step, knots, square, number, J):
    """Sums over pulses of n samples at every so many samples from the second on, and
    their information, of which `square` is that at the knots.
    """
    total, at, k = 0.0, 0, 1
    for i in range(n):
        total += residual[i]
    for j in range(len(number)):
        onset = 1 + j * step
        while at < onset:    # the sum over the pulse moves on
            total += residual[at + n] - residual[at]
            at += 1
        while k < len(knots) - 1 and onset > knots[k]:
            k += 1
        number[j], J[j] = total, max(square[k - 1], square[k], 1e-300)


SEARCHES = dict(onset=_onset_scores, frequency=_frequency_scores, pulse=_pulse_scores)


def scores(scene, family, solved):
    """`Scores` of all signatures of a family."""
    if family.psi is not None:
        return scores_at(scene, family, solved)
    of_node = SEARCHES[family.effect.search](scene, family, solved)
    nodes = [of_node(k) for k in range(len(solved.base))]
    return nodes[0]._replace(**{part: np.concatenate([getattr(s, part) for s in nodes])
                                for part in ("gain", "size", "sd")})


def family_bayes(scene, family, solved, table):
    """ln of the mean Bayes factor over all signatures of a family, (M,)."""
    def bayes(found):
        return mean_bayes(found.gain, table[found.k])
    if family.psi is not None:
        return bayes(scores_at(scene, family, solved))
    of_node = SEARCHES[family.effect.search](scene, family, solved)
    return np.concatenate(side_by_side(lambda k: bayes(of_node(k, True)),
                                       range(len(solved.base))))


def is_coarse(scene, family):
    """May there be better signatures between those that are tried?"""
    return bool(family.effect.search != "onset" and family.effect.parameters(scene))


def refined(scene, family, solved):
    """The family again, finer where a coarse search found mass."""
    effect, found = family.effect, scores(scene, family, solved)
    mass = np.exp(0.5 * (found.gain - found.gain.max())).sum(0)
    if effect.search == "pulse":
        return _resolved(scene, family, solved, *np.round(
            found.psi[mass.argmax()] / scene.dt).astype(int))
    near = np.flatnonzero(mass > 1e-4 * mass.max())
    low, high = found.psi[max(near[0] - 1, 0)], found.psi[
        min(near[-1] + 1, len(found.psi) - 1)]
    if effect.search == "frequency":
        top = found.psi[mass.argmax()]
        low, high = max(low, top - 1.0 / scene.duration), min(
            high, top + 1.0 / scene.duration)
        return family._replace(psi=tuple(np.linspace(low, high, 81)))
    (prior,) = effect.parameters(scene)
    return family._replace(psi=tuple(prior._replace(
        low=low, high=high).quantile(np.linspace(0.0, 1.0, 40))))


RESOLVED = 9.0    # pulses that have the mass of a grid which is fine enough


def _resolved(scene, family, solved, onset, n):
    """The family about a pulse of n samples, its ends ever closer until the grid
    resolves what is known of them.
    """
    apart = (DURATION_STEP - 1.0) * n / 6.0
    while True:
        ends = np.unique(np.round(apart * np.arange(-6, 7)).astype(int))
        family = family._replace(psi=tuple(
            ((onset + i) * scene.dt, (n + j - i) * scene.dt)
            for i in ends for j in ends if onset + i > 0 and n + j - i >= MIN_PULSE
            and onset + n + j <= len(scene.y)))
        if apart <= 1.0:
            return family
        found = scores_at(scene, family, solved)
        mass = normalized(0.5 * found.gain.mean(0))
        if 1.0 / np.sum(mass**2) > RESOLVED:
            return family
        first, duration = np.round(found.psi[mass.argmax()] / scene.dt).astype(int)
        onset, n, apart = first, duration, apart / 3.0
