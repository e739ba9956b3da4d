"""Scans: scores of thousands of signatures by one backward pass, each kind in its way:
what begins at some time (`onsets`), sinusoids at every frequency.

A scan of a long record has millions of scores a node: it is a function that gives those
of one node, so that they need not all be there at a time, and gains alone if asked to.
"""

import numpy as np
from numba import njit
from scipy.fft import next_fast_len

from sensorid import side_by_side
from sensorlab.gap.catalogue import MIN_CYCLES
from sensorlab.gap.effects import LONG_RECORD
from sensorlab.gap.kernels import KERNEL, spectrum
from sensorlab.gap.onsets import resolved, span_scores, step_scores
from sensorlab.gap.signatures import (
    Scores, blocks, information, joined, least_squares, mean_bayes, scores_at)


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


SEARCHES = dict(onset=step_scores, pulse=span_scores, frequency=_frequency_scores)


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
        return resolved(scene, family, solved, *np.round(
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
