"""What the values of a record tell without a model of it: the lattice they lie on, the
noise where it is calm, which samples are the last one once more, or were interpolated.
"""

import functools
from typing import NamedTuple

import numpy as np

TELLING = 20000     # samples that tell of a record what is the same everywhere
FEWEST = 8          # repeated samples that show a rate
CERTAIN = 15.0      # nats by which more than by chance are equal to the last
MOSTLY_NEW = 1.5    # times as many as by chance that must be, to tell where they are
EARLIER = range(4, 10)   # samples, to values that equal one by chance


def runs(true):
    """First sample and length of all runs of what is true."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], true.astype(int), [0]])))
    return ends[::2], ends[1::2] - ends[::2]


def within(start, length, samples):
    """Which of so many samples (N,) lie in runs of that first sample and length."""
    mask = np.zeros(samples, bool)
    for begin, n in zip(start, length):
        mask[begin:begin + n] = True
    return mask


def beside(x, start, length, otherwise):
    """Means of what is known of x (N,) before runs of that first sample and length and
    behind them, as a pair, over CALM samples that are in no run; something otherwise
    where there are too few.
    """
    own = ~(np.isnan(x) | within(start, length, len(x)))
    at, total = np.append(0, np.cumsum(own))[start], np.append(0.0, np.cumsum(x[own]))
    ends = (np.maximum(at - CALM, 0), at), (at, np.minimum(at + CALM, own.sum()))
    return [np.where(last - first < FEWEST, otherwise, (
        total[last] - total[first]) / np.maximum(last - first, 1))
        for first, last in ends]


def more_than_chance(tie, samples):
    """Ties of such a probability each, one after another, that are no chance."""
    with np.errstate(divide="ignore"):
        return np.where(tie < 1.0, np.maximum(2.0, np.log(1e-4 / samples) / np.log(
            tie)), np.inf)


def repeated_at_random(y):
    """Samples (N,) of a record that are the last one once more; none, where chance
    explains those that equal it, or they come in spans or in parts of the record.

    Where values lie on a lattice, some are equal by chance, which is as likely as that
    they equal an earlier one, the likelier the nearer they are. Which of them these
    are says nothing: as many as there are by chance are left out at random.
    """
    return _repeated_in(np.asarray(y, float).tobytes())


@functools.lru_cache(maxsize=2)    # every block of simulated records asks for it
def _repeated_in(y):
    y = np.frombuffer(y)
    none, low, high = np.zeros(len(y), bool), np.nanmin(y), np.nanmax(y)
    same = np.append(False, np.diff(y) == 0.0) & (low < y) & (y < high)    # not clipped
    count = int(same.sum())
    fresh = y[~same & ~np.isnan(y)]
    if count < FEWEST or len(fresh) <= max(FEWEST, *EARLIER):
        return none
    lsb, near = lattice(fresh), np.abs(np.diff(fresh)).mean()
    earlier = [np.abs(y[lag:] - y[:-lag]) for lag in EARLIER]
    chance = np.mean([np.sum(d < 0.5 * lsb) * np.nanmean(d) / near for d in earlier]
                     ) if lsb else _equal_by_chance(fresh)
    share = count / len(y)
    spans = np.sum(same[1:] & ~same[:-1])
    parts = [part.sum() for part in np.array_split(same, 4)]
    if (count < MOSTLY_NEW * chance or noise_where_calm(fresh) < SMOOTH_OVER * lsb
            or count * np.log(count / max(chance, 1e-9)) < count - chance + CERTAIN
            or spans < 0.5 * count * (1.0 - share) or min(parts) < count / 16
            or not lsb and (lattice(y[same]) or lattice_between(fresh)
                            or len(np.unique(y[same])) < FEWEST)):    # a dead zone
        return none
    keep = np.random.default_rng(0).random(len(y)) > chance / count
    return same & keep


OFTEN = 0.25    # as often as the difference that is met most


def _equal_by_chance(y):
    """How many neighbours of a record are equal by chance, where parts of it lie on
    lattices, each on its own: half as many as differ by the least of a lattice.
    """
    d = np.abs(np.diff(y))
    d = d[d > 0.0]
    scale = 1e-9 * np.median(d) if len(d) else 1.0
    value, times = np.unique(np.round(d / scale), return_counts=True)
    if not len(d) or times[times > 1].sum() < MOSTLY * len(d):
        return 0.0
    several = times > max(1.0, OFTEN * times.max())
    least = value[several].min()
    return 0.5 * times[several & (value < 1.99 * least)].sum()


CONCENTRATED = 0.9    # of a lattice: digits may blur it by a quarter of its spacing
MOST_VALUES = 400     # of a record that are looked at


def lattice(y):
    """Spacing of the values of a record, or 0 where they lie on no lattice.

    The coarsest at which |mean of exp(2 pi i value / spacing)| over the values, each
    once, is nearly 1: printed digits may have moved them a little. Where most samples
    lie on values that others have, too, the rest does not count. Where neighbours lie
    on a far coarser one, the record was moved since.
    """
    lsb = _lattice_of(np.asarray(y, float).tobytes())
    return lsb if lsb and lattice_between(y) < MOVED * lsb else 0.0


def lattice_between(y):
    """Spacing of a lattice that neighbours of a record lie on, or 0: that of one to
    which a step, or something slow, was added.

    The coarsest at which the mean of cos(2 pi difference / spacing) is nearly 1.
    """
    seen = np.asarray(y, float)
    d = np.diff(seen[~np.isnan(seen)])
    d = d[d != 0.0]    # what is repeated lies on any lattice
    return _spacing_between(d[::-(-len(d) // MOST_NEIGHBOURS) or 1].tobytes())


@functools.lru_cache(maxsize=4)
def _spacing_between(differences):
    d = np.frombuffer(differences)
    if not len(d):
        return 0.0
    scale = np.median(np.abs(d)) / 0.6745
    # even in 1 / spacing: so is the phase of a difference
    tries = scale / np.arange(1.0 / WIDEST, 1.0 / NARROWEST, 1.0 / 16.0)
    for spacing in tries[_concentration(d[::FEW], tries).real > CONCENTRATED / 2.0]:
        if _concentration(d, [spacing])[0].real > CONCENTRATED:
            return _refined(d, spacing)
    return 0.0


FEW = 16    # values, of which one tells which spacings are worth a look at all


def _concentration(values, spacings):
    """Means of exp(2 pi i value / spacing): 1 where all values are multiples."""
    per = 2j * np.pi / np.asarray(spacings, float)
    return np.exp(per[:, None] * values).mean(1)


MOST_NEIGHBOURS = 4000    # that are looked at
WIDEST = 4.0       # of their spread: to a wider spacing, all are near zero
NARROWEST = 0.07   # 0.1 of a white noise: a finer one is how a file was printed
MOVED = 1.5    # times as coarse


@functools.lru_cache(maxsize=4)    # the same few are asked for again and again
def _lattice_of(y):
    y = np.frombuffer(y)
    values, count = np.unique(y[~np.isnan(y)], return_counts=True)
    if count[count > 1].sum() > MOSTLY * count.sum():    # some were added to, later
        values = values[count > 1]
    values = values - values[len(values) // 2]
    step, far = np.diff(values), len(values) // 100    # a wrong word may lie far out
    step = np.sort(step[step > 1e-9 * np.ptp(values[far:len(values) - far])])
    if len(step) == 0:
        return 0.0
    # steps of one scale lie together: within a lattice, or between what digits blurred
    scales = np.split(step, np.flatnonzero(step[1:] > 3.0 * step[:-1]) + 1)
    middle = max(len(values) - MOST_VALUES, 0) // 2
    near = values[middle:middle + MOST_VALUES]
    scales = [s for s in scales if len(s) >= RARE * len(step)]    # a gap is no lattice
    for scale in reversed(scales):
        for lsb in (_blurred_spacing(near, np.median(scale)), _spacing(values, scale)):
            if lsb:
                return lsb
    return 0.0


MOSTLY = 0.9            # of the samples, that lie on values met again
RARE = 0.1              # of the steps
MAX_MULTIPLES = 2000    # of the spacing, in a lattice that digits blurred
EXACT = 0.05            # of the spacing: what a value on a lattice may be off it


def _spacing(values, scale):
    """Spacing of a lattice whose smallest step is that of a scale, or 0."""
    lsb = _refined(values, scale.min())
    off = np.abs(values / lsb - np.round(values / lsb))
    return lsb if np.mean(off < EXACT) > 0.95 else 0.0


def _blurred_spacing(values, step):
    """Spacing of a lattice with steps of about this size, or 0."""
    reach = np.abs(values).max() / step
    if reach > MAX_MULTIPLES:
        return 0.0
    tries = step * np.linspace(0.7, 1.4, int(8.0 * reach) + 16)
    tries = tries[np.abs(_concentration(values[::FEW], tries)) > CONCENTRATED / 2.0]
    phase = np.abs(_concentration(values, tries))
    if phase.max(initial=0.0) < CONCENTRATED:
        return 0.0
    lsb = _refined(values, tries[phase.argmax()])
    # digits move a code, they do not spread it: few heaps far apart are no lattice
    code = np.round(values / lsb)
    first, last = (np.searchsorted(code, np.unique(code), side) for side in (
        "left", "right"))
    return lsb if np.max(values[last - 1] - values[first]) < 2.0 * EXACT * lsb else 0.0


def _refined(values, lsb):
    """The spacing of a lattice about zero from about what it is."""
    for reach in (4.0, 16.0, 64.0, np.inf):    # refine with ever larger multiples
        own = values[np.abs(values) <= reach * lsb]
        number = np.round(own / lsb)
        if number.any():
            lsb = float(own @ number / (number @ number))
    return float(lsb)


SMOOTH_OVER = 2.0    # spacings: noise of as many makes the law of values smooth over
                     # them
CALM, CALMEST = 64, 0.05    # samples of a part, and the share of parts that are calm


def noise_where_calm(y):
    """Standard deviation of the white noise in the calmest parts of a record."""
    return spread_where_calm(np.diff(y)) / np.sqrt(2.0)


def spread_where_calm(x):
    """Standard deviation of what is normal, without mean, in its calmest parts."""
    size = np.abs(x)[:len(x) // CALM * CALM]
    if not len(size):
        return 0.0
    return np.sqrt(0.5 * np.pi) * np.quantile(size.reshape(-1, CALM).mean(1), CALMEST)


def snapped(y):
    """A record with its values on their lattice, if they have one."""
    lsb, seen = lattice(y), y[~np.isnan(y)]
    return seen[0] + lsb * np.round((y - seen[0]) / lsb) if lsb else y


# ---- what lies between

class Between(NamedTuple):
    """Samples of a record that others were interpolated from."""

    own: np.ndarray    # (N,) those that were interpolated
    every: int = 0     # from one of the others to the next, if they are evenly apart
    first: int = 0     # of the others
    order: int = 1     # 1 on straight lines, 3 on smooth curves


def interpolated(y):
    """What is `Between` others of a record (N,), none by chance; lines and curves may
    have been rounded to a lattice.
    """
    return _between(np.asarray(y, float).tobytes())


@functools.lru_cache(maxsize=2)    # every block of simulated records asks for it
def _between(y):
    y = np.frombuffer(y)
    every, first, order = _evenly(y)
    if every:
        return Between(np.arange(len(y)) % every != first, every, first, order)
    return Between(_on_lines(y))


MOST_APART = {1: 20, 3: 10}    # samples from one that was given to the next, by order
SIDES = {1: 1, 3: 12}    # of these, to either side, that what is between hangs on
ROWS = 400          # of samples that are foretold, at most; and ...
FEWEST_ROWS = 4     # ... times as many as those that foretell one
DETERMINED = 1e-3   # of the variance of steps: what is foretold is off by less, ...
ELSE = 100.0        # ... and by so many times less than from any others as far apart
NOTHING = 1e-12     # what rounding leaves
SHARPEST = 2.0      # variance of bends to that of steps: of what was interpolated, as
                    # half of the sampling rate of what was given is a quarter at most


def _evenly(y):
    """How far samples are apart that determine all between, the first of them, and the
    order of what is between, 1 or 3; 0, 0 and 1 if there are none.

    One in the middle is foretold from the nearest of them, by a line or least squares.
    Of a record that is merely smooth, all samples as far apart foretell the others.
    """
    start, length = runs(~np.isnan(y))
    at = start[length.argmax()]
    y = y[at:at + length.max()]
    scale = np.var(np.diff(y[:TELLING]))
    if np.var(np.diff(y[:TELLING], 2)) > SHARPEST * scale:
        return 0, 0, 1
    for order, most in MOST_APART.items():
        fewest = 2 * SIDES[order] * (FEWEST_ROWS + 1) + 2
        for every in range(min(most, len(y) // fewest) * bool(scale), 1, -1):
            turn = np.median(np.abs(np.diff(y[:TELLING:every], 2)))
            if turn**2 < DETERMINED * scale:    # most are held, or move steadily
                continue
            off = [_off(y[first:], every, order) / scale for first in range(every)]
            best, second = np.sort(off)[:2]
            if best < DETERMINED and second > max(ELSE * best, NOTHING):
                return every, (at + int(np.argmin(off))) % every, order
    return 0, 0, 1


def _off(y, every, order):
    """Variance of what those so far apart do not foretell of what is between."""
    sides, middle = SIDES[order], every // 2
    near = np.lib.stride_tricks.sliding_window_view(y[::every], 2 * sides)[:ROWS]
    true = y[(sides - 1) * every + middle::every][:len(near)]
    near = near[:len(true)]
    if order == 1:
        off = true - near @ np.array([every - middle, middle]) / every
    else:
        near = np.column_stack([np.ones(len(true)), near])
        off = true - near @ np.linalg.lstsq(near, true)[0]
    return np.var(off)


ON_A_LINE = 1e-4    # of a step: times of 1.7e9 s, of samples 10 ms apart, are as exact
ROUNDED = 1.5       # spacings of a lattice: rounding bends a line by one at most
DENSITY = 10        # times as wide, about: bends of a size that is as likely by chance
SELDOM = 0.1        # of what lies on lines may do so by chance
MOSTLY_MEET = 0.75    # of the lines, between samples, if any do
AHEAD = np.sqrt(20.0)    # standard deviations of a bend of noise that is not smooth, to
                         # that of what is new in it


def _on_lines(y):
    """Samples (N,) on straight lines between others, wherever they are."""
    step, bend = np.diff(y), np.full(len(y), np.nan)
    moves = np.abs(step[~np.isnan(step) & (step != 0.0)])
    typical = moves.mean() if len(moves) else 0.0
    bend[1:-1] = np.where(step[1:] * step[:-1] != 0.0, np.abs(np.diff(step)), np.nan)
    for reach, found in ((ON_A_LINE * typical, _exactly),
                         (ROUNDED * (lattice(y) or lattice_between(y)), _rounded)):
        if not reach or np.sum(bend <= reach) < FEWEST:
            continue
        start, length = found(bend, reach)
        begin, end = start - 1, start + length
        slope = (y[end] - y[begin]) / (end - begin)
        if FEWEST <= length.sum() < len(y) - 2 * FEWEST and _is_new(slope, typical):
            return within(start, length, len(y))
    return np.zeros(len(y), bool)


def _is_new(slope, typical):
    """Is every slope a new one? Those of something slow that was added to what is held
    go on, and those of a lattice come again.
    """
    return len(slope) == 1 or (
        np.median(np.abs(np.diff(slope))) > SELDOM * np.median(np.abs(slope))
        and len(np.unique(np.round(slope / (ON_A_LINE * typical)))) > 0.5 * len(slope))


def _exactly(bend, reach):
    """Runs (first sample, length) of samples on lines, if there are far more than by
    chance, which are as many as have bends that are little wider; on a lattice, half as
    many as have one size.
    """
    start, length = runs(bend <= reach)
    wider = np.round(bend[bend > reach] / reach)
    by_chance = max(np.sum(wider <= DENSITY) / DENSITY,
                    0.5 * np.unique(wider, return_counts=True)[1].max(initial=0))
    own = np.full(len(start), by_chance < SELDOM * length.sum())
    return start[own], length[own]


def _rounded(bend, reach):
    """The same where lines were rounded: if there are far more than by chance, as noise
    is about them, else those that go on for longer.
    """
    start, length = runs(bend <= reach)
    about = np.minimum(*beside(bend, start, length, np.inf))
    by_chance = np.where(np.isfinite(about), 2.0 * AHEAD / np.pi * reach / about, 1.0)
    own = by_chance < SELDOM
    if own.any() and np.median(by_chance[own]) * len(bend) > SELDOM * length[own].sum():
        own &= length >= more_than_chance(by_chance, len(bend))
    return start[own], length[own]


def on_samples(y):
    """A record (N,) whose lines meet between samples, where these are moved to the
    nearest sample; else as it is.
    """
    lines = interpolated(y)
    if lines.every or not lines.own.any():
        return y
    start, length = runs(lines.own)
    begin, end = start - 1, start + length
    pair = end[:-1][begin[1:] == end[:-1] + 3] + 1    # on one, too, if it meets both
    begin, end = np.sort([*begin, *pair]), np.sort([*end, *pair + 1])
    slope = (y[end] - y[begin]) / (end - begin)
    at = np.flatnonzero(begin[1:] == end[:-1] + 1)    # lines with nothing between them
    before, rise = end[at], y[begin[at + 1]] - y[end[at]]
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = (rise - slope[at + 1]) / (slope[at] - slope[at + 1])
    meet = (beyond >= 0.0) & (beyond <= 1.0)
    if meet.sum() < max(FEWEST, MOSTLY_MEET * len(meet)):
        return y
    at, before, beyond = at[meet], before[meet], beyond[meet]
    given, moved, seen = ~lines.own, y.copy(), np.flatnonzero(~np.isnan(y))
    given[before] = given[before + 1] = False
    nearest = np.where(beyond < 0.5, before, before + 1)
    given[nearest], moved[nearest] = True, y[before] + beyond * slope[at]
    given = np.flatnonzero(given & ~np.isnan(y))
    moved[seen] = np.interp(seen, given, moved[given])
    return moved
