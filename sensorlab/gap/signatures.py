"""Signatures, something known times an unknown size: one backward pass serves all."""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from scipy.special import logsumexp

from sensorid import JIT, bank, filter_bank, probabilities
from sensorlab.gap.effects import BLOCK, CATALOGUE, CYCLES, Effect, _sinusoid, _step
from sensorlab.gap.filters import Signature, _nodes, _products, solve
from sensorlab.gap.evidence import integrate, onset_law

NODE_BLOCK = 8 * BLOCK    # the same for one record at many nodes; few leave cores idle
SIZES = 8.0 * 4.0**np.arange(9)    # v / sampling variance in the prior of a size, which
                                   # is most probable at sqrt(2 v): 4 to 1024 standard
                                   # errors, for less is not to be seen


_LOG_PRIOR = -np.log(np.arange(1, len(SIZES) + 1) * np.arange(2, len(SIZES) + 2)
                     * len(SIZES) / (len(SIZES) + 1))


_ROOT = np.arange(0.0, 1000.0, 0.02)    # square roots of gains in the table


def _log_bayes(gain, k):
    """ln B of k sizes whose squared standard scores sum to `gain`, and ln of the prior,
    per v.

    Their prior is a^2 / k v N(0, v I), which is 0 at 0: no effect and one too small to
    be seen are the same, and would otherwise share the evidence (V. Johnson and
    D. Rossell, "On the use of non-local prior densities", J. R. Stat. Soc. B 72, 2010).
    """
    shrunk = np.multiply.outer(gain, SIZES / (1.0 + SIZES))
    return (_LOG_PRIOR - (0.5 * k + 1.0) * np.log1p(SIZES) + 0.5 * shrunk
            + np.log1p(shrunk / k))


_TABLE = {k: np.logaddexp.reduce(_log_bayes(_ROOT**2, k), axis=-1) for k in (1, 2)}


@njit(**JIT)
def _looked_up(gain, table, per_unit):
    at = np.sqrt(gain) * per_unit
    low = int(min(at, len(table) - 1.0))
    if low == len(table) - 1:    # beyond the table, ln B grows as gain / 2
        return table[low] + 0.5 * (gain - (low / per_unit)**2)
    return table[low] + (at - low) * (table[low + 1] - table[low])


@njit(parallel=True, **JIT)
def _mean_bayes(gain, table, per_unit):
    """ln of the mean Bayes factor over all psi, (M,), from gains (M, m)."""
    M, m = gain.shape
    result = np.empty(M)
    plain = np.exp(table[:int(20.0 * per_unit)])    # spares an exp for each small gain
    for node in prange(M):
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
    return result - np.log(m)


class Scan(NamedTuple):
    """Signatures of one effect at many values of psi, for M nodes."""

    psi: np.ndarray     # (m,)
    gain: np.ndarray    # (M, m) squared standard score of the size
    size: np.ndarray    # (M, m) least-squares size (of a sinusoid: amplitude)
    sd: np.ndarray      # (M, m) its standard error
    k: int


def _from_columns(columns, psi, quadratic, solved):
    """Scan of explicit (m, k, N) signatures; quadratic (M, m, k, k) = s' C^-1 s."""
    m, k, N = columns.shape
    flat = columns.reshape(-1, N)
    M, c = solved.w.shape[:2]
    cross = _products(solved.w.reshape(-1, N), flat).reshape(M, c, m, k)
    J = quadratic - np.einsum("mcak,mcd,mdal->makl", cross, solved.cov, cross)
    number = _products(solved.residual, flat).reshape(-1, m, k)
    if k == 1:
        J = np.maximum(J[..., 0, 0], 1e-300)
        number = number[..., 0]
        return Scan(psi, number**2 / J, number / J, 1.0 / np.sqrt(J), 1)
    J += 1e-9 * np.trace(J, axis1=2, axis2=3)[..., None, None] * np.eye(k)
    part = np.linalg.solve(J, number[..., None])[..., 0]
    return Scan(psi, (number * part).sum(-1), np.sqrt((part**2).sum(-1)),
                np.sqrt(k / np.trace(J, axis1=2, axis2=3)), k)


def _quadratic(h, scene, columns, theta):
    """s' C^-1 s (M, m, k, k) of (m, k, N) columns, by polarization through the bank."""
    m, k, N = columns.shape
    gap = np.isnan(scene.y)
    flat = [columns[:, i] for i in range(k)]
    if k == 2:
        flat.append(columns[:, 0] + columns[:, 1])
    flat = np.where(gap, np.nan, np.concatenate(flat))
    chi2 = next(filter_bank(bank(h, scene.dt, theta), flat, [N])).chi2
    chi2 = np.moveaxis(chi2.reshape(-1, m, len(theta)), 2, 1)
    if k == 1:
        return chi2[0, :, :, None, None]
    cross = 0.5 * (chi2[2] - chi2[0] - chi2[1])
    return np.moveaxis(np.array([[chi2[0], cross], [cross, chi2[1]]]), (0, 1), (-2, -1))


PADDING = 4    # frequencies per 1 / T


def _scan_steps(solved, scene):
    size, J = _step_sizes(solved.residual, solved.w, solved.cov, solved.steps)
    return Scan(scene.time[1:], size * size * J, size, 1.0 / np.sqrt(J), 1)


@njit(parallel=True, **JIT)
def _step_sizes(residual, w, cov, steps):
    """Least-squares size of a step at samples 1 ... N - 1, and its information, of the
    parts of `Solved`: (M, N - 1) each.
    """
    M, C, N = w.shape
    size, information = np.empty((M, N - 1)), np.empty((M, N - 1))
    for node in prange(M):
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
    return size, information


@njit(parallel=True, **JIT)
def _line_gains(line, turn, count, a, q, r):
    """Gain, amplitude and its standard error (M, m) of sinusoids.

    line (M, m) complex, the transform of C^-1 y; turn (m,) = |1 - exp(-i w)|^2. The
    information of a sinusoid is count / 2 over the spectrum of the model, averaged over
    the two levels that its white noise r (M, 1 or N) may have.
    """
    M, m = line.shape
    gain, size, sd = np.empty((M, m)), np.empty((M, m)), np.empty((M, m))
    for node in prange(M):
        low, high = r[node, 0], r[node, -1]
        share = (r[node].mean() - low) / (high - low) if high != low else 0.0
        for j in range(m):
            S = 0.0
            for s in range(a.shape[1]):
                S += q[node, s] / ((1.0 - a[node, s])**2 + a[node, s] * turn[j])
            J = 0.5 * count * ((1.0 - share) / (S + low) + share / (S + high))
            square = line[node, j].real**2 + line[node, j].imag**2
            gain[node, j] = square / J
            size[node, j] = np.sqrt(square) / J
            sd[node, j] = 1.0 / np.sqrt(J)
    return gain, size, sd


def _scan_frequencies(h, solved, scene, theta):
    n, v = PADDING * len(scene.y), _nodes(h, scene.dt, theta)
    keep = slice(CYCLES * PADDING, -PADDING)
    frequency = np.fft.rfftfreq(n, scene.dt)[keep]
    line = np.fft.rfft(solved.residual, n)[:, keep]
    turn = 2.0 - 2.0 * np.cos(2.0 * np.pi * frequency * scene.dt)
    return Scan(frequency, *_line_gains(line, turn, np.sum(~np.isnan(scene.y)), v.a,
                                        v.q, v.r), 2)


class Search(NamedTuple):
    """One effect on one column: the signatures to be tried."""

    effect: Effect
    column: str            # "" where none is needed
    psi: np.ndarray        # (m,)
    variant: tuple         # (m,)
    columns: np.ndarray    # (m, k, N); None for onsets and frequencies


STEPS = 16    # values of a psi that is neither onset nor frequency


def searches(scene, effects, signatures=()):
    """What there is to be searched for in a scene."""
    found = {(s.effect.name, s.column) for s in signatures}
    result = []
    for e in effects:
        if e.kind != "signature":
            continue
        columns = {"": None}
        if e.column:
            own = {c.column for c in CATALOGUE.values()}
            columns = {name: x for name, x in scene.columns.items()
                       if (name == e.column or e.column == "*" and name not in own)
                       and np.std(x) > 0.0}
        for name in columns:
            if (e.name, name) in found and e.build not in (_step, _sinusoid):
                continue
            if e.build in (_step, _sinusoid):
                result.append(Search(e, name, None, None, None))
                continue
            psi = [np.nan]
            for p in e.parameters(scene):
                psi = np.geomspace(p.low, p.high, STEPS)
            result.append(_search(scene, e, name, psi))
    return [r for r in result if r.columns is None or len(r.columns)]


def _search(scene, effect, column, psi):
    """`Search` of explicit signatures at the given psi."""
    x = scene.columns.get(column)
    parts = [(value, *part) for value in psi for part in effect.build(scene, x, value)
             if np.any(part[1])]
    if any(p[2].shape not in ((len(scene.y), 1), (len(scene.y), 2)) for p in parts):
        raise ValueError(f"effect {effect.name} builds columns of shape "
                         f"{sorted({p[2].shape for p in parts})}: "
                         f"({len(scene.y)}, 1) or ({len(scene.y)}, 2) are needed")
    return Search(effect, column, np.array([p[0] for p in parts]),
                  tuple(p[1] for p in parts), np.array([p[2].T for p in parts]))


def scan(h, scene, signatures, search, theta, solved):
    """`Scan` of one search, or of several by the generic way."""
    if search.effect.build is _step:
        return _scan_steps(solved, scene)
    if search.effect.build is _sinusoid:
        return _scan_frequencies(h, solved, scene, theta)
    return _from_columns(search.columns, search.psi,
                         _quadratic(h, scene, search.columns, theta), solved)


def signature_evidence(h, scene, signatures, list_of_searches, guess=None,
                       table_of=None):
    """Sample of a hypothesis with no further signature, and with each of a list.

    table_of : dict of ln B against `_ROOT` for one and two sizes, by default _TABLE.
    """
    table_of = _TABLE if table_of is None else table_of
    explicit = [s for s in list_of_searches if s.columns is not None]

    def all_of(theta):
        parts = np.array_split(theta, -(-len(theta) * len(scene.y) // NODE_BLOCK))
        return np.vstack([log_likelihood_of(part) for part in parts if len(part)])

    def log_likelihood_of(theta):
        solved = solve(h, scene, signatures, theta)
        table = [solved.base]
        quadratic = iter(())
        if explicit:
            together = np.concatenate([s.columns for s in explicit])
            split = np.cumsum([len(s.columns) for s in explicit])[:-1]
            quadratic = iter(np.split(_quadratic(h, scene, together, theta), split, 1))
        for s in list_of_searches:
            result = (scan(h, scene, signatures, s, theta, solved) if s.columns is None
                      else _from_columns(s.columns, s.psi, next(quadratic), solved))
            table.append(solved.base + _mean_bayes(
                np.ascontiguousarray(result.gain), table_of[result.k], 1.0 / _ROOT[1]))
        return np.column_stack(table)
    return integrate(all_of, h.parameters, guess, onset_law(h, scene, signatures))


def estimate_signature(hypotheses, scene, signatures, search, samples, number):
    """The most probable signature of a search, and its parameters with their sd.

    Moments over hypotheses, `RESAMPLED` nodes of each, psi and prior variances of the
    size.
    """
    pieces, chosen, most = [], None, 0.0
    shrink = SIZES / (1.0 + SIZES)
    shares = probabilities([s.log_evidence[number] for s in samples])
    for h, sample, share in zip(hypotheses, samples, shares):
        if share < 1e-3:
            continue
        w = sample.log_weight + sample.log_likelihood[:, number]
        theta = sample.theta[_resampled(np.exp(w - w.max()))]
        solved = solve(h, scene, signatures, theta)
        result = scan(h, scene, signatures, search, theta, solved)
        variant = search.variant or ("",) * len(result.psi)
        fine = _refined(scene, search, result)
        if fine is not None:
            result = _from_columns(fine.columns, fine.psi,
                                   _quadratic(h, scene, fine.columns, theta), solved)
            variant = fine.variant
        near = np.flatnonzero(result.gain.max(0) > result.gain.max() - 60.0)
        each = _log_bayes(result.gain[:, near], result.k)    # (M, m, sizes)
        mass = np.exp(each - logsumexp(each, axis=(1, 2), keepdims=True))
        mass *= share / RESAMPLED
        # moments along the estimate of the normal law times its squared size
        k, square = result.k, (result.size[:, near, None] * shrink)**2
        var = result.sd[:, near, None]**2 * shrink
        mean = result.size[:, near, None] * shrink * (
            (square + (k + 2) * var) / (square + k * var))
        second = (square**2 + (k + 5) * square * var + (k + 2) * var**2) / (
            square + k * var)
        pieces.append((mass, mean, second,
                       np.broadcast_to(result.psi[near][:, None], mass.shape),
                       np.array(variant)[near]))
        if mass.sum((0, 2)).max() > most:
            most = mass.sum((0, 2)).max()
            best = near[mass.sum((0, 2)).argmax()]
            chosen = float(result.psi[best]), variant[best]

    # the sizes of different variants have different units
    pieces = [[part[:, p[4] == chosen[1]] for part in p[:4]] for p in pieces]

    def expected(values):
        return (sum((p[0] * v).sum() for p, v in zip(pieces, values))
                / sum(p[0].sum() for p in pieces))
    size = expected([p[1] for p in pieces])
    sd = np.sqrt(max(expected([p[2] for p in pieces]) - size**2, 0.0))
    parameters = {search.effect.size: (float(size), float(sd))}
    for p in search.effect.parameters(scene):
        psi = expected([p[3] for p in pieces])
        spread = np.sqrt(expected([(p[3] - psi)**2 for p in pieces]))
        parameters = {p.symbol: (float(psi), float(spread)), **parameters}
    x = scene.columns.get(search.column)
    columns = next(c for v, c in search.effect.build(scene, x, chosen[0])
                   if v == chosen[1])
    return Signature(search.effect, search.column, chosen[1], chosen[0], columns,
                     3.0 * float(np.hypot(size, sd))), parameters


RESAMPLED = 24    # nodes that stand for a posterior


def _resampled(weight):
    """Numbers of RESAMPLED nodes, at even quantiles of their weights."""
    w = np.cumsum(weight)
    return np.searchsorted(w, w[-1] * (np.arange(RESAMPLED) + 0.5) / RESAMPLED)


def _refined(scene, search, result):
    """The search again, finer where a coarse scan found mass; None for onsets."""
    if search.effect.build is _step or not search.effect.parameters(scene):
        return None
    mass = np.exp(0.5 * (result.gain - result.gain.max())).sum(0)
    near = np.flatnonzero(mass > 1e-4 * mass.max())
    low, high = result.psi[max(near[0] - 1, 0)], result.psi[
        min(near[-1] + 1, len(result.psi) - 1)]
    if search.effect.build is _sinusoid:
        top = result.psi[mass.argmax()]
        low, high = max(low, top - 1.0 / scene.duration), min(
            high, top + 1.0 / scene.duration)
        psi = np.linspace(low, high, 81)
    else:
        psi = np.geomspace(low, high, 40)
    return _search(scene, search.effect, search.column, psi)
