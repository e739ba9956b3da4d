"""Dropouts: lost samples for which a file has a constant, 0, -9999 or the mean."""

from typing import NamedTuple

import numpy as np
from scipy.special import erf, ndtr

from sensorlab.gap.repeats import stuck_spans
from sensorlab.gap.values import (
    CERTAIN, EXACT, FEWEST, NOISY, NORMAL_MEDIAN, PREDICTED_BY, TELLING, lattice,
    less_rounding, not_foretold, runs)


class Dropouts(NamedTuple):
    """Samples of a record that are a constant in the place of lost ones."""

    own: np.ndarray       # (N,) those that are
    value: float = 0.0


MOST = 0.5         # of the samples: what is most of a record is no dropout
FEWEST_EQUAL = 2   # samples that are the constant
FEWEST_RUNS = 3    # of these, unless it is farther from all others than these from each
                   # other
FAR = 5.0          # times the white noise, or counts, from all others
CODES = 100.0      # counts from all others, where these are coarser than the noise
NEAR = 0.5         # of the white noise, to values that the sensor may as well give
BESIDE = 0.1       # of it: as near there are others, too, or it is a dead zone
SEVERAL = 4.0      # times as often as chance: a code of a converter may be wider
CLOSER = 0.9       # of the median distance of values: between two codes, to both
ALMOST_NEVER = 1e-9    # is a value in double precision met again


def dropouts(y):
    """`Dropouts` of a record (N,), none by chance: the least or the largest value, 0,
    or that which is met most, of all, of those between, or of those that are no code,
    if the sensor hardly gave it.
    """
    values, times = np.unique(y[~np.isnan(y)], return_counts=True)
    if len(values) and times.max() >= FEWEST_EQUAL:
        most = times.argmax()
        between = times[1:-1].argmax() + 1 if len(times) > 2 else most
        tried = [values[0], values[-1], 0.0, values[most], values[between]]
        lsb, code = _codes_beside(_between_codes(values, times), y, values, times)
        odd = np.where(_is_no_code(values - code, lsb), times, 0)
        if odd.max() > SEVERAL * (odd.sum() - odd.max()):
            tried.insert(0, values[odd.argmax()])    # beside it, codes seem odd
        for value in tried:
            own = y == value
            others = y[~own & ~np.isnan(y)]
            if FEWEST_EQUAL <= own.sum() < MOST * len(y) and (
                    _is_alien(value, others, own) or _is_far_off(value, others, own)
                    or value == 0.0 and _is_out_of_reach(y, own)):
                return Dropouts(own, float(value) + 0.0)    # not -0
        own = _held_at_zero(y)
        if own.any():
            return Dropouts(own)
    return Dropouts(np.zeros(len(y), bool))


HELD_AT_ZERO = np.log(1000.0)    # nats, by which spans are all at 0 by no chance


def _held_at_zero(y):
    """Samples (N,) of spans of equal values longer than chance, if all of them are 0,
    which is no limit of the record, and a sensor stuck at any value hardly was there.
    """
    nothing = np.zeros(len(y), bool)
    if not np.nanmin(y) < 0.0 < np.nanmax(y):
        return nothing
    spans, again = stuck_spans(y, lattice(y), nothing)
    start = np.array([begin for begin, _ in spans], int)
    if len(spans) < FEWEST_RUNS or y[start].any():
        return nothing
    own = again | np.isin(np.arange(len(y)), start)
    share = np.mean(y[~own] == 0.0) + ALMOST_NEVER
    return own if -len(spans) * np.log(share) > HELD_AT_ZERO else nothing


def less_dropouts(y):
    """A record without its dropouts, which are NaN."""
    return np.where(dropouts(y).own, np.nan, y)


def _between_codes(values, times):
    """Number of that value of a record which is met most of those that lie nearer to
    both neighbours than values do; None if none is met often.
    """
    step = np.diff(values)
    closer = step < CLOSER * np.median(step) if len(step) > 1 else np.zeros(0, bool)
    near = np.flatnonzero(closer[1:] & closer[:-1]) + 1
    often = near[times[near] >= FEWEST_RUNS]
    return often[times[often].argmax()] if len(often) else None


def _codes_beside(constant, y, values, times):
    """Spacing of the codes of a record and that which is met most, without what may be
    a constant, by its number: few codes seem to have no spacing, or a finer one.
    """
    lsb = lattice(y)
    if constant is not None:
        times = times.copy()
        times[constant] = 0
        lsb = max(lsb, lattice(y[y != values[constant]]))
    return lsb, values[times.argmax()]


def _is_no_code(away, lsb):
    """Are values, so far from codes that are multiples of lsb, none of these?"""
    return (np.abs(away / lsb - np.round(away / lsb)) > 2.0 * EXACT
            if lsb else np.zeros(np.shape(away), bool))


def _is_alien(value, others, own):
    """Is a value none that the sensor gave, by all others of the record?"""
    count, away = len(runs(own)[0]), others - value
    if count < FEWEST_RUNS or len(others) < FEWEST:
        return False
    lsb, apart = lattice(others), np.abs(away).min()
    noise = _noise_of_most(others, lsb)
    if lsb > noise and apart > CODES * lsb:
        return True
    if not noise > 0.0:
        return False
    if apart > FAR * max(noise, lsb):    # noise would spread it over more codes
        return bool(count * np.log(_on_one_code(lsb, noise)) < -CERTAIN and (
            count >= FEWEST or apart > np.ptp(others)))
    return _is_met_too_often(value, others, lsb, noise, count)


def _is_far_off(value, others, own):
    """Is a value of few runs farther from all others than these from each other, and
    met more often than by chance? What is odd once, a sensor may be stuck at for a
    while; what jumps as far is at 0 hardly ever.
    """
    count = len(runs(own)[0])
    if count >= FEWEST_RUNS or len(others) < FEWEST:
        return False
    apart = np.abs(others - value).min()
    if not apart > np.ptp(others):
        return False
    lsb = lattice(others)
    noise = _noise_of_most(others, lsb)
    if lsb > noise or not apart > FAR * noise > 0.0:    # it may be a level
        return False
    if value == 0.0:
        return bool(own.sum() * np.log(lsb / apart + ALMOST_NEVER) < -CERTAIN)
    again = max(_on_one_code(lsb, noise), np.mean(np.diff(others) == 0.0))
    return bool((own.sum() - count) * np.log(again) < -CERTAIN)


def _noise_of_most(others, lsb):
    """White noise of values of which a few may be other wrong words."""
    return less_rounding(
        np.median(np.abs(np.diff(others))) / (np.sqrt(2.0) * NORMAL_MEDIAN), lsb)


def _on_one_code(lsb, noise):
    """How likely noise leaves a value on the code it is on."""
    return erf(lsb / (2.0 * np.sqrt(2.0) * noise)) + ALMOST_NEVER


RARELY = 0.01    # of the samples, at most, are foretold to be there: where more are
                 # clipped, others are too near to foretell as many


def _is_out_of_reach(y, own):
    """Is 0, which samples (N,) are, beyond one end of all others, and met far more
    often than those before foretell, or half as surely so but then for long? What is
    clipped is foretold to be near.
    """
    y, own = y[:TELLING], own[:TELLING]
    others = y[~own & ~np.isnan(y)]
    if len(others) < FEWEST or others.min() < 0.0 < others.max():
        return False
    near = np.lib.stride_tricks.sliding_window_view(
        np.where(own, np.nan, y), PREDICTED_BY)[:-1]
    told = ~np.isnan(near).any(1) & ~np.isnan(y[PREDICTED_BY:])
    near, lost = near[told], own[PREDICTED_BY:][told]
    count, true = lost.sum(), y[PREDICTED_BY:][told]
    if count < FEWEST_RUNS or len(lost) - count < 4 * PREDICTED_BY:
        return False
    left = not_foretold(true, near, ~lost)
    size = np.abs(left[~lost])
    usual = size <= FAR * np.median(size) / NORMAL_MEDIAN
    sd = np.sqrt(np.mean(size[usual]**2))
    lsb = lattice(y)
    if not NOISY * less_rounding(sd, lsb) > lsb:    # it may be one code of few
        return False
    above = (true - left) * np.sign(others[0]) - 0.5 * lsb
    foretold = ndtr(-above / sd).sum() + ALMOST_NEVER
    if count <= foretold:
        return False
    nats = count * np.log(count / foretold) - count + foretold
    again = np.sum(own[1:] & own[:-1]) * -np.log(
        _on_one_code(lsb, less_rounding(sd, lsb)))
    return bool(nats > CERTAIN or nats > 0.5 * CERTAIN and again > CERTAIN and (
        foretold < RARELY * len(lost)))


def _is_met_too_often(value, others, lsb, noise, count):
    """Is a value met so many times no code, or in the midst of others, each of which is
    met far less often?
    """
    met, times = np.unique(others, return_counts=True)
    away = others - value
    if len(met) >= FEWEST and met[0] < value < met[-1] and (
            _is_no_code(away, lsb).mean() > 0.5):
        return True
    near, reach = np.abs(away) < NEAR * noise, max(BESIDE * noise, 1.5 * lsb)
    per_width = near.sum() / (2.0 * NEAR * noise)
    beside = np.abs(met - value) < (max(2.0 * BESIDE * noise, 2.5 * lsb) if lsb
                                    else np.inf)
    beside[[0, -1]] = False    # where samples may be clipped
    often = max(per_width * lsb, times[beside].max(initial=1) - 1, ALMOST_NEVER)
    return bool(
        lsb < NEAR * noise and (away[near] > 0.0).any() and (away[near] < 0.0).any()
        and np.sum(np.abs(away) < reach) > per_width * min(reach, lsb or reach)
        and count > SEVERAL * often and count * np.log(count / often) > (
            count - often + CERTAIN + np.log(len(away))))
