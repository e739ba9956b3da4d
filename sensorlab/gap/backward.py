"""The backward pass: what a record tells of every further signature at once."""

from typing import NamedTuple

import numpy as np

from sensorid import Bank, Modes, brief
from sensorlab.gap.kernels.adjoint import STEP, adjoint
from sensorlab.gap.kernels.arithmetic import dot, row_products
from sensorlab.gap.linear import Filter, constants, cut, filter_at, marginal, summed
from sensorlab.gap.parts import (
    EPSILON, Parts, bank_at, driven_bank, modes_of, parts_of)


class Solved(NamedTuple):
    """What all signatures need of a record: C^-1 (y - fit) at M nodes."""

    base: np.ndarray       # (M,) log-likelihood without a further signature
    residual: np.ndarray   # (M, N) C^-1 y less what bias and signatures explain
    w: np.ndarray          # (c, M, N) C^-1 of the columns known already
    cov: np.ndarray        # (M, c, c) of their sizes
    steps: np.ndarray      # (M, N) s' C^-1 s of steps s from every sample on
    size: np.ndarray       # (M, c) sizes of the columns known already
    spectra: tuple         # pairs of a share of the record, (M,), and the `Modes` there
    bank: Bank             # of the hypothesis, its states driven evenly
    parts: Parts
    rounding: np.ndarray   # (M,) share of an information that is but rounding
    filter: Filter = None  # of the only node, beside which the bank is slow
    passed: np.ndarray = None    # (M, N) as `steps`, of steps that pass a low-pass, if
                                 # there is one
    memory: int = None     # samples in which the filters forget

    __repr__ = brief

    def node(self, k):
        """The same at one node alone."""
        own, p = slice(k, k + 1), self.parts
        return Solved(
            self.base[own], self.residual[own], self.w[:, own], self.cov[own],
            self.steps[own], self.size[own], tuple(
                (share[own], Modes(*(part[own] for part in there)))
                for share, there in self.spectra), Bank(*(m[own] for m in self.bank)),
            p._replace(own=p.own[:, own], r=p.r[own], rise=p.rise[own]),
            self.rounding[own], passed=self.passed[own], memory=self.memory)

    def cut(self, first, last):
        """The same, for what is 0 but from the first sample to the last: no steps."""
        own = slice(first, last)
        b, parts = cut(self.bank, self.parts, first, last)
        return self._replace(residual=self.residual[:, own], w=self.w[..., own],
                             steps=None, passed=None, bank=b, parts=parts,
                             filter=self.filter and self.filter.cut(first, last))

    def for_scans(self, gap):
        """The same, of one node, with what many columns of a scan have in common."""
        p = self.parts
        if len(p.pair) == 1 and p.r.shape[1] == 1 and not len(p.rise):
            return self    # the bank of one state is quicker
        return self._replace(filter=filter_at(p, p.h[None], 0, gap))

    def before(self, low_pass, dt):
        """The same for what passes a low-pass, if there is one, before it is recorded:
        products with that are these with what passes.
        """
        if not low_pass:
            return self
        return self._replace(residual=low_pass.back(self.residual, dt),
                             w=low_pass.back(self.w, dt), steps=self.passed)


def solve(h, scene, signatures, theta, low_pass=None):
    """`Solved` of a hypothesis without jumps; `low_pass` is the `LowPass` that some
    signatures pass, if there is one.
    """
    y = np.where(np.isnan(scene.y), 0.0, scene.y)
    observed = 1.0 - np.isnan(scene.y)
    X = np.vstack([y, np.ones_like(y), *(s.columns.T for s in signatures)])
    b, change, *_ = bank_at(h, scene, theta)
    one = parts_of(h, b, change)
    w, shocks, log_det = adjoint(X, observed, one.h, one.own, one.pair, one.rise,
                                 one.r, low_pass.shock(scene.dt) if low_pass else STEP)
    c, M, N = w.shape
    gram = np.moveaxis(row_products(w.reshape(-1, N), X).reshape(c, M, c), 1, 0)
    known = marginal(gram, log_det, observed.sum(), constants(h, signatures))
    residual, w = w[0], w[1:]
    for node, size in enumerate(known.size):
        residual[node] -= np.einsum("j, ji -> i", size, w[:, node])
    spectra = _spectra(h, b, change, len(theta))
    return Solved(known.log_likelihood + h.log_joint(theta), residual, w,
                  known.covariance, shocks[0], known.size, spectra, b, one, _rounding(
                      spectra, b, one, observed, shocks[0]), passed=shocks[-1],
                  memory=_memory(one, observed))


MEMORY = 10**4    # samples in which a filter forgets how it began, at most


def _memory(parts, observed):
    """Samples in which filters of a long record, `observed` (N,) where it is seen,
    forget all but rounding of one: twice as many as one of the nodes takes, and those
    that are missing; MEMORY at most, or where their noise changes.
    """
    N, seen = len(observed), np.flatnonzero(observed)
    if N <= 3 * MEMORY or len(parts.rise) or parts.r.shape[1] > 1:
        return MEMORY
    one = filter_at(parts, parts.h[None], len(parts.r) // 2, np.zeros(
        2 * MEMORY, bool))
    (z,) = one.whitened(np.eye(1, 2 * MEMORY, MEMORY))
    left = np.cumsum(z[:MEMORY:-1]**2)[::-1]
    count = 2 * np.sum(left > EPSILON * dot(z, z)) * N // len(seen)
    return min(int(count + np.diff(seen, prepend=-1, append=N).max()), MEMORY)


TURNS = 4.0 * np.geomspace(1e-4, 1.0, 64)    # |1 - exp(-i w)|^2 where edges are seen
HARMLESS = 1e-9    # share of an information, as rounding
TRIED, TIMES = 4, 10.0    # steps whose information is computed twice, and how many
                          # times as large the rounding may be as that shows


def _rounding(spectra, b, parts, observed, steps):
    """Share (M,) of an information that may be rounding: the more, the less power a
    noise has at some frequency than at another. Where it may do harm, it is what the
    bank and the backward pass, whose `steps` (M, N) they are, differ by.
    """
    apart = 0.0
    for _, there in spectra:
        a, q = there.a[..., None], there.q[..., None]
        S = (q / ((1.0 - a)**2 + a * TURNS)).real.sum(1) + there.r.min(1, keepdims=True)
        apart = np.maximum(apart, S.max(1) / np.maximum(S.min(1), EPSILON * S.max(1)))
    result = EPSILON * apart
    if (result < HARMLESS).all():
        return result
    seen = np.flatnonzero(observed)
    at = seen[(np.arange(1, TRIED + 1) * len(seen)) // (TRIED + 1)]
    rows = np.where(observed > 0.0, np.arange(len(observed)) >= at[:, None], np.nan)
    twice = summed(b, parts, rows, None).chi2 / steps[:, at].T
    return TIMES * np.abs(twice - 1.0).max(0)


def _spectra(h, b, change, count):
    """Shares of the record, (M,), and the `Modes` of a hypothesis with a bank and a
    `Change` there: where its noise is weaker than on average, and where not.
    """
    if not change:
        return (np.ones(count), modes_of(h, b)),
    weaker, result = change.times < change.times.mean(1, keepdims=True), []
    for there in weaker, ~weaker:
        count = there.sum(1)
        times = np.where(count, (there * change.times).sum(1), 1.0)
        result.append((count / there.shape[1], modes_of(h, driven_bank(
            b, change, times / np.maximum(count, 1)))))
    return tuple(result)
