"""A moving average is undone but for a pattern that repeats with its window; where its
means were rounded, as far as that allows.
"""

import functools

import numpy as np
from scipy.signal import lfilter

from sensorlab.gap.values import runs


def undone(y, n, times=1, counts=0.0):
    """Records (..., N) before a moving average of n samples, at the same times; NaN
    where there are too few from one gap to the next, which all of them have. Where the
    mean was rounded to `counts`, as in `Average`: they have passed what leaves slow
    changes as they are and makes white noise white again, which the first samples do
    not tell. Of means of means that were not, as if they were, to very fine ones.
    """
    counts = max(counts, FINEST) if times > 1 else counts
    result = np.full_like(y, np.nan)
    for first, length in zip(*runs(~np.isnan(y.reshape(-1, y.shape[-1])[0]))):
        if length >= 2 * times * n:
            own = slice(first, first + length)
            result[..., own] = _whitened(y[..., own], _taps(n, times, counts)
                                         ) if counts else _undone(y[..., own], n)
    return result


FINEST = 1e-3    # counts, of the noise: it may be as weak at the zeros


def _undone(y, n):
    """The same of a mean that was not rounded, without a gap.

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


@functools.lru_cache(8)    # of thousands of records
def _taps(n, times, counts):
    """Taps (m,), of sum 1, which all decay behind zeros, through which white noise
    passes as it passes a mean of n samples, or of means, that is rounded: the minimum
    phase of that power, by its cepstrum.
    """
    covariance = covariance_of(n, times)
    covariance = covariance + rounding_of(covariance, counts)
    m = len(covariance)
    power = np.fft.rfft(np.concatenate([
        covariance, np.zeros(CEPSTRUM - 2 * m + 1), covariance[:0:-1]])).real
    cepstrum = np.fft.irfft(0.5 * np.log(np.maximum(power, LEAST * counts**2 / 12.0)))
    cepstrum[1:CEPSTRUM // 2] *= 2.0
    cepstrum[CEPSTRUM // 2 + 1:] = 0.0
    taps = np.fft.irfft(np.exp(np.fft.rfft(cepstrum)))[:m]
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


def covariance_of(n, times):
    """Autocovariance of white noise in a mean of n samples, or in a mean of means, of
    which its variance is 1, as far as it goes.
    """
    window = weights(n, times)
    covariance = np.correlate(window, window, "full")[len(window) - 1:]
    return covariance / covariance[0]


def weights(n, times):
    """Of the samples in a mean of n, or in a mean of means."""
    mean = np.full(n, 1.0 / n)
    return mean if times == 1 else np.convolve(mean, mean)


def rounding_of(covariance, counts):
    """Autocovariance of what rounding to multiples of `counts` adds to a normal process
    of a covariance (m,) that is 1 at first (B. Widrow, I. Kollar, "Quantization Noise",
    2008: that of a difference of normal values).
    """
    m = np.arange(1, ROUNDINGS)[:, None]
    apart = 1.0 - covariance[1:]    # half the variance of a difference
    return counts**2 * np.append(1.0 / 12.0, np.sum(np.exp(
        -(2.0 * np.pi * m / counts)**2 * apart) / m**2, 0) / (2.0 * np.pi**2))


LEAST = 0.01    # of the power of rounding, that it has at any frequency
ROUNDINGS = 30    # terms of a sum whose rest is 0.02 of it
