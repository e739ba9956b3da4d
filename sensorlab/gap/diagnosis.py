"""Where a record differs from a simulator, which effect causes it, and how far adding
that effect closes the gap.
"""

from collections import Counter
from typing import NamedTuple

import numpy as np

from sensorid import as_samples, brief, check_seed, check_whole, one_thread_if
from sensorlab.gap.account import Account, with_tails
from sensorlab.gap.causes import Cause
from sensorlab.gap.closure import Closure, along_the_filter, closure, held_out
from sensorlab.gap.costs import check_memory, heard_by, say, share_heap
from sensorlab.gap.distance import Gap, distance, enough_trials
from sensorlab.gap.drift import drift
from sensorlab.gap.effects import Scene
from sensorlab.gap.flexible import closed_by_any
from sensorlab.gap.implied import as_simulated, in_place
from sensorlab.gap.known import (
    as_columns, as_records, as_simulator, bias_beside, check_recorded, check_scene,
    check_units, default_simulator, with_readings, without_known)
from sensorlab.gap.own import as_effects, check_parameters
from sensorlab.gap.readings import as_read, compared, latent_mean, missing, recorded
from sensorlab.gap.refits import estimated_together
from sensorlab.gap.remainder import Remainder, parts, remainder
from sensorlab.gap.search import Search, beside_steps, narrowed, reduced, search
from sensorlab.gap.tuning import tuned
from sensorlab.gap.twins import Twins, less_shared
from sensorlab.gap.verdict import (
    all_causes, names_all, names_in, needed_duration, unknown_error, verdict_of)


class Diagnosis(NamedTuple):
    """Answer of `diagnose`: where the gap lies, which effect causes it, how far it
    shrinks.
    """

    scene: Scene
    verdict: str             # an effect ("a+b" for two), none, unknown (what is left
                             # beside others, or all there is) or undecided
    causes: tuple            # of Cause, most probable first; none and unknown are there
    known: tuple             # of Found: signatures that the simulator has
    shared: tuple            # of Found: what its own records show, too, and it lacks
    base: Account            # the simulator as it was, and with these
    final: Account           # with the effects that were found
    found: tuple             # of Found: these effects, in the order found
    parts: tuple             # of Part: what each of them closes
    before: Gap
    after: Gap
    closure: Closure         # how far the gap shrinks
    directed: bool           # is that along the filter of what was found? else by place
    by_any: float            # fraction that noise of any colour and spread would close
    remainder: Remainder     # what is left
    drift: tuple             # of Drift: the error integrated over horizons
    nats_per_sample: float   # gain of the one-step-ahead log score
    held_out: tuple          # HeldOut; None where nothing was found to foretell from
    bias: tuple              # of two Bias: beside the simulator as it was, and with
                             # the effects that were found
    needed_duration: float   # s; NaN unless undecided

    __repr__ = brief


def diagnose(y, dt, simulator=None, columns=None, effects=None, trials=None, seed=0,
             progress=None, simulated=None):
    """Where a record differs from a simulator, which effect causes it, how far adding
    that effect closes the gap.

    Parameters
    ----------
    y : (N,) array
        Sensor error, u, evenly sampled; NaN marks a missing sample.
    dt : float
        Sampling interval, s.
    simulator : Simulator, or sequence of Hypothesis, optional
        Draws one of its hypotheses with equal probability; by default those of
        `default_hypotheses`.
    columns : dict of (N,) arrays, or DataFrame or Dataset of them, optional
        What was recorded beside the error; `CATALOGUE` names what is looked for.
    effects : sequence of Effect, or of their names in CATALOGUE, optional
        By default all of the catalogue. What the values show by themselves, such as
        quantization, is always looked for.
    trials : int, optional
        Simulated records behind every p-value; by default TRIALS, fewer for a long
        record, more where a probability hangs on them.
    seed : int
    progress : function of (done, all, what), optional
        Hears how many parts of the work are done, of how many as far as is known, and
        what is done next.
    simulated : (L, M) array, optional
        Records of the simulator itself, where they are all that is known of it: what
        they have, too, is no gap. By default those that `simulator_from` had.

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError
        If the record is too short, constant or not finite, a column does not fit it,
        an effect of your own cannot be looked for,
        a hypothesis is no sum of random walks and stationary processes of one state or
        two, or the simulator has effects that cannot be in one.
    MemoryError
        If the record is longer than the memory allows.
    """
    y = as_samples(y)
    columns = as_columns(columns)
    check_scene(y, dt, columns)
    check_seed(seed)
    if trials is not None:
        check_whole(trials, "numbers of simulated records", MIN_TRIALS)
    effects = as_effects(effects)
    check_parameters(effects, Scene(y, dt, columns))
    simulator = default_simulator(y, dt) if simulator is None else as_simulator(
        simulator)
    simulated = simulator.records if simulated is None else as_records(simulated, dt)
    check_memory(len(y), len(columns))
    short = len(y) <= SHORT_RECORD
    if not short:
        share_heap()
    with heard_by(progress, EXPECTED), one_thread_if(short):
        return _diagnosed(recorded(y, dt, columns), simulator, effects, trials,
                          seed, simulated)


MIN_TRIALS = 9    # simulated records: of fewer, a p-value tells next to nothing
SHORT_RECORD = 6000    # samples, up to which a step takes less time than a thread waits
                       # for the interpreter that another has
EXPECTED = 18    # parts of the work, as `say` counts them, where nothing is found


def _diagnosed(raw, simulator, effects, trials, seed, simulated):
    """`diagnose`, of a scene and a simulator that have been checked."""
    say("measuring where it differs", 2)
    had, seen = compared(raw, [one for one in simulator.pairs[0][1]
                               if one.effect.reading], simulated)
    had, seen = ([r.as_white_as(simulator) for r in some] for some in (had, seen))
    check_recorded(simulator, raw)
    full, known, free, bases = without_known(
        tuned(simulator, raw), raw, latent_mean(raw.y, seen),
        any(r.placed for r in seen))
    if not free:
        check_units(full, bases)
    base = with_readings(full, bases, free, had)
    alone = distance(full, base, trials, seed)
    own = None if simulated is None else Twins(full, base, simulated, seed)

    def unshared(gap):
        return less_shared(gap, own.distances) if own else gap
    before = unshared(alone)

    def measured(acc, near=None, trials=trials, before=alone):
        return unshared(_surely(full, acc, trials, seed + 1, before, near))

    glance = None, None    # the account that was the last to be measured, and its gap

    def glanced(acc, near=None):
        nonlocal glance
        say("measuring what is left", 2)
        if acc is not glance[0]:
            glance = acc, measured(acc, near, trials or enough_trials(full))
        return glance[1]
    new = [r for r in seen if r.log_bayes]
    start = with_readings(full, bases, free, seen) if new else base
    found = Cause(tuple(map(missing, new)), 1.0, sum(r.log_bayes for r in new))

    def described(done):
        return _described(full, done, before, measured)

    def sought(acc, path, effects):
        def again(effects, acc=acc, path=path, least=-np.inf):
            return search(full, acc, path, effects, before, glanced, own, least=least)
        return beside_steps(full, again(effects), again, effects)
    by = described(sought(start, found, effects))
    shared = by.search.shared
    if shared:
        base, start = (reduced(full, by.search, names)[0]
                       for names in ([], [one.name for one in found.found]))
        before = glanced(base) if by.found else by.search.after
        by = described(by.search)
    if before.p_value >= by.search.after.p_value:    # what is unknown hangs on it
        nothing = by.search.after is before
        before = unshared(_surely(full, base, trials, seed, near=alone))
        by = described(by.search._replace(after=before) if nothing else by.search)
    whole, staying = by, [one for one, part in zip(by.found, by.parts) if part.stays]
    while True:
        causes = all_causes(whole.search, start, before, whole.rest, staying)
        verdict = verdict_of(causes)
        if names_all(verdict, by.found):
            break
        names, have = names_in(verdict), ["unknown", *(one.name for one in by.found)]
        named = narrowed(full, whole.search, names, glanced)
        if Counter(names) - Counter(have):
            # a rival of what is named was the first
            begun = (named.account, named.path) if len(named.path.found) > len(
                found.found) else (start, found)
            named = sought(*begun, [e for e in effects if e.name in names])
        by = described(named)
        if "unknown" not in names or not by.closure.interval[1] < 0.0:
            break
        by, staying = whole, []    # with what is named the gap is wider
    final, after = by.search.account, by.search.after
    seen = max(np.sum(~np.isnan(as_read(full, start.readings).y)), 1)
    more = final.signatures or len(final.member.effects) > len(start.member.effects)
    say("integrating the error, foretelling the end of the record", 2)
    return Diagnosis(
        full, verdict, causes, known, shared, base, final, by.found, by.parts, before,
        after, by.closure, by.directed, closed_by_any(before), by.rest,
        drift(full, [in_place(as_simulated(acc, full, gap.theta), acc, full)
                     for acc, gap in ((base, before), (final, after))], seed),
        float((final.log_evidence - start.log_evidence) / seen),
        held_out(full, start, final, trials, seed + 2)
        if more or final.hypotheses[0].hypothesis != start.hypotheses[0].hypothesis
        else None, tuple(bias_beside(simulator, known, acc, full)
                         for acc in (base, final)),
        needed_duration(causes, full) if verdict == "undecided" else np.nan)


class _Described(NamedTuple):
    """What a search has found, and what that does."""

    search: Search
    closure: Closure
    directed: bool
    rest: Remainder
    parts: tuple       # of Part

    @property
    def found(self):
        return self.search.path.found


def _described(full, done, before, measured):
    """`_Described` of a search, its effects estimated together."""
    final = with_tails(as_read(full, done.account.readings), done.account)
    if done.after is not before:
        done = done._replace(account=final, after=measured(final, done.after))
    elif final.best == done.account.best:    # what is before is of that hypothesis
        done = done._replace(account=final)
    path = estimated_together(full, _as_records_have(done), done.path)
    done = done._replace(path=path, leaves={
        **done.leaves, path.effect: done.leaves[path.effect]._replace(
            found=path.found)})
    closed = closure(before, done.after)
    directed = bool(path.found and np.isnan(closed.closed))
    if directed:
        closed = along_the_filter(path.log_bayes, done.left)
    return _Described(done, closed, directed, remainder(before, done.after), parts(
        full, path, done.account, done.lesser, closed, before, done.after, measured))


def _as_records_have(done):
    """The account of a search, its posterior moved to the parameters whose records give
    this fit, where coarse counts mislead a filter.
    """
    acc = done.account
    if not any(r.coarse for r in acc.readings) or (
            done.after.ruler.fit.setting.acc is not acc):
        return acc
    theta, old, new = acc.sample.theta, acc.theta, done.after.theta
    ratio = np.ones(len(new))    # what is positive stays so
    positive = (theta > 0.0).all(0) & (old > 0.0) & (new > 0.0)
    ratio[positive] = new[positive] / old[positive]
    low, high = np.transpose([(p.low, p.high) for p in acc.member.parameters])
    own = acc.sample._replace(theta=np.clip(
        ratio * theta + np.where(positive, 0.0, new - old), np.minimum(low, new),
        np.maximum(high, new)))
    return acc._replace(samples=(*acc.samples[:acc.best], own,
                                 *acc.samples[acc.best + 1:]))


MOST_ERROR = 0.03    # of a probability, by chance of the simulated records
MOST_TIMES = 4       # as many of them as usual


def _surely(scene, acc, trials, seed, before=None, near=None):
    """`distance`, with more simulated records where the probability of something
    unknown hangs on which there are.
    """
    gap = distance(scene, acc, trials, seed, before=before, near=near)
    off = unknown_error(gap)
    if trials or off <= MOST_ERROR:
        return gap
    return distance(scene, acc, round(enough_trials(scene) * min(
        (off / MOST_ERROR)**2, MOST_TIMES)), seed, before=before, near=gap)
