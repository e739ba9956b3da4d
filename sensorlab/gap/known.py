"""What is known before a diagnosis: a simulator that can be diagnosed, and the record
less what that says of it.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats.qmc import LatinHypercube

from sensorid import (
    Parameter, as_hypotheses, as_samples, at_quantiles, check_axis, check_interval,
    default_hypotheses, free_columns, mean_square, random_walk, rate_ramp)
from sensorlab.gap.account import account
from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.dropouts import less_dropouts
from sensorlab.gap.effects import Found, columns_of, fixed, known_values, signature_of
from sensorlab.gap.kernels.arithmetic import dot
from sensorlab.gap.linear import Signature
from sensorlab.gap.members import Simulator, members
from sensorlab.gap.readings import as_read
from sensorlab.gap.standins import bias_of

UNEXPECTED = 3.0        # standard deviations of the mean: a bias the simulator lacks
FAR_FROM_ZERO = 30.0    # standard deviations of the record
ROUNDING = 1e5          # a prior this much wider than the record tells nothing


def default_simulator(y, dt):
    """A `Simulator` of the default hypotheses of a record (N,); lost samples for which
    it has a constant tell nothing of their ranges.
    """
    return Simulator(default_hypotheses(less_dropouts(y), dt))


def as_simulator(simulator):
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


def as_columns(columns):
    """Columns by name, of a dictionary, or a table, of them, or None."""
    try:
        named = {} if columns is None else dict(columns)
    except (TypeError, ValueError):
        raise ValueError(f"columns are {columns!r}: a dictionary, or a table, of what "
                         "was recorded beside the error is needed") from None
    return {str(name): as_samples(x) for name, x in named.items()}


def check_recorded(simulator, raw):
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


def without_known(simulator, raw, latent=None, centred=False):
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
        h.bias_sigma**2 + np.mean(mean_squares(h, dt, weight)) for h in hypotheses])))


def mean_squares(h, dt, weight, nodes=None):
    """Mean squares (M,) of the weighted sum of the first samples of a hypothesis, less
    its bias, at nodes (M, p), or at parameters that stand for its prior.
    """
    if nodes is None:
        free = len(free_columns(h.parameters))
        u = LatinHypercube(max(free, 1), rng=0).random(PRIOR_NODES if free else 1)
        nodes = at_quantiles(h.parameters, u[:, :free])
    return [mean_square(weight, *h.filter(dt, theta)) for theta in nodes]


def check_units(scene, bases):
    """Refuse a record and a simulator that cannot be in one unit: no filter of the
    simulator comes near such a record, and what would be found is a matter of rounding.
    """
    weight = np.array([-1.0, 1.0]) / np.sqrt(2.0)
    most = CATALOGUE["wrong_parameter"].factor    # no parameter is more wrong
    of_all = np.sqrt(np.concatenate([mean_squares(h, scene.dt, weight)
                                     for h in bases]))
    least, noise = of_all.min(), of_all.max()
    if scene.white > most * noise and not any(h.has_jumps for h in bases):
        raise ValueError(
            f"the noise of the record, {scene.white:.3g} from one sample to the next, "
            f"is {scene.white / noise:.2g} times the largest that the simulator has, "
            f"{noise:.3g}: give both in one unit, or the simulator white noise")
    if (spread := np.nanstd(scene.y)) * most < least:    # what is slow is in it, too
        raise ValueError(
            f"the whole record, of standard deviation {spread:.3g}, moves "
            f"{spread / least:.2g} times as much as the least noise that the simulator "
            f"has, {least:.3g}: give both in one unit")


def with_readings(full, bases, signatures, read):
    """The account of the simulator with signatures and readings."""
    inside = tuple(one._replace(values=fixed(**one.values)) for r in read
                   for one in [r.found] if one.effect.model)
    return account(as_read(full, read), bases, tuple(
        h._replace(effects=h.effects + inside) for h in bases), signatures, read)


MIN_SAMPLES = 64    # fewer tell no effect from the noise


def check_scene(y, dt, columns):
    """Refuse what cannot be diagnosed."""
    check_interval(dt)
    check_axis(y)
    seen = y[~np.isnan(y)]
    if len(seen) < MIN_SAMPLES or np.ptp(seen) == 0.0:
        raise ValueError(f"the record has {len(seen)} samples, "
                         f"{len(np.unique(seen))} different ones: at least "
                         f"{MIN_SAMPLES} that are not all the same are needed")
    check_columns(y, columns)
    low, middle, high = np.quantile(seen, [0.25, 0.5, 0.75])
    off = np.abs(y - middle)
    if high > low and np.nanmax(off) > NO_READING * (high - low):
        k = int(np.nanargmax(off))
        raise ValueError(f"sample {k} is {y[k]:g}, where half of the record lies from "
                         f"{low:g} to {high:g}: no sensor reads that; mark it as "
                         "missing, by NaN or an empty value and --allow-missing")


NO_READING = 1e6    # times the spread of a record: a shock to full scale is 10^5


def as_records(records, dt):
    """Records of a simulator as an array (L, N); refuse what cannot be diagnosed."""
    rows = np.atleast_2d(records) if hasattr(records, "__array__") else records
    try:
        result = np.atleast_2d(np.array([as_samples(y) for y in rows]))
    except (TypeError, ValueError):
        result = np.empty(0)
    if result.ndim != 2 or not result.size:
        raise ValueError("records of a simulator: an array (L, N) of numbers is "
                         "needed, each record as long as the others, NaN where a "
                         "sample is missing")
    for number, y in enumerate(result):
        try:
            check_scene(y, dt, {})
        except ValueError as wrong:
            raise ValueError(f"record {number} of the simulator: {wrong}") from None
    return result


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


def bias_beside(simulator, known, acc, full):
    """`Bias` of a record beside an account, less the signatures that are known."""
    h, prior = simulator.hypotheses[acc.best], acc.bases[acc.best].bias_sigma
    mean, sd = bias_of(acc, as_read(full, acc.readings)) if prior else (0.0, 0.0)
    by_record = prior**2 - sd**2    # its share of what is known, as a variance
    if by_record > 0.0:
        mean, sd = mean * prior**2 / by_record, sd * prior / np.sqrt(by_record)
    return Bias(mean + offset_of(full, known), sd, h.bias_sigma if h.bias_given else
                np.nan, prior > h.bias_sigma)


def offset_of(full, known):
    """What was taken off a record beside the signatures that are known."""
    return float(np.mean(full.known - sum((
        signature_of(full, one, known_values(one)) for one in known), 0.0)))
