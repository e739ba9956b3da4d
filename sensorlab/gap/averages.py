"""A moving average that a record has been through, once or twice: it leaves nothing at
the harmonics of one over its window but what rounding adds.
"""

import functools
from typing import NamedTuple

import numpy as np

from sensorlab.gap.unaveraged import (
    LEAST, covariance_of, rounding_of, undone, weights)
from sensorlab.gap.values import (
    CERTAIN, lattice, less_rounding, longest, passed_by_mean, power_of)

FEWEST_TAPS = 3      # of two a low-pass of first order at its fastest does the same
FEWEST_TURNS = 40    # windows in a record, by which their pattern is known
MOST_TAPS = 512
TELLING = 2**17      # samples in which an average is looked for
MOST_HELD = 1.0 / 3.0    # of the samples: what a sensor holds has such zeros, too
LEAST_LEFT = 1e-30   # of the largest power: less is rounding
PEAK = 30.0    # times the median of the power about a zero: more is a line
UNEVEN = 10.0        # ratio of variances, or powers, that should be equal


class Average(NamedTuple):
    """A moving average that a record shows."""

    taps: int = 0              # 0: none
    times: int = 1             # 2: the mean of means, a triangular window
    log_bayes: float = 0.0
    counts: float = 0.0        # spacing of what its values were rounded to, by the
                               # standard deviation of white noise in them; 0: it is
                               # undone as if they were not


def averaged_over(y):
    """The `Average` that a record (N,) shows; that of 0 samples if nothing speaks for
    it. The longest stretch without a gap tells.

    Near a harmonic k / n of the sampling rate the mean of n leaves the power of its
    response, sin^2(pi n f) / sin^2(pi f) / n^2, of what is flat there, and what
    rounding adds; else it is flat as it is. Whittle's likelihood of each, of the level
    that is likeliest, tells. The mean of means leaves the square of that.
    """
    first, N = longest(~np.isnan(y))
    N = min(N, TELLING)
    y = y[first:][:N]
    if N < FEWEST_TAPS * FEWEST_TURNS:
        return Average()
    power, lsb = _power(y), lattice(y)
    held = np.mean(np.diff(y) == 0.0) > MOST_HELD
    ways = [_shown(y, power, lsb * rounded, times) for times in (1, 2)
            for rounded, may_be in ((False, not held), (True, lsb > 0.0)) if may_be]
    # if both do: rounding is to be reckoned with
    return max(ways, key=lambda one: one.log_bayes + CERTAIN * (one.counts > 0.0),
               default=Average())


def _shown(y, power, lsb, times):
    """The `Average` of a record without a gap, that many times, whose values were
    rounded since to multiples of lsb, if it is not 0.
    """
    N = len(y)
    floors = functools.partial(_floor, y, lsb, times) if lsb else _no_floor
    gains = {n: _gain(power, N, n, times, floors) for n in range(
        FEWEST_TAPS, min(N // FEWEST_TURNS, MOST_TAPS) + 1)}
    least = CERTAIN + np.log(len(gains))
    n = max((n for n, gain in gains.items() if gain > least), default=0)
    if not n:
        return Average()
    # a mean has the zeros of those of its parts, too: it may be one of more
    if times == 1 and not lsb:
        more = range(2 * n, N // 12 + 1, n)
        fits = _is_even(undone(y, n), n) and all(
            _gain(power, N, m, times, floors) <= least for m in more)
        return Average(n, times, float(gains[n])) if fits else Average()
    told = [m for m, gain in gains.items()
            if gain > least or not m % n and gain > 0.0]
    n = _whole(power, N, told, times, floors)
    counts = _counts_of(y, lsb, times * n)
    raw = undone(y, n, times, counts)[times * n:]
    fits = _rises(n, times, counts) and _is_even(raw, n) and _is_noise(raw, n)
    return Average(n, times, float(gains[n]), counts) if fits else Average()


def as_averaged(y, taps, times, rounded):
    """The `Average` of a record (N,) that is one of so many samples, so many times,
    even if it does not show it; it is `rounded` since, or as little as was printed.
    """
    first, N = longest(~np.isnan(y))
    y = y[first:][:N]
    rounded = rounded or not _is_even(undone(y, taps, times)[times * taps:], taps)
    return Average(taps, times, 0.0, _counts_of(
        y, lattice(y) if rounded else 0.0, times * taps))


def _counts_of(y, lsb, n):
    """`Average.counts` of a record without a gap."""
    return float(lsb / _noise_of(y, lsb, n)) if lsb else 0.0


def _rises(n, times, counts):
    """Is there more between the first zeros than rounding adds? What merely falls is
    any low-pass.
    """
    beyond = passed_by_mean(1.5 / n, n)**times / np.sum(weights(n, times)**2)
    return beyond > counts**2 / 12.0


def _power(y):
    """`power_of` a record (N,), less of which than rounding leaves there is not."""
    power = power_of(y)
    return np.maximum(power, LEAST_LEFT * power.max())


def _is_even(raw, n):
    """Is a record that was undone the same kind of noise at every place in a window?

    Where values were printed with few digits, these add up to other patterns at the
    end than at the beginning; what was interpolated is new at one place alone.
    """
    turns = len(raw) // n
    new = np.diff(raw)[:(turns - 1) * n].reshape(-1, n)
    first, second = np.array_split(new, 2)
    variance = new.var(0)
    apart = np.var(first.mean(0) - second.mean(0)) * turns / 4.0
    return variance.max() < UNEVEN * variance.min() and apart < UNEVEN * variance.mean()


def _is_noise(raw, n):
    """Is a record that was undone, as far as rounding allows, about as strong at the
    harmonics of one over its window as between them, and as large at every place?

    Another low-pass, of which rounding fills the zeros, is not flat; what was held or
    interpolated is larger where it is new.
    """
    power = _power(raw)
    band = (4.0 * n * np.arange(len(power)) / len(raw)).astype(int)
    level = [np.median(power[band == k]) for k in range(2, 2 * n)]
    turns = len(raw) // n - 1
    size = np.log(np.abs(np.diff(raw)[:turns * n]).reshape(turns, n) + TINY)
    apart = 0.5 * turns * np.sum((size.mean(0) - size.mean())**2) / size.var()
    return max(level) < UNEVEN * min(level) and apart < CERTAIN + n


TINY = 1e-300    # a difference of 0 has a logarithm


def _whole(power, N, told, times, floors):
    """Of how many samples is the mean, of some that are told, that describes the power
    best from below the first harmonic of the shortest.
    """
    number = np.arange(N // (4 * min(told)), len(power))

    def fits(m):
        response = np.maximum(passed_by_mean(number / N, m)**times, LEAST_RESPONSE)
        return _likelihood(power[number], response, floors(m)(number / N))
    return max(told, key=fits)


LEAST_RESPONSE = 1e-12    # at a harmonic itself


def _gain(power, N, n, times, floors):
    """Log odds that the power (N // 2 + 1,) of a record has the zeros of a mean of n
    samples, or of means, filled by what `floors` gives for n.
    """
    half, total, first, part = N // (4 * n), 0.0, round(N / n), N // (20 * n)
    if power[first - part:first + part + 1].mean() > DIP * power[
            first - half:first + half + 1].mean():
        return -np.inf
    floor = floors(n)
    for k in range(1, n // 2 + 1):
        at = round(k * N / n)
        near = np.arange(at - half, min(at + half, len(power) - 1) + 1)
        f = (near[0] - 1 + np.arange(len(near) + 2)) / N
        response = passed_by_mean(f, n)**times
        # as a Hann window shows it
        response = (response[:-2] + 4.0 * response[1:-1] + response[2:]) / 6.0
        own = np.minimum(power[near], PEAK * np.median(power[near]))    # no line tells
        total += _likelihood(own, response, floor(near / N)) - _of_levels(own)
        if total < 0.0:    # the first tells of nearly all that are none
            break
    return total


DIP = 0.8    # of the power near the first zero, that is left in the fifth about it


def _of_levels(power):
    """Whittle's log-likelihood of a power that is flat, or flat in each half."""
    halves = np.array_split(power, 2)
    return max(-sum(len(part) * (np.log(part.mean()) + 1.0) for part in parts)
               for parts in ([power], halves))


def _likelihood(power, response, floor):
    """That of a response, times the level that is likeliest, on a floor."""
    level = np.mean(power / response)
    if np.any(floor):    # Fisher's scoring
        level = max(np.mean(power - floor), 0.0) / response.mean()
        for _ in range(SCORINGS):
            total = level * response + floor
            level = max(0.0, level + np.sum(
                response * (power - total) / total**2) / np.sum(
                    response**2 / total**2))
    total = level * response + floor
    return -np.sum(np.log(total) + power / total)


SCORINGS = 8


def _no_floor(n):
    """Of values that were not rounded."""
    return lambda f: 0.0


def _floor(y, lsb, times, n):
    """Power at frequencies f (m,) that rounding to multiples of lsb adds, if a record
    is a mean of n samples, or a mean of means, through a Hann window.
    """
    noise = _noise_of(y, lsb, times * n)
    error = noise**2 * rounding_of(covariance_of(n, times), lsb / noise) if noise else (
        np.zeros(n))
    error[1:] *= 2.0
    power = np.maximum(np.fft.rfft(error, FINE).real, LEAST * error[0])
    return lambda f: np.interp(f * FINE, np.arange(len(power)), power)


FINE = 2**13    # parts of the sampling rate, in which the power of rounding is smooth


def _noise_of(y, lsb, n):
    """Standard deviation of white noise in means of n samples at most, rounded to
    multiples of lsb, between what is rare.
    """
    some = slice(None, None, len(y) // ENOUGH or 1)
    x = y[n:][some] - y[:-n][some]
    variance = np.mean(x**2)
    for _ in range(TRIMMINGS):
        variance = np.mean(x[x**2 <= RARE**2 * variance]**2) / WITHIN
    return less_rounding(np.sqrt(0.5 * variance), lsb)


RARE = 3.0           # standard deviations
WITHIN = 0.973       # of its variance, that a normal law has within these
TRIMMINGS = 10
ENOUGH = 4000    # samples that tell a standard deviation to 0.01 of it
