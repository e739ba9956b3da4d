"""Closure: how far a gap shrinks with the effects that were found, on the whole record
and on a part that took no part in the fit.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from sensorid import LOG_2PI, side_by_side
from sensorlab.gap.account import account
from sensorlab.gap.distance import MIN_WAYS, distance, enough_trials
from sensorlab.gap.kernels.arithmetic import row_products
from sensorlab.gap.linear import part_of
from sensorlab.gap.readings import as_read

OUTSTANDING = 0.05      # how often a record without a gap has what a gap is measured on


class Closure(NamedTuple):
    """How far a gap shrinks."""

    before: float      # rms distance of what stood out, standard deviations
    after: float       # the same with the effects; 1 is no gap
    closed: float      # fraction, 1 - (after - 1) / (before - 1); NaN without a gap
    interval: tuple    # of 95 %


def threshold(gap):
    """Distance that a record without a gap exceeds in one of twenty anywhere."""
    return np.quantile(np.abs(gap.null).max(1), 1.0 - OUTSTANDING)


def standing_out(gap):
    """Which statistics of a record stand out, (S,)."""
    return np.abs(gap.distance) > threshold(gap)


def along_the_filter(log_bayes, left):
    """`Closure` along the matched filter of what was found, where no place stands out:
    sqrt(1 + 2 ln B), for ln B is corrected for the search, before; the same of the best
    rival that is `left` after. The size found leaves one standard deviation of noise.
    """
    before, after = np.sqrt(1.0 + 2.0 * np.maximum([log_bayes, left], 0.0))
    before = max(before, 1.0 + 1e-9)
    low, high = np.sqrt(chi2.ppf([0.025, 0.975], 1)) - 1.0
    closed = 1.0 - (after - 1.0 + np.array([0.0, high, low])) / (before - 1.0)
    closed = np.clip(closed, -9.0, 1.0).tolist()
    return Closure(float(before), float(after), closed[0], tuple(closed[1:]))


def closure(before, after):
    """`Closure` over the statistics that stood out before. Its interval is where it
    lies for records of the simulator with the effects, of which 1 is the truth.
    """
    least, out = threshold(before), standing_out(before)
    if not out.any():
        return Closure(before.rms(), after.rms(), np.nan, (np.nan, np.nan))
    first, last = before.rms(out), after.rms(out)
    # records of the simulator with the effects go the same way: what stands out before
    # is chosen, and its noise is there after
    ways = [np.sqrt(np.mean(d[o]**2)) for d, o in zip(
        after.null, np.abs(after.beside) > least) if o.any()] if (
        after.beside is not None) else []
    if len(ways) < MIN_WAYS:    # too few do: through the statistics of the record
        ways = np.sqrt((after.null[:, out]**2).mean(1))
    low, high = np.quantile(ways, [0.025, 0.975]) - 1.0
    closed, *ends = np.clip(1.0 - (last - 1.0 - np.array([0.0, low, high])) / (
        first - 1.0), -9.0, 1.0).tolist()
    # of what was chosen because it stands out, noise is left: ends are less that
    return Closure(first, last, closed, (min(closed, *ends), max(closed, *ends)))


class HeldOut(NamedTuple):
    """What a fit of the first two thirds of a record says of the last third.

    Which effects there are, and their onset, frequency or delay, the whole record said.
    """

    gain: float           # of the log score with the effects, nats a sample
    reference: float      # of a flexible regression, nats a sample
    ratio_before: float   # real over calculated standard deviation of the predictions
    ratio_after: float    # the same with the effects: 1 where the criteria coincide
    closure: Closure      # of what stands out there


def held_out(scene, start, final, trials=None, seed=0):
    """`HeldOut` of an account with effects against that without; None where one of them
    begins in the last third.
    """
    cut = 2 * len(scene.y) // 3
    onsets = {key: value for key, value in zip(final.member.keys, final.theta)
              if key in final.member.onsets}
    if any(onset > cut * scene.dt for onset in onsets.values()) or any(
            not s.columns[:cut].any() for s in final.signatures):
        return None
    trials = trials or max(enough_trials(scene) // 2, round(1.0 / OUTSTANDING))
    seen = as_read(scene, final.readings)

    def fitted(acc):
        head, known = part_of(seen, acc.signatures, slice(cut))
        return account(head, acc.bases, [h.fixed(onsets) for h in acc.hypotheses],
                       known, acc.readings, None if onsets else acc)
    *fits, flexible = side_by_side(lambda work: work(), (
        lambda: fitted(start), lambda: fitted(final), lambda: _flexible(seen, cut)))
    gaps = []
    for acc, fit in zip((start, final), fits):
        gaps.append(distance(scene, fit._replace(signatures=acc.signatures), trials,
                             seed, cut, gaps[0] if gaps else None))
    score = [gap.log_score[cut:] for gap in gaps]
    ratio = [float(np.sqrt(np.nanmean(gap.z[cut:]**2))) for gap in gaps]
    return HeldOut(float(np.nanmean(score[1] - score[0])), flexible(score[0]), *ratio,
                   closure(*gaps))


def regression(rows_of, y, at):
    """Function of samples (n,) that gives the residuals (n,) of y (N,) there, of least
    squares of those at some samples on rows_of(samples), (K, n).

    By products of a few samples at a time: a long record has no room for rows, and the
    threads of a library of matrices spin while they wait.
    """
    def parts(at):
        return np.split(at, range(TOGETHER, len(at), TOGETHER))
    gram = 0.0
    for part in parts(at):
        rows = np.vstack([rows_of(part), y[part]])
        gram = gram + row_products(rows, rows)
    size = np.sqrt(np.diag(gram)[:-1])
    size[size == 0.0] = 1.0
    coefficients = np.linalg.lstsq(gram[:-1, :-1] / np.outer(size, size),
                                   gram[:-1, -1] / size)[0] / size
    return lambda at: np.concatenate([
        y[part] - np.einsum("k, kn -> n", coefficients, rows_of(part))
        for part in parts(at)])


TOGETHER = 10**5    # samples of a regression that are worked on at a time


LAGS = 32    # samples back that the flexible regression looks


def _flexible(scene, cut):
    """Log score of a regression on the samples before and all columns, as a function
    that gives how much it is over that of another model (N - cut,), nats a sample; NaN
    where there is too little data.
    """
    def rows_of(at):
        return np.vstack([np.ones(len(at)), *(
            x[at] - x.mean() for x in scene.columns.values()), *(
            scene.y[at - lag] for lag in range(1, LAGS + 1))])
    missing = np.cumsum(np.isnan(scene.y))
    whole = LAGS + np.flatnonzero(missing[LAGS:] - missing[:-LAGS] + np.isnan(
        scene.y[:-LAGS]) == 0)    # nothing is missing up to that sample
    early, late = whole[whole < cut], whole[whole >= cut]
    rows = 1 + len(scene.columns) + LAGS
    if len(early) <= 2 * rows or not len(late):
        return lambda score: np.nan
    residual = regression(rows_of, scene.y, early)
    variance = np.sum(residual(early)**2) / (len(early) - rows)
    density = -0.5 * (LOG_2PI + np.log(variance) + residual(late)**2 / variance)
    return lambda score: float(np.mean(density - score[late - cut]))
