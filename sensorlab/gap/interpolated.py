"""Samples that were interpolated from others: gaps that were filled, resampling to a
higher rate.
"""

import functools
from typing import NamedTuple

import numpy as np
from scipy.stats import binom

from sensorlab.gap.values import (
    CERTAIN, FEWEST, PADDED, TELLING, beside, lattice, longest, more_than_chance,
    not_foretold, runs, within)


class Between(NamedTuple):
    """Samples of a record that were interpolated from others."""

    own: np.ndarray    # (N,) those that were interpolated
    every: int = 0     # from one of the others to the next, if they are evenly apart
    first: int = 0     # of the others
    order: int = 1     # 1 on straight lines, 3 on smooth curves

    @property
    def rate(self):
        """How many of all samples were not interpolated."""
        return 1.0 / self.every if self.every else 1.0 - float(self.own.mean())

    @property
    def phase(self):
        """Of these, in turns; None where they are not evenly apart."""
        return (0.5 - self.first) * self.rate % 1.0 if self.every else None


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
ELSE = 10.0         # ... and by so many times less than from any others as far apart
NOTHING = 1e-12     # what rounding leaves
SHARPEST = 2.0      # variance of bends to that of steps: of what was interpolated, as
                    # half of the sampling rate of what was given is a quarter at most


def _evenly(y):
    """How far samples are apart that determine all between, the first of them, and the
    order of what is between, 1 or 3; 0, 0 and 1 if there are none. They may have been
    interpolated, too.
    """
    at, samples = longest(~np.isnan(y))
    every, first, order = _apart(y[at:at + samples])
    if every:
        times, later, more = _apart(y[at + first:at + samples:every])
        if times:
            every, first, order = every * times, first + every * later, max(order, more)
        first = (at + first) % every
    return every, first, order


def _apart(y):
    """The same of a record (N,) without a gap, as far as they may be apart.

    One in the middle is foretold from the nearest of them, by a line or least squares.
    Of a record that is merely smooth, all samples as far apart foretell the others.
    """
    if len(y) < FEWEST:
        return 0, 0, 1
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
            first = int(np.argmin(off))
            if second > max(ELSE * best, NOTHING) and (
                    best < DETERMINED + lattice(y)**2 / 6.0 / scale    # and rounded
                    and _stands_out(first, y, every, order)):
                return every, first, order
    return 0, 0, 1


def _off(y, every, order, usual=False):
    """Variance of what those so far apart do not foretell of what is between; or of the
    most of it, that is `usual`.
    """
    sides, middle = SIDES[order], every // 2
    near = np.lib.stride_tricks.sliding_window_view(y[::every], 2 * sides)[:ROWS]
    true = y[(sides - 1) * every + middle::every][:len(near)]
    near = near[:len(true)]
    if order == 1:
        return np.var(true - near @ np.array([every - middle, middle]) / every)
    left = not_foretold(true, near)
    if usual:
        most = left**2 <= ODD * np.median(left**2)
        left = not_foretold(true[most], near[most])
    return np.var(left)


ODD = 10.0    # times the median of squares: few of normal values are larger


def _stands_out(first, y, every, order):
    """Do samples from the first on foretell what is between better than any others,
    without what is odd, too? It spoils least squares for all but those who have none.
    """
    off = [_off(y[k:], every, order, usual=True) for k in range(every)]
    return min(off[:first] + off[first + 1:]) > ELSE * off[first]


ON_A_LINE = 1e-4    # of a step: times of 1.7e9 s, of samples 10 ms apart, are as exact
ROUNDED = 1.5       # spacings of a lattice: rounding bends a line by one at most
MOST_MET = 0.9      # of places at equal intervals
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
                         (ON_A_LINE * typical, _of_slopes_of_their_own(step)),
                         (ROUNDED * lattice(y), _rounded)):
        if not reach or np.sum(bend <= reach) < FEWEST:
            continue
        start, length = found(bend, reach)
        begin, end = start - 1, start + length
        slope = (y[end] - y[begin]) / (end - begin)
        if FEWEST <= length.sum() < len(y) - 2 * FEWEST and _is_new(slope, typical):
            return within(start, length, len(y))
    return _in_the_middle(bend <= ON_A_LINE * typical)


def _in_the_middle(straight):
    """Samples (N,) in the middle between others, of those at which a record is straight
    by chance, too: they come at equal intervals, to a sample, as where a record was
    resampled to a rate that is little higher.
    """
    nowhere, N = np.zeros(len(straight), bool), len(straight)
    count = straight.sum()
    if count < FEWEST or N < 2 * FEWEST:
        return nowhere
    wave = np.fft.rfft(straight - count / N, PADDED * N)
    power = np.abs(wave[FEWEST * PADDED:])**2
    at = int(np.argmax(power > 0.5 * power.max()))    # the others are its harmonics
    at += FEWEST * PADDED + int(np.argmax(power[at:at + PADDED]))
    every = PADDED * N / at
    first = (-np.angle(wave[at]) / (2.0 * np.pi) % 1.0) * every
    expected = np.round(np.arange(first, N - 1, every)).astype(int)
    near = expected[:, None] + np.array([0, -1, 1])
    there = straight[np.clip(near, 0, N - 1)]
    met = there.any(1)
    # how likely one of three is straight where none is expected
    chance = 1.0 - (1.0 - max(count - met.sum(), 1.0) / N)**3
    by_chance = binom.logsf(met.sum() - 1, len(met), chance)
    if met.mean() < MOST_MET or by_chance > -CERTAIN - np.log(N):
        return nowhere
    nowhere[near[met, there[met].argmax(1)]] = True
    return nowhere


def _is_new(slope, typical):
    """Is every slope a new one? Those of something slow that was added to what is held
    go on, and those of a lattice come again.
    """
    return len(slope) == 1 or (
        np.median(np.abs(np.diff(slope))) > SELDOM * np.median(np.abs(slope))
        and len(np.unique(np.round(slope / (ON_A_LINE * typical)))) > 0.5 * len(slope))


def _exactly(bend, reach):
    """Runs (first sample, length) of samples on lines, if there are far more than by
    chance, which are as many as have bends that are little wider, or have one size.
    """
    start, length = runs(bend <= reach)
    wider = np.sum((bend > reach) & (bend <= (DENSITY + 0.5) * reach))
    by_chance = max(wider / DENSITY, _of_one_size(bend, reach))
    own = np.full(len(start), by_chance < SELDOM * length.sum())
    return start[own], length[own]


def _rounded(bend, reach):
    """The same where lines were rounded: if there are far more than by chance, as noise
    is about them, else those that go on for longer.
    """
    start, length = runs(bend <= reach)
    about = np.minimum(*beside(bend, start, length, np.inf))
    by_chance = np.where(np.isfinite(about), 2.0 * AHEAD / np.pi * reach / about, 1.0)
    by_chance = np.maximum(by_chance, _of_one_size(bend, reach) / len(bend))
    own = by_chance < SELDOM
    if own.any() and np.median(by_chance[own]) * len(bend) > SELDOM * length[own].sum():
        own &= length >= more_than_chance(by_chance, len(bend))
    return start[own], length[own]


def _of_slopes_of_their_own(step):
    """`_rounded` of lines, whatever they are on, whose slope no other of the steps
    (N - 1,) has: in a record of counts many samples lie on lines by chance, but on
    steps that come again. Where there are such lines, some have equal ends.
    """
    def found(bend, reach):
        start, length = _rounded(bend, reach)
        others = np.sort(np.delete(step, np.flatnonzero(
            within(start - 1, length + 1, len(step)))))
        near, wider = (np.searchsorted(others, step[start] + width, "right")
                       - np.searchsorted(others, step[start] - width)
                       for width in (reach, DENSITY * reach))
        own = near <= SELDOM * length + 2.0 * wider / DENSITY
        if not own.any():
            return start[own], length[own]
        level, ties = runs(step == 0.0)
        flat = ties >= more_than_chance(np.mean(step == 0.0), len(bend))
        return (np.append(start[own], level[flat] + 1),
                np.append(length[own], ties[flat] - 1))
    return found


def _of_one_size(bend, reach):
    """How many bends are none by chance where they lie on a lattice: half as many as
    have the size that most have.
    """
    size = np.round(bend[bend > reach] / reach)
    return 0.5 * np.unique(size, return_counts=True)[1].max(initial=0)


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
