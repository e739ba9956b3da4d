"""Signatures: columns known up to a size, of which one backward pass serves thousands.

A family is one effect on one column of the record: the same signature at many values of
its parameter psi (an onset, a frequency, a time constant) and in all its variants.
"""

import functools
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.special import logsumexp

from sensorid import JIT, brief, probabilities
from sensorlab.gap.catalogue import CATALOGUE, MIN_CYCLES, MIN_PULSE
from sensorlab.gap.effects import (
    BLOCK, LONG_RECORD, Effect, Found, columns_of, psi_of)
from sensorlab.gap.evidence import enough_points, integrate, onset_law
from sensorlab.gap.filters import Signature, polarized, processes, solve
from sensorlab.gap.kernels import KERNEL, in_threads, row_products, spectrum

NODE_BLOCK = 4 * BLOCK    # samples of one record at many nodes that are worked on at a
                          # time; few leave cores idle

# ---- Bayes factor of a size

SIZES = 8.0 * 4.0**np.arange(9)    # v / sampling variance in the prior of a size, which
                                   # is most probable at sqrt(2 v): 4 to 1024 standard
                                   # errors, for less is not to be seen
# the k-th has the probability 1 / k (k + 1): it falls like the universal prior of
# integers (J. Rissanen, Ann. Stat. 11, 1983) and spends little on what needs no help
LOG_PRIOR = -np.log(np.arange(1, len(SIZES) + 1) * np.arange(2, len(SIZES) + 2)
                    * len(SIZES) / (len(SIZES) + 1))
GAIN_ROOT = np.arange(0.0, 1000.0, 0.02)    # square roots of gains in the table


def log_bayes(gain, k):
    """ln B of k sizes whose squared standard scores sum to `gain`, and ln of the prior,
    per v.

    Their prior is a^2 / k v N(0, v I), which is 0 at 0: no effect and one too small to
    be seen are the same, and would otherwise share the evidence (V. Johnson and
    D. Rossell, "On the use of non-local prior densities", J. R. Stat. Soc. B 72, 2010).
    """
    shrunk = np.multiply.outer(gain, SIZES / (1.0 + SIZES))
    return (LOG_PRIOR - (0.5 * k + 1.0) * np.log1p(SIZES) + 0.5 * shrunk
            + np.log1p(shrunk / k))


@functools.cache
def bayes_table():
    """ln B over all sizes at `GAIN_ROOT`, for one and for two columns."""
    return {k: np.logaddexp.reduce(log_bayes(GAIN_ROOT**2, k), axis=-1) for k in (1, 2)}


@njit(**JIT)
def _looked_up(gain, table, per_unit):
    at = np.sqrt(gain) * per_unit
    low = int(min(at, len(table) - 1.0))
    if low == len(table) - 1:    # beyond the table, ln B grows as gain / 2
        return table[low] + 0.5 * (gain - (low / per_unit)**2)
    return table[low] + (at - low) * (table[low + 1] - table[low])


def mean_bayes(gain, table):
    """ln of the mean Bayes factor over all psi, (M,), from gains (M, m)."""
    result = np.empty(len(gain))
    per_unit = 1.0 / GAIN_ROOT[1]
    # of small gains B itself, which spares an exp for each
    in_threads(_average, len(gain), np.ascontiguousarray(gain), table,
               np.exp(table[:int(20.0 * per_unit)]), per_unit, result)
    return result - np.log(gain.shape[1])


@njit(**KERNEL)
def _average(first, last, gain, table, plain, per_unit, result):
    """ln of the sum of Bayes factors of nodes first ... last - 1."""
    m = gain.shape[1]
    for node in range(first, last):
        best = 0.0
        for j in range(m):
            best = max(best, gain[node, j])
        top = _looked_up(best, table, per_unit)
        small, large = 0.0, 0.0
        for j in range(m):
            at = np.sqrt(gain[node, j]) * per_unit
            if at < len(plain) - 1:
                low = int(at)
                small += plain[low] + (at - low) * (plain[low + 1] - plain[low])
            elif gain[node, j] > best - 100.0:
                large += np.exp(_looked_up(gain[node, j], table, per_unit) - top)
        result[node] = np.log(small * np.exp(-top) + large) + top


# ---- scores of all signatures of a family

class Scores(NamedTuple):
    """Signatures of one effect at many values of psi, for M nodes."""

    psi: np.ndarray     # (m,) or (m, d)
    gain: np.ndarray    # (M, m) squared standard score of the size
    size: np.ndarray    # (M, m) least-squares size (of a sinusoid: amplitude)
    sd: np.ndarray      # (M, m) its standard error
    k: int              # columns

    __repr__ = brief


class Family(NamedTuple):
    """One effect on one column of the record: the signatures to be tried."""

    effect: Effect
    column: str            # "" where none is needed
    psi: np.ndarray = None        # (m,) or, where there are several, (m, d)
    variant: tuple = ()           # (m,)
    columns: np.ndarray = None    # (m, k, N); None for onsets and frequencies

    __repr__ = brief


PSI_COUNT = 16    # values of a psi that is neither onset nor frequency


def families(scene, effects, signatures=()):
    """What there is to be searched for in a scene."""
    known = {(s.found.name, s.found.column) for s in signatures}
    named = {c.column for c in CATALOGUE.values()}
    result = []
    for effect in effects:
        if not effect.columns:
            continue
        beside = [""] if not effect.column else [
            name for name, x in scene.columns.items() if np.std(x) > 0.0
            and (name == effect.column or effect.column == "any"
                 or effect.column == "*" and name not in named)]
        for column in beside:
            if effect.search:
                result.append(Family(effect, column))
            elif (effect.name, column) not in known:
                psi = [p.quantile(np.linspace(0.0, 1.0, PSI_COUNT))
                       for p in effect.parameters(scene)]
                result.append(explicit(scene, effect, column, [*psi, [np.nan]][0]))
    return [f for f in result if f.columns is None or len(f.columns)]


def explicit(scene, effect, column, psi):
    """`Family` of the signatures at the given psi, in all variants."""
    x = scene.columns.get(column)
    parts = [(value, *part) for value in psi for part in effect.columns(scene, x, value)
             if np.any(part[1])]
    if any(p[2].shape not in ((len(scene.y), 1), (len(scene.y), 2)) for p in parts):
        raise ValueError(f"effect {effect.name} builds columns of shape "
                         f"{sorted({p[2].shape for p in parts})}: "
                         f"({len(scene.y)}, 1) or ({len(scene.y)}, 2) are needed")
    return Family(effect, column, np.array([p[0] for p in parts]),
                  tuple(p[1] for p in parts), np.array([p[2].T for p in parts]))


def scores(h, scene, family, theta, solved):
    """`Scores` of all signatures of a family."""
    if family.columns is None:
        return SEARCHES[family.effect.search](h, scene, family, theta, solved)
    return explicit_scores(family, quadratic(h, scene, family.columns, theta), solved)


def explicit_scores(family, squares, solved):
    """`Scores` of explicit signatures; squares (M, m, k, k) = s' C^-1 s."""
    m, k, N = family.columns.shape
    number = row_products(solved.residual, family.columns.reshape(-1, N))
    return _least_squares(family.psi, number.reshape(-1, m, k),
                          _information(family, squares, solved))


def _information(family, squares, solved):
    """Information (M, m, k, k) of explicit signatures beside the known columns."""
    m, k, N = family.columns.shape
    M, c = solved.w.shape[:2]
    cross = row_products(solved.w.reshape(-1, N), family.columns.reshape(-1, N)
                         ).reshape(M, c, m, k)
    return squares - np.einsum("mcak,mcd,mdal->makl", cross, solved.cov, cross)


def _least_squares(psi, number, J):
    """`Scores` from numbers s' C^-1 y (M, m, k) and informations (M, m, k, k)."""
    k = number.shape[-1]
    if k == 1:
        J, number = np.maximum(J[..., 0, 0], 1e-300), number[..., 0]
        return Scores(psi, number**2 / J, number / J, 1.0 / np.sqrt(J), 1)
    J = J + 1e-9 * np.trace(J, axis1=2, axis2=3)[..., None, None] * np.eye(k)
    part = np.linalg.solve(J, number[..., None])[..., 0]
    return Scores(psi, (number * part).sum(-1), np.sqrt((part**2).sum(-1)),
                  np.sqrt(k / np.trace(J, axis1=2, axis2=3)), k)


def quadratic(h, scene, columns, theta):
    """s' C^-1 s (M, m, k, k) of (m, k, N) columns."""
    m, k, N = columns.shape
    pairs = [(i, i + 1) for i in range(0, m * k, 2)] if k == 2 else []
    sums, cross = polarized(h, scene, columns.reshape(m * k, N), pairs, theta)
    result = np.empty((len(theta), m, k, k))
    for i in range(k):
        result[..., i, i] = sums.chi2[i:m * k:k].T
    if k == 2:
        result[..., 0, 1] = result[..., 1, 0] = cross.T
    return result


def _onset_scores(h, scene, family, theta, solved):
    size, J = np.empty((2, len(theta), len(scene.y) - 1))
    in_threads(_step_sizes, len(theta), *solved[1:5], size, J)
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


def _frequency_scores(h, scene, family, theta, solved):
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
    J = []
    for psi in np.array_split(exact, -(-len(exact) * len(scene.y) // BLOCK)):
        part = explicit(scene, family.effect, family.column, psi)
        J.append(_information(part, quadratic(h, scene, part.columns, theta), solved))
    J = _interpolated(frequency[slow], exact, np.concatenate(J, axis=1))
    fast = slice(split - first, None)
    low = _least_squares(frequency[slow], number, J)
    high = _spectral_scores(h, scene, theta, solved, frequency[fast], line[:, fast])
    return Scores(*(np.concatenate(part, -1) for part in zip(low[:4], high[:4])), 2)


def _interpolated(x, at, value):
    """Values (M, len(x), ...) at x from those (M, len(at), ...) at some of them."""
    if len(at) == len(x):
        return value
    k = np.searchsorted(at, x).clip(1, len(at) - 1)
    share = ((x - at[k - 1]) / (at[k] - at[k - 1])).reshape(-1, 1, 1)
    return (1.0 - share) * value[:, k - 1] + share * value[:, k]


def _spectral_scores(h, scene, theta, solved, frequency, line):
    own = processes(h, scene, theta)
    square = line.real**2 + line.imag**2
    turn = 2.0 - 2.0 * np.cos(2.0 * np.pi * frequency * scene.dt)
    J = np.empty_like(square)
    in_threads(_line_information, len(theta), turn, np.sum(~np.isnan(scene.y)),
               *map(np.ascontiguousarray, (own.a, own.q, own.r)), J)
    return Scores(frequency, square / J, np.sqrt(square) / J, 1.0 / np.sqrt(J), 2)


DURATION_STEP = 1.6    # ratio of one duration of a pulse to the next
KNOTS = 0.0, 0.05, 0.5, 0.95, 1.0    # of all onsets, where the information of a pulse
                                     # is exact
PARTS = 4              # of its duration, by which onsets are apart
LIKELY = 32            # pulses whose information is exact wherever they are


def _pulse_scores(h, scene, family, theta, solved):
    """Pulses of any duration, which begin a fourth of it apart at most.

    Between two knots their information is taken to be the larger of both, so that no
    gain is too large; that of the likely ones is exact.
    """
    N = len(scene.y)
    lengths = np.unique(np.round(np.exp(np.arange(
        np.log(MIN_PULSE), np.log(N / 2.0), np.log(DURATION_STEP)))).astype(int))
    knots = [np.unique(np.round(1 + np.array(KNOTS) * (N - n - 2)).astype(int))
             for n in lengths]
    exact = explicit(scene, family.effect, family.column, [
        (i * scene.dt, n * scene.dt) for n, at in zip(lengths, knots) for i in at])
    squares = np.split(quadratic(h, scene, exact.columns, theta)[..., 0, 0],
                       np.cumsum([len(at) for at in knots])[:-1], axis=1)
    onsets = [np.arange(1, N - n, max(n // PARTS, 1)) for n in lengths]
    ends = np.cumsum([0, *map(len, onsets)])
    psi = np.column_stack([np.concatenate(onsets), np.repeat(lengths, np.diff(ends))]
                          ) * scene.dt
    gain, size, sd = np.empty((3, len(theta), len(psi)))
    for n, at, square, first, begin in zip(lengths, knots, squares, onsets, ends):
        in_threads(_pulse_sizes, len(theta), solved.residual, n, at, square, first,
                   begin, gain, size, sd)
    likely = np.argsort(-gain.mean(0), kind="stable")[:LIKELY]
    part = explicit(scene, family.effect, family.column, map(tuple, psi[likely]))
    found = explicit_scores(part, quadratic(h, scene, part.columns, theta), solved)
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


# ---- evidence of the families, and the signature that is found

def family_evidence(h, scene, signatures, listed, guess=None, table=None):
    """`Sample` of a hypothesis with no further signature, and with one of each family.

    `table` is that of ln B, by default `bayes_table`.
    """
    table = table or bayes_table()
    explicit_ones = [f for f in listed if f.columns is not None]

    def log_likelihood(theta):
        parts = np.array_split(theta, -(-len(theta) * len(scene.y) // NODE_BLOCK))
        return np.vstack([of_part(part) for part in parts if len(part)])

    def of_part(theta):
        solved = solve(h, scene, signatures, theta)
        result = [solved.base]
        squares = iter(())
        if explicit_ones:    # through the bank together
            together = np.concatenate([f.columns for f in explicit_ones])
            split = np.cumsum([len(f.columns) for f in explicit_ones])[:-1]
            squares = iter(np.split(quadratic(h, scene, together, theta), split, 1))
        for f in listed:
            found = (scores(h, scene, f, theta, solved) if f.columns is None
                     else explicit_scores(f, next(squares), solved))
            result.append(solved.base + mean_bayes(found.gain, table[found.k]))
        return np.column_stack(result)
    return integrate(log_likelihood, h.parameters, guess,
                     onset_law(h, scene, signatures), enough=enough_points(scene))


POSTERIOR_NODES = 24    # nodes that stand for a posterior


class _Sizes(NamedTuple):
    """Posterior of the size of signatures near the best: nodes, psi, prior variances.
    """

    mass: np.ndarray      # (M, m, v)
    mean: np.ndarray      # (M, m, v)
    second: np.ndarray    # (M, m, v) moment
    psi: np.ndarray       # (m, d)
    variant: np.ndarray   # (m,)


def estimate_signature(hypotheses, scene, signatures, family, samples, number):
    """The most probable signature of a family, as a `Signature` and as a `Found` whose
    values are (mean, sd).

    `number` is that of the family in the evidence of the samples. Moments are over
    hypotheses, `POSTERIOR_NODES` nodes of each, psi and prior variances of the size.
    """
    shares = probabilities([s.log_evidence[number] for s in samples])
    pieces = [_sizes(h, scene, signatures, family,
                     sample.nodes(POSTERIOR_NODES, number), share)
              for h, sample, share in zip(hypotheses, samples, shares) if share > 1e-3]
    best = max(pieces, key=lambda p: p.mass.sum((0, 2)).max())
    at = best.mass.sum((0, 2)).argmax()
    psi, variant = best.psi[at].tolist(), str(best.variant[at])
    # the sizes of different variants have different units
    pieces = [(p.mass[:, own], p.mean[:, own], p.second[:, own], p.psi[own])
              for p in pieces for own in [p.variant == variant]]
    total = sum(p[0].sum() for p in pieces)

    def expected(part):
        return float(sum((p[0] * part(p)).sum() for p in pieces) / total)
    effect = family.effect
    values = {}
    for k, p in enumerate(effect.parameters(scene)):
        mean = expected(lambda p: p[3][:, k, None])
        values[p.symbol] = mean, float(np.sqrt(expected(
            lambda p: (p[3][:, k, None] - mean)**2)))
    size = expected(lambda p: p[1])
    sd = float(np.sqrt(max(expected(lambda p: p[2]) - size**2, 0.0)))
    values[effect.size] = size, sd
    found = Found(effect, family.column, variant, values, float(total))
    numbers = {**dict(zip(values, psi)), effect.size: size}
    return Signature(found._replace(values=numbers),
                     columns_of(scene, effect, family.column, variant,
                                psi_of(scene, effect, numbers)),
                     3.0 * float(np.hypot(size, sd))), found


def _sizes(h, scene, signatures, family, theta, share):
    """`_Sizes` of a hypothesis of a given share at some nodes."""
    solved = solve(h, scene, signatures, theta)
    found = scores(h, scene, family, theta, solved)
    fine = _refined(scene, family, found)
    if fine is not None:
        family, found = fine, scores(h, scene, fine, theta, solved)
    near = np.flatnonzero(found.gain.max(0) > found.gain.max() - 60.0)
    each = log_bayes(found.gain[:, near], found.k)
    mass = np.exp(each - logsumexp(each, axis=(1, 2), keepdims=True))
    # moments along the estimate of the normal law times its squared size
    shrink = SIZES / (1.0 + SIZES)
    k, square = found.k, (found.size[:, near, None] * shrink)**2
    variance = found.sd[:, near, None]**2 * shrink
    mean = found.size[:, near, None] * shrink * (
        (square + (k + 2) * variance) / (square + k * variance))
    second = (square**2 + (k + 5) * square * variance + (k + 2) * variance**2) / (
        square + k * variance)
    variant = np.array(family.variant or [""] * len(found.psi))
    return _Sizes(mass * share / len(theta), mean, second,
                  found.psi[near].reshape(len(near), -1), variant[near])


def _refined(scene, family, found):
    """The family again, finer where a coarse search found mass; None where it was fine
    already.
    """
    effect = family.effect
    if effect.search == "onset" or not effect.parameters(scene):
        return None
    mass = np.exp(0.5 * (found.gain - found.gain.max())).sum(0)
    if effect.search == "pulse":
        onset, length = np.round(found.psi[mass.argmax()] / scene.dt).astype(int)
        near = length * (DURATION_STEP - 1.0) * np.linspace(-1.0, 1.0, 13)
        ends = np.unique(np.round(near).astype(int))
        return explicit(scene, effect, family.column, [
            ((onset + i) * scene.dt, (length + j - i) * scene.dt)
            for i in ends for j in ends if onset + i > 0 and length + j - i >= MIN_PULSE
            and onset + length + j <= len(scene.y)])
    near = np.flatnonzero(mass > 1e-4 * mass.max())
    low, high = found.psi[max(near[0] - 1, 0)], found.psi[
        min(near[-1] + 1, len(found.psi) - 1)]
    if effect.search == "frequency":
        top = found.psi[mass.argmax()]
        low, high = max(low, top - 1.0 / scene.duration), min(
            high, top + 1.0 / scene.duration)
        return explicit(scene, effect, family.column, np.linspace(low, high, 81))
    (prior,) = effect.parameters(scene)
    return explicit(scene, effect, family.column, prior._replace(
        low=low, high=high).quantile(np.linspace(0.0, 1.0, 40)))
