"""Where a record differs from a simulator, which effect causes it, and how far adding
that effect closes the gap.
"""

from collections import Counter
from typing import NamedTuple

import numpy as np
from scipy.stats.qmc import LatinHypercube

from sensorid import (
    Parameter, as_hypotheses, as_samples, at_quantiles, brief, free_columns,
    mean_square, one_thread_if, random_walk, rate_ramp, simulate)
from sensorlab.gap.account import (
    Account, account, around, as_simulated, bias_of, fixed, in_place, with_tails)
from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.causes import Cause
from sensorlab.gap.clipping import latent_law
from sensorlab.gap.closure import Closure, along_the_filter, closure, held_out
from sensorlab.gap.costs import check_memory, heard_by, say, share_heap
from sensorlab.gap.distance import Gap, distance, enough_trials
from sensorlab.gap.drift import drift
from sensorlab.gap.effects import (
    Found, Scene, Simulator, columns_of, known_values, members, signature_of)
from sensorlab.gap.filters import Signature
from sensorlab.gap.flexible import closed_by_any
from sensorlab.gap.kernels import dot
from sensorlab.gap.readings import (
    SMOOTH, as_read, compared, latent_mean, missing, recorded)
from sensorlab.gap.refits import estimated_together
from sensorlab.gap.remainder import Remainder, parts, remainder
from sensorlab.gap.search import Search, beside_steps, narrowed, search
from sensorlab.gap.twins import Twins, less_shared
from sensorlab.gap.tuning import tuned
from sensorlab.gap.verdict import (
    all_causes, names_all, names_in, needed_duration, unknown_error, verdict_of)


class Bias(NamedTuple):
    """What a record shows of its bias, and what the simulator says of it."""

    mean: float
    sd: float
    sigma: float    # that is given; NaN if none is
    taken: bool     # is it more than the simulator expects, and taken as it is?

    @property
    def is_large(self):
        """Is it more than what is given?"""
        return bool(abs(self.mean) > UNEXPECTED * np.hypot(self.sigma, self.sd))


class Diagnosis(NamedTuple):
    """Answer of `diagnose`: where the gap lies, which effect causes it, how far it
    shrinks.
    """

    scene: Scene
    verdict: str             # an effect ("a+b" for two), none, unknown (what is left
                             # beside others, or all there is) or undecided
    causes: tuple            # of Cause, most probable first; none and unknown are there
    known: tuple             # of Found: signatures that the simulator has
    base: Account            # the simulator as it was
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


def diagnose(y, dt, simulator, columns=None, effects=None, trials=None, seed=0,
             progress=None, simulated=None):
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
    columns : dict of (N,) arrays, or DataFrame or Dataset of them, optional
        What was recorded beside the error; `CATALOGUE` names what is looked for.
    effects : sequence of Effect, optional
        By default all of the catalogue.
    trials : int, optional
        Simulated records behind every p-value; by default TRIALS, fewer for a long
        record, more where a probability hangs on them.
    seed : int
    progress : function of (done, all, what), optional
        Hears how many parts of the work are done, of how many as far as is known, and
        what is done next.
    simulated : (L, M) array, optional
        Records of the simulator itself, where they are all that is known of it (see
        `simulator_from`): what they have, too, is no gap.

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError
        If the record is too short, constant or not finite, a column does not fit it,
        a hypothesis is no sum of random walks and stationary processes of one state or
        two, or the simulator has effects that cannot be in one.
    MemoryError
        If the record is longer than the memory allows.
    """
    y = as_samples(y)
    columns = {} if columns is None else {
        str(name): as_samples(x) for name, x in dict(columns).items()}
    check_scene(y, dt, columns)
    effects = tuple(CATALOGUE.values() if effects is None else effects)
    simulator = _simulator(simulator)
    check_memory(len(y), len(columns))
    short = len(y) <= SHORT_RECORD
    if not short:
        share_heap()
    with heard_by(progress, EXPECTED), one_thread_if(short):
        return _diagnosed(recorded(y, dt, columns), simulator, effects, trials,
                          seed, simulated)


SHORT_RECORD = 6000    # samples, up to which a step takes less time than a thread waits
                       # for the interpreter that another has
EXPECTED = 18    # parts of the work, as `say` counts them, where nothing is found


def _diagnosed(raw, simulator, effects, trials, seed, simulated):
    """`diagnose`, of a scene and a simulator that have been checked."""
    say("measuring where it differs", 2)
    had, seen = compared(raw, [one for one in simulator.pairs[0][1]
                               if one.effect.reading], simulated)
    _check_recorded(simulator, raw)
    full, known, free, bases = _without_known(
        tuned(simulator, raw), raw, latent_mean(raw.y, seen),
        any(r.placed for r in seen))
    if not free:
        _check_units(full, bases)
    base = _with_readings(full, bases, free, had)
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
    start = _with_readings(full, bases, free, seen) if new else base
    found = Cause(tuple(map(missing, new)), 1.0, sum(r.log_bayes for r in new))

    def described(done):
        return _described(full, done, before, measured)

    def sought(acc, path, effects):
        def again(effects, acc=acc, path=path):
            return search(full, acc, path, effects, before, glanced, own)
        return beside_steps(full, again(effects), again, effects)
    by = described(sought(start, found, effects))
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
        full, verdict, causes, known, base, final, by.found, by.parts, before, after,
        by.closure, by.directed, closed_by_any(before), by.rest,
        drift(full, [in_place(as_simulated(acc, full, gap.theta), acc, full)
                     for acc, gap in ((base, before), (final, after))], seed),
        float((final.log_evidence - start.log_evidence) / seen),
        held_out(full, start, final, trials, seed + 2)
        if more or final.hypotheses[0].hypothesis != start.hypotheses[0].hypothesis
        else None, tuple(_bias(simulator, known, acc, full) for acc in (base, final)),
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
    own = acc.sample._replace(theta=acc.sample.theta + done.after.theta - acc.theta)
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


def augmented(d):
    """The `Simulator` of a diagnosis with the effects that were found: ranges have the
    posterior's mean and standard deviation, the phase of a line is that of any record,
    what happened at some time is there or not, from nothing to the size found; when and
    for how long, and readings, are numbers.
    """
    to, sample, theta = d.final.member.in_units, d.final.sample, d.after.theta
    # a uniform range of this half-width has that standard deviation
    width = np.sqrt(3.0) * sample._replace(theta=to(sample.theta)).sd(to(theta))
    ((h, effects),) = as_simulated(d.final, d.scene, theta, width).pairs
    effects = _with_ranges(d, effects)
    offset = _offset(d.scene, d.known)
    base = d.final.bases[d.final.best].hypothesis
    bias_sigma = max(h.bias_sigma or base.bias_sigma, abs(offset))
    if not base.bias_given:    # nobody has said how large it may be
        mean, sd = bias_of(d.final, as_read(d.scene, d.final.readings))
        bias_sigma = float(np.hypot(offset + mean, sd))
    h = _before_rounding(d, h)._replace(bias_sigma=bias_sigma, bias_given=True)
    return Simulator((h,), (tuple(map(_at_any_phase, (
        *d.known, *map(_there_or_not, effects)))),))


def _bias(simulator, known, acc, full):
    """`Bias` of a record beside an account, less the signatures that are known."""
    h, prior = simulator.hypotheses[acc.best], acc.bases[acc.best].bias_sigma
    mean, sd = bias_of(acc, as_read(full, acc.readings)) if prior else (0.0, 0.0)
    by_record = prior**2 - sd**2    # its share of what is known, as a variance
    if by_record > 0.0:
        mean, sd = mean * prior**2 / by_record, sd * prior / np.sqrt(by_record)
    return Bias(mean + _offset(full, known), sd, h.bias_sigma if h.bias_given else
                np.nan, prior > h.bias_sigma)


def _offset(full, known):
    """What was taken off a record beside the signatures that are known."""
    return float(np.mean(full.known - sum((
        signature_of(full, one, known_values(one)) for one in known), 0.0)))


LATENTS = 32    # simulated records that tell how far values of a hypothesis lie apart


def _before_rounding(d, h):
    """A hypothesis, its noises by one factor as strong together as what was rounded to
    counts so coarse that rounding adds no white noise, if nothing else was found.
    """
    lsb = max((r.found.values.get("lsb", 0.0) for r in d.final.readings
               if r.coarse or r.opaque), default=0.0)
    if not lsb or any(not one.effect.reading for one in d.found):
        return h
    _, sigma = latent_law(d.scene.y + d.scene.known, (-np.inf, np.inf), lsb)
    if lsb < SMOOTH * sigma:
        return h
    number = h._replace(bias_sigma=0.0, parameters=tuple(
        p._replace(low=p.mean, high=p.mean) for p in h.parameters))
    drawn = simulate([number], d.scene.dt, len(d.scene.y), LATENTS).error
    factor = sigma / float(np.sqrt(np.mean(np.var(drawn, axis=1))))
    return h._replace(parameters=tuple(
        p._replace(low=factor * p.low, high=factor * p.high)
        if p.symbol.startswith("sigma") else p for p in h.parameters))


def _with_ranges(d, effects):
    """Effects of a simulator, of which those that were found and are columns times a
    size have their parameters in ranges, if they do not begin at some time.
    """
    result, found = list(effects), [one for one in d.found if one.effect.columns]
    at = [k for k, one in enumerate(effects) if one.effect.columns]
    for k, one in zip(at[len(at) - len(found):], found):    # the simulator's come first
        if one.effect.begins:
            continue
        least = 0.0 if one.effect.size == "amplitude" else -np.inf
        within = [*one.effect.parameters(d.scene), Parameter(
            one.effect.size, least, np.inf)]
        result[k] = result[k]._replace(values={**result[k].values, **{
            p.symbol: around(p, mean, np.sqrt(3.0) * sd)
            for p in within for mean, sd in [one.values[p.symbol]]}})
    return result


def _at_any_phase(one):
    """A line as another record has it, which begins at some other time."""
    if one.effect.search != "frequency":
        return one
    return one._replace(values={**one.values, "phase": ANY_PHASE})


ANY_PHASE = Parameter("phase", -np.pi, np.pi)


def _there_or_not(one):
    """What happened in a record at some time, as another record has it: of any size up
    to its own, or a noise that changes by any ratio up to its own.
    """
    if one.effect.drive and not one.column:
        ratio = one.values["ratio"].mean
        return one._replace(values={**one.values, "ratio": Parameter(
            "ratio", min(ratio, 1.0), max(ratio, 1.0), True)})
    if not one.effect.begins:
        return one
    symbol = one.effect.size
    size = known_values(one)[symbol]
    values = {**one.values, symbol: Parameter(symbol, min(size, 0.0), max(size, 0.0))}
    if "phase" in values:
        values["phase"] = ANY_PHASE
    return one._replace(values=values)


# ---- the simulator, and the record less what is known

UNEXPECTED = 3.0        # standard deviations of the mean: a bias the simulator lacks
FAR_FROM_ZERO = 30.0    # standard deviations of the record
ROUNDING = 1e5          # a prior this much wider than the record tells nothing


def _simulator(simulator):
    """A `Simulator` from one, or from hypotheses; refuse what cannot be diagnosed."""
    if not isinstance(simulator, Simulator):
        simulator = Simulator(as_hypotheses(simulator))
    if not simulator.hypotheses:
        raise ValueError("a simulator without a hypothesis: at least one is needed")
    if all(h.model is rate_ramp for h in simulator.hypotheses):
        simulator = _with_ramps_as_effects(simulator)
    sets = [effects for _, effects in simulator.pairs]
    if any(other != sets[0] for other in sets):
        raise ValueError("the hypotheses of the simulator have different effects: "
                         "diagnose takes one set for all")
    return simulator


def _check_recorded(simulator, raw):
    """Refuse a record without a column that the simulator's effects need."""
    for one in simulator.pairs[0][1]:
        for column in one.needs:
            if column not in raw.columns:
                raise ValueError(
                    f"{one.name} of the simulator needs a column {column}: beside the "
                    f"error is {', '.join(raw.columns) or 'nothing'} (--covariates "
                    f"{column}=COLUMN says which it is)")


def _with_ramps_as_effects(simulator):
    """Ramps with a walk, as walks with the effect of a ramp: a slope is a constant."""
    effect, pairs = CATALOGUE["rate_ramp"], []
    for h, effects in simulator.pairs:
        slope, *others = h.parameters
        pairs.append((
            h._replace(model=random_walk, parameters=tuple(others)),
            (*effects, Found(effect, values={effect.size: slope}))))
    return Simulator(*map(tuple, zip(*pairs)))


def _without_known(simulator, raw, latent=None, centred=False):
    """The scene less an offset, which is the `latent` mean if there is one, or the
    mean if it is to be `centred` or is far from zero, and less what the simulator's
    signatures of known size add, these signatures, those of unknown size as
    `Signature`, and the members of the simulator with a bias that the record may have.
    """
    known, free, added = [], [], np.zeros(len(raw.y))
    for one in simulator.pairs[0][1]:
        if not one.effect.columns:
            continue
        size, phase = (one.values.get(key) for key in (one.effect.size, "phase"))
        if any(getattr(p, "free", False) for p in one.values.values()):
            free.append(_of_unknown_size(raw, one))
        if getattr(phase, "free", False):
            continue
        mean = size.mean if isinstance(size, Parameter) else size
        if mean:    # of a range, the rest is in a signature
            known.append(one._replace(values={**one.values, **fixed(
                **{one.effect.size: mean})}))
            added += signature_of(raw, known[-1], known_values(known[-1]))
    y = raw.y - added
    bases = members(simulator, raw._replace(y=y))
    if not all(h.can_be_filtered for h in bases):
        raise ValueError("two effects of the simulator change the noise that passes "
                         "its low-pass: leave one of them out")
    mean, spread, offset = float(np.nanmean(y)), float(np.nanstd(y)), 0.0
    if abs(mean) > UNEXPECTED * expected_mean(bases, raw.dt, len(y)):
        # a bias that the simulator does not expect must not pass for an effect
        bases = tuple(_with_bias(h, max(h.bias_sigma, abs(mean))) for h in bases)
    if latent is not None and any(h.bias_sigma for h in bases):
        offset = latent - float(np.mean(added))
        # a walk gets this far without a bias: less that, it begins where no bias is
        bases = tuple(_with_bias(h, max(h.bias_sigma, abs(offset))) for h in bases)
    elif centred or abs(mean) > FAR_FROM_ZERO * spread:
        offset = mean
    # its prior is flat where the bias may be: less the mean of the record, a flat one
    # about zero says the same, and squares keep their digits
    y = y - offset
    # of two numbers in double precision, one must not drown the other
    bases = tuple(_with_bias(h, min(h.bias_sigma, ROUNDING * max(
        spread, abs(float(np.nanmean(y)))))) for h in bases)
    if known:
        offset = offset + added
    return raw._replace(y=y, known=offset), tuple(known), tuple(free), bases


def _of_unknown_size(raw, one):
    """A signature of the simulator as `Signature`: a line of any phase, or what is not
    known of a size within a range.
    """
    effect = one.effect
    size, phase = one.values[effect.size], one.values.get("phase")
    least, most = (size.low, size.high) if isinstance(size, Parameter) else (size, size)
    any_phase = getattr(phase, "free", False)
    sd = float(max(abs(least), abs(most)) if any_phase else size.sd)
    numbers = {**known_values(one), effect.size: sd}
    return Signature(one._replace(values=numbers),
                     columns_of(raw, one, numbers), sd, not any_phase,
                     (least, most) if any_phase and least > 0.0 else ())


def _with_bias(h, bias_sigma):
    return h._replace(hypothesis=h.hypothesis._replace(bias_sigma=bias_sigma))


PRIOR_NODES = 32    # parameters that stand for a prior


def expected_mean(hypotheses, dt, samples):
    """Root mean square of the means of simulated records, u."""
    weight = np.full(samples, 1.0 / samples)
    return float(np.sqrt(np.mean([
        h.bias_sigma**2 + np.mean(_mean_squares(h, dt, weight)) for h in hypotheses])))


def _mean_squares(h, dt, weight):
    """Mean squares (M,) of the weighted sum of the first samples of a hypothesis, less
    its bias, at parameters that stand for its prior.
    """
    free = len(free_columns(h.parameters))
    u = LatinHypercube(max(free, 1), rng=0).random(PRIOR_NODES if free else 1)
    return [mean_square(weight, *h.filter(dt, theta))
            for theta in at_quantiles(h.parameters, u[:, :free])]


def _check_units(scene, bases):
    """Refuse a record and a simulator that cannot be in one unit: no filter of the
    simulator comes near such a record, and what would be found is a matter of rounding.
    """
    weight = np.array([-1.0, 1.0]) / np.sqrt(2.0)
    most = CATALOGUE["wrong_parameter"].factor    # no parameter is more wrong
    noise = np.sqrt(max(max(_mean_squares(h, scene.dt, weight)) for h in bases))
    if scene.white > most * noise and not any(h.has_jumps for h in bases):
        raise ValueError(
            f"the noise of the record, {scene.white:.3g} from one sample to the next, "
            f"is {scene.white / noise:.2g} times the largest that the simulator has, "
            f"{noise:.3g}: give both in one unit, or the simulator white noise")


def _with_readings(full, bases, signatures, read):
    """The account of the simulator with signatures and readings."""
    inside = tuple(one._replace(values=fixed(**one.values)) for r in read
                   for one in [r.found] if one.effect.model)
    return account(as_read(full, read), bases, tuple(
        h._replace(effects=h.effects + inside) for h in bases), signatures, read)


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
    low, middle, high = np.quantile(seen, [0.25, 0.5, 0.75])
    off = np.abs(y - middle)
    if high > low and np.nanmax(off) > NO_READING * (high - low):
        k = int(np.nanargmax(off))
        raise ValueError(f"sample {k} is {y[k]:g}, where half of the record lies from "
                         f"{low:g} to {high:g}: no sensor reads that; mark it as "
                         "missing, by NaN or an empty value and --allow-missing")


NO_READING = 1e6    # times the spread of a record: a shock to full scale is 10^5


def check_columns(y, columns):
    """Refuse columns that do not go with a record."""
    for name, x in columns.items():
        if x.shape != y.shape:
            raise ValueError(f"column {name} has shape {x.shape}: {len(y)} numbers are "
                             "needed, one for every sample")
        if not np.isfinite(x).all():
            k = int(np.argmin(np.isfinite(x)))
            raise ValueError(f"column {name} has {np.sum(~np.isfinite(x))} values that "
                             f"are not finite, the first {x[k]} at sample {k}: numbers "
                             "are needed, one for every sample")
        if _is_record(y, x):
            raise ValueError(f"column {name} is the record itself, but for an offset "
                             "and a factor: it would explain all of it; leave it out "
                             "(--covariates says which columns are used)")


COPY = 1e-5    # of the spread of a record, that a copy of it leaves: it was printed
               # with so many digits


def _is_record(y, x):
    """Does a column leave nothing of a record?"""
    seen = ~np.isnan(y)
    y, x = y[seen] - y[seen].mean(), x[seen] - x[seen].mean()
    xx, yy = dot(x, x), dot(y, y)
    return xx > 0.0 and yy > 0.0 and 1.0 - dot(x, y)**2 / (xx * yy) < COPY**2
