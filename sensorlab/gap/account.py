"""An account: what a record is explained by."""

from typing import NamedTuple

import numpy as np

from sensorid import brief, probabilities, side_by_side
from sensorlab.gap.changes import onset_law
from sensorlab.gap.evidence import effort, integrate, log_sum
from sensorlab.gap.filters import log_likelihoods
from sensorlab.gap.guesses import guesses_from
from sensorlab.gap.scales import scale_law


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
            floor=-np.inf, tails=0):
    """Fit of all hypotheses to a scene, with equal prior probabilities.

    `past` is another account of about the same record, if there is one; `floor` and
    `tails` as for `integrate`.
    """
    hypotheses = bases if hypotheses is None else hypotheses

    def likelihood_of(h):
        return lambda theta: log_likelihoods(h, scene, signatures, theta)[:, None]
    guesses = side_by_side(lambda number: guesses_from(
        past, number, hypotheses[number], scene, signatures) if past else (),
        range(len(hypotheses)))
    samples, evidence = [None] * len(hypotheses), np.full(len(hypotheses), -np.inf)
    past_evidence = [s.log_evidence[0] for s in past.samples] if past else evidence
    for number in np.argsort(past_evidence, kind="stable")[::-1]:
        h = hypotheses[number]
        samples[number] = integrate(
            likelihood_of(h), h.parameters, guesses[number],
            onset_law(h, scene, signatures) or scale_law(h, scene, signatures),
            max(floor, evidence.max()),
            effort=effort(scene), tails=tails)
        evidence[number] = samples[number].log_evidence[0]
    best = int(np.argmax(evidence))
    return Account(tuple(bases), tuple(hypotheses), tuple(signatures), tuple(readings),
                   tuple(samples), mean_evidence(evidence) + sum(
                       s.gain for s in signatures), best,
                   central(samples[best], likelihood_of(hypotheses[best])))


TAILS = 8    # rounds


def with_tails(scene, acc):
    """The account of a scene, its posterior known far out, too; of a long record it is
    narrow.
    """
    if effort(scene) < 1.0:
        return acc
    return account(scene, acc.bases, acc.hypotheses, acc.signatures, acc.readings, acc,
                   tails=TAILS)


def central(sample, log_likelihood):
    """Posterior mean, or the most likely node where the posterior is bent around it:
    there the mean is less likely than a node is on average.
    """
    mean, ll = sample.mean, sample.log_likelihood[:, 0]
    if log_likelihood(mean[None])[0, 0] >= sample.weight @ ll:
        return mean
    return sample.likeliest


def mean_evidence(log_evidence):
    """Log of the mean over hypotheses of equal prior probability."""
    return float(log_sum(log_evidence) - np.log(len(log_evidence)))


def evidence_error(samples, number=0):
    """Standard deviation, nats, of the mean evidence of explanation `number` over
    hypotheses by chance of their nodes.
    """
    share = probabilities([s.log_evidence[number] for s in samples])
    return float(np.linalg.norm([part * s.error[number]
                                 for part, s in zip(share, samples)]))
