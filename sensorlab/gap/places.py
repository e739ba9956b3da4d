"""Places: six ways to look at a record, and the statistics of each.

Time, frequency, averaging time, lag, amplitude and covariate. Statistics are of the
residuals of a filter, which are N(0, 1) and white if all is well, and of the record.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.fft import next_fast_len, prev_fast_len
from scipy.special import (
    chdtr, chdtrc, log_ndtr, ndtr, ndtri, ndtri_exp, pdtr, pdtrc)

from sensorid import allan_variance, brief
from sensorlab.gap.effects import Scene
from sensorlab.gap.filters import normal_score
from sensorlab.gap.kernels.arithmetic import dot, row_products
from sensorlab.gap.kernels.lanes import KERNEL, in_threads

PLACES = "time", "frequency", "averaging_time", "lag", "amplitude", "covariate"
CLASSES = 12           # of even probability
SMOOTH = 8             # sums of cos(k pi u), u a probability
TAILS = 3.0, 4.0       # standard deviations
UNITS = dict(time="s", frequency="Hz", averaging_time="s", lag="s",
             amplitude="sigma", covariate="")
ROUNDING = 1e-12    # of the largest value: equal values
FAR_OUT = 40.0    # standard deviations: no normal score lies further out


# ---- normal scores

def _normal_tail(log_p):
    """Normal score of a small probability given by its logarithm."""
    return -ndtri_exp(np.minimum(log_p, -1e-12))


def _chi2_score(total, n):
    """Normal score of a chi2 of n degrees of freedom."""
    return normal_score(chdtr(n, total), chdtrc(n, total))


def _largest_score(log_tail, n):
    """Normal score of the largest of n, whose own tail probability is given."""
    none = n * np.log1p(-np.exp(np.minimum(log_tail, -1e-12)))
    return _normal_tail(np.where(log_tail < -20.0, log_tail + np.log(n),
                                 np.log(-np.expm1(none) + 1e-300)))


def _count_score(n, expected):
    """Normal score of a Poisson count, in the middle of its probability."""
    fewer = np.maximum(n - 1.0, 0.0)    # than n; of 0 there are none
    return normal_score(
        0.5 * (pdtr(n, expected) + np.where(n > 0.0, pdtr(fewer, expected), 0.0)),
        0.5 * (pdtrc(n, expected) + np.where(n > 0.0, pdtrc(fewer, expected), 1.0)))


# ---- statistics, a function for each place

class Statistics(NamedTuple):
    """S statistics of R records, and where each of them looks."""

    value: np.ndarray    # (R, S)
    place: tuple         # (S,) one of PLACES
    at: np.ndarray       # (S, 2) in the unit of the place
    column: tuple        # (S,) of a covariate, else ""
    least: np.ndarray    # (S,) standard deviation that each has at least

    __repr__ = brief

    @property
    def of_rounding(self):
        """Which of them hang on how and when values were rounded, (S,): how many are
        repeated, and their law but for its tails.
        """
        low, high = self.at.T
        return (np.array(self.place) == "amplitude") & (low < TAILS[0]) & (
            high > -TAILS[0])


class _One(NamedTuple):
    """One statistic of R records."""

    low: float
    high: float
    value: np.ndarray    # (R,)
    column: str = ""
    least: float = 1e-3


class _Residuals(NamedTuple):
    """What the statistics are made of."""

    z: np.ndarray        # (R, N), 0 where missing
    seen: np.ndarray     # (R, N)
    count: np.ndarray    # (R,) samples seen, at least 1
    y: np.ndarray        # (R, N) the records themselves
    scene: Scene


def statistics(z, y, scene, probes):
    """Statistics of residuals z (R, N), which are N(0, 1) and white if all is well.

    y (R, N) are the records themselves; `Probes` are what residuals are held against.
    """
    seen = ~np.isnan(z)
    r = _Residuals(np.where(seen, z, 0.0), seen, np.maximum(seen.sum(1), 1), y, scene)
    spectrum = _power(r, slice(0, len(scene.y)))
    level = [(place, _One(*ends, value, column)) for (place, ends, column), value in
             zip(probes.listed, probes.products(r.z))]
    every = [*(("time", one) for one in _in_time(r)), *level,
             *(("frequency", one) for one in _in_frequency(*spectrum)),
             *(("frequency", one) for one in _moving_line(r)),
             *(("averaging_time", one) for one in _in_averaging_time(r)),
             *(("lag", one) for one in _in_lag(r, *spectrum)),
             *(("amplitude", one) for one in _in_amplitude(r)),
             *(("covariate", one) for one in _in_covariates(r))]
    return Statistics(np.column_stack([one.value for _, one in every]),
                      tuple(place for place, _ in every),
                      np.array([[one.low, one.high] for _, one in every], float),
                      tuple(one.column for _, one in every),
                      np.array([one.least for _, one in every]))


CLUSTER = 16    # samples, or means of them, in the clusters of a long time


def _in_time(r):
    """Mean, variance, largest line and spectrum by segment: what is stationary in the
    mean need not be at any one time.
    """
    N = len(r.scene.y)
    for part, ends in _parts(r.scene, int(np.clip(N // 64, 2, 16))):
        z, n = r.z[:, part], np.maximum(r.seen[:, part].sum(1), 1)
        yield _One(*ends, z.sum(1) / np.sqrt(n))
        yield _One(*ends, _chi2_score(np.einsum("ri, ri -> r", z, z), n))
    for part, ends in _parts(r.scene, int(np.clip(N // 256, 1, 12))):
        power = _power(r, part)[1][:, 1:]
        yield _One(*ends, _largest_score(-power.max(1), len(power[0])))
        for band in np.array_split(power, 4, axis=1):
            yield _One(*ends, _chi2_score(2.0 * band.sum(1), 2 * band.shape[1]))


def _parts(scene, count):
    """(slice, first and last time) of so many even parts."""
    edges = np.linspace(0, len(scene.y), count + 1).astype(int).tolist()
    for first, end in itertools.pairwise(edges):
        yield slice(first, end), (scene.time[first], scene.time[end - 1])


def _power(r, part):
    """Frequencies (F,), Hz, and periodograms (R, F) of a part of the residuals, with a
    few samples more if that leaves a length without large primes, which take ten times
    as long; of all of them, with a few less.
    """
    N, length = r.z.shape[1], part.stop - part.start
    real = length > MANY    # without sevens: twice as fast
    length = next_fast_len(length, real)
    if length > N:
        length = prev_fast_len(N, real)
    first = min(part.start, N - length)
    part = slice(first, first + length)
    line = np.fft.rfft(r.z[:, part])
    return np.fft.rfftfreq(length, r.scene.dt), (line.real**2 + line.imag**2) / (
        np.maximum(r.seen[:, part].sum(1), 1)[:, None])


MANY = 10000    # samples, from which on lengths without sevens are dense


def _in_frequency(frequency, power):
    """Power, and the largest line, in bands of even width on a logarithmic axis."""
    edges = np.unique(np.round(np.geomspace(1, len(frequency), 14)).astype(int))
    for low, high in itertools.pairwise(edges):
        band, n = power[:, low:high], high - low
        yield _One(frequency[low], frequency[high - 1],
                   _chi2_score(2.0 * band.sum(1), 2 * n))
        at = frequency[low + band.argmax(1)[0]]
        yield _One(at, at, _largest_score(-band.max(1), n))


MOVING = 128    # samples of a part in which a line that moves is sought, at most
TRACKED = 16    # parts that are told apart, about


def _moving_line(r):
    """The largest sum of power along a line in time and frequency: what sweeps through
    many frequencies is at none for long.
    """
    R, N = r.z.shape
    # about 1 / sqrt(rate) of a line that sweeps through a fourth of all frequencies
    length = prev_fast_len(int(min(2.0 * np.sqrt(N), MOVING)), real=True)
    parts = N // length
    line = np.fft.rfft(r.z[:, :parts * length].reshape(R, parts, length))[
        ..., 1:(length + 1) // 2]    # at the Nyquist frequency there is half of a line
    power = (line.real**2 + line.imag**2) / (length * r.count / N)[:, None, None]
    several = max(round(parts / TRACKED), 1)    # are summed
    parts = parts // several * several
    power = power[:, :parts].reshape(R, -1, several, power.shape[2]).sum(2)
    largest, ends = np.zeros(R), np.zeros((2, R), int)
    in_threads(_largest_track, R, np.moveaxis(power, 0, -1).copy(), largest, ends)
    yield _One(*(np.sort(ends[:, 0] + 1) / (length * r.scene.dt)),
               _largest_score(log_ndtr(-_chi2_score(2.0 * largest, 2 * parts)),
                              0.5 * power.shape[2]**2))    # neighbours are alike


@njit(**KERNEL)
def _largest_track(first, last, power, largest, ends):
    """Of powers (parts, frequencies, R), records side by side: the largest sum along
    straight lines from the first part to the last, and the frequencies of its ends
    (2, R).
    """
    parts, F, _ = power.shape
    sums = np.empty(last - first)
    for begin in range(F):
        for end in range(F):
            for k in range(len(sums)):
                sums[k] = 0.0
            for part in range(parts):
                share = (part + 0.5) / parts
                at = int(begin + (end - begin) * share + 0.5)
                for k in range(len(sums)):
                    sums[k] += power[part, at, first + k]
            for k in range(len(sums)):
                if sums[k] > largest[first + k]:
                    largest[first + k] = sums[k]
                    ends[0, first + k], ends[1, first + k] = begin, end


def _in_averaging_time(r):
    """Allan deviations of the records by octave; long clusters move on by a CLUSTER-th
    of their length.
    """
    y, dt = r.y, r.scene.dt
    m = 2**np.arange(int(np.log2(max(len(r.scene.y) // 3, 1))) + 1)
    variances = list(allan_variance(y, dt, m[m <= CLUSTER]).T)
    while len(variances) < len(m):
        y = _pair_means(y)
        variances.append(allan_variance(y, dt, CLUSTER))
    for tau, variance in zip(m * dt, variances):
        yield _One(tau, tau, 0.5 * np.log(variance + 1e-300))


def _pair_means(y):
    """Means (R, N // 2) of neighbours in records (R, N); of one that is seen alone, it.
    """
    first, second = y[:, :-1:2], y[:, 1::2]
    mean = first + second
    mean *= 0.5
    gap = np.isnan(mean)
    if gap.any():
        mean[gap] = np.where(np.isnan(first), second, first)[gap]
    return mean


LAGS = 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64    # samples


ECHO = 4    # samples: what comes again later than that is sought at every lag


def _in_lag(r, frequency, power):
    """Correlations of the residuals and of their size; the largest by octave of lag,
    from their periodograms.
    """
    lags = np.array([k for k in LAGS if k < len(r.scene.y) // 4])
    both = np.zeros((len(lags), 2, len(r.z)))
    in_threads(_lagged, len(r.z), r.z, r.seen, lags, both)
    for k, one in zip(lags * r.scene.dt, both):
        for total in one:
            yield _One(k, k, total / np.sqrt(r.count))
    length = round(1.0 / (frequency[1] * r.scene.dt))
    size = np.abs(np.fft.irfft(power, length, axis=1)) * np.sqrt(r.count)[:, None]
    for k in ECHO * 2**np.arange(int(np.log2(length / (4 * ECHO))) + 1):
        octave = size[:, k + 1:2 * k + 1]
        at = (k + 1 + octave.argmax(1)[0]) * r.scene.dt
        yield _One(at, at, _largest_score(
            np.log(2.0) + log_ndtr(-octave.max(1)), octave.shape[1]))


@njit(**KERNEL)
def _lagged(first, last, z, seen, lags, both):
    """Of records z (R, N): sums over samples of the product of one with that at a lag
    (L,), and the same of their size less its mean, in both (L, 2, R).
    """
    size = np.empty(z.shape[1])
    for record in range(first, last):
        for i in range(len(size)):
            size[i] = min(abs(z[record, i]) - math.sqrt(2.0 / math.pi), 5.0)
            if not seen[record, i]:
                size[i] = 0.0
        for at, k in enumerate(lags):
            both[at, 0, record] = dot(z[record, k:], z[record, :-k])
            both[at, 1, record] = dot(size[k:], size[:-k])


def _in_amplitude(r):
    """The law of the residuals: classes, smooth departures, tails; repeated values."""
    R, count = len(r.z), r.count
    inside, cosines = np.zeros((R, CLASSES)), np.zeros((R, SMOOTH))
    tails, moments = np.zeros((R, 2 * len(TAILS))), np.zeros((R, 3))
    in_threads(_amplitudes, R, r.z, r.seen, LAW, inside, cosines, tails, moments)
    edges = np.clip(ndtri(np.linspace(0, 1, CLASSES + 1)), -FAR_OUT, FAR_OUT)
    for low, high, number in zip(edges[:-1], edges[1:], inside.T):
        yield _One(low, high, number / np.sqrt(count / CLASSES))
    # smooth departures from the predicted law (Neyman)
    for total in cosines.T:
        yield _One(-FAR_OUT, FAR_OUT, total / np.sqrt(0.5 * count))
    for k, number in enumerate(tails.T):
        low = TAILS[k // 2]
        # most counts are 0: their own spread would make a single one stand out
        yield _One(*((low, FAR_OUT) if k % 2 else (-FAR_OUT, -low)),
                   _count_score(number, count * ndtr(-low)), least=1.0)
    largest, cubes, sizes = moments.T
    yield _One(largest[0], FAR_OUT,
               _largest_score(np.log(2.0) + log_ndtr(-largest), count))
    yield _One(-FAR_OUT, FAR_OUT, cubes / np.sqrt(count))
    yield _One(-FAR_OUT, FAR_OUT, sizes / np.sqrt(count))
    ties = np.zeros(R)
    in_threads(_ties, R, r.y + r.scene.known, ties)
    # fewer than one in a hundred are how a file was printed
    yield _One(0.0, 0.0, ties, least=1.0 + 0.01 * (r.z.shape[1] - 1))


@njit(**KERNEL)
def _ties(first, last, y, ties):
    """How many samples of records y (R, N) are equal to the one before."""
    for record in range(first, last):
        largest = 0.0
        for value in y[record]:
            largest = max(largest, abs(value))    # NaN is not larger
        for i in range(1, y.shape[1]):
            ties[record] += abs(y[record, i] - y[record, i - 1]) <= ROUNDING * largest


PER_SIGMA = 256    # values in a table of the normal law u and of cos(pi u), between
                   # which straight lines are good to some millionths
LAW = np.column_stack([
    u := ndtr(np.arange(-8 * PER_SIGMA, 8 * PER_SIGMA + 2) / PER_SIGMA),
    np.cos(np.pi * u)])


@njit(**KERNEL)
def _amplitudes(first, last, z, seen, law, inside, cosines, tails, moments):
    """Of records z (R, N): how many lie in even classes of their probability u, sums of
    cos(k pi u), how many lie beyond TAILS on either side; the largest |z|, the sum of
    cubes up to five standard deviations, and of |z|.
    """
    for record in range(first, last):
        for i in range(z.shape[1]):
            if not seen[record, i]:
                continue
            value, size = z[record, i], abs(z[record, i])
            at = (min(8.0, max(-8.0, value)) + 8.0) * PER_SIGMA    # NaN is at an end
            k = int(at)
            u = law[k, 0] + (at - k) * (law[k + 1, 0] - law[k, 0])
            inside[record, min(int(CLASSES * u), CLASSES - 1)] += 1.0
            before, this = 1.0, law[k, 1] + (at - k) * (law[k + 1, 1] - law[k, 1])
            twice = 2.0 * this
            for k in range(SMOOTH):
                cosines[record, k] += this
                before, this = this, twice * this - before
            for k in range(len(TAILS)):
                if size >= TAILS[k]:
                    tails[record, 2 * k + (value > 0.0)] += 1.0
            moments[record, 0] = max(moments[record, 0], size)
            moments[record, 1] += min(max(value, -5.0), 5.0)**3
            moments[record, 2] += size


def _in_covariates(r):
    """Does the size of the residuals go with a column?"""
    spread = np.where(r.seen, r.z**2 - 1.0, 0.0).clip(-1.0, 25.0)
    for name, x in r.scene.columns.items():
        if np.std(x) > 0.0:
            for f in (x, np.abs(x - x.mean())):
                f = (f - f.mean()) / (f.std() + 1e-300)
                yield _One(x.min(), x.max(), row_products(spread, f[None])[:, 0]
                           / np.sqrt(r.count), name)
