"""What effects add to a record: (scene, x, psi) gives pairs of a variant and columns
(N, k), of x that was recorded beside it and of psi.
"""

import functools
import math

import numpy as np
from numba import njit
from scipy.signal import butter, lfilter, lfilter_zi

from sensorid import JIT

MIN_SLOW = 64     # of a slow step: fewer are a step
MAX_CUT = 0.45    # of the sampling rate: as fast as a digital low-pass can be


def _centred(x):
    """Less its mean; 0 where nothing but rounding varies."""
    return (x - x.mean()) * (np.ptp(x) > 1e-9 * np.abs(x).max())


def from_start(scene, x, psi):
    yield "", scene.time[:, None]


def from_onset(scene, x, psi):
    yield "", (scene.time >= psi - 1e-9 * scene.dt)[:, None].astype(float)


def between(scene, x, psi):
    onset, duration = psi
    yield "rectangular", _from(scene, onset, duration, np.ones_like)
    yield "half sine", _from(scene, onset, duration, lambda t: np.sin(
        np.pi / duration * t))
    yield "decaying", _from(scene, onset, LASTS * duration, lambda t: np.exp(
        -DECAYS / duration * t))


def settling(scene, x, psi):
    onset, duration = psi
    if len(scene.y) >= 4 * MIN_SLOW:    # a shorter record shows but a step
        yield "", _from(scene, onset, np.inf, lambda t: -np.expm1(
            -DECAYS / duration * t))


DECAYS = 3.0    # time constants until what decays is said to be over: 5 % are left
LASTS = 12.0    # times as long, after which nothing is: exp(-36)
OVER = 7.0      # time constants, after which a thousandth is left


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


def ringing(scene, x, psi):
    onset, duration, frequency = psi
    yield "", _waves(scene, onset, LASTS * duration, frequency, lambda t: np.exp(
        -DECAYS / duration * t))


def burst(scene, x, psi):
    onset, duration, frequency = psi
    yield "", _waves(scene, onset, duration, frequency, lambda t: np.sin(
        np.pi / duration * t)**2)


def _waves(scene, onset, duration, frequency, envelope):
    """Cosine and sine (N, 2) in an envelope, from an onset on, for so long."""
    columns, (own, since) = np.zeros((len(scene.y), 2)), _since(scene, onset, duration)
    size, phase = envelope(since), 2.0 * np.pi * frequency * since
    columns[own, 0], columns[own, 1] = size * np.cos(phase), size * np.sin(phase)
    return columns


def parabola(scene, x, psi):
    yield "", ((scene.time - psi)**2)[:, None]


def transient(scene, x, psi):
    yield "", np.exp(-scene.time / psi)[:, None]


AT_HALF = 0.25    # cycles in a record from half its rate: a line there is as one at
                  # half, which has no sine


def is_at_half(scene, frequency):
    """Is a line of that frequency as one at half the sampling rate?"""
    return abs(0.5 / scene.dt - frequency) * scene.duration < AT_HALF


def cosine_and_sine(scene, x, psi):
    N, psi = len(scene.y), 0.5 / scene.dt if is_at_half(scene, psi) else psi
    turn, count = 2j * np.pi * psi * scene.dt, math.isqrt(N) + 1
    # exp of a sum is a product: two short tables make all of it
    wave = np.outer(np.exp(turn * count * np.arange(-(-N // count))),
                    np.exp(turn * np.arange(count))).ravel()[:N]
    yield "", wave.view(float).reshape(N, 2)


AXES = "xyz"    # of which columns are named: rate_y beside the error of gyro_x


def linear(scene, x, psi):
    yield "", _centred(x)[:, None]


def of_temperature(scene, x, psi):
    yield "", _centred(less_noise(x))[:, None]


NO_CHANCE = 4.0    # standard deviations, that white noise must show by
MOSTLY = 0.9       # of the variance of a column is what moves, if it has a noise


def less_noise(x):
    """A column (N,) less the white noise of what recorded it, which the sensor does not
    follow: what is left by the smoother of a random walk in white noise (J. F. Muth, J.
    Am. Stat. Assoc. 55, 1960). As it is, if none shows, or it may be no walk.

    Neighbouring differences of such a record have the covariance -r; values so far
    apart that they differ by 4 r, in the mean square, are 2 r / q samples apart.
    """
    return _less_noise(np.asarray(x, float).tobytes())


@functools.lru_cache(maxsize=4)    # of every time constant
def _less_noise(x):
    x = np.frombuffer(x)
    step = np.diff(x)
    step = step - step.mean()
    r, variance = -np.mean(step[1:] * step[:-1]), np.mean(step**2)
    if not r > NO_CHANCE * variance / np.sqrt(len(x)):
        return x
    r, apart = min(r, 0.5 * variance), 1
    while 2 * apart < len(x) and np.mean((x[apart:] - x[:-apart])**2) < 4.0 * r:
        apart *= 2
    ratio = 2.0 / apart    # q / r
    a = 1.0 + 0.5 * ratio - np.sqrt(ratio + 0.25 * ratio**2)
    result = x
    for _ in range(2):    # forwards and backwards
        result = lfilter([1.0 - a], [1.0, -a], result, zi=[a * result[0]])[0][::-1]
    return result if np.var(result) > MOSTLY * np.var(x) else x


def while_warm(scene, x, psi):
    if "temperature" in scene.columns:
        yield "", (_centred(scene.columns["temperature"]) * _centred(x))[:, None]


def curved(scene, x, psi):
    yield "square", _centred(x**2)[:, None]
    yield "modulus", _centred(np.abs(x))[:, None]


def derivative(scene, x, psi):
    step = np.diff(x) / scene.dt
    yield "backward difference", np.append(0.0, step)[:, None]
    yield "forward difference", np.append(step, 0.0)[:, None]
    yield "central difference", np.gradient(x, scene.dt)[:, None]


def least_tau(scene):
    """Least time constant of an exponential that is tried, s."""
    return min(scene.duration / 400, max(5.0 * scene.dt, scene.duration / 4000))


def least_seen(scene):
    """The same of one from the start on, of which the first sample that is not missing
    shows a thousandth at least: that sample, if it is odd, would be the rest of
    something beyond measure.
    """
    return max(least_tau(scene), np.argmin(np.isnan(scene.y)) * scene.dt / OVER)


def lagged(x, dt, tau):
    """First-order low-pass of time constant tau, s, in steady state at the start."""
    a = np.exp(-dt / tau)
    return lfilter([1.0 - a], [1.0, -a], x, zi=[a * x[0]])[0]


def lagged_values(scene, x, psi):
    yield "lagged value", _centred(lagged(less_noise(x), scene.dt, psi))[:, None]
    # what compensates has the noise of the column, too
    yield "lag", _centred(lagged(x, scene.dt, psi) - x)[:, None]


def lagging(scene, x, psi):
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


def hysteresis(scene, x, psi):
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
