"""A simulator that is known by its records alone.

They are described as a real record is, and what the description leaves out of both is
no gap: distances of a record count from those of the simulator's own.
"""

import numpy as np
from scipy.special import ndtr
from scipy.stats import t as student

from sensorid import Parameter
from sensorlab.gap.account import account
from sensorlab.gap.augmented import with_ranges
from sensorlab.gap.diagnosis import diagnose
from sensorlab.gap.effects import fixed
from sensorlab.gap.implied import NEAREST
from sensorlab.gap.joint import joint_of
from sensorlab.gap.known import as_records, mean_squares
from sensorlab.gap.members import Simulator
from sensorlab.gap.readings import as_read, readings, recorded
from sensorlab.gap.standins import solved_by

MOST_RECORDS = 20    # that are described


def simulator_from(records, dt, columns=None):
    """`Simulator` that describes records of a black box.

    Parameters
    ----------
    records : (L, N) array
        u; NaN marks a missing sample.
    dt : float
        Sampling interval, s.
    columns : dict of (N,) arrays, optional
        What was recorded beside all of them.

    Returns
    -------
    Simulator
        Hypothesis and effects of the first record; of hypotheses that it does not tell
        apart, that which drifts most. A parameter has the range in which that of a
        further record lies with 95 %: of its posterior where there is one record; where
        there are several, of Student's law of the posterior means, or of
        what is known of each and of how far runs may be apart. One record tells them
        together, too: `Simulator.joint`. The amplitude of a line that several records
        tell has that of Student's law; of one, any may be as large. It keeps the
        records: what they have, too, is no gap for `diagnose`.

    Raises
    ------
    ValueError
        If the records are no such array, or one of them cannot be diagnosed.
    """
    records = as_records(records, dt)[:MOST_RECORDS]
    first = diagnose(records[0], dt, columns=columns)
    acc = _that_drifts_most(first.final, len(records[0]), dt)
    seen = as_read(first.scene, acc.readings)
    samples, amplitudes = [acc.sample], [_amplitudes(seen, acc)]
    for y in records[1:]:
        scene = recorded(y, dt, columns or {})
        # what clipped samples may have been is drawn: it would widen the ranges
        scene = as_read(scene, [r for r in readings(scene)
                                if "limits" not in r.found.values])
        own = account(scene, acc.bases[acc.best:acc.best + 1], [acc.member],
                      acc.signatures)
        samples.append(own.sample)
        amplitudes.append(_amplitudes(scene, own))
    # a factor on all standard deviations is in them
    samples = [s._replace(theta=acc.member.in_units(s.theta)) for s in samples]
    ranges = _ranges(acc.member.parameters, samples)
    base, count = acc.member.hypothesis, len(acc.member.hypothesis.parameters)
    spread = np.nanmean(records, axis=1)
    h = base._replace(parameters=ranges[:count], bias_given=True, bias_sigma=float(
        np.sqrt(np.mean(spread**2)) + np.nanstd(records[0])))
    inside = iter(ranges[count:])
    effects = [one._replace(values={symbol: next(inside) for symbol in one.values})
               for one in acc.member.effects]
    effects = [one for one in effects
               if not (one.effect.reading or one.effect.factor)]
    inside, columns = len(effects), with_ranges(first, [*effects, *(s.found._replace(
        values=fixed(**s.found.values)) for s in acc.signatures)])
    effects += [one._replace(values={**one.values, **_sizes(s, own)})
                for one, s, own in zip(columns[inside:], acc.signatures,
                                       np.transpose(amplitudes))]
    joint = None if len(records) > 1 else joint_of(seen, acc, ranges)
    return Simulator((h,), ((*effects, *(r.found for r in acc.readings)),), joint,
                     records)


OCCAM = np.log(20.0)    # nats of evidence, by which one hypothesis excludes another (D.
                        # Madigan, A. Raftery, J. Am. Stat. Assoc. 89, 1994)
DRIFTS = 16    # nodes that tell how far a hypothesis drifts


def _that_drifts_most(acc, samples, dt):
    """An account, the best of its hypotheses being that which drifts most, from half to
    half of so many samples, of those that no other excludes: a walk that one record
    does not show may show in the next, and is no gap.
    """
    half = samples // 2
    weight = np.repeat([-1.0 / half, 1.0 / half], half)
    evidence = np.array([s.log_evidence[0] for s in acc.samples])

    def drift(number):
        one = acc.hypotheses[number]
        nodes = one.in_units(acc.samples[number].nodes(DRIFTS))
        count = len(one.hypothesis.parameters)
        return np.mean(mean_squares(one.hypothesis, dt, weight, nodes[:, :count]))
    best = int(max(np.flatnonzero(evidence > evidence.max() - OCCAM), key=drift))
    return acc if best == acc.best else acc._replace(
        best=best, theta=acc.samples[best].mean)


def _amplitudes(scene, acc):
    """Sizes of the signatures of an account, of two columns as one."""
    size = solved_by(acc, scene).size[0, 1:]
    parts = np.split(size, np.cumsum([s.columns.shape[1] for s in acc.signatures])[:-1]
                     ) if acc.signatures else []
    return [float(np.linalg.norm(part)) for part in parts]


def _sizes(s, amplitudes):
    """Range of the size of a signature in a further record, from those of some (L,),
    and of its phase; it differs from run to run.
    """
    size, middle = s.found.effect.size, np.mean(amplitudes)
    if s.found.effect.search == "frequency" and len(amplitudes) > 1:
        half = _half(amplitudes)
        if half < middle:
            return {size: Parameter(size, middle - half, middle + half),
                    "phase": Parameter("phase", -np.pi, np.pi)}
    return {size: Parameter(size, -s.sd, s.sd)}


def _half(values):
    """Half of the range in which a further value lies with 95 %, by some (L,)."""
    L = len(values)
    return float(student.ppf(0.975, L - 1) * np.sqrt(1.0 + 1.0 / L)
                 * np.std(values, ddof=1))


APART = 0.3    # by which logarithms of a parameter may differ from run to run, a priori
SPREADS = np.append(0.0, np.geomspace(1e-3, 30.0, 200))    # of these, that are tried
HALVES = np.geomspace(1e-4, 100.0, 500)    # of ranges


def _half_beside(means, sds):
    """The same of values that are known by means and standard deviations (L,), of which
    it is known a priori how far they may be apart: by a half-Cauchy law of their
    standard deviation (A. Gelman, "Prior distributions for variance parameters in
    hierarchical models", Bayesian Anal. 1, 2006).
    """
    spread = APART * SPREADS
    variance = np.maximum(spread[:, None]**2 + sds**2, 1e-30)    # some are numbers
    weight = 1.0 / variance
    total = weight.sum(1)
    middle = (weight * means).sum(1) / total
    log_p = -0.5 * (np.log(variance).sum(1) + np.log(total) + (
        weight * (means - middle[:, None])**2).sum(1))
    p = np.exp(log_p - log_p.max()) / (1.0 + SPREADS**2) * np.gradient(spread)
    sd, off = np.sqrt(spread**2 + 1.0 / total), middle - means.mean()
    inside = ndtr((HALVES[:, None] - off) / sd) - ndtr((-HALVES[:, None] - off) / sd)
    return float(HALVES[np.searchsorted(inside @ (p / p.sum()), 0.95)])


ROUNDING = 1e-9    # of a number: its range is none


def _ranges(parameters, samples):
    """The parameters of a further record, from posterior samples of L records."""
    result, of_several = [], len(samples) > 1
    for column, p in enumerate(parameters):
        in_logs = of_several and p.low > 0.0
        values = [s.theta[:, column] for s in samples]
        values = [np.log(x) for x in values] if in_logs else values
        means = np.array([s.weight @ x for s, x in zip(samples, values)])
        sds = np.array([np.sqrt(s.weight @ (x - m)**2)
                        for s, x, m in zip(samples, values, means)])
        middle, half = means.mean(), 2.0 * np.sqrt(np.mean(sds**2))
        if in_logs:
            half = max(half / np.sqrt(len(samples)), min(
                _half(means), _half_beside(means, sds)))
        elif of_several:    # what the posterior means scatter is of both kinds
            half = max(half, _half(means))
        low, high = middle - half, middle + half
        if half <= ROUNDING * (1.0 if in_logs else abs(middle)):
            result.append(p)
        elif in_logs:
            result.append(Parameter(p.symbol, float(np.exp(low)), float(np.exp(high))))
        else:
            result.append(Parameter(p.symbol, float(
                max(low, NEAREST * middle) if middle > 0.0 else low), float(high)))
    return tuple(result)
