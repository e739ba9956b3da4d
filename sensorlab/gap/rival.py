"""One more effect as a rival of an account: its evidence."""

from typing import NamedTuple

import numpy as np

from sensorid import free_columns
from sensorlab.gap.account import Account, account
from sensorlab.gap.effects import Effect
from sensorlab.gap.evidence import HOPELESS_NATS

MATTERS = 4.0    # nats below the best rival: what lies lower need not be known well
AT_LEAST = 0.7    # of the best ln B, or of what another screen of the scores tells: a
                  # screen that tells less is good enough


class Rival(NamedTuple):
    """One further effect, on one column or in one parameter, against none."""

    effect: Effect
    at: str              # column, or symbol of the parameter that is wrong
    log_bayes: float
    family: int = 0      # number of its family where it was sought, from 1
    stand_in: object = None    # `StandIn` of that
    account: Account = None    # with the effect in it; a signature has a family instead
    values: dict = {}    # (mean, sd) by symbol
    variant: str = ""
    chosen: Account = None    # with it, by the filter with jumps, where what stood in
                              # for these misled


def least_told(best):
    """The least ln B by a screen, or by what stands in for jumps, with which an effect
    may come near the best.
    """
    return AT_LEAST * best - MATTERS


def floor_of(acc, best):
    """Log evidence below which a rival of the best, by its ln B over an account, need
    not be known well.
    """
    return acc.log_evidence + max(HOPELESS_NATS, best - MATTERS)


def search_cost(effect, scene):
    """What the best of as many signatures as a pulse has gains by chance over the best
    of as many as a step has, nats: an account has that one alone, of a wide size.
    """
    more = len(effect.parameters(scene)) - 1 if effect.columns else 0
    return max(more, 0) * np.log(len(scene.y))


def different(forms):
    """Those (variant, hypotheses) of which no earlier one has the same filters, and
    the same noise that is louder at times.
    """
    result, known = [], []
    for variant, richer in forms:
        filters = [(*h.at_mean[-1], h.is_louder_before) for h in richer]
        if any(all(np.array_equal(a, b) for one, own in zip(filters, other)
                   for a, b in zip(one, own)) for other in known):
            continue
        known.append(filters)
        result.append((variant, richer))
    return result


def log_bayes_over(new, old):
    """ln B of a richer account: where in its ranges the base lies is no evidence
    against it, so it is no more than the likelihood ratio less Akaike's correction.
    """
    more = max(len(free_columns(h.parameters)) - len(free_columns(o.parameters))
               for h, o in zip(new.hypotheses, old.hypotheses))
    return min(new.log_evidence - old.log_evidence,
               new.peak - old.peak - max(more, 1))


def values_of(own, acc):
    """Mean and standard deviation of the parameters of one of the effects inside the
    filters of an account, under the most probable hypothesis: beside another process it
    may be another.
    """
    sample, result = acc.sample, {}
    for symbol, prior in own.values.items():
        if not prior.free:
            result[symbol] = prior.low, 0.0
            continue
        value = acc.member.value(sample.theta, own.key, symbol)
        mean = sample.weight @ value
        result[symbol] = float(mean), float(np.sqrt(sample.weight @ (value - mean)**2))
    return result


def with_signature(scene, acc, one, floor=-np.inf):
    """An account with one more signature; `floor` as for `account`."""
    return account(scene, acc.bases, acc.hypotheses, (*acc.signatures, one),
                   acc.readings, acc, floor)
