"""What rivals are worth beside none and beside each other, and the account with the
best. Where something stood in for jumps, those that may be the best are measured once
more by the filter with jumps.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from sensorid import probabilities
from sensorlab.gap.account import account
from sensorlab.gap.directed import onsets_nearby, part_about
from sensorlab.gap.evidence import HOPELESS_NATS
from sensorlab.gap.filters import log_likelihoods
from sensorlab.gap.linear import part_of
from sensorlab.gap.rival import MATTERS, log_bayes_over, with_signature

PRIOR_NONE = 0.5    # that nothing is missing
PRIOR_LAST = 0.75   # that nothing more is: a second effect is half as likely as a first
SIMPLER = 1.0 / 3.0    # of the prior of an effect that has a simpler one within it,
                       # that goes to this: a step need not be gradual (H. Jeffreys,
                       # "Theory of Probability", 1961)


class Weighed(NamedTuple):
    """What rivals are worth beside none and beside each other."""

    prior: float         # log odds of any, a priori
    alone: float         # probability of none
    share: np.ndarray    # (R,) of each rival
    groups: list         # of lists of their numbers, by effect, most probable first

    @property
    def best(self):
        """Number of the most probable rival of the most probable effect."""
        return max(self.groups, key=lambda own: self.share[own].sum())[0]


def with_best(found, by_chance, among):
    """`Weighed` of the rivals that were found, a `Sought`, and the account with the
    best in it, or None where none is as probable. What proves to be worth less or more
    on the way is so among the rivals, too.

    Where jumps see a signature elsewhere than it was sought, it is moved. To weigh it
    beside jumps, one node of its `StandIn` will do. `by_chance` and `among` as for
    `further_causes`.
    """
    inside, rivals, others = found
    scene, acc, known = inside.scene, inside.acc, {}

    def account_with(one):
        """The account with a rival, and ln B of it by that."""
        key = id(one.stand_in), one.family, id(one.account)
        if key not in known:    # by the filter with jumps it is dear
            none, count = acc.log_evidence, None
            if acc.member.has_jumps and one.family:
                none, count = none + _seen_elsewhere(scene, acc, one, 1), 1
            new = _account_with(scene, acc, one, count, none + HOPELESS_NATS)
            known[key] = one, new, (    # it stays alive
                new.log_evidence - none if one.family else log_bayes_over(new, acc))
        return known[key][1:]

    def settled(one, chosen):
        """The account with the best rival, which may be known from one node."""
        if not (acc.member.has_jumps and one.family):
            return chosen
        _seen_elsewhere(scene, acc, one)
        return _account_with(scene, acc, one)
    if acc.member.has_jumps:
        enough = -_probabilities(acc, rivals, among)[0]
        _seen_by_jumps(rivals, account_with, enough, hidden=not others)
        _seen_better(rivals, others, account_with, enough)
    else:
        rivals[:] = _over_one_base(rivals, acc)
    while True:
        prior, alone, share = _probabilities(acc, rivals, among)
        weighed = Weighed(prior, alone, share, _grouped(rivals, share))
        if alone >= 0.5:
            return weighed, None
        best = rivals[weighed.best]
        if best.chosen:
            return weighed, settled(best, best.chosen)
        if not best.family and best.account is None:    # what was told of it sufficed
            rivals[:] = [one for one in rivals if one.effect is not best.effect]
            rivals += inside.fitted(best.effect, 0.0, -np.inf)
            continue
        chosen, worth = account_with(best)
        # what stood in for the jumps may mislead
        worth = min(best.log_bayes, worth) if acc.member.has_jumps else best.log_bayes
        if by_chance:
            worth = by_chance(best.effect, worth)
        if worth == best.log_bayes:
            return weighed, settled(best, chosen)
        rivals[weighed.best] = best._replace(chosen=chosen, log_bayes=worth)


def _over_one_base(rivals, acc):
    """The rivals of an account by their own evidence over one that all share.

    Where an account is squeezed against the ends of its ranges, it is worth more than
    its evidence, see `log_bayes_over`. By how much, each rival would say by what its
    own parameters cost; what the best of them says holds.
    """
    own = [one.account.log_evidence - acc.log_evidence if one.account else one.log_bayes
           for one in rivals]
    best = int(np.argmax(own)) if own else 0
    return [one._replace(log_bayes=float(worth - own[best] + rivals[best].log_bayes))
            for one, worth in zip(rivals, own)]


def _probabilities(acc, rivals, among=1):
    """Prior log odds of a rival on average, `among` so many at least; probability of
    none, of every rival.
    """
    first = not (acc.signatures or acc.readings or len(acc.member.effects) > len(
        acc.bases[acc.best].effects))
    alone = PRIOR_NONE if first else PRIOR_LAST
    weight, number = np.ones(len(rivals)), {
        (rival.effect.name, rival.at): k for k, rival in enumerate(rivals)}
    for k, rival in enumerate(rivals):
        for simpler in np.atleast_1d(rival.effect.becomes).tolist():
            if (simpler, rival.at) in number:
                weight[[k, number[simpler, rival.at]]] += -SIMPLER, SIMPLER
        if rival.variant in rival.effect.alike:
            weight[k] /= sum(one.effect is rival.effect and one.at == rival.at
                             and one.variant in rival.effect.alike for one in rivals)
    prior = np.log((1.0 - alone) / alone / max(weight.sum(), among))
    share = probabilities([0.0, *(prior + np.log(own) + rival.log_bayes
                                  for own, rival in zip(weight, rivals))])
    return prior, share[0], share[1:]


MENTIONED = 10.0**0.5    # times as probable is worth a mention (H. Jeffreys, the same)


def _grouped(rivals, share):
    """Numbers of the rivals of each effect, most probable first: columns are rivals in
    where an effect comes from, not in what it is. Of forms that are one a priori and
    hardly differ, the first comes first.
    """
    groups = {}
    for number in np.argsort(-share):
        groups.setdefault(rivals[number].effect.name, []).append(number)
    for own in groups.values():
        best, forms = rivals[own[0]], rivals[own[0]].effect.alike
        near = [k for k in own if rivals[k].variant in forms
                and rivals[k].at == best.at and share[own[0]] <= MENTIONED * share[k]]
        if best.variant in forms:
            first = min(near, key=lambda k: forms.index(rivals[k].variant))
            own.sort(key=lambda k: k != first)
    return list(groups.values())


NEARBY = 4    # samples to either side of an onset, which what stands in for jumps hides


def _seen_elsewhere(scene, acc, rival, count=None):
    """How much less a signature, from so many nodes, is worth on average, over where
    its onset and the like may be, than where the filter with jumps sees it, nats: that
    onset, of those nearby, is its own then in its `StandIn`, which knows the average.
    """
    plain, reference = rival.stand_in.scene, rival.stand_in.account
    one, found = rival.stand_in.signature(rival.family, count)
    there = with_signature(plain, reference, one).log_evidence - reference.log_evidence
    searched = max(there - rival.log_bayes, 0.0)
    near = onsets_nearby(scene, one, NEARBY)
    if len(near) < 2:
        return searched
    part = part_about(scene, one) if acc.member.is_even and (
        reference.member.is_even) else slice(None)
    seen, sought = (np.array([log_likelihoods(own.member, *part_of(
        at, (*own.signatures, other), part), own.theta[None])[0] for other in near])
        for at, own in ((scene, acc), (plain, reference)))
    best = near[seen.argmax()]
    mean, sd = found.values["onset"]
    away = best.found.values["onset"] - one.found.values["onset"]
    middle = [other is one for other in near].index(True)
    spread = logsumexp(sought - sought[middle]) - logsumexp(seen - seen.max())
    rival.stand_in.signatures[rival.family, count] = best, found._replace(
        values={**found.values, "onset": (mean + away, sd)})
    return max(searched + spread, 0.0)


MOST_RAISED = 3    # rivals nearly as good as the best: one alone would gain on them


def _seen_by_jumps(rivals, account_with, enough, hidden):
    """The best of the rivals that were sought where something stands in for jumps,
    signatures and processes, where the filter with jumps sees more of them; `enough`
    and `hidden` as for `_near_best`.
    """
    signatures = [k for k, one in enumerate(rivals) if one.family]
    processes = [k for k, one in enumerate(rivals) if one.account and one.effect.model
                 and not one.effect.jumps]
    for k in [*_near_best(rivals, signatures, enough, hidden),
              *_near_best(rivals, processes, enough, hidden)]:
        chosen, worth = account_with(rivals[k])
        if worth > rivals[k].log_bayes:
            rivals[k] = rivals[k]._replace(chosen=chosen, log_bayes=worth)


def _near_best(rivals, some, enough, hidden=False):
    """Numbers of those rivals, among some, that may be the best of them, and as
    probable as none, for which a ln B is `enough`; where they may be `hidden`, one at
    least.
    """
    some = sorted(some, key=lambda k: -rivals[k].log_bayes)[:MOST_RAISED]
    best = max(rivals[some[0]].log_bayes, enough) if some else 0.0
    least = max(best - MATTERS, 0.0)
    near = [k for k in some if rivals[k].log_bayes >= least]
    return near or some[:hidden]


def _seen_better(rivals, others, account_with, enough):
    """The best of others, which are signatures, in the place of the same among the
    rivals, where the filter with jumps sees more of them; `enough` as for `_near_best`.
    """
    def kind(one):
        family = one.stand_in.listed[one.family - 1]
        return family.effect, family.column, family.low_pass
    number = {kind(one): k for k, one in enumerate(rivals) if one.family}
    some = [k for k, one in enumerate(others) if kind(one) in number]
    for other in (others[k] for k in _near_best(others, some, enough)):
        chosen, worth = account_with(other)
        k = number[kind(other)]
        if rivals[k].log_bayes > worth and not rivals[k].chosen:
            own, of_own = account_with(rivals[k])
            rivals[k] = rivals[k]._replace(chosen=own, log_bayes=min(
                of_own, rivals[k].log_bayes))
        if rivals[k].log_bayes < worth:
            rivals[k] = other._replace(chosen=chosen, log_bayes=worth)


def _account_with(scene, acc, best, count=None, floor=-np.inf):
    """The account with a rival in it, a signature from so many nodes; `floor` as for
    `account`, of filters with jumps.
    """
    floor = floor if acc.member.has_jumps else -np.inf
    if best.family:
        signature, _ = best.stand_in.signature(best.family, count)
        return with_signature(scene, acc, signature, floor)
    if acc.member.has_jumps and best.effect.model and not best.effect.jumps:
        return account(scene, acc.bases,
                       [h.joined(own.effects[-1]) for h, own in zip(
                           acc.hypotheses, best.account.hypotheses)],
                       acc.signatures, acc.readings, acc, floor)
    return best.account
