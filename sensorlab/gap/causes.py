"""Which effect: probabilities of all that may be missing, one at a time, Eq. (10)."""

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from sensorid import brief, probabilities
from sensorlab.gap.account import Account, account, evidence_error, mean_evidence
from sensorlab.gap.costs import say
from sensorlab.gap.directed import (
    directed, estimate_signature, onsets_nearby, part_about)
from sensorlab.gap.effects import Effect, Found
from sensorlab.gap.evidence import HOPELESS_NATS, effort
from sensorlab.gap.filters import log_likelihoods
from sensorlab.gap.inside import Inside, rests_on_rounding, with_filters
from sensorlab.gap.linear import part_of
from sensorlab.gap.lowpass import families_passing, low_pass_of
from sensorlab.gap.rival import (
    MATTERS, Rival, floor_of, least_told, log_bayes_over, with_signature)
from sensorlab.gap.signatures import families
from sensorlab.gap.standins import stand_ins
from sensorlab.gap.wrong import (
    with_wrong_parameters, with_wrong_scale, with_wrong_sizes)

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
PRIOR_NONE = 0.5    # that nothing is missing
PRIOR_LAST = 0.75   # that nothing more is: a second effect is half as likely as a first
SIMPLER = 1.0 / 3.0    # of the prior of an effect that has a simpler one within it,
                       # that goes to this: a step need not be gradual (H. Jeffreys,
                       # "Theory of Probability", 1961)
NO_OTHER = "", 0.0     # of which ln B is known


def further_causes(scene, acc, effects, processes=True, by_chance=None,
                   known=NO_OTHER, among=1):
    """`Further`: probability of every further effect, Eq. (10), and the best account.

    Without `processes`, for signatures, jumps and changes. `by_chance`, a function of
    an effect and its ln B, gives what is left of that less chance; `known` is the name
    of an effect of which ln B is known, and that; without a name it is what others
    have, and if all here come to far less, none is told of. Each is as likely as one
    `among` so many, a priori, if there are fewer here.
    """
    inside, plain, reference, listed, samples, grids, rivals = _sought(
        scene, acc, effects, processes, known)
    name, least = known
    if not name and max([0.0, *(one.log_bayes for one in rivals)]) < least_told(least):
        return Further((Cause((), 1.0, 0.0),), None, -np.inf)
    say("weighing", 2)

    def estimated(number, count=None):
        return estimate_signature(plain, reference, listed[number - 1], samples, number,
                                  grids, count)
    signatures = _Estimated(estimated)
    weighed, chosen = _with_best(inside, plain, reference, rivals, signatures,
                                 _Estimated(lambda number: estimated(number, 1)),
                                 by_chance, among)
    prior, alone, share, groups = weighed
    error = _errors(alone, share, groups, np.array([
        _error(rival, acc, samples) for rival in rivals]))
    causes = [Cause((), float(alone), 0.0, error[0])]
    for group, off in zip(groups, error[1:]):
        rival, probability = rivals[group[0]], share[group].sum()
        column = "" if rival.effect.factor else _either(list(dict.fromkeys(
            rivals[i].at for i in group if rivals[i].at
            and share[i] > 0.1 * share[group[0]])))
        if rival.family and (probability > LISTED_FROM / effort(scene)
                             or chosen and group[0] == weighed.best):
            _, one = signatures[rival.family]
        else:
            one = Found(rival.effect, "", rival.variant, rival.values,
                        float(share[group[0]] / max(probability, 1e-300)))
        causes.append(Cause((one._replace(column=column),), float(probability),
                            float(rival.log_bayes), off))
    causes.sort(key=lambda c: -c.probability)
    return Further(tuple(causes), chosen, prior, inside.worth_of_few >= max(
        [0.0, *(one.log_bayes for one in rivals)]))


class _Estimated(dict):
    """`Signature` and `Found` of families by number, estimated when they are asked for.
    """

    def __init__(self, estimate):
        self._estimate = estimate

    def __missing__(self, number):
        self[number] = self._estimate(number)
        return self[number]


class _Sought(NamedTuple):
    """What was found of further effects."""

    inside: object       # Inside: where those inside the filter were sought
    plain: object        # Scene without jumps, where signatures were
    reference: Account   # of that scene
    listed: list         # of Family
    samples: list        # of Sample: their evidence, one of every hypothesis
    grids: dict          # number of a family -> `Grid` where it was resolved
    rivals: list         # of Rival


def _sought(scene, acc, effects, processes=True, known=NO_OTHER):
    """`_Sought` of some effects; see `further_causes`."""
    if acc.member.steps:    # what begins at some time is one more step, or two
        effects = [e for e in effects if not (e.columns and e.search in (
            "onset", "pulse"))]
    for_signatures, for_others = stand_ins(scene, acc)
    plain, reference = _without_jumps(scene, acc, for_signatures)
    listed = families(plain, effects, acc.signatures)
    low_pass = low_pass_of(acc.member, acc.theta)
    if low_pass:
        listed += families_passing(low_pass, listed)
    say("looking for signatures", 4)
    name, best = known
    samples = directed(plain, reference, listed, grids=(grids := {}),
                       least=0.0 if name else least_told(best))
    rivals = _with_signatures(listed, samples)
    even, of_even = _without_jumps(scene, acc, for_others, (plain, reference))
    inside = Inside(scene, even, acc, of_even)
    rivals += with_filters(inside, effects, processes, max(
        [best, *(one.log_bayes for one in rivals)]), name)
    wrong = [effect for effect in effects if effect.factor]
    if processes:
        floor = floor_of(acc, max([best, *(one.log_bayes for one in rivals)]))
        rivals += [rival for effect in wrong
                   for wrongly in (with_wrong_parameters, with_wrong_scale)
                   for rival in wrongly(scene, acc, effect, floor)
                   if not rests_on_rounding(rival.account, scene)]
    rivals += [rival for effect in wrong
               for rival in with_wrong_sizes(scene, acc, effect)]
    return _Sought(inside, plain, reference, listed, samples, grids, rivals)


def largest_bayes(scene, acc, effect):
    """Largest ln B of one further effect in any form; 0 if nothing is for it."""
    return max([0.0, *(one.log_bayes for one in _sought(scene, acc, [effect]).rivals)])


def _without_jumps(scene, acc, stand_in, like=None):
    """The scene and the account where another effect is sought, of a scene and
    hypotheses that stand in for those with jumps; those like it, if they are the same.
    """
    plain, hypotheses = stand_in
    if plain is scene:
        return scene, acc
    if like and hypotheses == like[1].hypotheses and np.array_equal(
            plain.y, like[0].y, equal_nan=True):
        return like
    return plain, account(plain, hypotheses, signatures=acc.signatures, past=acc)


def search_cost(effect, scene):
    """What the best of as many signatures as a pulse has gains by chance over the best
    of as many as a step has, nats: an account has that one alone, of a wide size.
    """
    more = len(effect.parameters(scene)) - 1 if effect.columns else 0
    return max(more, 0) * np.log(len(scene.y))


def _with_signatures(listed, samples):
    """Rivals that are signatures."""
    table = np.array([s.log_evidence for s in samples])
    base = mean_evidence(table[:, 0])
    return [Rival(family.effect, family.column, mean_evidence(table[:, number]) - base,
                   number) for number, family in enumerate(listed, 1)]


def _probabilities(acc, rivals, among=1):
    """Prior log odds of a rival on average, `among` so many at least; probability of
    none, of every rival.
    """
    first = not (acc.signatures or acc.readings or len(acc.member.effects) > len(
        acc.bases[acc.best].effects))
    alone = PRIOR_NONE if first else PRIOR_LAST
    prior = np.log((1.0 - alone) / alone / max(len(rivals), among))
    weight, number = np.ones(len(rivals)), {
        (rival.effect.name, rival.at): k for k, rival in enumerate(rivals)}
    for k, rival in enumerate(rivals):
        for simpler in np.atleast_1d(rival.effect.becomes).tolist():
            if (simpler, rival.at) in number:
                weight[[k, number[simpler, rival.at]]] += -SIMPLER, SIMPLER
        if rival.variant in rival.effect.alike:
            weight[k] /= sum(one.effect is rival.effect and one.at == rival.at
                             and one.variant in rival.effect.alike for one in rivals)
    share = probabilities([0.0, *(prior + np.log(own) + rival.log_bayes
                                  for own, rival in zip(weight, rivals))])
    return prior, share[0], share[1:]


def _error(rival, acc, samples):
    """Standard deviation of ln B of a rival by chance of the nodes, nats."""
    if rival.family:
        return evidence_error(samples, rival.family)
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


def _grouped(rivals, share):
    """Numbers of the rivals of each effect, most probable first: columns are rivals in
    where an effect comes from, not in what it is.
    """
    groups = {}
    for number in np.argsort(-share):
        groups.setdefault(rivals[number].effect.name, []).append(number)
    return list(groups.values())


def _either(columns):
    """Columns of which any may be the cause, as text."""
    return " or ".join(columns if len(columns) <= 3 else
                       [*columns[:2], f"{len(columns) - 2} others"])


class _Weighed(NamedTuple):
    """What rivals are worth beside none and beside each other."""

    prior: float         # log odds of any, a priori
    alone: float         # probability of none
    share: np.ndarray    # (R,) of each rival
    groups: list         # of lists of their numbers, by effect, most probable first

    @property
    def best(self):
        """Number of the most probable rival of the most probable effect."""
        return max(self.groups, key=lambda own: self.share[own].sum())[0]


def _with_best(inside, plain, reference, rivals, signatures, glimpsed, by_chance,
               among):
    """`_Weighed` of the rivals, and the account with the best in it, or None where none
    is as probable. What proves to be worth less or more on the way is so among the
    rivals, too.

    The `signatures` of families, by number, were sought in the scene `plain`, of which
    `reference` is the account; where jumps see one elsewhere, it is moved. To weigh
    them beside jumps, those `glimpsed` at one node will do. `by_chance` and `among` as
    for `further_causes`.
    """
    scene, acc, known = inside.scene, inside.acc, {}

    def account_with(one):
        """The account with a rival, and ln B of it by that."""
        key = one.family, id(one.account)
        if key not in known:    # by the filter with jumps it is dear
            none, some = acc.log_evidence, signatures
            if plain is not scene and one.family:
                none, some = none + seen_elsewhere(one, glimpsed), glimpsed
            new = _account_with(scene, plain, acc, one, some, none + HOPELESS_NATS)
            known[key] = one.account, new, (    # it stays alive
                new.log_evidence - none if one.family else log_bayes_over(new, acc))
        return known[key][1:]

    def seen_elsewhere(one, some):
        searched, some[one.family] = _seen_elsewhere(
            scene, acc, plain, reference, one, *some[one.family])
        return searched

    def settled(one, chosen):
        """The account with the best rival, which may be known by a glimpse."""
        if plain is scene or not one.family:
            return chosen
        seen_elsewhere(one, signatures)
        return _account_with(scene, plain, acc, one, signatures)
    if plain is not scene:
        _seen_by_jumps(rivals, account_with)
    while True:
        prior, alone, share = _probabilities(acc, rivals, among)
        weighed = _Weighed(prior, alone, share, _grouped(rivals, share))
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
        worth = best.log_bayes if plain is scene else min(best.log_bayes, worth)
        if by_chance:
            worth = by_chance(best.effect, worth)
        if worth == best.log_bayes:
            return weighed, settled(best, chosen)
        rivals[weighed.best] = best._replace(chosen=chosen, log_bayes=worth)


NEARBY = 4    # samples to either side of an onset, which what stands in for jumps hides


def _seen_elsewhere(scene, acc, plain, reference, rival, one, found):
    """How much less a signature is worth on average, over where its onset and the like
    may be, than where the filter with jumps sees it, nats; and the pair of `Signature`
    and `Found` with the onset, of those nearby, that it sees.

    It was sought in the scene `plain`, where its average is known.
    """
    there = with_signature(plain, reference, one).log_evidence - reference.log_evidence
    searched = max(there - rival.log_bayes, 0.0)
    near = onsets_nearby(scene, one, NEARBY)
    if len(near) < 2:
        return searched, (one, found)
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
    return max(searched + spread, 0.0), (best, found._replace(
        values={**found.values, "onset": (mean + away, sd)}))


MOST_RAISED = 3    # rivals nearly as good as the best: one alone would gain on them


def _seen_by_jumps(rivals, account_with):
    """The best of the rivals that were sought where something stands in for jumps,
    signatures and processes, where the filter with jumps sees more of them.
    """
    for listed in True, False:
        own = sorted((k for k, one in enumerate(rivals) if not one.effect.jumps
                      and (one.family > 0) == listed and (
                          listed or one.account and one.effect.model)),
                     key=lambda k: -rivals[k].log_bayes)[:MOST_RAISED]
        least = max(rivals[own[0]].log_bayes - MATTERS, 0.0) if own else 0.0
        for k in own:
            if k != own[0] and rivals[k].log_bayes < least:
                break
            chosen, worth = account_with(rivals[k])
            if worth > rivals[k].log_bayes:
                rivals[k] = rivals[k]._replace(chosen=chosen, log_bayes=worth)


def _account_with(scene, plain, acc, best, signatures, floor=-np.inf):
    """The account with a rival in it; `floor` as for `account`, of filters with jumps.
    """
    floor = -np.inf if plain is scene else floor
    if best.family:
        return with_signature(scene, acc, signatures[best.family][0], floor)
    if plain is not scene and best.effect.model and not best.effect.jumps:
        return account(scene, acc.bases,
                       [h.joined(own.effects[-1]) for h, own in zip(
                           acc.hypotheses, best.account.hypotheses)],
                       acc.signatures, acc.readings, acc, floor)
    return best.account
