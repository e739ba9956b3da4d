"""Samples that are the last one once more: a sensor is polled faster than it gives new
ones, or at random, or it is stuck.
"""

import functools
from typing import NamedTuple

import numpy as np
from scipy.fft import next_fast_len
from scipy.special import erf, pdtrc, xlogy

from sensorlab.gap.values import (
    CALM, CERTAIN, FEWEST, MOSTLY, NOISY, SMOOTH_OVER, TELLING, beside, lattice,
    lattice_and_noise, lattice_between, less_rounding, noise_of, noise_where_calm, runs,
    unpredicted, within)


class Repeats(NamedTuple):
    """Samples of a record that are the last one once more."""

    own: np.ndarray    # (N,) those that are
    rate: float        # how many of all samples are new
    phase: float       # of the new ones, in turns; None where they come at random

    @property
    def polled(self):
        """Has the sensor a rate of its own?"""
        return self.phase is not None and bool(self.own.any())


def repeated(y, between):
    """`Repeats` of a record (N,): at a rate of its own, else at random, if any, unless
    most of them lie `between` (N,) others, on a line from one value to the same.
    """
    polled = _polled(y)
    if polled:
        return polled
    own = repeated_at_random(y)
    own = own & (own.sum() > 2 * np.sum(own & between))
    return Repeats(own, 1.0 - float(own.mean()), None)


# ---- at a rate of its own

REGULAR = 0.75     # of the samples that a rate repeats are equal, if it is one: which
                   # is repeated where both meet may be chance
ALWAYS = 0.95      # the same, where counts are coarser than the noise
HARMONICS = 3      # of the rate that the largest line may be
A_LINE = 3.0       # nats that a line has over the largest of noise
MOST_TIES = 20000  # in which a rate is sought
ONE_TURN = 1e-7    # turns: one and the same
FINE = 20          # parts of the arc to which a rate is found over the record


def _polled(y):
    """`Repeats` of a sensor that is polled faster than it gives new values, or None.

    Sample i is repeated where the fractional part of rate i + phase is above the rate:
    an arc. The rate has a line in the spectrum of the ties. What repeats by chance is
    as often outside of the arc.
    """
    N = len(y)
    same = np.append(False, np.diff(y) == 0.0)
    ties, p = np.flatnonzero(same), same.mean()
    if len(ties) < FEWEST:
        return None
    n = next_fast_len(4 * N, real=True)
    power = np.abs(np.fft.rfft(same - p, n)[4:])**2 / (N * p * (1.0 - p) + 1e-9)
    if power.max() < np.log(N) + A_LINE:
        return None
    strong = np.flatnonzero(power > 0.5 * power.max())[[0, -1]]    # of its harmonics
    every = -(-len(ties) // MOST_TIES)
    ties = ties[::every]
    lines = (4 + np.append(strong, power.argmax())) / n
    rate = max((_nearest(ties, r, N / every, N, 0.5, 21)
                for line in lines for k in range(1, HARMONICS + 1)
                for r in (line / k, 1.0 - line / k)))[1]
    finer = np.clip(int(1.0 / (1.0 - rate)), 1, FINE)
    _, rate = _nearest(ties, rate, N / every, N, 0.1, FINE * finer)
    middle = _arc(ties, rate)[1]
    away = (rate * np.arange(N) - middle + 0.5) % 1.0 - 0.5
    arc = np.abs(away) < 0.5 * (1.0 - rate)
    again = same & arc
    gain = (_log_likelihood(same[arc]) + _log_likelihood(same[~arc])
            - _log_likelihood(same))
    lsb, noise = lattice_and_noise(y[~again])
    if (gain < CERTAIN + 2.0 * np.log(N)
            or same[arc].mean() < (ALWAYS if lsb > noise else REGULAR)):
        return None
    if lsb:    # what moves steadily through coarse counts is regular, too
        left = unpredicted(y[~np.isnan(y)][:TELLING])
        if left is None or lsb > NOISY * less_rounding(
                np.std(left) / np.sqrt(rate), lsb):    # nothing new is repeated
            return None
    else:    # none repeats by chance: what a clock that is not even repeats
        for begin, n in zip(*runs(same)):
            again[begin:begin + n] |= n <= np.ceil(1.0 / rate)
    return Repeats(again, float(rate), float((0.5 * (1.0 + rate) - middle) % 1.0))


def _log_likelihood(same):
    """Largest log-likelihood of independent ties."""
    p = np.sum(same) / max(len(same), 1)
    return len(same) * (xlogy(p, p) + xlogy(1.0 - p, 1.0 - p))


def _arc(ties, rate):
    """How many ties lie in the arc of the repeated samples at a rate, wherever most do,
    and its middle, in turns. Their mean direction would be off by those by chance.
    """
    turns = np.sort(rate * ties % 1.0)
    around = np.append(turns, turns + 1.0)
    # the arc is open: at a rate of 1/k both ends are samples
    last = np.searchsorted(around, turns + 1.0 - rate - ONE_TURN)
    count = last - np.arange(len(turns))
    k = count.argmax()
    return count[k], 0.5 * (turns[k] + around[last[k] - 1])


def _nearest(ties, rate, samples, N, reach, count):
    """By how much more ties than other samples, of so many in all, lie in the arc of
    the best of so many rates, so many turns in N samples about one; and the middle of
    the best rates.
    """
    rates = rate + np.linspace(-reach, reach, count) / N
    inside = np.array([_arc(ties, r)[0] for r in rates])
    score = 2.0 * inside - samples * (1.0 - rates)
    return score.max(), np.mean(rates[inside == inside[score.argmax()]])


# ---- at random

MOSTLY_NEW = 1.5    # times as many as by chance that must be, to tell where they are
EARLIER = range(4, 10)   # samples, to values that equal one by chance
LONGEST = 16             # ties in a row: of more a sensor is stuck


def repeated_at_random(y):
    """Samples (N,) of a record that are the last one once more; none, where chance
    explains those that equal it, or they come in spans or in parts of the record.

    Where values lie on a lattice, some are equal by chance, which is as likely as that
    they equal an earlier one, the likelier the nearer they are; or, if the record runs
    away from these, as that they are one spacing apart. How many are equal in a row
    tells, too. Which of them are so by chance says nothing: as many as there should be
    are left out at random.
    """
    return _repeated_in(np.asarray(y, float).tobytes())


@functools.lru_cache(maxsize=2)    # every block of simulated records asks for it
def _repeated_in(y):
    y = np.frombuffer(y)
    none, low, high = np.zeros(len(y), bool), np.nanmin(y), np.nanmax(y)
    same = np.append(False, np.diff(y) == 0.0) & (low < y) & (y < high)    # not clipped
    count = int(same.sum())
    fresh = y[~same & ~np.isnan(y)]
    if count < FEWEST or len(fresh) <= max(FEWEST, *EARLIER):
        return none
    lsb = lattice(fresh)
    chance = _equal_on_lattice(y, fresh, lsb) if lsb else _equal_by_chance(fresh)
    share = count / len(y)
    start, length = runs(same)
    known = noise_where_calm(fresh) >= SMOOTH_OVER * lsb
    found = np.bincount(length[length <= LONGEST], minlength=LONGEST + 1)[1:]
    alike = len(y) * share**np.arange(1, LONGEST + 1) * (1.0 - share)**2
    if lsb and not (known and _gain(found, alike).sum() < CERTAIN):
        by_chance = _chains_by_chance(y, chance, lsb)
        by_chance[0] = by_chance[0] if known else np.inf
        own = _repeated_in_a_row(y, start, length, found, by_chance, lsb)
        if own.any():
            return own
    if (count < MOSTLY_NEW * chance or _gain(count, chance) < CERTAIN or not known
            or len(start) < 0.5 * count * (1.0 - share) or not _is_everywhere(same)
            or not lsb and (lattice(y[same]) or lattice_between(fresh)
                            or len(np.unique(y[same])) < FEWEST)):    # a dead zone
        return none
    keep = np.random.default_rng(0).random(len(y)) > chance / count
    return same & keep


def _gain(count, chance):
    """ln of how much likelier so many are as there are than by chance."""
    return xlogy(count, count / np.maximum(chance, 1e-9)) - count + chance


def _is_everywhere(own):
    """Does every quarter of a record have its share of what (N,) is its own?"""
    return min(part.sum() for part in np.array_split(own, 4)) >= own.sum() / 16


def _repeated_in_a_row(y, start, length, found, by_chance, lsb):
    """`repeated_at_random` of a record whose values lie on a lattice, of ties in runs
    of that first sample and length, where they are not alone or in a row as if each
    came by itself: what there is more of than by chance of runs of every length, of
    which so many are `found`, and `by_chance` (LONGEST,).
    """
    none = np.zeros(len(y), bool)
    if noise_where_calm(y[~np.isnan(y)]) < lsb:    # what stayed once stays longer
        return none
    more = found > MOSTLY_NEW * by_chance
    if found[more].sum() < FEWEST or _gain(found[more], by_chance[more]
                                           ).sum() < CERTAIN:
        return none
    share = np.maximum(1.0 - by_chance / np.maximum(found, 1), 0.0)
    own = (length <= LONGEST) & (np.random.default_rng(0).random(len(length)) < share[
        np.minimum(length, LONGEST) - 1])
    result = within(start[own], length[own], len(y))
    # what moves steadily through coarse counts is none, either
    left = unpredicted(y[~np.isnan(y)][:TELLING])
    return result if _is_everywhere(result) and left is not None and (
        np.std(left) > lsb) else none


def _chains_by_chance(y, ties, lsb):
    """How many runs of every length (LONGEST,) there are by chance, if it makes so many
    ties: as often as one value after another equals that some samples before, if each
    does so as often as neighbours do.
    """
    N, several = len(y), np.arange(1, LONGEST + 1)
    result = N * (ties / N)**several
    for lag in EARLIER:
        equal = np.abs(y[lag:] - y[:-lag]) < 0.5 * lsb
        often = ties / max(equal.sum(), 1)
        chain = np.ones(len(equal), bool)
        for k in several:
            chain = chain[:len(equal) - (k - 1) * lag] & equal[(k - 1) * lag:]
            if not chain.any():
                break
            result[k - 1] = max(result[k - 1], chain.sum() * often**k)
    return result * (1.0 - ties / N)**2


def _equal_on_lattice(y, fresh, lsb):
    """How many neighbours of a record are equal by chance: as earlier values are, or as
    many as are one spacing apart, up or down; fresh are those that are no ties.
    """
    step = np.abs(np.diff(fresh))
    earlier = [np.abs(y[lag:] - y[:-lag]) for lag in EARLIER]
    return max(np.mean([np.sum(d < 0.5 * lsb) * np.nanmean(d) / step.mean()
                        for d in earlier]),
               0.5 * np.sum(np.abs(step - lsb) < 0.5 * lsb))


OFTEN = 0.25    # as often as the difference that is met most


def _equal_by_chance(y):
    """How many neighbours of a record are equal by chance, where parts of it lie on
    lattices, each on its own: half as many as differ by the least of a lattice.
    """
    d = np.abs(np.diff(y))
    d = d[d > 0.0]
    scale = 1e-9 * np.median(d) if len(d) else 1.0
    value, times = np.unique(np.round(d / scale), return_counts=True)
    if not len(d) or times[times > 1].sum() < MOSTLY * len(d):
        return 0.0
    several = times > max(1.0, OFTEN * times.max())
    least = value[several].min()
    return 0.5 * times[several & (value < 1.99 * least)].sum()


# ---- in spans

RARE = 0.1       # runs as long that are to be expected by chance: if more are, none of
                 # them is told first
SELDOM = 1e-4    # probability that so many are as long


def stuck_spans(y, lsb, clipped):
    """Runs (first sample, length) of equal values longer than chance, and the samples
    (N,) of them but the first, which is a reading.

    As many of the longest are told as are hardly ever met by chance, by a Poisson law.
    Where some are, others are that are more likely one more of them than chance: of n
    spans of m ties in the mean, one begins at a sample of N and has a length with the
    probability n / (N m) or less.
    """
    start, length = runs(np.append(False, np.diff(y) == 0.0) & ~clipped)
    chance = (_expected_on_lattice(y, start, length, lsb) if lsb else
              len(y) * _tie_by_chance(start, length, len(y))**length)
    several = length > 1
    start, length, chance = start[several], length[several], chance[several]
    rarest = np.sort(chance[chance < RARE])
    sure = np.flatnonzero(pdtrc(np.arange(len(rarest)), rarest) < SELDOM)
    own = chance <= (rarest[sure[-1]] if len(sure) else -1.0)
    if own.any():
        own |= chance <= own.sum() / length[own].mean()
    start, length = start[own], length[own]
    return list(zip(start - 1, length + 1)), within(start, length, len(y))


def _expected_on_lattice(y, start, length, lsb):
    """How many runs of equal values are to be expected by chance that are as long as
    those of that first sample and length, if values (N,) lie on a lattice; infinitely
    many where the noise does not tell.

    Noise, and counts, may change: those before or behind a run tell, where most are
    equal, or the noise is least if few are. Runs beside others are of a calm part.
    """
    N, long = len(y), length > LONGEST
    left_out = within(start[long], length[long], N)
    if not len(length) or left_out.mean() > 0.5 or lsb >= NOISY * noise_of(
            np.where(left_out, np.nan, y), lsb):
        return np.full(len(length), np.inf)
    step = np.abs(np.diff(y, prepend=np.nan))
    same = np.where(np.isnan(step), np.nan, step == 0.0)
    usual = np.minimum(_stays(np.nanmean(same, where=~left_out)),
                       _stays_in(np.nanmean(step, where=~left_out), lsb))
    chance = N * usual**length
    rare = np.flatnonzero(chance < 1.0)
    while len(rare):
        runs_of = start[rare], length[rare]
        by_ties = _stays(np.maximum(*beside(same, *runs_of, 0.0)))
        by_noise = _stays_in(np.minimum(*beside(step, *runs_of, np.inf)), lsb)
        stays = np.maximum(by_ties, np.minimum(by_noise, usual))
        chance[rare] = np.where(_are_beside_others(*runs_of, N), np.inf,
                                N * stays**length[rare])
        rarer = rare[chance[rare] < 1.0]
        if len(rarer) == len(rare):
            break
        rare = rarer
    return chance


def _are_beside_others(start, length, samples):
    """Are most of CALM samples before or behind runs of that first sample and length in
    others of them?
    """
    in_runs = np.append(0, np.cumsum(within(start, length, samples)))
    end = start + length
    before = in_runs[start] - in_runs[np.maximum(start - CALM, 0)]
    behind = in_runs[np.minimum(end + CALM, samples)] - in_runs[end]
    return np.maximum(before, behind) > 0.5 * CALM


def _stays(ties):
    """Probability that a value in the middle of its cell stays there, if neighbours are
    equal with that of ties: sqrt(2) times it, to a tenth, wherever the mean lies, if
    noise has half of a cell as its standard deviation or more.
    """
    return np.minimum(np.sqrt(2.0) * ties, 1.0)


def _stays_in(step, lsb):
    """The same by the mean size of the steps that noise makes."""
    noise = less_rounding(0.5 * np.sqrt(np.pi) * step, lsb)
    return erf(lsb / np.maximum(np.sqrt(8.0) * noise, np.finfo(float).tiny))


def _tie_by_chance(start, length, samples):
    """Probability that a sample equals the last by chance, where runs of equal ones
    are: it is that a single tie goes on, and one over how far it is to the next.
    """
    once, twice = start[length == 1], np.sum(length == 2)
    if FEWEST <= twice < len(once):
        return twice / len(once)
    if len(once) <= 2:
        return len(once) / samples
    # half of the distances are beyond the median; there are parts without ties, too
    return 1.0 - 0.5**(1.0 / np.median(np.diff(once)))
