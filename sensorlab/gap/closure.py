"""Closure: how far a gap shrinks with the effects that were found, on the whole record
and on a part that took no part in the fit.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from sensorid import LOG_2PI, side_by_side
from sensorlab.gap.account import account
from sensorlab.gap.distance import distance
from sensorlab.gap.kernels import row_products
from sensorlab.gap.readings import as_read

MIN_WAYS = 40           # simulated records that make an interval
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
    before, after = np.sqrt(1.0 + 2.0 * np.array([log_bayes, left]))
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
    closed = np.clip(1.0 - (last - 1.0 - np.array([0.0, low, high])) / (first - 1.0),
                     -9.0, 1.0)
    return Closure(first, last, float(closed[0]), (float(closed[1]), float(closed[2])))


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
    seen = as_read(scene, final.readings)
    head = seen.cut(slice(cut))

    def fitted(acc):
        return account(head, acc.bases, [h.fixed(onsets) for h in acc.hypotheses],
                       tuple(s._replace(columns=s.columns[:cut])
                             for s in acc.signatures),
                       acc.readings, None if onsets else acc)
    gaps = []
    for acc, fit in zip((start, final), side_by_side(fitted, (start, final))):
        gaps.append(distance(scene, fit._replace(signatures=acc.signatures), trials,
                             seed, cut, gaps[0] if gaps else None))
    score = [gap.log_score[cut:] for gap in gaps]
    ratio = [float(np.sqrt(np.nanmean(gap.z[cut:]**2))) for gap in gaps]
    return HeldOut(float(np.nanmean(score[1] - score[0])),
                   _flexible_gain(seen, cut, score[0]), *ratio, closure(*gaps))


def regression(rows, y):
    """Coefficients (K,) of least squares of y (n,) on rows (K, n), by products: the
    threads of a library of matrices spin while they wait.
    """
    size = np.sqrt(np.einsum("kn, kn -> k", rows, rows)) + 1e-300
    unit = rows / size[:, None]
    return np.linalg.lstsq(row_products(unit, unit), row_products(
        unit, y[None])[:, 0])[0] / size


LAGS = 32    # samples back that the flexible regression looks


def _flexible_gain(scene, cut, score):
    """Log score of a regression on the samples before and all columns, over that of
    another model `score` (N - cut,), nats a sample; NaN where there is too little data.
    """
    back = np.vstack([np.ones_like(scene.y), *(
        x - x.mean() for x in scene.columns.values()), *(
        np.roll(scene.y, lag) for lag in range(1, LAGS + 1))])
    whole = ~np.isnan(back).any(0) & ~np.isnan(scene.y)
    whole[:LAGS] = False
    early, late = whole.copy(), whole.copy()
    early[cut:], late[:cut] = False, False
    if early.sum() <= 2 * len(back) or not late.any():
        return np.nan
    residual = scene.y - np.einsum("k, kn -> n", regression(
        back[:, early], scene.y[early]), back)
    variance = np.sum(residual[early]**2) / (early.sum() - len(back))
    density = -0.5 * (LOG_2PI + np.log(variance) + residual[late]**2 / variance)
    return float(np.mean(density - score[late[cut:]]))
