"""A moving average that a record has been through: it leaves nothing at the harmonics
of one over its window, and is undone but for a pattern that repeats with it. Where its
values were rounded, rounding fills these zeros: it is undone as far as that allows.
"""

import functools
from typing import NamedTuple

import numpy as np
from scipy.signal import get_window, lfilter

from sensorlab.gap.values import CERTAIN, lattice, less_rounding, longest, runs

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
    that is likeliest, tells.
    """
    first, N = longest(~np.isnan(y))
    N = min(N, TELLING)
    y = y[first:][:N]
    if N < FEWEST_TAPS * FEWEST_TURNS:
        return Average()
    power, lsb = _power(y), lattice(y)
    held = np.mean(np.diff(y) == 0.0) > MOST_HELD
    ways = [_shown(y, power, lsb, rounded)
            for rounded, may_be in ((False, not held), (True, lsb > 0.0)) if may_be]
    # where both do, rounding is to be reckoned with
    return max(ways, key=lambda one: one.log_bayes + CERTAIN * (one.counts > 0.0),
               default=Average())


def _shown(y, power, lsb, rounded):
    """The `Average` of a record without a gap, whose values were rounded since to
    multiples of lsb, or not.
    """
    N, floors = len(y), functools.partial(_floor, y, lsb) if rounded else _no_floor
    taps = range(FEWEST_TAPS, min(N // FEWEST_TURNS, MOST_TAPS) + 1)
    gains = {n: _gain(power, N, n, floors(n)) for n in taps}
    least = CERTAIN + np.log(len(gains))
    n = max((n for n, gain in gains.items() if gain > least), default=0)
    if not n:
        return Average()
    # a mean has the zeros of those of its parts, too: it may be one of more
    if rounded:
        n = _whole(power, N, n, gains, floors)
        counts = lsb / _noise_of(y, lsb, n)
        raw = undone(y, n, counts)[n:]
        fits = _is_even(raw, n) and _is_noise(raw, n)
    else:
        counts, more = 0.0, range(2 * n, N // 12 + 1, n)
        fits = _is_even(undone(y, n), n) and all(
            _gain(power, N, m, _no_floor(m)) <= least for m in more)
    return Average(n, float(gains[n]), float(counts)) if fits else Average()


def _power(y):
    """Of the spectrum of a record (N,), through a Hann window."""
    power = np.abs(np.fft.rfft((y - y.mean()) * get_window("hann", len(y))))**2
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


def _whole(power, N, n, gains, floors):
    """Which mean, of n samples or a multiple that promises something, describes the
    power best from below the first harmonic of n.
    """
    number = np.arange(N // (4 * n), len(power))

    def fits(m):
        return _likelihood(power[number], _response(number, N, m) + LEAST_RESPONSE,
                           floors(m)(number / N))
    return max((m for m in gains if m % n == 0 and gains[m] > 0.0), key=fits)


LEAST_RESPONSE = 1e-12    # at a harmonic itself


def _gain(power, N, n, floor):
    """Log odds that the power (N // 2 + 1,) of a record has the zeros of a mean of n
    samples, filled by a `floor` of which it takes the frequencies.
    """
    half, total = N // (4 * n), 0.0
    for k in range(1, n // 2 + 1):
        at = round(k * N / n)
        near = np.arange(at - half, min(at + half, len(power) - 1) + 1)
        response = _response(near[0] - 1 + np.arange(len(near) + 2), N, n)
        # as a Hann window shows it
        response = (response[:-2] + 4.0 * response[1:-1] + response[2:]) / 6.0
        own = np.minimum(power[near], PEAK * np.median(power[near]))    # no line tells
        total += _likelihood(own, response, floor(near / N)) - _of_levels(own)
        if total < 0.0:    # the first tells of nearly all that are none
            break
    return total


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
            all_of_it = level * response + floor
            level = max(0.0, level + np.sum(
                response * (power - all_of_it) / all_of_it**2) / np.sum(
                    response**2 / all_of_it**2))
    all_of_it = level * response + floor
    return -np.sum(np.log(all_of_it) + power / all_of_it)


SCORINGS = 8


def _no_floor(n):
    """Of values that were not rounded."""
    return lambda f: 0.0


def _floor(y, lsb, n):
    """Power at frequencies f (m,) that rounding to multiples of lsb adds, if a record
    is a mean of n samples, through a Hann window.
    """
    noise = _noise_of(y, lsb, n)
    error = noise**2 * _rounding(n, lsb / noise) if noise else np.zeros(n)
    error[1:] *= 2.0
    power = np.maximum(np.fft.rfft(error, FINE).real, LEAST * error[0])
    of_window = 3.0 / 8.0 * len(y)    # its squares
    return lambda f: np.interp(f * FINE, np.arange(len(power)), of_window * power)


FINE = 2**13    # parts of the sampling rate, in which the power of rounding is smooth
LEAST = 0.01    # of the power of rounding, that it has at any frequency


def _noise_of(y, lsb, n):
    """Standard deviation of white noise in a mean of n samples, rounded to multiples of
    lsb, between what is rare.
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


def _rounding(n, counts):
    """Autocovariance (n,) of what rounding adds to a mean of n samples of white noise
    that has a standard deviation of 1, rounded to multiples of `counts` (B. Widrow, I.
    Kollar, "Quantization Noise", 2008: that of a difference of normal values).
    """
    m = np.arange(1, ROUNDINGS)[:, None]
    apart = np.arange(1, n) / n    # half the variance of a difference
    return counts**2 * np.append(1.0 / 12.0, np.sum(np.exp(
        -(2.0 * np.pi * m / counts)**2 * apart) / m**2, 0) / (2.0 * np.pi**2))


ROUNDINGS = 30    # terms of a sum whose rest is 0.02 of it


def _response(number, N, n):
    """Power of the response of a mean of n samples at multiples of 1 / N."""
    f = np.pi * number / N
    return (np.sin(n * f) / (n * np.sin(f)))**2


def undone(y, n, counts=0.0):
    """Records (..., N) before a moving average of n samples, at the same times; NaN
    where there are too few from one gap to the next, which all of them have. Where
    the mean was rounded to `counts`, as in `Average`: they have passed what leaves slow
    changes as they are and makes white noise white again, which the first n samples do
    not tell.
    """
    result = np.full_like(y, np.nan)
    for first, length in zip(*runs(~np.isnan(y.reshape(-1, y.shape[-1])[0]))):
        if length >= 2 * n:
            own = slice(first, first + length)
            result[..., own] = _whitened(y[..., own], _taps(n, counts)) if counts else (
                _undone(y[..., own], n))
    return result


@functools.lru_cache(8)    # of thousands of records
def _taps(n, counts):
    """Taps (n,), of sum 1, which all decay behind zeros, through which white noise
    passes as it passes a mean of n samples that is rounded: the minimum phase of that
    power, by its cepstrum.
    """
    covariance = 1.0 - np.arange(n) / n + _rounding(n, counts)
    power = np.fft.rfft(np.concatenate([
        covariance, np.zeros(CEPSTRUM - 2 * n + 1), covariance[:0:-1]])).real
    cepstrum = np.fft.irfft(0.5 * np.log(np.maximum(power, LEAST * counts**2 / 12.0)))
    cepstrum[1:CEPSTRUM // 2] *= 2.0
    cepstrum[CEPSTRUM // 2 + 1:] = 0.0
    taps = np.fft.irfft(np.exp(np.fft.rfft(cepstrum)))[:n]
    return taps / taps.sum()


CEPSTRUM = 2**16    # what the zeros of counts of 0.001 have decayed in


def _whitened(y, taps):
    """Records (..., N) before they went through taps (n,), as if what had come before
    their first was forecast from what came after (G. E. P. Box, G. M. Jenkins, "Time
    Series Analysis", 1970, of a moving-average process), about a level.
    """
    before = len(taps) - 1
    level = y[..., :4 * len(taps)].mean(-1, keepdims=True)
    last = lfilter([1.0], taps, (y - level)[..., ::-1])[..., -before:]
    nothing = np.zeros_like(last)
    forecast = lfilter(taps, [1.0], np.concatenate([last, nothing], -1))[..., before:]
    raw = level + lfilter([1.0], taps, np.concatenate([
        forecast[..., ::-1], y - level], -1))[..., before:]
    raw[..., :len(taps)] = np.nan    # as most of it was forecast
    return raw


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
