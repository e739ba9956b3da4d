"""Scans: scores of thousands of signatures by one backward pass, each kind in its way:
what begins at some time (`onsets`), sinusoids at every frequency.

A scan of a long record has millions of gains: it is of one node alone, and comes in
parts where there is no room for all at a time.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import next_fast_len

from sensorid import brief
from sensorlab.gap.catalogue import MIN_CYCLES, MIN_RINGING
from sensorlab.gap.effects import BLOCK, LONG_RECORD, Scene
from sensorlab.gap.kernels.arithmetic import spectrum
from sensorlab.gap.kernels.lanes import KERNEL
from sensorlab.gap.onsets import (
    PART_OF_SAMPLE, resolved_span, span_grid, span_in_cells, span_scan, step_scan,
    step_scores)
from sensorlab.gap.signatures import (
    MOST_GRIDS, Grid, Scan, blocks, each_bayes, information, least_squares, mean_bayes,
    of_scores, resolved, scores_at, unnamed)


@njit(**KERNEL)
def _line_information(turn, count, a, q, r, J):
    """Information (M, m) of sinusoids added to J: count / 2 over the spectrum of the
    model, averaged over the two levels that its white noise r (M, 1 or N) may have.

    turn (m,) = |1 - exp(-i w)|^2.
    """
    for node in range(len(J)):
        low, high = r[node].min(), r[node].max()
        share = (r[node].mean() - low) / (high - low) if high != low else 0.0
        for j in range(len(turn)):
            S = spectrum(a[node], q[node], turn[j])
            # where processes cancel, what is left is rounding, of either sign
            J[node, j] += 0.5 * count * (
                (1.0 - share) / abs(S + low) + share / abs(S + high))


PADDING = 4    # frequencies per 1 / T, at least


EXACT_CYCLES = 20    # in a record: below, its ends count, and the spectrum of a walk
                     # is no measure of the information
NEAR_HALF = 2        # cycles below half the sampling rate: there a line and its alias
                     # are nearly one, which each by itself tells


def _padded(scene):
    """Length of a record with zeros behind it, whose spectrum is scanned."""
    return next_fast_len(PADDING * len(scene.y), real=True)


def _frequency_scan(scene, family, one):
    """Of the information below EXACT_CYCLES, in a long record that of whole cycles and
    between them by interpolation; above by the spectrum, and near half the sampling
    rate by the columns themselves.
    """
    N, n = len(scene.y), _padded(scene)
    line, last = np.fft.rfft(one.residual, n), n // 2 + 1 - NEAR_HALF * n // N
    first, split = (min(-(-cycles * n // N), last) for cycles in (
        MIN_CYCLES, EXACT_CYCLES))

    def found(gain, begin):
        return Scan(gain.ravel(), 2, lambda number: (
            (begin + number) / (n * scene.dt), unnamed(number)))
    slow = np.arange(first, split) / (n * scene.dt)
    exact = slow if N <= LONG_RECORD else np.union1d(
        np.arange(MIN_CYCLES + 1, EXACT_CYCLES) / scene.duration, slow[[0, -1]])
    J = np.concatenate([information(scene, block.columns, one)
                        for block in blocks(scene, family, one, exact)], axis=1)
    number = np.stack([line[:, first:split].real, -line[:, first:split].imag], axis=-1)
    yield found(least_squares(slow, number, _interpolated(slow, exact, J)).gain, first)
    count = np.sum(~np.isnan(scene.y))
    for begin in range(split, last, BLOCK):
        end = min(begin + BLOCK, last)
        turn = 2.0 - 2.0 * np.cos(2.0 * np.pi / n * np.arange(begin, end))
        spectral = np.zeros((1, len(turn)))
        for share, own in one.spectra:
            _line_information(turn, share[0] * count, own.a, own.q, own.r, spectral)
        part = line[:, begin:end]
        yield found((part.real**2 + part.imag**2) / spectral, begin)
    fast = np.arange(last, n // 2 + 1) / (n * scene.dt)
    yield found(scores_at(scene, family, one, fast.tolist()).gain, last)


def _interpolated(x, at, value):
    """Values (M, len(x), ...) at x from those (M, len(at), ...) at some of them."""
    if len(at) == len(x):
        return value
    k = np.searchsorted(at, x).clip(1, len(at) - 1)
    share = ((x - at[k - 1]) / (at[k] - at[k - 1])).reshape(-1, 1, 1)
    return (1.0 - share) * value[:, k - 1] + share * value[:, k]


WAVE_STEP = 2.5     # ratio of one duration of waves to the next
WAVE_PARTS = 6      # of their duration, by which onsets are apart
FINER_WAVES = 5     # parts of that, and of a step of the duration, about the best
MIN_PERIODS = 2     # in a duration: with fewer it is a pulse
ROUNDED = 1e-12     # of the largest information: less may be rounding of a product
STRETCHES = 16      # of a record, that may miss more or fewer samples


def _wave_scan(scene, family, one):
    """Waves in an envelope at every onset, of every duration and frequency: spectra of
    the residual behind an onset, weighted as they rise and fall; and the same, finer,
    about the best of them.
    """
    one = one.before(family.low_pass, scene.dt)
    _, duration, _ = family.effect.parameters(scene)
    longest = int(duration.high / scene.dt)
    lengths = np.exp(np.arange(np.log(min(MIN_RINGING, longest)), np.log(longest + 1.0),
                               np.log(WAVE_STEP)))
    best, at = -1.0, (1, 1)
    for n in np.unique(np.round(lengths).astype(int)).tolist():
        every = max(n // WAVE_PARTS, 1)
        for part in _waves(scene, family, one, n, range(
                1, max(len(scene.y) - n, 2), every)):
            yield part
            top = part.gain.argmax(keepdims=True)
            if part.gain[top[0]] > best:
                ((onset, *_),), _ = part.of(top)
                best, at = part.gain[top[0]], (round(onset / scene.dt), n)
    onset, n = at
    every = max(n // WAVE_PARTS, 1)
    fine, parts = max(every // FINER_WAVES, 1), (np.arange(FINER_WAVES) + 0.5
                                                ) / FINER_WAVES - 0.5
    share = np.log(fine / every / FINER_WAVES)
    for length in np.round(n * WAVE_STEP**parts).astype(int).tolist():
        for part in _waves(scene, family, one, length, range(
                max(onset - every, 1), min(onset + every, len(scene.y) - 1), fine)):
            yield part._replace(gain=np.maximum(part.gain + 2.0 * share, 0.0),
                                log_share=share)


def _waves(scene, family, one, n, onsets):
    """`Scan` after scan of waves of n samples from some of them on. All that a wave
    holds of other frequencies counts, too: it may begin at once.
    """
    L = next_fast_len(2 * n, real=True)
    ((_, columns),) = family.effect.columns(
        Scene(np.zeros(L), scene.dt, {}), None, (0.0, n * scene.dt, 0.0))
    envelope = columns[:, 0]    # a wave that stands still
    keep = slice(-(-MIN_PERIODS * L // n), (L - 1) // 2)
    frequency = np.fft.rfftfreq(L, scene.dt)[keep]
    turn = 2.0 - 2.0 * np.cos(2.0 * np.pi * np.arange(L) / L)
    turn[0] = 0.01 * turn[1]    # at rest a walk has infinite power
    power, J = np.fft.rfft(np.abs(np.fft.fft(envelope))**2), 0.0
    for _, own in one.spectra:    # where the noise changes, at its quietest
        for level in {own.r[0].min(), own.r[0].max()}:
            inverse = np.zeros((1, L))
            _line_information(turn, 2.0, own.a, own.q, np.array([[level]]), inverse)
            if family.low_pass:
                inverse *= family.low_pass.power(turn, scene.dt)
            J = np.maximum(J, 0.5 / L * np.fft.irfft(
                power * np.fft.rfft(inverse[0]), L)[keep])
    # where samples are missing, they are most nearly whole
    J = J * max(part.mean() for part in np.array_split(~np.isnan(scene.y), STRETCHES))
    J = np.maximum(J, ROUNDED * J.max())
    behind = sliding_window_view(np.append(one.residual[0], np.zeros(L)), L)[
        onsets.start:onsets.stop:onsets.step]
    rows = max(BLOCK // L, 1)
    for first in range(0, len(behind), rows):
        line = np.fft.rfft(behind[first:first + rows] * envelope)[:, keep]

        def of(number, first=first):
            onset, at = np.divmod(number, len(frequency))
            return np.column_stack([
                scene.dt * (onsets.start + (first + onset) * onsets.step), np.full(
                    len(number), scene.dt * n), frequency[at]]), unnamed(number)
        yield Scan(((line.real**2 + line.imag**2) / J).ravel(), 2, of)


def _wave_grid(scene, family, onset, duration, frequency):
    """`Grid` of `_resolved_waves` about waves, as a scan found them."""
    prior = family.effect.parameters(scene)[1]
    duration = float(np.clip(duration, prior.low, prior.high))
    return Grid((onset, onset + duration, frequency), (
        duration / WAVE_PARTS / 3.0, duration * np.log(WAVE_STEP) / 3.0,
        0.25 / duration))


def _resolved_waves(scene, family, one, grid):
    """The family about waves in an envelope, on a grid that resolves what is known of
    their onset, end and frequency, each by itself; that `Grid`; and the `Scores`.
    """
    prior = family.effect.parameters(scene)[1]

    def waves(x):
        onset, end, frequency = x.T
        length = end - onset
        fits = (onset >= scene.dt) & (onset < scene.duration) & (
            length >= prior.low) & (length <= prior.high) & (
            frequency * length >= MIN_PERIODS) & (frequency <= 0.5 / scene.dt)
        return np.column_stack([onset, length, frequency]), fits
    least = PART_OF_SAMPLE * scene.dt
    return resolved(scene, family, one, waves, grid, (least, least, 0.0), 3)


def _waves_in_cells(scene, family, one, psi):
    """`Scan` of waves about one that a scan has found, on a grid that resolves them;
    each node has its share of a cell of the scan. And that `Grid`.
    """
    _, grid, found = _resolved_waves(scene, family, one, _wave_grid(
        scene, family, *psi))
    duration = grid.middle[1] - grid.middle[0]
    n = max(round(duration / scene.dt), 1)
    cell = max(n // WAVE_PARTS, 1) * duration * np.log(WAVE_STEP) / next_fast_len(
        2 * n, real=True)
    return of_scores(found, np.log(grid.apart.prod() / cell)), grid


def _line_in_cells(scene, family, one, frequency):
    """The same of sinusoids."""
    (prior,), apart = family.effect.parameters(scene), 1.0 / scene.duration
    _, found = _resolved_list(scene, family, one, (
        max(frequency - apart, prior.low), min(frequency + apart, prior.high)))
    cell = 1.0 / (_padded(scene) * scene.dt)
    return of_scores(found, np.log((found.psi[1] - found.psi[0]) / cell)), None


SCANS = dict(onset=step_scan, pulse=span_scan, frequency=_frequency_scan,
             waves=_wave_scan)
FINER = dict(pulse=(span_grid, resolved_span), waves=(_wave_grid, _resolved_waves))
SHARP = 100.0    # gain from which on a peak is narrower than what is tried
IN_CELLS = dict(waves=(0.0, _waves_in_cells), frequency=(SHARP, _line_in_cells),
                pulse=(SHARP, span_in_cells))
LIKELY = 16    # signatures whose gains are exact at every node; twice as many if some
               # are between those of a grid


class Likely(NamedTuple):
    """Signatures of a family that matter, as a scan tells."""

    psi: np.ndarray          # (m,) or (m, d)
    variant: np.ndarray      # (m,)
    log_share: np.ndarray    # (m,) as in `Scan`
    log_prior: np.ndarray    # (m,) as there
    k: int                   # columns
    rest: float              # ln of the mean Bayes factor over the sum of theirs
    grid: object = None      # `Grid` where they are resolved
    coarse: object = None    # `_Scanned`, if a finer grid may tell more

    __repr__ = brief


class _Scanned(NamedTuple):
    """What a scan tells of those signatures of a family that have the largest gains."""

    gain: np.ndarray         # (m,)
    log_share: np.ndarray    # (m,) as in `Scan`
    log_prior: np.ndarray    # (m,) as there
    psi: np.ndarray          # (m,) or (m, d)
    variant: np.ndarray      # (m,)
    k: int                   # columns
    beyond: np.ndarray       # (.,) ln of sums of the Bayes factors of all others
    log_total: float         # ln of the sum of the priors of all


def family_bayes(scene, family, solved, one, table, likely=None, finer=False):
    """ln of the mean Bayes factor over all signatures of a family, (M,), and the
    `Likely` ones.

    Where there are thousands, a scan at `one` of the nodes, the likeliest, tells which
    matter; or one of other nodes of the hypothesis did, which may be made `finer`. At
    all nodes these alone are computed: the sum over all is scaled by the same ratio.
    """
    if family.psi is not None:
        return _bayes_of_list(scene, family, solved, one, table), None
    scanned, grid = None, None
    if finer:
        scanned, grid = _finer(scene, family, one, table, likely.coarse)
    elif not likely:
        scanned = _scanned(scene, family, one, table)
    if scanned:
        likely, told, beyond = _likely(scanned, table)
    exact = np.empty((len(solved.base), len(likely.psi)))
    for name in np.unique(likely.variant):
        own = likely.variant == name
        exact[:, own] = scores_at(
            scene, family._replace(variant=str(name)), solved,
            likely.psi[own].tolist()).gain
    worth = _log_sum(np.maximum(exact + 2.0 * likely.log_share, 0.0), table[likely.k],
                     likely.log_prior)
    if scanned:
        there = worth[int(solved.base.argmax())]
        # a scan that says too much of these does so of the others
        less = min(there - told, 0.0)
        scanned = scanned._replace(gain=np.maximum(scanned.gain + 2.0 * less, 0.0),
                                   beyond=scanned.beyond + less)
        likely = likely._replace(rest=np.logaddexp.reduce(
            [there, *(beyond + less)]) - scanned.log_total - there, grid=grid,
            coarse=None if finer or not _may_be_finer(family, scanned, table)
            else scanned)
    return worth + likely.rest, likely


def _bayes_of_list(scene, family, solved, one, table):
    """`family_bayes` of a family that has a list: what is sharp is resolved."""
    found, likeliest = scores_at(scene, family, solved), int(solved.base.argmax())
    worth = mean_bayes(found.gain, table[found.k])
    if is_coarse(scene, family) and found.gain[likeliest].max() > SHARP:
        (prior,) = family.effect.parameters(scene)
        _, ends = _with_mass(found.psi, found.gain[likeliest])
        finer, there = _resolved_list(scene, family, one, ends)
        low, high = finer.psi[0], finer.psi[-1]
        share = np.log(np.log(high / low) / np.log(prior.high / prior.low) if prior.log
                       else (high - low) / (prior.high - prior.low))
        worth += mean_bayes(there.gain, table[found.k]) + share - worth[likeliest]
    return worth


def _scanned(scene, family, one, table):
    """`_Scanned` of a family at one node."""
    found, beyond, total = [], [], []
    for part in SCANS[family.effect.search](scene, family, one):
        top, others = _parted(part, table)
        found.append(top)
        beyond.append(others)
        total.append(part.log_total)
    return _Scanned(*map(np.concatenate, zip(*found)), part.k, np.concatenate(beyond),
                    np.logaddexp.reduce(total))


def _parted(scan, table):
    """Gains, shares, priors, psi and variants of those of a scan that matter most, and
    ln of the sum (1,) of the Bayes factors of all others.
    """
    share, prior = (np.broadcast_to(part, scan.gain.shape) for part in (
        scan.log_share, scan.log_prior))
    top = _largest(scan.gain, prior, 2 * LIKELY)
    others = np.delete(np.arange(len(scan.gain)), top)
    return (scan.gain[top], share[top], prior[top], *scan.of(top)), _log_sum(
        scan.gain[None, others], table[scan.k], prior[others])


def _may_be_finer(family, scanned, table):
    """Would a grid tell more: are there waves that are worth more than nothing, or a
    sinusoid or a pulse that is sharp?
    """
    least, _ = IN_CELLS.get(family.effect.search, (np.inf, None))
    peak = scanned.gain - 2.0 * scanned.log_share
    worth = each_bayes(peak, table[scanned.k]) + scanned.log_prior
    return peak.max() > least and worth.max() > scanned.log_total


def _finer(scene, family, one, table, scanned):
    """`_Scanned` with a grid about the best of every form in its place, of which a scan
    may tell too little to say which form is the best; and that `Grid`, if any.
    """
    peak = scanned.gain - 2.0 * scanned.log_share
    result, highest, about = scanned, -1.0, None
    for name in np.unique(scanned.variant[peak > ROUGHLY * peak.max()]):
        best = np.where(scanned.variant == name, peak, -1.0).argmax()
        part, grid = IN_CELLS[family.effect.search][1](
            scene, family._replace(variant=str(name)), one, scanned.psi[best])
        own, _ = part.of(np.arange(len(part.gain)))
        outside = (result.psi < own.min(0)) | (result.psi > own.max(0))
        away = (result.variant != name) | outside.reshape(len(outside), -1).any(1)
        top, others = _parted(part, table)
        both = zip((each[away] for each in result[:5]), top)
        result = _Scanned(*map(np.concatenate, both), scanned.k, np.append(
            result.beyond, others), scanned.log_total)
        if (height := (part.gain - 2.0 * part.log_share).max()) > highest:
            highest, about = height, grid
    return result, about


ROUGHLY = 0.9    # of the largest gain: a scan comes as near as that


def _likely(scanned, table):
    """`Likely` signatures, their rest not known yet; ln of the sum of their Bayes
    factors as the scan has them, and of sums of those of all others.
    """
    gain, share, prior, psi, variant, k, beyond, _ = scanned
    some = _largest(gain, prior, 2 * LIKELY if share.any() else LIKELY)
    others = np.delete(np.arange(len(gain)), some)
    beyond = np.append(beyond, _log_sum(gain[None, others], table[k], prior[others]))
    (told,) = _log_sum(gain[None, some], table[k], prior[some])
    return Likely(psi[some], variant[some], share[some], prior[some], k, np.nan
                  ), told, beyond


def _largest(gain, log_prior, count):
    """Numbers of the largest gains, so many, each as much less as its prior is."""
    worth = -gain - 2.0 * log_prior
    return np.sort(np.argpartition(worth, min(count, len(gain) - 1))[:count])


def _log_sum(gain, table, log_prior):
    """ln of the sum of the Bayes factors of gains (M, m), times their priors, (M,)."""
    if not gain.shape[1]:
        return np.full(len(gain), -np.inf)
    if np.ptp(log_prior) == 0.0:
        return mean_bayes(gain, table) + np.log(gain.shape[1]) + log_prior[0]
    return np.logaddexp.reduce(each_bayes(gain, table) + log_prior, axis=1)


def scores(scene, family, solved):
    """`Scores` of all signatures of a family that has a list of them, or steps."""
    if family.psi is not None:
        return scores_at(scene, family, solved)
    return step_scores(scene, solved.before(family.low_pass, scene.dt))


def is_coarse(scene, family):
    """May there be better signatures between those that are tried?"""
    return bool(family.effect.search != "onset" and family.effect.parameters(scene))


NODES = 41       # values of a parameter, about the best
RESOLVED = 8     # of them that have mass: as many as standard deviations hold all


def refined(scene, family, one, grid=None):
    """The family again, finer where a coarse search at one node found mass; and the
    `Grid` where it is so, if there is one, from which another node may begin.
    """
    effect = family.effect
    if grid:
        return FINER[effect.search][1](scene, family, one, grid)[:2]
    if effect.search:
        scan = max(SCANS[effect.search](scene, family, one),
                   key=lambda part: part.gain.max())
        gain = scan.gain
        if effect.search in FINER:
            (psi,), _ = scan.of(gain.argmax(keepdims=True))
            about, finer = FINER[effect.search]
            return finer(scene, family, one, about(scene, family, *psi))[:2]
        psi, _ = scan.of(np.arange(len(gain)))
    else:
        found = scores_at(scene, family, one)
        psi, gain = found.psi, found.gain[0]
    (prior,) = effect.parameters(scene)
    _, ends = _with_mass(psi, gain)
    if effect.search == "frequency":
        top, apart = psi[gain.argmax()], 1.0 / scene.duration
        # the scan may have parts on either side
        ends = (max(ends[0] if ends[0] > psi[0] else prior.low, top - apart),
                min(ends[1] if ends[1] < psi[-1] else prior.high, top + apart))
    return _resolved_list(scene, family, one, ends)[0], None


def _resolved_list(scene, family, one, ends):
    """The family with values of its parameter between two ends, about the best, which
    resolve what has mass; and its `Scores`.
    """
    (prior,) = family.effect.parameters(scene)
    for _ in range(MOST_GRIDS):
        family = family._replace(psi=tuple(prior._replace(
            low=ends[0], high=ends[1]).quantile(np.linspace(0.0, 1.0, NODES))))
        found = scores_at(scene, family, one)
        count, ends = _with_mass(found.psi, found.gain[0])
        if count >= RESOLVED:
            break
    return family, found


def _with_mass(psi, gain):
    """How many values of psi (m,), in any form, have mass, by gains (m,), and the ends
    of the range that holds them.
    """
    every = np.unique(psi)
    near = np.unique(psi[gain > gain.max() + 2.0 * np.log(1e-4)])
    first, last = np.searchsorted(every, near[[0, -1]])
    return len(near), (every[max(first - 1, 0)], every[min(last + 1, len(every) - 1)])
