"""Where a record differs from a simulator, which effect causes it, and how far adding
that effect closes the gap.
"""

from typing import NamedTuple

import numpy as np

from sensorid import as_samples, brief, simulate
from sensorlab.gap.account import Account, account, as_simulated, fixed
from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.causes import UNKNOWN, Cause, further_causes, without
from sensorlab.gap.effects import BLOCK, Found, Scene, Simulator, members, signature_of
from sensorlab.gap.closure import closure, held_out
from sensorlab.gap.distance import TRIALS, Gap, distance
from sensorlab.gap.readings import readings, without_readings


class Diagnosis(NamedTuple):
    """Answer of `diagnose`: where the gap lies, which effect causes it, how far it
    shrinks.
    """

    scene: Scene             # less what the simulator's own signatures add, and offset
    offset: float            # u, taken away where it is large beside all else
    verdict: str             # an effect ("a+b" for two), none, unknown or undecided
    causes: tuple            # of Cause, most probable first; none and unknown are there
    known: tuple             # of Found: signatures that the simulator has
    base: Account            # the simulator as it was
    final: Account           # with the effects that were found
    found: tuple             # of Found: these effects, in the order found
    before: Gap
    after: Gap
    rms_before: float        # of what stood out, standard deviations; 1 is no gap
    rms_after: float
    closed: float            # fraction of the gap; NaN where there was none
    closed_interval: tuple
    nats_per_sample: float   # gain of the one-step-ahead log score
    held_out: tuple          # HeldOut; None where nothing was found to foretell from
    needed_duration: float   # s; NaN unless undecided

    __repr__ = brief


MAX_EFFECTS = 3         # beside readings, looked for one after another
LOOK_ON = 0.2           # p-value from which on no second process is looked for


def diagnose(y, dt, simulator, columns=None, effects=None, trials=None, seed=0,
             progress=None):
    """Where a record differs from a simulator, which effect causes it, how far adding
    that effect closes the gap.

    Parameters
    ----------
    y : (N,) array
        Sensor error, u, evenly sampled; NaN marks a missing sample.
    dt : float
        Sampling interval, s.
    simulator : Simulator, or sequence of Hypothesis
        Draws one of its hypotheses with equal probability.
    columns : dict of (N,) arrays, optional
        What was recorded beside the error; `CATALOGUE` names what is looked for.
    effects : sequence of Effect, optional
        By default all of the catalogue.
    trials : int, optional
        Simulated records behind every p-value, by default TRIALS.
    seed : int
    progress : function of (done, all), optional

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError
        If the record is too short, constant or not finite, a column does not fit it,
        a hypothesis is no sum of one-state processes, or the simulator has effects
        that cannot be in one.
    """
    y = as_samples(y)
    columns = {name: as_samples(x) for name, x in (columns or {}).items()}
    check_scene(y, dt, columns)
    effects = tuple(CATALOGUE.values() if effects is None else effects)
    tell = _steps(progress)

    full, offset, known, bases = _without_known(_simulator(simulator),
                                                Scene(y, dt, columns))
    base = account(full, bases)
    before = distance(full, base, trials, seed)
    tell()
    scene, start = _without_readings(full, base)
    search = _search(full, offset, scene, start, effects, before, trials, seed, tell)
    causes = _causes(search, start, before)
    verdict = verdict_of(causes)
    final = search.account
    gain = (final.log_evidence - start.log_evidence) / max(np.sum(~np.isnan(scene.y)),
                                                           1)
    more = final.signatures or len(final.member.effects) > len(start.member.effects)
    result = Diagnosis(
        full, offset, verdict, causes, known, base, final, search.path.found, before,
        search.after, *closure(before, search.after), float(gain),
        held_out(full, start, final, trials or TRIALS // 2, seed + 2) if more or
        final.hypotheses[0].hypothesis != start.hypotheses[0].hypothesis else None,
        needed_duration(causes, full) if verdict == "undecided" else np.nan)
    tell(last=True)
    return result


def _steps(progress):
    """A function that tells of one more step, or of the last."""
    done = iter(range(1, 100))

    def tell(last=False):
        if progress:
            progress(MAX_EFFECTS + 3 if last else next(done), MAX_EFFECTS + 3)
    return tell


def augmented(d):
    """The `Simulator` of a diagnosis with the effects that were found: ranges of the
    base have the posterior's mean and standard deviation, the rest are numbers.
    """
    # a uniform range of this half-width has that standard deviation
    width = np.sqrt(3.0) * d.final.sample.sd(d.final.theta)
    (h,), (effects,) = as_simulated(d.final, d.scene, d.after.theta, width)
    h = h._replace(bias_sigma=float(np.hypot(h.bias_sigma, d.offset)))
    return Simulator((h,), ((*d.known, *(_at_offset(e, d.offset) for e in effects)),))


def _at_offset(found, offset):
    """A reading of a record less an offset as one of the record itself."""
    if "limits" not in found.values:
        return found
    return found._replace(values=dict(limits=[
        limit + offset for limit in found.values["limits"]]))


# ---- the simulator, and the record less what is known

UNEXPECTED = 3.0        # standard deviations of the mean: a bias the simulator lacks
FAR_FROM_ZERO = 30.0    # standard deviations of the record
ROUNDING = 1e5          # a prior this much wider than the record tells nothing


def _simulator(simulator):
    """A `Simulator` from one, or from hypotheses; refuse what cannot be diagnosed."""
    if not isinstance(simulator, Simulator):
        simulator = Simulator(tuple(simulator))
    if not simulator.hypotheses:
        raise ValueError("a simulator without a hypothesis: at least one is needed")
    sets = [effects for _, effects in simulator.pairs]
    if any(other != sets[0] for other in sets):
        raise ValueError("the hypotheses of the simulator have different effects: "
                         "diagnose takes one set for all")
    for one in sets[0]:
        if one.effect.reading:
            raise ValueError(f"the simulator has {one.name}, which a record shows by "
                             "itself: take it out to diagnose one")
        if one.effect.columns and any(getattr(p, "free", False)
                                      for p in one.values.values()):
            raise ValueError(f"{one.name} of the simulator has a range: "
                             "diagnose needs a number")
    return simulator


def _without_known(simulator, scene):
    """The scene less the signatures that the simulator has and less an offset, these,
    and the members of the simulator with a bias that the record may have.
    """
    known = tuple(one for one in simulator.pairs[0][1] if one.effect.columns)
    y = scene.y
    for one in known:
        if one.column and one.column not in scene.columns:
            raise ValueError(f"{one.name} of the simulator needs a column {one.column}:"
                             " beside the error is "
                             f"{', '.join(scene.columns) or 'nothing'}")
        y = y - signature_of(scene, one, {symbol: getattr(p, "low", p)
                                          for symbol, p in one.values.items()})
    bases = members(simulator, scene._replace(y=y))
    mean, spread, offset = float(np.nanmean(y)), float(np.nanstd(y)), 0.0
    if abs(mean) > UNEXPECTED * expected_mean(bases, scene.dt, len(y)):
        # a bias that the simulator does not expect must not pass for an effect
        bases = tuple(_with_bias(h, max(h.bias_sigma, abs(mean))) for h in bases)
    if abs(mean) > FAR_FROM_ZERO * spread:
        # its prior is flat where the bias may be: less the mean of the record, a flat
        # one about zero says the same, and squares keep their digits
        offset, y = mean, y - mean
    # of two numbers in double precision, one must not drown the other
    bases = tuple(_with_bias(h, min(h.bias_sigma, ROUNDING * max(
        spread, abs(float(np.nanmean(y)))))) for h in bases)
    return scene._replace(y=y), offset, known, bases


def _with_bias(h, bias_sigma):
    return h._replace(hypothesis=h.hypothesis._replace(bias_sigma=bias_sigma))


def expected_mean(hypotheses, dt, samples):
    """Root mean square of the means of 64 simulated records, u."""
    block = int(np.clip(BLOCK // samples, 1, 64))
    means = np.concatenate([
        simulate(hypotheses, dt, samples, min(block, 64 - first), first=first
                 ).error.mean(1) for first in range(0, 64, block)])
    return float(np.sqrt(np.mean(means**2)))


def _without_readings(full, base):
    """The scene and the account less what readings of the record hide."""
    read = readings(full)
    if not read:
        return full, base
    scene = full._replace(y=without_readings(full.y[None], read)[0])
    inside = tuple(one._replace(values=fixed(**one.values)) for r in read
                   for one in [r.found] if one.effect.model)
    return scene, account(scene, base.bases, tuple(
        h._replace(effects=h.effects + inside) for h in base.bases), (), read)


MIN_SAMPLES = 64    # fewer tell no effect from the noise


def check_scene(y, dt, columns):
    """Refuse what cannot be diagnosed."""
    if y.ndim != 1 or not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"a record of shape {y.shape} at {dt} s: "
                         "one row of samples and an interval > 0 are needed")
    seen = y[~np.isnan(y)]
    if len(seen) < MIN_SAMPLES or np.isinf(y).any() or np.ptp(seen) == 0.0:
        raise ValueError(f"the record has {len(seen)} samples, "
                         f"{len(np.unique(seen))} different ones: at least "
                         f"{MIN_SAMPLES} finite ones that are not all the same are "
                         "needed")
    check_columns(y, columns)


def check_columns(y, columns):
    """Refuse columns that do not go with a record."""
    for name, x in columns.items():
        if x.shape != y.shape or not np.isfinite(x).all():
            raise ValueError(f"column {name} has shape {x.shape} and "
                             f"{np.sum(~np.isfinite(x))} values that are not finite: "
                             f"{len(y)} numbers are needed, one for every sample")


# ---- one more effect at a time

class _Search(NamedTuple):
    """How far the search for effects has come."""

    account: Account
    path: Cause       # what has been found, with the probability of having gone there
    leaves: dict      # name of a set of effects -> Cause: where the search could stop
    after: Gap


def _search(full, offset, scene, start, effects, before, trials, seed, tell):
    """`_Search` from an account on, until nothing more is found."""
    acc = start
    path = Cause(tuple(r.found._replace(values={
        symbol: (value, 0.0) for symbol, value in _at_offset(
            r.found, offset).values.items()})
        for r in start.readings), 1.0, sum(r.log_bayes for r in start.readings))
    looks = 0
    leaves, after = {}, before
    if path.found:
        after = distance(full, acc, trials, seed + 1, before=before)
    while looks < MAX_EFFECTS and not any(r.opaque for r in start.readings):
        looks += 1
        # a process shows in the undirected statistics, if it is there; jumps may not
        look = further_causes(scene, acc, effects,
                              not path.found or after.p_value < LOOK_ON)
        tell()
        leaves = _with_leaves(leaves, path, look)
        if look.account is None:
            return _Search(acc, path, leaves, after)
        best = next(c for c in look.causes if c.found)
        acc, path = look.account, _joined(path, best)
        leaves.pop(path.effect)
        acc, path, leaves = _without_needless(scene, acc, path, leaves, look.prior)
        after = distance(full, acc, trials, seed + 1, before=before)
    return _Search(acc, path, {**leaves, path.effect: path}, after)


def _without_needless(scene, acc, path, leaves, prior):
    """The account and the path without what was found before and is not needed beside
    what is found now: what one effect seemed to be two others may explain.
    """
    for number, one in reversed(list(enumerate(path.found[:-1]))):
        if one.effect.reading:
            continue
        less = without(scene, acc, path.found, number)
        log_odds = acc.log_evidence - less.log_evidence + prior
        if log_odds < 0.0:
            kept = 1.0 / (1.0 + np.exp(-log_odds))
            full, total = path, path.probability
            path = Cause(path.found[:number] + path.found[number + 1:],
                         (1.0 - kept) * total,
                         path.log_bayes + less.log_evidence - acc.log_evidence)
            leaves = {**leaves, full.effect: full._replace(probability=kept * total)}
            leaves.pop(path.effect, None)
            acc = less
    return acc, path, leaves


def _joined(path, cause):
    """A set of effects and one more."""
    return Cause(path.found + cause.found, path.probability * cause.probability,
                 path.log_bayes + cause.log_bayes)


def _with_leaves(leaves, path, look):
    """The sets of effects where a search could stop, after one more look.

    Rivals of what is found now lack it as much as the account did to which it is added,
    unless it is theirs.
    """
    result = dict(leaves)
    if look.account is not None:
        alone = next(c.probability for c in look.causes if not c.found)
        best = next(c for c in look.causes if c.found)
        result = {}
        for one in leaves.values():
            result[one.effect] = one._replace(probability=alone * one.probability)
            if one.found and best.effect not in one.effects:
                both = Cause(one.found + best.found, (1.0 - alone) * one.probability,
                             one.log_bayes + best.log_bayes)
                result[both.effect] = both
    for cause in look.causes:
        one = _joined(path, cause)
        if (one.effect not in result
                or result[one.effect].probability < one.probability):
            result[one.effect] = one
    return result


# ---- verdict

PRIOR_UNKNOWN = 0.1     # that what is missing is in no catalogue
MISSING_NATS = 10.0     # mean of -ln p where something is missing: what can be named
SURE = 0.5              # what is named is more probable than not


def unknown_probability(p_value):
    """That something is still missing, from the p-value of what is left.

    -ln p is exponential: of mean 1 where nothing is missing, of mean MISSING_NATS
    where something is (T. Sellke, M. Bayarri, J. Berger, "Calibration of p values",
    Am. Stat. 55, 2001).
    """
    log_odds = (np.log(PRIOR_UNKNOWN / (1.0 - PRIOR_UNKNOWN) / MISSING_NATS)
                - (1.0 - 1.0 / MISSING_NATS) * np.log(p_value))
    return float(1.0 / (1.0 + np.exp(-log_odds)))


def _causes(search, start, before):
    """All sets of effects, none and unknown among them, most probable first."""
    # what stands out only beside an added effect speaks against that effect
    unknown = (PRIOR_UNKNOWN / MISSING_NATS if any(r.opaque for r in start.readings)
               else unknown_probability(max(before.p_value, search.after.p_value)))
    total = sum(c.probability for c in search.leaves.values())
    causes = [c._replace(probability=float((1.0 - unknown) * c.probability / total))
              for c in search.leaves.values()]
    causes.append(Cause((Found(UNKNOWN),), unknown, 0.0))
    if "none" not in search.leaves:
        causes.append(Cause((), 0.0, 0.0))
    return tuple(sorted(causes, key=lambda c: -c.probability))


def verdict_of(causes):
    """The first cause if it is more probable than not, or else every effect that is, in
    whatever company (the median probability model; M. Barbieri, J. Berger, "Optimal
    predictive model selection", Ann. Stat. 32, 2004).
    """
    if causes[0].probability >= SURE:
        return causes[0].effect
    present = {}
    for c in causes:
        for effect in dict.fromkeys(c.effects or ("none",)):
            present[effect] = present.get(effect, 0.0) + c.probability
    return "+".join(e for e, p in present.items() if p >= SURE) or "undecided"


def needed_duration(causes, scene):
    """Record length, s, at which the two best causes would be told apart, if their log
    odds grew as they did.
    """
    first, second = (c.probability for c in causes[:2])
    odds = max(np.log(first / max(second, 1e-12)), 0.5)
    return float(scene.duration * max(3.0 / odds, 1.0))
