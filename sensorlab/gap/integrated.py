"""Counts of the integral: a sensor that integrates gives pulses, and a sample is how
many there were since the last one, an increment of an angle or of a velocity.

What such a rounding adds is not white: an error of the integral is in one increment and
taken back in the next one, the quantization noise of IEEE Std 952.
"""

from typing import NamedTuple

import numpy as np

from sensorlab.gap.values import CERTAIN, lattice, longest, power_of

FEWEST_SUMS = 256       # in which a rounding of the integral is looked for
TELLING = 2**17         # samples of which these are sums
SUMS = 1, 4, 16, 64     # of so many increments, which are increments, too: where pulses
                        # are rare, several tell
DRIFTS_BELOW = 1 / 32   # cycles a sum, where what moves slowly may be more than noise
PART, PARTS = 16, 400   # powers of a part of the spectrum at least, and parts at most
LESSER = 0.8            # of the powers of a part tell its mean: the rest may be lines
LEAST = 1e-6            # squared counts: less power is none
NOISES = np.geomspace(1e-4, 30.0, 160)    # variances of white noise, squared counts
SHARES = np.geomspace(0.2, 5.0, 65)       # of the power that rounding adds
DITHER = 0.28    # of a count: a smaller white noise makes bands of what rounding adds,
                 # and is none of values that were rounded each
AS_STRONG = 1.5  # times, that rounding is as strong as it should be in bands
OTHER = 0.2      # of the gain, is what any other power of it may gain, ...
LIKE = 2.0       # ... and times the variance by chance, of the spectrum about its law
STILL = 0.1      # of a count: a smaller white noise makes lines of it
HARMONICS = 3    # of the rate of pulses, whose lines have ...
MOST = 0.5       # ... so much of the power at least, ...
OFF = 0.005      # ... so many cycles a sum off at most


class Pulses(NamedTuple):
    """What a record of increments shows."""

    lsb: float = 0.0      # u: of the integral, over the sampling interval; 0: none
    noise: float = 0.0    # u: standard deviation of the white noise beside the rounding

    @property
    def coarse(self):
        """Is what rounding adds no white noise that is differenced?"""
        return self.noise < DITHER * self.lsb


def counts_of_integral(y):
    """`Pulses` of a record (N,) on a lattice: the longest stretch without a gap tells.

    Whittle's likelihood of white noise with what rounding the integral adds, the
    difference of one white noise, of a twelfth of a squared count, and the one before,
    is held against that of white noise alone. It must be that strong: what else is blue
    may be any. Where next to no noise is beside them, pulses have lines at multiples of
    their rate instead.
    """
    lsb = lattice(y)
    for several in SUMS if lsb else ():
        seen = _spectrum(y, lsb, several)
        if seen is None:
            break
        variance, gain = _fitted(seen)
        if _is_even(seen) or gain > CERTAIN and (
                _is_as_strong if variance < DITHER**2 else _is_its_law)(seen, variance):
            return Pulses(lsb, lsb * float(np.sqrt(variance / several)))
    return Pulses()


def is_no_integral(y, lsb):
    """Does a record (N,) speak against counts of the integral, and none of its sums for
    them?
    """
    gains = [_fitted(seen)[1] for several in SUMS
             if (seen := _spectrum(y, lsb, several))]
    return bool(gains) and gains[0] < -CERTAIN and max(gains) < CERTAIN


class _Spectrum(NamedTuple):
    """Of sums of increments, in squared counts."""

    rate: float          # counts a sum, on average
    f: np.ndarray        # (F,) cycles a sum
    power: np.ndarray    # (F,)
    usual: np.ndarray    # (P,) means of parts, by their lesser powers
    many: int            # of so many
    shape: np.ndarray    # (P,) what rounding adds

    def log_likelihood(self, model):
        """Whittle's, of powers (..., P)."""
        return -self.many * np.sum(np.log(model) + self.usual / model, axis=-1)


def _spectrum(y, lsb, several):
    """`_Spectrum` of sums of several increments; None if there are too few."""
    start, length = longest(~np.isnan(y))
    count = min(length, TELLING) // several
    if count < FEWEST_SUMS:
        return None
    own = y[start:start + count * several] - y[start]    # a multiple of counts
    sums = own.reshape(-1, several).sum(1) / lsb
    # of neighbours in a Hann window, which are alike, one
    f = np.arange(count // 2 + 1)[::2] / count
    power, f = power_of(sums)[::2][f > DRIFTS_BELOW], f[f > DRIFTS_BELOW]
    each = max(PART, len(f) // PARTS)
    parts = len(f) // each
    lesser = np.sort(power[:parts * each].reshape(parts, each), axis=1)[
        :, :round(LESSER * each)]
    # so much of it they would be, by an exponential law
    share = np.cumsum(1.0 / np.arange(each, 0, -1))[:lesser.shape[1]].mean()
    middle = f[:parts * each].reshape(parts, each).mean(1)
    return _Spectrum(sums.mean(), f, power, np.maximum(lesser.mean(1) / share, LEAST),
                     lesser.shape[1], np.sin(np.pi * middle)**2 / 3.0)


def _fitted(seen):
    """Variance of the white noise beside what rounding adds, and the gain over white
    noise alone, nats.
    """
    own = seen.log_likelihood(NOISES[:, None] + seen.shape)
    return NOISES[own.argmax()], own.max() - _of_white(seen)


def _of_white(seen):
    """Log-likelihood of white noise alone."""
    return seen.log_likelihood(seen.usual.mean())


def _is_its_law(seen, variance):
    """Is there what rounding adds to a white noise, and neither more nor less?"""
    law = variance + seen.shape
    as_much, white = seen.log_likelihood(law), _of_white(seen)
    free = max(seen.log_likelihood(NOISES[:, None] + share * seen.shape).max()
               for share in SHARES)
    return free - as_much < OTHER * (as_much - white) and (
        seen.many * np.mean((seen.usual / law - 1.0)**2) < LIKE)


def _is_as_strong(seen, variance):
    """Is there as much beside a white noise as rounding adds, in bands?"""
    times = np.mean((seen.usual - variance) / seen.shape)
    return 1.0 / AS_STRONG < times < AS_STRONG


def _is_even(seen):
    """Are there lines at multiples of the rate of pulses, and next to no noise?"""
    if seen.usual.mean() > STILL**2:
        return False
    lines = seen.rate * np.arange(1, HARMONICS + 1) % 1.0
    away = np.abs(seen.f - np.minimum(lines, 1.0 - lines)[:, None]).min(0)
    return seen.power[away < OFF].sum() > MOST * seen.power.sum()
