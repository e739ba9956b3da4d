"""Signatures: columns known up to a size, of which one backward pass serves thousands.

A family is one effect on one column of the record: the same signature at many values of
its parameter psi (an onset, a frequency, a time constant) and in all its variants.
"""

import functools
from typing import Callable, NamedTuple

import numpy as np
from numba import njit

from sensorid import INSIDE, brief, mesh
from sensorlab.gap.backward import HARMLESS, MEMORY
from sensorlab.gap.catalogue import columns_for, is_known
from sensorlab.gap.effects import BLOCK, Effect, psi_of
from sensorlab.gap.kernels.arithmetic import row_products
from sensorlab.gap.kernels.lanes import KERNEL
from sensorlab.gap.linear import cut, summed
from sensorlab.gap.shapes import LASTS

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


@njit(**INSIDE)
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
    _average(np.ascontiguousarray(gain), table, np.exp(table[:int(20.0 * per_unit)]),
             per_unit, result)
    return result - np.log(gain.shape[1])


def each_bayes(gain, table):
    """ln B of every gain of an array."""
    return mean_bayes(gain.reshape(-1, 1), table).reshape(gain.shape)


@njit(**KERNEL)
def _average(gain, table, plain, per_unit, result):
    """ln of the sum of Bayes factors of every node."""
    m = gain.shape[1]
    for node in range(len(gain)):
        best = 0.0
        for j in range(m):
            best = max(best, gain[node, j])
        top = _looked_up(best, table, per_unit)
        small, large = 0.0, 0.0
        for j in range(m):
            at = np.sqrt(max(0.0, gain[node, j])) * per_unit    # rounding, or NaN
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
    variant: list = []  # (m,) names; [] where there is one

    __repr__ = brief


class Scan(NamedTuple):
    """Gains of one effect at thousands of values of psi, at one node."""

    gain: np.ndarray       # (m,)
    k: int                 # columns
    of: Callable           # some numbers (n,) -> their psi (n,) or (n, d), and variants
    log_share: np.ndarray = 0.0    # (m,) ln of the part of its cell of the grid in
                                   # which B is near its peak: it is in the gain
    log_prior: np.ndarray = 0.0    # (m,) ln of the prior, but for what all scans of the
                                   # effect have

    __repr__ = brief

    @property
    def log_total(self):
        """ln of the sum of the priors of all."""
        share = np.exp(self.log_prior + self.log_share)    # one for all, or of each
        return np.log(len(self.gain)) + np.log(np.mean(share))


def in_cells(gain, psi, variant, k, log_share, log_prior=0.0):
    """`Scan` of signatures of so many columns, each of which stands for a part of a
    cell of a grid.
    """
    return Scan(np.maximum(gain + 2.0 * log_share, 0.0), k, lambda number: (
        psi[number], variant[number]), log_share, log_prior)


def of_scores(found, log_share, log_prior=0.0):
    """The same of `Scores` at one node."""
    return in_cells(found.gain[0], found.psi, np.array(found.variant), found.k,
                    log_share, log_prior)


def unnamed(number):
    """Names of variants (n,) where there is one."""
    return np.full(len(number), "")


class Family(NamedTuple):
    """One effect on one column of the record: the signatures to be tried."""

    effect: Effect
    column: str          # "" where none is needed
    psi: tuple = None    # values of its parameter; None where a scan knows better
    variant: str = ""    # the only one that is tried; "" are all
    low_pass: object = None    # `LowPass` that they pass, if there is one

    __repr__ = brief


PSI_COUNT = 16    # values of a psi that is neither onset nor frequency, at least
PER_E_FOLD = 5    # of one whose logarithm is even


def families(scene, effects, signatures=()):
    """What there is to be searched for in a scene."""
    known = {(s.found.name, s.found.column) for s in signatures if not s.given}
    result = []
    for effect in effects:
        if not effect.columns:
            continue
        for column in columns_for(effect, scene):
            if not effect.search and (effect.name, column) in known:
                continue
            priors = effect.parameters(scene)
            family = Family(effect, column, None if effect.search else tuple([*(
                map(_values, priors)), [np.nan]][0]))
            some = family.psi or [psi_of(scene, effect, {
                p.symbol: p.mean for p in priors})]
            if next(columns_at(scene, family, some), None):
                result.append(family)
    return result


def _values(prior):
    """Values of a parameter that are tried."""
    count = max(PSI_COUNT, round(PER_E_FOLD * np.log(prior.high / prior.low))
                if prior.log else 0)
    return prior.quantile(np.linspace(0.0, 1.0, count))


ROWS = 6    # columns at a time, at least: of fewer, each takes longer, ...
ROWS_ALONE = 10    # ... the more so in a bank of one node
MOST_TOGETHER = 20 * BLOCK    # samples of these, if they are more than two


class Block(NamedTuple):
    """Some signatures of a family."""

    psi: list
    variant: list
    columns: np.ndarray    # (m, k, N)

    __repr__ = brief


def blocks(scene, family, solved, psi=None):
    """`Block` after block of a family's signatures at psi, by default all that it has,
    in all variants. The columns of one are overwritten by those of the next: a long
    record has no room for both.
    """
    least = ROWS if solved.filter or len(solved.base) > 1 else ROWS_ALONE
    values, variants, block = [], [], None
    for value, variant, columns in columns_at(scene, family,
                                            family.psi if psi is None else psi):
        N, k = columns.shape
        if block is None:
            rows = max(BLOCK // N, min(least, MOST_TOGETHER // N), 2)
            block = np.empty((rows // k, k, N))
        block[len(values)] = columns.T
        values.append(value)
        variants.append(variant)
        if len(values) == len(block):
            yield Block(values, variants, block)
            values, variants = [], []
    if values:
        yield Block(values, variants, block[:len(values)])


def columns_at(scene, family, psi):
    """(value, variant, columns (N, k)) of the signatures of a family that are not 0."""
    x, N = scene.columns.get(family.column), len(scene.y)
    own = not is_known(family.effect)
    for value in psi:
        for variant, columns in family.effect.columns(scene, x, value):
            if family.variant not in ("", variant):
                continue
            if columns.shape not in ((N, 1), (N, 2)):
                raise ValueError(
                    f"effect {family.effect.name} builds columns of shape "
                    f"{columns.shape}: ({N}, 1) or ({N}, 2) are needed")
            if own and not (np.isrealobj(columns) and np.isfinite(columns).all()):
                raise ValueError(f"effect {family.effect.name} builds columns with "
                                 f"{_first_odd(columns)}: finite real numbers are "
                                 "needed")
            if np.any(columns):
                yield value, variant, (family.low_pass.passed(columns, scene.dt)
                                       if family.low_pass else columns)


def _first_odd(columns):
    """What is no finite real number in columns (N, k), and where, in words."""
    odd = np.argwhere(~np.isfinite(columns))
    return f"{columns[tuple(odd[0])]:g} at sample {odd[0][0]}" if len(odd) else (
        "complex numbers")


def scores_at(scene, family, solved, psi=None):
    """`Scores` of the signatures of `blocks`."""
    psi = list(family.psi if psi is None else psi)
    return joined([found for some, part in _pieces(scene, family, solved, psi)
                   for found in _scores_within(scene, family, solved, some, *part)])


def _pieces(scene, family, solved, psi):
    """Some psi after others, and the first and last sample of a part of the scene that
    tells all of their signatures: waves are over soon.
    """
    whole = 0, len(scene.y)
    if family.effect.search != "waves":
        return [(psi, whole)]

    def needed(some):
        return _needed(*span_of(scene, some), len(scene.y), solved.memory)
    if needed(psi) != whole:
        return [(psi, needed(psi))]
    result = []    # they are apart, or long
    for one in psi:
        part = needed([one])
        if result and result[-1][1] == part == whole:
            result[-1][0].append(one)
        else:
            result.append(([one], part))
    return result


def span_of(scene, psi):
    """First and last sample of what begins at onsets and is over after durations, the
    first two of psi, or after LASTS of them.
    """
    onset, duration = np.transpose(psi)[:2] / scene.dt
    return max(int(onset.min()) - 1, 0), min(
        int((onset + LASTS * duration).max()) + 2, len(scene.y))


def _scores_within(scene, family, solved, psi, first, last):
    """`Scores` of one block of signatures after another by a part of the scene that
    tells all of them.
    """
    own = {}    # psi of the scene, by that of its part
    if last - first < len(scene.y):
        later = [(onset - first * scene.dt, *rest) for onset, *rest in psi]
        own = dict(zip(later, psi))
        scene, solved, psi = (scene.cut(slice(first, last)), solved.cut(first, last),
                              later)
    for block in blocks(scene, family, solved, psi):
        m, k, N = block.columns.shape
        number = row_products(solved.residual, block.columns.reshape(-1, N)).reshape(
            -1, m, k)
        if family.effect.has_edges:
            number[:, _is_missed(scene, block.columns)] = 0.0
        yield least_squares([own[one] for one in block.psi] if own else block.psi,
                            number, information(scene, block.columns, solved))._replace(
            variant=block.variant)


SEEN = 0.1    # of the squares of what begins or ends: where a gap hides more, the rest
              # would be that of something beyond measure


def _is_missed(scene, columns):
    """Which signatures (m, k, N) gaps hide, where they do not hide all alike."""
    there = ~np.isnan(scene.y)
    if there.all():
        return np.zeros(len(columns), bool)
    squares = np.einsum("mkn,mkn->mn", columns, columns)
    return squares @ there < SEEN * there.mean() * squares.sum(1)


def joined(parts):
    """`Scores` one after another."""
    return Scores(np.concatenate([p.psi for p in parts]), *(
        np.concatenate(each, -1) for each in zip(*(p[1:4] for p in parts))),
        parts[0].k, [name for p in parts for name in p.variant])


CLOSER, WIDER = 3.0, 2.0    # how much a grid changes at a time
MOST_GRIDS = 12
FEW = 2.0       # nodes that have the mass along an axis of a grid that is too coarse
EDGE = 0.05     # of the mass of the best node along an axis: as much at its end is
                # what a grid does not hold


class Grid(NamedTuple):
    """Where a family has been resolved: its coordinates are those of `resolved`."""

    middle: np.ndarray    # (d,)
    apart: np.ndarray     # (d,)
    least: np.ndarray = None    # (d,) distances below which nodes hold too little;
                                # None of a grid that a scan gives


def resolved(scene, family, one, at, grid, least, reach):
    """The family on a grid of its parameter that holds what is known of it along each
    axis, and resolves it; that `Grid`; and the `Scores`.

    Parameters
    ----------
    one : Solved
        At one node.
    at : function of (m, d)
        psi (m, .) of coordinates, and which of them are allowed.
    grid : Grid
        Where to begin: its middle has mass, and is allowed. From that of a scan, what
        is known is first sought along each axis alone, which takes few nodes.
    least : sequence of d numbers
        The least distances of nodes along each axis.
    reach : int
        How many nodes there are to either side.
    """
    d = len(grid.middle)
    steps = mesh(*d * [np.arange(-reach, reach + 1)])
    if grid.least is None:
        alone = steps[np.sum(steps != 0, axis=1) < 2]
        _, grid, _ = _by_grids(scene, family, one, at, grid._replace(least=least),
                               alone)
        grid = grid._replace(least=least)
    return _by_grids(scene, family, one, at, grid, steps)


def _by_grids(scene, family, one, at, grid, steps):
    """`resolved` by nodes so many steps (m, d) from the middle: a whole grid, or but
    lines along its axes.
    """
    middle, apart, least = (np.array(part, float) for part in grid)
    d, reach = len(middle), steps.max()
    whole = len(steps) == (2 * reach + 1)**d
    along = [np.full(len(steps), whole) | (np.delete(steps, axis, 1) == 0).all(1)
             for axis in range(d)]
    apart, coarse = np.maximum(apart, least), np.zeros(d, bool)
    for _ in range(MOST_GRIDS):
        here = Grid(middle, apart, least)
        psi, fits = at(middle + apart * steps)
        fits[len(steps) // 2] = True    # it has mass, but for rounding in its range
        tried = [tuple(own) for own in psi[fits].tolist()]
        family = family._replace(psi=tuple(dict.fromkeys(tried)))
        found = scores_at(scene, family, one)
        best = found.variant[found.gain[0].argmax()]
        gain = {tuple(own): float(gain) for own, gain, variant in zip(
            found.psi.tolist(), found.gain[0], found.variant) if variant == best}
        mass = np.zeros(len(steps))
        mass[fits] = np.exp(0.5 * (np.array([gain.get(own, -np.inf) for own in tried])
                                   - found.gain[0].max()))
        factor, held = np.ones(d), True
        for axis in range(d):
            own = along[axis]
            share = np.bincount(steps[own, axis] + reach, mass[own])
            few = share.sum()**2 < FEW * (share**2).sum()
            out = max(share[0], share[-1]) > EDGE * share.max()
            held &= not out
            if few != out:    # else only its middle is elsewhere
                factor[axis] = WIDER if out else 1.0 / CLOSER
                if out and coarse[axis]:    # to one side of an edge, what is known
                    least[axis] = WIDER * apart[axis]    # may be neither
                coarse[axis] |= few
        changed = np.maximum(apart * factor, least)
        if held and (changed == apart).all():
            break
        middle, apart = (middle + apart * steps)[mass.argmax()], changed
    return family, here, found


FORGETS = 10    # times as many samples as a signature lasts, at least, in which filters
                # forget that have a long memory


def _about(rows, memory):
    """First and last sample of a record from which a filter of some memory tells all of
    some rows (R, N): of such as are 0 but for a short while, few.
    """
    N = rows.shape[1]
    seen = rows.any(0) if N > 3 * MEMORY else np.ones(1, bool)
    return _needed(int(seen.argmax()), N - int(seen[::-1].argmax()), N, memory)


def _needed(begin, end, N, memory):
    """First and last sample, of N, from which a filter of some memory tells all of what
    is 0 but between these two.
    """
    more = memory if memory < MEMORY else max(MEMORY, FORGETS * (end - begin))
    first, last = max(begin - more, 0), min(end + more, N)
    return (first, last) if last - first < N // 2 else (0, N)


def information(scene, columns, solved):
    """Information (M, m, k, k) of signatures (m, k, N) beside the known columns."""
    m, k, N = columns.shape
    rows = columns.reshape(-1, N)
    first, last = _about(rows, solved.memory)
    own, gap = rows[:, first:last], np.isnan(scene.y[first:last])
    own = np.where(gap, np.nan, own) if gap.any() else np.ascontiguousarray(own)
    if solved.filter:
        z = solved.filter.cut(first, last).whitened(own)
        z[:, gap] = 0.0
        z = z.reshape(m, k, -1)
        squares = np.einsum("mkn,mln->mkl", z, z)[None]    # no threads that spin
    else:
        sums = summed(*cut(solved.bank, solved.parts, first, last), own, [
            (i, i + 1) for i in range(0, m * k, 2)] if k == 2 else ())
        squares = np.empty((len(solved.base), m, k, k))
        for i in range(k):
            squares[..., i, i] = sums.chi2[i:m * k:k].T
        if k == 2:
            squares[..., 0, 1] = squares[..., 1, 0] = sums.products.T
    c, M = solved.w.shape[:2]
    cross = row_products(solved.w.reshape(-1, N), rows).reshape(c, M, m, k)
    J = squares - np.einsum("cmak,mcd,dmal->makl", cross, solved.cov, cross)
    if solved.rounding.max() > HARMLESS:
        some = solved.rounding[:, None] * np.trace(squares, axis1=2, axis2=3) / k
        J += np.maximum(some - np.linalg.eigvalsh(J)[..., 0], 0.0)[
            ..., None, None] * np.eye(k)
    return J


def least_squares(psi, number, J):
    """`Scores` from numbers s' C^-1 y (M, m, k) and informations (M, m, k, k)."""
    k, psi = number.shape[-1], np.asarray(psi)
    if k == 1:
        J, number = np.maximum(J[..., 0, 0], 1e-300), number[..., 0]
        return Scores(psi, number**2 / J, number / J, 1.0 / np.sqrt(J), 1)
    trace = np.maximum(np.trace(J, axis1=2, axis2=3), 1e-290)    # none within a gap
    J = J + 1e-9 * trace[..., None, None] * np.eye(k)
    part = np.linalg.solve(J, number[..., None])[..., 0]
    return Scores(psi, (number * part).sum(-1), np.sqrt((part**2).sum(-1)),
                  np.sqrt(k / trace), k)
