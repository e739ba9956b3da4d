"""A record that was resampled along straight lines, from times of which none need be
that of a sample, to a rate up to twice as high.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded
from scipy.optimize import minimize

from sensorlab.gap.values import CERTAIN, FEWEST, PADDED, TELLING, lattice, longest

REGULAR = 0.15       # of the power of squares, in one line: of noise it is 0.04
MOST = 9.0           # times the median of the squares of steps: more counts as that
DETERMINED = 1e-6    # of the variance of steps: digits, that lines leave
AS_ROUNDED = 1.3     # times what rounding leaves of as many samples, at most


class Knots(NamedTuple):
    """What lines go through, at integer times, and where samples lie between."""

    value: np.ndarray    # (n,)
    time: np.ndarray     # (N,) of samples, from 0 to n - 1
    left: float          # sum of squares that lines leave of the samples
    more: int            # samples than knots

    @property
    def variance(self):
        """Of what is left of a sample."""
        return self.left / self.more


def less_resampling(y):
    """A record (N,) whose lines have their knots at the nearest samples, if it was
    resampled; else as it is. The longest stretch without a gap tells.

    The squares of steps on lines of noise are the smaller, the nearer a knot is to the
    middle of a step: they repeat as samples come nearer to knots and go.
    """
    first, N = longest(~np.isnan(y))
    size = min(N, TELLING)
    pace = _pace(y[first:][:size]) if N > 4 * FEWEST else None
    if pace is None:
        return y
    begin, step = _best(y[first:][:size], *pace)
    if not _leaves_little(y[first:][:size], begin, step):
        return y
    while size < len(y) - first:    # by a pace that is known as well as for as many
        size *= LONGER
        begin, step = _best(y[first:][:size], begin, step)
    return _on_nearest(y, _through(y, begin - first * step, step))


LONGER = 4    # times


def _leaves_little(y, begin, step):
    """Do lines at a pace leave no more than rounding of a record (N,), and by far less
    than at another pace? There, too, some samples are more than knots.
    """
    knots, other = _through(y, begin, step), _through(y, begin, step + OFF / len(y))
    lsb, scale = lattice(y), np.var(np.diff(y))
    rounding = AS_ROUNDED * lsb**2 / 12.0
    is_white = lsb**2 < scale    # what rounding adds, if steps are longer than counts
    is_little = knots.variance < rounding + AS_ROUNDED * DETERMINED * scale
    is_smooth = other.variance < ELSE * (knots.variance - rounding)
    log_odds = 0.5 * knots.more * np.log(other.variance / knots.variance)
    return is_white and is_little and not is_smooth and (
        knots.more >= 4 * FEWEST and log_odds > CERTAIN)


ELSE = 10.0    # times what lines leave but for rounding, another pace leaves
OFF = 3.0      # turns within a record, by which a pace is another


def _pace(y):
    """Time of the first sample of a record (N,) and from one to the next, in those of
    what was resampled, about; None if nothing repeats.
    """
    square = np.diff(y)**2
    square = np.minimum(square, MOST * np.median(square))
    square -= square.mean()
    if not square.any():
        return None
    length = PADDED * len(square)
    wave = np.fft.rfft(square, length)
    power = np.abs(wave)**2 / np.sum(square**2)
    at = FEWEST * PADDED + int(np.argmax(power[FEWEST * PADDED:]))
    if not CERTAIN + np.log(len(square)) < power[at] < REGULAR * len(square):
        return None
    step = 1.0 - at / length
    # squares are least where the middle of a step is at a knot
    return (0.5 - np.angle(wave[at]) / (2.0 * np.pi) - 0.5 * step) % 1.0, step


def _best(y, begin, step):
    """The same, of which lines leave least: times of the first sample and the last."""
    N, y = len(y), y - np.mean(y[~np.isnan(y)])

    def left(ends):
        return np.log(_through(y, ends[0], (ends[1] - ends[0]) / (N - 1)).left)
    ends = np.array([begin, begin + (N - 1) * step])
    simplex = ends + NEAR * np.array([[-1.0, -1.0], [1.0, -1.0], [0.0, 1.5]])
    best = minimize(left, ends, method="Nelder-Mead", options=dict(
        initial_simplex=simplex, xatol=EXACTLY, fatol=np.inf)).x
    return best[0], (best[1] - best[0]) / (N - 1)


NEAR = 0.05       # of a turn, by which times are known, ...
EXACTLY = 1e-9    # ... and to which they are sought


def _through(y, begin, step):
    """`Knots` by least squares of a record (N,), NaN where it says nothing."""
    seen = ~np.isnan(y)
    begin -= np.floor(begin)
    time = begin + step * np.arange(len(y))
    number = time.astype(int)
    share, n = time - number, number[-1] + 2
    k, b, own = number[seen], share[seen], y[seen]
    a = 1.0 - b
    bands = np.zeros((2, n))
    bands[1] = np.bincount(k, a**2, n) + np.bincount(k + 1, b**2, n) + NOTHING
    bands[0, 1:] = np.bincount(k, a * b, n)[:-1]
    value = solveh_banded(bands, np.bincount(k, a * own, n) + np.bincount(
        k + 1, b * own, n))
    left = own - a * value[k] - b * value[k + 1]
    return Knots(value, time, float(np.sum(left**2)) + TINY, len(own) - n)


NOTHING = 1e-12    # of a sample, that every knot has: none is without
TINY = 1e-300      # a sum of 0 has a logarithm


def _on_nearest(y, knots):
    """A record with its knots at the nearest samples, on lines between them, and NaN at
    its ends.
    """
    step = (knots.time[-1] - knots.time[0]) / (len(y) - 1)
    number = np.arange(np.ceil(knots.time[0]), knots.time[-1]).astype(int)
    nearest = np.round((number - knots.time[0]) / step)
    return np.where(np.isnan(y), y, np.interp(
        np.arange(len(y)), nearest, knots.value[number], np.nan, np.nan))
