"""The catalogue: every effect that is looked for, with its equation.

An effect of your own is another `Effect`; those below are examples of every kind.
"""

import functools
import math

import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d
from scipy.optimize import nnls
from scipy.signal import butter, lfilter, lfilter_zi

from sensorid import JIT, Parameter, ShapingFilter, sum_of
from sensorlab.gap.effects import Effect, Jumps
from sensorlab.gap.interpolated import interpolated
from sensorlab.gap.repeats import repeated_at_random
from sensorlab.gap.values import lattice


# ---- columns: (scene, x, psi) gives pairs of a variant and an (N, k) array

def _centred(x):
    """Less its mean; 0 where nothing but rounding varies."""
    return (x - x.mean()) * (np.ptp(x) > 1e-9 * np.abs(x).max())


def _from_start(scene, x, psi):
    yield "", scene.time[:, None]


def _from_onset(scene, x, psi):
    yield "", (scene.time >= psi - 1e-9 * scene.dt)[:, None].astype(float)


def _between(scene, x, psi):
    onset, duration = psi
    yield "rectangular", _from(scene, onset, duration, np.ones_like)
    yield "half sine", _from(scene, onset, duration, lambda t: np.sin(
        np.pi / duration * t))
    yield "decaying", _from(scene, onset, LASTS * duration, lambda t: np.exp(
        -DECAYS / duration * t))


def _settling(scene, x, psi):
    onset, duration = psi
    if len(scene.y) >= 4 * MIN_SLOW:    # a shorter record shows but a step
        yield "", _from(scene, onset, np.inf, lambda t: -np.expm1(
            -DECAYS / duration * t))


DECAYS = 3.0    # time constants until what decays is said to be over: 5 % are left
LASTS = 12.0    # times as long, after which nothing is: exp(-36)


def _from(scene, onset, duration, law):
    """Column (N, 1) of a law of the time since an onset, for so long, 0 else."""
    column, (own, since) = np.zeros((len(scene.y), 1)), _since(scene, onset, duration)
    column[own, 0] = law(since)
    return column


def _since(scene, onset, duration):
    """Samples from an onset on, for so long, and the time of each since then."""
    early = 1e-9 * scene.dt
    own = slice(*np.searchsorted(scene.time, [onset - early, onset + duration - early]))
    return own, np.maximum(scene.time[own] - onset, 0.0)


def _ringing(scene, x, psi):
    onset, duration, frequency = psi
    yield "", _waves(scene, onset, LASTS * duration, frequency, lambda t: np.exp(
        -DECAYS / duration * t))


def _burst(scene, x, psi):
    onset, duration, frequency = psi
    yield "", _waves(scene, onset, duration, frequency, lambda t: np.sin(
        np.pi / duration * t)**2)


def _waves(scene, onset, duration, frequency, envelope):
    """Cosine and sine (N, 2) in an envelope, from an onset on, for so long."""
    columns, (own, since) = np.zeros((len(scene.y), 2)), _since(scene, onset, duration)
    size, phase = envelope(since), 2.0 * np.pi * frequency * since
    columns[own, 0], columns[own, 1] = size * np.cos(phase), size * np.sin(phase)
    return columns


def _parabola(scene, x, psi):
    yield "", ((scene.time - psi)**2)[:, None]


def _transient(scene, x, psi):
    yield "", np.exp(-scene.time / psi)[:, None]


def _cosine_and_sine(scene, x, psi):
    N = len(scene.y)
    turn, count = 2j * np.pi * psi * scene.dt, math.isqrt(N) + 1
    # exp of a sum is a product: two short tables make all of it
    wave = np.outer(np.exp(turn * count * np.arange(-(-N // count))),
                    np.exp(turn * np.arange(count))).ravel()[:N]
    yield "", wave.view(float).reshape(N, 2)


AXES = "xyz"    # of which columns are named: rate_y beside the error of gyro_x


def _linear(scene, x, psi):
    yield "", _centred(x)[:, None]


def _while_warm(scene, x, psi):
    if "temperature" in scene.columns:
        yield "", (_centred(scene.columns["temperature"]) * _centred(x))[:, None]


def _curved(scene, x, psi):
    yield "square", _centred(x**2)[:, None]
    yield "modulus", _centred(np.abs(x))[:, None]


def _derivative(scene, x, psi):
    step = np.diff(x) / scene.dt
    yield "backward difference", np.append(0.0, step)[:, None]
    yield "forward difference", np.append(step, 0.0)[:, None]
    yield "central difference", np.gradient(x, scene.dt)[:, None]


def _least_tau(scene):
    """Least time constant of an exponential that is tried, s."""
    return min(scene.duration / 400, max(5.0 * scene.dt, scene.duration / 4000))


def lagged(x, dt, tau):
    """First-order low-pass of time constant tau, s, in steady state at the start."""
    a = np.exp(-dt / tau)
    return lfilter([1.0 - a], [1.0, -a], x, zi=[a * x[0]])[0]


def _lagged(scene, x, psi):
    late = lagged(x, scene.dt, psi)
    yield "lagged value", _centred(late)[:, None]
    yield "lag", _centred(late - x)[:, None]


def _behind(scene, x, psi):
    t = scene.time
    yield "delay", (np.interp(t - psi, t, x) - x)[:, None]
    yield "delay of the column", (np.interp(t + psi, t, x) - x)[:, None]
    yield "first order", (lagged(x, scene.dt, psi) - x)[:, None]
    yield "second order", (_lagged_twice(x, scene.dt, psi) - x)[:, None]


def _lagged_twice(x, dt, delay):
    """Butterworth low-pass of second order that delays what is slow by so much, s, in
    steady state at the start.
    """
    cut = min(1.0 / (np.sqrt(2.0) * np.pi * delay), MAX_CUT / dt)
    b, a = butter(2, cut, fs=1.0 / dt)
    return lfilter(b, a, x, zi=lfilter_zi(b, a) * x[0])[0]


def _hysteresis(scene, x, psi):
    width = psi * np.ptp(x)
    yield "", _centred((x - _followed(x, width)) / width if width > 0.0 else 0.0 * x
                       )[:, None]


@njit(**JIT)
def _followed(x, width):
    """What follows x once a play of so much is used up."""
    behind, at = np.empty(len(x)), x[0]
    for i, value in enumerate(x):
        at = min(max(at, value - width), value + width)
        behind[i] = at
    return behind


# ---- models: (scene, filt, **parameters) gives a shaping filter; the parameters are
# numbers, or columns (M, 1) of as many nodes

def beside(filt, a, sigma):
    """A shaping filter with Markov processes of factors a, standard deviations sigma
    added to its output.
    """
    return join(filt, *((f, s * np.sqrt(1.0 - f**2), s**2) for f, s in zip(a, sigma)))


def join(filt, *processes):
    """A shaping filter with one-state processes added to its output; of each the
    factor, the standard deviation of its noise and the variance of its initial value.
    """
    return _added(filt, sum_of(0.0, *processes))


def _added(filt, other):
    """A shaping filter with the output of another, of zero expectation, added."""
    return ShapingFilter(_blocks(filt.Phi, other.Phi), _blocks(filt.Gamma, other.Gamma),
                         np.append(filt.H[0], other.H[0])[None], filt.Psi,
                         np.append(filt.m0, other.m0), _blocks(filt.P0, other.P0))


def _blocks(one, other):
    """Matrices (..., n, m) and (..., k, l) as the blocks of one."""
    n, m = one.shape[-2:]
    result = np.zeros((*np.broadcast_shapes(one.shape[:-2], other.shape[:-2]),
                       n + other.shape[-2], m + other.shape[-1]))
    result[..., :n, :m], result[..., n:, m:] = one, other
    return result


def _matrices(*rows):
    """Matrices (1, n, m) of numbers, or (M, 1, n, m) of numbers and columns (M, 1)."""
    shape = np.broadcast_shapes((1,), *(np.shape(v) for row in rows for v in row))
    result = np.empty((*shape, len(rows), len(rows[0])))
    for i, row in enumerate(rows):
        for j, v in enumerate(row):
            result[..., i, j] = v
    return result


def _random_walk(scene, filt, sigma_w):
    return join(filt, (1.0, sigma_w, 0.0))


def _correlated_noise(scene, filt, tau, sigma):
    return beside(filt, [np.exp(-scene.dt / tau)], [sigma])


FLICKER_TIMES = 1.0, 0.065    # samples, share of the record: shortest and longest
                              # correlation time of what makes up flicker noise
FLICKER_BAND = 0.25     # cycles a sample: faster, a sensor's filter and aliases have it
FLICKER_NATS = 0.1      # that the sum may be off by, an e-fold of frequencies


@functools.lru_cache(16)
def flicker_processes(samples):
    """Correlation times, in samples, and variances of the Markov processes that make up
    flicker noise of the two-sided spectrum 1 / (2 pi f), f in cycles a sample.

    Processes at even distances d of ln tau have the spectrum sum sech(ln omega tau)
    / (2 omega): a ripple of 4 exp(-pi^2 / d), by Poisson's formula. A ripple r is worth
    r^2 / 4 nats a frequency, and an e-fold has the fewer frequencies the slower they
    are: at distances of pi^2 / (a - ln(tau) / 2) each is worth as much. Variances are
    the least squares of what is left of the ripple. (One a decade: M. S. Keshner,
    "1/f noise", Proc. IEEE 70, 1982.)
    """
    a = 0.5 * np.log(4.0 / FLICKER_NATS * samples / (2.0 * np.pi))
    first, last = np.log(np.array(FLICKER_TIMES) * (1.0, samples))
    begin, end = ((a - x / 4.0) * x / np.pi**2 for x in (first, max(first, last)))
    number = np.linspace(begin, end, math.ceil(end - begin) + 1)
    tau = np.exp(2.0 * (a - np.sqrt(a**2 - np.pi**2 * number)))

    k = np.unique(np.geomspace(1.0, max(FLICKER_BAND * samples, 2.0), 400).astype(int))
    f, many = k[:, None] / samples, np.gradient(k.astype(float))
    factor = np.exp(-1.0 / tau)
    ratio = 2.0 * np.pi * f * (1.0 - factor**2) / np.abs(
        1.0 - factor * np.exp(-2j * np.pi * f))**2
    variance, _ = nnls(np.sqrt(many)[:, None] * ratio, np.sqrt(many))
    return tau, variance


def _bias_instability(scene, filt, sigma):
    """Flicker noise, as strong as one Markov process a decade from a tenth of the
    record downwards would be with the standard deviation sigma all together.

    The coefficient B of IEEE Std 952 (two-sided S = B^2 / (2 pi f)) is sigma times
    sqrt(pi / (decades ln 10)).
    """
    tau, variance = flicker_processes(len(scene.y))
    decades = np.floor(max(np.log10(0.1 * len(scene.y)), 0.0)) + 1.0
    B = np.sqrt(np.pi / (decades * np.log(10.0))) * sigma
    return beside(filt, np.exp(-1.0 / tau), [own * B for own in np.sqrt(variance)])


EXPONENTIAL = "exponential"    # a form of `bandwidth`, that of white noise alone of
                               # which is of first order: an average of all that was
NO_MEMORY = 7.0    # time constants in a sample: more make two equal poles, at zero


def _bandwidth(scene, filt, tau, variant=""):
    """The white noise passes a low-pass of unit gain at rest, of first order or of
    second (Butterworth), or a digital one (the bilinear transform of either, or an
    exponential average), which random walks, Markov processes and narrow-band noise
    pass, too, if it is not of white noise alone: it lets nothing of them through where
    it lets no white noise through.
    """
    rest, white = filt._replace(Psi=np.zeros(1)), filt.Psi[..., :1]
    if filt.Psi.shape[-1] > 1:    # it changes, and so does what drives the low-pass
        even = _bandwidth(scene, filt._replace(Psi=white), tau, variant)
        own = np.arange(even.Gamma.shape[-1]) >= filt.Gamma.shape[-1]
        change = filt.Psi / np.where(white > 0.0, white, 1.0)
        return even._replace(Gamma=even.Gamma * np.where(
            own, change[..., None, None], 1.0))
    if variant.startswith("digital") or variant == EXPONENTIAL and rest.Gamma.any():
        low_pass = digital(variant, scene.dt / tau)
        if variant.endswith("white noise"):
            return _through(low_pass, rest, white)
        return _through(low_pass, rest, white, _alone(rest), _turning(rest))
    if variant != "second order":
        a = np.exp(-scene.dt / tau)
        return beside(rest, [a], [np.sqrt((1.0 - a) / (1.0 + a)) * white])
    # V and another state, which alone is driven, turn as fast as they decay: A P + P A'
    # + b b' = 0 with b = (0, 1) has P in the ratio of 1, -1 and 3
    decay = np.minimum(scene.dt / tau / np.sqrt(2.0), NO_MEMORY)
    pole = np.exp((-1.0 + 1j) * decay)
    c, s, tail = pole.real, pole.imag, pole / (1.0 - pole)
    sd = white / np.sqrt(1.0 + 2.0 * (tail.real + tail.imag))    # of V, its sum that
    first = np.sqrt(np.where(    # of v over all lags; a slow one moves little
        decay > 1e-3, 1.0 - c * c - 2.0 * c * s - 3.0 * s * s, 8.0 / 3.0 * decay**3))
    both = (c * c + 2.0 * c * s - s * s - 1.0) / first
    second = np.sqrt(np.maximum(
        3.0 - 3.0 * c * c + 2.0 * c * s - s * s - both**2, 0.0))
    return _added(rest, _pair([[c, -s], [s, c]], [
        [sd * first, 0.0], [sd * both, sd * second]], [1.0, 0.0], [
        [sd**2, -sd**2], [-sd**2, 3.0 * sd**2]]))


def _through(low_pass, rest, white, alone=(), turning=()):
    """White noise, and states of a shaping filter that are `_alone` or of which two are
    `_turning`, through a low-pass, which is the shaping filter of white noise of
    variance 1 that passes it, that noise its last state.

    Its states s <- A s + B u are driven by the output u = h x of a process x <- f x +
    g w. With T = f (f - A)^-1 B, s - T h x <- A (s - T h x) + (B - T) h g w is driven
    by w alone, and what the low-pass puts out, C s + D u, has (D + C T) h x of x, its
    response at f. Of two, x, f and w are complex, u and s real parts.
    """
    A, B = low_pass.Phi[..., :-1, :-1], low_pass.Gamma[..., :-1, 0]
    C, D = low_pass.H[0, :-1], low_pass.Gamma[..., -1, 0]
    filt = _added(rest, low_pass._replace(
        Gamma=low_pass.Gamma * white[..., None, None],
        P0=low_pass.P0 * white[..., None]**2))
    n, own, columns = rest.H.shape[-1], np.eye(A.shape[-1]), rest.Gamma.shape[-1]
    s = slice(n, n + len(own))
    of_nodes = np.broadcast_shapes(filt.Phi.shape[:-3], filt.Gamma.shape[:-3],
                                   filt.P0.shape[:-2])
    Gamma = np.broadcast_to(filt.Gamma, of_nodes + filt.Gamma.shape[-3:]).copy()
    P0 = np.broadcast_to(filt.P0, of_nodes + filt.P0.shape[-2:]).copy()
    for k, axes in [*((k, [1.0]) for k in alone), *((k, [1.0, 1j]) for k in turning)]:
        x = list(zip(range(k, k + 2), axes))
        f, g = (sum(axis * part[..., i, :] for i, axis in x)
                for part in (rest.Phi, rest.Gamma))
        f, h = f[..., k], rest.H[0, k]
        T = f[..., None] * _solved(f[..., None, None] * own - A, B)
        response, e = D + T @ C, (B - T) * h
        drive = (np.abs(g)**2).sum(-1)[..., :1] / len(x)    # before anything changes
        settled = sum(_settled(A, (e * np.conj(axis)).real) for axis in axes)
        with_x = _solved(own - f.conj()[..., None, None] * A, e
                         ) * response.conj()[..., None]
        # what a walk has moved before is in s: it begins with as much
        begun = np.where(
            np.abs(f) < 1.0, np.abs(response)**2 * rest.P0[..., None, k, k],
            drive * _explained(settled, with_x.real))
        for i, axis in x:
            Gamma[..., i, :columns] = (np.conj(axis) * response[..., None] * g).real
            P0[..., i, i] = begun[..., 0]
            P0[..., i, s] = P0[..., s, i] = (
                drive[..., None] * (axis * with_x).real)[..., 0, :]
        Gamma[..., s, :columns] += (e[..., :, None] * g[..., None, :]).real
        P0[..., s, s] += (drive[..., None, None] * settled)[..., 0, :, :]
    return filt._replace(Gamma=Gamma, P0=P0)


def _alone(filt):
    """Numbers of those states that neither move nor are moved by others, nor share
    their noise, and are observed.
    """
    apart = np.abs(filt.Phi).reshape(-1, *filt.Phi.shape[-2:]).max(0)
    noise = np.abs(filt.Gamma).reshape(-1, *filt.Gamma.shape[-2:]).max(0)
    joined = apart + apart.T + noise @ noise.T
    np.fill_diagonal(joined, 0.0)
    return np.flatnonzero(~joined.any(0) & (filt.H[0] != 0.0) & ~filt.m0.astype(bool)
                          & (filt.H == filt.H[0]).all(0))


def _turning(filt):
    """Numbers of the first of two states that turn and shrink alike, driven evenly in
    all directions, of which it is observed, and apart from all others.
    """
    Phi, Gamma = (np.abs(part).reshape(-1, *part.shape[-2:]).max(0)
                  for part in (filt.Phi, filt.Gamma))
    joined, h = Phi + Phi.T + Gamma @ Gamma.T, filt.H[0]

    def turns(k):
        pair = [k, k + 1]
        even = not Gamma[pair].prod(0).any() and np.ptp(Gamma[pair].max(1)) == 0.0
        return (Phi[k, k + 1] == Phi[k + 1, k] > 0.0 and even and h[k] and not h[k + 1]
                and not np.delete(joined[pair], pair, 1).any()
                and not filt.m0[pair].any())
    return [k for k in range(len(joined) - 1) if (filt.H == h).all() and turns(k)]


def _solved(A, b):
    """A^-1 b of matrices (..., m, m) and vectors (..., m)."""
    return np.linalg.solve(A, np.broadcast_to(b, np.broadcast_shapes(
        A.shape[:-1], b.shape))[..., None])[..., 0]


def _explained(P, c):
    """c' P^-1 c of covariances (..., m, m), which may be 0, and vectors (..., m)."""
    size = np.trace(P, axis1=-2, axis2=-1)[..., None, None]
    return (c * _solved(P + (1e-14 * size + 1e-290) * np.eye(P.shape[-1]), c)).sum(-1)


def _settled(A, b):
    """P = A P A' + b b' of matrices (..., m, m) and vectors (..., m)."""
    m = A.shape[-1]
    both = np.einsum("...ij,...kl->...ikjl", A, A).reshape(*A.shape[:-2], m * m, m * m)
    square = (b[..., :, None] * b[..., None, :]).reshape(*b.shape[:-1], m * m)
    return _solved(np.eye(m * m) - both, square).reshape(*b.shape[:-1], m, m)


MOST_WARPED = 1.55    # radians: a higher cut-off is taken for 0.493 of the rate
ZERO = 0.998    # for 1, of the zeros at half the sampling rate: no sensor is as silent
                # there as arithmetic would have it


def digital(variant, cut_off):
    """White noise of variance 1 through a digital low-pass, a form of `bandwidth`, its
    cut-off in radians a sample; the noise is the last state.
    """
    if variant == EXPONENTIAL:
        return _of_first_order(np.tanh(0.5 * cut_off), 0.0)
    K = np.tan(np.minimum(0.5 * cut_off, MOST_WARPED))
    return _of_first_order(K) if "first order" in variant else _of_second_order(K)


def _of_second_order(K):
    """White noise w through the bilinear transform of a Butterworth filter:
    b (1 + ZERO / z)^2 / (1 - c / z - d / z^2).

    That is b0 w and two states that w drives by b1 and b2. K is the tangent of half the
    cut-off.
    """
    all_of = 1.0 + np.sqrt(2.0) * K + K**2
    b, c = 4.0 * K**2 / all_of / (1.0 + ZERO)**2, 2.0 * (1.0 - K**2) / all_of
    d = (np.sqrt(2.0) * K - 1.0 - K**2) / all_of
    b0 = -b * ZERO**2 / d
    b1, b2 = b - b0, 2.0 * b * ZERO + b0 * c
    # 1 + d, 1 - c - d and 1 + c - d of a slow one are too small to be differences
    first = (2.0 * c * b1 * b2 + (1.0 - d) * (b1**2 + b2**2)) / (
        np.sqrt(2.0) * 32.0 * K**3) * all_of**3
    both = (c * d * first + b1 * b2) / (1.0 - d)
    second = d**2 * first + b2**2
    P0 = [[first, both, b0 * b1], [both, second, b0 * b2], [b0 * b1, b0 * b2, b0**2]]
    return _of_one_noise([[c, 1.0, 0.0], [d, 0.0, 0.0], [0.0, 0.0, 0.0]], (b1, b2, b0),
                         [1.0, 0.0, 1.0], P0)


LEAST_POLE = 1e-4    # for less, of the pole: at zero it is that of the white noise


def _of_first_order(K, zero=ZERO):
    """The same of first order, b (1 + zero / z) / (1 - c / z): b0 w and a state that w
    drives by b1.
    """
    b, c = 2.0 * K / (1.0 + K) / (1.0 + zero), (1.0 - K) / (1.0 + K)
    c = np.where(np.abs(c) < LEAST_POLE, LEAST_POLE, c)
    b0 = -b * zero / c
    b1 = b - b0
    # 1 - c^2 of a slow one is too small to be a difference
    P0 = [[b1**2 * (1.0 + K)**2 / (4.0 * K), b0 * b1], [b0 * b1, b0**2]]
    return _of_one_noise([[c, 0.0], [0.0, 0.0]], (b1, b0), [1.0, 1.0], P0)


def _of_one_noise(Phi, b, H, P0):
    """A shaping filter of states that one noise of variance 1 drives by b, their
    covariance P0 at first.
    """
    return ShapingFilter(
        _matrices(*Phi), _matrices(*([part] for part in b)), np.array([H]), np.zeros(1),
        np.zeros(len(H)), _matrices(*P0)[..., 0, :, :])


def _pair(Phi, Gamma, H, P0):
    """A shaping filter of two states."""
    return ShapingFilter(_matrices(*Phi), _matrices(*Gamma), np.array([H]), np.zeros(1),
                         np.zeros(2), _matrices(*P0)[..., 0, :, :])


MIN_TURN = 2.0    # radians in the correlation time of a band: with fewer its width is
                  # more than its frequency, and it is a Markov process


def _narrow_band(scene, filt, frequency, tau, sigma):
    """A vector that turns and shrinks, driven evenly in all directions: one of its two
    components has the covariance sigma^2 exp(-|t| / tau) cos(2 pi frequency t).
    """
    sigma = sigma * (2.0 * np.pi * frequency * tau >= MIN_TURN)
    turn, a = 2.0 * np.pi * frequency * scene.dt, np.exp(-scene.dt / tau)
    c, s, drive = a * np.cos(turn), a * np.sin(turn), sigma * np.sqrt(1.0 - a**2)
    return _added(filt, _pair([[c, -s], [s, c]], [[drive, 0.0], [0.0, drive]],
                              [1.0, 0.0], [[sigma**2, 0.0], [0.0, sigma**2]]))


def _blue_noise(scene, filt, tau, sigma):
    """A Markov process less what it was a sample before: white noise through a
    first-order high-pass.
    """
    a = np.exp(-np.minimum(scene.dt / tau, NO_MEMORY))
    variance = sigma**2 / (2.0 * (1.0 - a))
    return _added(filt, _pair(
        [[a, 0.0], [1.0, 0.0]], [[np.sqrt((1.0 - a**2) * variance)], [0.0]],
        [1.0, -1.0], [[variance, a * variance], [a * variance, variance]]))


def _level(scene, filt, dwell, sigma):
    """A level that nothing but jumps moves."""
    return join(filt, (1.0, 0.0 * sigma, 0.0))


def _noise_step(scene, filt, onset, ratio):
    if np.all(onset > scene.time[-1]):
        return filt
    return _with_white(filt, _stronger_from(scene, onset, ratio))


def _stronger_from(scene, onset, ratio):
    first, ratio = np.broadcast_arrays(np.searchsorted(scene.time, onset), ratio)
    times = np.ones((*first.shape[:-1], len(scene.y)))
    for row, at, own in zip(np.atleast_2d(times), first.ravel(), ratio.ravel()):
        row[at:] = own    # at many nodes it is long
    return times


def _with_white(filt, times):
    """A shaping filter whose white noise is so many times as strong."""
    return filt._replace(Psi=filt.Psi * times) if filt.Psi.any() else filt


def _noise_along(scene, filt, **values):
    return _with_white(filt, _stronger_along(scene, **values))


def _stronger_along(scene, ratio, about, per, x, variant=""):
    u = (x - about) / per
    return np.sqrt(np.maximum(1.0 + (ratio**2 - 1.0) * u**2, 0.0)) if (
        variant == "square") else ratio**u


def _whole_range(x, variant=""):
    """What the strength of white noise is relative to: it is as the simulator says at
    zero, or at the mean, and ratio times as strong a whole range away.
    """
    if variant == "square":
        return dict(about=0.0, per=float(np.abs(x).max()))
    return dict(about=float(x.mean()), per=float(np.ptp(x)))


def _walk_step(scene, filt, onset, ratio):
    return filt._replace(Gamma=filt.Gamma * _stronger_from(scene, onset, ratio)[
        ..., None, None])


def _rounding(scene, filt, lsb):
    """What rounding adds to the white noise."""
    return filt._replace(Psi=np.sqrt(filt.Psi**2 + lsb**2 / 12.0))


# ---- jumps: (dt, **parameters) gives `Jumps`

def _outliers(dt, rate, sigma):
    return Jumps(rate=rate, variance=sigma**2)


def _telegraph(dt, dwell, size):
    change = -0.5 * np.expm1(-2.0 * dt / dwell)
    return Jumps(begin=change, end=change, half=0.5 * size)


def _random_steps(dt, dwell, sigma):
    begin = -np.expm1(-dt / dwell)    # in every sample anew
    return Jumps(begin=begin, end=1.0 - begin, step=sigma**2)


def _noise_bursts(dt, quiet, duration, sigma):
    return Jumps(begin=-np.expm1(-dt / quiet), end=-np.expm1(-dt / duration),
                 louder=sigma**2)


# ---- readings: (scene, y, **values) alters the values y (..., N) in place

def quantize(scene, y, lsb):
    """Round to multiples of lsb, on the lattice of the scene's record if it has one; 0
    is not rounded.
    """
    raw = scene.y + scene.known
    seen = raw[~np.isnan(raw)]
    origin = seen[0] if len(seen) and lattice(raw) else 0.0
    if lsb:
        y[:] = origin + lsb * np.round((y - origin) / lsb)


def convert(scene, y, codes):
    """What lies within the codes of a converter, (value, width) each, becomes the value
    of its code; they are half a spacing about their values, were they all as wide.
    """
    value, width = np.transpose(codes)
    ends = value[0] - 0.5 * (value[1] - value[0]) + np.cumsum([0.0, *width])
    inside = (y >= ends[0]) & (y < ends[-1])
    y[inside] = value[np.searchsorted(ends, y[inside], "right") - 1]


def _saturate(scene, y, limits):
    np.clip(y, *limits, out=y)


def _stick(scene, y, spans):
    for start, length in spans:
        first = round(start / scene.dt)
        y[..., first:first + int(length)] = y[..., first:first + 1]


def _average(scene, y, window):
    """Every sample becomes the mean of all in a window that ends with it; before the
    record, of its first.
    """
    taps = taps_of(scene, window)
    y[:] = uniform_filter1d(y, taps, mode="nearest", origin=(taps - 1) // 2)


def taps_of(scene, window):
    """Samples in a window, at least one."""
    return max(round(window / scene.dt), 1)


def repeat(scene, y, frequency, phase):
    """Every sample becomes the last that a sensor of a rate of its own has given. With
    no phase it gives them at random: where the scene's record has them if it has.
    """
    for one, given in _given(scene, y, frequency, phase, repeated_at_random):
        one[:] = one[given[np.searchsorted(given, np.arange(len(one)), "right") - 1]]


def interpolate(scene, y, frequency, phase, order):
    """The same, but samples between lie on straight lines, or on smooth curves."""
    number = np.arange(y.shape[-1])
    for one, given in _given(scene, y, frequency, phase, lambda y: interpolated(y).own):
        curve = order > 1 and len(given) > order and CubicSpline(given, one[given])
        line = np.interp(number, given, one[given])
        one[:] = np.where(number <= given[-1], curve(number), line) if curve else line


def _given(scene, y, frequency, phase, others):
    """Records of y (..., N), and the numbers of the samples that a sensor of a rate of
    its own has given; at random where the `others` of the scene's record are not.
    """
    if phase is not None:
        number = np.floor(frequency * scene.time + phase / (2.0 * np.pi))
        own = np.diff(number, prepend=-1.0) > 0.0
    else:
        left_out = others(scene.y + scene.known)
    for one in y.reshape(-1, y.shape[-1]):    # a view
        if phase is None:
            # a seed of its own numbers: whatever records are made with it, it is the
            # same
            rng = np.random.default_rng(one[:OWN_SEED].copy().view(np.uint64))
            own = ~left_out if left_out.any() else (
                rng.random(len(one)) <= frequency * scene.dt)
            own[0] = True
        yield one, np.flatnonzero(own)


OWN_SEED = 16       # samples


# ---- the catalogue

MIN_CYCLES = 3    # in a record, of a sinusoid: slow noise shows fewer by itself
                  # (S. Krishnan et al., Mon. Not. R. Astron. Soc. 508, 2021)


def _log(symbol, low, high):
    return Parameter(symbol, low, max(high, 1.01 * low), True)


def _spread(scene):
    return max(np.nanstd(scene.y), 3.0 * scene.white)


MIN_PULSE = 3     # samples: fewer are outliers
MIN_SHAPED = 8    # of a pulse: fewer have no shape but a rectangle
MIN_RINGING = 16    # of a ringing, or a burst: fewer are outliers
MIN_SLOW = 64     # of a slow step: fewer are a step
MIN_STEPS = 10    # in a record, on average: fewer are bias steps
MIN_REST = 30    # samples from one step to the next: fewer are a walk
WIDEST_PLAY = 0.25    # of the range of a column, to either side: a wider loop is hardly
                      # told from the column itself
LATEST = 300.0    # sampling intervals by which a sensor is late
MAX_CUT = 0.45    # of the sampling rate: as fast as a digital low-pass can be
MIN_BURST = 8    # samples of a burst of noise: fewer are outliers
MIN_SIDE = 16    # samples on either side of a change of noise: fewer tell no variance


def _onset(scene, samples=1):
    """Prior of an onset with so many samples on either side at least."""
    return Parameter("onset", samples * scene.dt, scene.duration - samples * scene.dt)


CATALOGUE = {effect.name: effect for effect in (
    Effect("rate_ramp", columns=_from_start, size="slope",
           equation="y + slope t; slope in u/s",
           resembles="random walk, slow transient",
           experiment="record longer"),
    Effect("bias_step", columns=_from_onset, search="onset",
           parameters=lambda s: (_onset(s, MIN_PULSE),),
           equation="y + size from t = onset on; onset in s, size in u",
           resembles="random walk, one stuck interval",
           experiment="look for what happened at the onset: a knock, a restart"),
    Effect("pulse", columns=_between, search="pulse",
           parameters=lambda s: (_onset(s), _log("duration", MIN_PULSE * s.dt,
                                                 0.5 * s.duration)),
           equation="y + size f, from t = onset on; f = 1 or sin(pi s), 0 <= s < 1, or "
                    "exp(-3 s), s = (t - onset) / duration; both in s, size in u",
           resembles="random telegraph, two bias steps, outliers",
           experiment="look for what happened then: a shock, another load"),
    Effect("gradual_step", columns=_settling, search="pulse", becomes="bias_step",
           parameters=lambda s: (_onset(s), _log("duration", MIN_SLOW * s.dt,
                                                 0.5 * s.duration)),
           equation="y + size (1 - exp(-3 s)), s = (t - onset) / duration > 0; both in "
                    "s, size in u",
           resembles="bias step, turn-on transient, random walk",
           experiment="look for what changed at the onset: a load, a heater"),
    Effect("ringing", columns=_ringing, search="waves", size="amplitude",
           parameters=lambda s: (
               _onset(s), _log("duration", MIN_RINGING * s.dt, s.duration / 2.0),
               Parameter("frequency", MIN_CYCLES / s.duration, 0.5 / s.dt)),
           equation="y + amplitude exp(-3 s) cos(2 pi frequency (t - onset) + phase), "
                    "s = (t - onset) / duration > 0; onset and duration in s, "
                    "frequency in Hz, amplitude in u",
           resembles="narrow-band noise, pulse, outliers",
           experiment="knock at the mount: it rings at the same frequency"),
    Effect("vibration_burst", columns=_burst, search="waves", size="amplitude",
           parameters=lambda s: (
               _onset(s), _log("duration", MIN_RINGING * s.dt, s.duration / 2.0),
               Parameter("frequency", MIN_CYCLES / s.duration, 0.5 / s.dt)),
           equation="y + amplitude sin(pi s)^2 cos(2 pi frequency (t - onset) + "
                    "phase), s = (t - onset) / duration from 0 to 1; onset and "
                    "duration in s, frequency in Hz, amplitude in u",
           resembles="ringing, narrow-band noise, sinusoid",
           experiment="look for what ran then: a motor, a passing vehicle"),
    Effect("second_order_drift", columns=_parabola, size="curvature",
           becomes="rate_ramp",    # as nearly, with its vertex far away
           parameters=lambda s: (Parameter("vertex", 0.0, s.duration),),
           equation="y + curvature (t - vertex)^2; vertex in s, curvature in u/s^2",
           resembles="turn-on transient, rate ramp, random walk",
           experiment="record longer"),
    Effect("turn_on_transient", columns=_transient,
           parameters=lambda s: (_log("tau", _least_tau(s), s.duration / 3),),
           equation="y + size exp(-t / tau); tau in s, size in u",
           resembles="rate ramp, temperature",
           experiment="switch off, cool down and on again: it returns"),
    Effect("sinusoid", columns=_cosine_and_sine, search="frequency", size="amplitude",
           parameters=lambda s: (Parameter("frequency", MIN_CYCLES / s.duration,
                                           0.5 / s.dt),),
           equation="y + amplitude cos(2 pi frequency t + phase); frequency in Hz, "
                    "amplitude in u",
           resembles="correlated noise of long period",
           experiment="damp vibration; an alias moves with the sampling rate"),
    Effect("temperature", columns=_linear, size="coefficient", column="temperature",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="random walk, thermal lag",
           experiment="cycle the temperature twice at different speed"),
    Effect("thermal_lag", columns=_lagged, size="coefficient", column="temperature",
           becomes="temperature",
           parameters=lambda s: (_log("tau", _least_tau(s), s.duration / 4),),
           equation="y + coefficient f, f = X less its mean, or X - x where what comes "
                    "at once is compensated, tau dX/dt = x - X; tau in s, coefficient "
                    "in u per unit of x",
           resembles="temperature",
           experiment="step the temperature and hold it"),
    Effect("scale_factor", columns=_linear, size="coefficient", column="rate",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="nonlinearity",
           experiment="turn at several known rates of both signs"),
    Effect("thermal_scale_factor", columns=_while_warm, size="coefficient",
           column=("rate", "acceleration"), also="temperature",
           equation="y + coefficient (T - mean of T) (x - mean of x), T the column "
                    "temperature; in u per unit of x and kelvin",
           resembles="scale factor, nonlinearity",
           experiment="turn at a known rate while the temperature is cycled"),
    Effect("misalignment", columns=_linear, size="coefficient",
           column=tuple(f"rate_{axis}" for axis in AXES),
           equation="y + coefficient (x - mean of x), x the rate about another axis; "
                    "in u per unit of x",
           resembles="scale factor, if the axes are turned together",
           experiment="turn about one axis after the other"),
    Effect("nonlinearity", columns=_curved, size="coefficient",
           column=("rate", "acceleration"),
           equation="y + coefficient f, f = x^2 or |x| less its mean; in u per unit "
                    "of f",
           resembles="scale factor where the rate has one sign",
           experiment="turn at several known rates of both signs"),
    Effect("latency", columns=_derivative, size="coefficient",
           column=("rate", "acceleration"),
           equation="y + coefficient dx/dt; in u per unit of x and second",
           resembles="scale factor under slow motion, lag",
           experiment="turn with sharp starts and stops"),
    Effect("lag", columns=_behind, size="coefficient",
           column=("rate", "acceleration", "*"),
           becomes=("latency", "scale_factor", "g_sensitivity", "covariate"),
           parameters=lambda s: (_log("tau", s.dt, s.dt * np.clip(
               len(s.y) / 40.0, 2.0, LATEST)),),
           equation="y + coefficient (X - x), X = x(t - tau), or x(t + tau) where the "
                    "column is late, or x after a low-pass of first or second order "
                    "that delays by tau; tau in s, coefficient in u per unit of x, 1 "
                    "of a sensor that is but late",
           resembles="latency where tau is short, noise of the column where the "
                    "coefficient is 1, hysteresis, scale factor",
           experiment="turn with sharp starts and stops"),
    Effect("g_sensitivity", columns=_linear, size="coefficient",
           column=("acceleration", *(f"acceleration_{axis}" for axis in AXES)),
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="scale factor",
           experiment="turn the sensor over at rest"),
    Effect("covariate", columns=_linear, size="coefficient", column="*",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="any drift that moves as the column does",
           experiment="vary that quantity alone"),
    Effect("hysteresis", columns=_hysteresis, column="any",
           parameters=lambda s: (_log("play", 3e-4, WIDEST_PLAY),),
           equation="y + size (x - X) / width, X follows x as soon as it is width = "
                    "play (max x - min x) behind; play without unit, size in u",
           resembles="thermal lag, lag, scale factor, random telegraph",
           experiment="drive that quantity up and down at different speed"),
    Effect("random_walk", model=_random_walk, elementwise=True,
           parameters=lambda s: (_log("sigma_w", s.white / len(s.y),
                                      _spread(s) / np.sqrt(len(s.y)) * 10.0),),
           equation="y + w, w the sum of white noises of standard deviation sigma_w, "
                    "in u per sample",
           resembles="rate ramp, correlated noise of long time, bias instability",
           experiment="record longer"),
    Effect("correlated_noise", model=_correlated_noise, elementwise=True,
           parameters=lambda s: (_log("tau", 1.5 * s.dt, s.duration / 10),
                                 _log("sigma", 0.03 * s.white, _spread(s))),
           equation="y + m, dm/dt = -m / tau + white noise, standard deviation of m "
                    "sigma; tau in s, sigma in u",
           resembles="bias instability, random telegraph, random walk",
           experiment="record longer, sample faster"),
    Effect("bias_instability", model=_bias_instability, elementwise=True,
           parameters=lambda s: (_log("sigma", 0.01 * s.white, _spread(s)),),
           equation="y + Markov processes of the spectrum B^2 / (2 pi f) together, B = "
                    "sigma sqrt(pi / (decades ln 10)) in u, decades one more than "
                    "whole ones from dt to T / 10",
           resembles="correlated noise, random walk", experiment="record longer"),
    Effect("narrow_band_noise", model=_narrow_band, elementwise=True, search="band",
           parameters=lambda s: (Parameter("frequency", MIN_CYCLES / s.duration,
                                           0.5 / s.dt),
                                 _log("tau", 2.0 * s.dt, s.duration / 10),
                                 _log("sigma", 0.03 * s.white, _spread(s))),
           equation="y + a process of covariance sigma^2 exp(-|t| / tau) "
                    "cos(2 pi frequency t), 0 where 2 pi frequency tau < 2; frequency "
                    "in Hz, tau in s, sigma in u",
           resembles="sinusoid where tau is long, correlated noise where it is short",
           experiment="damp vibration; an alias moves with the sampling rate"),
    Effect("bandwidth", model=_bandwidth, elementwise=True, search="spectrum",
           variants=("first order", "second order", "digital", "digital first order",
                     "digital white noise", "digital first order white noise",
                     EXPONENTIAL),
           alike=("first order", EXPONENTIAL),
           of_all=(("digital", "digital white noise"),
                   ("digital first order", "digital first order white noise"),
                   (EXPONENTIAL, "first order")),
           uneven=(("digital", "second order"), ("digital first order", "first order"),
                   (EXPONENTIAL, "first order"),
                   ("digital white noise", "second order"),
                   ("digital first order white noise", "first order")),
           parameters=lambda s: (_log("tau", 0.15 * s.dt, 50.0 * s.dt),),
           equation="the white noise v becomes V, tau dV/dt = v - V, or tau^2 d2V/dt2 "
                    "+ sqrt(2) tau dV/dt = v - V, sampled, with the density that v has "
                    "at rest; a digital one (of second order, or "
                    "first), the bilinear transform of either that keeps the cut-off "
                    "1 / (2 pi tau), or an exponential one, y + a (Y - y) with a = "
                    "exp(-dt / tau) and Y the value before, has random walks, Markov "
                    "processes, narrow-band noise, what begins at some time and what "
                    "follows a column pass it, too, or the white noise alone, if no "
                    "noise changes; tau in s",
           resembles="correlated noise of short time", experiment="sample faster"),
    Effect("blue_noise", model=_blue_noise, elementwise=True, search="spectrum",
           parameters=lambda s: (_log("tau", 0.25 * s.dt, 50.0 * s.dt),
                                 _log("sigma", 0.03 * s.white, _spread(s))),
           equation="y + w - W, tau dW/dt = w - W, w white noise, standard deviation "
                    "of w - W sigma; tau in s, sigma in u",
           resembles="quantization of the angle, white noise that is low-passed",
           experiment="integrate: the angle has white noise"),
    Effect("noise_step", model=_noise_step, drive=_stronger_from, of_white=True,
           elementwise=True, search="onset",
           parameters=lambda s: (_onset(s, MIN_SIDE), _log("ratio", 0.1, 10.0)),
           equation="the white noise becomes ratio times as strong from t = onset "
                    "on; onset in s",
           resembles="outliers in clusters, noise ramp",
           experiment="look for what was switched on at the onset"),
    Effect("noise_ramp", model=_noise_along, drive=_stronger_along, of_white=True,
           elementwise=True, relative_to=_whole_range,
           parameters=lambda s: (_log("ratio", 1.0 / 30.0, 30.0),),
           equation="the white noise becomes ratio^((t - about) / per) times as "
                    "strong; about and per in s",
           resembles="noise step, noise sensitivity where the column drifts",
           experiment="record longer, and the temperature with it"),
    Effect("noise_sensitivity", model=_noise_along, drive=_stronger_along,
           of_white=True, elementwise=True, column="any", variants=("value", "square"),
           relative_to=_whole_range,
           parameters=lambda s: (_log("ratio", 1.0 / 30.0, 30.0),),
           equation="the white noise becomes ratio^u times as strong, or sqrt(1 + "
                    "(ratio^2 - 1) u^2) times, u = (x - about) / per; about and per "
                    "in units of x",
           resembles="bursts of noise, change of the noise, outliers",
           experiment="hold that quantity at several values, compare the Allan "
                      "deviations"),
    Effect("walk_step", model=_walk_step, drive=_stronger_from, elementwise=True,
           search="onset",
           parameters=lambda s: (_onset(s, MIN_SIDE), _log("ratio", 1.0 / 30.0, 30.0)),
           equation="the noise that drives the random walk, or the Markov process, "
                    "becomes ratio times as strong from t = onset on; onset in s",
           resembles="random telegraph, bias step, correlated noise",
           experiment="look for what was switched on at the onset; record longer"),
    Effect("outliers", jumps=_outliers,
           parameters=lambda s: (_log("rate", 1.0 / len(s.y), 0.1),
                                 _log("sigma", 2.0 * s.white, 300.0 * s.white)),
           equation="y + N(0, sigma^2) with the probability rate in every sample; "
                    "sigma in u",
           resembles="noise step, random telegraph",
           experiment="log the raw bus: are they transmission errors?"),
    Effect("noise_bursts", jumps=_noise_bursts,
           parameters=lambda s: (
               _log("quiet", MIN_BURST * s.dt, s.duration / 4.0),
               _log("duration", MIN_BURST * s.dt, s.duration / 10.0),
               _log("sigma", 0.5 * s.white, 30.0 * s.white)),
           equation="y + N(0, sigma^2) in every sample of a burst; bursts last for "
                    "duration and are quiet apart on average, in s; sigma in u",
           resembles="outliers in clusters, noise step, noise sensitivity",
           experiment="look for what runs at times: a fan, a motor, a radio"),
    Effect("random_telegraph", jumps=_telegraph,
           parameters=lambda s: (_log("dwell", 3.0 * s.dt, s.duration / 4),
                                 _log("size", 0.1 * s.white, 2.0 * _spread(s))),
           equation="y +- size / 2, two levels, each kept for dwell on average; "
                    "dwell in s, size in u",
           resembles="correlated noise",
           experiment="average less white noise away: two levels show in a histogram"),
    Effect("random_steps", jumps=_random_steps, model=_level, elementwise=True,
           becomes="random_walk",    # as nearly, of many small steps
           parameters=lambda s: (
               _log("dwell", MIN_REST * s.dt, s.duration / MIN_STEPS),
               _log("sigma", 0.3 * s.white, 3.0 * _spread(s))),
           equation="y + L, L moves by N(0, sigma^2) at times that are dwell apart on "
                    "average; dwell in s, sigma in u",
           resembles="random walk, bias step, random telegraph",
           experiment="average less white noise away: the level stands still between"),
    Effect("quantization", reading=quantize, model=_rounding, elementwise=True,
           equation="lsb round(y / lsb); lsb in u",
           resembles="white noise",
           experiment="widen the word length, raise the gain"),
    Effect("differential_nonlinearity", reading=convert,
           equation="the value of the code of a converter within whose width y lies, "
                    "with codes of (value, width), in u; all widths are lsb without it",
           resembles="coarser quantization",
           experiment="sweep the input slowly over the codes and count how often each "
                      "is met (IEEE Std 1241)"),
    Effect("saturation", reading=_saturate,
           equation="y between two limits, in u",
           resembles="skewed noise",
           experiment="widen the range"),
    Effect("stuck", reading=_stick,
           equation="y keeps its value in spans of (start in s, samples)",
           resembles="quantization",
           experiment="compare the counters of sensor and logger"),
    Effect("repeated_samples", reading=repeat,
           equation="y is what the sensor gave last, which samples at frequency, in "
                    "Hz, below that of the record; phase, in rad, at the first; none "
                    "if it samples at random",
           resembles="stuck samples, quantization",
           experiment="compare the counters of sensor and logger, poll faster"),
    Effect("interpolated_samples", reading=interpolate,
           equation="y is on a straight line, of order 1, or a smooth curve, of order "
                    "3, through what the sensor gave; it samples at frequency, in Hz, "
                    "below that of the record; phase, in rad, at the first; none if it "
                    "samples at random, or loses samples",
           resembles="bandwidth",
           experiment="look for resampling, or for gaps that were filled, in what "
                      "wrote the file; take the samples as they came"),
    Effect("moving_average", reading=_average,
           equation="the mean of y over a window that ends with the sample; window in "
                    "s, whole sampling intervals",
           resembles="bandwidth",
           experiment="look for zeros of the spectrum at multiples of one over the "
                      "window; switch off what smooths the data"),
    Effect("wrong_parameter", factor=1000.0,
           equation="one parameter of the simulator, or all standard deviations, is "
                    "factor times what it says: the middle of a narrow range, the "
                    "nearest end of one wider than by a factor e",
           resembles="correlated noise, bandwidth",
           experiment="compare the Allan deviation with the data sheet, unit by unit"),
)}


def columns_for(effect, scene):
    """Names of the columns of a scene beside which an effect is looked for, [""] if it
    needs none.
    """
    named = {name for other in CATALOGUE.values() for name in other.named}
    return [name for name, x in scene.columns.items()
            if np.std(x) > 0.0 and effect.takes(name, named)] if effect.column else [""]


FAMILIES = (    # effects that a record may show to be one of them, but not which
    ("temperature", "thermal_lag"), ("latency", "lag"),
    ("bias_step", "pulse", "gradual_step"), ("sinusoid", "narrow_band_noise"),
    ("ringing", "vibration_burst"),
    ("rate_ramp", "second_order_drift", "turn_on_transient"),
    ("noise_step", "noise_ramp", "noise_sensitivity"),
    ("random_walk", "correlated_noise", "bias_instability", "random_telegraph"))
