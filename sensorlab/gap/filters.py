"""Filters of a hypothesis with effects: likelihood, innovations, and the backward pass.

Signatures and the bias are constants of a wide prior. Where all is Gaussian the bank of
`sensorid` gives the likelihood, and one backward pass serves every further signature.
Outliers and a level of two values take a filter of their own, one Gaussian a level.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from sensorid import LOG_2PI, Bank, Modes, Sums, bank, brief, filter_bank, modes
from sensorlab.gap.effects import BLOCK, Found
from sensorlab.gap.kernels import (
    LANES, STEP, adjoint, dot, in_rows, plain_gains, row_products, whiten, whiten_back)
from sensorlab.gap.mixtures import mixture_filters


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


class Predicted(NamedTuple):
    """What a mixture filter makes of R records at M nodes."""

    log_likelihood: np.ndarray    # (R, M)
    z: np.ndarray                 # (R, M, N) normal scores of the samples
    odd: np.ndarray               # (R, M, N) probability of an outlier
    log_score: np.ndarray         # (R, M, N) ln of the predictive density
    second: np.ndarray = None     # (R, M, N) probability of the second level, or that
                                  # a step was some 15 samples ago at most

    __repr__ = brief


NOISES = 16 * BLOCK    # variances of noise that changes that are held at a time


def in_parts(h, scene, theta):
    """Theta (M, p) as parts of which what changes of the noise is not too long."""
    most = max(NOISES // len(scene.y), LANES)
    if len(theta) <= most or not h.driven and _bank(h, scene, theta[:1]).r.size == 1:
        return [theta]
    return [theta[k:k + most] for k in range(0, len(theta), most)]


def processes(h, scene, theta):
    """The one-state processes that a hypothesis is the sum of at theta (M, p), or that
    have the covariance of such a sum; driven, and in white noise, as on average over
    the record.
    """
    h = h.on_average
    return Modes(*map(np.concatenate, zip(*(
        _on_average(h, scene, part) for part in in_parts(h, scene, theta)))))


def _on_average(h, scene, theta):
    """`processes` of few nodes."""
    b, change = _bank(h, scene, theta), _change(h, scene, theta)
    if change:
        b = _driven(b, change.states, change.times.mean(1))
    own = _modes_of(h, b)
    return own._replace(r=own.r.mean(1, keepdims=True))


def _bank(h, scene, theta):
    """`Bank` of a hypothesis at theta (M, p), its states driven evenly."""
    even, theta = h.evenly_driven(theta)
    b = bank(even, scene.dt, theta)
    momentary = _momentary(b)
    if momentary.any():
        momentary[:h.own_states] = False    # those of effects alone
    return _apart(_without_states(b, momentary), h.own_states)


def _momentary(b):
    """Which states (n,) of a bank are observed by 1 and have no memory: white noise
    that drives others, too.
    """
    return ~(b.Phi.any((0, 1, 2)) | b.Phi.any((0, 1, 3))) & b.Q.any((0, 1, 3)) & (
        b.H == 1.0).all((0, 1))


def _without_states(b, momentary):
    """A bank whose output has the same covariance, with white noise in place of states
    that have no memory.

    A filter knows states x and white noise of variance r by P h and f = h' P h + r
    alone. Covariances s of x with the noise are a part of these if S is added to P, and
    S - Phi S Phi' to Q, of which S h = s, and h's is added to r. (Such a Q may have
    negative eigenvalues: what it stands for can be filtered, not drawn.)
    """
    if not momentary.any():
        return b
    keep, own, r = ~momentary, b.Q, b.r
    S = np.zeros_like(b.P0)
    for i in np.flatnonzero(momentary):
        s = own[:, 0, :, i] * keep
        first = np.argmax((s != 0.0).any(0))    # of a pair: it is observed by 1
        S[:, first] += s
        S[:, :, first] += s
        S[:, first, first] -= s[:, first]
        r = r + own[:, :, i, i] + s[:, first, None]
    Phi = b.Phi[:, 0]
    Q, P0 = own[:, 0] + S - Phi @ S @ Phi.swapaxes(1, 2), b.P0 + S
    inside = np.ix_(range(len(S)), keep, keep)
    return Bank(Phi[inside][:, None], Q[inside][:, None], b.H[..., keep], r,
                b.m0[:, keep], P0[inside])


def _apart(b, own_states):
    """A bank whose output has the same covariance, its states without noise in common
    with one that no other moves, or a pair of which each moves the other alone; the
    first ones, of a hypothesis itself, may have.

    As in `_without_states`, S is added to P, here with S h = 0, so that it changes
    nothing that a filter says of its output; between a block k and others, S - Phi_k S
    Phi' is -Q, which leaves them no covariance.
    """
    off = ~np.eye(b.Q.shape[-1], dtype=bool)
    shared, moved = b.Q.any((0, 1)) & off, b.Phi.any((0, 1)) & off
    moved |= moved.T
    shared &= ~moved
    shared[:own_states, :own_states] = False
    if not shared.any() or b.Phi.shape[1] > 1 or b.Q.shape[1] > 1:
        return b
    parts = [*([k] for k in np.flatnonzero(~moved.any(1))),
             *([k, k + 1] for k in range(len(moved) - 1)
               if moved[k, k + 1] and (moved[k:k + 2].sum(1) == 1).all())]
    # the low-pass, with which all others share theirs, is the last
    parts = sorted(part for part in parts if shared[part].any())
    h, Phi, Q, S = b.H[0, 0], b.Phi[:, 0], b.Q[:, 0], np.zeros_like(b.P0)
    left = shared.copy()
    for part in parts:
        others = np.flatnonzero(left[part].any(0))
        if not len(others):    # they were first
            continue
        left[part] = left[:, part] = False
        at = np.ix_(range(len(S)), part, others)
        both = np.einsum("mij, mkl -> mikjl", Phi[np.ix_(range(len(S)), part, part)],
                         Phi[np.ix_(range(len(S)), others, others)])
        size = len(part) * len(others)
        S[at] = own = -np.linalg.solve(
            np.eye(size) - both.reshape(-1, size, size), Q[at].reshape(-1, size, 1)
        ).reshape(-1, len(part), len(others))
        S[at[0], others[:, None], part] = own.swapaxes(1, 2)
        _balance(S, np.array(part), own @ h[others], h)
        _balance(S, others, h[part] @ own, h)
    Q, P0 = Q + S - Phi @ S @ Phi.swapaxes(1, 2), b.P0 + S
    for m in (Q, P0):
        for part in parts:
            for k in part:
                m[:, k, shared[k]] = m[:, shared[k], k] = 0.0
    return b._replace(Q=Q[:, None], P0=P0)


def _balance(S, states, v, h):
    """Take from matrices S (M, n, n) a symmetric one, among some states, of which the
    product with h is v (M, m).
    """
    k = int(h[states].astype(bool).argmax())    # it is observed
    first = states[k]
    S[:, first, first] -= v[:, k] / h[first]
    for axis, other in enumerate(states):
        if axis != k:
            part = v[:, axis] / h[first]
            S[:, first, other] -= part
            S[:, other, first] -= part
            S[:, first, first] += part * h[other] / h[first]


class Change(NamedTuple):
    """Some states are not driven evenly, at M nodes."""

    states: np.ndarray    # their numbers
    times: np.ndarray     # (M, N) as large the variances of their noises are


def _change(h, scene, theta):
    """`Change` of a hypothesis at theta (M, p), or None."""
    one = h.driven
    if not one:
        return None
    return Change(h.states_driven(one.effect),
                  h.strength(one, theta)[:, :len(scene.y)]**2)


def _driven(b, states, times):
    """A bank of which some states are driven by noises of so many times (M,) the
    variance.
    """
    own, factor = np.s_[..., states[:, None], states], times[:, None, None]
    Q, P0 = b.Q.copy(), b.P0.copy()
    Q[own] *= factor[..., None]
    P0[own] *= factor
    return b._replace(Q=Q, P0=P0)


def _modes_of(h, b):
    """`Modes` of a hypothesis with this bank."""
    own = modes(b) or equivalent_modes(b)
    if own is None:
        raise _refusal(h)
    return own


def _refusal(h):
    return ValueError(f"{h.name} is no sum of random walks and of stationary processes "
                      "of one state or two: only such hypotheses can be diagnosed; "
                      "give a ramp as an effect of a random walk")


EPSILON = np.finfo(float).eps
SAME = 1e-8    # relative: two numbers that are equal but for rounding


def equivalent_modes(b):
    """`Modes` whose sum has the covariance of the output of a bank, or None where there
    are none.

    All that a filter says of its output follows from the covariance of the output.
    That of a stationary filter is a sum of terms v a^|k|, a the eigenvalues of Phi.
    Each is that of a process, if v may be negative (less white noise below a frequency)
    and a complex (a band, with its conjugate): the recursions hold all the same, for
    what such processes lack of the true covariance is constant and never seen.
    """
    if not b.Phi.shape[1] == b.Q.shape[1] == b.H.shape[1] == 1 or b.m0.any():
        return None
    a, axes = np.linalg.eig(b.Phi[:, 0])
    if np.linalg.cond(axes).max() > 1.0 / SAME:
        return None
    # the states of which each is observed by 1, and their covariances
    to = (b.H @ axes).swapaxes(1, 2) * np.linalg.inv(axes)
    Q, P = (to @ m @ to.swapaxes(1, 2) for m in (b.Q[:, 0], b.P0))
    apart = ~np.eye(a.shape[1], dtype=bool)
    step = a[:, :, None] * P * a[:, None, :] + Q
    if np.abs(step - P)[:, apart].max() > SAME * np.abs(P).max():
        return None
    p0 = P.sum(2)
    q = step.sum(2) - a**2 * p0
    if not a.imag.any():
        a, q, p0 = a.real, q.real, p0.real
    return Modes(a, q, p0, b.r)


LIVES = 30.0    # time constants in a record: of a process of fewer little is known


def leaked(own, N, back):
    """What a spectrum of N samples of processes `own` gains (M, F) at frequencies where
    exp(-i w) is `back` (F,), because its ends do not meet: covariances at lag k are
    seen in 1 - |k| / N of the samples (Sykulski et al., "The debiased Whittle
    likelihood", Biometrika 106, 2019).
    """
    result = np.zeros((len(own.a), len(back)))
    for a, q in zip(own.a.T[..., None], own.q.T[..., None]):
        if (N * (1.0 - np.abs(a)) > LIVES).all():
            result -= 2.0 / N * (q / (1.0 - a**2) * (
                a * back / (1.0 - a * back)**2)).real
    return result


def constants(h, signatures):
    """Prior variances of the bias and of the sizes of all signature columns."""
    return np.concatenate([[h.bias_sigma**2], *(
        np.full(s.columns.shape[1], s.sd**2) for s in signatures)])


class Parts(NamedTuple):
    """Filters that fall apart into processes of one state and of two, at M nodes."""

    own: np.ndarray     # (8, M, n) factors of a state and of the other one of its pair,
                        # variances of the noises and their covariances with that of
                        # the other, both of the states at first, and what is added
                        # to those of the noises, `rise` times
    pair: np.ndarray    # (n,) number of the other state, or its own
    h: np.ndarray       # (n,) what observes the states
    r: np.ndarray       # (M, 1 or N) variance of the white noise
    rise: np.ndarray = np.zeros((0, 0))    # (M, N); (0, 0) where no noise changes

    __repr__ = brief


def parts_of(h, b):
    """`Parts` of a hypothesis with this bank."""
    n = b.Phi.shape[2]
    timeless = b.Phi.shape[1] == b.Q.shape[1] == b.H.shape[1] == 1
    joined = sum(np.abs(m).sum(0) for m in (b.Phi[:, 0], b.Q[:, 0], b.P0)) > 0.0
    joined = (joined | joined.T) & ~np.eye(n, dtype=bool)
    if not timeless or b.m0.any() or (b.H != b.H[0]).any() or joined.sum(1).max() > 1:
        raise _refusal(h)
    pair = np.where(joined.any(1), joined.argmax(1), np.arange(n))
    beside = (pair != np.arange(n)) * 1.0
    own = [part for m in (b.Phi[:, 0], b.Q[:, 0], b.P0)
           for part in (m[:, range(n), range(n)], m[:, range(n), pair] * beside)]
    return Parts(np.array([*own, *np.zeros((2, *own[0].shape))]), pair, b.H[0, 0], b.r)


def parts_at(h, scene, theta, b=None):
    """`Parts` of a hypothesis at theta (M, p), with a change of the noise of its
    states; b is its bank, if it is known.
    """
    one = parts_of(h, _bank(h, scene, theta) if b is None else b)
    change = _change(h, scene, theta)
    if not change:
        return one
    one.own[6:, :, change.states] = one.own[2:4, :, change.states]
    if h.driven.effect.of_white:    # a low-pass was at rest with the noise at first
        one.own[4:6, :, change.states] *= change.times[:, :1]
    return one._replace(rise=change.times - 1.0)


def with_constants(h, scene, signatures, theta):
    """`Parts` with the bias and the sizes of signatures as further processes, and what
    observes them, (N, n).
    """
    one = parts_at(h, scene, theta)
    variance = constants(h, signatures)
    k, n = len(variance), len(one.pair)
    more = np.zeros((8, len(theta), k))
    more[0], more[4] = 1.0, variance
    H = np.column_stack([np.tile(np.append(one.h, 1.0), (len(scene.y), 1)),
                         *(s.columns for s in signatures)])
    return one._replace(own=np.concatenate([one.own, more], axis=2),
                        pair=np.append(one.pair, n + np.arange(k))), H


def filtered(h, scene, signatures, theta, y):
    """Log-likelihoods (R, M) of records y (R, N) like that of the scene: through the
    bank, unless there are jumps, or the states are driven unevenly.
    """
    parts = in_parts(h, scene, theta)
    if len(parts) > 1:
        return np.hstack([filtered(h, scene, signatures, part, y) for part in parts])
    if _is_plain(h, y) and not h.driven:
        return estimated(h, scene, signatures, theta, y).log_likelihood
    own, H = with_constants(h, scene, signatures, theta)
    (R, N), M = y.shape, len(theta)
    return h.log_joint(theta) + _through_mixtures(
        h, own, H, theta, y, np.empty((R, M, 0, N)))


def _is_plain(h, y):
    """Are records filtered without jumps, and miss the same samples?"""
    gap = np.isnan(y)
    return not h.has_jumps and bool((gap == gap[0]).all())


def _through_mixtures(h, own, H, theta, y, out):
    jumps = h.jumps(theta)
    own, H, moved = _with_one_level(own, H, h.own_states if jumps.step.any() else None)
    return mixture_filters(
        y, H, own.own, own.pair, own.rise, own.r, np.column_stack(jumps[:2]),
        np.column_stack(jumps[2:]), out, moved or 0)


def _with_one_level(own, H, moved):
    """The same filter with one state for all levels that only their noise moves, as a
    bias and a random walk, and without states that are nothing; where the state `moved`
    is then, if there is one.

    Records tell the sum of these levels. How far each of them is in it, as paths are
    merged, would be ever less known, till rounding hides what is known of the sum.
    """
    every = np.arange(len(own.pair))
    alone = own.pair == every
    level = np.flatnonzero(alone & (own.own[0] == 1.0).all(0) & (H == 1.0).all(0))
    left = ~alone | own.own[2:].any((0, 1))
    left[0] |= not left.any()
    if moved is not None:
        left[moved] = True
    one = own.own.copy()
    if len(level):
        one[2:, :, level[0]] = one[2:][:, :, level].sum(-1)
        left[level[1:]], left[level[0]] = False, True
        moved = level[0] if moved in level else moved
    number = np.cumsum(left) - 1
    return own._replace(
        own=np.ascontiguousarray(one[:, :, left]), pair=number[own.pair[left]]
    ), np.ascontiguousarray(H[:, left]), None if moved is None else int(number[moved])


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
    return _filter_at(*with_constants(h, scene, signatures, theta[None]), 0, gap)


def _filter_at(own, H, node, gap):
    """`Filter` of one node of `Parts`, which H (N or 1, n) observes."""
    gain, f, states = np.empty((len(gap), H.shape[1])), np.empty(len(gap)), own.own[
        :, node].copy()
    H, = in_rows(H)
    rise = own.rise[node] if len(own.rise) else np.zeros(0)
    plain_gains(H, states, own.pair, rise, own.r[node], gap, gain, f)
    return Filter(H, states[:2], own.pair, gain, 1.0 / np.sqrt(f), gap)


def predict(h, scene, signatures, theta, y=None, whole=True, known=None):
    """`Predicted` of the record of a scene, or of others like it, y (R, N); if not the
    `whole`, without what is known of single samples beside their scores, and without
    the log-likelihood where nothing jumps. `known` is the `Filter` of the only node, if
    it is.
    """
    y = scene.y[None] if y is None else y
    M = len(theta)
    if _is_plain(h, y):
        gap = np.isnan(y[0])
        if known is not None and np.array_equal(gap, known.gap):
            every = [known]
        else:
            parts = with_constants(h, scene, signatures, theta)
            every = [_filter_at(*parts, node, gap) for node in range(M)]
        z = np.stack([one.whitened(y) for one in every], 1)
        if not whole:
            return Predicted(None, _within_limits(z), None, None)
        log_f = np.array([one.log_f for one in every])
        log_score = z * z
        log_score += log_f + LOG_2PI
        log_score *= -0.5
        return Predicted(np.nansum(log_score, axis=2), _within_limits(z),
                         np.broadcast_to(np.nan, z.shape), log_score)
    return predict_first(h, scene, signatures, theta, y, whole, M)


def predict_first(h, scene, signatures, theta, y, whole=True, count=1):
    """`Predicted` of records y (R, N) by filters with jumps: the log-likelihood at all
    nodes, all else at the first ones.
    """
    own, H = with_constants(h, scene, signatures, theta)
    out = np.full((len(y), count, 5 if whole else 2, y.shape[1]), np.nan)
    total = _through_mixtures(h, own, H, theta, y, out)
    z = normal_score(out[:, :, 0], out[:, :, 1]) if h.has_jumps else out[:, :, 0]
    return Predicted(total, _within_limits(z), *(
        (out[:, :, k] for k in (2, 3, 4)) if whole else (None, None)))


def _within_limits(z):
    return np.clip(z, -SCORE_LIMIT, SCORE_LIMIT, out=z)


SCORE_LIMIT = 37.0    # standard deviations: no normal score of double precision lies
                      # further out


def normal_score(below, above):
    """Normal score of a value with these probabilities below and above it."""
    with np.errstate(divide="ignore"):
        score = ndtri(np.minimum(below, above))
    return np.clip(np.where(below < above, score, -score), -SCORE_LIMIT, SCORE_LIMIT)


def log_likelihoods(h, scene, signatures, theta):
    """ln f(Y / theta) (M,) of the record of a scene."""
    return filtered(h, scene, signatures, theta, scene.y[None])[0]


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
    b = _bank(h, scene, theta)
    sums = summed(b, parts_at(h, scene, theta, b), rows, pairs or None)
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
    b, variance = _bank(h, scene, theta), constants(h, signatures)
    one = parts_at(h, scene, theta, b)
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
        one = _filter_at(parts, parts.h[None], k, gap)
        z = np.where(gap, 0.0, one.whitened(rows))
        result.chi2[:, k] = (z[:-1]**2).sum(1)
        result.score[:, k] = row_products(z[:-1], z[-1:])[:, 0]
        result.information[k] = dot(z[-1], z[-1])
        result.log_det[k] = one.log_f[~gap].sum()
        result.products[:, k] = [dot(z[i], z[j]) for i, j in pairs or ()]
    return result


def cut(b, parts, first, last):
    """A timeless bank and its `Parts` for the samples from the first to the last."""
    r = b.r if b.r.shape[1] == 1 else b.r[:, first:last]
    return b._replace(r=r), parts._replace(r=r, rise=parts.rise[:, first:last])


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
        return self._replace(filter=_filter_at(p, p.h[None], 0, gap))


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
    b = _bank(h, scene, theta)
    one = parts_at(h, scene, theta, b)
    w, shocks, log_det = adjoint(X, observed, one.h, one.own, one.pair, one.rise,
                                 one.r, low_pass.shock(scene.dt) if low_pass else STEP)
    c, M, N = w.shape
    gram = np.moveaxis(row_products(w.reshape(-1, N), X).reshape(c, M, c), 1, 0)
    known = marginal(gram, log_det, observed.sum(), constants(h, signatures))
    residual, w = w[0], w[1:]
    for node, size in enumerate(known.size):
        residual[node] -= np.einsum("j, ji -> i", size, w[:, node])
    spectra = _spectra(h, scene, theta, b)
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
    one = _filter_at(parts, parts.h[None], len(parts.r) // 2, np.zeros(
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


def _spectra(h, scene, theta, b):
    """Shares of the record, (M,), and the `Modes` of a hypothesis there: where its
    noise is weaker than on average, and where not.
    """
    change = _change(h, scene, theta)
    if not change:
        return (np.ones(len(theta)), _modes_of(h, b)),
    weaker, result = change.times < change.times.mean(1, keepdims=True), []
    for there in weaker, ~weaker:
        count = there.sum(1)
        times = np.where(count, (there * change.times).sum(1), 1.0)
        result.append((count / len(scene.y), _modes_of(h, _driven(
            b, change.states, times / np.maximum(count, 1)))))
    return tuple(result)
