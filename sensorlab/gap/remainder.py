"""The remainder: what each effect that was found closes, what is left when all are
added, and which of them are needed whatever that is.
"""

from typing import NamedTuple

import numpy as np

from sensorlab.gap.closure import standing_out
from sensorlab.gap.flexible import stays_needed
from sensorlab.gap.refits import without


class Part(NamedTuple):
    """What one of the effects that were found does."""

    share: float    # of the gap, which comes back when it alone is taken out again
    stays: bool     # is it needed where the remainder is described flexibly?


class Remainder(NamedTuple):
    """What is left of a gap when all that was found is added."""

    share: float     # of the gap, over all that stands out before or after
    p_value: float
    where: int       # number of the statistic that stands out most; -1 if none does


def remainder(before, after):
    """`Remainder` of two gaps, to the simulator without and with the effects."""
    late = standing_out(after)
    out = standing_out(before) | late
    if not out.any():
        return Remainder(0.0, after.p_value, -1)
    first, last = before.rms(out) - 1.0, after.rms(out) - 1.0
    share = np.clip(last / max(first, last), 0.0, 1.0) if last > 0.0 else 0.0
    where = int(np.abs(after.distance).argmax()) if late.any() else -1
    return Remainder(float(share), after.p_value, where)


TRIALS_WITHOUT = 60    # simulated records behind a share


def parts(full, path, acc, lesser, closed, before, after, measured):
    """`Part` of every effect of a path; `lesser` as in `Search`, `closed` is the
    `Closure` by all of them, `measured` gives the `Gap` to an account.
    """
    if len(path.found) == 1:
        return (_part(path.found[0], closed.closed, before, after),)
    out, result = standing_out(before), []
    beyond = {r.found.effect.reading: r.log_bayes for r in acc.readings if r.beyond}
    for number, one in enumerate(path.found):
        if one.effect.reading in beyond:    # there is no gap to measure without it
            result.append(Part(float(np.clip(
                beyond[one.effect.reading] / path.log_bayes, 0.0, 1.0)), True))
            continue
        less = lesser.get(number) or without(full, acc, path.found, number)
        gap = measured(less, after, TRIALS_WITHOUT, None)
        share = (gap.rms(out) - after.rms(out)) / (before.rms(out) - 1.0) if (
            out.any()) else (acc.log_evidence - less.log_evidence) / path.log_bayes
        again = any(one.column and other.column == one.column
                    for other in path.found[:number])
        result.append(_part(one, share, gap, after, again))
    return tuple(result)


SLIGHT = 0.05    # share of the gap that is not worth a word


def _part(one, share, without_it, with_it, again=False):
    """`Part` of an effect that closes a share, NaN if nobody knows, by two gaps; see
    `stays_needed`. A parameter that closes nothing is not to be changed: it makes room
    for the law of something else.
    """
    stays = not (one.effect.factor and share < SLIGHT) and stays_needed(
        one.effect, without_it, with_it, again)
    return Part(float(np.clip(share, 0.0, 1.0)), stays)
