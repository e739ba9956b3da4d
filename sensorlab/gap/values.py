"""What the values of a record tell without a model of it: the lattice that they lie on,
the noise beneath it, and the spectrum.
"""

import functools

import numpy as np
from scipy.signal import get_window

TELLING = 20000     # samples that tell of a record what is the same everywhere
FEWEST = 8          # samples that show what is rare
CERTAIN = 15.0      # nats by which there is more than by chance
PADDED = 4          # times as long: of which a line's frequency is read
NORMAL_MEDIAN = 0.6745    # of |z|
COARSE = 0.1        # of the white noise: a finer lattice is how a file was printed
NOISY = 2.0         # of the white noise: what a coarser lattice adds is no white
                    # noise (B. Widrow, I. Kollar, "Quantization Noise", 2008)


def runs(true):
    """First sample and length of all runs of what is true."""
    ends = np.flatnonzero(np.diff(np.concatenate([[0], true.astype(int), [0]])))
    return ends[::2], ends[1::2] - ends[::2]


def longest(true):
    """First sample and length of the longest run of what is true."""
    start, length = runs(true)
    return start[length.argmax()], length.max()


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


def more_than_chance(tie, samples, by_chance=1e-4):
    """Ties of such a probability each, one after another, that are no chance: so many
    at most are to be expected of it.
    """
    with np.errstate(divide="ignore"):
        return np.where(tie < 1.0, np.maximum(2.0, np.log(by_chance / samples) / np.log(
            tie)), np.inf)


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
    scale = np.median(np.abs(d)) / NORMAL_MEDIAN
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


OFF = 1e-6    # of the spacing of a lattice: what lies on it is nearer


def snapped(y, between=False):
    """A record with its values on their lattice, if they have one; 0 stays 0, as do
    samples `between` others (N,) that lie off it.
    """
    lsb, seen = lattice(y), y[~np.isnan(y)]
    if not lsb:
        return y
    near = seen[0] + lsb * np.round((y - seen[0]) / lsb)
    return np.where((y == 0.0) | between & (np.abs(y - near) > OFF * lsb), y, near)


def lattice_and_noise(y):
    """`lattice` of a record, and the standard deviation of its noise without it."""
    lsb = lattice(y)
    return lsb, noise_of(y, lsb)


def noise_of(y, lsb, apart=1):
    """Standard deviation of what is another in samples so many `apart`, without what
    rounding adds.
    """
    seen = y[~np.isnan(y)]
    return less_rounding(np.sqrt(np.mean((seen[apart:] - seen[:-apart])**2) / 2.0), lsb)


def less_rounding(noise, lsb):
    """Standard deviation of a noise without what rounding adds."""
    return np.sqrt(np.maximum(noise**2 - lsb**2 / 12.0, 0.0))


PREDICTED_BY = 16    # samples before, that tell the white noise of a record


def unpredicted(y):
    """What those PREDICTED_BY before do not foretell of samples, by least squares; None
    if there are too few of them.
    """
    rows = np.lib.stride_tricks.sliding_window_view(y, min(PREDICTED_BY + 1, len(y)))
    if len(rows) < 4 * PREDICTED_BY:
        return None
    return not_foretold(rows[:, -1], rows[:, :-1])


def not_foretold(true, near, by=slice(None)):
    """What a sum of values near each sample (n, k), and a constant, leave of samples
    (n,), by least squares `by` some of them.
    """
    near = np.column_stack([np.ones(len(true)), near])
    return true - near @ np.linalg.lstsq(near[by], true[by])[0]


def power_of(y):
    """Of the spectrum of a record (N,), (N // 2 + 1,), through a Hann window; that of
    white noise is its variance on average.
    """
    return np.abs(np.fft.rfft((y - y.mean()) * get_window("hann", len(y)))
                  )**2 / (SQUARES_OF_HANN * len(y))


SQUARES_OF_HANN = 3.0 / 8.0    # their mean


def passed_by_mean(f, n):
    """Share of the power at f cycles a sample that the mean of n samples leaves."""
    return (np.sin(np.pi * n * f) / (n * np.sin(np.pi * f)))**2
