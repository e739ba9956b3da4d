"""A flexible remainder: whatever colour and spread the normal scores of a filter have,
and whatever curves of the columns are in them.

What is left of a real record is never white. An effect that is named beside it must be
needed even where it is described in any way that does not describe the effect itself.
"""

import numpy as np

from sensorlab.gap.closure import regression, standing_out
from sensorlab.gap.places import PLACES
from sensorlab.gap.rival import search_cost

NEEDED_NATS = 3.0    # that an effect must gain
LAGS = 16      # samples before, on which a regression describes any colour
SPANS = 32     # parts of the record, each with a spread of its own
EVEN = 2.0     # standard errors by which a process must gain on average over SPANS
MOST = 0.5     # share of the gap that jumps, or a change of noise, must close


def stays_needed(effect, without_it, with_it, again=False):
    """Is an effect needed where what is left is coloured and uneven in any way? By two
    gaps, to the account without and with it.

    A process is no more than a colour: for it, only the spread may be uneven, but its
    gain must be even. A change of noise is no more than an uneven spread: for it, there
    may only be a colour, but it must close most of the gap in time. What comes from no
    column is needed beside any curve of those that there are, and so is what comes
    `again` from a column. Jumps are one law among many: they must close most of the gap
    where it is widest.
    """
    if effect.reading:
        return True
    change = effect.model and effect.search == "onset"
    process = effect.factor or effect.model and not (change or effect.jumps)
    wide = (0 if process else LAGS, 1 if change else SPANS,
            again or not effect.column)
    gain = _scores(with_it, *wide) - _scores(without_it, *wide)
    if process:
        parts = np.array([part.sum() for part in np.array_split(gain, SPANS)])
        if parts.mean() < EVEN * parts.std(ddof=1) / np.sqrt(SPANS):
            return False
    if effect.jumps and _closed_at_worst(without_it, with_it) < MOST or (
            change and _closed_at_worst(without_it, with_it, ("time",)) < MOST):
        return False
    # the best of as many places as it could be at gains that much by chance
    searched = np.log(len(with_it.z)) if effect.search not in ("", "spectrum") else 0.0
    searched += search_cost(effect, with_it.ruler.fit.setting.scene)
    return bool(gain.sum() > NEEDED_NATS + searched)


def _closed_at_worst(without_it, with_it, places=PLACES):
    """Share of the gap that is closed in that of some places where it is widest."""
    place = np.array(without_it.statistics.place)
    out = standing_out(without_it) & np.isin(place, places)
    if not out.any():
        return 1.0
    own = max((out & (place == name) for name in sorted(set(place[out]))),
              key=without_it.rms)
    return 1.0 - (with_it.rms(own) - 1.0) / (without_it.rms(own) - 1.0)


def closed_by_any(gap):
    """Fraction of a gap that noise of any colour and spread would close, without a name
    for it; NaN where nothing of the filter's residuals stands out.
    """
    out = standing_out(gap) & (np.array(gap.statistics.place) != "averaging_time")
    if not out.any():
        return np.nan
    seen, e, variance = _described(gap, LAGS, SPANS)
    z = np.full(len(gap.z), np.nan)
    z[seen] = e / np.sqrt(variance)
    d = gap.ruler.distances_of(z)
    last = np.sqrt(np.mean(d[out]**2)) - 1.0
    return float(np.clip(1.0 - last / (gap.rms(out) - 1.0), 0.0, 1.0))


def _scores(gap, *wide):
    """Log score of every sample seen by a gap's filter, its normal scores described
    flexibly, nats.
    """
    seen, e, variance = _described(gap, *wide)
    return (gap.log_score + 0.5 * gap.z**2)[seen] - 0.5 * (
        np.log(variance) + e**2 / variance)


def _described(gap, lags, spans, curves=False):
    """Samples seen by a gap's filter, what a regression on the scores before, and on
    curves of the columns, leaves of theirs, and its variance in every span.
    """
    seen = np.flatnonzero(~np.isnan(gap.z))
    z = np.nan_to_num(gap.z)
    e, before = z[seen], np.append(np.zeros(lags), z)
    white = gap.ruler.probes.whitened_curves() if curves else np.empty((0, len(z)))
    if lags or len(white):
        e = regression(lambda at: np.vstack([
            *(before[at + lags - k] for k in range(1, lags + 1)), white[:, at]]), z,
            seen)(seen)
    variance = np.concatenate([np.full(len(part), np.mean(part**2) + 1e-12)
                               for part in np.array_split(e, spans) if len(part)])
    return seen, e, variance
