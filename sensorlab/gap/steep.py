"""A low-pass of third order or more that a record has been through: above its cut-off
nothing is left to tell, and what it took of a white noise is filled in.

A filter of so many states would tell no more: what the low-pass lets through is as it
was, and what is filled in is as strong as what was white is where it passes.
"""

import zlib
from typing import NamedTuple

import numpy as np
from numpy.fft import irfft, rfft, rfftfreq
from scipy.ndimage import median_filter
from scipy.optimize import minimize

from sensorlab.gap.values import CERTAIN, longest, passed_by_mean, power_of

FEWEST_SAMPLES = 400
TELLING = 2**17       # samples in which it is looked for
PARTS = 400           # of the spectrum, whose powers are averaged
HIGHEST = 0.45        # cycles a sample, from where on a cut-off is sought
BEYOND = 8.0          # times the cut-off, what tells of it
LEAST_LEFT = 1e-4     # of the power where it passes: less tells nothing, ...
TELLS_SHAPE = 1e-2    # ... nor of what a simulator lets through
FALLEN = 0.2          # of the power where it passes, is what is left at most
FLAT = 2.5            # times a model of the power is what is there, at most, and at
                      # least as much less
LOWEST_POLES, HIGHEST_POLES = 3, 20


class Steep(NamedTuple):
    """A steep low-pass that a record shows: a Butterworth filter, as `scipy.signal`
    has it.
    """

    cutoff: float = 0.0    # cycles a sample, where half the power passes; 0: there is
                           # none
    poles: int = 0
    log_bayes: float = 0.0


def steep_low_pass(y, average=None):
    """The `Steep` that a record (N,) shows. The longest stretch without a gap tells.

    Whittle's likelihood of white noise and a walk through a Butterworth filter of any
    order, on a floor that it does not reach, is held against that of the low-passes of
    first and of second order, with any damping, and that of a moving average, if there
    is one, by its samples and times.
    """
    edge = _edge(y)
    if edge is None:
        return Steep()
    steep = _likeliest(_butterworth, edge, LEAST_LEFT, [edge.log_tan, np.log(5.0)])
    others = [_likeliest(_first_order, edge, LEAST_LEFT, [edge.log_tan]),
              _likeliest(_second_order, edge, LEAST_LEFT, [
                  edge.log_tan, np.log(0.7)]),
              *([_likeliest(_mean_of(*average), edge, LEAST_LEFT, [])] if average
                else [])]
    gain = edge.many * (min(one.fun for one in others) - steep.fun)
    poles, log_floor = np.exp(steep.x[-1]), steep.x[2]
    if gain < CERTAIN or poles < LOWEST_POLES - 0.5 or log_floor > np.log(FALLEN):
        return Steep()
    shape = _likeliest(_butterworth, edge, TELLS_SHAPE, steep.x[-2:])
    log_tan, log_poles = shape.x[-2:]
    poles = int(np.clip(round(np.exp(log_poles)), LOWEST_POLES, HIGHEST_POLES))
    whole = _likeliest(_of_poles(poles), edge, TELLS_SHAPE, [log_tan])
    cutoff = float(np.arctan(np.exp(whole.x[-1])) / np.pi)
    if not _is_flat(edge, _of_poles(poles), whole.x, cutoff):
        return Steep()
    return Steep(cutoff, poles, float(gain))


def log_odds_of_another(y, cutoff, poles):
    """Log odds that a record (N,) has passed a steep low-pass of another cut-off, in
    cycles a sample, or of more or fewer poles.
    """
    edge = _edge(y)
    if edge is None:
        return np.inf
    shape = [np.log(np.tan(np.pi * min(cutoff, NO_CUTOFF))), np.log(poles)]
    own = _likeliest(lambda f: _butterworth(f, *shape), edge, TELLS_SHAPE, [])
    best = min(_likeliest(_butterworth, edge, TELLS_SHAPE, [begin, np.log(5.0)]).fun
               for begin in (edge.log_tan, shape[0]))
    return float(edge.many * (own.fun - best))


class _Edge(NamedTuple):
    """The spectrum of a record about where it falls."""

    f: np.ndarray        # (m,) cycles a sample
    power: np.ndarray    # (m,) mean of those about it, ...
    many: int            # ... so many
    log_tan: float       # ln tan(pi f) where it falls
    level: float         # of the power about there


def _edge(y):
    """The `_Edge` of a record (N,), where most of its acceleration is; None if there is
    too little of it, or its power falls by too little beyond.
    """
    y = _bridged(y)
    first, N = longest(~np.isnan(y))
    N = min(N, TELLING)
    if N < FEWEST_SAMPLES:
        return None
    power = power_of(y[first:][:N])[1:-1]
    f, smooth, _ = _averaged(power, N)
    smooth = median_filter(smooth, SMOOTHED)
    at = int(np.argmax(f**2 * smooth))    # that of walks is even, of white noise rises
    level = smooth[at]
    if not smooth[at:].min() < FALLEN * level:
        return None
    edge = min(f[at], HIGHEST)
    return _Edge(*_averaged(power[:int(BEYOND * edge * N)], N),
                 np.log(np.tan(np.pi * edge)), level)


SMOOTHED = 9    # parts of a spectrum


def _bridged(y, few=3):
    """A record (N,) with what its neighbours say of samples that stand out from them,
    and of a few that are missing together.
    """
    seen = np.flatnonzero(~np.isnan(y))
    bend = np.abs(np.convolve(np.pad(y[seen], 1, "edge"), [-0.5, 1.0, -0.5], "valid"))
    odd, time = bend > ODD * bend.mean(), np.arange(len(y))
    kept = seen[~odd] if odd.mean() < FEW_ARE_ODD else seen
    apart = np.diff(kept, prepend=-1, append=len(y))[np.searchsorted(kept, time)]
    result = np.where(apart <= few + 1, np.interp(time, kept, y[kept]), np.nan)
    result[kept] = y[kept]
    return result


ODD = 10.0           # times the mean of bends, 8 standard deviations of noise
FEW_ARE_ODD = 0.01   # of the samples


def _averaged(power, N):
    """Frequencies (m,), powers there, averaged over so many, and these, of those of a
    spectrum of N samples from the first above zero.
    """
    many = max(len(power) // PARTS, 1)
    whole = len(power) // many * many
    f = (1.0 + np.arange(whole)).reshape(-1, many).mean(1) / N
    return f, power[:whole].reshape(-1, many).mean(1), many


def _butterworth(f, log_tan, log_poles):
    log_ratio = np.log(np.tan(np.pi * f)) - log_tan
    return 1.0 / (1.0 + np.exp(np.minimum(2.0 * np.exp(log_poles) * log_ratio, 600.0)))


def _of_poles(poles):
    return lambda f, log_tan: _butterworth(f, log_tan, np.log(poles))


def _first_order(f, log_tan):
    return _butterworth(f, log_tan, 0.0)


def _second_order(f, log_tan, log_damping):
    square = (np.tan(np.pi * f) * np.exp(-log_tan))**2
    return 1.0 / ((1.0 - square)**2 + 4.0 * np.exp(2.0 * log_damping) * square)


def _mean_of(samples, times):
    return lambda f: passed_by_mean(f, samples)**times


def _model(form, f, x):
    """Power of white noise and a walk through a low-pass, on a floor."""
    log_level, log_walk, log_floor, *shape = x
    return np.exp(log_level) * ((1.0 + np.exp(log_walk) / f**2) * form(f, *shape)
                                + np.exp(log_floor))


def _likeliest(form, edge, least, shape):
    """Least of Whittle's negative log-likelihood of a spectrum, of which what is below
    the `least` of its level tells nothing, of a form, from the logarithms of its
    parameters on.
    """
    f, power = edge.f, edge.power + least * edge.level

    def negative(x):
        if np.abs(x).max() > FAR:
            return np.inf
        model = _model(form, f, x)
        return np.sum(np.log(model) + power / model)
    begin = np.array([np.log(edge.level), 2.0 * np.log(f[0]), np.log(0.01), *shape])
    for _ in range(ROUNDS):
        best = minimize(negative, begin, method="Nelder-Mead", options=dict(
            maxiter=MOST_STEPS, xatol=1e-3, fatol=1e-2, adaptive=True))
        begin = best.x
    return best


FAR = 100.0          # no logarithm is as large
ROUNDS = 2           # of a simplex, that may come to rest too early
MOST_STEPS = 600


def _is_flat(edge, form, x, cutoff):
    """Is the power about what a model of it says, wherever it passes?"""
    passes = edge.f < cutoff
    parts = np.array_split((edge.power / _model(form, edge.f, x))[passes],
                           PASSING)
    level = np.array([np.median(part) for part in parts if len(part) > 2]) / np.log(2.0)
    return len(level) > 2 and level.max() < FLAT and level.min() > 1.0 / FLAT


PASSING = 8    # parts of what passes


def passed(cutoff, poles, f):
    """Share of the power at frequencies f (m,) that passes; all, where the cut-off is
    at half the rate.
    """
    if cutoff >= NO_CUTOFF:
        return np.ones(len(f))
    return _butterworth(np.clip(f, 1e-9, 0.5 - 1e-9), np.log(np.tan(np.pi * cutoff)),
                        np.log(poles))


NO_CUTOFF = 0.499


def filled(y, cutoff, poles, white=None):
    """Records (R, N) that passed a low-pass with what it took of a white noise filled
    in: noise as strong as what was white is where it passes, less the floor that the
    low-pass did not reach. `white` are the least and the largest standard deviation
    that a simulator says, which it is then within, unless the record contradicts.

    What is filled in hangs on that record alone, by which it is drawn.
    """
    if cutoff >= NO_CUTOFF:
        return y
    N = y.shape[-1]
    first, length = longest(~np.isnan(_bridged(y[0])))
    known = slice(first, first + length)
    taken, result = np.sqrt(1.0 - passed(cutoff, poles, rfftfreq(N))), y.copy()
    for row in result:
        noise = np.random.default_rng(zlib.crc32(row)).standard_normal(N)
        variance = np.pad(_variances(_bridged(row, N)[known], cutoff, poles, white),
                          (first, N - first - length), "edge")
        row += np.sqrt(variance) * irfft(rfft(noise) * taken, N)
    return result


def _variances(y, cutoff, poles, white):
    """Of the white noise that a low-pass took from a record (N,) without a gap, were it
    all of it, (N,): as strong always, unless its energy where it passes changes.
    """
    N, f, power = len(y), rfftfreq(len(y)), power_of(y)
    share = passed(cutoff, poles, f)
    passes, beyond = (f > cutoff / 3.0) & (share > 0.5), share < 0.01
    if passes.sum() < ENOUGH:
        return np.zeros(N)
    count = passes.sum()
    floor = _mean(power[beyond]) if beyond.sum() > ENOUGH else 0.0
    wave = np.where(passes, rfft(y - np.linspace(y[0], y[-1], N)) / np.sqrt(
        np.maximum(share, 0.5)), 0.0)
    size = np.abs(wave) + TINY
    most = np.sqrt(RARE / np.log(2.0)) * np.median(size[passes])    # no line tells
    energy = irfft(wave * np.minimum(1.0, most / size), N)**2 * N / (2.0 * count)
    levels = _levels(np.append(0.0, np.cumsum(energy)), 0, N, count / N)
    if len(levels) == 1:
        level = _mean(power[passes] / share[passes])
        near = np.clip(level, *np.square(white)) if white else level
        sure = SURE * level / np.sqrt(count)
        levels = [(near if abs(near - level) < sure else level, N)]
    return np.concatenate([np.full(length, max(one - floor, 0.0))
                           for one, length in levels])


def _levels(total, first, last, rate):
    """Levels and lengths of the parts, from a first sample to a last, of what has this
    sum (N + 1,) from the begin on, in which it is the same, if so many frequencies a
    sample tell of it.
    """
    mean, fewest = (total[last] - total[first]) / (last - first), int(PART / rate)
    at = np.arange(first + fewest, last - fewest)
    if len(at):
        before = (total[at] - total[first]) / (at - first)
        after = (total[last] - total[at]) / (last - at)
        gain = rate * ((last - first) * np.log(mean + TINY) - (at - first) * np.log(
            before + TINY) - (last - at) * np.log(after + TINY))
        k = np.argmax(gain)
        if gain[k] > CERTAIN:
            return [*_levels(total, first, at[k], rate),
                    *_levels(total, at[k], last, rate)]
    return [(mean, last - first)]


PART = 20        # frequencies, that tell a level
TINY = 1e-300    # a level of 0 has a logarithm


def _mean(power):
    """Of powers (m,), of which lines do not tell."""
    return np.mean(np.minimum(power, RARE * np.median(power) / np.log(2.0)))


ENOUGH = 20    # frequencies
RARE = 6.0     # times a mean: a power is so large once in 400
SURE = 3.0     # standard errors, from which on a record contradicts a simulator
