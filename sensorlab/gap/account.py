"""An account: what a record is explained by, and the simulator that this implies."""

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from sensorid import Parameter, brief, free_columns
from sensorlab.gap.catalogue import beside
from sensorlab.gap.effects import Effect, Found, Simulator
from sensorlab.gap.evidence import effort, integrate, onset_law
from sensorlab.gap.filters import log_likelihoods, predict, solve


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
    def peak(self):
        """Largest log-likelihood that any hypothesis reaches."""
        return max(s.log_likelihood.max() for s in self.samples)


def account(scene, bases, hypotheses=None, signatures=(), readings=(), past=None,
            floor=-np.inf):
    """Fit of all hypotheses to a scene, with equal prior probabilities.

    `past` is an account of hypotheses with fewer parameters, if there is one; `floor`
    as for `integrate`.
    """
    hypotheses = bases if hypotheses is None else hypotheses

    def likelihood_of(h):
        return lambda theta: log_likelihoods(h, scene, signatures, theta)[:, None]
    samples, evidence = [None] * len(hypotheses), np.full(len(hypotheses), -np.inf)
    past_evidence = [s.log_evidence[0] for s in past.samples] if past else evidence
    for number in np.argsort(past_evidence, kind="stable")[::-1]:
        h = hypotheses[number]
        samples[number] = integrate(
            likelihood_of(h), h.parameters, guess_from(past, number),
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


def guess_from(past, number):
    """Mean and covariance of a hypothesis in the coordinates of `integrate`."""
    if past is None or not free_columns(past.hypotheses[number].parameters):
        return None
    return past.samples[number].law


def mean_evidence(log_evidence):
    """Log of the mean over hypotheses of equal prior probability."""
    return float(logsumexp(log_evidence) - np.log(len(log_evidence)))


def fixed(**values):
    """Values of an effect as parameters that are known."""
    return {symbol: Parameter(symbol, float(v), float(v))
            for symbol, v in values.items()}


def _level_as_noise(scene, filt, change, half):
    return beside(filt, [1.0 - 2.0 * change], [half])


LEVEL_AS_NOISE = Effect("level_as_noise", model=_level_as_noise)


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
    h = base._replace(bias_sigma=0.0 if clipped else base.bias_sigma, parameters=tuple(
        _around(p, v, w) for p, v, w in zip(base.parameters, theta, widths)))
    inside = [one._replace(values=fixed(**acc.member.of(one, theta)))
              for one in acc.member.effects if not one.effect.reading]
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
