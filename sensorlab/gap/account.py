"""What a record is explained by: a fit of all hypotheses; the simulator it implies."""

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from sensorid import Parameter, free_columns
from sensorlab.gap.effects import CATALOGUE, Added, _beside
from sensorlab.gap.filters import _has_jumps, _log_likelihoods, predict, solve
from sensorlab.gap.evidence import integrate, onset_law


class Account(NamedTuple):
    """What a record is explained by."""

    bases: tuple         # of Hypothesis: the simulator without effects
    hypotheses: tuple    # the same with processes and jumps
    signatures: tuple    # of Signature
    readings: tuple      # of Reading
    samples: tuple       # of Sample, one of every hypothesis
    log_evidence: float
    best: int            # number of the most probable hypothesis
    theta: np.ndarray    # (p,) parameters that stand for its posterior

    @property
    def peak(self):
        """Largest log-likelihood that any hypothesis reaches."""
        return max(s.log_likelihood.max() for s in self.samples)


def account(scene, bases, hypotheses=None, signatures=(), found=(), past=None,
            floor=-np.inf):
    """Fit of all hypotheses to a scene, with equal prior probabilities.

    `past` is an account of hypotheses with fewer parameters, if there is one; `floor`
    as for `integrate`.
    """
    hypotheses = bases if hypotheses is None else hypotheses

    def likelihood_of(h):
        return lambda theta: _log_likelihoods(h, scene, signatures, theta)[:, None]
    samples, evidence = [None] * len(hypotheses), np.full(len(hypotheses), -np.inf)
    past_evidence = [s.log_evidence[0] for s in past.samples] if past else evidence
    for number in np.argsort(past_evidence, kind="stable")[::-1]:
        h = hypotheses[number]
        samples[number] = integrate(
            likelihood_of(h), h.parameters, _guess(past, number),
            onset_law(h, scene, signatures), max(floor, evidence.max()))
        evidence[number] = samples[number].log_evidence[0]
    best = int(np.argmax(evidence))
    return Account(tuple(bases), tuple(hypotheses), tuple(signatures), tuple(found),
                   tuple(samples), _mean_evidence(evidence), best,
                   _central(samples[best], likelihood_of(hypotheses[best])))


def _central(sample, log_likelihood):
    """Posterior mean, or the most likely node where the posterior is bent around it:
    there the mean is less likely than a node is on average.
    """
    mean, ll = sample.weight @ sample.theta, sample.log_likelihood[:, 0]
    if log_likelihood(mean[None])[0, 0] >= sample.weight @ ll:
        return mean
    return sample.theta[ll.argmax()]


def _guess(acc, number):
    """Mean and covariance of a hypothesis in the coordinates of `integrate`."""
    if acc is None or not free_columns(acc.hypotheses[number].parameters):
        return None
    w, x = acc.samples[number].weight, acc.samples[number].x
    return w @ x, np.atleast_2d(np.cov(x.T, aweights=w, ddof=0))


def _mean_evidence(log_evidence):
    return float(logsumexp(log_evidence) - np.log(len(log_evidence)))


def _gaussian(scene, acc):
    """Scene, hypotheses and prior samples without jumps: sure outliers are masked,
    a telegraph becomes the Markov process of its covariance.
    """
    h = acc.hypotheses[acc.best]
    if not _has_jumps(h):
        return scene, acc.hypotheses
    odd = predict(h, scene, acc.signatures, acc.theta[None]).odd[0, 0]
    masked = scene._replace(y=np.where(odd > 0.5, np.nan, scene.y))
    plain = []
    for h, sample in zip(acc.hypotheses, acc.samples):
        values = dict(zip((p.symbol for p in h.parameters),
                          sample.weight @ sample.theta))
        jumps = {s: v for s, v in values.items()
                 if s.startswith(("outliers.", "random_telegraph."))}

        def model(dt, h=h, jumps=jumps, **rest):
            filt = h.model(dt, **rest, **jumps)
            if "random_telegraph.size" in jumps:
                filt = _beside(
                    filt, [np.exp(-2.0 * dt / jumps["random_telegraph.dwell"])],
                    [0.5 * jumps["random_telegraph.size"]])
            return filt
        plain.append(h._replace(model=model, parameters=tuple(
            p for p in h.parameters if p.symbol not in jumps)))
    return masked, tuple(plain)


def as_simulated(acc, scene, theta, widths=None):
    """The best hypothesis of an account, and its effects, with numbers for parameters.

    `widths` (p,) turns those of the base into ranges theta -+ width.
    """
    h, base = acc.hypotheses[acc.best], acc.bases[acc.best]
    widths = np.zeros(len(theta)) if widths is None else widths
    value = {p.symbol: (v, w) for p, v, w in zip(h.parameters, theta, widths)}

    def ranged(p):
        v, w = value[p.symbol]
        low = max(v - w, p.low) if v >= p.low else v
        high = min(v + w, p.high) if v <= p.high else v
        return Parameter(p.symbol, low, high)
    effects = {}
    for symbol in value:
        effect, dot, name = symbol.rpartition(".")
        if dot:
            effects.setdefault(effect, {})[name] = Parameter(
                name, value[symbol][0], value[symbol][0])
    added = [Added(h.model.effects[effect], "", "", parameters)
             for effect, parameters in effects.items()]
    masked, hypotheses = _gaussian(scene, acc)
    inner = hypotheses[acc.best]
    sizes = iter(())
    if acc.signatures:
        at = np.array([[value[p.symbol][0] for p in inner.parameters]])
        sizes = iter(solve(inner, masked, acc.signatures, at).size[0, 1:])
    for s in acc.signatures:
        e = s.effect
        size = [next(sizes) for _ in range(s.columns.shape[1])]
        numbers = {p.symbol: s.psi for p in e.parameters(scene)}
        numbers[e.size] = float(np.hypot(*size) if len(size) == 2 else size[0])
        if len(size) == 2:
            numbers["phase"] = float(np.arctan2(-size[1], size[0]))
        added.append(Added(e, s.column, s.variant, {
            k: Parameter(k, v, v) for k, v in numbers.items()}))
    added += [Added(CATALOGUE[r.effect], "", "", r.value) for r in acc.readings]
    plain = getattr(base.model, "plain", base)
    return base._replace(model=plain.model, parameters=tuple(
        map(ranged, plain.parameters))), tuple(added)
