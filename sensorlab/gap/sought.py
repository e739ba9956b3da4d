"""Where further effects are sought, and the rivals that are found there: signatures and
processes without jumps, jumps and changes by the filter that has them.
"""

from typing import NamedTuple

import numpy as np

from sensorid import brief
from sensorlab.gap.account import Account, account, mean_evidence
from sensorlab.gap.costs import say
from sensorlab.gap.directed import directed, estimate_signature
from sensorlab.gap.inside import Inside, rests_on_rounding, told_inside, with_filters
from sensorlab.gap.lowpass import families_passing, low_pass_of
from sensorlab.gap.rival import Rival, floor_of, least_told
from sensorlab.gap.signatures import families
from sensorlab.gap.standins import stand_ins
from sensorlab.gap.wrong import (
    with_wrong_parameters, with_wrong_scale, with_wrong_sizes)

NO_OTHER = "", 0.0     # of which ln B is known


class StandIn(NamedTuple):
    """Where signatures were sought: an account without jumps, or what stands in for
    one that has some.
    """

    scene: object
    account: Account     # of that scene
    listed: list         # of Family
    samples: list        # of Sample: their evidence, one of every hypothesis
    grids: dict          # number of a family -> `Grid` where it was resolved
    signatures: dict     # number, count of nodes -> `signature`

    __repr__ = brief

    def signature(self, number, count=None):
        """`Signature` and `Found` of the family of a number, from so many nodes."""
        known = self.signatures
        if (number, count) not in known:
            known[number, count] = estimate_signature(
                self.scene, self.account, self.listed[number - 1], self.samples, number,
                self.grids, count)
        return known[number, count]

    @property
    def rivals(self):
        """Of every family a `Rival`."""
        table = np.array([s.log_evidence for s in self.samples])
        base = mean_evidence(table[:, 0])
        return [Rival(family.effect, family.column, mean_evidence(
            table[:, number]) - base, number, self)
            for number, family in enumerate(self.listed, 1)]


class Sought(NamedTuple):
    """What was found of further effects."""

    inside: Inside    # where those inside the filter were sought
    rivals: list      # of Rival
    others: list      # signatures, where a level that jumps is taken away as it was
                      # without them: right if they are small beside it


def sought(scene, acc, effects, processes=True, known=NO_OTHER):
    """`Sought` of some effects; see `further_causes`."""
    if acc.member.steps:    # what begins at some time is one more step, or two
        effects = [e for e in effects if not (e.columns and e.search in (
            "onset", "pulse"))]
    name, best = known
    for_signatures, for_others = stand_ins(scene, acc)
    even = _without_jumps(scene, acc, for_others)
    inside = Inside(scene, even[0], acc, even[1])
    told = told_inside(inside, effects, processes)
    # signatures that come to far less than what a spectrum or a screen promises need
    # not be known well
    least = least_told(max([0.0 if name else best, *filter(
        np.isfinite, told.values())]))
    plain, every = [even], []
    for pair in for_signatures:
        plain.append(_without_jumps(scene, acc, pair, plain))
        every.append(_with_signatures(acc, *plain[-1], effects, least))
    rivals, *others = (one.rivals for one in every)
    rivals += with_filters(inside, told, max(
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
    return Sought(inside, rivals, [one for own in others for one in own])


def largest_bayes(scene, acc, effect):
    """Largest ln B of one further effect in any form; 0 if nothing is for it."""
    return max([0.0, *(one.log_bayes for one in sought(scene, acc, [effect]).rivals)])


def _with_signatures(acc, plain, reference, effects, least):
    """`StandIn` for an account, a scene and an account without jumps: where signatures
    of some effects were sought; what comes to less than the `least` ln B matters
    little.
    """
    listed = families(plain, effects, acc.signatures)
    low_pass = low_pass_of(acc.member, acc.theta)
    if low_pass:
        listed += families_passing(low_pass, listed)
    say("looking for signatures", 4)
    samples = directed(plain, reference, listed, grids=(grids := {}), least=least)
    return StandIn(plain, reference, listed, samples, grids, {})


def _without_jumps(scene, acc, pair, known=()):
    """The scene and the account where another effect is sought, of a pair of a scene
    and hypotheses that stand in for those with jumps; those that are known, if they are
    the same.
    """
    plain, hypotheses = pair
    if plain is scene:
        return scene, acc
    for seen, own in known:
        if hypotheses == own.hypotheses and np.array_equal(plain.y, seen.y,
                                                           equal_nan=True):
            return seen, own
    return plain, account(plain, hypotheses, signatures=acc.signatures, past=acc)
