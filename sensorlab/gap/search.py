"""The search for a set of effects: one more at a time; what is needless is dropped, and
what another effect explains better beside all others is exchanged.
"""

import functools
from typing import NamedTuple

import numpy as np

from sensorid import brief, probabilities
from sensorlab.gap.account import Account, account
from sensorlab.gap.causes import Cause, further_causes
from sensorlab.gap.costs import heard_by, say
from sensorlab.gap.distance import Gap
from sensorlab.gap.draws import simulate_effects
from sensorlab.gap.evidence import HOPELESS_NATS, effort
from sensorlab.gap.flexible import stays_needed
from sensorlab.gap.implied import as_simulated, in_place
from sensorlab.gap.inside import MANY_STEPS
from sensorlab.gap.pairs import best_pair
from sensorlab.gap.readings import as_read, hide
from sensorlab.gap.refits import in_best_forms, without
from sensorlab.gap.rival import search_cost
from sensorlab.gap.sought import largest_bayes
from sensorlab.gap.weighing import PRIOR_LAST
from sensorlab.gap.wrong import pushes

MAX_NOISES = 6          # effects beside readings that the filter must follow: columns
                        # cost little
MAX_DOUBTFUL = 3        # one after another that may stand in for something unknown
MAX_LOOKS = 8           # with what the simulator's own records show, too
MAX_EXCHANGES = 2
EXPLAINED = 0.01        # p-value of what is left, below which no set is the right one
                        # and their evidence does not tell which is nearest
MAX_ASKED = 3           # effects that may be exchanged: those that are needed least
LOOK_ON = 0.2           # p-value from which on no second process is looked for


class Search(NamedTuple):
    """How far the search for effects has come."""

    account: Account
    lesser: dict      # number of an effect of the path -> account without it, as far as
                      # they are known
    path: Cause       # what has been found, with the probability of having gone there
    leaves: dict      # name of a set of effects -> Cause: where the search could stop
    after: Gap
    left: float       # ln B of the best that is not added; 0 if nothing is for it
    other: object = None    # `Search` for what happens at some time alone, if steps at
                            # random were the best, but few, and it did not go on there
    shared: tuple = ()    # of Found: what the account has as the simulator's records do

    __repr__ = brief


def search(full, start, readings, effects, before, glanced, twins=None, among=1,
           looks=MAX_LOOKS, least=-np.inf):
    """`Search` from an account with the readings of a record on, which are a `Cause`,
    until nothing more is found, in so many looks at most.

    `glanced` gives the `Gap` to an account, quicker beside that to a like one. Where
    few steps at random would be the best, what happens at some time is sought alone: a
    process tells more than the first of several steps. An effect that the simulator's
    own records have, too, its `Twins` if they are known, is described, but nothing that
    is missing. `among` as for `further_causes`. It stops where a path of the `least`
    ln B is out of reach: what is found next seldom tells more than what was.
    """
    scene, acc, path = as_read(full, start.readings), start, readings
    coarse = any(r.coarse for r in start.readings)
    noises, doubtful, exchanges, left, settled = 0, 0, 0, 0.0, 1
    leaves, after, lesser, other, shared = {}, before, {}, None, ()
    asked = twins or any(one.effect.search == "onset" for one in path.found)
    if path.found:
        after = glanced(acc)
    looks, latest = 0 if any(r.opaque for r in start.readings) else looks, np.inf
    for remaining in range(looks, 0, -1):
        if noises == MAX_NOISES or doubtful == MAX_DOUBTFUL or (
                path.log_bayes + remaining * latest < least):
            break
        # a process shows in the undirected statistics, if it is there, or in parameters
        # that are at an end of their range in its place; jumps and changes may not
        look = further_causes(scene, acc, effects, not path.found or
                              after.p_value < LOOK_ON or pushes(acc),
                              _by_rounding(full, acc, after.theta) if coarse else None,
                              among=among)
        if look.few_steps and not asked:
            asked, other = True, _at_some_time(path, effects, lambda some: search(
                full, acc, path, some, before, glanced, None, len(effects), MANY_STEPS))
            if other and other.after.p_value > EXPLAINED:
                best = next(c for c in look.causes if c.found)
                better = _of_both(Search(
                    acc, lesser, _joined(path, best), _with_leaves(leaves, path, look),
                    after, left), other, len(effects))
                if better.path is other.path:
                    acc, lesser, path, leaves, after, *_ = better
                    other = None
                    continue
        if look.account is not None and not coarse:
            look = _or_a_pair(scene, acc, look, effects, functools.partial(
                _describes, scene, glanced, look.account, after))
        found = [c for c in look.causes if c.found]
        left, known = max([0.0, *(c.log_bayes for c in found)]), None
        if twins and look.account is not None and len(found[0].found) == 1:
            known = twins.have(found[0].found[0], look.account, scene)
            look = look._replace(causes=_unless_shared(look.causes, known.probability))
        others, leaves = leaves, _with_leaves(leaves, path, look)
        if look.account is None:
            better = not coarse and exchanges < MAX_EXCHANGES and (
                after.p_value > EXPLAINED) and (
                _exchanged(full, acc, path, leaves, lesser, effects, twins, settled))
            same = acc
            if better:
                acc, lesser, path, leaves = better
            if acc is same:
                return Search(acc, lesser, path, leaves, after, left, other, shared)
            exchanges, settled = exchanges + 1, 1
            after = glanced(acc, after)
            continue
        best = next(c for c in look.causes if c.found)
        missing = sum(c.probability for c in look.causes if c.found)
        if known and missing < 0.5:
            twins.describe(known.account)
            leaves = {**others, **{key: c for key, c in leaves.items()
                                   if len(c.found) > len(path.found)}}
            acc, path, lesser = look.account, scaled(path, 1.0 - missing, 0.0), {}
            shared = *shared, best.found[0]
            if best.found[0].effect.columns:    # those of the simulator come first
                acc = acc._replace(signatures=(acc.signatures[-1],
                                               *acc.signatures[:-1]))
            after = glanced(acc, after)
            continue
        settled = int(len(best.found) == 1)    # of a pair neither is the best alone
        latest = best.log_bayes
        noises += sum(not one.effect.columns for one in best.found)
        acc, path = look.account, _joined(path, best)
        leaves.pop(path.effect)
        acc, lesser, path, leaves = _without_needless(full, acc, path, leaves,
                                                      look.prior)
        formed = in_best_forms(full, acc, path.found)
        if formed is not acc:
            path, lesser = path._replace(
                log_bayes=path.log_bayes + formed.log_evidence - acc.log_evidence), {}
            acc = formed
        last, after = after, glanced(acc, after)
        needed = stays_needed(best.found[-1].effect, last, after)
        doubtful = 0 if needed else doubtful + 1
    return Search(acc, lesser, path, {**leaves, path.effect: path}, after, left, other,
                  shared)


def _unless_shared(causes, theirs):
    """Causes of what a record shows, if the simulator's own records have it, too, with
    this probability: then nothing is missing.
    """
    some = sum(c.probability for c in causes if c.found)
    return tuple(scaled(c, 1.0 - theirs, 0.0) if c.found else c._replace(
        probability=c.probability + theirs * some) for c in causes)


GRADUAL = "gradual_step"    # it takes its time


def _at_some_time(path, effects, searched):
    """What both find that is `searched` for steps alone beside a path, and for pulses,
    too; None if that is not few, or no step is among the effects.
    """
    steps, pulses = ([e for e in effects if e.columns and e.search == kind
                      and e.name != GRADUAL] for kind in ("onset", "pulse"))
    if steps:
        alone = searched(steps)
        if len(alone.path.found) < len(path.found) + MANY_STEPS:
            return _of_both(alone, searched([*steps, *pulses]), len(effects)
                            ) if pulses else alone


def beside_steps(full, done, again, effects):
    """A search, or a better one: the other that it has; or one `again` without steps at
    random, if these leave something: they come near to whatever stays for a while. What
    that is shows the more, the longer a record.
    """
    other = done.other
    if other and other.after.p_value < LOOK_ON:
        other = again(effects, other.account, other.path, done.path.log_bayes)
    elif not other and "random_steps" in done.path.effects and (
            done.after.p_value < LOOK_ON * effort(full)):
        other = again([e for e in effects if e.name != "random_steps"],
                      least=done.path.log_bayes)
    return _of_both(done, other, len(effects)) if other else done


def _of_both(one, other, count):
    """The better of two searches among so many effects, with the leaves of both."""
    worth = [_worth(own.path, count) for own in (one, other)]
    (share, rest), (best, lesser) = probabilities(worth), (one, other)
    if rest > share:
        (share, rest), (best, lesser) = (rest, share), (other, one)

    def scaled_leaves(own, part):
        total = sum(c.probability for c in own.leaves.values())
        return {key: scaled(c, part / total, 0.0) for key, c in own.leaves.items()}
    leaves = scaled_leaves(best, share)
    keys = {c.names: key for key, c in leaves.items()}
    for key, c in scaled_leaves(lesser, rest).items():
        known = leaves.get(keys.get(c.names, key))
        leaves[keys.get(c.names, key)] = known._replace(
            probability=known.probability + c.probability,
            error=float(np.hypot(known.error, c.error))) if known else c
    return best._replace(leaves=leaves)


def _worth(path, count):
    """ln B of a path, and of its prior: as one of so many effects each is as likely as
    any; that one is there once more, as that any is.
    """
    more = len(path.found) - len({*path.effects})
    return path.log_bayes - np.log(count) * len({*path.effects}) - more * np.log(
        PRIOR_LAST / (1.0 - PRIOR_LAST))


HELD_AGAINST = 12    # simulated records, fewer for a long record, ...
MOST_AGAIN = 8       # ... and as many again, so many times at most, ...
UNSURE = 2.0, 10.0   # ... where an effect lies so many of their standard deviations
                     # beyond them: fewer name none, more leave no doubt
THEIR_SEED = 1


def _by_rounding(full, acc, theta):
    """Function of an effect and its ln B that gives what is left of that less chance:
    what rounding to counts coarser than the noise adds is no white noise, and may look
    like an effect. Records of the simulator of an account at theta, where there is
    none, tell; beyond the largest of theirs, chance is an exponential law as wide as
    they scatter. Few seldom hold the largest that chance makes: there are more where an
    effect is not far beyond them. Where counts hide what theirs are, none tells of this
    one.
    """
    scene = as_read(full, acc.readings)
    simulator = in_place(as_simulated(acc, scene, theta), acc, scene)
    number = round(HELD_AGAINST * effort(full))
    (lsb,) = (r.cell for r in acc.readings if r.coarse)

    @functools.cache
    def drawn(again):
        """Of so many records the accounts of those whose counts do not hide them."""
        some = simulate_effects(simulator, full, number, THEIR_SEED + again).error
        read = [as_read(full._replace(y=y), acc.readings)
                for y in some if not hide(y, lsb)]
        return [(scene, account(scene, acc.bases, acc.hypotheses, acc.signatures,
                                acc.readings, acc)) for scene in read]

    @functools.cache
    def theirs(effect, again):
        say(f"looking for {effect.name.replace('_', ' ')} where there is none", 4)
        with heard_by(None, 0):
            return [largest_bayes(*one, effect) for one in drawn(again)]

    def beyond(effect, log_bayes):
        told, left = [], log_bayes
        for again in range(MOST_AGAIN):
            told += theirs(effect, again)
            if told:
                left = log_bayes - max(told)
                left /= max(np.std(told), 1.0) if left > 0.0 else 1.0
                if not UNSURE[0] < left < UNSURE[1]:
                    break
        return left
    return beyond


def narrowed(full, done, names, glanced):
    """A search with only those effects of its path that have certain names."""
    acc, path = reduced(full, done, names)
    return Search(acc, done.lesser if acc is done.account else {}, path,
                  {path.effect: path}, glanced(acc), done.left)


def reduced(full, done, names):
    """The account and the path of a search with only those effects."""
    acc, lesser, path = done.account, done.lesser, done.path
    for number, one in reversed(list(enumerate(path.found))):
        if one.name not in names:
            acc, path = _less(full, acc, lesser, path, number)
            lesser = {}
    return acc, path


def _less(full, acc, lesser, path, number, floor=-np.inf):
    """An account and a path without effect `number` of those found; `lesser` as in
    `Search`, `floor` as for `account`.
    """
    less = lesser.get(number) or without(full, acc, path.found, number, floor)
    return less, path._replace(
        found=path.found[:number] + path.found[number + 1:],
        log_bayes=path.log_bayes + less.log_evidence - acc.log_evidence)


def _without_needless(full, acc, path, leaves, prior):
    """The account and the path without what was found before and is not needed beside
    what is found now: what one effect seemed to be two others may explain.
    """
    lesser, every = {}, path.found
    for number, one in reversed(list(enumerate(path.found[:-1]))):
        if one.effect.reading:
            continue
        even = acc.log_evidence + prior - search_cost(one.effect, full)
        less, rest = _less(full, acc, {}, path, number, even)
        log_odds = even - less.log_evidence
        if log_odds < 0.0:
            kept = 1.0 / (1.0 + np.exp(-log_odds))
            leaves = {**leaves, path.effect: scaled(path, kept, 0.0)}
            acc, path, lesser = less, scaled(rest, 1.0 - kept, 0.0), {}
            leaves.pop(path.effect, None)
        elif log_odds < HOPELESS_NATS:    # it is known well
            lesser[number] = less
    if len(path.found) < len(every):
        for one in path.found:
            again = _sought_again(full, acc, path, one)
            if again:
                acc, path, lesser = *again, {}
                leaves.pop(path.effect, None)
    return acc, lesser, path, leaves


def _sought_again(full, acc, path, one):
    """An account and a path in which one of its effects is sought again, or None:
    beside what is dropped now it had another onset or duration.
    """
    scene = as_read(full, acc.readings)
    if not (one.effect.columns and one.effect.parameters(scene)):
        return None
    number = next(k for k, other in enumerate(path.found) if other is one)
    less, rest = _less(full, acc, {}, path, number)
    look = further_causes(scene, less, [one.effect])
    best = next((c for c in look.causes if c.found), None)
    if look.account is None or best.column != one.column or (
            look.account.log_evidence <= acc.log_evidence):
        return None
    return look.account, path._replace(
        found=rest.found + best.found,
        log_bayes=rest.log_bayes + look.account.log_evidence - less.log_evidence)


def _describes(scene, glanced, acc, near):
    """Does an account leave nothing of a record that stands out?"""
    return glanced(acc, near).p_value >= LOOK_ON * effort(scene)


def _or_a_pair(scene, acc, look, effects, describes):
    """A look with the best pair of effects among its causes: a process may follow two
    of them nearly as well as they do, of which neither does alone.
    """
    pair = best_pair(scene, acc, look, effects, describes)
    if pair is None:
        return look
    best, (found, log_bayes, together) = next(c for c in look.causes if c.found), pair
    odds = np.exp(np.clip(log_bayes + look.prior - best.log_bayes, -99.0, 99.0))
    share = float(odds * best.probability / (1.0 + odds * best.probability))
    causes = [Cause(found, share, log_bayes, best.error * (1.0 - share)), *(
        scaled(c, 1.0 - share, 0.0) for c in look.causes)]
    return look._replace(
        causes=tuple(sorted(causes, key=lambda c: -c.probability)),
        account=together if odds > 1.0 else look.account)


class _Exchanged(NamedTuple):
    """What has become of an account, its path and the leaves; see `Search`."""

    account: Account
    lesser: dict
    path: Cause
    leaves: dict


COMPARABLE = 1e-6    # probability of an effect beside the others, below which it was
                     # not looked for as when it was found, but for evidence against it


def _exchanged(full, acc, path, leaves, lesser, effects, twins, settled):
    """`_Exchanged`: is another effect, beside all others, more probable than one that
    was found, but for so many last that are `settled`, as the best beside all others?
    What may as well stand in its place is among the leaves.
    """
    every = {number: _less(full, acc, lesser, path, number)
             for number, one in enumerate(path.found[:len(path.found) - settled])
             if not one.effect.reading}
    lesser = {**lesser, **{number: less for number, (less, _) in every.items()}}
    asked = sorted(every, key=lambda number: -lesser[number].log_evidence)
    scene, leaf, before = as_read(full, acc.readings), leaves[path.effect], leaves
    for number in asked[:MAX_ASKED]:
        less, rest = every[number]
        name = path.found[number].name
        look = further_causes(scene, less, effects, known=(
            name, acc.log_evidence - less.log_evidence))
        here = sum(c.probability for c in look.causes if c.effect == name
                   and _is_same(c.found[0], path.found[number]))
        best = next(c for c in look.causes if c.found)
        if here < COMPARABLE and not (look.account is not None and _net(
                look.account, best.found[0], full) > _net(acc, path.found[number], full)
                ):
            continue
        if look.account is not None and best.probability > here and not (
                twins and twins.have(best.found[0], look.account, scene
                                     ).probability >= 0.5):
            kept = here / (here + best.probability)
            new = scaled(_joined(rest, best)._replace(
                probability=path.probability, error=path.error), 1.0 - kept, 0.0)
            account, lesser, new, leaves = _without_needless(full, look.account, new, {
                key: scaled(c, kept, 0.0) if c.effects[:len(path.found)] == path.effects
                else c for key, c in before.items() if c.names != new.names
            }, look.prior)
            return _Exchanged(account, lesser, new, leaves)
        if here < COMPARABLE:
            continue
        for c in look.causes:
            instead = _joined(rest, c)._replace(
                probability=leaf.probability * min(c.probability / here, 1.0))
            known = sum(one.probability for one in leaves.values()
                        if one.names == instead.names)
            if c.effect != name and instead.probability > known:
                leaves = {instead.effect: instead, **{
                    key: one for key, one in leaves.items()
                    if one.names != instead.names}}
    return _Exchanged(acc, lesser, path, leaves)


def _is_same(one, other):
    """Are two effects of one name the same? Of wrong parameters there are several."""
    return not one.effect.factor or (
        one.values["parameter"][0] == other.values["parameter"][0])


def _net(acc, one, full):
    """Log evidence of an account with an effect, less what its search gains by chance.
    """
    return acc.log_evidence - search_cost(one.effect, full)


def _joined(path, cause):
    """A set of effects and one more."""
    return scaled(path, cause.probability, cause.error)._replace(
        found=path.found + cause.found, log_bayes=path.log_bayes + cause.log_bayes)


def scaled(cause, share, error):
    """A cause with a share of its probability, which has an error of its own."""
    return cause._replace(probability=share * cause.probability, error=float(np.hypot(
        share * cause.error, error * cause.probability)))


def _with_leaves(leaves, path, look):
    """The sets of effects where a search could stop, after one more look.

    Rivals of what is found now lack it as much as the account did to which it is added,
    unless it is theirs.
    """
    result = dict(leaves)
    if look.account is not None:
        none = next(c for c in look.causes if not c.found)
        alone = none.probability
        best = next(c for c in look.causes if c.found)
        result = {}
        for one in leaves.values():
            result[one.effect] = scaled(one, alone, none.error)
            if one.found and best.effect not in one.effects:
                both = scaled(one, 1.0 - alone, none.error)._replace(
                    found=one.found + best.found,
                    log_bayes=one.log_bayes + best.log_bayes)
                result[both.effect] = both
    for cause in look.causes:
        one = _joined(path, cause)
        if (one.effect not in result
                or result[one.effect].probability < one.probability):
            result[one.effect] = one
    return result
