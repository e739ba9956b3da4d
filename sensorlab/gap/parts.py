"""What filters of a hypothesis with effects are made of: processes of one state and of
two, whose sum has the covariance of its output.
"""

from typing import NamedTuple

import numpy as np

from sensorid import Bank, Modes, bank, brief, modes
from sensorlab.gap.effects import BLOCK, Effect, Found, fixed
from sensorlab.gap.kernels.lanes import LANES
from sensorlab.gap.processes import moved_by_level

NOISES = 16 * BLOCK    # variances of noise that changes that are held at a time


def in_parts(h, scene, theta):
    """Theta (M, p) as parts of which what changes of the noise is not too long."""
    most = max(NOISES // len(scene.y), LANES)
    if len(theta) <= most or (
            not h.driven and bank_at(h, scene, theta[:1])[0].r.size == 1):
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
    b, change, *_ = bank_at(h, scene, theta)
    if change:
        b = driven_bank(b, change, change.times.mean(1))
    own = modes_of(h, b)
    return own._replace(r=own.r.mean(1, keepdims=True))


def bank_at(h, scene, theta):
    """`Bank` of a hypothesis at theta (M, p), its states driven evenly; the `Change` of
    those that are not, or None; and which of the hypothesis's states (n,) it keeps, and
    what is told, as by `_lean_bank`.
    """
    even, evenly = h.evenly_driven(theta)
    b, kept, told = _lean_bank(even, scene, evenly)
    if not h.driven:
        return b, None, kept, told
    times = h.strength(h.driven, theta)[:, :len(scene.y)]**2
    if h.driven.effect.of_white:
        louder = _of_louder(even, scene, evenly, b, told, times, 2.0, 0.0)
        return b, louder, kept, told
    own = np.zeros(len(kept))
    own[h.states_driven(h.driven.effect)] = 1.0
    driven = np.outer(own[kept], own[kept])
    return b, Change(times, b.Q[:, 0] * driven, b.P0 * driven, np.zeros_like(b.r),
                     np.zeros_like(b.P0)), kept, told


def _lean_bank(h, scene, theta):
    """`Bank` of a hypothesis driven evenly, without states that have no memory and
    apart; which states (n,) it keeps; and what is left, a sample later, of the S of
    `_without_states`, Phi S Phi' (M, n, n).
    """
    b = bank(h, scene.dt, theta)
    momentary = _momentary(b)
    if momentary.any():
        momentary[:h.own_states] = False    # those of effects alone
    lean, kept = _without_states(b, momentary), ~momentary
    Phi, S = lean.Phi[:, 0], lean.P0 - b.P0[
        np.ix_(range(len(b.P0)), kept, kept)]
    return _apart(lean, h.own_states), kept, Phi @ S @ Phi.swapaxes(1, 2)


def _louder(scene, filt, times, plus):
    """White noise of so many times the variance, and more, before all that it passes.
    """
    return filt._replace(Psi=np.sqrt(times * filt.Psi**2 + plus))


LOUDER = Effect("louder", model=_louder, drive=_louder, elementwise=True)


def _of_louder(h, scene, theta, b, told, at, times, plus):
    """`Change` of a hypothesis at theta (M, p), of the bank `b` and what is `told` of
    it, where its white noise is `_louder`; `at` are its times.
    """
    other, _, its_told = _lean_bank(h._replace(effects=(*h.effects, Found(
        LOUDER, values=fixed(times=1.0, plus=0.0)))), scene, np.column_stack([
            theta, *(np.broadcast_to(v, len(theta)) for v in (times, plus))]))
    return Change(at, other.Q[:, 0] - b.Q[:, 0], other.P0 - b.P0, other.r - b.r,
                  its_told - told)


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
    """Some states are not driven evenly, at M nodes: variances that are `times` as
    large add as many times, less one, to ...
    """

    times: np.ndarray     # (M, N); None if that is not known
    Q: np.ndarray         # (M, n, n) ... the covariance of the states' noises, ...
    P0: np.ndarray        # (M, n, n) ... that of the states at first, ...
    white: np.ndarray     # (M, 1) ... the variance of white noise, ...
    told: np.ndarray      # (M, n, n) ... and as much as that is more than before, to
                          # what a sample before there was of S in `_without_states`:
                          # Phi S Phi'


def driven_bank(b, change, times):
    """A bank with a `Change` that is the same at all times, so many times (M,) the
    variance.
    """
    more = times[:, None] - 1.0
    return b._replace(
        Q=b.Q + more[..., None, None] * change.Q[:, None],
        P0=b.P0 + more[..., None] * change.P0, r=b.r + more * change.white)


def modes_of(h, b):
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


class Parts(NamedTuple):
    """Filters that fall apart into processes of one state and of two, at M nodes."""

    own: np.ndarray     # (11, M, n) factors of a state and of the other one of its
                        # pair, variances of the noises and their covariances with that
                        # of the other, both of the states at first, what is added to
                        # those of the noises, `rise` times, or once at the second
                        # level, and what is, as many times as that is more than before;
                        # by how much a level that changes moves it, a unit, as one that
                        # steps does its own state
    pair: np.ndarray    # (n,) number of the other state, or its own
    h: np.ndarray       # (n,) what observes the states
    r: np.ndarray       # (M, 1 or N) variance of the white noise
    rise: np.ndarray = np.zeros((0, 0))    # (M, N); (0, 0) where no noise changes
    louder: np.ndarray = None    # (M,) variance that the second level adds to the white
                        # noise where it is louder before a low-pass

    __repr__ = brief


def parts_at(h, scene, theta):
    """`Parts` of a hypothesis at theta (M, p)."""
    b, change, kept, told = bank_at(h, scene, theta)
    one, at, seen = parts_of(h, b, change), np.cumsum(kept) - 1, np.ones(len(theta))
    low_pass, states = h.low_pass_of_levels
    if low_pass:
        one.own[10][:, at[states]], seen = moved_by_level(
            low_pass.variant, scene.dt / h.value(theta, low_pass.key, "tau"),
            h.moves_once)
    if h.moves_a_state:
        one.own[10][:, at[h.own_states]] = seen
    if h.is_louder_before:
        louder = _of_louder(h, scene, theta, b, told, None, 1.0, h.jumps(theta).louder)
        _add_changes(one, louder)
        one = one._replace(louder=louder.white[:, 0])
    return one


def parts_of(h, b, change=None):
    """`Parts` of a hypothesis with this bank, and with a `Change` of the noise of its
    states.
    """
    n = b.Phi.shape[2]
    timeless = b.Phi.shape[1] == b.Q.shape[1] == b.H.shape[1] == 1
    joined = sum(np.abs(m).sum(0) for m in (b.Phi[:, 0], b.Q[:, 0], b.P0)) > 0.0
    joined = (joined | joined.T) & ~np.eye(n, dtype=bool)
    if not timeless or b.m0.any() or (b.H != b.H[0]).any() or joined.sum(1).max() > 1:
        raise _refusal(h)
    pair = np.where(joined.any(1), joined.argmax(1), np.arange(n))
    own = [part for m in (b.Phi[:, 0], b.Q[:, 0], b.P0) for part in _paired(m, pair)]
    one = Parts(np.array([*own, *np.zeros((5, *own[0].shape))]), pair, b.H[0, 0], b.r)
    return _changing(one, h, change) if change else one


def _paired(m, pair):
    """Of matrices (M, n, n) the numbers (2, M, n) of every state with itself, and with
    the other one of its pair.
    """
    states = np.arange(len(pair))
    return np.array([m[:, states, states], m[:, states, pair] * (pair != states)])


def _add_changes(one, change):
    """What a `Change` adds to the noises of `Parts`, into these."""
    one.own[6:8] = _paired(change.Q, one.pair)
    one.own[8:10] = _paired(change.told, one.pair)


def _changing(one, h, change):
    """`Parts` of states driven evenly with a `Change` of their noise."""
    _add_changes(one, change)
    if h.driven.effect.of_white:    # a low-pass was at rest with the noise at first
        one.own[4:6] += (change.times[:, :1] - 1.0) * _paired(change.P0, one.pair)
    rise = change.times - 1.0
    return one._replace(rise=rise, r=one.r + change.white * rise
                        if change.white.any() else one.r)
