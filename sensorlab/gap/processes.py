"""What effects do inside the filter: (scene, filt, **parameters) gives another shaping
filter; the parameters are numbers, or columns (M, 1) of as many nodes. Those that jump
give `Jumps`.
"""

import functools
import math

import numpy as np
from scipy.optimize import nnls

from sensorid import ShapingFilter, sum_of
from sensorlab.gap.effects import Jumps


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


def random_walk(scene, filt, sigma_w):
    return join(filt, (1.0, sigma_w, 0.0))


def correlated_noise(scene, filt, tau, sigma):
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


def bias_instability(scene, filt, sigma):
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


def bandwidth(scene, filt, tau, variant=""):
    """The white noise passes a low-pass of unit gain at rest, of first order or of
    second (Butterworth), or a digital one (the bilinear transform of either, or an
    exponential average), which random walks, Markov processes and narrow-band noise
    pass, too, if it is not of white noise alone: it lets nothing of them through where
    it lets no white noise through.
    """
    rest, white = filt._replace(Psi=np.zeros(1)), filt.Psi[..., :1]
    if filt.Psi.shape[-1] > 1:    # it changes, and so does what drives the low-pass
        even = bandwidth(scene, filt._replace(Psi=white), tau, variant)
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


def moved_by_level(variant, cut_off, once=False):
    """By how much the states of a `digital` low-pass, but its noise, move where a level
    that passes it does, a unit, (M, m), and what is seen of the level itself (M,), at
    cut-offs (M,): less where they rest, with T of `_through` at f = 1, s - T u <-
    A (s - T u) + (B - T) (u less what it was before); if it is there but `once`, f and
    T are 0.
    """
    filt = digital(variant, cut_off[:, None])
    A, B = filt.Phi[:, 0, :-1, :-1], filt.Gamma[:, 0, :-1, 0]
    if once:
        return B, filt.Gamma[:, 0, -1, 0]
    rest = _solved(np.eye(A.shape[-1]) - A, B)
    return -(A @ rest[..., None])[..., 0], np.ones(len(cut_off))    # B - T, D + C T


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


def narrow_band(scene, filt, frequency, tau, sigma):
    """A vector that turns and shrinks, driven evenly in all directions: one of its two
    components has the covariance sigma^2 exp(-|t| / tau) cos(2 pi frequency t).
    """
    sigma = sigma * (2.0 * np.pi * frequency * tau >= MIN_TURN)
    turn, a = 2.0 * np.pi * frequency * scene.dt, np.exp(-scene.dt / tau)
    c, s, drive = a * np.cos(turn), a * np.sin(turn), sigma * np.sqrt(1.0 - a**2)
    return _added(filt, _pair([[c, -s], [s, c]], [[drive, 0.0], [0.0, drive]],
                              [1.0, 0.0], [[sigma**2, 0.0], [0.0, sigma**2]]))


def blue_noise(scene, filt, tau, sigma):
    """A Markov process less what it was a sample before: white noise through a
    first-order high-pass.
    """
    a = np.exp(-np.minimum(scene.dt / tau, NO_MEMORY))
    variance = sigma**2 / (2.0 * (1.0 - a))
    return _added(filt, _pair(
        [[a, 0.0], [1.0, 0.0]], [[np.sqrt((1.0 - a**2) * variance)], [0.0]],
        [1.0, -1.0], [[variance, a * variance], [a * variance, variance]]))


def level(scene, filt, dwell, sigma):
    """A level that nothing but jumps moves."""
    return join(filt, (1.0, 0.0 * sigma, 0.0))


BEFORE_LOW_PASS = "before the low-pass"    # a form of outliers, and of bursts


def shot(scene, filt, rate, sigma, variant=""):
    """What is 0 but where outliers are that pass a low-pass."""
    return join(filt, (0.0, 0.0 * sigma, 0.0)) if variant == BEFORE_LOW_PASS else filt


BEFORE = "before the onset"    # a form of a change of noise, which has settled since


def noise_step(scene, filt, onset, ratio, variant=""):
    if variant != BEFORE and np.all(onset > scene.time[-1]):
        return filt
    return _with_white(filt, stronger_from(scene, onset, ratio, variant))


def stronger_from(scene, onset, ratio, variant=""):
    first, ratio = np.broadcast_arrays(np.searchsorted(scene.time, onset), ratio)
    times = np.ones((*first.shape[:-1], len(scene.y)))
    for row, at, own in zip(np.atleast_2d(times), first.ravel(), ratio.ravel()):
        row[slice(at) if variant == BEFORE else slice(at, None)] = own    # it is long
    return times


def _with_white(filt, times):
    """A shaping filter whose white noise is so many times as strong."""
    return filt._replace(Psi=filt.Psi * times) if filt.Psi.any() else filt


def noise_along(scene, filt, **values):
    return _with_white(filt, stronger_along(scene, **values))


def stronger_along(scene, ratio, about, per, x, variant=""):
    u = (x - about) / per
    return np.sqrt(np.maximum(1.0 + (ratio**2 - 1.0) * u**2, 0.0)) if (
        variant == "square") else ratio**u


AT_FIRST, AT_LAST = "as simulated at first", "as simulated at last"    # forms of a
LEAST, MOST = "value above its least", "value below its most"    # noise in time, and
                                                                 # along a column


def whole_range(x, variant=""):
    """What the strength of white noise is relative to: it is as the simulator says at
    zero, at the mean, or at an end, and ratio times as strong a whole range away.
    """
    if variant == "square":
        return dict(about=0.0, per=float(np.abs(x).max()))
    least, most = float(x.min()), float(x.max())
    about = {AT_FIRST: least, AT_LAST: most, LEAST: least, MOST: most}
    return dict(about=about.get(variant, float(x.mean())), per=most - least)


def walk_step(scene, filt, onset, ratio):
    return filt._replace(Gamma=filt.Gamma * stronger_from(scene, onset, ratio)[
        ..., None, None])


def rounding(scene, filt, lsb):
    """What rounding adds to the white noise."""
    return filt._replace(Psi=np.sqrt(filt.Psi**2 + lsb**2 / 12.0))


def rounding_of_integral(scene, filt, lsb):
    """What rounding the integral adds: the difference of one white noise, of a twelfth
    of a squared count, and the one before.
    """
    return blue_noise(scene, filt, scene.dt / NO_MEMORY, lsb / np.sqrt(6.0))


# ---- jumps: (dt, **parameters) gives `Jumps`

def outliers(dt, rate, sigma, variant=""):
    if variant == BEFORE_LOW_PASS:
        return Jumps(begin=rate, end=1.0 - rate, step=sigma**2, before=1.0)
    return Jumps(rate=rate, variance=sigma**2)


def telegraph(dt, dwell, size):
    change = -0.5 * np.expm1(-2.0 * dt / dwell)
    return Jumps(begin=change, end=change, half=0.5 * size)


def random_steps(dt, dwell, sigma):
    begin = -np.expm1(-dt / dwell)    # in every sample anew
    return Jumps(begin=begin, end=1.0 - begin, step=sigma**2)


def noise_bursts(dt, quiet, duration, sigma, variant=""):
    return Jumps(begin=-np.expm1(-dt / quiet), end=-np.expm1(-dt / duration),
                 louder=sigma**2, before=float(variant == BEFORE_LOW_PASS))
