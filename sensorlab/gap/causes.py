"""Which effect: probabilities of all that may be missing, one at a time, Eq. (10)."""

from typing import NamedTuple

import numpy as np

from sensorid import brief
from sensorlab.gap.account import Account, evidence_error
from sensorlab.gap.costs import say
from sensorlab.gap.effects import Effect, Found
from sensorlab.gap.evidence import effort
from sensorlab.gap.rival import least_told
from sensorlab.gap.sought import NO_OTHER, sought
from sensorlab.gap.weighing import with_best

UNKNOWN = Effect("unknown")    # something that is in no catalogue


class Cause(NamedTuple):
    """A set of effects as the explanation of a record; the empty one is `none`."""

    found: tuple          # of Found, in the order found; values are (mean, sd)
    probability: float
    log_bayes: float
    error: float = 0.0    # standard deviation of the probability by chance of the nodes
                          # and records that it is computed from

    @property
    def effects(self):
        """Their names."""
        return tuple(one.name for one in self.found)

    @property
    def names(self):
        """Their names in whatever order they were found; unknown is the last."""
        return tuple(sorted(self.effects, key=lambda name: (name == "unknown", name)))

    @property
    def effect(self):
        """Their names as one."""
        return "+".join(self.effects) or "none"

    @property
    def column(self):
        """Their columns as one; "a or b" where columns are alike."""
        return "+".join(one.column for one in self.found if one.column)

    @property
    def parameters(self):
        """Values by name: symbol, or effect.symbol where there are several effects; one
        found again is number 2.
        """
        result = {}
        for one in self.found:
            for symbol, value in one.values.items():
                number, key = 1, symbol
                if len(self.found) > 1:
                    key = f"{one.name}.{symbol}"
                while key in result:
                    number += 1
                    key = f"{one.name}_{number}.{symbol}"
                result[key] = value
        return result


class Further(NamedTuple):
    """One look for a further effect."""

    causes: tuple      # of Cause, most probable first, none among them
    account: Account   # with the most probable effect in it; None where it is none
    prior: float       # log odds of any one further effect, a priori
    few_steps: bool = False    # are steps at random the best, but few?

    __repr__ = brief


LISTED_FROM = 0.01  # probability from which on a cause is worth its parameters, which
                    # cost a long record more


def further_causes(scene, acc, effects, processes=True, by_chance=None,
                   known=NO_OTHER, among=1):
    """`Further`: probability of every further effect, Eq. (10), and the best account.

    Without `processes`, for signatures, jumps and changes. `by_chance`, a function of
    an effect and its ln B, gives what is left of that less chance; `known` is the name
    of an effect of which ln B is known, and that; without a name it is what others
    have, and if all here come to far less, none is told of. Each is as likely as one
    `among` so many, a priori, if there are fewer here.
    """
    found = sought(scene, acc, effects, processes, known)
    inside, rivals, others = found
    name, least = known
    if not name and max([0.0, *(one.log_bayes for one in [*rivals, *others])]
                        ) < least_told(least):
        return Further((Cause((), 1.0, 0.0),), None, -np.inf)
    say("weighing", 2)
    weighed, chosen = with_best(found, by_chance, among)
    prior, alone, share, groups = weighed
    error = _errors(alone, share, groups, np.array([
        _error(rival, acc) for rival in rivals]))
    causes = [Cause((), float(alone), 0.0, error[0])]
    for group, off in zip(groups, error[1:]):
        rival, probability = rivals[group[0]], share[group].sum()
        column = "" if rival.effect.factor else _either(list(dict.fromkeys(
            rivals[i].at for i in group if rivals[i].at
            and share[i] > 0.1 * share[group[0]])))
        if rival.family and (probability > LISTED_FROM / effort(scene)
                             or chosen and group[0] == weighed.best):
            _, one = rival.stand_in.signature(rival.family)
        else:
            one = Found(rival.effect, "", rival.variant, rival.values,
                        float(share[group[0]] / max(probability, 1e-300)))
        causes.append(Cause((one._replace(column=column),), float(probability),
                            float(rival.log_bayes), off))
    causes.sort(key=lambda c: -c.probability)
    return Further(tuple(causes), chosen, prior, inside.worth_of_few >= max(
        [0.0, *(one.log_bayes for one in rivals)]))


def _error(rival, acc):
    """Standard deviation of ln B of a rival by chance of the nodes, nats."""
    if rival.family:
        return evidence_error(rival.stand_in.samples, rival.family)
    return np.hypot(rival.account.error, acc.error) if rival.account else 0.0


def _errors(alone, share, groups, off):
    """Standard deviations of the probabilities of none and of groups of rivals, of
    probabilities `share` (R,), whose ln B have the standard deviations `off` (R,).
    """
    total = [alone] + [share[group].sum() for group in groups]
    own = np.zeros((len(total), len(share)))
    for number, group in enumerate(groups, 1):
        own[number, group] = 1.0
    slope = share * (own - np.array(total)[:, None])
    return np.sqrt((slope * off)**2 @ np.ones(len(share))).tolist()


def _either(columns):
    """Columns of which any may be the cause, as text."""
    return " or ".join(columns if len(columns) <= 3 else
                       [*columns[:2], f"{len(columns) - 2} others"])
