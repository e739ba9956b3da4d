"""A moving average that a record has been through: it leaves nothing at the harmonics
of one over its window, and is undone but for a pattern that repeats with it.
"""

import numpy as np
from scipy.signal import get_window

from sensorlab.gap.values import CERTAIN, longest, runs

FEWEST_TAPS = 3      # of two a low-pass of first order at its fastest does the same
FEWEST_TURNS = 40    # windows in a record, by which their pattern is known
MOST_TAPS = 512
TELLING = 2**17      # samples in which an average is looked for
MOST_HELD = 1.0 / 3.0    # of the samples: what a sensor holds has such zeros, too
LEAST_LEFT = 1e-30   # of the largest power: less is rounding
PEAK = 30.0    # times the median of the power about a zero: more is a line
UNEVEN = 10.0        # ratio of variances that should be equal


def averaged_over(y):
    """How many samples each of a record (N,) is the mean of, and the log odds to none;
    0 and 0.0 if nothing speaks for it. The longest stretch without a gap tells.

    Near a harmonic k / n of the sampling rate the mean of n leaves the power of its
    response, sin^2(pi n f) / sin^2(pi f) / n^2, of what is flat there; else it is flat
    as it is. Whittle's likelihood of each, of the level that is likeliest, tells.
    """
    first, N = longest(~np.isnan(y))
    N = min(N, TELLING)
    y = y[first:][:N]
    if N < FEWEST_TAPS * FEWEST_TURNS or np.mean(np.diff(y) == 0.0) > MOST_HELD:
        return 0, 0.0
    power = np.abs(np.fft.rfft((y - y.mean()) * get_window("hann", N)))**2
    power = np.maximum(power, LEAST_LEFT * power.max())
    most = min(N // FEWEST_TURNS, MOST_TAPS)
    gains = {n: _gain(power, N, n) for n in range(FEWEST_TAPS, most + 1)}
    least = CERTAIN + np.log(len(gains))
    n = max((n for n, gain in gains.items() if gain > least), default=0)
    # a mean has the zeros of those of its parts, too: it may be one of more than most
    if not n or not _is_even(undone(y, n), n) or any(
            _gain(power, N, m) > least for m in range(2 * n, N // 12 + 1, n)):
        return 0, 0.0
    return n, float(gains[n])


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


def _gain(power, N, n):
    """Log odds that the power (N // 2 + 1,) of a record has the zeros of a mean of n
    samples.
    """
    half, total = N // (4 * n), 0.0
    for k in range(1, n // 2 + 1):
        at = round(k * N / n)
        near = np.arange(at - half, min(at + half, len(power) - 1) + 1)
        response = _response(near[0] - 1 + np.arange(len(near) + 2), N, n)
        # as a Hann window shows it
        response = (response[:-2] + 4.0 * response[1:-1] + response[2:]) / 6.0
        own = np.minimum(power[near], PEAK * np.median(power[near]))    # no line tells
        total += len(near) * np.log(np.mean(own) / np.mean(own / response)) - (
            np.log(response).sum())
        if total < 0.0:    # the first tells of nearly all that are none
            break
    return total


def _response(number, N, n):
    """Power of the response of a mean of n samples at multiples of 1 / N."""
    f = np.pi * number / N
    return (np.sin(n * f) / (n * np.sin(f)))**2


def undone(y, n):
    """Records (..., N) before a moving average of n samples, at the same times; NaN
    where there are too few from one gap to the next, which all of them have.
    """
    result = np.full_like(y, np.nan)
    for first, length in zip(*runs(~np.isnan(y.reshape(-1, y.shape[-1])[0]))):
        if length >= 2 * n:
            own = slice(first, first + length)
            result[..., own] = _undone(y[..., own], n)
    return result


def _undone(y, n):
    """The same without a gap.

    Each sample less the last is 1 / n of what came less what left: so they are known
    but for a pattern of n, whose mean is zero. It is what samples n apart are on
    average, less the mean of the window that they are in the middle of.
    """
    N, turns = y.shape[-1], -(-y.shape[-1] // n)

    def folded(x):
        whole = np.full((*x.shape[:-1], turns * n), np.nan)
        whole[..., :N] = x
        return whole.reshape(*x.shape[:-1], turns, n)
    came = folded(n * np.diff(y, prepend=y[..., :1]))
    raw = y[..., :1] + np.cumsum(came, axis=-2).reshape(*y.shape[:-1], -1)[..., :N]
    about, before = np.full_like(y, np.nan), (n - 1) // 2
    about[..., before:N - (n - 1 - before)] = y[..., n - 1:]
    pattern = np.nanmean(folded(raw - about), axis=-2)
    return raw - np.tile(pattern, turns)[..., :N]
