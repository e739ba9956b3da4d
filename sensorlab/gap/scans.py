"""Scans: scores of thousands of signatures by one backward pass, each kind in its way:
steps at every onset, sinusoids at every frequency, pulses of every duration.
"""

import numpy as np
from numba import njit

from sensorlab.gap.catalogue import MIN_CYCLES, MIN_PULSE
from sensorlab.gap.effects import LONG_RECORD
from sensorlab.gap.kernels import KERNEL, in_threads, spectrum
from sensorlab.gap.signatures import (
    Scores, blocks, information, joined, least_squares, scores_at)


def _onset_scores(scene, family, solved):
    M = len(solved.base)
    size, J = np.empty((2, M, len(scene.y) - 1))
    in_threads(_step_sizes, M, *solved[1:5], size, J)
    return Scores(scene.time[1:], size * size * J, size, 1.0 / np.sqrt(J), 1)


@njit(**KERNEL)
def _step_sizes(first, last, residual, w, cov, steps, size, information):
    """Least-squares size of a step at samples 1 ... N - 1, and its information, of the
    parts of `Solved`: (M, N - 1) each.
    """
    M, C, N = w.shape
    for node in range(first, last):
        number, cross = 0.0, np.zeros(C)
        least = 1e-9 * steps[node].max()    # after the last sample seen there is none
        for i in range(N - 1, 0, -1):
            number += residual[node, i]
            J = steps[node, i]
            for c in range(C):
                cross[c] += w[node, c, i]
            for c in range(C):
                for d in range(C):
                    J -= cross[c] * cov[node, c, d] * cross[d]
            J = max(J, 1e-6 * steps[node, i] + least)
            size[node, i - 1], information[node, i - 1] = number / J, J


@njit(**KERNEL)
def _line_information(first, last, turn, count, a, q, r, J):
    """Information (M, m) of sinusoids: count / 2 over the spectrum of the model,
    averaged over the two levels that its white noise r (M, 1 or N) may have.

    turn (m,) = |1 - exp(-i w)|^2.
    """
    for node in range(first, last):
        low, high = r[node, 0], r[node, -1]
        share = (r[node].mean() - low) / (high - low) if high != low else 0.0
        for j in range(len(turn)):
            S = spectrum(a[node], q[node], turn[j])
            J[node, j] = 0.5 * count * ((1.0 - share) / (S + low) + share / (S + high))


PADDING = 4    # frequencies per 1 / T


EXACT_CYCLES = 20    # in a record: below, its ends count, and the spectrum of a walk
                     # is no measure of the information


def _frequency_scores(scene, family, solved):
    """Of the information below EXACT_CYCLES, in a long record that of whole cycles and
    between them by interpolation; above by the spectrum.
    """
    n, first, split = (PADDING * len(scene.y), MIN_CYCLES * PADDING,
                       EXACT_CYCLES * PADDING)
    frequency = np.fft.rfftfreq(n, scene.dt)[first:-PADDING]
    line = np.fft.rfft(solved.residual, n)[:, first:-PADDING]
    slow = slice(split - first)
    number = np.stack([line[:, slow].real, -line[:, slow].imag], axis=-1)
    exact = frequency[slow][::1 if len(scene.y) <= LONG_RECORD else PADDING]
    exact = np.union1d(exact, frequency[slow][-1:])
    J = [information(scene, block.columns, solved)
         for block in blocks(scene, family, exact)]
    J = _interpolated(frequency[slow], exact, np.concatenate(J, axis=1))
    fast = slice(split - first, None)
    return joined([least_squares(frequency[slow], number, J),
                   _spectral_scores(scene, solved, frequency[fast], line[:, fast])])


def _interpolated(x, at, value):
    """Values (M, len(x), ...) at x from those (M, len(at), ...) at some of them."""
    if len(at) == len(x):
        return value
    k = np.searchsorted(at, x).clip(1, len(at) - 1)
    share = ((x - at[k - 1]) / (at[k] - at[k - 1])).reshape(-1, 1, 1)
    return (1.0 - share) * value[:, k - 1] + share * value[:, k]


def _spectral_scores(scene, solved, frequency, line):
    own = solved.own
    square = line.real**2 + line.imag**2
    turn = 2.0 - 2.0 * np.cos(2.0 * np.pi * frequency * scene.dt)
    J = np.empty_like(square)
    in_threads(_line_information, len(square), turn, np.sum(~np.isnan(scene.y)),
               *map(np.ascontiguousarray, (own.a, own.q, own.r)), J)
    return Scores(frequency, square / J, np.sqrt(square) / J, 1.0 / np.sqrt(J), 2)


DURATION_STEP = 1.6    # ratio of one duration of a pulse to the next
KNOTS = 0.0, 0.05, 0.5, 0.95, 1.0    # of all onsets, where the information of a pulse
                                     # is exact
PARTS = 4              # of its duration, by which onsets are apart
LIKELY = 32            # pulses whose information is exact wherever they are


def _pulse_scores(scene, family, solved):
    """Pulses of any duration, which begin a fourth of it apart at most.

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
    onsets = [np.arange(1, N - n, max(n // PARTS, 1)) for n in lengths]
    ends = np.cumsum([0, *map(len, onsets)])
    psi = np.column_stack([np.concatenate(onsets), np.repeat(lengths, np.diff(ends))]
                          ) * scene.dt
    gain, size, sd = np.empty((3, len(solved.base), len(psi)))
    for n, at, square, first, begin in zip(lengths, knots, squares, onsets, ends):
        in_threads(_pulse_sizes, len(gain), solved.residual, n, at, square, first,
                   begin, gain, size, sd)
    likely = np.argsort(-gain.mean(0), kind="stable")[:LIKELY]
    found = scores_at(scene, family, solved, map(tuple, psi[likely]))
    gain[:, likely], size[:, likely], sd[:, likely] = found.gain, found.size, found.sd
    return Scores(psi, gain, size, sd, 1)


@njit(**KERNEL)
def _pulse_sizes(first, last, residual, n, knots, square, onsets, begin, gain, size,
                 sd):
    """Gain, size and its standard error of pulses of n samples at some onsets, written
    from number `begin` on; `square` (M, knots) is their information at the knots.
    """
    for node in range(first, last):
        total, at, k = 0.0, 0, 1
        for i in range(n):
            total += residual[node, i]
        for j in range(len(onsets)):
            onset = onsets[j]
            while at < onset:    # the sum over the pulse moves on
                total += residual[node, at + n] - residual[node, at]
                at += 1
            while k < len(knots) - 1 and onset > knots[k]:
                k += 1
            J = max(square[node, k - 1], square[node, k], 1e-300)
            gain[node, begin + j] = total * total / J
            size[node, begin + j] = total / J
            sd[node, begin + j] = 1.0 / np.sqrt(J)


SEARCHES = dict(onset=_onset_scores, frequency=_frequency_scores, pulse=_pulse_scores)


def scores(scene, family, solved):
    """`Scores` of all signatures of a family."""
    if family.psi is None:
        return SEARCHES[family.effect.search](scene, family, solved)
    return scores_at(scene, family, solved)


def is_coarse(scene, family):
    """May there be better signatures between those that are tried?"""
    return bool(family.effect.search != "onset" and family.effect.parameters(scene))


def refined(scene, family, found):
    """The family again, finer where a coarse search found mass."""
    effect = family.effect
    mass = np.exp(0.5 * (found.gain - found.gain.max())).sum(0)
    if effect.search == "pulse":
        onset, length = np.round(found.psi[mass.argmax()] / scene.dt).astype(int)
        near = length * (DURATION_STEP - 1.0) * np.linspace(-1.0, 1.0, 13)
        ends = np.unique(np.round(near).astype(int))
        return family._replace(psi=tuple(
            ((onset + i) * scene.dt, (length + j - i) * scene.dt)
            for i in ends for j in ends if onset + i > 0 and length + j - i >= MIN_PULSE
            and onset + length + j <= len(scene.y)))
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
