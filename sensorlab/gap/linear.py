"""What is linear in a record where nothing jumps: its filter, products with columns,
and likelihoods with the sizes of signatures and the bias integrated out.

Signatures and the bias are constants of a wide prior. Where all is Gaussian the bank of
`sensorid` gives the likelihood.
"""

from typing import NamedTuple

import numpy as np

from sensorid import LOG_2PI, Bank, Sums, brief, filter_bank
from sensorlab.gap.effects import Found
from sensorlab.gap.kernels.adjoint import adjoint
from sensorlab.gap.kernels.arithmetic import dot, row_products
from sensorlab.gap.kernels.lanes import in_rows
from sensorlab.gap.kernels.whitening import plain_gains, whiten, whiten_back
from sensorlab.gap.parts import Parts, bank_at, parts_at, parts_of


class Signature(NamedTuple):
    """An effect that has been found, as columns, with the prior of its size."""

    found: Found
    columns: np.ndarray    # (N, k)
    sd: float              # of its size, a priori: wide
    given: bool = False    # by the simulator, but for the rest of a size
    held: tuple = ()       # ends of its size in the simulator, of a line of any phase
    gain: float = 0.0      # nats, if it may be beyond

    __repr__ = brief

    @property
    def is_held(self):
        return bool(self.held) and not self.gain


def part_of(scene, signatures, part):
    """A slice of a scene, and `Signature`s as they are there."""
    return scene.cut(part), tuple(
        s._replace(columns=s.columns[part]) for s in signatures)


def constants(h, signatures):
    """Prior variances of the bias and of the sizes of all signature columns."""
    return np.concatenate([[h.bias_sigma**2], *(
        np.full(s.columns.shape[1], s.sd**2) for s in signatures)])


def with_constants(h, scene, signatures, theta):
    """`Parts` with the bias and the sizes of signatures as further processes, and what
    observes them, (N, n).
    """
    one = parts_at(h, scene, theta)
    variance = constants(h, signatures)
    k, n = len(variance), len(one.pair)
    more = np.zeros((11, len(theta), k))
    more[0], more[4] = 1.0, variance
    H = np.column_stack([np.tile(np.append(one.h, 1.0), (len(scene.y), 1)),
                         *(s.columns for s in signatures)])
    return one._replace(own=np.concatenate([one.own, more], axis=2),
                        pair=np.append(one.pair, n + np.arange(k))), H


class Filter(NamedTuple):
    """A filter without jumps at one node: all of it that no record changes."""

    H: np.ndarray            # (N or 1, n) what observes the states
    turned: np.ndarray       # (2, n) their factors, as in `Parts`
    pair: np.ndarray         # (n,)
    gain: np.ndarray         # (N, n) by which an innovation moves them; 0 in a gap
    per_sigma: np.ndarray    # (N,) one over its standard deviation
    gap: np.ndarray          # (N,) where nothing is seen

    __repr__ = brief

    @property
    def log_f(self):
        """Logarithms (N,) of the variances of the innovations."""
        return -2.0 * np.log(self.per_sigma)

    def cut(self, first, last):
        """The same of the samples from the first to the last."""
        own = slice(first, last)
        return self._replace(H=self.H[own] if len(self.H) > 1 else self.H,
                             gain=self.gain[own], per_sigma=self.per_sigma[own],
                             gap=self.gap[own])

    def whitened(self, y):
        """Normal scores (R, N) of records with the same gaps; they are linear."""
        return whiten(y, self.H, self.turned, self.pair, self.gain, self.per_sigma)

    def whitened_back(self, u, first=0):
        """(R, N - first) whose products with records that are 0 before that sample are
        those of u with `whitened` records.
        """
        return whiten_back(np.where(self.gap[first:], 0.0, u), first, self.H,
                           self.turned, self.pair, self.gain, self.per_sigma)


def filter_of(h, scene, signatures, theta, gap):
    """`Filter` of a hypothesis without jumps at theta (p,), records of which have this
    gap (N,).
    """
    return filter_at(*with_constants(h, scene, signatures, theta[None]), 0, gap)


def filter_at(own, H, node, gap):
    """`Filter` of one node of `Parts`, which H (N or 1, n) observes."""
    gain, f, states = np.empty((len(gap), H.shape[1])), np.empty(len(gap)), own.own[
        :, node].copy()
    H, = in_rows(H)
    rise = own.rise[node] if len(own.rise) else np.zeros(0)
    plain_gains(H, states, own.pair, rise, own.r[node], gap, gain, f)
    return Filter(H, states[:2], own.pair, gain, 1.0 / np.sqrt(f), gap)


class Marginal(NamedTuple):
    """A likelihood with constants integrated out, and what is known of them; of R
    records where there are several.
    """

    log_likelihood: np.ndarray    # ([R,] M)
    size: np.ndarray              # ([R,] M, c) expectations of the constants
    covariance: np.ndarray        # ([R,] M, c, c)


def marginal(gram, log_det, count, variance):
    """`Marginal` from products ([R,] M, 1 + c, 1 + c) of a record and c columns, whose
    constants are N(0, variance).
    """
    root, c = np.sqrt(variance), len(variance)
    inner = np.eye(c) + root[:, None] * gram[..., 1:, 1:] * root
    covariance = root[:, None] * np.linalg.inv(inner) * root
    size = (covariance @ gram[..., 1:, :1])[..., 0]
    chi2 = gram[..., 0, 0] - (gram[..., 1:, 0] * size).sum(-1)
    return Marginal(-0.5 * (count * LOG_2PI + log_det + np.linalg.slogdet(inner)[1]
                            + chi2), size, covariance)


def estimated(h, scene, signatures, theta, y=None):
    """`Marginal` of a hypothesis without jumps and of the record of a scene, or of
    others with the same gaps, y (R, N): over the sizes of signature columns, then the
    bias.
    """
    y = scene.y[None] if y is None else y
    columns = [c for s in signatures for c in s.columns.T]
    variance = constants(h, signatures)
    gram = products(h, scene, y, columns, theta)
    known = marginal(gram.products, gram.log_det, gram.count, np.append(
        variance[1:], variance[0]))
    return known._replace(log_likelihood=known.log_likelihood + h.log_joint(theta))


def explained(h, scene, signatures, theta):
    """What bias and signatures are expected to explain of the record of a scene, (N,),
    at theta (p,), jumps left aside.
    """
    less = h.without_jumps
    size = estimated(less, scene, signatures, h.matching(less, theta)[None]).size[0, 0]
    return sum((s.columns @ own for s, own in zip(signatures, np.split(
        size, np.cumsum([s.columns.shape[1] for s in signatures])))), size[-1])


class Gram(NamedTuple):
    """Products c' C^-1 d of one of R records and of columns, the last of them ones, at
    M nodes.
    """

    count: int
    log_det: np.ndarray     # (M,)
    products: np.ndarray    # (R, M, c + 2, c + 2)


def products(h, scene, y, columns, theta):
    """`Gram` of records y (R, N) and of columns, of which there are few."""
    rows, gap = np.array([*y, *columns]), np.flatnonzero(np.isnan(y[0]))
    rows[:, gap] = 0.0
    # of one size: a sum must not lose the smaller of two columns
    size = np.array([np.sqrt(dot(row, row) / len(row)) or 1.0 for row in rows])
    rows /= size[:, None]
    R, c = len(y), len(columns)
    pairs = [(i, j) for i in range(R, R + c) for j in range(i)]
    rows[:, gap] = np.nan
    b, change, *_ = bank_at(h, scene, theta)
    sums = summed(b, parts_of(h, b, change), rows, pairs or None)
    result = np.empty((R, len(theta), c + 2, c + 2))
    result[..., -1, -1] = sums.information
    # a record is in the first place of its own products, a column in those of all
    place = [*((row, 0) for row in range(R)), *(
        (slice(None), 1 + column) for column in range(c))]
    for (own, at), square, score in zip(place, sums.chi2, sums.score):
        result[own, :, at, at] = square
        result[own, :, at, -1] = result[own, :, -1, at] = score
    for product, (i, j) in zip(sums.products, pairs):
        (own, at), (_, of) = place[j], place[i]
        result[own, :, of, at] = result[own, :, at, of] = product
    of_columns = np.append(size[R:], 1.0)
    for number in range(R):
        one = np.append(size[number], of_columns)
        result[number] *= one[:, None] * one
    return Gram(sums.count, sums.log_det, result)


class Shared(NamedTuple):
    """What a record shares with others that miss the same samples, where columns are
    known, at M nodes.
    """

    bank: Bank
    parts: Parts
    variance: np.ndarray    # (c + 1,) of the sizes of the columns and of the bias
    gram: Gram              # of columns
    w: np.ndarray           # (c M, N) C^-1 of columns
    gap: np.ndarray         # (N,)
    log_joint: np.ndarray   # (M,), or 0

    __repr__ = brief

    def log_likelihoods(self, y):
        """ln f(Y / theta) (R, M) of records y (R, N)."""
        sums, gram = summed(self.bank, self.parts, y, None), np.repeat(
            self.gram.products, len(y), axis=0)
        gram[..., 0, 0], gram[..., 0, -1] = sums.chi2, sums.score
        gram[..., 0, 1:-1] = row_products(self.w, np.where(self.gap, 0.0, y)).reshape(
            -1, gram.shape[1], len(y)).T
        gram[..., 1:, 0] = gram[..., 0, 1:]
        return self.log_joint + marginal(
            gram, sums.log_det, sums.count, self.variance).log_likelihood


def shared(h, scene, signatures, theta, gap):
    """`Shared` of records with this gap (N,) and a hypothesis without jumps, its states
    driven evenly.
    """
    columns = np.vstack([s.columns.T for s in signatures])
    b, change, *_ = bank_at(h, scene, theta)
    one, variance = parts_of(h, b, change), constants(h, signatures)
    w, *_ = adjoint(np.where(gap, 0.0, columns).copy(), 1.0 - gap, one.h, one.own,
                    one.pair, one.rise, one.r)
    # the first column stands for a record
    gram = products(h, scene, np.where(gap, np.nan, columns[:1]), columns, theta)
    return Shared(b, one, np.append(variance[1:], variance[0]), gram,
                  w.reshape(-1, len(gap)), gap, h.log_joint(theta))


def summed(b, parts, rows, pairs):
    """`Sums` of rows (C, N) under the filters of a bank, as `filter_bank` gives them,
    with the change of the noise of states that `Parts` know.
    """
    if not len(parts.rise):
        return next(filter_bank(b, rows, [rows.shape[1]], pairs))
    (C, N), M = rows.shape, len(parts.r)
    gap = np.isnan(rows[0])
    rows = np.vstack([rows, np.where(gap, np.nan, 1.0)])
    result = Sums(N - gap.sum(), *np.empty((2, C, M)), *np.empty((2, M)),
                  np.empty((len(pairs or ()), M)))
    for k in range(M):
        one = filter_at(parts, parts.h[None], k, gap)
        z = np.where(gap, 0.0, one.whitened(rows))
        result.chi2[:, k] = (z[:-1]**2).sum(1)
        result.score[:, k] = row_products(z[:-1], z[-1:])[:, 0]
        result.information[k] = dot(z[-1], z[-1])
        result.log_det[k] = one.log_f[~gap].sum()
        result.products[:, k] = [dot(z[i], z[j]) for i, j in pairs or ()]
    return result


def cut(b, parts, first, last):
    """A timeless bank and its `Parts` for the samples from the first to the last."""
    own, r = (part if part.shape[1] == 1 else part[:, first:last]
              for part in (b.r, parts.r))
    return b._replace(r=own), parts._replace(r=r, rise=parts.rise[:, first:last])
