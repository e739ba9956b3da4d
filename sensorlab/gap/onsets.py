"""Signatures that begin at some time: steps at every onset, pulses and slow steps of
every duration.
"""

import itertools
from typing import Callable, NamedTuple

import numpy as np
from numba import njit
from scipy.interpolate import PchipInterpolator
from scipy.signal import find_peaks

from sensorlab.gap.catalogue import MIN_PULSE, MIN_SHAPED
from sensorlab.gap.kernels.lanes import KERNEL, in_rows
from sensorlab.gap.shapes import DECAYS, MIN_SLOW
from sensorlab.gap.signatures import (
    Grid, Scan, Scores, blocks, in_cells, information, of_scores, resolved, scores_at,
    unnamed)


def step_scores(scene, solved):
    """`Scores` of steps at every onset; nothing is for one that has fewer samples on a
    side than a pulse: these are outliers.
    """
    size, J = np.empty((2, len(solved.base), len(scene.y) - 1))
    parts = in_rows(*solved[1:5])
    for node in range(len(solved.base)):
        _step_sizes(node, *parts, solved.rounding[node], size[node], J[node])
    gain, few = size * size * J, MIN_PULSE - 1
    gain[:, :few] = gain[:, -few:] = 0.0
    return Scores(scene.time[1:], gain, size, 1.0 / np.sqrt(J), 1)


def step_scan(scene, family, one):
    passed = one.before(family.low_pass, scene.dt)
    yield Scan(step_scores(scene, passed).gain[0], 1, lambda number: (
        scene.time[1 + number], unnamed(number)))


@njit(**KERNEL)
def _step_sizes(node, residual, w, cov, steps, rounding, size, information):
    """Least-squares size of a step at samples 1 ... N - 1, and its information, each
    (N - 1,), at one node of the parts of `Solved`.
    """
    C, M, N = w.shape
    number, cross = 0.0, np.zeros(C)
    least = 1e-9 * np.abs(steps[node]).max()    # after the last one seen there is none
    for i in range(N - 1, 0, -1):
        number += residual[node, i]
        J = steps[node, i]
        for c in range(C):
            cross[c] += w[c, node, i]
        for c in range(C):
            for d in range(C):
                J -= cross[c] * cov[node, c, d] * cross[d]
        J = max(J, max(1e-6, rounding) * abs(steps[node, i]) + least)
        size[i - 1], information[i - 1] = number / J, J


# ---- pulses and slow steps

RECTANGULAR = "rectangular"


class _Shape(NamedTuple):
    """A shape of n samples: the real part of w rho^j, j the samples since its onset, or
    the sum of that over the samples before.
    """

    law: Callable            # n -> w, rho
    least: int               # samples
    ends: bool = False       # after n samples; or w rho^j dies away
    mounts: bool = False     # it is the sum
    falls: bool = False      # it is 1 less the sum


def _arc(n):
    rho = np.exp(1j * np.pi / n)
    return -1j * (rho - 1.0), rho


def _decay(n):
    return -np.expm1(-DECAYS / n), np.exp(-DECAYS / n)


SHAPES = {    # by variant: those of `pulse`, and that of `gradual_step`
    RECTANGULAR: _Shape(lambda n: (1.0, 1.0), MIN_PULSE, ends=True),
    "half sine": _Shape(_arc, MIN_SHAPED, ends=True, mounts=True),
    "decaying": _Shape(_decay, MIN_SHAPED, mounts=True, falls=True),
    "": _Shape(_decay, MIN_SLOW, mounts=True)}

DURATION_STEP = 1.6    # ratio of one duration to the next
PARTS = 4              # of its duration, by which onsets are apart
FINE = 16              # parts of a duration, at least: a longer shape is held against
                       # sums of samples
KNOTS = np.array([0.0, 0.05, 0.5, 0.95])    # of all onsets, where information is exact
APART = 3              # durations, from one whose information is exact to the next
LIKELY_ONSETS = 16     # of what begins at once, of every duration
SHARPEST = 2           # durations of it, that are looked at still finer, ...
FINER_ONSETS = 8       # ... by that part of what is summed, or by single samples
EDGES = 12             # onsets of steps that may be edges of a pulse
MOST_PEAKS = 4096      # among which they are sought


def _fineness(n):
    """How many samples are summed before a shape of n samples is held against them: of
    a curve, its slope is what is a little coarse.
    """
    return 2**max(int(np.log2(n / FINE)), 0)


def _known(scene, family, one):
    """Durations of the one shape of a family, in samples, with onsets at the knots and
    their information (KNOTS,). Between durations at which that is exact, its logarithm
    is a monotone cubic in that of the duration.
    """
    N, seen = len(scene.y), np.flatnonzero(~np.isnan(scene.y[1:])) + 1
    least = min(SHAPES[family.variant].least, N // 4)
    lengths = np.exp(np.arange(np.log(least), np.log(N / 2.0), np.log(DURATION_STEP)))
    lengths = np.unique([round(n / _fineness(n)) * _fineness(n) for n in lengths])
    # of the onsets that are seen: in a gap there is no information
    count = np.searchsorted(seen, N - lengths)[:, None]
    knots = seen[np.round(np.maximum(count - 1, 0) * KNOTS).astype(int)]
    knots = np.minimum(knots, N - lengths[:, None] - 1)
    some = np.unique([*range(0, len(lengths), APART), len(lengths) - 1])
    J = np.concatenate([information(scene, block.columns, one)[0, :, 0, 0]
                        for block in blocks(scene, family, one, [
                            (i * scene.dt, n * scene.dt)
                            for n, at in zip(lengths[some], knots[some])
                            for i in at])])
    log_J = np.log(np.maximum(J, 1e-6 * J.max())).reshape(len(some), len(KNOTS))
    if len(some) > 1:
        log_J = PchipInterpolator(np.log(lengths[some]), log_J)(np.log(lengths))
    return zip(lengths.tolist(), knots, np.exp(log_J))


def span_scan(scene, family, one):
    """Pulses, or slow steps, of any duration, which begin a fourth of it apart at most,
    and rectangular pulses between two likely edges, which are known to a few samples:
    those of steps, and those near the best pulse of each duration; `Scan` after scan,
    one of each duration. What begins at once is scanned finer where it is likely.
    """
    variants = [variant for variant, _ in family.effect.columns(
        scene, None, (scene.dt, scene.duration))]
    if not set(variants) <= set(SHAPES):
        raise ValueError(f"effect {family.effect.name}, which is searched as a pulse, "
                         f"has the forms {variants}: they must be among {list(SHAPES)}")
    passed = one.before(family.low_pass, scene.dt)
    residual = passed.residual[0, 1:]
    left = residual[::-1].cumsum()[::-1]
    # a sum of the past is held against the sum of what is left
    sums = {(False, 1): residual, (True, 1): np.append(left[1:], 0.0)}
    best, at_once = [], []
    for variant in variants:
        shape = SHAPES[variant]
        for n, knots, J in _known(scene, family._replace(variant=variant), one):
            by = _fineness(n)
            for half in (2**k for k in range(int(np.log2(by)))):
                if (shape.mounts, 2 * half) not in sums:
                    rows = sums[shape.mounts, half]
                    sums[shape.mounts, 2 * half] = rows[:-1:2] + rows[1::2]
            rows = sums[shape.mounts, by]
            scan = _span(scene.dt, variant, n, knots, J, rows, left)
            yield scan
            if shape.falls:
                fine = _span(scene.dt, variant, n, knots, J, rows, left, n)
                likely = np.sort(np.argsort(-fine.gain)[:LIKELY_ONSETS])
                share = np.log(len(scan.gain) / len(fine.gain))
                yield in_cells(fine.gain[likely], *fine.of(likely), 1, share,
                               scan.log_prior)
                at_once.append((fine.gain.max(), variant, n, fine.of(
                    fine.gain.argmax(keepdims=True))[0][0, 0]))
            if variant == RECTANGULAR:
                ((onset, _),), _ = scan.of(scan.gain.argmax(keepdims=True))
                best.append((round(onset / scene.dt), n, J.max()))
    for _, variant, n, onset in sorted(at_once, key=lambda own: -own[0])[:SHARPEST]:
        yield _about_onset(scene, family._replace(variant=variant), one, onset, n)
    if RECTANGULAR in variants:
        yield from _between_edges(scene, family._replace(variant=RECTANGULAR), one,
                                  passed, best)


def _about_onset(scene, family, one, onset, n):
    """`Scan`, finer, about a shape of n samples that begins at once."""
    by = _fineness(n)
    step = max(by // FINER_ONSETS, 1)
    onsets = round(onset / scene.dt) + np.arange(-by, by + 1, step)
    lengths = np.unique(np.round(n * DURATION_STEP**(np.arange(-1, 2) / 3.0)).clip(
        min(SHAPES[family.variant].least, n), max(len(scene.y) // 2, n)).astype(int))
    psi = scene.dt * np.array([(i, k) for i in onsets.tolist() for k in lengths.tolist()
                               if 0 < i and i + k <= len(scene.y)])
    gain = scores_at(scene, family, one, list(map(tuple, psi.tolist()))).gain[0]
    return in_cells(gain, psi, np.full(len(psi), family.variant), 1, np.log(
        step / max(n // PARTS, 1) / len(lengths)), _log_prior(n))


def _span(dt, variant, n, knots, J, rows, left, parts=PARTS):
    """`Scan` of a shape of n samples against sums `rows` of as many samples as its
    fineness, and the sums (N,) of all that is `left`; it begins so many `parts` of
    itself apart.

    Between two knots, and beyond the last, the information is taken to be the larger of
    two, so that no gain is too large.
    """
    shape, by = SHAPES[variant], _fineness(n)
    every = max(n // by // parts, 1)
    gain = np.empty((len(left) // by - n // by) // every + 1)
    w, rho = map(complex, shape.law(n))
    mean = 1.0 if rho == 1.0 else (1.0 - rho**by) / (1.0 - rho) / by
    _sums_over(rows, n // by, every, w * mean, rho**by, rho**n * shape.ends, gain)
    if shape.falls:
        np.subtract(left[:1 + (len(gain) - 1) * every * by:every * by], gain, gain)
    gain *= gain
    gain /= np.repeat(np.maximum(J[1:], J[:-1]), np.diff(
        [0, *(knots[1:-1] - 1) // (every * by), len(gain)]))

    def of(number):
        return dt * np.column_stack([1 + number * every * by, np.full(
            len(number), n)]), np.full(len(number), variant)
    return Scan(gain, 1, of, log_prior=np.log(every * by))


def _log_prior(n):
    """ln of the prior of a shape of n samples in a cell of a scan: as even in the onset
    and in the logarithm of the duration, it is as large as onsets are apart.
    """
    return np.log(np.maximum(n // PARTS, 1))


@njit(**KERNEL)
def _sums_over(x, n, every, w, rho, last, result):
    """Sums of the real part of w rho^j times x[onset + j] at onsets `every` apart: over
    n samples, of which `last` is rho^n, or to the end of x, if that is 0.
    """
    stop = (len(result) - 1) * every + n if last else len(x)
    total, at = 0.0 * rho, stop
    for k in range(len(result) - 1, -1, -1):
        while at > k * every:
            at -= 1
            total = x[at] + rho * total
            if at + n < stop:
                total -= last * x[at + n]
        result[k] = (w * total).real


def _between_edges(scene, family, one, passed, best):
    """`Scan`, if there are any, of pulses between the likeliest onsets of steps of
    opposite sign, and between the likeliest edges near the `best` of a grid, each of
    which is an onset, samples and their information.
    """
    steps, residual = step_scores(scene, passed), passed.residual[0]
    size, peaks = steps.size[0], _most_prominent(steps.gain[0])
    log_n, log_J = np.log([own[1:] for own in best]).T
    powers = np.gradient(log_J, log_n) if len(best) > 1 else np.ones(1)
    total = np.append(0.0, np.cumsum(residual))
    edges = {(i + 1, j + 1) for i, j in itertools.combinations(peaks.tolist(), 2)
             if size[i] * size[j] < 0.0} | {
        _edges_near(total, onset, n, power)
        for (onset, n, _), power in zip(best, powers)}
    spans = np.array([(i, j - i) for i, j in sorted(edges)
                      if MIN_PULSE <= j - i <= len(scene.y) // 2])
    if len(spans):
        found = scores_at(scene, family, one, (scene.dt * spans).tolist())
        share = np.array([
            _log_share(residual, *pulse, sd**-2, np.interp(
                np.log(pulse[1]), log_n, powers))
            for pulse, sd in zip(spans.tolist(), found.sd[0])])
        yield in_cells(found.gain[0], scene.dt * spans, np.full(
            len(spans), RECTANGULAR), 1, share, _log_prior(spans[:, 1]))


def _most_prominent(gain):
    """Numbers of the EDGES peaks of gains (N,) that stand out most, by a nat at least.
    Of a long record they are sought among the best of every part: on a slope, each peak
    is held against all that lies below it.
    """
    size = -(-len(gain) // MOST_PEAKS)
    parts = np.append(gain, np.full(-len(gain) % size, -np.inf)).reshape(-1, size)
    best = np.arange(0, len(gain), size) + parts.argmax(1)
    line = np.empty(2 * len(best) + 1)
    line[1::2], line[::2] = gain[best], np.minimum.reduceat(gain, np.append(0, best))
    peaks, how = find_peaks(line, prominence=1.0)
    return np.sort(best[(peaks[np.argsort(-how["prominences"])[:EDGES]] - 1) // 2])


def _edges_near(total, onset, n, power):
    """Edges of the likeliest pulse near one of n samples, whose information grows with
    its samples to some power; `total` (N + 1,) are sums of a residual before a sample.
    """
    reach, i, j = n // 3, onset, onset + n
    first = np.arange(max(i - reach, 1), i + reach + 1)
    last = np.arange(j - reach, min(j + reach + 1, len(total)))
    for _ in range(2):
        i = int(first[np.argmax((total[j] - total[first])**2 / (j - first)**power)])
        j = int(last[np.argmax((total[last] - total[i])**2 / (last - i)**power)])
    return i, j


def _log_share(residual, onset, n, J, power):
    """ln of the part of a cell of the grid of its duration in which the Bayes factor of
    a pulse is near its peak; its information J grows with its samples to some power.
    """
    area, reach = 1.0, max(n // (2 * PARTS), 1)
    number = residual[onset:onset + n].sum()
    for edge, longer in (onset, -1), (onset + n, 1):
        low, high = max(edge - reach, 0), min(edge + reach, len(residual))
        sums = np.cumsum(residual[low:high])
        near = number + longer * (sums - sums[edge - low - 1])
        more = longer * (np.arange(low, high) + 1 - edge) / n
        area *= np.exp(np.minimum(0.5 * (
            near**2 * (1.0 + more)**-power - number**2) / J, 50.0)).sum()
    cell = max(n // PARTS, 1) * n * np.log(DURATION_STEP)
    return min(np.log(area / cell), 0.0)


def span_grid(scene, family, onset, duration):
    """`Grid` of `resolved_span` about a pulse, as a scan found it."""
    onset, n = round(onset / scene.dt), round(duration / scene.dt)
    apart = (DURATION_STEP - 1.0) * n / 6.0
    return Grid((onset, onset + n), (apart, apart))


def resolved_span(scene, family, one, grid):
    """The family about a pulse, on a grid that resolves what is known of its onset and
    of its end, each by itself: of a decay, an onset may be known a hundred times as
    well. That `Grid`, and the `Scores`. A large one that rises slowly is known better
    than to a sample.
    """
    prior, N = family.effect.parameters(scene)[1], len(scene.y)
    n = round(grid.middle[1] - grid.middle[0])
    low, high = min(round(prior.low / scene.dt), n), max(prior.high / scene.dt, n)

    def between(begin, end):
        length = end - begin
        fits = (begin > 0) & (low <= length) & (length <= high) & (end <= N)
        return scene.dt * np.column_stack([begin, length]), fits
    result = resolved(scene, family, one, lambda ends: between(*np.round(
        ends).astype(int).T), grid, (1.0, 1.0), 6)
    _, there, found = result
    rectangular = found.variant[found.gain[0].argmax()] == RECTANGULAR
    if rectangular or (there.apart > 1.0).all():
        return result
    return resolved(scene, family, one, lambda ends: between(*ends.T), there._replace(
        least=np.minimum(there.least, PART_OF_SAMPLE)), None, 6)


PART_OF_SAMPLE = 0.01    # to which an onset may be known


def span_in_cells(scene, family, one, psi):
    """`Scan` of pulses of one form about one that a scan has found, on a grid that
    resolves them; each node has its share of a cell of the scan. And that `Grid`.
    """
    _, grid, found = resolved_span(scene, family, one, span_grid(scene, family, *psi))
    n = found.psi[:, 1] / scene.dt    # a node of onset and end is so much of ln n
    cell = np.maximum(n // PARTS, 1) * n * np.log(DURATION_STEP)
    return of_scores(found, np.log(grid.apart.prod() / cell), _log_prior(n)), grid
