"""Where a record differs from a simulator, which effect causes it, how far adding that
effect closes the gap.
"""

from typing import NamedTuple

import numpy as np

from sensorid import LOG_2PI, simulate
from sensorlab.gap.effects import BLOCK, CATALOGUE, Scene
from sensorlab.gap.account import Account, account
from sensorlab.gap.causes import Cause, look
from sensorlab.gap.readings import readings, with_quantization, without_readings
from sensorlab.gap.places import TRIALS, Gap, distance


class Diagnosis(NamedTuple):
    """Answer of `diagnose`: where the gap lies, which effect causes it, how far it
    shrinks.
    """

    scene: Scene
    verdict: str             # an effect ("a+b" for two), none, unknown or undecided
    causes: tuple            # of Cause, most probable first; none and unknown are there
    base: Account            # the simulator as it was
    final: Account           # with the effects that were found
    found: tuple             # of Cause: these effects, in the order found
    before: Gap
    after: Gap
    rms_before: float        # of what stood out, standard deviations; 1 is no gap
    rms_after: float
    closed: float            # fraction of the gap; NaN where there was none
    closed_interval: tuple
    nats_per_sample: float   # gain of the one-step-ahead log score
    held_out: tuple          # HeldOut; None where nothing was found to foretell from
    needed_duration: float   # s; NaN unless undecided


PRIOR_UNKNOWN = 0.1     # that what is missing is in no catalogue
MISSING_NATS = 10.0     # mean of -ln p where something is missing: what can be named
SURE = 0.5              # what is named is more probable than not
OUTSTANDING = 0.05      # how often a record without a gap has what a gap is measured on
UNEXPECTED = 3.0        # standard deviations of the mean: a bias the simulator lacks
ROUNDING = 1e5          # a prior this much wider than the record tells nothing
LOOK_ON = 0.2           # p-value from which on no second process is looked for
MOST = 3                # effects beside readings, looked for one after another


def unknown_probability(p_value):
    """That something is still missing, from the p-value of what is left.

    -ln p is exponential: of mean 1 where nothing is missing, of mean MISSING_NATS
    where something is (T. Sellke, M. Bayarri, J. Berger, "Calibration of p values",
    Am. Stat. 55, 2001).
    """
    log_odds = (np.log(PRIOR_UNKNOWN / (1.0 - PRIOR_UNKNOWN) / MISSING_NATS)
                - (1.0 - 1.0 / MISSING_NATS) * np.log(p_value))
    return float(1.0 / (1.0 + np.exp(-log_odds)))


def diagnose(y, dt, hypotheses, columns=None, effects=None, trials=None, seed=0,
             progress=None):
    """Where a record differs from a simulator, which effect causes it, how far adding
    that effect closes the gap.

    Parameters
    ----------
    y : (N,) array
        Sensor error, u, evenly sampled; NaN marks a missing sample.
    dt : float
        Sampling interval, s.
    hypotheses : sequence of Hypothesis
        The simulator: it draws one of them with equal probability.
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
        or a hypothesis is no sum of one-state processes.
    """
    y = np.asarray(y, float)
    columns = {name: np.asarray(x, float) for name, x in (columns or {}).items()}
    check_scene(y, dt, columns)
    if not hypotheses:
        raise ValueError("a simulator without a hypothesis: at least one is needed")
    effects = tuple(CATALOGUE.values() if effects is None else effects)
    full = scene = Scene(y, dt, columns)
    done = iter(range(1, 100))

    def tell(last=False):
        if progress:
            number = next(done)
            progress(MOST + 3 if last else number, MOST + 3)
    bases, mean = tuple(hypotheses), abs(float(np.nanmean(y)))
    # of two numbers in double precision, one must not drown the other
    most = ROUNDING * max(float(np.nanstd(y)), mean)
    bases = tuple(h._replace(bias_sigma=min(h.bias_sigma, most)) for h in bases)
    if mean > UNEXPECTED * expected_mean(bases, dt, len(y)):
        # a bias that the simulator does not expect must not pass for an effect
        bases = tuple(h._replace(bias_sigma=max(h.bias_sigma, mean)) for h in bases)
    base = acc = start = account(scene, bases)
    before = distance(scene, base, trials, seed)
    tell()

    known = readings(scene)
    found = [Cause(r.effect, "", 1.0, float(r.log_bayes),
                   {name: (v, 0.0) for name, v in r.value.items()}) for r in known]
    if known:
        scene = scene._replace(y=without_readings(y[None], known)[0])
        inner = bases
        for r in known:
            if r.effect == "quantization":
                inner = tuple(with_quantization(h, r.value["lsb"]) for h in inner)
        acc = start = account(scene, bases, inner, (), known)
    leaves, share = {}, 1.0    # every set of effects as a Cause; probability so far

    after = distance(full, acc, trials, seed + 1) if found else before
    while len(found) < len(known) + MOST and not any(r.opaque for r in known):
        # a process shows in the undirected statistics, if it is there; jumps may not
        step = look(scene, acc, effects, not found or after.p_value < LOOK_ON)
        tell()
        if step.account is not None:
            best = next(c for c in step.causes if c.effect != "none")
            leaves = _followed(leaves, step, best)
        for c in step.causes:
            listed = found if c.effect == "none" else [*found, c]
            one = _joined(listed, share * c.probability)
            if one.effect not in leaves or leaves[one.effect].probability < \
                    one.probability:
                leaves[one.effect] = one
        if step.account is None:
            break
        acc, found = step.account, [*found, best]
        after = distance(full, acc, trials, seed + 1)
        share *= best.probability
        leaves.pop(_joined(found, share).effect)
    else:
        one = _joined(found, share)
        leaves[one.effect] = one
    tell(last=True)

    # what stands out only beside an added effect speaks against that effect
    unknown = (PRIOR_UNKNOWN / MISSING_NATS if any(r.opaque for r in known)
               else unknown_probability(max(before.p_value, after.p_value)))
    total = sum(c.probability for c in leaves.values())
    causes = [c._replace(probability=float((1.0 - unknown) * c.probability / total))
              for c in leaves.values()]
    causes.append(Cause("unknown", "", unknown, 0.0, {}))
    if "none" not in leaves:
        causes.append(Cause("none", "", 0.0, 0.0, {}))
    causes.sort(key=lambda c: -c.probability)
    verdict = verdict_of(causes)
    gain = (acc.log_evidence - start.log_evidence) / max(np.sum(~np.isnan(scene.y)), 1)
    return Diagnosis(full, verdict, tuple(causes), base, acc, tuple(found), before,
                     after, *closure(before, after), float(gain),
                     held_out(full, start, acc, trials or TRIALS // 2, seed + 2)
                     if acc.signatures or acc.hypotheses != start.hypotheses else None,
                     needed_duration(causes, full) if verdict == "undecided"
                     else np.nan)


def verdict_of(causes):
    """The first cause if it is more probable than not, or else every effect that is, in
    whatever company (the median probability model; M. Barbieri, J. Berger, "Optimal
    predictive model selection", Ann. Stat. 32, 2004).
    """
    if causes[0].probability >= SURE:
        return causes[0].effect
    present = {}
    for c in causes:
        for effect in dict.fromkeys(c.effect.split("+")):
            present[effect] = present.get(effect, 0.0) + c.probability
    return "+".join(e for e, p in present.items() if p >= SURE) or "undecided"


def _followed(leaves, step, best):
    """Rivals of what has been found, once a further effect has been: they lack it as
    much as the account did to which it was added, unless it is theirs.
    """
    alone = next(c.probability for c in step.causes if c.effect == "none")
    result = {}
    for one in leaves.values():
        result[one.effect] = one._replace(probability=alone * one.probability)
        if one.effect != "none" and best.effect not in one.effect.split("+"):
            both = _joined([one, best], (1.0 - alone) * one.probability)
            result[both.effect] = both
    return result


def expected_mean(hypotheses, dt, samples):
    """Root mean square of the means of 64 simulated records, u."""
    block = int(np.clip(BLOCK // samples, 1, 64))
    means = np.concatenate([
        simulate(hypotheses, dt, samples, min(block, 64 - first), first=first
                 ).error.mean(1) for first in range(0, 64, block)])
    return float(np.sqrt(np.mean(means**2)))


def check_scene(y, dt, columns):
    """Refuse what cannot be diagnosed."""
    if y.ndim != 1 or not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"a record of shape {y.shape} at {dt} s: "
                         "one row of samples and an interval > 0 are needed")
    seen = y[~np.isnan(y)]
    if len(seen) < SHORTEST or np.isinf(y).any() or np.ptp(seen) == 0.0:
        raise ValueError(f"the record has {len(seen)} samples, "
                         f"{len(np.unique(seen))} different ones: at least {SHORTEST} "
                         "finite ones that are not all the same are needed")
    check_columns(y, columns)


def check_columns(y, columns):
    """Refuse columns that do not go with a record."""
    for name, x in columns.items():
        if x.shape != y.shape or not np.isfinite(x).all():
            raise ValueError(f"column {name} has shape {x.shape} and "
                             f"{np.sum(~np.isfinite(x))} values that are not finite: "
                             f"{len(y)} numbers are needed, one for every sample")


SHORTEST = 64    # samples; fewer tell no effect from the noise


def _joined(found, probability):
    """Several effects as one `Cause`, with their names before their parameters'; one
    found again is number 2.
    """
    parameters = {}
    for c in found:
        for name, value in c.parameters.items():
            effect, _, own = name.rpartition(".")
            effect = effect or (c.effect if len(found) > 1 else "")
            number, key = 1, name if not effect else f"{effect}.{own}"
            while key in parameters:
                number += 1
                key = f"{effect}_{number}.{own}"
            parameters[key] = value
    return Cause("+".join(c.effect for c in found) or "none",
                 "+".join(filter(None, (c.column for c in found))),
                 probability, sum(c.log_bayes for c in found), parameters)


def closure(before, after):
    """rms distances before and after over the statistics that stood out before, the
    fraction closed, 1 - (after - 1) / (before - 1), and its interval.
    """
    out = np.abs(before.distance) > np.quantile(np.abs(before.null).max(1),
                                                1.0 - OUTSTANDING)
    if not out.any():
        return before.rms(), after.rms(), np.nan, (np.nan, np.nan)
    first, last = before.rms(out), after.rms(out)
    # of a record without a gap, through the same statistics
    noise = 2.0 * np.std(np.sqrt((after.null[:, out]**2).mean(1)))
    closed = np.clip(1.0 - (last + np.array([0.0, noise, -noise]) - 1.0)
                     / (first - 1.0), -9.0, 1.0)
    return first, last, float(closed[0]), (float(closed[1]), float(closed[2]))


class HeldOut(NamedTuple):
    """What a fit of the first two thirds of a record says of the last third.

    Which effects there are, and their onset, frequency or delay, the whole record said.
    """

    gain: float           # of the log score with the effects, nats a sample
    reference: float      # of a flexible regression, nats a sample
    ratio_before: float   # real over calculated standard deviation of the predictions
    ratio_after: float    # the same with the effects: 1 where the criteria coincide
    before: float         # rms distance of what stands out there, standard deviations
    after: float          # the same with the effects; 1 is no gap
    closed: float         # fraction of the gap; NaN where there was none
    closed_interval: tuple


LAGS = 32    # samples back that the flexible regression looks


def held_out(scene, start, final, trials=None, seed=0):
    """`HeldOut` of an account with effects against that without; None where one of them
    begins in the last third.
    """
    cut = 2 * len(scene.y) // 3
    full, scene = scene, scene._replace(
        y=without_readings(scene.y[None], final.readings)[0])
    known = {p.symbol: value for p, value in zip(
        final.hypotheses[final.best].parameters, final.theta)
        if p.symbol == "noise_step.onset"}
    if any(onset > cut * scene.dt for onset in known.values()) or any(
            not s.columns[:cut].any() for s in final.signatures):
        return None
    head = Scene(scene.y[:cut], scene.dt,
                 {name: x[:cut] for name, x in scene.columns.items()})
    score, ratio, gaps = [], [], []
    for acc in (start, final):
        hypotheses = [h._replace(parameters=tuple(
            p._replace(low=known[p.symbol], high=known[p.symbol])
            if p.symbol in known else p for p in h.parameters)) for h in acc.hypotheses]
        fit = account(head, acc.bases, hypotheses, tuple(
            s._replace(columns=s.columns[:cut]) for s in acc.signatures),
            acc.readings, None if known else acc)
        gap = distance(full, fit._replace(signatures=acc.signatures), trials, seed, cut)
        score.append(gap.log_score[cut:])
        ratio.append(float(np.sqrt(np.nanmean(gap.z[cut:]**2))))
        gaps.append(gap)
    back = np.column_stack([np.ones_like(scene.y), *scene.columns.values(), *(
        np.roll(scene.y, lag) for lag in range(1, LAGS + 1))])
    whole = ~np.isnan(back).any(1) & ~np.isnan(scene.y) & (
        np.arange(len(scene.y)) >= LAGS)
    early, late = whole.copy(), whole.copy()
    early[cut:], late[:cut] = False, False
    reference = np.nan
    if early.sum() > 2 * back.shape[1] and late.any():
        c, *_ = np.linalg.lstsq(back[early], scene.y[early])
        variance = np.sum((scene.y - back @ c)[early]**2) / (
            early.sum() - back.shape[1])
        density = -0.5 * (LOG_2PI + np.log(variance)
                          + (scene.y - back @ c)[late]**2 / variance)
        reference = float(np.mean(density - score[0][late[cut:]]))
    return HeldOut(float(np.nanmean(score[1] - score[0])), reference, *ratio,
                   *closure(*gaps))


def needed_duration(causes, scene):
    """Record length, s, at which the two best causes would be told apart, if their log
    odds grew as they did.
    """
    first, second = (c.probability for c in causes[:2])
    odds = max(np.log(first / max(second, 1e-12)), 0.5)
    return float(scene.duration * max(3.0 / odds, 1.0))
