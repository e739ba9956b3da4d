"""An account: what a record is explained by, and the simulator that this implies."""

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from sensorid import Parameter, brief, free_columns, probabilities
from sensorlab.gap.catalogue import beside
from sensorlab.gap.effects import Effect, Found, Simulator
from sensorlab.gap.evidence import effort, integrate, onset_law
from sensorlab.gap.filters import log_likelihoods, predict, solve
from sensorlab.gap.spectra import posterior_law


class Account(NamedTuple):
    """What a record is explained by."""

    bases: tuple         # of Member: the simulator as it was
    hypotheses: tuple    # of Member: the same with effects that were found
    signatures: tuple    # of Signature
    readings: tuple      # of Reading
    samples: tuple       # of Sample, one of every hypothesis
    log_evidence: float
    best: int            # number of the most probable hypothesis
    theta: np.ndarray    # (p,) parameters that stand for its posterior

    __repr__ = brief

    @property
    def member(self):
        """The most probable hypothesis."""
        return self.hypotheses[self.best]

    @property
    def sample(self):
        """Of the most probable hypothesis."""
        return self.samples[self.best]

    @property
    def error(self):
        """Standard deviation of the log evidence by chance of the nodes, nats."""
        return evidence_error(self.samples)

    @property
    def peak(self):
        """Largest log-likelihood that any hypothesis reaches."""
        return max(s.log_likelihood.max() for s in self.samples)


def account(scene, bases, hypotheses=None, signatures=(), readings=(), past=None,
            floor=-np.inf):
    """Fit of all hypotheses to a scene, with equal prior probabilities.

    `past` is another account of about the same record, if there is one; `floor` as for
    `integrate`.
    """
    hypotheses = bases if hypotheses is None else hypotheses

    def likelihood_of(h):
        return lambda theta: log_likelihoods(h, scene, signatures, theta)[:, None]
    samples, evidence = [None] * len(hypotheses), np.full(len(hypotheses), -np.inf)
    past_evidence = [s.log_evidence[0] for s in past.samples] if past else evidence
    for number in np.argsort(past_evidence, kind="stable")[::-1]:
        h = hypotheses[number]
        samples[number] = integrate(
            likelihood_of(h), h.parameters,
            guesses_from(past, number, h, scene, signatures) if past else (),
            onset_law(h, scene, signatures), max(floor, evidence.max()),
            effort=effort(scene))
        evidence[number] = samples[number].log_evidence[0]
    best = int(np.argmax(evidence))
    return Account(tuple(bases), tuple(hypotheses), tuple(signatures), tuple(readings),
                   tuple(samples), mean_evidence(evidence), best,
                   central(samples[best], likelihood_of(hypotheses[best])))


def central(sample, log_likelihood):
    """Posterior mean, or the most likely node where the posterior is bent around it:
    there the mean is less likely than a node is on average.
    """
    mean, ll = sample.mean, sample.log_likelihood[:, 0]
    if log_likelihood(mean[None])[0, 0] >= sample.weight @ ll:
        return mean
    return sample.theta[ll.argmax()]


def guesses_from(past, number, h, scene, signatures):
    """Pairs of mean and covariance that the free parameters of a hypothesis, or the
    first of them, may have in the coordinates of `integrate`.
    """
    other, sample = past.hypotheses[number], past.samples[number]
    own, before = free_columns(h.parameters), free_columns(other.parameters)
    if not own or not before and h.is_patchy:
        return ()
    mean, cov = sample.law if before else (np.zeros(0), np.zeros((0, 0)))
    same = {h.keys[c]: axis for axis, key in enumerate(other.keys[b] for b in before)
            for c in own if h.keys[c] == key and _is_same(
                h.parameters[c], other.parameters[before[axis]])}
    axes = [same.get(h.keys[c]) for c in own]
    first = axes[:axes.index(None) if None in axes else None]
    result = [(mean[first], cov[np.ix_(first, first)])] if first else []
    if h.is_patchy or axes == [*range(len(mean))] and len(
            signatures) == len(past.signatures):
        return result
    # where what is new is weak, all else is as it was; where not, its spectrum tells
    return [*result, posterior_law(
        h, scene, signatures, other, sample.theta[sample.log_likelihood[:, 0].argmax()],
        {key: mean[axis] for key, axis in same.items()})]


def _is_same(p, q):
    """Are two priors one, so that their coordinates are?"""
    return p is q or type(p) is type(q) is Parameter and p == q


def mean_evidence(log_evidence):
    """Log of the mean over hypotheses of equal prior probability."""
    return float(logsumexp(log_evidence) - np.log(len(log_evidence)))


def evidence_error(samples, number=0):
    """Standard deviation, nats, of the mean evidence of explanation `number` over
    hypotheses by chance of their nodes.
    """
    share = probabilities([s.log_evidence[number] for s in samples])
    return float(np.linalg.norm([part * s.error[number]
                                 for part, s in zip(share, samples)]))


def fixed(**values):
    """Values of an effect as parameters that are known."""
    return {symbol: Parameter(symbol, float(v), float(v))
            for symbol, v in values.items()}


def _level_as_noise(scene, filt, change, half):
    return beside(filt, [1.0 - 2.0 * change], [half])


LEVEL_AS_NOISE = Effect("level_as_noise", model=_level_as_noise, elementwise=True)


def gaussian(scene, acc):
    """Scene and hypotheses without jumps: sure outliers are masked, a level of two
    values becomes the Markov process of its covariance.
    """
    if not acc.member.has_jumps:
        return scene, acc.hypotheses
    odd = predict(acc.member, scene, acc.signatures, acc.theta[None]).odd[0, 0]
    masked = scene._replace(y=np.where(odd > 0.5, np.nan, scene.y))
    plain = []
    for h, sample in zip(acc.hypotheses, acc.samples):
        effects = tuple(one for one in h.effects if not one.effect.jumps)
        jumps = h.jumps(sample.mean[None])
        if jumps.half[0] > 0.0:
            effects += (Found(LEVEL_AS_NOISE, values=fixed(change=jumps.change[0],
                                                           half=jumps.half[0])),)
        plain.append(h._replace(effects=effects))
    return masked, tuple(plain)


def as_simulated(acc, scene, theta, widths=None):
    """The most probable hypothesis of an account, and its effects, with numbers for
    parameters, as a `Simulator`.

    `widths` (p,) turns those of the base into ranges theta -+ width. Of a record that
    is clipped the bias counts, as the limits stand still: it is that of the scene.
    """
    base = acc.bases[acc.best].hypothesis
    clipped = any("limits" in r.found.values for r in acc.readings)
    widths = np.zeros(len(theta)) if widths is None else widths
    scaled = acc.member.in_units(theta)
    h = base._replace(bias_sigma=0.0 if clipped else base.bias_sigma, parameters=tuple(
        _around(p, v, w) for p, v, w in zip(base.parameters, scaled, widths)))
    for one in acc.member.effects:
        if one.effect.factor:    # what makes a bias larger is in the base already
            h = h._replace(bias_sigma=h.bias_sigma * min(
                acc.member.value(theta, one.key, "factor"), 1.0))
    inside = [one._replace(values=fixed(**acc.member.of(one, scaled)))
              for one in acc.member.effects
              if not (one.effect.reading or one.effect.factor)]
    return Simulator((h,), ((*inside, *_with_sizes(acc, scene, theta),
                             *(r.found for r in acc.readings)),))


def _around(p, value, width):
    """A parameter known to +- width, within its prior if the value is."""
    low = max(value - width, p.low) if value >= p.low else value
    high = min(value + width, p.high) if value <= p.high else value
    return Parameter(p.symbol, low, high)


def _with_sizes(acc, scene, theta):
    """The signatures of an account, as `Found`, with their least-squares sizes."""
    if not acc.signatures:
        return []
    masked, hypotheses = gaussian(scene, acc)
    plain = hypotheses[acc.best]
    at = acc.member.matching(plain, theta)[None]
    sizes, result = iter(solve(plain, masked, acc.signatures, at).size[0, 1:]), []
    for s in acc.signatures:
        size = [next(sizes) for _ in range(s.columns.shape[1])]
        values = {**s.found.values, s.found.effect.size: np.hypot(*size)
                  if len(size) == 2 else size[0]}
        if len(size) == 2:
            values["phase"] = np.arctan2(-size[1], size[0])
        result.append(s.found._replace(values=fixed(**values)))
    return result
