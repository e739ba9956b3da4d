"""sensorid: which error model does an inertial sensor follow,
and how well can one tell?

Reference implementation of O. Stepanov and A. Motorin, "Performance Criteria for the
Identification of Inertial Sensor Error Models", Sensors 2019, 19(9), 1997. Equation
numbers are theirs. A record y is explained by one of K shaping filters

    x_i = Phi x_{i-1} + Gamma w_i,    y_i = H x_i + bias + Psi v_i,           (1), (2)

whose structure and parameters theta are unknown. A bank of Kalman filters over a grid
of theta gives the probability of every structure and the posterior of its parameters;
simulation gives the criteria: how often, and by how much, such an answer is wrong.

Notation
    y[trial, i]    sensor error in the user's unit u, sampled at (i + 1) * dt
    k, j           hypothesis; node of its grid
    theta          parameters of a shaping filter; sigma_* a standard deviation, u
    tau_m          correlation time of a Markov process, s
    tau            averaging time of the Allan variance, s; never a correlation time
    a, q, r, p     one-state filter: transition factor, process and measurement noise
                   variances, predicted variance of the state
    nu, f          innovation and its variance (the paper's lambda and Lambda)
    e, mu          the same filter fed with ones: its state and its innovation
    scale          factor common to all noises; integrated out in closed form

The file reads in the order of the paper; a section calls only sections above it.
"""

import argparse
import csv
import functools
import hashlib
import inspect
import io
import itertools
import json
import math
import os
import pathlib
import sys
import warnings
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from typing import Callable, NamedTuple

import numpy as np

if __name__ == "__main__":    # only parses the command line, and quickly
    prange, njit = range, lambda **options: lambda kernel: kernel
else:
    from numba import njit, prange
    from scipy.optimize import isotonic_regression, least_squares, minimize
    from scipy.signal import lfilter
    from scipy.special import (gammainc, gammaincinv, log_ndtr, logsumexp, ndtr, ndtri,
                               ndtri_exp)

__version__ = "0.1.0"

try:
    CACHE = bool(njit(cache=True)(lambda: None))
except RuntimeError:    # neither this folder nor the user's own cache can be written
    CACHE = False
JIT = dict(cache=CACHE, error_model="numpy", fastmath={"contract"})
LOG_2PI = np.log(2.0 * np.pi)


# ---- 1. Models -------------------------- paper Secs. 2 and 4, Eqs. (1)-(2), (21)-(23)

class ShapingFilter(NamedTuple):
    """Matrices of Eqs. (1)-(2). The leading axis is time: one step,
    or one per sample.
    """

    Phi: np.ndarray      # (1 or N, n, n)
    Gamma: np.ndarray    # (1 or N, n, p)
    H: np.ndarray        # (1 or N, n)
    Psi: np.ndarray      # (1 or N,)
    m0: np.ndarray       # (n,) prior expectation of x_0
    P0: np.ndarray       # (n, n) prior covariance of x_0


def shaping_filter(Phi, Gamma, H, Psi=0.0, m0=None, P0=None):
    """Shaping filter of Eqs. (1)-(2) with a scalar measurement.

    Parameters
    ----------
    Phi, Gamma, H : (n, n), (n, p) and (n,) array, 1 <= n <= 6
        Any of them may carry a leading time axis of N samples.
    Psi : float or (N,) array
        Standard deviation of the white noise, u.
    m0, P0 : (n,) and (n, n) array, optional
        Prior expectation and covariance of x_0, by default zero. The first sample is
        y_1, one transition after x_0. A constant bias is no state here: every
        hypothesis adds it by itself.

    Returns
    -------
    ShapingFilter

    Raises
    ------
    ValueError
        If the shapes do not fit or there are more than six states.

    Examples
    --------
    >>> shaping_filter([[1.0]], [[0.1]], [1.0]).Phi.shape
    (1, 1, 1)
    """
    Phi, Gamma, H = (np.array(m, float) for m in (Phi, Gamma, H))
    Phi = Phi if Phi.ndim == 3 else Phi[None]
    Gamma = Gamma if Gamma.ndim == 3 else Gamma[None]
    H = H if H.ndim == 2 else H[None]
    n = Phi.shape[-1]
    m0 = np.zeros(n) if m0 is None else np.array(m0, float)
    P0 = np.zeros((n, n)) if P0 is None else np.array(P0, float)
    shapes = Phi.shape[1:], Gamma.shape[1:2], H.shape[1:], m0.shape, P0.shape
    if shapes != ((n, n), (n,), (n,), (n,), (n, n)) or not 1 <= n <= 6:
        raise ValueError(
            f"Phi, Gamma, H, m0, P0 have shapes {', '.join(map(str, shapes))} "
            "(time apart): a shaping filter of n states needs (n, n), (n, p), (n,), "
            "(n,), (n, n), 1 <= n <= 6")
    return ShapingFilter(Phi, Gamma, H, np.atleast_1d(np.array(Psi, float)), m0, P0)


def white_noise(dt, sigma_v):
    """White noise alone, Eq. (23) without a correlated part."""
    return shaping_filter([[0.0]], [[0.0]], [1.0], sigma_v)


def random_walk(dt, sigma_w, sigma_v=0.0):
    """Random walk from 0, Eq. (21); sigma_w per sample."""
    return shaping_filter([[1.0]], [[sigma_w]], [1.0], sigma_v)


def markov(dt, tau_m, sigma_m, sigma_v=0.0):
    """First-order Markov process in its steady state, Eq. (22)."""
    a = np.exp(-dt / tau_m)
    drive = sigma_m * np.sqrt(-np.expm1(-2.0 * dt / tau_m))
    return shaping_filter([[a]], [[drive]], [1.0], sigma_v, P0=[[sigma_m**2]])


def random_walk_markov(dt, sigma_w, tau_m, sigma_m, sigma_v=0.0):
    """Random walk plus first-order Markov process."""
    m = markov(dt, tau_m, sigma_m)
    return shaping_filter(np.diag([1.0, m.Phi[0, 0, 0]]),
                          np.diag([sigma_w, m.Gamma[0, 0, 0]]),
                          [1.0, 1.0], sigma_v, P0=np.diag([0.0, sigma_m**2]))


def two_markov(dt, tau_m, sigma_m, tau_n, sigma_n, sigma_v=0.0):
    """Two first-order Markov processes."""
    m, n = markov(dt, tau_m, sigma_m), markov(dt, tau_n, sigma_n)
    return shaping_filter(np.diag([m.Phi[0, 0, 0], n.Phi[0, 0, 0]]),
                          np.diag([m.Gamma[0, 0, 0], n.Gamma[0, 0, 0]]),
                          [1.0, 1.0], sigma_v, P0=np.diag([sigma_m**2, sigma_n**2]))


def rate_ramp(dt, slope, sigma_w=0.0, sigma_v=0.0):
    """Ramp of a given slope, u/s (IEEE Std 952, rate ramp), on a random walk."""
    return shaping_filter([[1.0, dt], [0.0, 1.0]], [[sigma_w], [0.0]], [1.0, 0.0],
                          sigma_v, m0=[0.0, slope])


MODELS = {model.__name__: model for model in (
    white_noise, random_walk, markov, random_walk_markov, two_markov, rate_ramp)}


class Parameter(NamedTuple):
    """A parameter and its prior: fixed where low == high,
    else uniform or log-uniform.
    """

    symbol: str
    low: float
    high: float
    log: bool = False

    @property
    def free(self):
        return self.low < self.high

    def quantile(self, u):
        """Value below which the prior has the probability u, 0..1."""
        if self.free and self.log:
            return self.low * (self.high / self.low)**u
        return self.low + u * (self.high - self.low)

    @property
    def mean(self):
        """Prior mean, the denominator of Eq. (20)."""
        if self.free and self.log:
            return (self.high - self.low) / np.log(self.high / self.low)
        return 0.5 * (self.low + self.high)

    @property
    def sd(self):
        """Prior standard deviation."""
        if self.free and self.log:
            second = (self.high**2 - self.low**2) / (2.0 * np.log(self.high / self.low))
            return np.sqrt(second - self.mean**2)
        return (self.high - self.low) / np.sqrt(12.0)


def free_columns(parameters):
    """Columns of the parameters that are not fixed."""
    return [c for c, p in enumerate(parameters) if p.free]


def at_quantiles(parameters, u):
    """Parameters (..., p) at the prior quantiles u (..., d) of the free ones."""
    theta = np.empty((*np.shape(u)[:-1], len(parameters)))
    theta[:] = [p.low for p in parameters]
    for axis, column in enumerate(free_columns(parameters)):
        theta[..., column] = parameters[column].quantile(np.asarray(u)[..., axis])
    return theta


class Hypothesis(NamedTuple):
    """A structure of the error model with the prior of its parameters,
    see `hypothesis`.
    """

    name: str
    model: Callable[..., ShapingFilter]
    parameters: tuple
    bias_sigma: float


def hypothesis(model, name=None, bias_sigma=1.0, prior="uniform", **parameters):
    """Hypothesis h_k of Eqs. (1)-(2): a shaping filter, a bias and priors.

    Parameters
    ----------
    model : str or function
        A name in MODELS, or a function of dt, s, and the parameters that returns a
        `shaping_filter`. Parameters called sigma_* are standard deviations.
    name : str, optional
        Label in tables and legends, by default the name of the model.
    bias_sigma : float >= 0
        The constant bias is drawn from N(0, bias_sigma^2), u.
    prior : "uniform" or "log"
        Law of every parameter given as a range.
    **parameters : float, (low, high) or Parameter
        Known value, range of an unknown one, or range with a law of its own.

    Returns
    -------
    Hypothesis

    Raises
    ------
    ValueError
        If a name is unknown or missing, or a range is upside down or out of bounds.

    Examples
    --------
    Case 2 of the paper, and a structure of one's own:

    >>> rw = hypothesis("random_walk", sigma_w=(0.04, 0.15), sigma_v=0.5)
    >>> def drift(dt, sigma_d):
    ...     return shaping_filter([[1, dt], [0, 1]], [[0], [sigma_d]], [1, 0], Psi=0.1)
    >>> hypothesis(drift, sigma_d=(1e-6, 1e-4)).name
    'drift'
    """
    if isinstance(model, str):
        if model not in MODELS:
            raise ValueError(f"unknown hypothesis {model!r}: "
                             f"known are {', '.join(MODELS)}")
        model = MODELS[model]
    name = name or model.__name__
    signature = list(inspect.signature(model).parameters.values())[1:]
    known = [p.name for p in signature]
    missing = [p.name for p in signature
               if p.default is p.empty and p.name not in parameters]
    strange = [symbol for symbol in parameters if symbol not in known]
    if missing or strange:
        raise ValueError(f"{name} has the parameters {', '.join(known)}: " + "; ".join(
            [f"{s} is not given" for s in missing]
            + [f"{s} is none of them" for s in strange]))
    if prior not in ("uniform", "log"):
        raise ValueError(f"prior {prior!r} of {name} is neither 'uniform' nor 'log'")
    if not 0.0 <= _number(bias_sigma, f"bias_sigma of {name}") < np.inf:
        raise ValueError(f"bias_sigma = {bias_sigma} of {name} "
                         "is not a finite number >= 0")
    priors = tuple(_parameter(name, s, parameters[s], prior)
                   for s in known if s in parameters)
    h = Hypothesis(name, model, priors, float(bias_sigma))
    at_most = _filter_at(h, 1.0, [p.high for p in priors])
    if not (at_most.Gamma.any() or at_most.Psi.any() or at_most.P0.any()):
        raise ValueError(f"all noises of {name} are zero: "
                         "give at least one sigma_* > 0")
    return h


def _number(value, what):
    """`value` as a float, or a sentence on what it should be."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        raise ValueError(f"{what} is {value!r}: a number is needed")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{what} is too large a number") from None


def _parameter(name, symbol, value, prior):
    """Prior of one parameter from a number or a range."""
    what = f"{symbol} of {name}"
    if isinstance(value, Parameter):
        prior, value = "log" if value.log else "uniform", value[1:3]
    if np.ndim(value) == 0:
        low = high = _number(value, what)
    elif np.shape(value) == (2,):
        low, high = (_number(v, what) for v in value)
    else:
        raise ValueError(f"{what} is {value!r}: give a number or a range [low, high]")
    if not (np.isfinite(low) and np.isfinite(high)):
        raise ValueError(f"{what} is {value!r}: both ends must be finite")
    if low > high:
        raise ValueError(f"range [{low:g}, {high:g}] of {what} is upside down: "
                         "low <= high")
    if (symbol.startswith("sigma") and low < 0.0
            or symbol.startswith("tau") and low <= 0.0):
        raise ValueError(
            f"{what} starts at {low:g}: "
            f"it must be {'>= 0' if symbol.startswith('sigma') else '> 0'}")
    if prior == "log" and low <= 0.0 < high - low:
        raise ValueError(f"range [{low:g}, {high:g}] of {what} with a log prior: "
                         "it must be > 0")
    return Parameter(symbol, low, high, prior == "log")


class Trials(NamedTuple):
    """Simulated records with the truth behind them."""

    error: np.ndarray         # (L, N), u
    hypothesis: np.ndarray    # (L,) number of the true hypothesis, from 0
    theta: np.ndarray         # (L, largest number of parameters), NaN where there
                              # is none


def simulate(hypotheses, dt, samples, trials=1, seed=0, first=0):
    """Records drawn from the prior: hypothesis, parameters, bias, x_0 and noises.

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
        Equally probable.
    dt : float
        Sampling interval, s.
    samples, trials : int
        Length N of a record and number L of records.
    seed, first : int
        Trial number l = first, first + 1, ... owns the stream `spawn_key=(l,)` of the
        seed, so that any part of a set of trials can be drawn alone.

    Returns
    -------
    Trials

    Examples
    --------
    >>> h = hypothesis("random_walk", sigma_w=0.1, bias_sigma=0.0)
    >>> simulate([h], 1.0, 2, trials=3).error.shape
    (3, 2)
    """
    error = np.empty((trials, samples))
    number = np.empty(trials, int)
    theta = np.full((trials, max(len(h.parameters) for h in hypotheses)), np.nan)

    def draw(row):
        rng = np.random.default_rng(
            np.random.SeedSequence(seed, spawn_key=(first + row,)))
        number[row] = rng.integers(len(hypotheses))
        h = hypotheses[number[row]]
        for column, p in enumerate(h.parameters):
            theta[row, column] = p.quantile(rng.random())
        bias = h.bias_sigma * rng.standard_normal()
        filt = _filter_at(h, dt, theta[row])
        n, noises = filt.Gamma.shape[1:]
        variance, axes = np.linalg.eigh(filt.P0)
        x0 = filt.m0 + axes @ (np.sqrt(np.maximum(variance, 0.0))
                               * rng.standard_normal(n))
        w, v = rng.standard_normal((samples, noises)), rng.standard_normal(samples)
        error[row] = bias + _response(filt.Phi, filt.Gamma, filt.H, filt.Psi, x0, w, v)

    with ThreadPoolExecutor(os.cpu_count()) as pool:    # NumPy draws without the lock
        list(pool.map(draw, range(trials)))
    return Trials(error, number, theta)


def _filter_at(h, dt, theta):
    """Shaping filter of a hypothesis at one value of its parameters."""
    return h.model(dt, **{p.symbol: value for p, value in zip(h.parameters, theta)})


@njit(nogil=True, **JIT)
def _response(Phi, Gamma, H, Psi, x0, w, v):
    """y of Eqs. (1)-(2) for given noises."""
    y = np.empty(len(v))
    x = x0.copy()
    new = np.empty_like(x)
    for i in range(len(v)):
        phi, gamma = Phi[min(i, len(Phi) - 1)], Gamma[min(i, len(Gamma) - 1)]
        h = H[min(i, len(H) - 1)]
        y[i] = Psi[min(i, len(Psi) - 1)] * v[i]
        for row in range(len(x)):
            new[row] = 0.0
            for column in range(len(x)):
                new[row] += phi[row, column] * x[column]
            for column in range(w.shape[1]):
                new[row] += gamma[row, column] * w[i, column]
            y[i] += h[row] * new[row]
        x[:] = new
    return y


# ---- 2. Grid --------------------------------------------------- paper Sec. 2, Eq. (3)
#
# Where all noises of a hypothesis are unknown, a common factor, the scale, enters the
# likelihood in closed form. Nodes then hold ratios to the last sigma_*. One axis less,
# and the sharpest one: the white noise of 20 000 samples is known to 0.5 %.
#
# `limits` say where the prior leaves the scale of a node. Row 0 is the range of the
# scale itself. The range of any other sigma_* cuts the grid at a slant; as the scale is
# sharper than the grid, such an edge is a step between nodes, and its weight runs from
# 0 to 1 over `blur`, the distance of the nodes, so that linear functions are integrated
# exactly.
#
# Nodes are spaced evenly in ln theta (in theta where a range reaches below zero).

FLOOR = 1e-4    # a uniform range from 0 is gridded from FLOOR * high: 1e-4 of its mass


class Grid(NamedTuple):
    """Nodes theta^kj of Eq. (3) with the logarithm of their prior weights mu_0^kj."""

    hypothesis: Hypothesis
    dt: float
    theta: np.ndarray         # (M, p) parameters at scale 1
    exponent: np.ndarray      # (p,) 1 where the parameter is multiplied by the scale
    coordinate: np.ndarray    # (M, d) coordinates of the nodes
    spacing: np.ndarray       # (d,) largest distance of neighbours along each axis
    log_prior: np.ndarray     # (M,) includes the quadrature weight
    limits: np.ndarray        # (M, 1 + E, 3) low and high end of ln scale, blur
    power: float              # prior of ln scale: scale**power


def _scale_parameter(h, dt):
    """Column of the parameter that serves as the scale, or None where none can.

    All noises must be free (or absent) and the filter must be linear in them.
    """
    sigma = [c for c, p in enumerate(h.parameters) if p.symbol.startswith("sigma")]
    if not sigma or any(not h.parameters[c].free and h.parameters[c].high > 0
                        for c in sigma):
        return None
    once = np.array([p.mean for p in h.parameters])
    twice = once.copy()
    twice[sigma] *= 2.0
    one, two = _filter_at(h, dt, once), _filter_at(h, dt, twice)
    factors = dict(Phi=1.0, H=1.0, Gamma=2.0, Psi=2.0, P0=4.0, m0=2.0)
    linear = all(np.allclose(getattr(two, m), factor * getattr(one, m),
                             rtol=1e-12, atol=0.0)
                 for m, factor in factors.items()) and not one.m0.any()
    return [c for c in sigma if h.parameters[c].free][-1] if linear else None


def _gregory(n):
    """Weights of n evenly spaced ordinates:
    the trapezoid with third-order end corrections.
    """
    weight = np.ones(n)
    if n >= 6:
        weight[:3] = weight[:-4:-1] = 3 / 8, 7 / 6, 23 / 24
    elif n > 1:
        weight[0] = weight[-1] = 0.5
    return weight


class Box(NamedTuple):
    """Part of the parameter space:
    axis a lies low..high above slope[a, :a] @ outer axes.
    """

    low: np.ndarray
    high: np.ndarray
    slope: np.ndarray


def _axes(h, dt):
    """Columns of the free axes, logarithmic or not, and the scale column."""
    scale = _scale_parameter(h, dt)
    free = [c for c, p in enumerate(h.parameters) if p.free and c != scale]
    log = np.array([h.parameters[c].low > 0
                    or h.parameters[c].symbol.startswith("sigma")
                    for c in free], bool)
    return free, log, scale


def prior_box(h, dt):
    """The whole prior of a hypothesis as a `Box` in the coordinates of its grid."""
    free, log, scale = _axes(h, dt)
    low, high = np.empty(len(free)), np.empty(len(free))
    for axis, column in enumerate(free):
        p = h.parameters[column]
        ends = np.array([(p.low or FLOOR * p.high) if log[axis] else p.low, p.high])
        if scale is not None and p.symbol.startswith("sigma"):
            s = h.parameters[scale]
            ends = ends / (s.high, (s.low or FLOOR * s.high))
        low[axis], high[axis] = np.log(ends) if log[axis] else ends
    return Box(low, high, np.zeros((len(free), len(free))))


def grid(h, dt, nodes, box=None):
    """Grid over the prior of a hypothesis, or over a box inside it.

    Parameters
    ----------
    h : Hypothesis
    dt : float
        Sampling interval, s.
    nodes : int or (d,) sequence of int
        Nodes along each axis. There are d axes: the unknown parameters less the scale.
    box : Box, optional
        Part of the prior to be covered; a sheared box follows a ridge.

    Returns
    -------
    Grid

    Examples
    --------
    Random walk with unknown white noise: one axis, sigma_w / sigma_v.

    >>> g = grid(hypothesis("random_walk", sigma_w=(0.04, 0.15), sigma_v=(0.25, 1)),
    ...          1.0, 33)
    >>> g.coordinate.shape[1], float(np.exp(g.coordinate).max().round(3))
    (1, 0.6)
    """
    free, log, scale = _axes(h, dt)
    prior = prior_box(h, dt)
    box = prior if box is None else box
    nodes = np.broadcast_to(nodes, len(free))
    z, log_prior, step = np.zeros((1, 0)), np.zeros(1), np.zeros((1, 0))
    for axis, n in enumerate(nodes):
        shift = z @ box.slope[axis, :axis]
        low = np.maximum(prior.low[axis], shift + box.low[axis])
        high = np.minimum(prior.high[axis], shift + box.high[axis])
        keep = high > low
        width = (high - low)[keep, None] / max(n - 1, 1)
        new = low[keep, None] + width * (np.arange(n) if n > 1 else 0.5)
        log_prior = (log_prior[keep, None] + np.log(width * _gregory(n))).ravel()
        z = np.column_stack([np.repeat(z[keep], n, axis=0), new.ravel()])
        step = np.repeat(np.column_stack([step[keep], width]), n, axis=0)

    theta = np.array([p.high for p in h.parameters]) * np.ones((len(z), 1))
    theta[:, free] = np.where(log, np.exp(z * log), z)
    exponent, power = np.zeros(len(h.parameters)), 0.0
    limits = np.zeros((len(z), 1, 3))
    for axis, column in enumerate(free):
        p = h.parameters[column]
        log_prior += (-np.log(np.log(p.high / p.low)) if p.log else
                      log[axis] * z[:, axis] - np.log(p.high - p.low))
    if scale is not None:
        theta[:, scale] = 1.0
        s = h.parameters[scale]
        log_prior -= np.log(np.log(s.high / s.low) if s.log else s.high - s.low)
        sigma = [c for c, p in enumerate(h.parameters)
                 if p.symbol.startswith("sigma") and p.free]
        exponent[sigma] = 1.0
        power = sum(not h.parameters[c].log for c in sigma)
        limits = np.zeros((len(z), len(sigma), 3))
        for row, column in enumerate([scale] + [c for c in sigma if c != scale]):
            p = h.parameters[column]
            ratio = np.log(theta[:, column])
            limits[:, row, 0] = np.log((p.low or FLOOR * p.high)) - ratio
            limits[:, row, 1] = np.log(p.high) - ratio
            limits[:, row, 2] = step[:, free.index(column)] if row else 0.0
    low = (limits[..., 0] - limits[..., 2]).max(1)
    high = (limits[..., 1] + limits[..., 2]).min(1)
    keep = (low < high) | (scale is None)
    return Grid(h, dt, theta[keep], exponent, z[keep], step.max(0, initial=0.0),
                log_prior[keep], limits[keep], float(power))


def uniform_grid(h, dt, nodes):
    """The plain grid of the paper: evenly spaced in theta, equal weights, no scale.

    Takes and returns what `grid` does; nothing is integrated in closed form.
    """
    free = free_columns(h.parameters)
    axes = [np.linspace(h.parameters[c].low, h.parameters[c].high, nodes) for c in free]
    z = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(free))
    theta = np.array([p.high for p in h.parameters]) * np.ones((len(z), 1))
    theta[:, free] = z
    spacing = np.array([axis[1] - axis[0] for axis in axes])
    return Grid(h, dt, theta, np.zeros(theta.shape[1]), z, spacing,
                np.full(len(z), -np.log(len(z))), np.zeros((len(z), 1, 3)), 0.0)


# ---- 3. Filter bank --------------------------------------- paper Sec. 2, Eqs. (4)-(9)
#
# The second state of Eqs. (21)-(22), the bias, is kept apart (B. Friedland, "Treatment
# of bias in recursive filtering", IEEE Trans. Autom. Control 14, 1969): a filter
# without bias runs on the data, the same filter runs on ones, and four sums hold the
# exact likelihood of the two-state filter for every prior of the bias and every scale
# of the noises:
#
#     chi2 = sum nu^2/f,           score = sum nu mu/f,
#     information = sum mu^2/f,    log_det = sum ln f.
#
# Gains and f never see the data. They run once per node and serve all trials.

LANES = 32     # trials that march abreast
GROUP = 32     # nodes that march abreast
TILE = 128     # samples; a TILE x LANES tile of data (32 KiB) stays in the L1 cache


class Sums(NamedTuple):
    """What a bank of M nodes knows of C records after `count` observed samples."""

    count: int
    chi2: np.ndarray           # (C, M)
    score: np.ndarray          # (C, M)
    information: np.ndarray    # (M,)
    log_det: np.ndarray        # (M,)


@njit(**JIT)
def _gains(observed, node, memory, ak, w, c):
    """Gain a k, weights 1/f and mu/f of every step, Eqs. (5), (6), (8),
    for GROUP nodes.

    node (4, GROUP) rows a, q, r, unused; memory (4, GROUP) rows p, e, information,
    log_det.
    """
    n = len(observed)
    product = np.ones(GROUP)    # of eight f's: a logarithm costs more than all the rest
    for i in range(n):
        o = observed[i]         # 0 where the sample is missing: predict only
        for g in range(GROUP):
            a, q, r = node[0, g], node[1, g], node[2, g]
            p, e = memory[0, g], memory[1, g]
            f = p + r
            mu = 1.0 - e
            k = a * p * o / f
            w[i, g] = o / f
            c[i, g] = mu * o / f
            ak[i, g] = k
            memory[0, g] = a * (a - k) * p + q
            memory[1, g] = a * e + k * mu
            memory[2, g] += mu * mu * o / f
            product[g] *= o * f + (1.0 - o)
        if i % 8 == 7 or i == n - 1:
            for g in range(GROUP):
                memory[3, g] += np.log(product[g])
                product[g] = 1.0


@njit(**JIT)
def _trials_abreast(y, a, ak, w, c, g, state):
    """Eqs. (4), (7) and the sums of node g of a group for LANES trials.

    y (n * LANES,) is a tile of data; `state` holds the predicted states, chi2 and
    scores one after another. Four samples a pass keep its loads and stores from
    becoming the bottleneck.
    """
    n = len(y) // LANES
    for i in range(0, n - n % 4, 4):
        k0, k1, k2, k3 = ak[i, g], ak[i + 1, g], ak[i + 2, g], ak[i + 3, g]
        w0, w1, w2, w3 = w[i, g], w[i + 1, g], w[i + 2, g], w[i + 3, g]
        c0, c1, c2, c3 = c[i, g], c[i + 1, g], c[i + 2, g], c[i + 3, g]
        at = i * LANES
        for t in range(LANES):
            x = state[t]
            nu0 = y[at + t] - x
            x = a * x + k0 * nu0
            nu1 = y[at + t + LANES] - x
            x = a * x + k1 * nu1
            nu2 = y[at + t + 2 * LANES] - x
            x = a * x + k2 * nu2
            nu3 = y[at + t + 3 * LANES] - x
            state[t] = a * x + k3 * nu3
            state[t + LANES] += (nu0 * w0 * nu0 + nu1 * w1 * nu1
                                 + nu2 * w2 * nu2 + nu3 * w3 * nu3)
            state[t + 2 * LANES] += c0 * nu0 + c1 * nu1 + c2 * nu2 + c3 * nu3
    for i in range(n - n % 4, n):
        for t in range(LANES):
            nu = y[i * LANES + t] - state[t]
            state[t] = a * state[t] + ak[i, g] * nu
            state[t + LANES] += nu * w[i, g] * nu
            state[t + 2 * LANES] += nu * c[i, g]


@njit(parallel=True, **JIT)
def _advance_trials(y, observed, node, memory, state):
    """Move a one-state bank on by one stretch of data, trials abreast.

    y (blocks, n * LANES) sample-major within a block; node, memory (groups, 4, GROUP)
    as in `_gains`; state (groups, GROUP, blocks, 3 * LANES).
    """
    n = len(observed)
    for group in prange(len(node)):
        ak, w, c = (np.empty((TILE, GROUP)), np.empty((TILE, GROUP)),
                    np.empty((TILE, GROUP)))
        for first in range(0, n, TILE):
            last = min(first + TILE, n)
            _gains(observed[first:last], node[group], memory[group], ak, w, c)
            for block in range(len(y)):
                tile = y[block, first * LANES:last * LANES]
                for g in range(GROUP):
                    _trials_abreast(tile, node[group, 0, g], ak, w, c, g,
                                    state[group, g, block])


@njit(**JIT)
def _nodes_abreast(y, node, ak, w, c, state):
    """Eqs. (4), (7) and the sums of GROUP nodes for one record;
    `state` as for the trials.
    """
    for i in range(len(y)):
        for g in range(GROUP):
            nu = y[i] - state[g]
            state[g] = node[0, g] * state[g] + ak[i, g] * nu
            state[g + GROUP] += nu * w[i, g] * nu
            state[g + 2 * GROUP] += nu * c[i, g]


@njit(**JIT)
def _steady_abreast(y, a, ak, state):
    """`_nodes_abreast` once the gain is constant,
    with sums of nu^2 and nu unweighted.
    """
    n = len(y)
    for i in range(0, n - n % 4, 4):
        y0, y1, y2, y3 = y[i], y[i + 1], y[i + 2], y[i + 3]
        for g in range(GROUP):
            x = state[g]
            nu0 = y0 - x
            x = a[g] * x + ak[g] * nu0
            nu1 = y1 - x
            x = a[g] * x + ak[g] * nu1
            nu2 = y2 - x
            x = a[g] * x + ak[g] * nu2
            nu3 = y3 - x
            state[g] = a[g] * x + ak[g] * nu3
            state[g + GROUP] += nu0 * nu0 + nu1 * nu1 + nu2 * nu2 + nu3 * nu3
            state[g + 2 * GROUP] += nu0 + nu1 + nu2 + nu3
    for i in range(n - n % 4, n):
        for g in range(GROUP):
            nu = y[i] - state[g]
            state[g] = a[g] * state[g] + ak[g] * nu
            state[g + GROUP] += nu * nu
            state[g + 2 * GROUP] += nu


@njit(parallel=True, **JIT)
def _advance_record(y, observed, last_gap, node, memory, state):
    """Move a one-state bank on by one stretch of one record, nodes abreast.

    Once p and mu no longer change, f, gain and mu are constants of the node: only the
    innovation is left of the recursion. y (n,); node, memory (groups, 4, GROUP); state
    (groups, 3 * GROUP).
    """
    n = len(observed)
    for group in prange(len(node)):
        ak, w, c = (np.empty((TILE, GROUP)), np.empty((TILE, GROUP)),
                    np.empty((TILE, GROUP)))
        own, gain, sums = memory[group], np.empty(GROUP), np.zeros(3 * GROUP)
        first, drift = 0, 1.0
        while first < n and (drift > 1e-15 or first <= last_gap):
            last = min(first + TILE, n)
            past = own.copy()
            _gains(observed[first:last], node[group], own, ak, w, c)
            _nodes_abreast(y[first:last], node[group], ak, w, c, state[group])
            first, drift = last, 0.0
            for g in range(GROUP):
                drift = max(drift, abs(own[1, g] - past[1, g]),
                            abs(own[0, g] - past[0, g])
                            / (own[0, g] + node[group, 2, g]))
        if first < n:
            for g in range(GROUP):
                f = own[0, g] + node[group, 2, g]
                gain[g] = node[group, 0, g] * own[0, g] / f
                sums[g] = state[group, g]
            _steady_abreast(y[first:], node[group, 0], gain, sums)
            for g in range(GROUP):
                f, mu = own[0, g] + node[group, 2, g], 1.0 - own[1, g]
                state[group, g] = sums[g]
                state[group, g + GROUP] += sums[g + GROUP] / f
                state[group, g + 2 * GROUP] += sums[g + 2 * GROUP] * mu / f
                own[2, g] += (n - first) * mu * mu / f
                own[3, g] += (n - first) * np.log(f)


@njit(parallel=True, **JIT)
def _advance_general(y, observed, last_gap, first, Phi, Q, H, r, x, P, sums):
    """Move a bank of n-state filters on from sample `first`, Eqs. (4)-(8), n <= 6.

    y (C + 1, n_samples) whose last row is ones; Phi, Q (M, 1 or N, n, n),
    H (M, 1 or N, n), r (M, 1 or N); filtered state x (M, C + 1, n) and covariance
    P (M, n, n); sums (M, C + 1, 2) of nu^2/f and nu mu/f, the last row information
    and log_det.
    """
    columns, samples = y.shape
    n = x.shape[2]
    timeless = Phi.shape[1] == Q.shape[1] == H.shape[1] == r.shape[1] == 1
    for node in prange(len(x)):
        prior, Ph, gain = np.empty((n, n)), np.empty(n), np.empty(n)
        new, f, steady = np.empty(n), 1.0, False
        for i in range(samples):
            phi = Phi[node, min(first + i, Phi.shape[1] - 1)]
            noise = Q[node, min(first + i, Q.shape[1] - 1)]
            h = H[node, min(first + i, H.shape[1] - 1)]
            if not steady:
                for row in range(n):
                    for column in range(n):
                        prior[row, column] = 0.0
                        for s in range(n):
                            prior[row, column] += phi[row, s] * P[node, s, column]
                f = r[node, min(first + i, r.shape[1] - 1)]
                for row in range(n):
                    for column in range(n):
                        new[column] = noise[row, column]
                        for s in range(n):
                            new[column] += prior[row, s] * phi[column, s]
                    for column in range(n):
                        prior[row, column] = new[column]
                for row in range(n):
                    Ph[row] = 0.0
                    for column in range(n):
                        Ph[row] += prior[row, column] * h[column]
                    f += h[row] * Ph[row]
                for row in range(n):
                    gain[row] = Ph[row] / f * observed[i]
                steady = timeless and i > last_gap
                for row in range(n):
                    for column in range(n):
                        update = prior[row, column] - gain[row] * Ph[column]
                        steady &= (abs(update - P[node, row, column])
                                   <= 1e-15 * abs(update))
                        P[node, row, column] = update
            mu = 0.0
            for record in range(columns - 1, -1, -1):    # the ones first: they give mu
                nu = y[record, i]
                for row in range(n):
                    new[row] = 0.0
                    for column in range(n):
                        new[row] += phi[row, column] * x[node, record, column]
                    nu -= h[row] * new[row]
                for row in range(n):
                    x[node, record, row] = new[row] + gain[row] * nu
                if record == columns - 1:
                    mu = nu
                    sums[node, record, 0] += observed[i] * mu * mu / f
                    sums[node, record, 1] += observed[i] * np.log(f)
                else:
                    sums[node, record, 0] += observed[i] * nu * nu / f
                    sums[node, record, 1] += observed[i] * nu * mu / f


@njit(parallel=True, **JIT)
def _advance_modal(y, observed, first, a, q, r, P, x, sums):
    """Move a bank of sums of n independent one-state processes on, nodes abreast.

    y (C + 1, n_samples) whose last row is ones; a, q (groups, n, GROUP),
    r (groups, 1 or N, GROUP); filtered covariance P (groups, n, n, GROUP) and state
    x (groups, C + 1, n, GROUP); sums (groups, C + 1, 2, GROUP) as in
    `_advance_general`.
    """
    columns, samples = y.shape
    n = a.shape[1]
    for group in prange(len(a)):
        Ph, f, weight = np.empty((n, GROUP)), np.empty(GROUP), np.empty(GROUP)
        nu, mu = np.empty(GROUP), np.empty(GROUP)
        product = np.ones(GROUP)
        for i in range(samples):
            o, noise = observed[i], r[group, min(first + i, r.shape[1] - 1)]
            for g in range(GROUP):
                f[g] = noise[g]
            for row in range(n):
                for g in range(GROUP):
                    Ph[row, g] = 0.0
                for s in range(n):
                    for g in range(GROUP):
                        P[group, row, s, g] *= a[group, row, g] * a[group, s, g]
                        Ph[row, g] += P[group, row, s, g]
                for g in range(GROUP):
                    P[group, row, row, g] += q[group, row, g]
                    Ph[row, g] += q[group, row, g]
                    f[g] += Ph[row, g]
            for g in range(GROUP):
                weight[g] = o / f[g]
                product[g] *= o * f[g] + (1.0 - o)
            for row in range(n):
                for s in range(n):
                    for g in range(GROUP):
                        P[group, row, s, g] -= Ph[row, g] * Ph[s, g] * weight[g]
            for record in range(columns - 1, -1, -1):    # the ones first: they give mu
                for g in range(GROUP):
                    nu[g] = y[record, i]
                for s in range(n):
                    for g in range(GROUP):
                        x[group, record, s, g] *= a[group, s, g]
                        nu[g] -= x[group, record, s, g]
                for s in range(n):
                    for g in range(GROUP):
                        x[group, record, s, g] += Ph[s, g] * weight[g] * nu[g]
                if record == columns - 1:
                    for g in range(GROUP):
                        mu[g] = nu[g]
                        sums[group, record, 0, g] += weight[g] * mu[g] * mu[g]
                else:
                    for g in range(GROUP):
                        sums[group, record, 0, g] += weight[g] * nu[g] * nu[g]
                        sums[group, record, 1, g] += weight[g] * nu[g] * mu[g]
            if i % 8 == 7 or i == samples - 1:
                for g in range(GROUP):
                    sums[group, columns - 1, 1, g] += np.log(product[g])
                    product[g] = 1.0


class Bank(NamedTuple):
    """Matrices of all nodes of a grid, stacked for the kernels."""

    Phi: np.ndarray    # (M, 1 or N, n, n)
    Q: np.ndarray      # (M, 1 or N, n, n) = Gamma Gamma'
    H: np.ndarray      # (M, 1 or N, n)
    r: np.ndarray      # (M, 1 or N) = Psi^2
    m0: np.ndarray     # (M, n)
    P0: np.ndarray     # (M, n, n)


def bank(h, dt, theta):
    """Shaping filters of a hypothesis at theta (M, p) as a `Bank`."""
    filters = [_filter_at(h, dt, row) for row in theta]
    Phi, Gamma, H, Psi, m0, P0 = (np.stack(part) for part in zip(*filters))
    return Bank(Phi, Gamma @ np.swapaxes(Gamma, -1, -2), H, Psi**2, m0, P0)


def _is_scalar(b):
    """Does the one-state kernel apply?"""
    timeless = b.Phi.shape[1] == b.Q.shape[1] == b.H.shape[1] == b.r.shape[1] == 1
    return b.Phi.shape[2] == 1 and timeless and np.all(b.H == 1.0) and not b.m0.any()


def is_modal(b):
    """Are all filters sums of independent one-state processes in white noise?"""
    off = ~np.eye(b.Phi.shape[2], dtype=bool)
    timeless = b.Phi.shape[1] == b.Q.shape[1] == b.H.shape[1] == 1
    return bool(timeless and np.all(b.H == 1.0) and not b.m0.any() and not (
        b.Phi[..., off].any() or b.Q[..., off].any() or b.P0[..., off].any()))


def filter_bank(b, y, stops):
    """Sums of a bank over records, at each of the given numbers of samples.

    Parameters
    ----------
    b : Bank
    y : (C, N) array
        Records, u. NaN marks a missing sample, the same in all of them.
    stops : increasing sequence of int, 1 <= stop <= N

    Yields
    ------
    Sums
        One per stop, in order. Log-likelihoods of every node follow from it, Eq. (9),
        by `log_likelihood`.

    Raises
    ------
    ValueError
        If samples are missing in some records only, or a stop lies outside the record.

    Examples
    --------
    Two samples of white noise of variance 4, without bias:

    >>> b = bank(hypothesis("white_noise", sigma_v=2.0), 1.0, np.array([[2.0]]))
    >>> next(filter_bank(b, np.array([[2.0, -4.0]]), [2])).chi2
    array([[5.]])
    """
    y = np.asarray(y, float)
    gap = np.isnan(y)
    if (gap != gap[0]).any():
        raise ValueError("samples are missing in some records only: filter these apart")
    if np.any(np.diff(stops) <= 0) or not 1 <= stops[0] <= stops[-1] <= y.shape[1]:
        raise ValueError(f"stops {list(stops)} do not increase within 1..{y.shape[1]}")
    return _sums(b, np.where(gap, 0.0, y), 1.0 - gap[0], stops)


def _sums(b, y, observed, stops):
    """The loop of `filter_bank`: choose a kernel and advance from stop to stop."""
    stretches = [
        (begin, end, np.flatnonzero(observed[begin:end] == 0.0).max(initial=-1))
        for begin, end in zip([0, *stops[:-1]], stops)]
    run = (_sums_record if _is_scalar(b) and len(y) == 1
           else _sums_trials if _is_scalar(b)
           else _sums_modal if is_modal(b) else _sums_general)
    for end, sums in zip(stops, run(b, y, observed, stretches)):
        yield Sums(int(observed[:end].sum()), *sums)


def _sums_general(b, y, observed, stretches):
    records, nodes, n = len(y), *b.m0.shape
    y = np.vstack([y, np.ones(y.shape[1])])
    x, P, sums = (np.zeros((nodes, records + 1, n)), b.P0.copy(),
                  np.zeros((nodes, records + 1, 2)))
    x[:, :-1] = b.m0[:, None]
    for begin, end, last_gap in stretches:
        _advance_general(np.ascontiguousarray(y[:, begin:end]), observed[begin:end],
                         last_gap, begin, b.Phi, b.Q, b.H, b.r, x, P, sums)
        yield sums[:, :-1, 0].T, sums[:, :-1, 1].T, sums[:, -1, 0], sums[:, -1, 1]


def _abreast(part):
    """Nodes of a bank, first axis, as groups: (groups, ..., GROUP)."""
    pad = -len(part) % GROUP
    if pad:
        part = np.pad(part, [(0, pad)] + [(0, 0)] * (part.ndim - 1), mode="edge")
    part = part.reshape(-1, GROUP, *part.shape[1:])
    return np.ascontiguousarray(np.moveaxis(part, 1, -1))


def _sums_modal(b, y, observed, stretches):
    (nodes, n), records = b.m0.shape, len(y)
    y = np.vstack([y, np.ones(y.shape[1])])
    a, q = (_abreast(np.diagonal(m[:, 0], 0, 1, 2)) for m in (b.Phi, b.Q))
    r, P = _abreast(b.r), _abreast(b.P0)
    x = np.zeros((len(a), records + 1, n, GROUP))
    sums = np.zeros((len(a), records + 1, 2, GROUP))
    for begin, end, _ in stretches:
        _advance_modal(np.ascontiguousarray(y[:, begin:end]), observed[begin:end],
                       begin, a, q, r, P, x, sums)
        flat = np.moveaxis(sums, -1, 1).reshape(-1, records + 1, 2)[:nodes]
        yield flat[:, :-1, 0].T, flat[:, :-1, 1].T, flat[:, -1, 0], flat[:, -1, 1]


def _scalar_nodes(b):
    """node and memory of the one-state kernels, padded to whole groups."""
    a, q, r, p0 = (
        np.pad(part.ravel(), (0, -part.size % GROUP), mode="edge").reshape(-1, GROUP)
        for part in (b.Phi, b.Q, b.r, b.P0))
    zero = np.zeros_like(a)
    return np.stack([a, q, r, p0], 1), np.stack([a * a * p0 + q, zero, zero, zero], 1)


def _sums_record(b, y, observed, stretches):
    node, memory = _scalar_nodes(b)
    state = np.zeros((len(node), 3, GROUP))
    for begin, end, last_gap in stretches:
        _advance_record(y[0, begin:end], observed[begin:end], last_gap,
                        node, memory, state.reshape(len(node), -1))
        yield (*(part.reshape(1, -1)[:, :len(b.r)]
                 for part in (state[:, 1], state[:, 2])),
               *(part.ravel()[:len(b.r)] for part in (memory[:, 2], memory[:, 3])))


def _sums_trials(b, y, observed, stretches):
    node, memory = _scalar_nodes(b)
    records, blocks = len(y), -(-len(y) // LANES)
    y = np.pad(y, ((0, -records % LANES), (0, 0))).reshape(blocks, LANES, -1)
    # the lanes of a sample lie side by side
    y = np.ascontiguousarray(y.swapaxes(1, 2))
    state = np.zeros((len(node), GROUP, blocks, 3, LANES))
    for begin, end, _ in stretches:
        stretch = np.ascontiguousarray(y[:, begin:end]).reshape(blocks, -1)
        _advance_trials(stretch, observed[begin:end],
                        node, memory, state.reshape(len(node), GROUP, blocks, -1))
        yield (*(state[:, :, :, part].reshape(-1, blocks * LANES)[:len(b.r), :records].T
                 for part in (1, 2)),
               *(part.ravel()[:len(b.r)] for part in (memory[:, 2], memory[:, 3])))


# ---- 4. Posterior ---------------------------------- paper Sec. 2, Eqs. (3), (10)-(14)

ABSCISSAE, WEIGHTS = np.polynomial.legendre.leggauss(16)
GAMMA = 0.8         # threshold of the decision, the paper's value
TAIL = 14.0         # nats below the mode at which a posterior is cut off: 1e-7 of it
SETTLED = 0.03      # nats, and standard deviations, that a finer grid may change
MAX_ZOOMS = 60      # each halves a box or so; 1e-9 of the prior takes 30
NODES_PER_SD = 1.5  # along every axis; what the prior's edges need,
                    # a Gaussian needs 0.7


@njit(**JIT)
def log_likelihood(s2, count, chi2, score, information, log_det, bias):
    """ln f(Y / theta, scale) of Eq. (9) from the sums of a node at s2 = scale^2.

    The integral over the bias, N(mean, variance), of the Gaussian whose -2 ln is
    (chi2 - 2 score b + information b^2) / s2, up to constants. All arguments broadcast.
    """
    mean, variance = bias
    spread = variance * information + s2
    pull = mean * (2.0 * score - mean * information)
    chi2 = chi2 - (variance * score * score + pull * s2) / spread
    return -0.5 * (count * LOG_2PI + (count - 1) * np.log(s2) + np.log(spread)
                   + log_det + chi2 / s2)


@njit(**JIT)
def _scale_window(count, chi2, score, information, bias, low, high):
    """Mode of ln scale within low..high, its exp(2 mode),
    and the half-width that counts.

    The log posterior of u = ln scale is -count u - D exp(-2u) / 2, less half a nat for
    the bias; D hardly depends on u, so that four fixed-point steps find the mode.
    """
    mean, variance = bias
    pull = mean * (2.0 * score - mean * information)
    least, most = np.exp(2.0 * low), np.exp(2.0 * high)
    s2 = np.sqrt(least * most)
    for _ in range(4):
        spread = variance * information + s2
        known = count - variance * information / spread
        D = max(chi2 - (variance * score * score + pull * s2) / spread, 0.0)
        s2 = min(most, max(least, D / known)) if known > 0.0 else most
    curvature = 2.0 * D / s2
    slope = abs(0.5 * curvature - known)
    width = 2.0 * TAIL / (slope + np.sqrt(slope * slope + 2.0 * TAIL * curvature)
                          + 1e-300)
    # few samples leave a slow upper tail
    return 0.5 * np.log(s2), s2, max(width, TAIL / max(known, 1e-3))


@njit(**JIT)
def _ramp(x):
    """Share of a node x spacings inside an edge:
    the integral of the linear interpolant.
    """
    if x < 0.0:
        return 0.5 * max(1.0 + x, 0.0)**2
    return 1.0 - 0.5 * max(1.0 - x, 0.0)**2


@njit(**JIT)
def _node_mass(count, chi2, score, node, limits, power, bias):
    """Mass of every node for one record: log of it and mean and square of the scale.

    node (M, 3) columns information, log_det, log_prior; limits as in `Grid`. The scale
    is integrated by Gauss-Legendre over the part of its range that holds the posterior;
    nodes TAIL + 10 nats below the best are dropped.
    """
    M, edges = limits.shape[:2]
    mass, first, second = np.empty(M), np.ones(M), np.ones(M)
    low, high, mode, peak = np.zeros(M), np.zeros(M), np.zeros(M), np.empty(M)
    for j in range(M):
        information, log_det, log_prior = node[j]
        low[j] = np.max(limits[j, :, 0] - limits[j, :, 2])
        high[j] = np.min(limits[j, :, 1] + limits[j, :, 2])
        width, s2 = 0.5, 1.0
        if low[j] < high[j]:
            mode[j], s2, width = _scale_window(
                count - power, chi2[j], score[j], information, bias, low[j], high[j])
            low[j], high[j] = (max(low[j], mode[j] - width),
                               min(high[j], mode[j] + width))
            width = 0.5 * (high[j] - low[j])
        peak[j] = power * mode[j] + log_likelihood(
            s2, count, chi2[j], score[j], information, log_det, bias)
        # a bound, if the scale is free
        mass[j] = log_prior + peak[j] + np.log(2.0 * width)
    best = np.max(mass)
    for j in range(M):
        information, log_det, log_prior = node[j]
        if not mass[j] > best - TAIL - 10.0:
            mass[j] = -np.inf
        elif low[j] < high[j]:
            total = mean = square = 0.0
            for point in range(len(ABSCISSAE)):
                u = low[j] + 0.5 * (high[j] - low[j]) * (1.0 + ABSCISSAE[point])
                s2 = np.exp(2.0 * u)
                g = WEIGHTS[point] * np.exp(power * u - peak[j] + log_likelihood(
                    s2, count, chi2[j], score[j], information, log_det, bias))
                for edge in range(1, edges):
                    begin, end, blur = limits[j, edge]
                    g *= _ramp((u - begin) / blur) * _ramp((end - u) / blur)
                total += g
                mean += g * np.sqrt(s2)
                square += g * s2
            mass[j] = log_prior + peak[j] + np.log(0.5 * (high[j] - low[j]) * total)
            if total > 0.0:
                first[j], second[j] = mean / total, square / total
    return mass, first, second


@njit(**JIT)
def _moments(mass, first, second, feature, exponent):
    """Log of the total mass; mean and covariance of the features, Eqs. (13), (14).

    feature (M, F) at scale 1, to be multiplied by scale**exponent (0 or 1).
    """
    M, F = feature.shape
    best = np.max(mass)
    total, mean, cov = 0.0, np.zeros(F), np.zeros((F, F))
    for j in range(M):
        if mass[j] > -np.inf:
            weight = np.exp(mass[j] - best)
            total += weight
            for row in range(F):
                mean[row] += weight * feature[j, row] * (
                    first[j] if exponent[row] else 1.0)
    mean /= total
    for j in range(M):
        if mass[j] > -np.inf:
            weight = np.exp(mass[j] - best) / total
            spread = second[j] - first[j] * first[j]
            for row in range(F):
                high = (feature[j, row] * (first[j] if exponent[row] else 1.0)
                        - mean[row])
                for column in range(row + 1):
                    wide = (feature[j, column] * (first[j] if exponent[column] else 1.0)
                            - mean[column])
                    both = (feature[j, row] * feature[j, column] * spread
                            if exponent[row] and exponent[column] else 0.0)
                    cov[row, column] += weight * (high * wide + both)
    for row in range(F):
        for column in range(row):
            cov[column, row] = cov[row, column]
    return best + np.log(total), mean, cov


@njit(parallel=True, **JIT)
def _posteriors(count, chi2, score, node, limits, power, bias, feature, exponent):
    """Log evidence (C,), means (C, F) and covariances (C, F, F) of C records."""
    C, F = len(chi2), len(exponent)
    log_evidence, mean, cov = np.empty(C), np.empty((C, F)), np.empty((C, F, F))
    for record in prange(C):
        mass, first, second = _node_mass(
            count, chi2[record].copy(), score[record].copy(),
            node, limits, power, bias)
        log_evidence[record], mean[record], cov[record] = _moments(
            mass, first, second, feature, exponent)
    return log_evidence, mean, cov


def _node_columns(g, sums):
    """The columns of `node` in `_node_mass`."""
    return np.column_stack([sums.information, sums.log_det, g.log_prior])


def _features(g):
    """Parameters and coordinates side by side, with their exponents."""
    return (np.column_stack([g.theta, g.coordinate]),
            np.append(g.exponent, np.zeros(g.coordinate.shape[1])))


def _edge_nodes(g, mean, cov):
    """Nodes per standard deviation of ln theta along every axis of a ratio.

    Where the data lie outside the prior, its edge cuts a posterior that is sharper in
    theta than in the ratio.
    """
    nodes = np.full(len(g.spacing), np.inf)
    free, _, scale = _axes(g.hypothesis, g.dt)
    for axis, column in enumerate(free):
        if scale is not None and g.exponent[column]:
            nodes[axis] = np.sqrt(cov[column, column]) / mean[column] / g.spacing[axis]
    return nodes


def posteriors(g, y, stops, coordinates=False):
    """Posterior of many records on one grid, Eqs. (11), (13), (14).

    Parameters
    ----------
    g : Grid
    y : (C, N) array
        Records, u, as for `filter_bank`.
    stops : increasing sequence of int
        Numbers of samples at which it is wanted.
    coordinates : bool
        Append the coordinates of the grid to the parameters.

    Yields
    ------
    log_evidence, mean, covariance : (C,), (C, p) and (C, p, p) array
        One triple per stop.
    """
    feature, exponent = g.theta, g.exponent
    if coordinates:
        feature, exponent = _features(g)
    h = g.hypothesis
    for sums in filter_bank(bank(h, g.dt, g.theta), y, stops):
        yield _posteriors(sums.count, np.ascontiguousarray(sums.chi2),
                          np.ascontiguousarray(sums.score), _node_columns(g, sums),
                          g.limits, g.power, (0.0, h.bias_sigma**2), feature, exponent)


def _nodes_per_sd(g, cov):
    """Nodes per posterior standard deviation along every axis,
    the outer ones held fixed.

    That is what an iterated quadrature has to resolve. 0 where one node holds all the
    mass.
    """
    cov = cov[g.theta.shape[1]:, g.theta.shape[1]:]
    sd = np.sqrt(np.diagonal(cov))
    if not (sd > 0.0).all():
        return np.zeros(len(sd))
    try:
        return sd * np.diagonal(np.linalg.cholesky(cov / np.outer(sd, sd))) / g.spacing
    except np.linalg.LinAlgError:    # all the mass lies on one line of nodes
        return np.zeros(len(sd))


class Estimate(NamedTuple):
    """What a record says of one hypothesis:
    the point masses of Eq. (3) and their moments.
    """

    hypothesis: Hypothesis
    log_evidence: float          # ln f(Y / h_k)
    mean: np.ndarray             # (p,) Eq. (13)
    covariance: np.ndarray       # (p, p) Eq. (14)
    theta: np.ndarray            # (M, p) point masses
    weight: np.ndarray           # (M,) mu^kj, sum to 1
    nodes_per_sd: np.ndarray     # (d,) along each axis of the last grid
    settled: bool                # a finer grid said the same
    updates: int                 # filter steps that it took, all grids together


class Posterior(NamedTuple):
    """Answer of `identify`."""

    dt: float
    samples: int
    probability: np.ndarray    # (K,) Eq. (10), equal prior probabilities
    estimates: tuple           # K of Estimate


class _View(NamedTuple):
    """What a grid shows of a posterior."""

    box: Box           # holds it, or the tempered one
    tempered: bool     # the grid is too coarse to show the posterior itself
    cut: bool          # there is mass at an edge of the grid that the prior
                       # does not have


def _look(g, mass, box):
    """Where the posterior is, from its masses on a grid over `box`.

    A coarse grid sees nothing but its best node. The posterior is therefore raised to
    the largest power beta <= 1 that still spreads over about one node per standard
    deviation; what that broader law excludes is excluded. Where a box cut mass off, it
    grows by half.
    """
    z, d = g.coordinate, g.coordinate.shape[1]
    mass = mass - mass.max()

    def spread(beta):    # effective number of nodes; (2 sqrt(pi))**d at one node per sd
        w = np.exp(beta * mass)
        return w.sum()**2 / (w @ w)

    enough, low, beta = 3.5**d, 0.0, 1.0
    if spread(1.0) < enough:
        for _ in range(50):
            middle = 0.5 * (low + beta)
            low, beta = (middle, beta) if spread(middle) > enough else (low, middle)
    w = np.exp(beta * mass)
    cov = np.atleast_2d(np.cov(z.T, aweights=w, ddof=0))
    slope = np.zeros((d, d))
    for axis in range(1, d):
        slope[axis, :axis] = np.linalg.pinv(cov[:axis, :axis]) @ cov[:axis, axis]
    kept = beta * mass > -TAIL * beta - 6.0
    above = (z - z @ slope.T)[kept]

    prior = prior_box(g.hypothesis, g.dt)
    # less than kept, or boxes would swing
    heavy = beta * mass > -0.7 * TAIL * beta - 3.0
    at = (z - z @ box.slope.T)[heavy]
    cut_low = ((at < box.low + 0.5 * g.spacing) & (z[heavy] > prior.low + 1e-9)).any(0)
    cut_high = ((at > box.high - 0.5 * g.spacing)
                & (z[heavy] < prior.high - 1e-9)).any(0)
    growth = 0.5 * (box.high - box.low)
    return _View(Box(above.min(0) - np.where(cut_low, growth, g.spacing),
                     above.max(0) + np.where(cut_high, growth, g.spacing), slope),
                 beta < 1.0, bool((cut_low | cut_high).any()))


def resolve(h, dt, y, max_nodes=60000):
    """Grid that resolves the posterior of one hypothesis, found by zooming in on it.

    Parameters
    ----------
    h : Hypothesis
    dt : float
        Sampling interval, s.
    y : (N,) array
        Record, u; NaN marks a missing sample.
    max_nodes : int
        Largest grid tried.

    Returns
    -------
    Estimate
        It is not `settled` only if max_nodes or MAX_ZOOMS grids did not suffice.
    """
    offset = np.nanmean(y)      # leaves the sums of a large bias their digits
    bias = -offset, h.bias_sigma**2
    record = (y - offset)[None]
    d = len(prior_box(h, dt).low)
    nodes = [1, 32, 20, 14, 10, 8, 6][min(d, 6)]
    box, updates = prior_box(h, dt), 0
    past_evidence, past_mean, settled = np.inf, np.inf, d == 0
    for _ in range(MAX_ZOOMS):
        g = grid(h, dt, nodes, box)
        updates += g.log_prior.size * len(y)
        sums = next(filter_bank(bank(h, dt, g.theta), record, [len(y)]))
        mass, first, second = _node_mass(
            sums.count, sums.chi2[0].copy(), sums.score[0].copy(),
            _node_columns(g, sums), g.limits, g.power, bias)
        log_evidence, mean, cov = _moments(mass, first, second, *_features(g))
        nodes_per_sd = np.minimum(_nodes_per_sd(g, cov), _edge_nodes(g, mean, cov))
        if settled:
            break
        view = _look(g, mass, box)
        shrunk = np.prod((view.box.high - view.box.low) / (box.high - box.low))
        if (nodes_per_sd >= NODES_PER_SD).all() and not view.tempered and not view.cut:
            # the average may hide a corner: believed when a finer grid says the same
            sd = np.sqrt(np.diagonal(cov))
            settled = (abs(log_evidence - past_evidence) < SETTLED
                       and bool((abs(mean - past_mean) <= SETTLED * sd).all()))
            if settled:
                break
            past_evidence, past_mean, shrunk = log_evidence, mean, 1.0
        if shrunk > 0.8 and not view.cut:
            nodes = int(np.ceil(1.4 * nodes))
            if nodes**d > max_nodes:
                break
        box = view.box
    p = len(h.parameters)
    theta, weight = _point_masses(g, mass, first, second)
    return Estimate(h, log_evidence, mean[:p], cov[:p, :p], theta, weight, nodes_per_sd,
                    settled, updates)


def _point_masses(g, mass, first, second):
    """Point masses of Eq. (3): three per node where the scale was integrated
    (Gauss-Hermite).
    """
    weight = np.exp(mass - mass.max())
    keep = weight > 1e-12 * weight.sum()
    weight, first = weight[keep], first[keep]
    sd = np.sqrt(np.maximum(second[keep] - first**2, 0.0))
    points = [(1.0, 0.0)] if not g.exponent.any() else [
        (2 / 3, 0.0), (1 / 6, 3**0.5), (1 / 6, -3**0.5)]
    theta = [g.theta[keep] * np.where(g.exponent, (first + at * sd)[:, None], 1.0)
             for _, at in points]
    weight = np.concatenate([share * weight for share, _ in points])
    return np.concatenate(theta), weight / weight.sum()


def identify(y, dt, hypotheses, progress=None):
    """Posterior of the error model of one record, Eqs. (3)-(14).

    Parameters
    ----------
    y : (N,) array
        Sensor error, u, evenly sampled; NaN marks a missing sample.
    dt : float
        Sampling interval, s.
    hypotheses : sequence of Hypothesis
        The K structures in question.
    progress : function of (done, all), optional
        Called after every hypothesis.

    Returns
    -------
    Posterior

    Raises
    ------
    ValueError
        If the record is too short, constant or not finite.

    Examples
    --------
    >>> h = [hypothesis("random_walk", sigma_w=(0.04, 0.15), sigma_v=0.5),
    ...      hypothesis("markov", tau_m=(60, 1500), sigma_m=(0.5, 1.5), sigma_v=0.5)]
    >>> answer = identify(simulate(h[:1], 1.0, 4000, seed=3).error[0], 1.0, h)
    >>> answer.estimates[decide(answer)].hypothesis.name
    'random_walk'
    """
    y = np.asarray(y, float)
    _check_record(y, dt)
    estimates = []
    for h in hypotheses:
        estimates.append(resolve(h, dt, y))
        if progress:
            progress(len(estimates), len(hypotheses))
    return Posterior(dt, len(y), probabilities([e.log_evidence for e in estimates]),
                     tuple(estimates))


MIN_SAMPLES = 16    # fewer say nothing of any correlated process


def _check_record(y, dt):
    """Refuse what no model can be identified from."""
    if not (np.ndim(dt) == 0 and np.isfinite(dt) and dt > 0):
        raise ValueError(f"the sampling interval is {dt} s: it must be a number > 0")
    if y.ndim != 1:
        raise ValueError(f"the record has shape {y.shape}: "
                         "one axis of one sensor is needed")
    if np.isinf(y).any():
        raise ValueError(f"the record holds {np.isinf(y).sum()} infinite values, "
                         f"the first at sample {np.argmax(np.isinf(y))}: "
                         "remove them or mark them missing")
    observed = y[~np.isnan(y)]
    if len(observed) < MIN_SAMPLES:
        raise ValueError(f"the record has {len(observed)} samples: "
                         f"at least {MIN_SAMPLES} are needed")
    if (observed == observed[0]).all():
        raise ValueError(f"the record is constant ({observed[0] + 0.0:g}): "
                         "there is no error model to identify, check the column")


def probabilities(log_evidence):
    """Eq. (10) with equal prior probabilities, over the last axis."""
    log_evidence = np.asarray(log_evidence)
    ratio = np.exp(log_evidence - log_evidence.max(-1, keepdims=True))
    return ratio / ratio.sum(-1, keepdims=True)


def decide(posterior, gamma=GAMMA):
    """Number of the most probable hypothesis h_k*,
    or None below the threshold gamma.
    """
    best = int(np.argmax(posterior.probability))
    return best if posterior.probability[best] >= gamma else None


def estimate_state(y, estimate, dt):
    """Expectation and covariance of the state at the last sample, Eqs. (13), (14).

    Parameters
    ----------
    y : (N,) array
        The record that `estimate` comes from.
    estimate : Estimate
    dt : float
        Sampling interval, s.

    Returns
    -------
    mean, covariance : (n + 1,), (n + 1, n + 1) array
        The states of the shaping filter, then the bias.
    """
    h = estimate.hypothesis
    b = bank(h, dt, estimate.theta)
    observed = 1.0 - np.isnan(y)
    offset = np.nanmean(y)
    columns = np.vstack([np.nan_to_num(y - offset), np.ones(len(y))])
    M, n = b.m0.shape
    x, P, sums = np.zeros((M, 2, n)), b.P0.copy(), np.zeros((M, 2, 2))
    x[:, 0] = b.m0
    _advance_general(columns, observed,
                     np.flatnonzero(observed == 0).max(initial=-1), 0,
                     b.Phi, b.Q, b.H, b.r, x, P, sums)
    score, information = sums[:, 0, 1], sums[:, 1, 0]
    variance = h.bias_sigma**2 / (1.0 + h.bias_sigma**2 * information)
    bias = -offset + variance * (score + offset * information)  # of the centred record
    response = np.column_stack([-x[:, 1], np.ones(M)])  # of the state to the bias
    state = np.column_stack([x[:, 0], np.zeros(M)]) + bias[:, None] * response
    P = np.pad(P, ((0, 0), (0, 1), (0, 1)))
    P += variance[:, None, None] * response[:, :, None] * response[:, None, :]
    mean = estimate.weight @ state
    away = state - mean
    covariance = np.einsum("j,jab->ab", estimate.weight,
                           P + away[:, :, None] * away[:, None, :])
    mean[-1] += offset
    return mean, covariance


# ---- 5. Criteria ---------------------------------------- paper Sec. 3, Eqs. (15)-(20)

CHUNK = 128            # trials simulated and filtered together; results do not
                       # depend on it
LONG = 100_000         # samples above which a chunk is one block of LANES


class Curve(NamedTuple):
    """A criterion against time: real and calculated,
    with Monte-Carlo standard errors.
    """

    real: np.ndarray             # (T,) from the truth, Eqs. (15), (17)
    calculated: np.ndarray       # (T,) from the posterior alone, Eqs. (18), (19)
    real_se: np.ndarray          # (T,)
    calculated_se: np.ndarray    # (T,)
    z: np.ndarray                # (T,) their difference over its standard error, paired


class Criteria(NamedTuple):
    """Performance criteria of Sec. 3."""

    time: np.ndarray             # (T,) s
    trials: int
    error_probability: Curve     # Eqs. (15), (18)
    labels: tuple                # "hypothesis.parameter" of every unknown parameter
    rsd: tuple                   # a Curve for each label, Eq. (20)
    nodes: tuple                 # nodes of the grid of each hypothesis
    nodes_per_sd: tuple          # (d,) for each: what nine of ten trials exceed
                                 # at the end
    rivals: dict                 # name of another algorithm -> Rival


class Rival(NamedTuple):
    """Another algorithm on the same trials, with Monte-Carlo standard errors (se)."""

    error_probability: np.ndarray    # (T,) Eq. (15)
    error_se: np.ndarray
    excess: np.ndarray               # (T,) over that of the Bayesian algorithm, paired
    excess_se: np.ndarray
    rsd: tuple                       # (T,) for each label, Eqs. (17), (20)
    rsd_se: tuple
    efficiency: tuple                # (T,) for each label: the Bayesian variance over
    efficiency_se: tuple             # that of the rival, paired


def criteria_times(samples):
    """Numbers of samples at which criteria are shown: dense early, then even."""
    early, late = np.geomspace(1, samples, 19), np.linspace(samples / 16, samples, 16)
    return np.unique(np.round(np.append(early, late)).astype(int).clip(1))


def criteria_grid(h, dt, samples, seed=0, pilots=16, max_nodes=60000):
    """Grid over the whole prior that resolves the posterior after `samples` samples.

    Pilot trials of the hypothesis set the density: nine of ten shall have NODES_PER_SD.
    Returns the grid and the nodes per standard deviation reached, (d,).
    """
    box = prior_box(h, dt)
    nodes = np.full(len(box.low), 12)
    y = simulate([h], dt, samples, pilots, seed).error
    while True:
        g = grid(h, dt, nodes, box)
        _, _, cov = next(posteriors(g, y, [samples], coordinates=True))
        reached = np.array([_nodes_per_sd(g, c) for c in cov])
        reached = np.quantile(reached, 0.1, axis=0) if len(nodes) else reached[0]
        growth = np.clip(1.05 * NODES_PER_SD / np.maximum(reached, 0.1), 1.0, 2.5)
        more = np.ceil(nodes * growth).astype(int)
        if (reached >= NODES_PER_SD).all() or np.prod(more) > max_nodes:
            return g, reached
        nodes = np.where(reached < NODES_PER_SD, more, nodes)


class _Chunk(NamedTuple):
    """Trials first..last - 1 through every bank: what the criteria are made of."""

    log_evidence: np.ndarray    # (L, T, K)
    mean: np.ndarray            # (L, T, P) of all parameters of all hypotheses
    variance: np.ndarray        # (L, T, P)
    hypothesis: np.ndarray      # (L,)
    truth: np.ndarray           # (L, P), NaN for the parameters of other hypotheses
    choice: np.ndarray          # (L, T, A) of the other algorithms
    guess: np.ndarray           # (L, T, A, P)


def _run_chunk(truths, grids, algorithms, dt, stops, seed, first, last):
    """Simulate from `truths` and filter through `grids`;
    a pure function of its arguments.
    """
    trials = simulate(truths, dt, int(stops[-1]), last - first, seed, first)
    log_evidence, mean, variance, truth = [], [], [], []
    for k, g in enumerate(grids):
        p = g.theta.shape[1]
        evidence, means, covariances = (
            np.stack(part, 1) for part in zip(*posteriors(g, trials.error, stops)))
        log_evidence.append(evidence)
        mean.append(means)
        variance.append(np.diagonal(covariances, axis1=2, axis2=3))
        truth.append(np.where((trials.hypothesis == k)[:, None],
                              trials.theta[:, :p], np.nan))
    hypotheses, truth = tuple(g.hypothesis for g in grids), np.concatenate(truth, 1)
    shape = len(truth), len(stops), len(algorithms)
    choice, guess = np.zeros(shape, int), np.zeros((*shape, truth.shape[1]))
    for at in np.ndindex(shape):
        trial, t, a = at
        choice[at], estimates = algorithms[a](trials.error[trial, :stops[t]], dt,
                                              hypotheses)
        guess[at] = np.concatenate(estimates)
    return _Chunk(np.stack(log_evidence, 2), np.concatenate(mean, 2),
                  np.concatenate(variance, 2), trials.hypothesis, truth, choice, guess)


def _kept_chunk(folder, *arguments):
    """`_run_chunk`, or its result from an earlier run that was interrupted."""
    if folder is None:
        return _run_chunk(*arguments)
    digest = hashlib.sha256(__version__.encode())
    truths, grids, algorithms, *numbers = arguments
    for part in (*truths, *(part for g in grids for part in g), *algorithms, *numbers):
        digest.update(part.tobytes() if isinstance(part, np.ndarray)
                      else _describe(part))
    file = pathlib.Path(folder) / f"{digest.hexdigest()[:32]}.npz"
    if file.exists():
        try:
            with np.load(file) as kept:
                return _Chunk(**kept)
        except Exception:    # damaged, in whatever way: worth no more than nothing
            pass
    chunk = _run_chunk(*arguments)
    _write(file, lambda stream: np.savez(stream, **chunk._asdict()))
    return chunk


def _describe(part):
    """Bytes that tell one argument of a chunk from another."""
    if isinstance(part, Hypothesis):
        return _describe(part.model) + repr((part.name, *part[2:])).encode()
    code = getattr(part, "__code__", None)
    return repr((part.__qualname__, code.co_code, code.co_consts) if code
                else part).encode()


def _write(file, put):
    """Write a file whole or not at all."""
    file = pathlib.Path(os.path.realpath(file))
    if file.exists() and not file.is_file():    # a pipe or a device
        with open(file, "wb") as stream:
            return put(stream)
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        with open(part, "wb") as stream:
            put(stream)
        os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)


def criteria(hypotheses, dt, duration, trials=500, seed=0, *, times=None, truths=None,
             grids=None, algorithms=None, executor=None, checkpoint=None,
             progress=None):
    """Performance criteria by statistical trials, Eqs. (15)-(20).

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
        The K structures; trials are drawn from their priors with equal probability.
    dt, duration : float
        Sampling interval and record length, s.
    trials, seed : int
        Number L of trials and the seed of their streams.
    times : (T,) array, optional
        Times, s, at which the criteria are wanted, each a number of samples times dt.
    truths : sequence of Hypothesis, optional
        What the trials are drawn from, where the algorithm shall be wrong about it.
    grids : sequence of Grid, optional
        One per hypothesis; by default grids that resolve the posterior.
    algorithms : dict of functions, optional
        Other algorithms to put through the same trials, see ALGORITHMS. Each is called
        with a record (N,), dt and the hypotheses, and returns the number of the one
        that it chooses and its estimates, an array (p,) for each hypothesis.
    executor : concurrent.futures.Executor, optional
        Runs chunks of trials elsewhere: a pool of processes (spawned, as forked threads
        of Numba do not survive), `dask.distributed.Client.get_executor()`,
        `mpi4py.futures.MPIPoolExecutor`. The result is the same to the last bit; what a
        broken pool did not finish is run here.
    checkpoint : path, optional
        Folder in which finished chunks are kept; the same call takes them up again.
    progress : function of (done, all), optional
        Called after every chunk.

    Returns
    -------
    Criteria

    Raises
    ------
    ValueError
        If dt, duration, trials or times make no sense.

    Examples
    --------
    Two kinds of noise that can be told apart at once:

    >>> h = [hypothesis("white_noise", sigma_v=1.0, bias_sigma=0.0),
    ...      hypothesis("random_walk", sigma_w=100.0, bias_sigma=0.0)]
    >>> float(criteria(h, 1.0, 50.0, trials=32).error_probability.real[-1])
    0.0
    """
    algorithms = algorithms or {}
    samples = _check_trials(hypotheses, dt, duration, trials)
    if times is not None:
        stops = np.unique(np.round(np.asarray(times) / dt).astype(int))
    elif algorithms:
        stops = np.unique(np.round(np.geomspace(min(max(samples / 32, SHORT), samples),
                                                samples, 6)).astype(int))
    else:
        stops = criteria_times(samples)
    if algorithms and stops[0] < SHORT:
        raise ValueError(f"the first time has {stops[0]} samples: "
                         f"algorithms are compared from {SHORT} samples on")
    if not 1 <= stops[0] <= stops[-1] <= samples:
        raise ValueError(f"times {stops[0] * dt:g} to {stops[-1] * dt:g} s "
                         f"do not lie within {dt:g} to {duration:g} s")
    if algorithms:    # refuse what they cannot do before the work
        short = simulate(truths or hypotheses, dt, int(stops[0]), 1, seed).error[0]
        for algorithm in algorithms.values():
            algorithm(short, dt, tuple(hypotheses))
    reached = tuple(np.full(g.coordinate.shape[1], np.nan) for g in grids or ())
    if grids is None:
        grids, reached = zip(*(criteria_grid(h, dt, samples, seed) for h in hypotheses))
    chunk = _run_trials(truths or hypotheses, grids, algorithms, dt, stops, trials,
                        seed, executor, checkpoint, progress)
    return _criteria(hypotheses, grids, reached, dt * stops, algorithms, chunk)


def _check_trials(hypotheses, dt, duration, trials):
    """Number of samples of a trial, if all numbers make sense."""
    if not (np.isfinite(dt) and dt > 0 and np.isfinite(duration) and duration >= dt):
        raise ValueError(f"dt = {dt:g} s, duration = {duration:g} s: "
                         "0 < dt <= duration is needed")
    if trials < 8 * len(hypotheses):
        raise ValueError(f"{trials} trials of {len(hypotheses)} hypotheses: "
                         f"a criterion needs at least {8 * len(hypotheses)}")
    if not duration / dt < 2**31:
        raise ValueError(f"{duration:g} s at {dt:g} s are {duration / dt:.3g} samples: "
                         "record less, or sample more slowly")
    return int(round(duration / dt))


def _run_trials(truths, grids, algorithms, dt, stops, trials, seed, executor=None,
                checkpoint=None, progress=None):
    """All trials as one `_Chunk`."""
    size = CHUNK if stops[-1] <= LONG and not algorithms else LANES
    firsts = range(0, trials, size)
    calls = [(checkpoint, tuple(truths), tuple(grids), tuple(algorithms.values()), dt,
              stops, seed, first, min(first + size, trials)) for first in firsts]
    waiting = [executor and executor.submit(_kept_chunk, *call) for call in calls]
    chunks = []
    for call, future in zip(calls, waiting):
        try:
            chunks.append(future.result() if future else _kept_chunk(*call))
        except BrokenExecutor:    # a worker died and took its pool along: go on here
            chunks.append(_kept_chunk(*call))
        if progress:
            progress(min(len(chunks) * size, trials), trials)
    return _Chunk(*(np.concatenate(part) for part in zip(*chunks)))


SHORT = 32    # samples; slopes of an Allan deviation need as many


def _criteria(hypotheses, grids, reached, time, algorithms, chunk):
    """Eqs. (15)-(20) from the trials."""
    probability = probabilities(chunk.log_evidence)
    wrong = (probability.argmax(-1) != chunk.hypothesis[:, None]).astype(float)
    error = _curve(wrong, 1.0 - probability.max(-1))
    labels, rsd, squares = [], [], []
    listed = [(h, p) for h in hypotheses for p in h.parameters]
    for column, (h, p) in enumerate(listed):
        if p.free:
            own = ~np.isnan(chunk.truth[:, column])
            truth = chunk.truth[own, column, None]
            square = (truth - chunk.mean[own, :, column])**2
            labels.append(f"{h.name}.{p.symbol}")
            rsd.append(_relative(_curve(square, chunk.variance[own, :, column]),
                                 own.sum(), abs(p.mean)))
            squares.append((abs(p.mean) or np.nan, square, (truth[..., None]
                            - chunk.guess[own, :, :, column])**2))
    missed = chunk.choice != chunk.hypothesis[:, None, None]
    rivals = {name: _rival(wrong, missed[:, :, number],
                           [(mean, ours, theirs[:, :, number])
                            for mean, ours, theirs in squares])
              for number, name in enumerate(algorithms)}
    return Criteria(time, len(wrong), error, tuple(labels), tuple(rsd),
                    tuple(len(g.theta) for g in grids), reached, rivals)


def _standard_error(x):
    """Of a mean over the trials (L, ...)."""
    return x.std(0, ddof=1) / np.sqrt(len(x))


def _rival(wrong, rival_wrong, squares):
    """`Rival` from its errors (L, T) and squared errors beside those of the bank."""
    excess = rival_wrong - wrong
    rsd, rsd_se, efficiency, efficiency_se = [], [], [], []
    for mean, ours, theirs in squares:
        n, variance = len(ours), theirs.mean(0)
        ratio = ours.mean(0) / variance
        rsd.append(np.sqrt(variance * n / (n - 1)) / mean)
        rsd_se.append(_standard_error(theirs) / (2.0 * np.sqrt(variance) * mean))
        efficiency.append(ratio)
        efficiency_se.append(_standard_error(ours - ratio * theirs) / variance)
    return Rival(rival_wrong.mean(0), _standard_error(rival_wrong), excess.mean(0),
                 _standard_error(excess), tuple(rsd), tuple(rsd_se), tuple(efficiency),
                 tuple(efficiency_se))


def _curve(real, calculated):
    """Means over the trials (L, T) of a criterion, with standard errors."""
    difference = real - calculated
    se = _standard_error(difference)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(se > 0.0, difference.mean(0) / se, 0.0)
    return Curve(real.mean(0), calculated.mean(0), _standard_error(real),
                 _standard_error(calculated), z)


def _relative(variance, trials, mean):
    """Eq. (20) from a curve of variances; Eq. (17) divides by L - 1."""
    real = np.sqrt(variance.real * trials / (trials - 1))
    calculated = np.sqrt(variance.calculated)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = mean or np.nan    # about zero nothing is relative
        return Curve(real / mean, calculated / mean,
                     variance.real_se / (2.0 * real * mean),
                     variance.calculated_se / (2.0 * calculated * mean), variance.z)


# ---- how long must be recorded

class Needed(NamedTuple):
    """The shortest record that meets a target."""

    label: str         # "error_probability" or a label of an RSD
    target: float
    duration: float    # s; NaN where the limit does not suffice
    interval: tuple    # (2,) s, 95 %, infinite where it leaves the limit
    reached: float     # at the end of the longest records that were tried
    reason: str        # what limits, where the limit does not suffice, and doubts


def record_length(hypotheses, dt, limit, error=None, rsd=None, trials=4000, seed=0, *,
                  executor=None, checkpoint=None, progress=None):
    """How long must be recorded to reach an error probability or an RSD.

    Parameters
    ----------
    hypotheses, dt, seed, executor, checkpoint, progress
        As for `criteria`.
    limit : float
        Longest record in question, s.
    error : float in 0..1, optional
        Target of the error probability, Eq. (15).
    rsd : dict, optional
        Targets of relative standard deviations, Eq. (20): by label, such as
        markov.tau_m, or by parameter for all hypotheses that have it.
    trials : int
        The intervals narrow with their root.

    Returns
    -------
    list of Needed

    Raises
    ------
    ValueError
        If a target is out of range or of no free parameter.

    Notes
    -----
    The calculated criteria, Eqs. (18) and (19), have the expectation of the real ones
    where the filter bank has the right model, and a smaller variance. Their means over
    the trials, made monotone, are interpolated; intervals come from 200 resamples of
    the trials. Short records are tried first.
    """
    targets = _targets(hypotheses, error, rsd or {})
    samples = _check_trials(hypotheses, dt, limit, trials)
    for stage in (64, 8, 1):
        if samples // stage < 256 and stage > 1:
            continue
        stops = np.unique(np.round(np.geomspace(1, samples // stage, 49)).astype(int))
        grids, resolved = zip(*(criteria_grid(h, dt, stops[-1], seed)
                                for h in hypotheses))
        chunk = _run_trials(hypotheses, grids, {}, dt, stops, trials, seed, executor,
                            checkpoint, progress)
        result = [_needed(hypotheses, dt * stops, chunk, *one, seed) for one in targets]
        if all(np.isfinite(n.interval[1]) for n in result):
            break
    if any((nodes < NODES_PER_SD).any() for nodes in resolved):
        result = [n._replace(reason="; ".join(filter(None, (
            n.reason, "the grid is too coarse for such a posterior: take the number as "
            "a hint")))) for n in result]
    return result


def _targets(hypotheses, error, rsd):
    """(label, target, column) of every target; column None is the error."""
    if error is None and not rsd:
        raise ValueError("no target is given: a target of the error probability "
                         "or of an RSD is needed")
    if error is not None and (len(hypotheses) < 2 or not 0.0 < error < 1.0):
        raise ValueError(f"error probability {error:g} of {len(hypotheses)} hypotheses:"
                         " 0 < target < 1 and two of them are needed")
    result = [] if error is None else [("error_probability", float(error), None)]
    listed = [(f"{h.name}.{p.symbol}", p) for h in hypotheses for p in h.parameters]
    for name, target in rsd.items():
        own = [(label, float(target), column) for column, (label, p) in
               enumerate(listed) if p.free and p.mean and name in (label, p.symbol)]
        if not own or not target > 0.0:
            raise ValueError(f"RSD {target:g} of {name}: a target > 0 is needed, of "
                             + (", ".join(label for label, p in listed
                                          if p.free and p.mean)
                                or "a parameter given as a range"))
        result += own
    return result


def _needed(hypotheses, time, chunk, label, target, column, seed):
    """`Needed` from trials, all of which show how a criterion falls with time."""
    if column is None:
        value, level = 1.0 - probabilities(chunk.log_evidence).max(-1), target
    else:
        mean = [p.mean for h in hypotheses for p in h.parameters][column]
        own = ~np.isnan(chunk.truth[:, column])
        value, level = chunk.variance[own, :, column], (target * mean)**2

    def crossing(curve):
        curve = np.maximum(isotonic_regression(curve, increasing=False).x, 1e-300)
        if curve[-1] > level:
            return np.inf
        return np.exp(np.interp(-np.log(level), -np.log(curve), np.log(time)))
    draws = np.random.default_rng(seed).multinomial(
        len(value), np.full(len(value), 1.0 / len(value)), 200) / len(value)
    low, high = np.quantile([crossing(draw @ value) for draw in draws], [0.025, 0.975],
                            method="inverted_cdf")
    duration, last = crossing(value.mean(0)), value[:, -1].mean()
    last = last if column is None else np.sqrt(last) / abs(mean)
    reached = np.isfinite(duration)
    return Needed(label, target, float(duration) if reached else np.nan,
                  (float(low), float(high)), float(last), "" if reached else
                  (_confusion(hypotheses, chunk) if column is None
                   else _pace(time, value.mean(0), level)))


def _pace(time, curve, level):
    """How fast a variance falls over the last factor of four."""
    late = time >= time[-1] / 4.0
    if late.sum() < 3:
        return "so short a record tells nothing"
    power = -np.polyfit(np.log(time[late]), np.log(curve[late]), 1)[0]
    if power < 0.02:
        return "longer records hardly help"
    longer = time[-1] * (curve[-1] / level)**(1.0 / power)
    return (f"it falls with the power {-0.5 * power:.2f} of time: "
            f"at that pace {longer:.2g} s")


def _confusion(hypotheses, chunk):
    """Which structures are confused at the end, and where in their ranges."""
    best, names = chunk.log_evidence[:, -1].argmax(-1), [h.name for h in hypotheses]
    wrong = best != chunk.hypothesis
    if not wrong.any():
        return "no trial was wrong: more trials are needed"
    count = np.zeros((len(names), len(names)))
    np.add.at(count, (chunk.hypothesis[wrong], best[wrong]), 1)
    true, chosen = np.unravel_index(count.argmax(), count.shape)
    text = (f"{count.max():.0f} of {wrong.sum()} errors are {names[true]} taken for "
            f"{names[chosen]}")
    own = chunk.hypothesis == true
    away, column = {}, sum(len(h.parameters) for h in hypotheses[:true])
    for p in hypotheses[true].parameters:
        there = chunk.truth[own & (best == chosen), column]
        all_of = chunk.truth[own, column]
        if p.free:
            away[p.symbol] = (abs(there.mean() - all_of.mean()) / p.sd, there.mean(),
                              all_of.mean())
        column += 1
    if away and max(away.values())[0] * np.sqrt(count.max()) > 2.0:
        symbol = max(away, key=away.get)
        text += (f", with {symbol} {away[symbol][1]:.3g} on average, "
                 f"{away[symbol][2]:.3g} over all trials")
    return text


def at_condition(hypotheses, dt, new_dt=None, sigma_v=None):
    """The same sensor sampled at another interval, or with another white noise.

    A random walk and the density of the white noise stay what they are: sigma_w goes
    with the root of the interval, sigma_v with its inverse, as if a sample were the
    mean over its interval. `sigma_v`, u, is the new level at the old dt.
    """
    new_dt = dt if new_dt is None else new_dt
    deaf = [h.name for h in hypotheses
            if "sigma_v" not in inspect.signature(h.model).parameters]
    if sigma_v is not None and deaf:
        raise ValueError(f"{', '.join(deaf)} takes no sigma_v that could be varied")
    factor = dict(sigma_w=np.sqrt(new_dt / dt), sigma_v=np.sqrt(dt / new_dt))
    result = []
    for h in hypotheses:
        own = list(h.parameters)
        if sigma_v is not None:
            own = [p for p in own if p.symbol != "sigma_v"]
            own.append(Parameter("sigma_v", sigma_v, sigma_v))
        result.append(h._replace(parameters=tuple(
            p._replace(low=p.low * factor.get(p.symbol, 1.0),
                       high=p.high * factor.get(p.symbol, 1.0)) for p in own)))
    return tuple(result), new_dt


# ---- 6. Allan variance, other algorithms ---- what the filter bank is compared with

def allan_variance(omega, dt, m):
    """Overlapping Allan variance of a rate record at averaging time tau = m * dt.

    Parameters
    ----------
    omega : (..., N) array
        Rate or specific force, u, evenly sampled; NaN marks a missing sample.
    dt : float
        Sampling interval, s.
    m : int
        Samples per cluster, 1 <= m <= N / 2.

    Returns
    -------
    float, or array (...)
        sigma^2(tau), u^2, from the pairs of clusters that miss nothing; NaN if there
        are none.

    Raises
    ------
    ValueError
        If the record does not hold two clusters of m samples.

    Notes
    -----
    NIST SP 1065, Eq. (11), with the integrated rate as the phase.

    Examples
    --------
    A ramp of slope R has sigma^2 = (R * tau)^2 / 2:

    >>> allan_variance(np.arange(10.0), dt=1.0, m=2)
    2.0
    """
    omega = np.asarray(omega, float)
    samples = omega.shape[-1]
    if not 1 <= m <= samples // 2:
        raise ValueError(
            f"m = {m} does not fit a record of {samples} samples: the Allan "
            f"variance needs two clusters, so 1 <= m <= {samples // 2}")
    gap = np.isnan(omega)

    def summed(x):    # up to every sample, from none on
        return np.concatenate([np.zeros_like(x[..., :1]), x], -1).cumsum(-1)
    mean = np.nanmean(omega, -1, keepdims=True)
    phase = summed(np.where(gap, 0.0, omega - mean)) * dt
    second = phase[..., 2 * m:] - 2.0 * phase[..., m:-m] + phase[..., :-2 * m]
    pairs = second.shape[-1]
    if gap.any():
        missed = summed(gap.astype(int))
        whole = missed[..., 2 * m:] == missed[..., :-2 * m]
        second, pairs = np.where(whole, second, 0.0), whole.sum(-1)
    with np.errstate(invalid="ignore"):
        variance = (second**2).sum(-1) / pairs / (2.0 * (m * dt)**2)
    return variance if variance.ndim else float(variance)


def allan_deviation(omega, dt, per_octave=1):
    """Averaging times, s, up to a third of the record, and Allan deviations, u."""
    n = len(omega)
    octaves = np.arange(0.0, np.log2(max(n // 3, 1)) + 1e-9, 1.0 / per_octave)
    m = np.unique(np.round(2.0**octaves).astype(int))
    adev = np.sqrt([allan_variance(omega, dt, k) for k in m])
    return m[~np.isnan(adev)] * dt, adev[~np.isnan(adev)]


@njit(**JIT)
def _functional_variances(m, Phi, Q, H, m0, P0):
    """Mean squares of (second mean of m - first mean of m) / sqrt(2) of H x, from the
    derivatives to every w_i.
    """
    out = np.empty(len(m))
    for j in range(len(m)):
        out[j] = _functional_variance(m[j], Phi, Q, H, m0, P0)
    return out


@njit(**JIT)
def _functional_variance(m, Phi, Q, H, m0, P0):
    n = len(H)
    g, new, total = np.zeros(n), np.zeros(n), 0.0
    for i in range(2 * m - 1, -1, -1):
        weight = (1.0 if i >= m else -1.0) / (np.sqrt(2.0) * m)
        for row in range(n):
            g[row] += weight * H[row]
        for row in range(n):
            new[row] = 0.0
            for column in range(n):
                total += g[row] * Q[row, column] * g[column]
                new[row] += Phi[column, row] * g[column]
        g[:] = new
    mean = 0.0
    for row in range(n):
        mean += g[row] * m0[row]
        for column in range(n):
            total += g[row] * P0[row, column] * g[column]
    return total + mean * mean


def model_allan_variance(filt, m):
    """Expected Allan variance of a shaping filter at averaging times of m samples, u^2;
    m is a number or an array of numbers.

    For a process that is not stationary, the expectation is that of its first 2 m
    samples. `filt` must not depend on time.

    Examples
    --------
    White noise falls with the averaging time, Eq. (23):

    >>> round(float(model_allan_variance(white_noise(1.0, 2.0), 4)), 12)
    1.0
    """
    Gamma = filt.Gamma[0]
    process = _functional_variances(np.atleast_1d(m), filt.Phi[0], Gamma @ Gamma.T,
                                    filt.H[0], filt.m0, filt.P0)
    return np.reshape(process, np.shape(m)) + filt.Psi[0]**2 / m


# ---- the other algorithms: what the criteria compare the filter bank with
#
# An algorithm is a function of a record (N,), dt and a tuple of hypotheses. It gives
# the number of the hypothesis that it chooses, and one array (p,) of estimates for each
# hypothesis. All of them know the ranges of the prior.

def allan_line(tau, adev, slope):
    """Value at 1 s of the line of a given slope through part of an Allan deviation.

    By IEEE Std 952 it is sqrt(3) Q for slope -1 (quantization), N for -1/2 (angle
    random walk) and K / sqrt(3) for +1/2 (rate random walk).
    """
    return float(np.exp(np.mean(np.log(adev) - slope * np.log(tau))))


def allan_slopes(y, dt, hypotheses):
    """Model and parameters from the slopes of the Allan deviation.

    IEEE Std 952, Annex C: white noise has slope -1/2 and is read there, a random walk
    +1/2; a Markov process has a top of 0.437 q sqrt(T) at 1.89 T. The end of the
    curve, its last factor of four in averaging time, chooses the model.
    """
    tau, adev = allan_deviation(y, dt)
    x, curve = np.log(tau), np.log(adev)
    slope = np.diff(curve) / np.diff(x)
    end = np.polyfit(x[-3:], curve[-3:], 1)[0]
    nominal = {white_noise: -0.5, markov: 0.0, random_walk: 0.5}
    if any(h.model not in nominal for h in hypotheses):
        raise ValueError("slopes are known of white_noise, markov and random_walk "
                         "alone, not of " + ", ".join(h.name for h in hypotheses))

    def line(power, segments, otherwise):
        ends = np.flatnonzero(segments)
        ends = np.unique([ends, ends + 1]) if len(ends) else [otherwise]
        return allan_line(tau[ends], adev[ends], power)
    low = curve.argmin()
    top = low + curve[low:].argmax()
    falls = np.logical_and.accumulate(slope < -0.25)    # from the shortest time on
    rises = (slope > 0.25) & (np.arange(len(slope)) >= low)
    read = dict(sigma_v=line(-0.5, falls, 0) / np.sqrt(dt),
                sigma_w=line(0.5, rises, -1) * np.sqrt(3.0 * dt),
                tau_m=tau[top] / 1.89, sigma_m=adev[top] / (0.437 * np.sqrt(2.0)))
    return (int(np.argmin([abs(end - nominal[h.model]) for h in hypotheses])),
            [np.array([np.clip(read[p.symbol], p.low, p.high) for p in h.parameters])
             for h in hypotheses])


def allan_least_squares(y, dt, hypotheses):
    """Model and parameters from weighted least squares of the whole Allan variance.

    The generalized method of wavelet moments (S. Guerrier, J. Skaloud, Y. Stebler,
    M.-P. Victoria-Feser, J. Am. Stat. Assoc. 108, 2013): twice the variance of Haar
    wavelets is the Allan variance. The model is chosen by the wavelet variance
    information criterion with a diagonal covariance: the sum of squares plus 2 p.
    """
    tau, adev = allan_deviation(y, dt)
    fits = [fit_allan_variance(h, dt, tau, adev**2, np.sum(~np.isnan(y)))
            for h in hypotheses]
    costs = [cost + 2.0 * len(free_columns(h.parameters))
             for h, (_, cost) in zip(hypotheses, fits)]
    return int(np.argmin(costs)), [theta for theta, _ in fits]


def fit_allan_variance(h, dt, tau, avar, samples):
    """Weighted least squares of an Allan variance.

    Parameters
    ----------
    h : Hypothesis
        Model and ranges of its parameters.
    dt : float
        Sampling interval, s.
    tau : (J,) array
        Averaging times, s, whole multiples of dt.
    avar : (J,) array
        Overlapping Allan variance, u^2.
    samples : int
        Length of the record, which sets the weights: the degrees of freedom of a
        wavelet variance (D. Percival, A. Walden, "Wavelet Methods for Time Series
        Analysis", 2000, Sec. 8.4, the third approximation). They are those of the
        95 % intervals of the curve first, then those of the model so found.

    Returns
    -------
    theta : (p,) array
    cost : float
        Weighted sum of squares at theta.
    """
    m = np.round(np.asarray(tau) / dt).astype(int)
    half = 0.5 * np.maximum((samples - 2.0 * m + 1.0) / (2.0 * m), 1.0)
    low, high = avar * half / gammaincinv(half, [[0.975], [0.025]])
    sd = (high - low) / (ndtri(0.975) - ndtri(0.025))

    def expected(u):
        return model_allan_variance(_filter_at(h, dt, at_quantiles(h.parameters, u)), m)

    def residual(u, sd):
        return (avar - expected(u)) / sd
    u = min(_coarse(h), key=lambda u: np.sum(residual(u, sd)**2))
    for step in range(2):
        if len(u):
            u = least_squares(residual, u, bounds=(0.0, 1.0), args=(sd,)).x
        sd = expected(u) / np.sqrt(half)
    return at_quantiles(h.parameters, u), float(np.sum(residual(u, sd)**2))


def akaike(y, dt, hypotheses):
    """Maximum likelihood within the ranges, model by AIC (H. Akaike, IEEE Trans.
    Automat. Contr. 19, 1974).
    """
    return _penalized(hypotheses, _likelihood_fits(y.tobytes(), dt, hypotheses), 2.0)


def schwarz(y, dt, hypotheses):
    """Maximum likelihood within the ranges, model by BIC (G. Schwarz, Ann. Stat. 6,
    1978).
    """
    return _penalized(hypotheses, _likelihood_fits(y.tobytes(), dt, hypotheses),
                      np.log(np.sum(~np.isnan(y))))


@functools.lru_cache(maxsize=2)    # both criteria look at the same fits
def _likelihood_fits(y, dt, hypotheses):
    y = np.frombuffer(y)

    def log_likelihoods(h, theta):
        return _bank_likelihood(next(filter_bank(bank(h, dt, theta), y[None],
                                                 [len(y)])), h)
    return [_maximize(h, log_likelihoods) for h in hypotheses]


def whittle(y, dt, hypotheses):
    """Model by AIC and parameters by Whittle's likelihood of the first differences.

    P. Whittle, Ark. Mat. 2, 1953. Differences are stationary for a random walk, too,
    and free of the bias. For sums of one-state processes without missing samples.
    """
    n = len(y) - 1
    power = np.abs(np.fft.rfft(np.diff(y)))[1:(n + 1) // 2]**2 / n
    turn = 2.0 - 2.0 * np.cos(2.0 * np.pi * np.arange(1, (n + 1) // 2) / n)

    def log_likelihoods(h, theta):
        b = bank(h, dt, theta)
        if not is_modal(b):
            raise ValueError(f"{h.name} is no sum of one-state processes: "
                             "Whittle's likelihood is of such sums alone")
        a, q = (np.diagonal(part[:, 0], 0, 1, 2) for part in (b.Phi, b.Q))
        return _whittle(power, turn, n, a, q, b.r[:, 0])
    return _penalized(hypotheses, [_maximize(h, log_likelihoods) for h in hypotheses],
                      2.0)


ALGORITHMS = dict(slopes=allan_slopes, gmwm=allan_least_squares, aic=akaike,
                  bic=schwarz, whittle=whittle)


@njit(**JIT)
def _whittle(power, turn, n, a, q, r):
    """Whittle log-likelihood (M,) of a periodogram of n differences.

    Its expectation is the spectrum and, as the differences of the white noise do not
    go around in a circle, 2 r cos(w) / n: little, but all there is at low frequencies.
    """
    total = np.zeros(len(a))
    for node in range(len(a)):
        for j in range(len(power)):
            S = r[node]
            for s in range(a.shape[1]):
                S += q[node, s] / ((1.0 - a[node, s])**2 + a[node, s] * turn[j])
            S = S * turn[j] + r[node] * (2.0 - turn[j]) / n
            total[node] -= np.log(S) + power[j] / S
    return total


def _bank_likelihood(sums, h):
    """ln f(Y / theta) (M,) of one record."""
    return log_likelihood(1.0, sums.count, sums.chi2[0], sums.score[0],
                          sums.information, sums.log_det, (0.0, h.bias_sigma**2))


def _penalized(hypotheses, fits, penalty):
    """The choice by likelihood, less half a penalty per free parameter."""
    return (int(np.argmax([2.0 * top - penalty * len(free_columns(h.parameters))
                           for h, (_, top) in zip(hypotheses, fits)])),
            [theta for theta, _ in fits])


def _maximize(h, log_likelihoods):
    """Parameters (p,) in their ranges where a function of h and nodes (M, p) is
    largest.
    """
    def inside(u):
        """Mirrored at the ends of the ranges: a simplex may not collapse onto one."""
        return at_quantiles(h.parameters, 1.0 - np.abs(1.0 - u % 2.0))
    nodes = _coarse(h)
    ll = log_likelihoods(h, inside(nodes))
    u = nodes[int(np.argmax(ll))]
    if not len(u):
        return inside(u), float(ll[0])
    # 1e-4 of a range is far below any standard deviation
    best = minimize(lambda u: -log_likelihoods(h, inside(u)[None])[0], u,
                    method="Nelder-Mead", options=dict(
                        xatol=1e-4, fatol=1e-3,
                        initial_simplex=u + np.vstack([0.0 * u, 0.1 * np.eye(len(u))])))
    return inside(best.x), -float(best.fun)


def _coarse(h):
    """Nodes (M, d) of a coarse grid over the prior, in its quantiles."""
    return np.array(list(itertools.product((np.arange(4) + 0.5) / 4.0,
                                           repeat=len(free_columns(h.parameters)))))


# ---- what no algorithm can do better

def estimation_bound(h, dt, times, trials=2000, seed=0):
    """Bayesian Cramer-Rao bound: what no estimator's RSD, Eq. (20), can fall below.

    Parameters
    ----------
    h : Hypothesis
    dt : float
        Sampling interval, s.
    times : (T,) array
        Record lengths, s.
    trials, seed : int
        For the expectations.

    Returns
    -------
    bound, se : (T, d) array
        For every parameter that is free, with its Monte-Carlo standard error.

    Raises
    ------
    ValueError
        If a prior is not uniform.

    Notes
    -----
    The bound of Van Trees needs a prior that vanishes at its ends. With weights q_i(u)
    that vanish at both ends of u_i instead and psi_i = q_i d ln f / du_i + dq_i / du_i,
    the variance of u_i is at least E{q_i}^2 [E{psi psi'}^-1]_ii under the uniform prior
    itself (E. Weinstein, A. J. Weiss, IEEE Trans. Inf. Theory 34, 1988). The largest of
    some weights is taken: the bound stays loose where the information varies much over
    the prior.
    """
    if any(p.free and p.log for p in h.parameters):
        raise ValueError(f"{h.name} has a log-uniform prior: "
                         "the bound is of uniform ones")
    stops = np.round(np.asarray(times) / dt).astype(int)
    free = [p for p in h.parameters if p.free]
    if not free:
        return np.empty((2, len(stops), 0))
    d, step = len(free), 1e-4
    u = step + (1.0 - 2.0 * step) * np.random.default_rng(seed).random((trials, d))
    score = np.empty((trials, len(stops), d))
    for trial in range(trials):
        exact = h._replace(parameters=tuple(Parameter(p.symbol, v, v) for p, v in zip(
            h.parameters, at_quantiles(h.parameters, u[trial]))))
        y = simulate([exact], dt, int(stops[-1]), 1, seed, trial).error
        around = u[trial] + step * np.vstack([np.eye(d), -np.eye(d)])
        b = bank(h, dt, at_quantiles(h.parameters, around))
        for t, sums in enumerate(filter_bank(b, y, stops)):
            ll = _bank_likelihood(sums, h)
            score[trial, t] = (ll[:d] - ll[d:]) / (2.0 * step)
    gain = np.array([p.high - p.low for p in free]) / [abs(p.mean) for p in free]
    best = np.zeros((3, len(stops), d))
    # weights u_i (1 - u_i) times powers of all, which look where little is known; one
    # half of the trials chooses, the other answers
    for power in np.array(list(itertools.product((0.0, 2.0, 5.0), repeat=d))):
        tilt = np.prod(u**power, axis=1)[:, None]
        q = tilt * u * (1.0 - u)
        slope = tilt * (1.0 + power - (2.0 + power) * u)
        psi = q[:, None] * score + slope[:, None]
        one, two = (_weighted_bound(q[half], psi[half])
                    for half in (slice(None, trials // 2), slice(trials // 2, None)))
        best = np.where(one[0] > best[0], (one[0], *two), best)
    return gain * best[1], gain * best[2]


def _weighted_bound(q, psi):
    """E q sqrt([E{psi psi'}^-1]_ii) and its standard error, (T, d)."""
    inverse = np.linalg.inv(np.einsum("lti,ltj->tij", psi, psi) / len(psi))
    square = np.diagonal(inverse, axis1=1, axis2=2)
    bound = q.mean(0) * np.sqrt(square)
    # the delta method: d[J^-1] = -J^-1 dJ J^-1; q varies as well
    pull = (0.5 * np.einsum("tij,ltj->lti", inverse, psi)**2 / square
            - (q / q.mean(0))[:, None])
    return bound, bound * pull.std(0, ddof=1) / np.sqrt(len(psi))


# ---- 7. Gap ----------------------- why a simulated record differs from the real one
#
# A simulator is a set of hypotheses. Every effect that it may lack joins it as one more
# hypothesis, in one of four ways:
#
#   signature   something known times an unknown size is added to the record;
#   process     another shaping filter, or another variance, inside the model;
#   jumps       noises that are not Gaussian: a filter with several modes;
#   reading     the values themselves are altered: rounded, clipped, repeated.
#
# Evidence is integrated over all parameters, Eq. (11), by adaptive importance sampling.

BLOCK = 10**6    # samples of simulated records that are worked on at a time: 100 MB
NODE_BLOCK = 8 * BLOCK    # the same for one record at many nodes; few leave cores idle


class Scene(NamedTuple):
    """A record and what was recorded beside it."""

    y: np.ndarray    # (N,) sensor error, u; NaN where missing
    dt: float        # s
    columns: dict    # name -> (N,) array

    @property
    def time(self):
        """Time since the first sample, s."""
        return self.dt * np.arange(len(self.y))

    @property
    def duration(self):
        return self.dt * len(self.y)

    @property
    def white(self):
        """Standard deviation of the white part, from first differences; robust."""
        step = np.abs(np.diff(self.y[~np.isnan(self.y)]))
        scale = np.median(step) / 0.6745 or np.sqrt(np.mean(step**2))
        return scale / np.sqrt(2.0)


class Effect(NamedTuple):
    """An effect that a simulator may lack; a user's own is another of these."""

    name: str
    kind: str               # "signature", "process", "jumps" or "reading"
    parameters: Callable    # of the scene: priors of what is not a size
    build: Callable         # see `CATALOGUE`
    size: str = ""          # what the coefficient of a signature is called
    column: str = ""        # what must be recorded beside the error
    resembles: str = ""     # what it is confused with
    experiment: str = ""    # what tells them apart
    equation: str = ""      # what becomes of the error y, with units


def _none(scene):
    return ()


# ---- signatures: build(scene, column, psi) gives (variant, (N, k) array) pairs

def _centred(x):
    """Less its mean; 0 where nothing but rounding varies."""
    return (x - x.mean()) * (np.ptp(x) > 1e-9 * np.abs(x).max())


def _from_start(scene, column, psi):
    yield "", scene.time[:, None]


def _step(scene, column, psi):
    yield "", (scene.time >= psi - 1e-9 * scene.dt)[:, None].astype(float)


def _transient(scene, column, psi):
    yield "", np.exp(-scene.time / psi)[:, None]


def _sinusoid(scene, column, psi):
    phase = 2.0 * np.pi * psi * scene.time
    yield "", np.column_stack([np.cos(phase), np.sin(phase)])


def _linear(scene, column, psi):
    yield "", _centred(column)[:, None]


def _curved(scene, column, psi):
    yield "square", _centred(column**2)[:, None]
    yield "modulus", _centred(np.abs(column))[:, None]


def _derivative(scene, column, psi):
    step = np.diff(column) / scene.dt
    yield "backward", np.append(0.0, step)[:, None]
    yield "forward", np.append(step, 0.0)[:, None]
    yield "central", np.gradient(column, scene.dt)[:, None]


def lagged(x, dt, tau):
    """First-order low-pass of time constant tau, s, in steady state at the start."""
    a = np.exp(-dt / tau)
    return lfilter([1.0 - a], [1.0, -a], x, zi=[a * x[0]])[0]


def _lagged(scene, column, psi):
    yield "", _centred(lagged(column, scene.dt, psi))[:, None]


# ---- processes: build(scene, h) gives a model with further parameters

def _beside(filt, a, sigma):
    """A shaping filter with Markov processes of factors a, standard deviations sigma
    added to its output.
    """
    n, m, k = filt.Phi.shape[1], filt.Gamma.shape[2], len(a)
    Phi, Gamma, P0 = (np.zeros((n + k, n + k)), np.zeros((n + k, m + k)),
                      np.zeros((n + k, n + k)))
    Phi[:n, :n], Gamma[:n, :m], P0[:n, :n] = filt.Phi[0], filt.Gamma[0], filt.P0
    for i in range(k):
        Phi[n + i, n + i] = a[i]
        Gamma[n + i, m + i] = sigma[i] * np.sqrt(1.0 - a[i]**2)
        P0[n + i, n + i] = sigma[i]**2
    return ShapingFilter(Phi[None], Gamma[None],
                         np.append(filt.H[0], np.ones(k))[None], filt.Psi,
                         np.append(filt.m0, np.zeros(k)), P0)


def _correlated_noise(scene, h):
    def extended(dt, tau, sigma, **base):
        return _beside(h.model(dt, **base), [np.exp(-dt / tau)], [sigma])
    return extended


def flicker_times(scene):
    """Correlation times, s, of the processes that make up flicker noise: from a tenth
    of the record to the sampling interval, at even distances, five at most.
    """
    decades = max(np.log10(0.1 * scene.duration / scene.dt), 0.0)
    return 0.1 * scene.duration * 10.0**-np.linspace(
        0.0, decades, int(np.clip(2.0 * decades, 1, 5)))


def _bias_instability(scene, h):
    """Flicker noise, as strong as one Markov process a decade from a tenth of the
    record downwards would be with the standard deviation sigma all together.

    The coefficient B of IEEE Std 952 (two-sided S = B^2 / (2 pi f)) is sigma times
    sqrt(pi / (decades ln 10)).
    """
    taus = flicker_times(scene)
    decades = np.floor(max(np.log10(0.1 * scene.duration / scene.dt), 0.0)) + 1.0
    apart = np.log10(taus[0] / taus[1]) if len(taus) > 1 else 1.0
    a, part = np.exp(-scene.dt / taus), np.full(len(taus), np.sqrt(apart / decades))

    def extended(dt, sigma, **base):
        return _beside(h.model(dt, **base), a, sigma * part)
    return extended


def _bandwidth(scene, h):
    """The white noise passes a first-order low-pass of unit gain at rest."""
    def extended(dt, tau, **base):
        filt = h.model(dt, **base)
        a = np.exp(-dt / tau)
        low = np.sqrt((1.0 - a) / (1.0 + a)) * filt.Psi
        return _beside(filt._replace(Psi=np.zeros(1)), [a], low)
    return extended


def _noise_step(scene, h):
    time = scene.time

    def extended(dt, onset, ratio, **base):
        filt, first = h.model(dt, **base), np.searchsorted(time, onset)
        if first == len(time):
            return filt
        Psi = filt.Psi * np.ones(len(time))
        Psi[first:] *= ratio
        return filt._replace(Psi=Psi)
    return extended


# ---- readings: build(scene, y, value) alters the values y (..., N) in place

def _quantize(scene, y, value):
    seen = scene.y[~np.isnan(scene.y)]
    origin = seen[0] if len(seen) and lattice(scene.y) else 0.0
    y[:] = origin + value["lsb"] * np.round((y - origin) / value["lsb"])


def _saturate(scene, y, value):
    np.clip(y, *value["limits"], out=y)


def _stick(scene, y, value):
    for start, length in value["spans"]:
        first = round(start / scene.dt)
        y[..., first:first + int(length)] = y[..., first:first + 1]


def lattice(y):
    """Spacing of the values of a record, or 0 where they lie on no lattice."""
    values = np.unique(y[~np.isnan(y)])
    if len(values) < 2:
        return 0.0
    step = np.diff(values)
    step = step[step > 1e-9 * (values[-1] - values[0])]
    lsb = step.min()
    for _ in range(3):    # refine with ever larger multiples
        lsb = np.sum(step) / np.sum(np.round(step / lsb))
    off = np.abs(step / lsb - np.round(step / lsb))
    return float(lsb) if np.mean(off < 0.05) > 0.95 else 0.0


def lattice_and_noise(y):
    """`lattice` of a record, and the standard deviation of its noise without it."""
    seen, lsb = y[~np.isnan(y)], lattice(y)
    return lsb, np.sqrt(max(np.mean(np.diff(seen)**2) / 2.0 - lsb**2 / 12.0, 0.0))


def _log(symbol, low, high):
    return Parameter(symbol, low, max(high, 1.01 * low), True)


def _spread(scene):
    return max(np.nanstd(scene.y), 3.0 * scene.white)


# ---- the catalogue

CYCLES = 3    # in a record, of a sinusoid at least: slow noise shows fewer by itself
              # (S. Krishnan et al., Mon. Not. R. Astron. Soc. 508, 2021)

CATALOGUE = {effect.name: effect for effect in (
    Effect("rate_ramp", "signature", _none, _from_start, "slope",
           equation="y + slope t; slope in u/s",
           resembles="random walk, slow transient",
           experiment="record longer"),
    Effect("bias_step", "signature",
           lambda s: (Parameter("onset", s.dt, s.duration - s.dt),), _step, "size",
           equation="y + size from t = onset on; onset in s, size in u",
           resembles="random walk, one stuck interval",
           experiment="look for what happened at the onset: a knock, a restart"),
    Effect("turn_on_transient", "signature",
           lambda s: (_log("tau", s.duration / 400, s.duration / 3),), _transient,
           "size",
           equation="y + size exp(-t / tau); tau in s, size in u",
           resembles="rate ramp, temperature",
           experiment="switch off, cool down and on again: it returns"),
    Effect("sinusoid", "signature",
           lambda s: (Parameter("frequency", CYCLES / s.duration, 0.5 / s.dt),),
           _sinusoid, "amplitude",
           equation="y + amplitude sin(2 pi frequency t + phase); frequency in Hz, "
                    "amplitude in u",
           resembles="correlated noise of long period",
           experiment="damp vibration; an alias moves with the sampling rate"),
    Effect("temperature", "signature", _none, _linear, "coefficient", "temperature",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="random walk, thermal lag",
           experiment="cycle the temperature twice at different speed"),
    Effect("thermal_lag", "signature",
           lambda s: (_log("tau", s.duration / 100, s.duration / 4),), _lagged,
           "coefficient", "temperature",
           equation="y + coefficient (X - mean of X), tau dX/dt = x - X; tau in s, "
                    "coefficient in u per unit of x",
           resembles="temperature",
           experiment="step the temperature and hold it"),
    Effect("scale_factor", "signature", _none, _linear, "coefficient", "rate",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="nonlinearity",
           experiment="turn at several known rates of both signs"),
    Effect("nonlinearity", "signature", _none, _curved, "coefficient", "rate",
           equation="y + coefficient f, f = x^2 or |x| less its mean; in u per unit "
                    "of f",
           resembles="scale factor where the rate has one sign",
           experiment="turn at several known rates of both signs"),
    Effect("latency", "signature", _none, _derivative, "coefficient", "rate",
           equation="y + coefficient dx/dt; in u per unit of x and second",
           resembles="scale factor under slow motion",
           experiment="turn with sharp starts and stops"),
    Effect("g_sensitivity", "signature", _none, _linear, "coefficient",
           "acceleration",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="scale factor",
           experiment="turn the sensor over at rest"),
    Effect("covariate", "signature", _none, _linear, "coefficient", "*",
           equation="y + coefficient (x - mean of x); in u per unit of x",
           resembles="any drift that moves as the column does",
           experiment="vary that quantity alone"),
    Effect("correlated_noise", "process",
           lambda s: (_log("tau", 1.5 * s.dt, s.duration / 10),
                      _log("sigma", 0.03 * s.white, _spread(s))), _correlated_noise,
           equation="y + m, dm/dt = -m / tau + white noise, standard deviation of m "
                    "sigma; tau in s, sigma in u",
           resembles="bias instability, random telegraph, random walk",
           experiment="record longer, sample faster"),
    Effect("bias_instability", "process",
           lambda s: (_log("sigma", 0.01 * s.white, _spread(s)),), _bias_instability,
           equation="y + Markov processes, tau evenly in log from dt to T / 10, "
                    "together of standard deviation sigma, in u",
           resembles="correlated noise, random walk", experiment="record longer"),
    Effect("bandwidth", "process",
           lambda s: (_log("tau", 0.15 * s.dt, 50.0 * s.dt),), _bandwidth,
           equation="the white noise v becomes V, tau dV/dt = v - V; tau in s",
           resembles="correlated noise of short time", experiment="sample faster"),
    Effect("noise_step", "process",
           lambda s: (Parameter("onset", s.dt, s.duration - s.dt),
                      _log("ratio", 0.1, 10.0)), _noise_step,
           equation="the white noise becomes ratio times as strong from t = onset "
                    "on; onset in s",
           resembles="outliers in clusters",
           experiment="look for what was switched on at the onset"),
    Effect("outliers", "jumps",
           lambda s: (_log("rate", 1.0 / len(s.y), 0.1),
                      _log("sigma", 2.0 * s.white, 300.0 * s.white)), None,
           equation="y + N(0, sigma^2) with the probability rate in every sample; "
                    "sigma in u",
           resembles="noise step, random telegraph",
           experiment="log the raw bus: are they transmission errors?"),
    Effect("random_telegraph", "jumps",
           lambda s: (_log("dwell", 3.0 * s.dt, s.duration / 4),
                      _log("size", 0.1 * s.white, 2.0 * _spread(s))), None,
           equation="y +- size / 2, two levels, each kept for dwell on average; "
                    "dwell in s, size in u",
           resembles="correlated noise",
           experiment="average less white noise away: two levels show in a histogram"),
    Effect("quantization", "reading", _none, _quantize,
           equation="lsb round(y / lsb); lsb in u",
           resembles="white noise",
           experiment="widen the word length, raise the gain"),
    Effect("saturation", "reading", _none, _saturate,
           equation="y between two limits, in u",
           resembles="skewed noise",
           experiment="widen the range"),
    Effect("stuck", "reading", _none, _stick,
           equation="y keeps its value in spans of (start in s, samples)",
           resembles="quantization",
           experiment="compare the counters of sensor and logger"),
    Effect("wrong_parameter", "parameter", _none, None,
           equation="one parameter of the simulator is factor times what it says",
           resembles="correlated noise, bandwidth",
           experiment="compare the Allan deviation with the data sheet, unit by unit"),
)}


def describe(effect, scene=None):
    """Definition of an effect as text: equation, columns, what it is confused with and
    how to tell; with a scene, the priors that it has there.
    """
    lines = [f"{effect.name}: {effect.equation}"]
    if effect.column:
        lines.append("needs, as x, " + ("any other column" if effect.column == "*" else
                                        f"a column {effect.column}"))
    if scene:
        units = dict(onset="s", tau="s", dwell="s", frequency="Hz", sigma="u", size="u")
        lines += [f"{p.symbol}: {'log-' if p.log else ''}uniform from {p.low:.4g} to "
                  f"{p.high:.4g} {units.get(p.symbol, '')}".rstrip()
                  for p in effect.parameters(scene)]
    lines.append(f"confused with: {effect.resembles}")
    lines.append(f"to tell: {effect.experiment}")
    return "\n    ".join(lines)


def extend(scene, h, effect):
    """Hypothesis with a process or jumps as well, and their parameters."""
    extra = tuple(p._replace(symbol=f"{effect.name}.{p.symbol}")
                  for p in effect.parameters(scene))
    inner = effect.build(scene, h) if effect.kind == "process" else (
        lambda dt, **values: h.model(dt, **values))

    def model(dt, **values):
        own = {p.symbol.split(".")[1]: values.pop(p.symbol) for p in extra}
        return inner(dt, **values, **(own if effect.kind == "process" else {}))
    model.plain = getattr(h.model, "plain", h)
    model.effects = {**getattr(h.model, "effects", {}), effect.name: effect}
    return h._replace(model=model, parameters=h.parameters + extra)


# ---- simulation: a simulator with effects added to it

class Added(NamedTuple):
    """An effect as a simulator has it."""

    effect: Effect
    column: str          # of the record, "" where none is needed
    variant: str         # of a signature, "" where there is one only
    parameters: dict     # symbol -> Parameter; a size, and a phase, among them


def simulate_effects(hypotheses, effects, scene, trials=1, seed=0, first=0):
    """Records of hypotheses with effects.

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
        Equally probable.
    effects : sequence of sequences of Added
        Those of every hypothesis.
    scene : Scene
        Gives the length and the columns; its missing samples will be missing.
    trials, seed, first : int
        As for `simulate`.

    Returns
    -------
    Trials
        As `simulate` draws them, then altered. Processes and jumps are added to the
        noise, signatures to the sum, readings last.
    """
    extended = [with_processes(scene, h, added)
                for h, added in zip(hypotheses, effects)]
    drawn = simulate(extended, scene.dt, len(scene.y), trials, seed, first)
    for trial, y in enumerate(drawn.error):
        rng = np.random.default_rng(
            np.random.SeedSequence(seed, spawn_key=(first + trial, 1)))
        h = extended[drawn.hypothesis[trial]]
        values = dict(zip((p.symbol for p in h.parameters), drawn.theta[trial]))
        _add_jumps(y, scene.dt, values, rng)
        for one in effects[drawn.hypothesis[trial]]:
            if one.effect.kind == "signature":
                y += signature_of(scene, one, {
                    symbol: p.quantile(rng.random()) if isinstance(p, Parameter) else p
                    for symbol, p in one.parameters.items()})
    for number, added in enumerate(effects):
        own = drawn.hypothesis == number
        read = drawn.error[own]
        for one in added:
            if one.effect.kind == "reading":
                one.effect.build(scene, read, one.parameters)
        drawn.error[own] = read
    drawn.error[:, np.isnan(scene.y)] = np.nan
    return drawn


def with_processes(scene, h, added):
    """Hypothesis with the processes and jumps among added effects."""
    for one in added:
        if one.effect.kind in ("process", "jumps"):
            h = extend(scene, h, one.effect)
            h = h._replace(parameters=tuple(
                one.parameters[p.symbol.partition(".")[2]]._replace(symbol=p.symbol)
                if p.symbol.startswith(one.effect.name + ".") else p
                for p in h.parameters))
    return h


def signature_of(scene, one, value):
    """The signature (N,) of an added effect at values of its parameters."""
    e = one.effect
    psi = next((value[p.symbol] for p in e.parameters(scene)), np.nan)
    built = e.build(scene, scene.columns.get(one.column), psi)
    columns = next(c for variant, c in built if one.variant in ("", variant))
    size = np.array([value[e.size]])
    if columns.shape[1] == 2:
        phase = value.get("phase", 0.0)
        size = size * [np.cos(phase), -np.sin(phase)]
    return columns @ size


def _add_jumps(y, dt, value, rng):
    """Outliers and telegraph noise, by the names of their parameters, added to y."""
    N = len(y)
    if "outliers.rate" in value:
        at = rng.random(N) < value["outliers.rate"]
        y[at] += value["outliers.sigma"] * rng.standard_normal(at.sum())
    if "random_telegraph.size" in value:
        change = rng.random(N) < -0.5 * np.expm1(
            -2.0 * dt / value["random_telegraph.dwell"])
        level = (rng.integers(2) + np.cumsum(change)) % 2
        y += value["random_telegraph.size"] * (level - 0.5)


# ---- likelihood: Gaussian through the bank, jumps and signatures through a filter of
# their own

ABREAST = 8    # pairs of a record and a node that go through a filter side by side


@njit(parallel=True, **JIT)
def _mixture_filters(y, H, a, q, p0, r, outlier, jump, out):
    """Log-likelihoods (R, M) of records under filters with outliers and two levels.

    y (R, N); H (N, n) observes n independent processes with factors a, noise variances
    q and initial variances p0 (M, n); r (M, 1 or N). outlier (M, 2) = rate, variance;
    jump (M, 2) = probability of a change of level, half the distance of the levels
    (0: one level). out (R, M, 4 or 0, N) gets of every sample the predictive
    probabilities below and above it, that of its being an outlier, and its log density;
    where nothing jumps, its normal score in place of the first.

    One Gaussian per level is kept (interacting multiple models; Blom and Bar-Shalom,
    "The interacting multiple model algorithm", IEEE Trans. Autom. Control 33, 1988).
    """
    R, N = y.shape
    M, n = a.shape
    rows, pairs = out.shape[2], R * M
    levels = 2 if jump[:, 1].max() > 0.0 else 1
    kinds = 2 if outlier[:, 0].max() > 0.0 else 1
    total = np.empty((R, M))
    for group in prange((pairs + ABREAST - 1) // ABREAST):
        record, node = np.empty(ABREAST, np.int64), np.empty(ABREAST, np.int64)
        A, Q = np.empty((n, ABREAST)), np.empty((n, ABREAST))
        rate, wider = np.empty(ABREAST), np.empty(ABREAST)
        change, offset = np.empty(ABREAST), np.empty(ABREAST)
        x, P = np.zeros((levels, n, ABREAST)), np.zeros((levels, n, n, ABREAST))
        Ph, apart = np.empty((levels, n, ABREAST)), np.empty((n, ABREAST))
        weight = np.full((levels, ABREAST), 1.0 / levels)
        prior, share = weight.copy(), np.ones((levels, ABREAST))
        seen, nu, f = np.empty(ABREAST), np.empty((levels, ABREAST)), np.empty(ABREAST)
        per_f, half = np.empty((2, levels, kinds, ABREAST))
        term, mass = np.empty((levels, kinds, ABREAST)), np.empty(ABREAST)
        least, wild = np.empty(ABREAST), np.zeros((levels, ABREAST))
        gain, shrink = np.empty(ABREAST), np.empty(ABREAST)
        log_f, product = np.zeros(ABREAST), np.ones(ABREAST)
        number = min(ABREAST, pairs - group * ABREAST)
        for g in range(ABREAST):
            pair = min(group * ABREAST + g, pairs - 1)
            record[g], node[g] = pair // M, pair % M
            rate[g], wider[g] = outlier[node[g]]
            change[g], offset[g] = jump[node[g]]
            for s in range(n):
                A[s, g], Q[s, g] = a[node[g], s], q[node[g], s]
                for level in range(levels):
                    P[level, s, s, g] = p0[node[g], s]
        for i in range(N):
            if levels == 2:
                for level in range(2):
                    for g in range(ABREAST):
                        stay = weight[level, g] * (1.0 - change[g])
                        prior[level, g] = stay + weight[1 - level, g] * change[g]
                        share[level, g] = stay / prior[level, g]
                for s in range(n):
                    for g in range(ABREAST):
                        apart[s, g] = x[0, s, g] - x[1, s, g]
                        x[0, s, g] -= (1.0 - share[0, g]) * apart[s, g]
                        x[1, s, g] += (1.0 - share[1, g]) * apart[s, g]
                    for t in range(s + 1):
                        for g in range(ABREAST):
                            more = P[0, s, t, g] - P[1, s, t, g]
                            both = apart[s, g] * apart[t, g]
                            P[0, s, t, g] -= (1.0 - share[0, g]) * (
                                more - share[0, g] * both)
                            P[1, s, t, g] += (1.0 - share[1, g]) * (
                                more + share[1, g] * both)
            for g in range(ABREAST):
                value = y[record[g], i]
                seen[g] = 0.0 if np.isnan(value) else 1.0
                for level in range(levels):
                    nu[level, g] = (value if seen[g] > 0.0 else 0.0) - (
                        2 * level - 1) * (levels - 1) * offset[g]
                least[g] = np.inf
            for level in range(levels):
                for g in range(ABREAST):
                    f[g] = r[node[g], min(i, r.shape[1] - 1)]
                for s in range(n):
                    for g in range(ABREAST):
                        x[level, s, g] *= A[s, g]
                        nu[level, g] -= H[i, s] * x[level, s, g]
                        Ph[level, s, g] = 0.0
                    for t in range(s + 1):
                        for g in range(ABREAST):
                            P[level, s, t, g] *= A[s, g] * A[t, g]
                    for g in range(ABREAST):
                        P[level, s, s, g] += Q[s, g]
                    for t in range(s):
                        for g in range(ABREAST):
                            Ph[level, s, g] += H[i, t] * P[level, s, t, g]
                            Ph[level, t, g] += H[i, s] * P[level, s, t, g]
                    for g in range(ABREAST):
                        Ph[level, s, g] += H[i, s] * P[level, s, s, g]
                for s in range(n):
                    for g in range(ABREAST):
                        f[g] += H[i, s] * Ph[level, s, g]
                for kind in range(kinds):
                    for g in range(ABREAST):
                        k = 1.0 / (f[g] + kind * wider[g])
                        per_f[level, kind, g] = k
                        term[level, kind, g] = prior[level, g] * np.sqrt(k) * (
                            rate[g] if kind else 1.0 - rate[g])
                        half[level, kind, g] = 0.5 * k * nu[level, g] * nu[level, g]
                        least[g] = min(least[g], half[level, kind, g])
            mass[:] = 0.0
            for level in range(levels):
                for kind in range(kinds):
                    for g in range(ABREAST):
                        if half[level, kind, g] > least[g]:
                            term[level, kind, g] *= np.exp(
                                least[g] - half[level, kind, g])
                    for g in range(ABREAST):
                        mass[g] += term[level, kind, g]
            for g in range(ABREAST):
                log_f[g] += seen[g] * (least[g] + 0.5 * LOG_2PI)
                product[g] *= seen[g] * mass[g] + 1.0 - seen[g]
            if i % 8 == 7 or i == N - 1:    # one logarithm for many samples
                for g in range(ABREAST):
                    log_f[g] -= np.log(product[g])
                    product[g] = 1.0
            for level in range(levels):
                for g in range(ABREAST):
                    own = term[level, 0, g]
                    k, less = per_f[level, 0, g], per_f[level, 0, g]
                    if kinds == 2:
                        own += term[level, 1, g]
                        wild[level, g] = term[level, 1, g] / own if own > 0.0 else 0.0
                        apart_k = k - per_f[level, 1, g]
                        k -= wild[level, g] * apart_k
                        less = k - wild[level, g] * (1.0 - wild[level, g]) * (
                            apart_k * nu[level, g])**2
                    weight[level, g] = max(own / mass[g], 1e-12) if (
                        seen[g] > 0.0) else prior[level, g]
                    gain[g], shrink[g] = seen[g] * k * nu[level, g], seen[g] * less
                for s in range(n):
                    for g in range(ABREAST):
                        x[level, s, g] += Ph[level, s, g] * gain[g]
                    for t in range(s + 1):
                        for g in range(ABREAST):
                            P[level, s, t, g] -= (
                                Ph[level, s, g] * Ph[level, t, g] * shrink[g])
            for g in range(number * rows // 4):
                if seen[g] == 0.0:
                    continue
                at = out[record[g], node[g], :, i]
                at[3] = np.log(mass[g]) - least[g] - 0.5 * LOG_2PI
                at[:3] = 0.0
                if levels * kinds == 1:
                    at[0] = nu[0, g] * np.sqrt(per_f[0, 0, g])
                    continue
                for level in range(levels):
                    at[2] += weight[level, g] * wild[level, g]
                    for kind in range(kinds):
                        part = 0.5 * prior[level, g] * (
                            rate[g] if kind else 1.0 - rate[g])
                        e = nu[level, g] * np.sqrt(0.5 * per_f[level, kind, g])
                        at[0] += part * math.erfc(-e)
                        at[1] += part * math.erfc(e)
        for g in range(number):
            total[record[g], node[g]] = -log_f[g]
    return total


class Nodes(NamedTuple):
    """A hypothesis at M values of its parameters, as the mixture filter takes it."""

    a: np.ndarray          # (M, n)
    q: np.ndarray          # (M, n)
    p0: np.ndarray         # (M, n)
    r: np.ndarray          # (M, 1 or N)
    outlier: np.ndarray    # (M, 2)
    jump: np.ndarray       # (M, 2)


def _value(h, theta, symbol):
    """A parameter by name; 0 where the hypothesis does not have it."""
    for column, p in enumerate(h.parameters):
        if p.symbol == symbol:
            return theta[:, column]
    return np.zeros(len(theta))


def _nodes(h, dt, theta):
    b = bank(h, dt, theta)
    if not is_modal(b):
        raise ValueError(f"{h.name} is no sum of independent one-state processes: "
                         "only such hypotheses can be diagnosed")
    a, q = (np.diagonal(m[:, 0], 0, 1, 2) for m in (b.Phi, b.Q))
    outlier = np.column_stack([_value(h, theta, "outliers.rate"),
                               _value(h, theta, "outliers.sigma")**2])
    dwell = _value(h, theta, "random_telegraph.dwell")
    p = 0.5 * -np.expm1(-2.0 * dt / np.where(dwell > 0, dwell, np.inf))
    jump = np.column_stack([p, 0.5 * _value(h, theta, "random_telegraph.size")])
    return Nodes(a, q, np.diagonal(b.P0, 0, 1, 2), b.r, outlier, jump)


class Signature(NamedTuple):
    """A signature that has been found, with the prior of its size."""

    effect: Effect
    column: str
    variant: str
    psi: float
    columns: np.ndarray    # (N, k)
    sd: float              # of its size, a priori: wide


class Predicted(NamedTuple):
    """What a mixture filter makes of R records at M nodes."""

    log_likelihood: np.ndarray    # (R, M)
    z: np.ndarray                 # (R, M, N) normal scores of the samples
    odd: np.ndarray               # (R, M, N) probability of an outlier
    log_score: np.ndarray         # (R, M, N) ln of the predictive density


def _with_constants(h, scene, signatures, theta):
    """`Nodes` with the bias and the sizes of signatures as further processes, and what
    observes them, (N, n).
    """
    v = _nodes(h, scene.dt, theta)
    S = [s.columns for s in signatures]
    k, M = 1 + sum(s.shape[1] for s in S), len(theta)
    H = np.column_stack([np.ones((len(scene.y), v.a.shape[1] + 1)), *S])
    sd = np.concatenate([[h.bias_sigma],
                         *(np.full(s.columns.shape[1], s.sd) for s in signatures)])
    return v._replace(a=np.hstack([v.a, np.ones((M, k))]),
                      q=np.hstack([v.q, np.zeros((M, k))]),
                      p0=np.hstack([v.p0, np.tile(sd**2, (M, 1))])), H


def _filtered(h, scene, signatures, theta, y, rows):
    """Log-likelihoods (R, M) of records y (R, N) like that of the scene, and what
    `_mixture_filter` writes of their samples, (R, M, rows, N).
    """
    v, H = _with_constants(h, scene, signatures, theta)
    out = np.full((len(y), len(theta), rows, y.shape[1]), np.nan)
    return _mixture_filters(y, H, v.a, v.q, v.p0, v.r, v.outlier, v.jump, out), out


def predict(h, scene, signatures, theta, y=None):
    """`Predicted` of the record of a scene, or of others like it, y (R, N)."""
    total, out = _filtered(h, scene, signatures, theta,
                           scene.y[None] if y is None else y, 4)
    z, above = out[:, :, 0], out[:, :, 1]
    if _has_jumps(h):
        with np.errstate(divide="ignore"):
            z = np.where(z < above, ndtri(z), -ndtri(above))
    return Predicted(total, np.clip(z, -37.0, 37.0), out[:, :, 2], out[:, :, 3])


def _has_jumps(h):
    return any(p.symbol.startswith(("outliers.", "random_telegraph."))
               for p in h.parameters)


def _log_likelihoods(h, scene, signatures, theta):
    """ln f(Y / theta) (M,): through the bank, unless there are jumps."""
    if _has_jumps(h):
        return _filtered(h, scene, signatures, theta, scene.y[None], 0)[0][0]
    gram = _gram(h, scene, [scene.y, *(c for s in signatures for c in s.columns.T)],
                 theta)
    variance = np.concatenate([
        *(np.full(s.columns.shape[1], s.sd**2) for s in signatures),
        [max(h.bias_sigma, 1e-9)**2]])
    A = gram.products[:, 1:, 1:] + np.diag(1.0 / variance)
    b = gram.products[:, 1:, 0]
    explained = (b[:, None] @ np.linalg.solve(A, b[..., None]))[:, 0, 0]
    return -0.5 * (gram.count * LOG_2PI + gram.log_det + np.log(variance).sum()
                   + np.linalg.slogdet(A)[1] + gram.products[:, 0, 0] - explained)


STRAY = 0.1     # probability of an onset anywhere at all, in `onset_law`
BIN = 16        # samples whose likeliest onset stands for all until one is drawn
WILD = 25.0     # squared standard score from which on a sample may be an outlier


@njit(**JIT)
def _draw_one(mass, u):
    """Number at the quantile u of a law, and the quantile within it."""
    k = 0
    while k < len(mass) - 1 and u > mass[k]:
        u -= mass[k]
        k += 1
    return k, min(max(u / mass[k], 1e-6), 1.0)


@njit(**JIT)
def _draw_onset(gain, peak, u):
    """Onset, in samples, at the quantile u of a law of these log odds, and the log of
    its density over 1 / N; `peak` is the largest gain of every bin.

    Drawn is a bin, then a sample in it; with the probability STRAY any sample.
    """
    bins, stray, k, onset = np.exp(peak - peak.max()), u < STRAY, 0, 0.0
    bins /= bins.sum()
    if stray:
        onset = max(u / STRAY, 1e-9) * len(gain)
        k = int(np.ceil(onset) - 1) // BIN
    else:
        k, u = _draw_one(bins, (u - STRAY) / (1.0 - STRAY))
    inside = np.exp(gain[k * BIN:(k + 1) * BIN] - peak[k])
    inside /= inside.sum()
    if not stray:
        at, u = _draw_one(inside, u)
        onset = k * BIN + at + u
    share = bins[k] * inside[int(np.ceil(onset)) - 1 - k * BIN]
    return onset, np.log((1.0 - STRAY) * share * len(gain) + STRAY)


@njit(parallel=True, **JIT)
def _draw_onsets(y, H, a, q, p0, r, ratio, u):
    """Onsets of a change of noise, in samples, at quantiles u (M,) of their law, and
    the log of their density over 1 / N; ABREAST nodes side by side.

    The filter of the early noise, of variance r (M,), up to a sample and that of the
    late one, of variance r ratio^2, from there on nearly give the likelihood of every
    onset 1 ... N - 1 at once.
    """
    M, n, N = len(a), a.shape[1], len(y)
    onset, density, bins = np.empty(M), np.zeros(M), (N - 2) // BIN + 1
    for group in prange((M + ABREAST - 1) // ABREAST):
        first, number = group * ABREAST, min(ABREAST, M - group * ABREAST)
        A, Q = np.zeros((n, ABREAST)), np.zeros((n, ABREAST))
        P, x = np.empty((n, n, ABREAST)), np.empty((n, ABREAST))
        Ph = np.empty((n, ABREAST))
        noise, f, nu = np.ones(ABREAST), np.empty(ABREAST), np.empty(ABREAST)
        last, log_f, weight = np.zeros((3, ABREAST))
        gain = np.zeros((N, ABREAST))
        for late in range(2):
            P[:], x[:] = 0.0, 0.0
            for g in range(number):
                node = first + g
                noise[g] = r[node] * (ratio[node]**2 if late else 1.0)
                for s in range(n):
                    A[s, g], Q[s, g] = a[node, s], q[node, s]
                    P[s, s, g] = p0[node, s]
            for i in range(N):
                for g in range(ABREAST):
                    nu[g] = y[i]
                f[:] = noise
                for s in range(n):
                    for g in range(ABREAST):
                        x[s, g] *= A[s, g]
                        nu[g] -= H[i, s] * x[s, g]
                        Ph[s, g] = Q[s, g] * H[i, s]
                    for t in range(n):
                        for g in range(ABREAST):
                            P[s, t, g] *= A[s, g] * A[t, g]
                            Ph[s, g] += P[s, t, g] * H[i, t]
                    for g in range(ABREAST):
                        P[s, s, g] += Q[s, g]
                        f[g] += H[i, s] * Ph[s, g]
                if np.isnan(y[i]):
                    continue
                for g in range(ABREAST):
                    if abs(f[g] - last[g]) > 1e-6 * f[g]:
                        # a law to draw from need not be exact
                        last[g], log_f[g] = f[g], np.log(f[g])
                    square = nu[g] * nu[g] / f[g]
                    gain[i, g] += (late - 0.5) * (log_f[g] + min(square, WILD))
                    weight[g] = 1.0 / f[g] if square < WILD else 0.0
                for s in range(n):
                    for g in range(ABREAST):
                        x[s, g] += Ph[s, g] * nu[g] * weight[g]
                    for t in range(n):
                        for g in range(ABREAST):
                            P[s, t, g] -= Ph[s, g] * Ph[t, g] * weight[g]
        peak = np.full((bins, ABREAST), -np.inf)
        for i in range(N - 1):
            for g in range(ABREAST):
                gain[i, g] += gain[i - 1, g] if i else 0.0
                peak[i // BIN, g] = max(peak[i // BIN, g], gain[i, g])
        for g in range(number):
            onset[first + g], density[first + g] = _draw_onset(
                gain[:N - 1, g], peak[:, g], u[first + g])
    return onset, density


def onset_law(h, scene, signatures):
    """How `integrate` draws the onset of a change of noise; None if there is none."""
    symbols = [p.symbol for p in h.parameters]
    if "noise_step.onset" not in symbols:
        return None
    at = symbols.index("noise_step.onset")
    low, high = h.parameters[at].low, h.parameters[at].high
    if low == high:
        return None

    def moved(theta):
        """Theta with its onset at the quantile of that law that it has in the prior."""
        early = theta.copy()
        early[:, at] = scene.duration
        v, H = _with_constants(h, scene, signatures, early)
        onset, density = _draw_onsets(
            scene.y, H, v.a, v.q, v.p0, v.r[:, 0], _value(h, theta, "noise_step.ratio"),
            (theta[:, at] - low) / (high - low))
        theta = theta.copy()
        theta[:, at] = onset * scene.dt
        return theta, -density
    return moved


class Gram(NamedTuple):
    """Products c' C^-1 d of columns, the last of them ones, at M nodes."""

    count: int
    log_det: np.ndarray     # (M,)
    products: np.ndarray    # (M, c + 1, c + 1)


def _gram(h, scene, columns, theta):
    """`Gram` of columns by polarization: 2 c'd = (c + d)'(c + d) - c'c - d'd."""
    c, gap = len(columns), np.isnan(scene.y)
    pairs = [(i, j) for i in range(c) for j in range(i)]
    # of one size: a sum must not lose the smaller of two columns
    size = np.array([np.sqrt(np.nansum(column**2) / len(gap)) or 1.0
                     for column in columns])
    columns = np.array(columns) / size[:, None]
    rows = np.array([*columns, *(columns[i] + columns[j] for i, j in pairs)])
    sums = next(filter_bank(bank(h, scene.dt, theta), np.where(gap, np.nan, rows),
                            [len(scene.y)]))
    products = np.empty((len(theta), c + 1, c + 1))
    products[:, c, c] = sums.information
    for i in range(c):
        products[:, i, i] = sums.chi2[i]
        products[:, i, c] = products[:, c, i] = sums.score[i]
    for chi2, (i, j) in zip(sums.chi2[c:], pairs):
        products[:, i, j] = products[:, j, i] = 0.5 * (
            chi2 - sums.chi2[i] - sums.chi2[j])
    size = np.append(size, 1.0)
    products *= size[:, None] * size
    return Gram(sums.count, sums.log_det, products)


# ---- evidence by adaptive importance sampling

class Sample(NamedTuple):
    """A weighted sample of a posterior."""

    theta: np.ndarray           # (M, p)
    x: np.ndarray               # (M, d) the coordinates of `integrate`
    log_weight: np.ndarray      # (M,) ln prior / proposal
    log_likelihood: np.ndarray  # (M, E), of E rival explanations
    log_evidence: np.ndarray    # (E,)

    @property
    def weight(self):
        """Posterior weights over all explanations, (M,)."""
        w = self.log_weight + logsumexp(self.log_likelihood, axis=1)
        w = np.exp(w - w.max())
        return w / w.sum()


POINTS = 2 * GROUP    # of a round; the bank takes whole groups
ROUNDS = 18       # at most
ENOUGH = 60.0     # effective points at which the evidence is good to 0.13 nat
LOST = 4          # rounds after which a mode is climbed if none has been found
MISSED = 2.0      # nats that a mode is above all points of a sample that missed it
STEP = 1e-2       # of numerical derivatives, in standard deviations of the prior: wide
                  # enough to pass over the roughness that a mixture filter has
HOPELESS = 3.0    # nats below a rival: what the mean evidence would hardly notice


def _log_t(x, mean, chol, nu=5.0):
    """Log density of a multivariate Student t, up to a constant of d and nu."""
    e = np.linalg.inv(chol) @ (x - mean).T
    d = len(mean)
    return (-0.5 * (nu + d) * np.log1p((e * e).sum(0) / nu)
            - np.log(np.diag(chol)).sum()
            + math.lgamma(0.5 * (nu + d)) - math.lgamma(0.5 * nu)
            - 0.5 * d * np.log(nu * np.pi))


def integrate(log_likelihood, parameters, guess=None, move=None, floor=-np.inf,
              seed=0):
    """Evidence and posterior sample by adaptive multiple importance sampling.

    Parameters
    ----------
    log_likelihood : function of theta (M, p)
        Gives (M, E): log-likelihoods of E rival explanations, whose sum is sampled.
    parameters : tuple of Parameter
    guess : (k,) and (k, k) array, optional
        Mean and covariance that the first k free parameters may have, in the
        coordinates where the prior is standard normal.
    move : function of theta (M, p), optional
        Gives theta mapped to where the mass is, and the log of the prior density there
        over that of what is mapped, (M,).
    floor : float
        An evidence this low need not be known well.
    seed : int

    Returns
    -------
    Sample

    Notes
    -----
    J.-M. Cornuet, J.-M. Marin, A. Mira, C. Robert, "Adaptive multiple importance
    sampling", Scand. J. Stat. 39, 2012. Coordinates in which the prior is N(0, I) have
    no edges. Early proposals follow the tempered posterior.
    """
    def located(x):
        theta, moved = at_quantiles(parameters, ndtr(x)), np.zeros(len(x))
        if move is not None:
            theta, moved = move(theta)
        # where a filter breaks down nothing is explained
        ll = log_likelihood(theta)
        return theta, moved, np.where(np.isfinite(ll), ll, -1e100)

    def log_posterior(x):
        _, moved, ll = located(x)
        return logsumexp(ll, axis=1) + moved - 0.5 * (x * x).sum(1)
    d = len(free_columns(parameters))
    if d == 0:
        x = np.zeros((1, 0))
        theta, moved, ll = located(x)
        return Sample(theta, x, moved, ll, ll[0])
    rng = np.random.default_rng(seed)
    # Latin hypercube of the prior: few where a whole guess may do better
    first = POINTS if guess is None or len(guess[0]) < d else POINTS // 4
    strata = np.array([rng.permutation(first) for _ in range(d)]).T
    x = ndtri((strata + rng.random(strata.shape)) / first)
    parts = [(first, lambda x: -0.5 * (x * x).sum(1) - 0.5 * d * LOG_2PI)]

    def propose(mean, cov):
        chol = np.linalg.cholesky(1.2 * cov + 1e-12 * np.eye(d))
        parts.append((POINTS, lambda x: _log_t(x, mean, chol)))
        return mean + (rng.standard_normal((POINTS, d)) @ chol.T
                       / np.sqrt(rng.chisquare(5, (POINTS, 1)) / 5))

    def log_weights():
        log_q = logsumexp([np.log(n) + density(x) for n, density in parts], axis=0)
        return moved - 0.5 * (x * x).sum(1) - 0.5 * d * LOG_2PI - log_q
    if guess is not None:
        k = len(guess[0])
        mean, cov = np.zeros(d), np.eye(d)
        mean[:k], cov[:k, :k] = guess
        x = np.vstack([x, propose(mean, cov)])
    theta, moved, ll = located(x)
    climbed, missed = [], True
    for attempt in range(ROUNDS):
        log_w = log_weights()
        total = logsumexp(ll, axis=1)

        def tempered(beta):
            w = np.exp(beta * (total - total.max()) + log_w - log_w.max())
            return w / w.sum(), w.sum()**2 / (w @ w)
        w, effective = tempered(1.0)
        found = effective >= 5.0 * (d + 1)
        below = floor - logsumexp(total + log_w)
        if effective >= ENOUGH or found and below > HOPELESS or (
                attempt > LOST + 1 and below > 3.0 * HOPELESS):
            break
        if attempt in (LOST, LOST + 1) and missed and not found:
            height = total + moved - 0.5 * (x * x).sum(1)
            for mode, _ in climbed:    # where one was missed, a second one may be, too
                height[((x - mode)**2).sum(1) < 1.0] = -np.inf
            climbed.append(climb(log_posterior, x[height.argmax()]))
            missed = log_posterior(climbed[-1][0][None])[0] > height.max() + MISSED
            new = propose(*climbed[-1])
        else:
            low, beta = 0.0, 1.0
            if not found and not climbed:
                for _ in range(30):
                    middle = 0.5 * (low + beta)
                    low, beta = ((middle, beta) if tempered(middle)[1] > 5.0 * (d + 1)
                                 else (low, middle))
                w = tempered(low)[0]
            mean, cov = w @ x, np.atleast_2d(np.cov(x.T, aweights=w, ddof=0))
            if not found and climbed:    # few points tell little of their own spread
                near = min(climbed, key=lambda m: ((m[0] - mean)**2).sum())
                cov = (effective * cov + (d + 1) * near[1]) / (effective + d + 1)
            new = propose(mean, cov)
        x = np.vstack([x, new])
        theta, moved, ll = (np.concatenate(pair) for pair in zip(
            (theta, moved, ll), located(new)))
    log_w = log_weights()
    return Sample(theta, x, log_w, ll, logsumexp(ll + log_w[:, None], axis=0))


CLIMB = 12    # steps at most
DAMPING = np.concatenate([[0.0], np.geomspace(1.0, 1e6, 13)])


def climb(log_posterior, x):
    """Mode (d,) uphill from x, and the covariance (d, d) of the normal law there.

    Newton's steps, each of them at several dampings at once (D. Marquardt, J. SIAM 11,
    1963); `log_posterior` takes (M, d), its prior is N(0, I).
    """
    d = len(x)
    shift = STEP * np.eye(d)
    pairs = [(i, j) for i in range(d) for j in range(i)]
    stencil = np.vstack([np.zeros((1, d)), shift, -shift, *(
        [one * shift[i] + two * shift[j] for one in (1, -1) for two in (1, -1)]
        for i, j in pairs)])
    for _ in range(CLIMB):
        lp = log_posterior(x + stencil)
        up, down, cross = lp[1:1 + d], lp[1 + d:1 + 2 * d], lp[1 + 2 * d:]
        curvature = np.diag(2.0 * lp[0] - up - down)
        for (i, j), (a, b, c, e) in zip(pairs, cross.reshape(-1, 4)):
            curvature[i, j] = curvature[j, i] = 0.25 * (b + c - a - e)
        width, axes = np.linalg.eigh(curvature / STEP**2)
        width = np.maximum(np.abs(width), 1.0)    # the prior alone curves by 1
        slope = axes.T @ (up - down) / (2.0 * STEP)
        tries = x + (slope / (width + DAMPING[:, None])) @ axes.T
        height = log_posterior(tries)
        if height.max() < lp[0] + 0.1:
            break
        x = tries[height.argmax()]
    return x, axes @ np.diag(1.0 / width) @ axes.T


# ---- signatures: one backward pass serves all of them

@njit(parallel=True, **JIT)
def _adjoint(y, observed, a, q, p0, r):
    """C^-1 y of every column, and s' C^-1 s of a step s at every sample.

    y (C, N); a, q, p0 (M, n), r (M, 1 or N). Returns w (M, C, N), steps (M, N) and
    log_det (M,): P. De Jong, J. Penzer, "Diagnosing shocks in time series", J. Am.
    Stat. Assoc. 93, 1998, with the output shifted for good as the shock.
    """
    C, N = y.shape
    M, n = a.shape
    w, steps, log_det = np.zeros((M, C, N)), np.zeros((M, N)), np.zeros(M)
    for node in prange(M):
        K, weight = np.zeros((N, n)), np.zeros(N)
        P, x, g = np.zeros((n, n)), np.zeros((C, n)), np.zeros(n)
        for s in range(n):
            P[s, s] = a[node, s]**2 * p0[node, s] + q[node, s]
        for i in range(N):
            f = r[node, min(i, r.shape[1] - 1)]
            for s in range(n):
                g[s] = P[s, :].sum()
                f += g[s]
            weight[i] = observed[i] / f
            if observed[i] > 0.0:
                log_det[node] += np.log(f)
            for s in range(n):
                K[i, s] = a[node, s] * g[s] * weight[i]
                for t in range(n):
                    P[s, t] = a[node, s] * a[node, t] * (
                        P[s, t] - g[s] * g[t] * weight[i])
                P[s, s] += q[node, s]
            for c in range(C):
                nu = y[c, i]
                for s in range(n):
                    nu -= x[c, s]
                w[node, c, i] = nu * weight[i]
                for s in range(n):
                    x[c, s] = a[node, s] * x[c, s] + K[i, s] * nu
        R, D, kD = np.zeros((C, n)), np.zeros((n + 1, n + 1)), np.zeros(n + 1)
        for i in range(N - 1, -1, -1):
            for c in range(C):
                for s in range(n):
                    w[node, c, i] -= K[i, s] * R[c, s]
                for s in range(n):
                    R[c, s] = w[node, c, i] + a[node, s] * R[c, s]
            # D = h h' / f + L' D L with L = diag(a, 1) - (K, 0) h'
            for t in range(n + 1):
                kD[t] = 0.0
                for s in range(n):
                    kD[t] += D[t, s] * K[i, s]
            kDk = 0.0
            for s in range(n):
                kDk += K[i, s] * kD[s]
            for s in range(n + 1):
                a_s = a[node, s] if s < n else 1.0
                for t in range(n + 1):
                    a_t = a[node, t] if t < n else 1.0
                    D[s, t] = (a_s * a_t * D[s, t] - a_s * kD[s] - a_t * kD[t]
                               + kDk + weight[i])
            steps[node, i] = D[n, n]
    return w, steps, log_det


SIZES = 8.0 * 4.0**np.arange(9)    # v / sampling variance in the prior of a size, which
                                   # is most probable at sqrt(2 v): 4 to 1024 standard
                                   # errors, for less is not to be seen
# the k-th has the probability 1 / k (k + 1): it falls like the universal prior of
# integers (J. Rissanen, Ann. Stat. 11, 1983) and spends little on what needs no help
_LOG_PRIOR = -np.log(np.arange(1, len(SIZES) + 1) * np.arange(2, len(SIZES) + 2)
                     * len(SIZES) / (len(SIZES) + 1))
_ROOT = np.arange(0.0, 1000.0, 0.02)    # square roots of gains in the table


def _log_bayes(gain, k):
    """ln B of k sizes whose squared standard scores sum to `gain`, and ln of the prior,
    per v.

    Their prior is a^2 / k v N(0, v I), which is 0 at 0: no effect and one too small to
    be seen are the same, and would otherwise share the evidence (V. Johnson and
    D. Rossell, "On the use of non-local prior densities", J. R. Stat. Soc. B 72, 2010).
    """
    shrunk = np.multiply.outer(gain, SIZES / (1.0 + SIZES))
    return (_LOG_PRIOR - (0.5 * k + 1.0) * np.log1p(SIZES) + 0.5 * shrunk
            + np.log1p(shrunk / k))


_TABLE = {k: np.logaddexp.reduce(_log_bayes(_ROOT**2, k), axis=-1) for k in (1, 2)}


@njit(**JIT)
def _looked_up(gain, table, per_unit):
    at = np.sqrt(gain) * per_unit
    low = int(min(at, len(table) - 1.0))
    if low == len(table) - 1:    # beyond the table, ln B grows as gain / 2
        return table[low] + 0.5 * (gain - (low / per_unit)**2)
    return table[low] + (at - low) * (table[low + 1] - table[low])


@njit(parallel=True, **JIT)
def _mean_bayes(gain, table, per_unit):
    """ln of the mean Bayes factor over all psi, (M,), from gains (M, m)."""
    M, m = gain.shape
    result = np.empty(M)
    plain = np.exp(table[:int(20.0 * per_unit)])    # spares an exp for each small gain
    for node in prange(M):
        best = 0.0
        for j in range(m):
            best = max(best, gain[node, j])
        top = _looked_up(best, table, per_unit)
        small, large = 0.0, 0.0
        for j in range(m):
            at = np.sqrt(gain[node, j]) * per_unit
            if at < len(plain) - 1:
                low = int(at)
                small += plain[low] + (at - low) * (plain[low + 1] - plain[low])
            elif gain[node, j] > best - 100.0:
                large += np.exp(_looked_up(gain[node, j], table, per_unit) - top)
        result[node] = np.log(small * np.exp(-top) + large) + top
    return result - np.log(m)


class Scan(NamedTuple):
    """Signatures of one effect at many values of psi, for M nodes."""

    psi: np.ndarray     # (m,)
    gain: np.ndarray    # (M, m) squared standard score of the size
    size: np.ndarray    # (M, m) least-squares size (of a sinusoid: amplitude)
    sd: np.ndarray      # (M, m) its standard error
    k: int


@njit(parallel=True, **JIT)
def _products(rows, columns):
    """rows @ columns.T, without a second set of threads that would get in the way."""
    M, N = rows.shape
    result = np.zeros((M, len(columns)))
    for m in prange(M):
        for begin in range(0, N, 2048):    # what a cache holds of all columns
            end = min(begin + 2048, N)
            whole = end - (end - begin) % 8
            for c in range(len(columns)):
                total = np.zeros(8)
                for i in range(begin, whole, 8):
                    for lane in range(8):
                        total[lane] += rows[m, i + lane] * columns[c, i + lane]
                rest = total.sum()
                for i in range(whole, end):
                    rest += rows[m, i] * columns[c, i]
                result[m, c] += rest
    return result


class Solved(NamedTuple):
    """What all signatures need of a record: C^-1 (y - fit) at M nodes."""

    base: np.ndarray       # (M,) log-likelihood without a further signature
    residual: np.ndarray   # (M, N) C^-1 y less what bias and signatures explain
    w: np.ndarray          # (M, c, N) C^-1 of the columns known already
    cov: np.ndarray        # (M, c, c) of their sizes
    steps: np.ndarray      # (M, N)
    size: np.ndarray       # (M, c) sizes of the columns known already


def solve(h, scene, signatures, theta):
    """`Solved` of a hypothesis without jumps."""
    y = np.where(np.isnan(scene.y), 0.0, scene.y)
    observed = 1.0 - np.isnan(scene.y)
    X = np.vstack([np.ones_like(y), *(s.columns.T for s in signatures)])
    var = np.concatenate([[max(h.bias_sigma, 1e-9)**2],
                          *(np.full(s.columns.shape[1], s.sd**2) for s in signatures)])
    v = _nodes(h, scene.dt, theta)
    w, steps, log_det = _adjoint(np.vstack([y, X]), observed, *v[:4])
    M, c, N = w.shape
    product = _products(w.reshape(-1, N), np.vstack([X, y])).reshape(M, c, c)
    A = np.diag(1.0 / var) + product[:, 1:, :-1]
    cov = np.linalg.inv(A)
    b = product[:, 0, :-1]
    size = np.einsum("mij,mj->mi", cov, b)
    chi2 = product[:, 0, -1] - (b * size).sum(1)
    base = -0.5 * (observed.sum() * LOG_2PI + log_det + np.log(var).sum()
                   + np.linalg.slogdet(A)[1] + chi2)
    residual = w[:, 0] - np.einsum("mj,mji->mi", size, w[:, 1:])
    return Solved(base, residual, w[:, 1:], cov, steps, size)


def _from_columns(columns, psi, quadratic, solved):
    """Scan of explicit (m, k, N) signatures; quadratic (M, m, k, k) = s' C^-1 s."""
    m, k, N = columns.shape
    flat = columns.reshape(-1, N)
    M, c = solved.w.shape[:2]
    cross = _products(solved.w.reshape(-1, N), flat).reshape(M, c, m, k)
    J = quadratic - np.einsum("mcak,mcd,mdal->makl", cross, solved.cov, cross)
    number = _products(solved.residual, flat).reshape(-1, m, k)
    if k == 1:
        J = np.maximum(J[..., 0, 0], 1e-300)
        number = number[..., 0]
        return Scan(psi, number**2 / J, number / J, 1.0 / np.sqrt(J), 1)
    J += 1e-9 * np.trace(J, axis1=2, axis2=3)[..., None, None] * np.eye(k)
    part = np.linalg.solve(J, number[..., None])[..., 0]
    return Scan(psi, (number * part).sum(-1), np.sqrt((part**2).sum(-1)),
                np.sqrt(k / np.trace(J, axis1=2, axis2=3)), k)


def _quadratic(h, scene, columns, theta):
    """s' C^-1 s (M, m, k, k) of (m, k, N) columns, by polarization through the bank."""
    m, k, N = columns.shape
    gap = np.isnan(scene.y)
    flat = [columns[:, i] for i in range(k)]
    if k == 2:
        flat.append(columns[:, 0] + columns[:, 1])
    flat = np.where(gap, np.nan, np.concatenate(flat))
    chi2 = next(filter_bank(bank(h, scene.dt, theta), flat, [N])).chi2
    chi2 = np.moveaxis(chi2.reshape(-1, m, len(theta)), 2, 1)
    if k == 1:
        return chi2[0, :, :, None, None]
    cross = 0.5 * (chi2[2] - chi2[0] - chi2[1])
    return np.moveaxis(np.array([[chi2[0], cross], [cross, chi2[1]]]), (0, 1), (-2, -1))


PADDING = 4    # frequencies per 1 / T


def _scan_steps(solved, scene):
    size, J = _step_sizes(solved.residual, solved.w, solved.cov, solved.steps)
    return Scan(scene.time[1:], size * size * J, size, 1.0 / np.sqrt(J), 1)


@njit(parallel=True, **JIT)
def _step_sizes(residual, w, cov, steps):
    """Least-squares size of a step at samples 1 ... N - 1, and its information, of the
    parts of `Solved`: (M, N - 1) each.
    """
    M, C, N = w.shape
    size, information = np.empty((M, N - 1)), np.empty((M, N - 1))
    for node in prange(M):
        number, cross = 0.0, np.zeros(C)
        least = 1e-9 * steps[node].max()    # after the last sample seen there is none
        for i in range(N - 1, 0, -1):
            number += residual[node, i]
            J = steps[node, i]
            for c in range(C):
                cross[c] += w[node, c, i]
            for c in range(C):
                for d in range(C):
                    J -= cross[c] * cov[node, c, d] * cross[d]
            J = max(J, 1e-6 * steps[node, i] + least)
            size[node, i - 1], information[node, i - 1] = number / J, J
    return size, information


@njit(parallel=True, **JIT)
def _line_gains(line, turn, count, a, q, r):
    """Gain, amplitude and its standard error (M, m) of sinusoids.

    line (M, m) complex, the transform of C^-1 y; turn (m,) = |1 - exp(-i w)|^2. The
    information of a sinusoid is count / 2 over the spectrum of the model, averaged over
    the two levels that its white noise r (M, 1 or N) may have.
    """
    M, m = line.shape
    gain, size, sd = np.empty((M, m)), np.empty((M, m)), np.empty((M, m))
    for node in prange(M):
        low, high = r[node, 0], r[node, -1]
        share = (r[node].mean() - low) / (high - low) if high != low else 0.0
        for j in range(m):
            S = 0.0
            for s in range(a.shape[1]):
                S += q[node, s] / ((1.0 - a[node, s])**2 + a[node, s] * turn[j])
            J = 0.5 * count * ((1.0 - share) / (S + low) + share / (S + high))
            square = line[node, j].real**2 + line[node, j].imag**2
            gain[node, j] = square / J
            size[node, j] = np.sqrt(square) / J
            sd[node, j] = 1.0 / np.sqrt(J)
    return gain, size, sd


def _scan_frequencies(h, solved, scene, theta):
    n, v = PADDING * len(scene.y), _nodes(h, scene.dt, theta)
    keep = slice(CYCLES * PADDING, -PADDING)
    frequency = np.fft.rfftfreq(n, scene.dt)[keep]
    line = np.fft.rfft(solved.residual, n)[:, keep]
    turn = 2.0 - 2.0 * np.cos(2.0 * np.pi * frequency * scene.dt)
    return Scan(frequency, *_line_gains(line, turn, np.sum(~np.isnan(scene.y)), v.a,
                                        v.q, v.r), 2)


class Search(NamedTuple):
    """One effect on one column: the signatures to be tried."""

    effect: Effect
    column: str            # "" where none is needed
    psi: np.ndarray        # (m,)
    variant: tuple         # (m,)
    columns: np.ndarray    # (m, k, N); None for onsets and frequencies


STEPS = 16    # values of a psi that is neither onset nor frequency


def searches(scene, effects, signatures=()):
    """What there is to be searched for in a scene."""
    found = {(s.effect.name, s.column) for s in signatures}
    result = []
    for e in effects:
        if e.kind != "signature":
            continue
        columns = {"": None}
        if e.column:
            own = {c.column for c in CATALOGUE.values()}
            columns = {name: x for name, x in scene.columns.items()
                       if (name == e.column or e.column == "*" and name not in own)
                       and np.std(x) > 0.0}
        for name in columns:
            if (e.name, name) in found and e.build not in (_step, _sinusoid):
                continue
            if e.build in (_step, _sinusoid):
                result.append(Search(e, name, None, None, None))
                continue
            psi = [np.nan]
            for p in e.parameters(scene):
                psi = np.geomspace(p.low, p.high, STEPS)
            result.append(_search(scene, e, name, psi))
    return [r for r in result if r.columns is None or len(r.columns)]


def _search(scene, effect, column, psi):
    """`Search` of explicit signatures at the given psi."""
    x = scene.columns.get(column)
    parts = [(value, *part) for value in psi for part in effect.build(scene, x, value)
             if np.any(part[1])]
    if any(p[2].shape not in ((len(scene.y), 1), (len(scene.y), 2)) for p in parts):
        raise ValueError(f"effect {effect.name} builds columns of shape "
                         f"{sorted({p[2].shape for p in parts})}: "
                         f"({len(scene.y)}, 1) or ({len(scene.y)}, 2) are needed")
    return Search(effect, column, np.array([p[0] for p in parts]),
                  tuple(p[1] for p in parts), np.array([p[2].T for p in parts]))


def scan(h, scene, signatures, search, theta, solved):
    """`Scan` of one search, or of several by the generic way."""
    if search.effect.build is _step:
        return _scan_steps(solved, scene)
    if search.effect.build is _sinusoid:
        return _scan_frequencies(h, solved, scene, theta)
    return _from_columns(search.columns, search.psi,
                         _quadratic(h, scene, search.columns, theta), solved)


def signature_evidence(h, scene, signatures, list_of_searches, guess=None,
                       table_of=None):
    """Sample of a hypothesis with no further signature, and with each of a list.

    table_of : dict of ln B against `_ROOT` for one and two sizes, by default _TABLE.
    """
    table_of = _TABLE if table_of is None else table_of
    explicit = [s for s in list_of_searches if s.columns is not None]

    def all_of(theta):
        parts = np.array_split(theta, -(-len(theta) * len(scene.y) // NODE_BLOCK))
        return np.vstack([log_likelihood_of(part) for part in parts if len(part)])

    def log_likelihood_of(theta):
        solved = solve(h, scene, signatures, theta)
        table = [solved.base]
        quadratic = iter(())
        if explicit:
            together = np.concatenate([s.columns for s in explicit])
            split = np.cumsum([len(s.columns) for s in explicit])[:-1]
            quadratic = iter(np.split(_quadratic(h, scene, together, theta), split, 1))
        for s in list_of_searches:
            result = (scan(h, scene, signatures, s, theta, solved) if s.columns is None
                      else _from_columns(s.columns, s.psi, next(quadratic), solved))
            table.append(solved.base + _mean_bayes(
                np.ascontiguousarray(result.gain), table_of[result.k], 1.0 / _ROOT[1]))
        return np.column_stack(table)
    return integrate(all_of, h.parameters, guess, onset_law(h, scene, signatures))


# ---- what readings hide is seen in the values themselves

class Reading(NamedTuple):
    """An effect of the reading that a record shows."""

    effect: str
    value: dict          # lsb, limits or spans
    log_bayes: float     # a continuous simulator never repeats a value
    masked: np.ndarray   # (N,) samples that say nothing of the rest
    opaque: bool         # it hides what else there may be


COINCIDENCE = 23.0    # nats: what one repeated value in double precision is worth,
                      # about ln(1e10 distinguishable values in the noise)
COARSE = 0.1          # of the white noise: a finer lattice is how a file was printed
HIDDEN = 0.05         # of the samples: more clipped ones are not missing at random, as
                      # the filters assume; nor is rounding by more than the noise a
                      # white noise of its own (B. Widrow, I. Kollar, "Quantization
                      # Noise", 2008)


def readings(scene):
    """Quantization, saturation and stuck samples of a record, as a tuple of Reading."""
    y, N, found = scene.y, len(scene.y), []
    seen = y[~np.isnan(y)]
    lsb, noise = lattice_and_noise(y)
    # saturation: the last value is met far more often than a tail allows
    clipped, limits = np.zeros(N, bool), []
    for sign in (-1.0, 1.0):
        end = sign * np.max(sign * seen)
        before = np.sum(np.abs(y - (end - sign * lsb)) < 0.5 * lsb)
        full = np.sum(y == end) >= 3 + 2.0 * before + 6.0 * np.sqrt(before)
        limits.append(float(end) if full else sign * np.inf)
        clipped |= (y == end) & full
    # stuck: a run of equal values longer than chance; its first is a reading
    same = np.append(False, np.diff(y) == 0.0) & ~clipped
    start = np.flatnonzero(same & ~np.append(False, same[:-1]))
    length = np.flatnonzero(same & ~np.append(same[1:], False)) + 1 - start
    enough = 2
    if lsb:    # a value in the middle of its cell stays there by chance
        tie = math.erf(lsb / max(2.0 * np.sqrt(2.0) * noise, 1e-9 * lsb))
        enough = (max(2.0, np.log(1e-4 / N) / np.log(tie)) if lsb < 2.0 * noise
                  else np.inf)
    spans = [(begin - 1, n + 1) for begin, n in zip(start, length) if n >= enough]
    stuck = np.zeros(N, bool)
    for begin, n in spans:
        stuck[begin + 1:begin + n] = True
    if clipped.any():
        found.append(Reading("saturation", dict(limits=limits),
                             COINCIDENCE * clipped.sum(), clipped,
                             bool(clipped.mean() > HIDDEN)))
    if spans:
        spans = [[float(begin * scene.dt), int(n)] for begin, n in spans]
        found.append(Reading("stuck", dict(spans=spans), COINCIDENCE * stuck.sum(),
                             stuck, False))
    if lsb > COARSE * noise:
        found.append(Reading("quantization", dict(lsb=lsb), COINCIDENCE * N,
                             np.zeros(N, bool), bool(lsb > noise)))
    return tuple(found)


def without_readings(y, found):
    """Records (R, N) with NaN where a reading says nothing more of the true value."""
    y = y.copy()
    for r in found:
        if r.effect == "saturation":
            y[(y <= r.value["limits"][0]) | (y >= r.value["limits"][1])] = np.nan
        elif r.effect == "stuck":
            y[:, r.masked] = np.nan
    return y


def with_quantization(h, lsb):
    """Hypothesis whose white noise includes that of rounding, lsb^2 / 12."""
    def model(dt, **values):
        filt = h.model(dt, **values)
        return filt._replace(Psi=np.sqrt(filt.Psi**2 + lsb**2 / 12.0))
    return h._replace(model=model)


# ---- which: one more effect at a time

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


class Cause(NamedTuple):
    """An effect as the explanation of a record."""

    effect: str
    column: str         # "a or b" where columns are alike
    probability: float
    log_bayes: float
    parameters: dict    # name -> (mean, sd)


class Step(NamedTuple):
    """One look for a further effect."""

    causes: tuple      # of Cause, most probable first, "none" among them
    account: Account   # with the most probable effect in it; None where it is "none"


LISTED = 0.01       # probability from which on a cause is worth its parameters
PRIOR_NONE = 0.5    # that nothing is missing
PRIOR_LAST = 0.75   # that nothing more is: a second effect is half as likely as a first


def look(scene, acc, effects, processes=True):
    """`Step`: probability of every further effect, Eq. (10), and the best account.

    Without `processes`, for signatures and jumps alone.
    """
    plain, hypotheses = _gaussian(scene, acc)
    reference = acc if plain is scene else account(
        plain, hypotheses, signatures=acc.signatures)
    tries = searches(plain, effects, acc.signatures)
    samples = [signature_evidence(h, plain, acc.signatures, tries,
                                  _guess(reference, number))
               for number, h in enumerate(hypotheses)]
    table = np.array([s.log_evidence for s in samples])
    log_bayes, accounts, parameters = {}, {}, {}

    def enter(name, new, old, values):
        """A richer account: where in its ranges the base lies is no evidence against
        it, so ln B is no more than the likelihood ratio less Akaike's correction.
        """
        more = max(len(free_columns(h.parameters)) - len(free_columns(o.parameters))
                   for h, o in zip(new.hypotheses, old.hypotheses))
        log_bayes[name] = min(new.log_evidence - old.log_evidence,
                              new.peak - old.peak - max(more, 1))
        accounts[name], parameters[name] = new, values
    base = _mean_evidence(table[:, 0])
    for number, t in enumerate(tries):
        log_bayes[t.effect.name, t.column] = (
            _mean_evidence(table[:, 1 + number]) - base)
    for e in effects:
        start, at = (reference, plain) if e.kind == "process" else (acc, scene)
        if not processes and e.kind != "jumps":
            continue
        if e.kind in ("process", "jumps") and _fits(e, acc, scene):
            new = account(at, acc.bases, [extend(at, h, e) for h in start.hypotheses],
                          acc.signatures, acc.readings, start,
                          start.log_evidence + HOPELESS)
            enter((e.name, ""), new, start, _account_parameters(e.name, new))
        elif e.kind == "parameter":
            for p, new, factor in wrong_parameters(scene, acc):
                enter((e.name, p), new, acc, dict(parameter=(p, 0.0), factor=factor))
    names = list(log_bayes)
    first = not (acc.signatures or acc.readings or acc.hypotheses[0].parameters
                 != acc.bases[0].parameters)
    alone = PRIOR_NONE if first else PRIOR_LAST
    share = np.array([_share(acc, *name) for name in names])
    probability = probabilities([np.log(alone), *(
        np.log((1.0 - alone) * share / share.sum())
        + [log_bayes[name] for name in names])])
    # columns are rivals in where an effect comes from, not in what it is
    own = {}
    for i in np.argsort(-probability[1:]):
        own.setdefault(names[i][0], []).append(i)
    total = {effect: float(probability[1:][i].sum()) for effect, i in own.items()}
    best = names[own[max(total, key=total.get)][0]] if own else None
    estimates = {}
    for number, t in enumerate(tries, 1):
        name = t.effect.name, t.column
        if name == names[own[name[0]][0]] and (
                total[name[0]] > LISTED or name == best):
            estimates[name], parameters[name] = estimate_signature(
                hypotheses, plain, acc.signatures, t, samples, number)
    chosen = None
    if probability[0] < 0.5:
        if best in accounts:
            chosen = accounts[best]
            effect = next(e for e in effects if e.name == best[0])
            if plain is not scene and effect.kind == "process":
                chosen = account(scene, acc.bases, [
                    extend(scene, h, effect) for h in acc.hypotheses],
                    acc.signatures, acc.readings, acc)
        else:
            chosen = account(scene, acc.bases, acc.hypotheses,
                             (*acc.signatures, estimates[best]), acc.readings, acc)
        if plain is not scene and (
                chosen.log_evidence - acc.log_evidence < np.log(len(names))):
            # what stood in for the jumps misled: the filter with jumps sees nothing
            return look(scene, acc, [e for e in effects if e.name != best[0]],
                        processes)
    causes = [Cause(effect, "" if effect == "wrong_parameter" else _either(
                        [names[i][1] for i in rivals if
                         probability[1 + i] > 0.1 * probability[1 + rivals[0]]]),
                    total[effect], float(log_bayes[names[rivals[0]]]),
                    parameters.get(names[rivals[0]], {}))
              for effect, rivals in own.items()]
    causes.append(Cause("none", "", float(probability[0]), 0.0, {}))
    causes.sort(key=lambda c: -c.probability)
    return Step(tuple(causes), chosen)


def _either(columns):
    """Columns of which any may be the cause, as text."""
    return " or ".join(columns if len(columns) <= 3 else
                       [*columns[:2], f"{len(columns) - 2} others"])


def _share(acc, effect, symbol):
    """Prior of an effect, relative to others: ranges are seldom wrong, numbers often.
    """
    ranged = effect == "wrong_parameter" and all(
        p.free for h in acc.hypotheses for p in h.parameters if p.symbol == symbol)
    return 0.1 if ranged else 1.0


def _fits(effect, acc, scene):
    """Is there room for a process or jumps that are not there yet?"""
    symbols = [p.symbol for p in acc.hypotheses[0].parameters]
    if any(s.startswith(effect.name + ".") for s in symbols):
        return False
    more = dict(bias_instability=len(flicker_times(scene))).get(
        effect.name, effect.kind == "process")
    return max(_states(h, scene.dt) for h in acc.hypotheses) + more <= 6


def _states(h, dt):
    return bank(h, dt, [[p.mean for p in h.parameters]]).m0.shape[1]


def _account_parameters(effect, acc):
    """Mean and standard deviation of an effect's parameters over all hypotheses."""
    share = probabilities([s.log_evidence[0] for s in acc.samples])
    symbols = [p.symbol for p in acc.hypotheses[0].parameters
               if p.symbol.startswith(effect + ".")]
    result = {}
    for symbol in symbols:
        first = second = 0.0
        for h, sample, part in zip(acc.hypotheses, acc.samples, share):
            value = _value(h, sample.theta, symbol)
            first += part * sample.weight @ value
            second += part * sample.weight @ value**2
        result[symbol.split(".")[1]] = (float(first),
                                        float(np.sqrt(max(second - first**2, 0.0))))
    return result


OFF = 1000.0    # a wrong parameter is wrong by less than this factor


def wrong_parameters(scene, acc):
    """Accounts in which one parameter of the simulator may leave its bounds.

    A range is left alone unless the record pushes against one of its ends.
    """
    for symbol in dict.fromkeys(p.symbol for h in acc.hypotheses for p in h.parameters
                                if "." not in p.symbol):
        pushed, new = False, []
        for h, sample in zip(acc.hypotheses, acc.samples):
            symbols = [p.symbol for p in h.parameters]
            if symbol not in symbols or h.parameters[symbols.index(symbol)].high <= 0.0:
                new.append(h)
                continue
            at = symbols.index(symbol)
            p, value, w = h.parameters[at], sample.theta[:, at], sample.weight
            mean = w @ value
            sd = np.sqrt(w @ (value - mean)**2)
            near = min(mean - p.low, p.high - mean) < 2.0 * sd and sd < 0.2 * p.sd
            pushed |= near or not p.free
            wide = Parameter(symbol, (p.low or 1e-3 * p.high) / OFF, p.high * OFF, True)
            new.append(h._replace(parameters=(
                *h.parameters[:at], wide, *h.parameters[at + 1:])))
        if pushed:
            wide = account(scene, acc.bases, new, acc.signatures, acc.readings)
            yield symbol, wide, _factor(symbol, acc, wide)


def _factor(symbol, acc, wide):
    """A parameter over what the simulator has, or its nearest end: mean, sd."""
    symbols = [p.symbol for p in wide.hypotheses[wide.best].parameters]
    if symbol not in symbols:
        return 1.0, 0.0
    at = symbols.index(symbol)
    p, sample = acc.hypotheses[wide.best].parameters[at], wide.samples[wide.best]
    value = sample.theta[:, at]
    mean = sample.weight @ value
    sd = np.sqrt(sample.weight @ (value - mean)**2)
    reference = np.clip(mean, p.low, p.high) or 1.0
    return float(mean / reference), float(sd / reference)


def estimate_signature(hypotheses, scene, signatures, search, samples, number):
    """The most probable signature of a search, and its parameters with their sd.

    Moments over hypotheses, `RESAMPLED` nodes of each, psi and prior variances of the
    size.
    """
    pieces, chosen, most = [], None, 0.0
    shrink = SIZES / (1.0 + SIZES)
    shares = probabilities([s.log_evidence[number] for s in samples])
    for h, sample, share in zip(hypotheses, samples, shares):
        if share < 1e-3:
            continue
        w = sample.log_weight + sample.log_likelihood[:, number]
        theta = sample.theta[_resampled(np.exp(w - w.max()))]
        solved = solve(h, scene, signatures, theta)
        result = scan(h, scene, signatures, search, theta, solved)
        variant = search.variant or ("",) * len(result.psi)
        fine = _refined(scene, search, result)
        if fine is not None:
            result = _from_columns(fine.columns, fine.psi,
                                   _quadratic(h, scene, fine.columns, theta), solved)
            variant = fine.variant
        near = np.flatnonzero(result.gain.max(0) > result.gain.max() - 60.0)
        each = _log_bayes(result.gain[:, near], result.k)    # (M, m, sizes)
        mass = np.exp(each - logsumexp(each, axis=(1, 2), keepdims=True))
        mass *= share / RESAMPLED
        # moments along the estimate of the normal law times its squared size
        k, square = result.k, (result.size[:, near, None] * shrink)**2
        var = result.sd[:, near, None]**2 * shrink
        mean = result.size[:, near, None] * shrink * (
            (square + (k + 2) * var) / (square + k * var))
        second = (square**2 + (k + 5) * square * var + (k + 2) * var**2) / (
            square + k * var)
        pieces.append((mass, mean, second,
                       np.broadcast_to(result.psi[near][:, None], mass.shape),
                       np.array(variant)[near]))
        if mass.sum((0, 2)).max() > most:
            most = mass.sum((0, 2)).max()
            best = near[mass.sum((0, 2)).argmax()]
            chosen = float(result.psi[best]), variant[best]

    # the sizes of different variants have different units
    pieces = [[part[:, p[4] == chosen[1]] for part in p[:4]] for p in pieces]

    def expected(values):
        return (sum((p[0] * v).sum() for p, v in zip(pieces, values))
                / sum(p[0].sum() for p in pieces))
    size = expected([p[1] for p in pieces])
    sd = np.sqrt(max(expected([p[2] for p in pieces]) - size**2, 0.0))
    parameters = {search.effect.size: (float(size), float(sd))}
    for p in search.effect.parameters(scene):
        psi = expected([p[3] for p in pieces])
        spread = np.sqrt(expected([(p[3] - psi)**2 for p in pieces]))
        parameters = {p.symbol: (float(psi), float(spread)), **parameters}
    x = scene.columns.get(search.column)
    columns = next(c for v, c in search.effect.build(scene, x, chosen[0])
                   if v == chosen[1])
    return Signature(search.effect, search.column, chosen[1], chosen[0], columns,
                     3.0 * float(np.hypot(size, sd))), parameters


RESAMPLED = 24    # nodes that stand for a posterior


def _resampled(weight):
    """Numbers of RESAMPLED nodes, at even quantiles of their weights."""
    w = np.cumsum(weight)
    return np.searchsorted(w, w[-1] * (np.arange(RESAMPLED) + 0.5) / RESAMPLED)


def _refined(scene, search, result):
    """The search again, finer where a coarse scan found mass; None for onsets."""
    if search.effect.build is _step or not search.effect.parameters(scene):
        return None
    mass = np.exp(0.5 * (result.gain - result.gain.max())).sum(0)
    near = np.flatnonzero(mass > 1e-4 * mass.max())
    low, high = result.psi[max(near[0] - 1, 0)], result.psi[
        min(near[-1] + 1, len(result.psi) - 1)]
    if search.effect.build is _sinusoid:
        top = result.psi[mass.argmax()]
        low, high = max(low, top - 1.0 / scene.duration), min(
            high, top + 1.0 / scene.duration)
        psi = np.linspace(low, high, 81)
    else:
        psi = np.geomspace(low, high, 40)
    return _search(scene, search.effect, search.column, psi)


# ---- where: statistics of the record, beside those of records of the fitted simulator

class Statistics(NamedTuple):
    """S statistics of R records, and where each of them looks."""

    value: np.ndarray    # (R, S)
    place: tuple         # (S,) one of PLACES
    at: np.ndarray       # (S, 2) in the unit of the place
    column: tuple        # (S,) of a covariate, else ""
    least: np.ndarray    # (S,) standard deviation that each has at least


FAR = 40.0    # standard deviations: no normal score lies further out
PLACES = "time", "frequency", "averaging_time", "lag", "amplitude", "covariate"
UNITS = dict(time="s", frequency="Hz", averaging_time="s", lag="s",
             amplitude="sigma", covariate="")


def _normal_tail(log_p):
    """Normal score of a small probability given by its logarithm."""
    return -ndtri_exp(np.minimum(log_p, -1e-12))


def _chi2_score(total, n):
    """Normal score of a chi2 of n degrees of freedom (Wilson and Hilferty)."""
    return ((total / n)**(1 / 3) - 1.0 + 2.0 / (9.0 * n)) / np.sqrt(2.0 / (9.0 * n))


def _largest_score(log_tail, n):
    """Normal score of the largest of n, whose own tail probability is given."""
    none = n * np.log1p(-np.exp(np.minimum(log_tail, -1e-12)))
    return _normal_tail(np.where(log_tail < -20.0, log_tail + np.log(n),
                                 np.log(-np.expm1(none) + 1e-300)))


def _count_score(n, expected):
    """Normal score of a Poisson count, in the middle of its probability."""
    more, as_many = gammainc(n + 1.0, expected), gammainc(np.maximum(n, 0.5), expected)
    return -ndtri(np.maximum(0.5 * (more + np.where(n > 0, as_many, 1.0)), 1e-300))


SMOOTH = 5    # degree of the polynomials in a column: thermal models are of the third
FEW = 5       # columns at most whose products are looked at: of more there are too many


def probes(scene):
    """Columns (S, N) that residuals are held against: shifts, and the covariates."""
    N = len(scene.y)
    result = [("time", (scene.time[i], scene.time[-1]), "",
               (np.arange(N) >= i).astype(float))
              for i in np.linspace(0, N, 34).astype(int)[1:-1]]
    scaled = {name: 2.0 * (x - x.min()) / np.ptp(x) - 1.0
              for name, x in scene.columns.items() if np.ptp(x) > 0.0}
    curves = []
    for name, x in scaled.items():
        moved = np.append(0.0, np.diff(x))
        curves += [(name, f) for f in (*np.polynomial.legendre.legvander(
            x, SMOOTH).T[1:], moved, np.sign(moved))]    # the sign: hysteresis
    if len(scaled) <= FEW:    # what one column does may depend on another
        curves += [(name, x * z) for (name, x), (_, z) in itertools.combinations(
            (*scaled.items(), ("", scene.time / scene.time[-1] - 0.5)), 2)]
    for name, f in curves:
        if np.ptp(f) > 0.0:
            x = scene.columns[name]
            result.append(("covariate", (x.min(), x.max()), name, f - f.mean()))
    return result


def statistics(z, y, scene, white):
    """Statistics of residuals z (R, N), which are N(0, 1) and white if all is well.

    y (R, N) are the records themselves; white (S, N) whitened probes of unit norm.
    """
    R, N = z.shape
    value, where = [], []

    def put(place, low, high, column, statistic, least=1e-3):
        where.append((place, low, high, column, least))
        value.append(statistic)
    seen = ~np.isnan(z)
    z0 = np.where(seen, z, 0.0)
    count = np.maximum(seen.sum(1), 1)
    dt = scene.dt
    segments = int(np.clip(N // 64, 2, 16))
    for part in np.array_split(np.arange(N), segments):
        n = np.maximum(seen[:, part].sum(1), 1)
        ends = scene.time[part[0]], scene.time[part[-1]]
        put("time", *ends, "", z0[:, part].sum(1) / np.sqrt(n))
        put("time", *ends, "", _chi2_score((z0[:, part]**2).sum(1), n))
    listed = probes(scene)
    for (place, ends, column, _), statistic in zip(listed, _products(white, z0)):
        put(place, *ends, column, statistic)

    power = np.abs(np.fft.rfft(z0))**2 / count[:, None]
    frequency = np.fft.rfftfreq(N, dt)
    edges = np.unique(np.round(np.geomspace(1, len(frequency), 14)).astype(int))
    for low, high in zip(edges[:-1], edges[1:]):
        band = power[:, low:high]
        ends = frequency[low], frequency[high - 1]
        n = high - low
        put("frequency", *ends, "", _chi2_score(2.0 * band.sum(1), 2 * n))
        at = low + band.argmax(1)[0]
        put("frequency", frequency[at], frequency[at], "",
            _largest_score(-band.max(1), n))

    for part in np.array_split(np.arange(N), int(np.clip(N // 256, 1, 12))):
        # what is stationary in the mean need not be at any one time
        power = np.abs(np.fft.rfft(z0[:, part]))**2 / np.maximum(
            seen[:, part].sum(1), 1)[:, None]
        ends = scene.time[part[0]], scene.time[part[-1]]
        put("time", *ends, "", _largest_score(-power[:, 1:].max(1), len(power[0]) - 1))
        for band in np.array_split(power[:, 1:], 4, axis=1):
            put("time", *ends, "", _chi2_score(2.0 * band.sum(1), 2 * band.shape[1]))

    m = 2**np.arange(int(np.log2(max(N // 3, 1))) + 1)
    for k in m:
        put("averaging_time", k * dt, k * dt, "",
            0.5 * np.log(allan_variance(y, dt, k) + 1e-300))

    size = np.abs(z0) - np.sqrt(2.0 / np.pi)
    size = np.where(seen, np.minimum(size, 5.0), 0.0)
    for k in (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64):
        if k < N // 4:
            for x in (z0, size):
                put("lag", k * dt, k * dt, "", np.einsum(
                    "ri, ri -> r", x[:, k:], x[:, :-k]) / np.sqrt(count))

    u, classes = ndtr(z0), 12
    at = np.minimum((classes * u).astype(int), classes - 1)
    inside = np.bincount((at + classes * np.arange(R)[:, None])[seen],
                         minlength=classes * R).reshape(R, classes)
    edges = np.clip(ndtri(np.linspace(0, 1, classes + 1)), -FAR, FAR)
    for low, high, number in zip(edges[:-1], edges[1:], inside.T):
        put("amplitude", low, high, "", number / np.sqrt(count / classes))
    # smooth departures from the predicted law (Neyman): the mean of cos(k pi u)
    last, one = np.where(seen, 1.0, 0.0), np.where(seen, np.cos(np.pi * u), 0.0)
    twice, this = 2.0 * one, one
    for _ in range(8):
        put("amplitude", -FAR, FAR, "", this.sum(1) / np.sqrt(0.5 * count))
        last, this = this, twice * this - last
    for low, high in ((-FAR, -3.0), (3.0, FAR), (-FAR, -4.0), (4.0, FAR)):
        inside = ((z0 >= low) & (z0 < high)).sum(1)
        expected = count * ndtr(-min(abs(low), abs(high)))
        # most counts are 0: their own spread would make a single one stand out
        put("amplitude", low, high, "", _count_score(inside, expected), least=1.0)
    largest = np.abs(z0).max(1)
    put("amplitude", largest[0], FAR, "",
        _largest_score(np.log(2.0) + log_ndtr(-largest), count))
    put("amplitude", -FAR, FAR, "", (np.clip(z0, -5, 5)**3).sum(1) / np.sqrt(count))
    put("amplitude", -FAR, FAR, "", np.abs(z0).sum(1) / np.sqrt(count))
    put("amplitude", 0.0, 0.0, "", (np.diff(y) == 0.0).sum(1).astype(float), least=1.0)

    spread = np.where(seen, z0**2 - 1.0, 0.0).clip(-1.0, 25.0)
    for name, x in scene.columns.items():
        if np.std(x) > 0.0:
            for f in (x, np.abs(x - x.mean())):
                f = (f - f.mean()) / (f.std() + 1e-300)
                put("covariate", x.min(), x.max(), name,
                    _products(spread, f[None])[:, 0] / np.sqrt(count))
    return Statistics(np.column_stack(value), tuple(w[0] for w in where),
                      np.array([w[1:3] for w in where], float),
                      tuple(w[3] for w in where), np.array([w[4] for w in where]))


class Gap(NamedTuple):
    """Distance of a record from the records of a fitted simulator."""

    statistics: Statistics    # of the record
    distance: np.ndarray      # (S,) in standard deviations
    null: np.ndarray          # (B, S) the same of the simulated records
    p_place: dict             # place -> p-value
    p_value: float            # of the whole
    theta: np.ndarray         # parameters at which they were simulated
    z: np.ndarray             # (N,) normal scores of the record
    log_score: np.ndarray     # (N,) ln of its one-step-ahead densities

    def rms(self, where=slice(None)):
        """Root mean square of some distances; about 1 where nothing is missing."""
        return float(np.sqrt(np.mean(self.distance[where]**2)))


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


TRIALS = 199    # simulated records behind every p-value; half of them for a record
MANY = 20000    # of more samples than this


def distance(scene, acc, trials=None, seed=0, first=0):
    """`Gap` of a record to the simulator of an account, put through the same fit.

    The record and `trials` simulated ones are filtered at the posterior mean. Refitting
    each would change a statistic by its regression on the score, the derivative of the
    log-likelihood to the parameters; that is taken away instead, for all alike.

    With `first`, of the samples from that one on, which had no part in the fit: nothing
    is taken away, but the simulated records have parameters drawn from the posterior.
    """
    h, sample, theta = acc.hypotheses[acc.best], acc.samples[acc.best], acc.theta
    trials = trials or (TRIALS if len(scene.y) <= MANY else TRIALS // 2)
    free = [] if first else free_columns(h.parameters)
    symbols = [p.symbol for p in h.parameters]
    step = 0.5 * np.sqrt(sample.weight @ (sample.theta - theta)**2)
    step = np.where(theta + step < [p.high for p in h.parameters], step, -step)
    shifted = theta + np.diag(step)[free]
    own = without_readings(scene.y[None], acc.readings)
    fitted, late = scene._replace(y=own[0]), scene
    if first:
        fitted = scene._replace(y=np.append(own[0, :first], np.full(
            len(scene.y) - first, np.nan)))
        late = Scene(scene.y[first:], scene.dt,
                     {name: x[first:] for name, x in scene.columns.items()})
    lsb, noise = lattice_and_noise(scene.y)
    printed = lsb if lsb <= COARSE * noise else 0.0

    def simulator(*thetas):
        """Hypotheses with numbers for parameters, and the effects of each."""
        return tuple(zip(*(as_simulated(acc, fitted, one) for one in thetas)))

    def drawn(simulator, trials, seed, number=0):
        """Records of the simulator as they are read, and less what says nothing."""
        read = simulate_effects(*simulator, scene, trials, seed, number).error
        if printed:    # to so many digits, finer than would be an effect
            _quantize(scene, read, dict(lsb=printed))
        return read, without_readings(read, acc.readings)

    def predicted(masked):
        return predict(h, scene, acc.signatures, theta[None], masked)

    def scores(masked, middle=None):
        """Gains of a step in every parameter; `middle` is the filter at theta."""
        if not free:
            return np.zeros((len(masked), 0))
        nodes = shifted if middle else np.vstack([shifted, theta])
        ll = _filtered(h, scene, acc.signatures, nodes, masked, 0)[0]
        return ll - middle.log_likelihood if middle else ll[:, :-1] - ll[:, -1:]
    truth = theta.copy()
    if free and (acc.readings or "random_telegraph.size" in symbols):
        # the fit ignores what rounding and clipping do beyond a further white noise,
        # and a telegraph's history: simulate at the parameters whose records give this
        # fit (indirect inference; C. Gourieroux, A. Monfort, E. Renault, J. Appl.
        # Econometrics 8, 1993); what the record does not tell, the prior keeps in place
        cov = np.atleast_2d(np.cov((sample.theta[:, free] / step[free]).T, ddof=0,
                                   aweights=sample.weight))
        for attempt in range(4):
            masked = drawn(simulator(truth), 48, seed + 100 + attempt)[1]
            s = scores(np.vstack([own, masked]))
            told = np.cov(s[1:].T).reshape(len(free), -1)
            away = (truth - theta)[free] / step[free]
            move = cov @ (s[0] - s[1:].mean(0) + told @ away) - away
            length = np.sqrt(move @ np.linalg.pinv(cov) @ move)    # standard deviations
            truth[free] = np.maximum(
                truth[free] + move * step[free] / max(length, 1.0), 0.5 * truth[free])
    white = _whitened_probes(acc, scene, own[0], late)
    real = predicted(own)
    z = real.z[:, 0]
    stats = statistics(z[:, first:], late.y[None], late, white)
    T, s = [stats.value], [scores(own, real)]
    fixed = simulator(*(sample.theta[_resampled(sample.weight)] if first else [truth]))
    block = int(np.clip(BLOCK // len(scene.y), 1, trials))
    for number in range(0, trials, block):
        read, masked = drawn(fixed, min(block, trials - number), seed, number)
        part = predicted(masked)
        T.append(statistics(part.z[:, 0, first:], read[:, first:], late, white).value)
        s.append(scores(masked, part))
    T, s = np.vstack(T), np.vstack(s)
    usable = np.isfinite(T).all(0)    # no two clusters may be without a gap
    T = np.where(usable, T, 0.0)
    if free:
        s -= s[1:].mean(0)
        inverse = _inverse(s[1:])
        s[0] *= min(1.0, 3.0 / np.sqrt(max(s[0] @ inverse @ s[0], 1e-300)))
        T = T - s @ (inverse @ (s[1:].T @ (T[1:] - T[1:].mean(0))) / (trials - 1))
    sd = np.maximum(T[1:].std(0, ddof=1), stats.least + 1e-9 * np.abs(T[0]))
    d = (T - T[1:].mean(0)) / sd
    d = np.clip(d, -1e3, 1e3)
    places = np.array(stats.place)
    p_place = {place: _tail(np.abs(d[:, own]).max(1)) for place in PLACES
               for own in [(places == place) & usable] if own.any()}
    p_value = -np.expm1(len(p_place) * np.log1p(-min(p_place.values())))
    return Gap(stats._replace(value=T[0]), d[0], d[1:], p_place,
               float(max(p_value, 1e-15)), truth, z[0],
               real.log_score[0, 0])


def _inverse(scores):
    """Inverse covariance of scores (B, d); singular ones are left out."""
    return np.linalg.pinv(np.cov(scores.T).reshape(scores.shape[1], -1), rcond=1e-6)


def _whitened_probes(acc, scene, y, late):
    """`probes` of the end of a scene through the filter of an account without its
    jumps, of unit norm.

    The normal scores of a column far smaller than the noise are its innovations.
    """
    plain, hypotheses = _gaussian(scene._replace(y=y), acc)
    h = hypotheses[acc.best]
    values = dict(zip((p.symbol for p in acc.hypotheses[acc.best].parameters),
                      acc.theta))
    theta = np.array([[values[p.symbol] for p in h.parameters]])
    probe = np.array([p[3] for p in probes(late)])
    probe *= 1e-3 * scene.white / np.abs(probe).max(1)[:, None]
    first = len(y) - len(late.y)
    probe = np.where(np.isnan(y), np.nan, np.pad(probe, ((0, 0), (first, 0))))
    white = predict(h, scene, acc.signatures, theta, probe).z[:, 0, first:]
    white = np.where(np.isnan(white), 0.0, white)
    return white / (np.sqrt((white**2).sum(1))[:, None] + 1e-300)


def _tail(largest):
    """p-value of the first of several maxima among the others: Gumbel's law."""
    null = largest[1:]
    scale = np.std(null, ddof=1) * np.sqrt(6.0) / np.pi
    e = (largest[0] - np.mean(null)) / scale + np.euler_gamma
    return float(max(-np.expm1(-np.exp(-e)), 1e-15))


# ---- verdict

class Diagnosis(NamedTuple):
    """Answer of `diagnose`: where the gap lies, which effect causes it, how far it
    shrinks.
    """

    scene: Scene
    verdict: str             # an effect ("a+b" for two), none, unknown or undecided
    causes: tuple            # of Cause, most probable first; none and unknown are there
    base: Account            # the simulator as it was
    final: Account           # with the effects that were found
    found: tuple             # of Cause: these effects, in the order found
    before: Gap
    after: Gap
    rms_before: float        # of what stood out, standard deviations; 1 is no gap
    rms_after: float
    closed: float            # fraction of the gap; NaN where there was none
    closed_interval: tuple
    nats_per_sample: float   # gain of the one-step-ahead log score
    held_out: tuple          # HeldOut; None where nothing was found to foretell from
    needed_duration: float   # s; NaN unless undecided


PRIOR_UNKNOWN = 0.1     # that what is missing is in no catalogue
MISSING_NATS = 10.0     # mean of -ln p where something is missing: what can be named
SURE = 0.5              # what is named is more probable than not
OUTSTANDING = 0.05      # how often a record without a gap has what a gap is measured on
UNEXPECTED = 3.0        # standard deviations of the mean: a bias the simulator lacks
ROUNDING = 1e5          # a prior this much wider than the record tells nothing
LOOK_ON = 0.2           # p-value from which on no second process is looked for
MOST = 3                # effects beside readings, looked for one after another


def unknown_probability(p_value):
    """That something is still missing, from the p-value of what is left.

    -ln p is exponential: of mean 1 where nothing is missing, of mean MISSING_NATS
    where something is (T. Sellke, M. Bayarri, J. Berger, "Calibration of p values",
    Am. Stat. 55, 2001).
    """
    log_odds = (np.log(PRIOR_UNKNOWN / (1.0 - PRIOR_UNKNOWN) / MISSING_NATS)
                - (1.0 - 1.0 / MISSING_NATS) * np.log(p_value))
    return float(1.0 / (1.0 + np.exp(-log_odds)))


def diagnose(y, dt, hypotheses, columns=None, effects=None, trials=None, seed=0,
             progress=None):
    """Where a record differs from a simulator, which effect causes it, how far adding
    that effect closes the gap.

    Parameters
    ----------
    y : (N,) array
        Sensor error, u, evenly sampled; NaN marks a missing sample.
    dt : float
        Sampling interval, s.
    hypotheses : sequence of Hypothesis
        The simulator: it draws one of them with equal probability.
    columns : dict of (N,) arrays, optional
        What was recorded beside the error; `CATALOGUE` names what is looked for.
    effects : sequence of Effect, optional
        By default all of the catalogue.
    trials : int, optional
        Simulated records behind every p-value, by default TRIALS.
    seed : int
    progress : function of (done, all), optional

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError
        If the record is too short, constant or not finite, a column does not fit it,
        or a hypothesis is no sum of one-state processes.
    """
    y = np.asarray(y, float)
    columns = {name: np.asarray(x, float) for name, x in (columns or {}).items()}
    check_scene(y, dt, columns)
    if not hypotheses:
        raise ValueError("a simulator without a hypothesis: at least one is needed")
    effects = tuple(CATALOGUE.values() if effects is None else effects)
    full = scene = Scene(y, dt, columns)
    done = iter(range(1, 100))

    def tell(last=False):
        if progress:
            number = next(done)
            progress(MOST + 3 if last else number, MOST + 3)
    bases, mean = tuple(hypotheses), abs(float(np.nanmean(y)))
    # of two numbers in double precision, one must not drown the other
    most = ROUNDING * max(float(np.nanstd(y)), mean)
    bases = tuple(h._replace(bias_sigma=min(h.bias_sigma, most)) for h in bases)
    if mean > UNEXPECTED * expected_mean(bases, dt, len(y)):
        # a bias that the simulator does not expect must not pass for an effect
        bases = tuple(h._replace(bias_sigma=max(h.bias_sigma, mean)) for h in bases)
    base = acc = start = account(scene, bases)
    before = distance(scene, base, trials, seed)
    tell()

    known = readings(scene)
    found = [Cause(r.effect, "", 1.0, float(r.log_bayes),
                   {name: (v, 0.0) for name, v in r.value.items()}) for r in known]
    if known:
        scene = scene._replace(y=without_readings(y[None], known)[0])
        inner = bases
        for r in known:
            if r.effect == "quantization":
                inner = tuple(with_quantization(h, r.value["lsb"]) for h in inner)
        acc = start = account(scene, bases, inner, (), known)
    leaves, share = {}, 1.0    # every set of effects as a Cause; probability so far

    after = distance(full, acc, trials, seed + 1) if found else before
    while len(found) < len(known) + MOST and not any(r.opaque for r in known):
        # a process shows in the undirected statistics, if it is there; jumps may not
        step = look(scene, acc, effects, not found or after.p_value < LOOK_ON)
        tell()
        if step.account is not None:
            best = next(c for c in step.causes if c.effect != "none")
            leaves = _followed(leaves, step, best)
        for c in step.causes:
            listed = found if c.effect == "none" else [*found, c]
            one = _joined(listed, share * c.probability)
            if one.effect not in leaves or leaves[one.effect].probability < \
                    one.probability:
                leaves[one.effect] = one
        if step.account is None:
            break
        acc, found = step.account, [*found, best]
        after = distance(full, acc, trials, seed + 1)
        share *= best.probability
        leaves.pop(_joined(found, share).effect)
    else:
        one = _joined(found, share)
        leaves[one.effect] = one
    tell(last=True)

    # what stands out only beside an added effect speaks against that effect
    unknown = (PRIOR_UNKNOWN / MISSING_NATS if any(r.opaque for r in known)
               else unknown_probability(max(before.p_value, after.p_value)))
    total = sum(c.probability for c in leaves.values())
    causes = [c._replace(probability=float((1.0 - unknown) * c.probability / total))
              for c in leaves.values()]
    causes.append(Cause("unknown", "", unknown, 0.0, {}))
    if "none" not in leaves:
        causes.append(Cause("none", "", 0.0, 0.0, {}))
    causes.sort(key=lambda c: -c.probability)
    verdict = verdict_of(causes)
    gain = (acc.log_evidence - start.log_evidence) / max(np.sum(~np.isnan(scene.y)), 1)
    return Diagnosis(full, verdict, tuple(causes), base, acc, tuple(found), before,
                     after, *closure(before, after), float(gain),
                     held_out(full, start, acc, trials or TRIALS // 2, seed + 2)
                     if acc.signatures or acc.hypotheses != start.hypotheses else None,
                     needed_duration(causes, full) if verdict == "undecided"
                     else np.nan)


def verdict_of(causes):
    """The first cause if it is more probable than not, or else every effect that is, in
    whatever company (the median probability model; M. Barbieri, J. Berger, "Optimal
    predictive model selection", Ann. Stat. 32, 2004).
    """
    if causes[0].probability >= SURE:
        return causes[0].effect
    present = {}
    for c in causes:
        for effect in dict.fromkeys(c.effect.split("+")):
            present[effect] = present.get(effect, 0.0) + c.probability
    return "+".join(e for e, p in present.items() if p >= SURE) or "undecided"


def _followed(leaves, step, best):
    """Rivals of what has been found, once a further effect has been: they lack it as
    much as the account did to which it was added, unless it is theirs.
    """
    alone = next(c.probability for c in step.causes if c.effect == "none")
    result = {}
    for one in leaves.values():
        result[one.effect] = one._replace(probability=alone * one.probability)
        if one.effect != "none" and best.effect not in one.effect.split("+"):
            both = _joined([one, best], (1.0 - alone) * one.probability)
            result[both.effect] = both
    return result


def expected_mean(hypotheses, dt, samples):
    """Root mean square of the means of 64 simulated records, u."""
    block = int(np.clip(BLOCK // samples, 1, 64))
    means = np.concatenate([
        simulate(hypotheses, dt, samples, min(block, 64 - first), first=first
                 ).error.mean(1) for first in range(0, 64, block)])
    return float(np.sqrt(np.mean(means**2)))


def check_scene(y, dt, columns):
    """Refuse what cannot be diagnosed."""
    if y.ndim != 1 or not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"a record of shape {y.shape} at {dt} s: "
                         "one row of samples and an interval > 0 are needed")
    seen = y[~np.isnan(y)]
    if len(seen) < SHORTEST or np.isinf(y).any() or np.ptp(seen) == 0.0:
        raise ValueError(f"the record has {len(seen)} samples, "
                         f"{len(np.unique(seen))} different ones: at least {SHORTEST} "
                         "finite ones that are not all the same are needed")
    check_columns(y, columns)


def check_columns(y, columns):
    """Refuse columns that do not go with a record."""
    for name, x in columns.items():
        if x.shape != y.shape or not np.isfinite(x).all():
            raise ValueError(f"column {name} has shape {x.shape} and "
                             f"{np.sum(~np.isfinite(x))} values that are not finite: "
                             f"{len(y)} numbers are needed, one for every sample")


SHORTEST = 64    # samples; fewer tell no effect from the noise


def _joined(found, probability):
    """Several effects as one `Cause`, with their names before their parameters'; one
    found again is number 2.
    """
    parameters = {}
    for c in found:
        for name, value in c.parameters.items():
            effect, _, own = name.rpartition(".")
            effect = effect or (c.effect if len(found) > 1 else "")
            number, key = 1, name if not effect else f"{effect}.{own}"
            while key in parameters:
                number += 1
                key = f"{effect}_{number}.{own}"
            parameters[key] = value
    return Cause("+".join(c.effect for c in found) or "none",
                 "+".join(filter(None, (c.column for c in found))),
                 probability, sum(c.log_bayes for c in found), parameters)


def closure(before, after):
    """rms distances before and after over the statistics that stood out before, the
    fraction closed, 1 - (after - 1) / (before - 1), and its interval.
    """
    out = np.abs(before.distance) > np.quantile(np.abs(before.null).max(1),
                                                1.0 - OUTSTANDING)
    if not out.any():
        return before.rms(), after.rms(), np.nan, (np.nan, np.nan)
    first, last = before.rms(out), after.rms(out)
    # of a record without a gap, through the same statistics
    noise = 2.0 * np.std(np.sqrt((after.null[:, out]**2).mean(1)))
    closed = np.clip(1.0 - (last + np.array([0.0, noise, -noise]) - 1.0)
                     / (first - 1.0), -9.0, 1.0)
    return first, last, float(closed[0]), (float(closed[1]), float(closed[2]))


class HeldOut(NamedTuple):
    """What a fit of the first two thirds of a record says of the last third.

    Which effects there are, and their onset, frequency or delay, the whole record said.
    """

    gain: float           # of the log score with the effects, nats a sample
    reference: float      # of a flexible regression, nats a sample
    ratio_before: float   # real over calculated standard deviation of the predictions
    ratio_after: float    # the same with the effects: 1 where the criteria coincide
    before: float         # rms distance of what stands out there, standard deviations
    after: float          # the same with the effects; 1 is no gap
    closed: float         # fraction of the gap; NaN where there was none
    closed_interval: tuple


LAGS = 32    # samples back that the flexible regression looks


def held_out(scene, start, final, trials=None, seed=0):
    """`HeldOut` of an account with effects against that without; None where one of them
    begins in the last third.
    """
    cut = 2 * len(scene.y) // 3
    full, scene = scene, scene._replace(
        y=without_readings(scene.y[None], final.readings)[0])
    known = {p.symbol: value for p, value in zip(
        final.hypotheses[final.best].parameters, final.theta)
        if p.symbol == "noise_step.onset"}
    if any(onset > cut * scene.dt for onset in known.values()) or any(
            not s.columns[:cut].any() for s in final.signatures):
        return None
    head = Scene(scene.y[:cut], scene.dt,
                 {name: x[:cut] for name, x in scene.columns.items()})
    score, ratio, gaps = [], [], []
    for acc in (start, final):
        hypotheses = [h._replace(parameters=tuple(
            p._replace(low=known[p.symbol], high=known[p.symbol])
            if p.symbol in known else p for p in h.parameters)) for h in acc.hypotheses]
        fit = account(head, acc.bases, hypotheses, tuple(
            s._replace(columns=s.columns[:cut]) for s in acc.signatures),
            acc.readings, None if known else acc)
        gap = distance(full, fit._replace(signatures=acc.signatures), trials, seed, cut)
        score.append(gap.log_score[cut:])
        ratio.append(float(np.sqrt(np.nanmean(gap.z[cut:]**2))))
        gaps.append(gap)
    back = np.column_stack([np.ones_like(scene.y), *scene.columns.values(), *(
        np.roll(scene.y, lag) for lag in range(1, LAGS + 1))])
    whole = ~np.isnan(back).any(1) & ~np.isnan(scene.y) & (
        np.arange(len(scene.y)) >= LAGS)
    early, late = whole.copy(), whole.copy()
    early[cut:], late[:cut] = False, False
    reference = np.nan
    if early.sum() > 2 * back.shape[1] and late.any():
        c, *_ = np.linalg.lstsq(back[early], scene.y[early])
        variance = np.sum((scene.y - back @ c)[early]**2) / (
            early.sum() - back.shape[1])
        density = -0.5 * (LOG_2PI + np.log(variance)
                          + (scene.y - back @ c)[late]**2 / variance)
        reference = float(np.mean(density - score[0][late[cut:]]))
    return HeldOut(float(np.nanmean(score[1] - score[0])), reference, *ratio,
                   *closure(*gaps))


def needed_duration(causes, scene):
    """Record length, s, at which the two best causes would be told apart, if their log
    odds grew as they did.
    """
    first, second = (c.probability for c in causes[:2])
    odds = max(np.log(first / max(second, 1e-12)), 0.5)
    return float(scene.duration * max(3.0 / odds, 1.0))


# ---- 8. Records and model files --------------- what the command line reads and writes

class Record(NamedTuple):
    """A column of a file, evenly sampled; missing samples are NaN."""

    file: str
    column: str
    error: np.ndarray    # (N,) u
    dt: float            # s
    columns: dict = {}   # what was recorded beside it, if asked for


def read_record(file, column="error", dt=None, resample=False, allow_missing=False,
                beside=()):
    """Record from a CSV file with a header, or from .npz, .mat or .npy.

    Parameters
    ----------
    file : path
        A CSV header names the columns; .npz and .mat hold arrays of such names and,
        optionally, a scalar `dt`; .npy holds the error alone.
    column : str
        Column or array of the sensor error; a row of a 2-D array as in "error[0]".
    dt : float, optional
        Sampling interval, s. By default it comes from the column `time` or the scalar
        `dt`; if given, the samples count as evenly spaced and `time` is not read.
    resample : bool
        Interpolate an unevenly sampled record linearly onto even times.
    allow_missing : bool
        Take NaN and empty cells as missing samples.
    beside : sequence of str, or None
        Further columns wanted, as NAME or as NAME=COLUMN to give one another name; None
        for all that hold numbers. Where samples are missing they are interpolated.

    Returns
    -------
    Record
        A gap of whole sampling intervals in `time` becomes missing samples.

    Raises
    ------
    ValueError, OSError
        With one sentence on what is wrong with the file.
    """
    file = pathlib.Path(file)
    if not file.is_file():
        raise ValueError(f"{file}: no such file" + ", but a folder" * file.is_dir())
    name, row = column, None
    if column.endswith("]") and column.rpartition("[")[2][:-1].isdigit():
        name, row = column.rpartition("[")[0], int(column.rpartition("[")[2][:-1])
    arrays = _read_arrays(file, name, with_time=dt is None,
                          others=None if beside is None else [
                              part.rpartition("=")[2] for part in beside])
    if arrays.get(name) is None:
        raise ValueError(f"{file}: no column {name!r} among {', '.join(arrays)}; "
                         "choose one with --column")
    error = arrays[name]
    if error.ndim == 2 and error.shape[1] == 1:
        error = error[:, 0]
    if error.ndim == 1 and row is not None:
        raise ValueError(f"{file}: {name} is one row of numbers: leave [{row}] out")
    if error.ndim == 2 and (row is not None or len(error) == 1):
        if not (row or 0) < len(error):
            raise ValueError(f"{file}: {name} has the rows 0 to {len(error) - 1}, "
                             f"not {row}")
        error = error[row or 0]
    if error.ndim != 1 or error.dtype.kind not in "iuf":
        raise ValueError(
            f"{file}: {name} is an array of {error.dtype} of shape {error.shape}: a "
            f"record is one row of numbers, such as --column '{name}[0]'")
    shape = np.shape(arrays[name])
    error = error.astype(float)
    columns = _columns_beside(file, arrays, name, row or 0, shape, len(error), beside)
    time = arrays.get("time")
    holes = int(np.isnan(error).sum())
    if holes and not allow_missing:
        raise ValueError(f"{file}: {column} holds {holes} NaN or empty values, "
                         f"the first at sample {np.argmax(np.isnan(error))}; "
                         "--allow-missing takes them as missing")
    if dt is None and arrays.get("time") is not None:
        dt, error = _even(file, _numbers(file, "time", arrays), error, resample)
    elif dt is None:
        if "dt" not in arrays:
            raise ValueError(f"{file}: neither a column time nor dt: "
                             "give the sampling interval with --dt")
        dt = _numbers(file, "dt", arrays)
        if dt.size != 1:
            raise ValueError(f"{file}: dt holds {dt.size} numbers, not one")
        dt = float(dt[0])
    try:
        _check_record(error, dt)
    except ValueError as problem:
        raise ValueError(f"{file}: {problem}") from None
    if len(columns) and time is not None and len(time) == len(next(
            iter(columns.values()))) != len(error):
        even = time[0] + dt * np.arange(len(error))
        columns = {name: np.interp(even, time, x) for name, x in columns.items()}
    return Record(str(file), column, error, float(dt), columns)


def _columns_beside(file, arrays, name, row, shape, samples, beside):
    """The further columns of a file by their names; rows of arrays as name[k]."""
    columns = {}
    for key, x in arrays.items():
        if key in (name, "time", "dt") or x is None or x.dtype.kind not in "iuf":
            continue
        x = np.asarray(x, float)
        if x.ndim == 2 and x.shape == shape:
            columns[key] = x[row]
        elif x.ndim == 2 and x.shape[1] == samples:
            columns.update((f"{key}[{k}]", part) for k, part in enumerate(x))
        elif x.shape == (samples,):
            columns[key] = x
    if beside is None:
        return columns
    for part in beside:
        new, _, old = part.rpartition("=")
        if old not in columns:
            raise ValueError(f"{file}: no column {old!r} of {samples} numbers beside "
                             f"{name}; there are {', '.join(columns) or 'none'}")
        columns[new or old] = columns.pop(old)
    wanted = [part.rpartition("=")[0] or part for part in beside]
    return {key: columns[key] for key in wanted}


def _numbers(file, name, arrays):
    """An array of a file as floats in one row."""
    if np.asarray(arrays[name]).dtype.kind not in "iuf":
        raise ValueError(f"{file}: {name} does not hold real numbers")
    return np.asarray(arrays[name], float).ravel()


def _read_arrays(file, name, with_time, others=()):
    """Arrays of a file by name; None for those that are not needed."""
    needed = [name, "time", "dt"] if with_time else [name]
    needed += [part.partition("[")[0] for part in others or ()]
    kind = file.suffix.lower()
    if kind == ".npy":
        return {name: _loaded(file, np.load)}
    if kind == ".npz":
        with _loaded(file, np.load) as archive:
            return {key: archive[key] if others is None or key in needed else None
                    for key in archive.files}
    if kind == ".mat":
        from scipy.io import loadmat
        return {key: np.squeeze(value) for key, value in _loaded(file, loadmat).items()
                if not key.startswith("__")}
    return _read_csv(file, needed, everything=others is None)


def _loaded(file, load):
    """A NumPy or MATLAB file, or a sentence on what is wrong with it."""
    try:
        return load(file)
    except Exception as problem:    # each format raises its own
        raise ValueError(f"{file}: cannot be read as {file.suffix}: "
                         f"{str(problem).splitlines()[0]}") from None


def _read_csv(file, wanted, everything=False):
    """The wanted columns of a CSV file as arrays; None for the ones it only names.

    Everything means all columns whose first cell is a number.
    """
    with open(file, newline="", encoding="utf-8-sig", errors="replace") as stream:
        skip, header = 0, ""
        for header in stream:
            skip += 1
            if header.strip() and not header.startswith("#"):
                break
        first = next((line for line in stream if line.strip()), "")
    delimiter = next((d for d in (",", ";", "\t") if d in header), ",")
    names = [name.strip().strip('"') for name in header.strip().split(delimiter)]
    if not header.isprintable() and not header.strip("\r\n\t").isprintable():
        raise ValueError(f"{file}: not a CSV file in UTF-8")
    if all(_is_number(name) or not name for name in names):
        raise ValueError(f"{file}: no header: the first line must name the columns, "
                         "such as time,error")
    if everything:
        cells = first.strip("\r\n").split(delimiter)
        wanted = [wanted[0], *(n for n, cell in zip(names, cells)
                               if n and n not in wanted and _is_number(cell)),
                  *wanted[1:]]
    present = [name for name in dict.fromkeys(wanted) if name in names]
    twice = [name for name in present if names.count(name) > 1]
    if twice:
        raise ValueError(f"{file}: the header names {twice[0]} more than once")
    if wanted[0] in present:
        at = [names.index(name) for name in present]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")    # on files without a row: told below
                table = np.loadtxt(file, delimiter=delimiter, skiprows=skip,
                                   usecols=at, ndmin=2, encoding="utf-8-sig")
        except ValueError:
            table = _read_cells(file, delimiter, skip, at, present)
        return {**dict.fromkeys(names), **dict(zip(present, table.T))}
    return dict.fromkeys(names)


def _is_number(text):
    try:
        float(text)
        return True
    except ValueError:
        return False


MISSING = "", "NA", "N/A", "NULL"    # cells that count as NaN


def _read_cells(file, delimiter, skip, at, names):
    """Cell by cell: missing ones are NaN, and what is no number is named with its line.
    """
    rows = []
    with open(file, newline="", encoding="utf-8-sig", errors="replace") as stream:
        for number, row in enumerate(csv.reader(stream, delimiter=delimiter), 1):
            if number <= skip or not "".join(row).strip() or row[0].startswith("#"):
                continue
            if len(row) <= max(at):
                raise ValueError(f"{file}, line {number}: {len(row)} cells, but column "
                                 f"{names[np.argmax(at)]} is number {max(at) + 1}")
            cells = [row[column].strip() for column in at]
            for name, cell in zip(names, cells):
                if cell.upper() not in MISSING and not _is_number(cell):
                    raise ValueError(f"{file}, line {number}: {cell!r} "
                                     f"in column {name} is not a number")
            rows.append([np.nan if cell.upper() in MISSING else float(cell)
                         for cell in cells])
    return np.array(rows).reshape(-1, len(at))


JITTER = 0.1    # of a sampling interval: what a time stamp may be off


def _even(file, time, error, resample):
    """dt and the record on evenly spaced times; gaps become NaN."""
    if len(time) != len(error):
        raise ValueError(f"{file}: {len(time)} times for {len(error)} samples")
    if not np.isfinite(time).all():
        raise ValueError(f"{file}: time of sample {np.argmin(np.isfinite(time))} is "
                         f"{time[np.argmin(np.isfinite(time))]}: a number is needed")
    step = np.diff(time)
    bad = np.flatnonzero(~(step > 0.0))
    if bad.size:
        raise ValueError(f"{file}: time does not increase from sample {bad[0]} "
                         f"({time[bad[0]]:g} s) to the next "
                         f"({time[bad[0] + 1]:g} s): sort the record, "
                         "or give --dt if it is evenly sampled")
    if len(time) < 2:
        raise ValueError(f"{file}: the record has {len(time)} samples: "
                         f"at least {MIN_SAMPLES} are needed")
    middle = np.median(step)
    if (time[-1] - time[0]) / middle > 100 * len(time):
        raise ValueError(f"{file}: {len(time)} samples, usually {middle:g} s apart, "
                         f"are spread over {time[-1] - time[0]:g} s: cut the gap after "
                         f"sample {step.argmax()} out")
    count = np.maximum(np.round(step / middle), 1.0)
    dt = (time[-1] - time[0]) / count.sum()
    off = np.abs(step - count * dt)
    if resample:
        dt = middle
        even = np.arange(time[0], time[-1] + 1e-6 * dt, dt)
        after = np.searchsorted(time, even).clip(1, len(time) - 1)
        value = np.interp(even, time, error)
        value[time[after] - time[after - 1] > 2.5 * dt] = np.nan
        return dt, value
    if off.max() > JITTER * dt:
        raise ValueError(f"{file}: the record is uneven: "
                         f"the step after sample {off.argmax()} is "
                         f"{step[off.argmax()]:g} s where {middle:g} s is usual; "
                         "--resample interpolates it, --dt takes the samples as even")
    index = np.append(0, np.cumsum(count)).astype(int)
    even = np.full(index[-1] + 1, np.nan)
    even[index] = error
    return dt, even


class Model(NamedTuple):
    """A model file: the simulator, or the hypotheses and their priors."""

    dt: float
    unit: str
    hypotheses: tuple
    effects: tuple = ()    # of every hypothesis, tuples of Added; () if none has any


def read_model(file):
    """Model from a JSON file.

    The file holds `dt`, s, optionally `unit`, `bias_sigma` (1) and `prior` ("uniform"
    or "log"), and `hypotheses`: a list of `name`, a name in MODELS, and `parameters`,
    each a number or a range [low, high]; optionally `label`, `prior`, `bias_sigma` and
    `effects`: a list of `name`, a name in CATALOGUE, `parameters` and, where the effect
    needs one, `column`.

    Raises
    ------
    ValueError
        With one sentence on what is wrong with the file.
    """
    file = pathlib.Path(file)
    if not file.is_file():
        raise ValueError(f"{file}: no such model file")
    try:
        text = json.loads(file.read_text(encoding="utf-8-sig"))
    except (ValueError, OSError, RecursionError) as problem:
        raise ValueError(f"{file}: not a JSON model file: {problem}") from None
    try:
        if not isinstance(text, dict) or not text.get("hypotheses"):
            raise ValueError("no hypotheses: a model file needs a list of at least one")
        if not isinstance(text["hypotheses"], list):
            raise ValueError("hypotheses must be a list")
        dt = _number(text.get("dt"), "dt")
        if not (np.isfinite(dt) and dt > 0.0):
            raise ValueError(f"dt is {dt:g} s: it must be > 0")
        if not isinstance(text.get("unit", "u"), str):
            raise ValueError(f"unit {text['unit']!r} must be a text")
        hypotheses = tuple(_hypothesis_from(entry, text)
                           for entry in text["hypotheses"])
        names = [h.name for h in hypotheses]
        if len(set(names)) < len(names):
            raise ValueError(f"hypotheses of the same name among {', '.join(names)}: "
                             "give each a \"label\" of its own")
        effects = tuple(tuple(_effect_from(one, entry["name"])
                              for one in entry.get("effects") or ())
                        for entry in text["hypotheses"])
    except ValueError as problem:
        raise ValueError(f"{file}: {problem}") from None
    return Model(dt, str(text.get("unit", "u")), hypotheses,
                 effects if any(effects) else ())


def _effect_from(entry, owner):
    """One effect of a hypothesis of a model file."""
    if not isinstance(entry, dict) or entry.get("name") not in CATALOGUE:
        raise ValueError(f"effect {entry!r} of {owner}: a name is needed, "
                         f"one of {', '.join(CATALOGUE)}")
    name, parameters = entry["name"], entry.get("parameters")
    effect = CATALOGUE[name]
    if effect.kind == "parameter":
        raise ValueError(f"{name} is no effect to be added: change the parameter")
    if not isinstance(parameters, dict):
        raise ValueError(f"parameters of {name} must be an object")
    column, variant = entry.get("column") or "", entry.get("variant") or ""
    if effect.column and not column:
        raise ValueError(f"{name} of {owner} names no column")
    scene = Scene(np.arange(8.0), 1.0, {column: np.arange(8.0)})
    needed = {p.symbol for p in effect.parameters(scene)} | {
        "quantization": {"lsb"}, "saturation": {"limits"}, "stuck": {"spans"}}.get(
            name, {effect.size} - {""})
    optional = {"phase"} if name == "sinusoid" else set()
    if not needed <= parameters.keys() <= needed | optional:
        raise ValueError(f"{name} has the parameters {', '.join(sorted(needed))}, "
                         f"not {', '.join(sorted(parameters)) or 'none'}")
    if effect.kind != "reading":
        parameters = {symbol: _parameter(name, symbol, value, "uniform")
                      for symbol, value in parameters.items()}
    else:
        shape = dict(quantization=(), saturation=(2,), stuck=(None, 2))[name]
        value = next(iter(parameters.values()))
        try:
            numbers = np.array([[-np.inf, np.inf][i] if v is None else v
                                for i, v in enumerate(value)]
                               if name == "saturation" else value, float)
        except (TypeError, ValueError):
            numbers = np.zeros(7)
        if numbers.ndim != len(shape) or any(
                n not in (None, have) for n, have in zip(shape, numbers.shape)):
            raise ValueError(f"{needed.pop()} of {name} is {value!r}: a number for "
                             "lsb, [low, high] for limits, [[onset, samples], ...] "
                             "for spans")
        parameters = {needed.pop(): numbers.tolist()}
    return Added(effect, column, variant, parameters)


def _hypothesis_from(entry, text):
    """One hypothesis of a model file."""
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise ValueError(f"hypothesis {entry!r}: a name and parameters are needed")
    if not isinstance(entry.get("parameters", {}), dict):
        raise ValueError(f"parameters of {entry['name']} "
                         "must be an object of numbers and ranges")
    if not isinstance(entry.get("effects") or [], list):
        raise ValueError(f"effects of {entry['name']} must be a list")
    if not isinstance(entry.get("label", ""), str):
        raise ValueError(f"label {entry['label']!r} of {entry['name']} must be a text")
    parameters = entry.get("parameters", {})
    strange = {"name", "model", "prior", "bias_sigma"} & parameters.keys()
    if strange:
        raise ValueError(f"{entry['name']} has no parameter {strange.pop()}")
    return hypothesis(entry["name"], name=entry.get("label"),
                      bias_sigma=entry.get("bias_sigma", text.get("bias_sigma", 1.0)),
                      prior=entry.get("prior", text.get("prior", "uniform")),
                      **parameters)


def model_text(model):
    """JSON text of a model file."""
    def value(p):
        if isinstance(p, Parameter):
            return [p.low, p.high] if p.free else p.low
        return [v if not np.isscalar(v) or np.isfinite(v) else None
                for v in p] if isinstance(p, list) else p
    hypotheses = [dict(name=h.model.__name__, label=h.name, bias_sigma=h.bias_sigma,
                       prior="log" if any(p.log for p in h.parameters) else "uniform",
                       parameters={p.symbol: value(p) for p in h.parameters})
                  for h in model.hypotheses]
    for entry, added in zip(hypotheses, model.effects):
        entry["effects"] = [
            dict(name=one.effect.name, column=one.column or None,
                 variant=one.variant or None,
                 parameters={k: value(p) for k, p in one.parameters.items()})
            for one in added]
    return json.dumps(dict(dt=model.dt, unit=model.unit, hypotheses=hypotheses),
                      indent=1)


def default_hypotheses(y, dt, names=("white_noise", "random_walk", "markov")):
    """Hypotheses with priors from sample characteristics,
    as Sec. 2 of the paper advises.

    Parameters
    ----------
    y : (N,) array
        Record, u.
    dt : float
        Sampling interval, s.
    names : sequence of str
        Names in MODELS.

    Returns
    -------
    tuple of Hypothesis
        Log-uniform priors, the same for a parameter in every hypothesis. The standard
        deviation of the difference of neighbours, d, is at least sigma_w, that of the
        record at least sigma_v. From below: white noise of 0.01 d, a walk of d / N per
        sample and a Markov process of d / sqrt(N) are lost in N samples of the rest. A
        correlation time lies between dt and the whole record.
    """
    seen = y[~np.isnan(y)]
    short = np.sqrt(np.mean(np.diff(seen)**2)) or np.ptp(seen) / len(seen)
    wide = max(np.std(seen), short)
    duration = dt * len(y)
    bias_sigma = float(np.hypot(np.mean(seen), 3.0 * wide))
    slow = short / np.sqrt(len(y)), 3.0 * wide
    ranges = dict(sigma_v=(0.01 * short, 3.0 * wide),
                  sigma_w=(short / len(y), 1.5 * short),
                  tau_m=(dt, duration), tau_n=(dt, duration),
                  sigma_m=slow, sigma_n=slow)
    ranges["slope"] = Parameter("slope", -10.0 * wide / duration,
                                10.0 * wide / duration)
    for name in names:
        if name not in MODELS:
            raise ValueError(f"unknown hypothesis {name!r}: "
                             f"known are {', '.join(MODELS)}")
    if len(set(names)) < len(names):
        raise ValueError(f"a hypothesis is named twice among {', '.join(names)}")
    return tuple(
        hypothesis(name, bias_sigma=bias_sigma, prior="log", **{
            symbol: ranges[symbol]
            for symbol in inspect.signature(MODELS[name]).parameters
            if symbol in ranges})
        for name in names)


# ---- 9. Command line ---------------------------------- parse, read, call, print, draw
#
# The drawings live here and not in `figures`, so that --plot works where this file was
# copied alone; Matplotlib is imported when asked for.

DESCRIPTION = """\
sensorid says which error model a gyro or an accelerometer follows, with which
parameters, and how well that can be known at all (Stepanov and Motorin,
Sensors 2019, 19(9), 1997); and why a simulated sensor differs from the real one."""

EPILOG = """\
a first session:
  python -m sensorid identify record.csv --plot record.png
  python -m sensorid criteria model.json --duration 2000 --trials 500
  python -m sensorid simulate model.json --samples 20000 --records 10 \\
    --out simulated.npz
  python -m sensorid diagnose record.csv --model model.json --out gap

record.csv has a header: time,error. model.json holds the hypotheses:
  {"dt": 0.1, "unit": "deg/h", "bias_sigma": 1.0, "hypotheses": [
    {"name": "random_walk", "parameters": {"sigma_w": [0.04, 0.15], "sigma_v": 0.5}},
    {"name": "markov", "parameters": {
      "tau_m": [60, 1500], "sigma_m": [0.5, 1.5], "sigma_v": 0.5}}]}
A number is known, a range is to be found. tau_m is in s, every sigma in the unit of
the record, sigma_w per sample.
Hypotheses: """ + ", ".join(MODELS) + "."


class _Parser(argparse.ArgumentParser):
    """Says in one line what is wrong."""

    def error(self, message):
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _parser():
    raw = argparse.RawDescriptionHelpFormatter
    parser = _Parser(prog="sensorid", description=DESCRIPTION, epilog=EPILOG,
                     formatter_class=raw)
    commands = parser.add_subparsers(dest="command", required=True, metavar="command",
                                     parser_class=_Parser)

    one = commands.add_parser(
        "identify", help="name the error model of a record", formatter_class=raw,
        description="Probability of every hypothesis and the parameters of each, "
                    "Eqs. (3)-(14).",
        epilog="Without --model, priors come from sample characteristics "
               "of the record.")
    one.add_argument("record", help="CSV with a header, .npz, .mat or .npy")
    one.add_argument("--model", metavar="M.json", help="hypotheses and priors")
    one.add_argument("--hypotheses", metavar="NAMES",
                     help="without --model: names, comma-separated, "
                          "or all (default white_noise,random_walk,markov)")
    _record_options(one)
    one.add_argument("--json", metavar="OUT.json",
                     help="write the result, with Phi, Gamma, H, Psi")
    one.add_argument("--save-model", metavar="OUT.json",
                     help="write the most probable model, "
                          "ready for simulate and criteria")
    one.add_argument("--plot", metavar="OUT.png", help="draw the result")

    two = commands.add_parser(
        "criteria", help="how well the models of a file can be identified",
        formatter_class=raw,
        description="Error probability and relative standard deviations "
                    "against record length,\nEqs. (15)-(20), or how long must be "
                    "recorded for a target of them.",
        epilog="sensorid criteria M.json --duration 2000 --algorithms all\n"
               "sensorid criteria M.json --duration 2000 --target 0.02 "
               "--target-rsd tau_m=0.35\n"
               "sensorid criteria M.json --duration 2000 --target 0.05 "
               "--design dt=0.1,1 \\\n    --design sigma_v=0.1,0.5 --csv T.csv "
               "--plot T.png\n"
               "At another dt the random walk and the density of the white noise stay.")
    two.add_argument("model", metavar="M.json", help="hypotheses and priors")
    two.add_argument("--duration", type=float, required=True, metavar="S",
                     help="record length, s; with a target, the longest in question")
    two.add_argument("--trials", type=int, metavar="L",
                     help="trials (default 500; 4000 with a target)")
    two.add_argument("--algorithms", metavar="NAMES",
                     help="put others through the same trials: all, or any of "
                          + ", ".join(ALGORITHMS) + ", comma-separated")
    two.add_argument("--target", type=float, metavar="P",
                     help="how long must be recorded for this error probability")
    two.add_argument("--target-rsd", action="append", default=[], metavar="NAME=R",
                     help="the same for a relative standard deviation, such as "
                          "tau_m=0.2; may be repeated")
    two.add_argument("--design", action="append", default=[], metavar="NAME=V,V,...",
                     help="answer the targets for every sampling interval dt, s, or "
                          "white noise sigma_v, u; may be repeated for a grid of both")
    two.add_argument("--csv", metavar="OUT.csv", help="write the design table")
    two.add_argument("--seed", type=_seed, default=0,
                     help="of the random numbers, >= 0 (default 0)")
    two.add_argument("--checkpoint", metavar="FOLDER",
                     help="keep finished chunks of trials there; "
                          "the same command takes up an interrupted run")
    two.add_argument("--json", metavar="OUT.json", help="write the result")
    two.add_argument("--plot", metavar="OUT.png", help="draw the result")

    four = commands.add_parser(
        "diagnose", help="why a record differs from a simulator", formatter_class=raw,
        description="Where a record differs from a simulator, which effect causes it,\n"
                    "how far the gap closes once that effect is added.",
        epilog="Effects looked for: " + ", ".join(CATALOGUE) + ".\n"
               "--effects defines each of them; with a record, it gives their priors "
               "there.\n"
               "Without --model and --simulated, the simulator is white noise, random "
               "walk or\nMarkov process with priors from the record.")
    four.add_argument("record", nargs="?", help="CSV with a header, .npz, .mat or .npy")
    four.add_argument("--effects", action="store_true",
                      help="define the effects that are looked for, and do no more")
    simulator = four.add_mutually_exclusive_group()
    simulator.add_argument("--model", metavar="M.json", help="the simulator")
    simulator.add_argument("--simulated", metavar="FILE",
                           help="records of the simulator, error[L, N] or one column")
    _record_options(four)
    four.add_argument("--covariates", metavar="NAMES",
                      help="columns beside the error, comma-separated, NAME or "
                           "NAME=COLUMN, such as temperature=temp_degC "
                           "(default all, '' for none)")
    four.add_argument("--seed", type=_seed, default=0,
                      help="of the simulated records, >= 0 (default 0)")
    four.add_argument("--out", metavar="DIR",
                      help="folder for report.json, report.png and model.json, "
                           "the simulator with the effects added")

    three = commands.add_parser(
        "simulate", help="draw records from a model file", formatter_class=raw,
        description="Records from the prior of a model file; arrays error[L, N] "
                    "and dt, with the name of the true hypothesis and its "
                    "parameters.")
    three.add_argument("model", metavar="M.json", help="the simulator")
    length = three.add_mutually_exclusive_group(required=True)
    length.add_argument("--samples", type=int, metavar="N", help="samples of a record")
    length.add_argument("--like", metavar="RECORD",
                        help="as long as this record, and with its gaps")
    _record_options(three)
    three.add_argument("--records", type=int, default=1, metavar="L",
                       help="records (default 1)")
    three.add_argument("--seed", type=_seed, default=0,
                       help="of the random numbers, >= 0 (default 0)")
    three.add_argument("--out", required=True, metavar="FILE.npz",
                       help="file to be written")
    return parser


def _seed(text):
    """A seed of the command line."""
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text} is not a whole number >= 0")
    return int(text)


def _record_options(parser):
    parser.add_argument("--column", default="error", metavar="C",
                        help="column of the sensor error (default error)")
    parser.add_argument("--dt", type=float, metavar="S",
                        help="sampling interval, s "
                             "(default: from the column time or the scalar dt)")
    parser.add_argument("--resample", action="store_true",
                        help="interpolate an uneven record onto even times")
    parser.add_argument("--allow-missing", action="store_true",
                        help="take NaN and empty cells as missing samples")


def _read(options, model=None, beside=()):
    """The record that the options name, with further columns, at the sampling interval
    of the model if there is one.
    """
    dt = options.dt
    if dt is None and model and pathlib.Path(options.record).suffix.lower() == ".npy":
        dt = model.dt
    record = read_record(options.record, options.column, dt, options.resample,
                         options.allow_missing, beside)
    if model and abs(record.dt - model.dt) > 0.01 * model.dt:
        raise ValueError(f"{options.record} is sampled at {record.dt:g} s, "
                         f"but the model is for dt = {model.dt:g} s: "
                         "its noises per sample do not apply")
    return record


def _refuse_effects(file, model):
    if model and model.effects:
        raise ValueError(f"{file} has effects: only simulate and diagnose know them, "
                         "take them out for anything else")


PICTURES = ".png", ".pdf", ".svg", ".jpg"


def _check_outputs(inputs, *outputs, plot=None):
    """Refuse before the work what could not be written after it."""
    if plot is not None and pathlib.Path(plot).suffix.lower() not in PICTURES:
        raise ValueError(f"{plot}: a picture is one of {', '.join(PICTURES)}")
    outputs = [file for file in (*outputs, plot) if file is not None]
    taken = {os.path.realpath(file) for file in inputs if file}
    for file in outputs:
        if os.path.realpath(file) in taken:
            raise ValueError(f"{file} is named twice: "
                             "an output must be a file of its own")
        taken.add(os.path.realpath(file))
        folder = pathlib.Path(file).absolute().parent
        if (not folder.is_dir() or not os.access(folder, os.W_OK)
                or pathlib.Path(file).is_dir()):
            raise ValueError(f"{file} cannot be written: "
                             "no such folder, or no right to")


def _matplotlib():
    try:
        import matplotlib
    except ImportError:
        raise ValueError("--plot needs Matplotlib: pip install matplotlib") from None
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    return plt


def _save(fig, file):
    fig.set_layout_engine("tight")
    kind = pathlib.Path(file).suffix[1:].lower()
    _write(file, lambda stream: fig.savefig(stream, format=kind, dpi=150))


def progress_bar(done, total):
    """Progress on a terminal."""
    if sys.stderr.isatty():
        filled = 30 * done // total
        print(f"\r[{'#' * filled}{'.' * (30 - filled)}] {done}/{total}",
              end="\n" if done == total else "", file=sys.stderr, flush=True)


def matrices(estimate, dt):
    """Phi, Gamma, H, Psi at the estimated parameters, the bias as the last state,
    Eq. (21).
    """
    filt = _filter_at(estimate.hypothesis, dt, estimate.mean)
    n, noises = filt.Gamma.shape[1:]
    Phi = np.eye(n + 1)
    Phi[:n, :n] = filt.Phi[0]
    return dict(Phi=Phi.tolist(),
                Gamma=np.vstack([filt.Gamma[0], np.zeros((1, noises))]).tolist(),
                H=[*filt.H[0].tolist(), 1.0], Psi=float(filt.Psi[0]))


def _identify(options):
    model = read_model(options.model) if options.model else None
    _refuse_effects(options.model, model)
    if model and options.hypotheses is not None:
        raise ValueError("--hypotheses names defaults and --model brings its own: "
                         "give one of them")
    _check_outputs([options.record, options.model], options.json, options.save_model,
                   plot=options.plot)
    plt = _matplotlib() if options.plot else None
    record = _read(options, model)
    y, dt = record.error, record.dt
    names = ("white_noise,random_walk,markov" if options.hypotheses is None
             else options.hypotheses)
    names = MODELS if names == "all" else names.split(",")
    hypotheses = model.hypotheses if model else default_hypotheses(y, dt, names)
    unit = model.unit if model else "u"
    posterior = identify(y, dt, hypotheses, progress=progress_bar)
    best = int(posterior.probability.argmax())
    misfit = allan_misfit(y, dt, posterior.estimates[best])

    print(f"{record.file}, column {record.column}: {len(y)} samples at {dt:g} s, "
          f"{dt * len(y):g} s; {np.isnan(y).sum()} missing")
    print(f"{'hypothesis':<20}{'probability':>11}  "
          "parameters, mean +- standard deviation")
    for k in np.argsort(-posterior.probability):
        e = posterior.estimates[k]
        text = ", ".join(
            f"{p.symbol} = {m:.4g}" + (f" +- {sd:.2g}" if p.free else "")
            + (" s" if p.symbol.startswith("tau") else f" {unit}")
            + ("/s" if p.symbol == "slope" else "") + _at_an_end(p, m, sd)
            for p, m, sd in zip(e.hypothesis.parameters, e.mean,
                                np.sqrt(np.diag(e.covariance))))
        print(f"{e.hypothesis.name:<20}{posterior.probability[k]:>11.4f}  {text}")
        if not e.settled:
            print(f"{'':<33}coarse: a finer grid than one of "
                  f"{e.nodes_per_sd.min():.2g} nodes per standard deviation is needed")
    chosen = decide(posterior)
    print(f"decision at threshold {GAMMA}: "
          + ("none, record longer" if chosen is None else hypotheses[chosen].name))
    print(misfit.sentence)
    result = dict(
        record=dict(file=record.file, column=record.column, samples=len(y), dt=dt),
        decision=None if chosen is None else hypotheses[chosen].name,
        hypotheses=[dict(
            name=e.hypothesis.name, probability=float(posterior.probability[k]),
            log_evidence=float(e.log_evidence),
            parameters={p.symbol: dict(mean=float(m), sd=float(sd)) for p, m, sd in zip(
                e.hypothesis.parameters, e.mean, np.sqrt(np.diag(e.covariance)))},
            matrices=matrices(e, dt), nodes_per_sd=e.nodes_per_sd.tolist(),
            settled=e.settled)
            for k, e in enumerate(posterior.estimates)],
        allan_misfit=dict(tau=misfit.tau, ratio=misfit.ratio, sd=misfit.sd))
    if options.json:
        _write(options.json,
               lambda stream: stream.write(json.dumps(result, indent=1).encode()))
    if options.save_model:
        text = model_text(Model(dt, unit, (_narrowed(posterior.estimates[best]),)))
        _write(options.save_model, lambda stream: stream.write(text.encode()))
    if plt:
        _save(_draw_identify(plt, record, posterior, unit), options.plot)


def _at_an_end(p, mean, sd):
    """A warning where a sharp posterior leans on an end of its prior."""
    if p.free and sd < 0.25 * p.sd and min(mean - p.low, p.high - mean) < 1.5 * sd:
        end = "low" if mean - p.low < p.high - mean else "high"
        return f" (at the {end} end of its range: widen the prior)"
    return ""


def _narrowed(e):
    """The hypothesis of an estimate with ranges of two standard deviations to
    either side.
    """
    sds = np.sqrt(np.diag(e.covariance))
    return e.hypothesis._replace(parameters=tuple(
        Parameter(p.symbol, max(p.low, m - 2 * sd), min(p.high, m + 2 * sd))
        if p.free else p
        for p, m, sd in zip(e.hypothesis.parameters, e.mean, sds)))


class Misfit(NamedTuple):
    """Where the Allan deviation of a record and that of its model differ most."""

    tau: float       # s; None where too much is missing
    ratio: float     # record over model
    sd: float        # difference in standard deviations
    sentence: str


def allan_misfit(y, dt, estimate):
    """Largest difference between the Allan deviations of a record and of its model.

    Octaves up to a tenth of the record. The standard deviation is that of white noise
    (edf of NIST SP 1065, Table 5), a lower bound for slower noises: a hint, not a test.
    """
    seen = 1.0 - np.isnan(y).mean()
    filt = _filter_at(estimate.hypothesis, dt, estimate.mean)
    tau, adev = allan_deviation(y, dt)
    if not len(tau):
        return Misfit(None, None, None, "too many samples are missing for an Allan "
                      "deviation: the fit is not checked")
    keep = tau <= 0.1 * dt * len(y)
    tau, adev = (tau[keep], adev[keep]) if keep.any() else (tau[:1], adev[:1])
    m = np.round(tau / dt).astype(int)
    model = np.sqrt(model_allan_variance(filt, m))
    edf = ((1.5 * (len(y) - 1) / m - 2 * (len(y) - 2) / len(y))
           * 4 * m**2 / (4 * m**2 + 5)) * seen**(2 * m)    # of pairs without a gap
    z = np.log(adev / model) * np.sqrt(2.0 * np.maximum(edf, 1.0))
    worst = int(np.abs(z).argmax())
    ratio = float(adev[worst] / model[worst])
    sentence = ("Allan deviation of the record over that of the most probable model: "
                f"{ratio:.3g} at tau = {tau[worst]:g} s, {abs(z[worst]):.1f} "
                "standard deviations, the largest of all octaves")
    if abs(z[worst]) > 5.0:
        sentence += "\nno hypothesis describes this record: something is left out"
    return Misfit(float(tau[worst]), ratio, float(z[worst]), sentence)


def _draw_identify(plt, record, posterior, unit):
    """Allan deviations of the record and of every hypothesis;
    probability against length.
    """
    y, dt = record.error, record.dt
    fig, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.2))
    tau, adev = allan_deviation(y, dt, per_octave=2)
    left.loglog(tau, adev, "k.-", label="record")
    m = np.unique(np.geomspace(1, max(len(y) // 3, 1), 40).astype(int))
    lengths = [n for n in len(y) // 2**np.arange(6, -1, -1) if n >= MIN_SAMPLES
               and (~np.isnan(y[:n])).sum() >= MIN_SAMPLES
               and np.nanmin(y[:n]) < np.nanmax(y[:n])]
    hypotheses = [e.hypothesis for e in posterior.estimates]
    history = np.array([identify(y[:n], dt, hypotheses).probability for n in lengths])
    for k, e in enumerate(posterior.estimates):
        filt = _filter_at(e.hypothesis, dt, e.mean)
        left.loglog(m * dt, np.sqrt(model_allan_variance(filt, m)),
                    color=f"C{k}",
                    label=f"{e.hypothesis.name}, {posterior.probability[k]:.3f}")
        right.semilogx(np.array(lengths) * dt, history[:, k], "o-", color=f"C{k}",
                       label=e.hypothesis.name)
    right.axhline(GAMMA, color="0.6", linestyle=":", label=f"threshold {GAMMA}")
    left.set(xlabel="averaging time, s", ylabel=f"Allan deviation, {unit}",
             title=f"{pathlib.Path(record.file).name}, {record.column}")
    right.set(xlabel="record length used, s", ylabel="probability of the hypothesis",
              ylim=(-0.03, 1.03), title="Eq. (10)")
    for ax in (left, right):
        ax.legend(frameon=False)
        ax.grid(True, which="major", alpha=0.3)
    return fig


def _criteria_command(options):
    model = read_model(options.model)
    _refuse_effects(options.model, model)
    _check_outputs([options.model], options.json, options.csv, plot=options.plot)
    if options.checkpoint is not None and not os.path.isdir(options.checkpoint):
        _check_outputs([], options.checkpoint)
        if os.path.exists(options.checkpoint):
            raise ValueError(f"{options.checkpoint} is a file: a folder is needed")
    if options.target is not None or options.target_rsd:
        return _targets_command(options, model)
    for name in ("design", "csv"):
        if getattr(options, name):
            raise ValueError(f"--{name} goes with --target or --target-rsd")
    plt = _matplotlib() if options.plot else None
    result = criteria(model.hypotheses, model.dt, options.duration,
                      500 if options.trials is None else options.trials, options.seed,
                      algorithms=_algorithms(options.algorithms),
                      checkpoint=options.checkpoint, progress=progress_bar)
    error = result.error_probability
    print(f"{result.trials} trials of {options.duration:g} s at {model.dt:g} s, seed "
          f"{options.seed}; real / calculated, +- standard error")
    print(f"{'time, s':>10}  {'error probability':<28}"
          + "".join(f"{'RSD ' + label:<28}" for label in result.labels))
    shown = np.unique(np.linspace(0, len(result.time) - 1, 12).astype(int))
    for i in shown:
        print(f"{result.time[i]:>10.4g}  " + "".join(
            f"{f'{c.real[i]:.4f} / {c.calculated[i]:.4f} +- {c.real_se[i]:.4f}':<28}"
            for c in (error, *result.rsd)))
    for name, r in result.rivals.items():
        print(f"\n{name}, on the same trials; error probability and what it is above "
              "the Bayesian one, then efficiencies")
        for i in shown:
            print(f"{result.time[i]:>10.4g}  " + f"{r.error_probability[i]:.4f}, "
                  + f"{f'{r.excess[i]:+.4f} +- {r.excess_se[i]:.4f}':<20}" + "".join(
                      f"{f'{e[i]:.2f} +- {se[i]:.2f}':<28}"
                      for e, se in zip(r.efficiency, r.efficiency_se)))
    if options.json:
        def by_label(parts):
            return dict(zip(result.labels, parts))
        _write_json(options.json, dict(
            time=result.time, trials=result.trials, seed=options.seed, unit=model.unit,
            error_probability=error._asdict(),
            rsd=by_label(c._asdict() for c in result.rsd),
            algorithms={name: {key: by_label(part) if isinstance(part, tuple) else part
                               for key, part in r._asdict().items()}
                        for name, r in result.rivals.items()}))
    if plt:
        _save(_draw_criteria(plt, result), options.plot)


def _draw_criteria(plt, result):
    fig, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.2))
    for ax, curves in ((left, [("error probability", result.error_probability)]),
                       (right, list(zip(result.labels, result.rsd)))):
        for number, (label, c) in enumerate(curves):
            color = f"C{number}"
            ax.plot(result.time, c.real, "-", color=color, label=label)
            ax.plot(result.time, c.calculated, "--", color=color)
            ax.fill_between(result.time, c.real - c.real_se, c.real + c.real_se,
                            color=color, alpha=0.2, linewidth=0)
        ax.plot([], [], "-", color="0.4", label="real, +- standard error")
        ax.plot([], [], "--", color="0.4", label="calculated")
    for number, (name, r) in enumerate(result.rivals.items(), 1):
        left.plot(result.time, r.error_probability, ":o", color=f"C{number}",
                  markersize=3, label=name)
        for label, c in enumerate(r.rsd):
            right.plot(result.time, c, ":", color=f"C{label}", linewidth=0.8)
    if result.rivals:
        right.plot([], [], ":", color="0.4", label="other algorithms")
    for ax, curves in (left, 2 + len(result.rivals)), (right, 2 + len(result.rsd)):
        ax.set_xlabel("time, s")
        ax.legend(frameon=False, fontsize="small", loc="upper right",
                  ncols=1 + (curves > 5))
        ax.grid(True, alpha=0.3)
        ax.margins(y=0.35 if curves > 5 else 0.05)
        ax.set_ylim(bottom=0)
    left.set_ylabel("identification error probability")
    right.set_ylabel("relative standard deviation")
    return fig


def _write_json(file, value):
    text = json.dumps(_finite(value), indent=1, allow_nan=False)
    _write(file, lambda stream: stream.write(text.encode()))


def _algorithms(text):
    names = list(ALGORITHMS) if text == "all" else (text or "").split(",")
    unknown = [name for name in names if name and name not in ALGORITHMS]
    if unknown:
        raise ValueError(f"--algorithms {', '.join(unknown)}: choose from "
                         + ", ".join(ALGORITHMS) + ", or all")
    return {name: ALGORITHMS[name] for name in names if name}


def _numbers_of(option, texts, most=1000):
    """Sorted numbers by name from texts NAME=V,V,..."""
    result = {}
    for text in texts:
        name, _, values = text.rpartition("=")
        try:
            numbers = sorted(float(v) for v in values.split(","))
        except ValueError:
            numbers = []
        if (not name or name in result or not 1 <= len(numbers) <= most
                or not all(0.0 < v < np.inf for v in numbers)):
            raise ValueError(f"{option} {text}: NAME=NUMBER is needed, once for each "
                             "name, and numbers > 0")
        result[name] = numbers
    return result


def _targets_command(options, model):
    """How long must be recorded: one answer, or a table over conditions."""
    rsd = {name: value for name, (value, *_) in _numbers_of(
        "--target-rsd", options.target_rsd, most=1).items()}
    design = _numbers_of("--design", options.design)
    if set(design) - {"dt", "sigma_v"}:
        raise ValueError(f"--design {', '.join(design)}: dt and sigma_v can be varied")
    if options.algorithms:
        raise ValueError("--algorithms goes with criteria, not with a target")
    if options.plot and not design:
        raise ValueError("--plot goes with --design: a single answer is no picture")
    conditions = [(sigma_v, *at_condition(model.hypotheses, model.dt, dt, sigma_v))
                  for dt, sigma_v in itertools.product(design.get("dt", [None]),
                                                       design.get("sigma_v", [None]))]
    trials = 4000 if options.trials is None else options.trials
    for _, hypotheses, interval in conditions:    # refuse them before the work
        _targets(hypotheses, options.target, rsd)
        _check_trials(hypotheses, interval, options.duration, trials)
    plt = _matplotlib() if options.plot else None
    rows = []
    print(f"shortest record [95 % interval], {trials} trials of {options.duration:g} s "
          f"at most, seed {options.seed}")
    for sigma_v, hypotheses, interval in conditions:
        answer = record_length(hypotheses, interval, options.duration, options.target,
                               rsd, trials, options.seed,
                               checkpoint=options.checkpoint, progress=progress_bar)
        condition = f"dt {interval:g} s" + (
            f", sigma_v {sigma_v:g} {model.unit} at {model.dt:g} s" if sigma_v else "")
        for n in answer:
            rows.append(dict(dt=interval, sigma_v=sigma_v, **n._asdict()))
            found = (f"{n.duration:.4g} s [{n.interval[0]:.4g}, {n.interval[1]:.4g}]"
                     if n.duration == n.duration else
                     f"not within {options.duration:g} s, {n.reached:.4g} there")
            line = f"{condition}: {n.label} {n.target:g}: {found}"
            print("; ".join(filter(None, (line, n.reason))), flush=True)
    if options.json:
        _write_json(options.json, dict(seed=options.seed, trials=trials, needed=rows))
    if options.csv:
        names = "dt", "sigma_v", "label", "target", "duration", "low", "high", "reached"
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(names)
        table.writerows(["" if v is None or v != v else v for v in (
            r["dt"], r["sigma_v"], r["label"], r["target"], r["duration"],
            *r["interval"], r["reached"])] for r in rows)
        _write(options.csv, lambda stream: stream.write(text.getvalue().encode()))
    if plt:
        _save(_draw_design(plt, rows, options.duration, model.unit), options.plot)


def _draw_design(plt, rows, limit, unit):
    """Needed duration against one condition, a line for each value of the other."""
    labels = list(dict.fromkeys((r["label"], r["target"]) for r in rows))
    several = len({r["sigma_v"] for r in rows}) > 1
    x, other = ("sigma_v", "dt") if several else ("dt", "sigma_v")
    fig, axes = plt.subplots(1, len(labels), figsize=(1.0 + 4.6 * len(labels), 4.2),
                             squeeze=False)
    for ax, (label, target) in zip(axes[0], labels):
        for number, value in enumerate(dict.fromkeys(r[other] for r in rows)):
            own = [r for r in rows if (r["label"], r["target"], r[other]) == (
                label, target, value)]
            at = np.array([r[x] for r in own])
            low, high = np.clip([r["interval"] for r in own], None, limit).T
            ax.plot(at, [r["duration"] for r in own], "o-", color=f"C{number}",
                    label=None if value is None else
                    f"dt = {value:g} s" if several else f"sigma_v = {value:g} {unit}")
            ax.fill_between(at, low, high, color=f"C{number}", alpha=0.15, linewidth=0)
            never = at[[r["duration"] != r["duration"] for r in own]]
            ax.plot(never, np.full(len(never), limit), "^", color=f"C{number}")
        ax.set(xscale="log", yscale="log", ylabel="needed record length, s",
               xlabel=f"white noise sigma_v, {unit}" if several else
               "sampling interval, s",
               title=f"{label} of {target:g}")
        ax.plot([], [], "k^", label=f"not within {limit:g} s")
        ax.grid(True, which="both", alpha=0.3)
        ax.legend(frameon=False)
    return fig


def _simulate_command(options):
    model = read_model(options.model)
    _check_outputs([options.model, options.like], options.out)
    if options.records < 1 or options.samples is not None and options.samples < 1:
        raise ValueError("--records and --samples must be at least 1")
    needed = sorted({one.column for added in model.effects for one in added} - {""})
    if needed and not options.like:
        raise ValueError(f"the effects of {options.model} need the column"
                         f"{'s' * (len(needed) > 1)} {', '.join(needed)}: "
                         "give a record that has them with --like")
    scene = Scene(np.zeros(options.samples or 0), model.dt, {})
    if options.like:
        options.record = options.like
        like = _read(options, model, beside=needed)
        scene = Scene(like.error, model.dt, like.columns)
        check_columns(like.error, like.columns)
    trials = simulate_effects(model.hypotheses,
                              model.effects or ((),) * len(model.hypotheses), scene,
                              options.records, options.seed)
    names = np.array([h.name for h in model.hypotheses])
    _write(options.out, lambda stream: np.savez(
        stream, error=trials.error, dt=model.dt, hypothesis=names[trials.hypothesis],
        theta=trials.theta))
    print(f"{options.out}: error {trials.error.shape}, dt {model.dt:g} s")


def simulator_from(records, dt):
    """Hypotheses that describe records of a black box.

    Parameters
    ----------
    records : (L, N) array
    dt : float

    Returns
    -------
    tuple of Hypothesis
        Those found in any of the records; the range of a parameter holds its posterior
        mean -+ 2 standard deviations in all of them.
    """
    spans = {}
    for y in records[:20]:
        posterior = identify(y, dt, default_hypotheses(y, dt))
        e = posterior.estimates[int(posterior.probability.argmax())]
        for p, mean, sd in zip(e.hypothesis.parameters, e.mean,
                               np.sqrt(np.diag(e.covariance))):
            low, high = max(p.low, mean - 2 * sd), min(p.high, mean + 2 * sd)
            old = spans.setdefault(e.hypothesis.name, {}).get(p.symbol, (low, high))
            spans[e.hypothesis.name][p.symbol] = min(low, old[0]), max(high, old[1])
    means = np.nanmean(records, axis=1)
    bias = float(np.sqrt(np.mean(means**2)) + np.nanstd(records[0]))
    return tuple(hypothesis(name, bias_sigma=bias, **parameters)
                 for name, parameters in spans.items())


def _list_effects(options):
    scene = None
    if options.record is not None:
        record = _read(options, None, None)
        scene = Scene(record.error, record.dt, record.columns)
        check_scene(*scene)
    print("y is the error, u its unit, t the time, T the duration, dt the sampling "
          "interval.\nThe prior of a size, slope, coefficient or amplitude is highest "
          "at 4 standard errors,\nfalls from there on and is 0 at 0.\n")
    print("\n".join(describe(effect, scene) for effect in CATALOGUE.values()))


def _diagnose_command(options):
    if options.effects:
        return _list_effects(options)
    if options.record is None:
        raise ValueError("diagnose needs a record (--effects alone does without)")
    model = read_model(options.model) if options.model else None
    folder = None
    if options.out is not None:
        folder = pathlib.Path(options.out)
        if folder.exists() and not folder.is_dir():
            raise ValueError(f"{folder} is a file: a folder is needed")
        _check_outputs([], *([folder / "report.json"] if folder.is_dir() else [folder]))
        _check_outputs([options.record, options.model, options.simulated],
                       *(folder / name for name in ("report.json", "model.json")
                         if folder.is_dir()))
    plt = _matplotlib() if folder else None
    beside = None if options.covariates is None else [
        part for part in options.covariates.split(",") if part]
    record = _read(options, model, beside)
    y, dt, known = record.error, record.dt, ()
    unit = model.unit if model else "u"
    if model:
        hypotheses, known = _with_effects(options.model, model, record)
        scene = Scene(y, dt, record.columns)
        for one in known:
            y = y - signature_of(scene, one, {k: p.low
                                              for k, p in one.parameters.items()})
    elif options.simulated:
        hypotheses = simulator_from(_simulated(options, dt), dt)
    else:
        hypotheses = default_hypotheses(y, dt)
    d = diagnose(y, dt, hypotheses, record.columns, seed=options.seed,
                 progress=progress_bar)
    print(_table(d, record, unit), end="")
    if folder:
        folder.mkdir(exist_ok=True)
        sample = d.final.samples[d.final.best]
        sd = np.sqrt(sample.weight @ (sample.theta - d.final.theta)**2)
        # a uniform range of this half-width has that standard deviation
        h, added = as_simulated(d.final, d.scene, d.after.theta, np.sqrt(3.0) * sd)
        text = model_text(Model(dt, unit, (h,), ((*known, *added),)))
        answer = json.dumps(report(d, record), indent=1, allow_nan=False)
        _write(folder / "model.json", lambda stream: stream.write(text.encode()))
        _write(folder / "report.json", lambda stream: stream.write(answer.encode()))
        _save(_draw_diagnosis(plt, d, record, unit), folder / "report.png")
        print(f"{folder}: report.json, report.png, model.json")


def _with_effects(file, model, record):
    """Hypotheses of a model file with its processes and jumps, and its signatures."""
    if not model.effects:
        return model.hypotheses, ()
    added = model.effects[0]
    if any(other != added for other in model.effects):
        raise ValueError(f"the hypotheses of {file} have different effects: "
                         "diagnose takes one set for all")
    for one in added:
        name, kind = one.effect.name, one.effect.kind
        if kind == "reading":
            raise ValueError(f"{file} has {name}, which a record shows by itself: "
                             "take it out to diagnose one")
        if kind == "signature" and any(p.free for p in one.parameters.values()):
            raise ValueError(f"{name} of {file} has a range: diagnose needs a number")
        if one.column and one.column not in record.columns:
            raise ValueError(f"{name} of {file} needs a column {one.column}: beside "
                             f"the error is {', '.join(record.columns) or 'nothing'}")
    scene = Scene(record.error, record.dt, record.columns)
    return (tuple(with_processes(scene, h, added) for h in model.hypotheses),
            tuple(one for one in added if one.effect.kind == "signature"))


def _simulated(options, dt):
    """Records (L, N) of a black-box simulator."""
    file = pathlib.Path(options.simulated)
    if file.suffix.lower() == ".npz" and file.is_file():
        with _loaded(file, np.load) as archive:
            if "error" in archive.files and archive["error"].ndim == 2:
                own = float(archive["dt"]) if "dt" in archive.files else dt
                if abs(own - dt) > 0.01 * dt:
                    raise ValueError(f"{file} is sampled at {own:g} s, "
                                     f"the record at {dt:g} s")
                return np.asarray(archive["error"], float)
    simulated = read_record(file, "error", options.dt)
    if abs(simulated.dt - dt) > 0.01 * dt:
        raise ValueError(f"{file} is sampled at {simulated.dt:g} s, "
                         f"the record at {dt:g} s")
    return simulated.error[None]


def _finite(x):
    """A value for JSON: None for a number that there is not."""
    if isinstance(x, dict):
        return {name: _finite(v) for name, v in x.items()}
    if isinstance(x, (list, tuple, np.ndarray)):
        return [_finite(v) for v in x]
    if x is None or isinstance(x, (str, int)):
        return x
    return float(x) if np.isfinite(x) else None


def _outstanding(gap):
    """Of every place the statistic that stands out most, largest first."""
    places = np.array(gap.statistics.place)
    best = [int(np.flatnonzero(places == place)[
        np.abs(gap.distance[places == place]).argmax()])
        for place in gap.p_place]
    return sorted(best, key=lambda i: -abs(gap.distance[i]))


def report(d, record):
    """Contents of report.json for a diagnosis of a `Record`."""
    s = d.before.statistics
    return _finite(dict(
        record=dict(file=record.file, column=record.column, samples=len(record.error),
                    dt=record.dt),
        verdict=d.verdict,
        gap=dict(p_value=d.before.p_value, residual_p_value=d.after.p_value,
                 before=d.rms_before, after=d.rms_after, closed=d.closed,
                 closed_interval=d.closed_interval,
                 nats_per_sample=d.nats_per_sample,
                 held_out=d.held_out and d.held_out._asdict()),
        where=[dict(place=s.place[i], at=s.at[i],
                    column=s.column[i] or None, before=abs(float(d.before.distance[i])),
                    after=abs(float(d.after.distance[i])),
                    p_value=d.before.p_place[s.place[i]],
                    residual_p_value=d.after.p_place[s.place[i]])
               for i in _outstanding(d.before)],
        causes=[dict(effect=c.effect, column=c.column or None,
                     probability=c.probability, log_bayes_factor=c.log_bayes,
                     parameters={k: dict(mean=v[0], sd=v[1])
                                 for k, v in c.parameters.items()})
                for c in d.causes],
        needed_duration=d.needed_duration))


FACTORS = {9.80665: "g taken for m/s^2", 57.29578: "deg taken for rad",
           3600.0: "per hour taken for per second", 60.0: "per root hour taken for "
           "per root second", 1000.0: "milli left out"}


def _looks_like(factor, sd, dt):
    """What a wrong factor usually is."""
    named = {**FACTORS, 1.0 / dt: "the sampling rate",
             dt**-0.5: "root of the rate: a density taken for a per-sample sigma, or "
             "the other way round"}
    for value, text in named.items():
        for v in (value, 1.0 / value):
            if abs(factor - v) < max(3.0 * sd, 0.03 * v) and sd < 0.2 * v \
                    and abs(np.log(v)) > 0.2:
                return f"about {v:.4g}: {text}"
    return ""


def _words(c, dt):
    """Parameters of a cause as text."""
    parts = []
    for name, (mean, sd) in c.parameters.items():
        if isinstance(mean, list):
            shown = mean if len(mean) <= 2 else f"{len(mean)} of them"
            parts.append(f"{name} {shown}")
        elif isinstance(mean, str):
            parts.append(mean)
        else:
            parts.append(f"{name} {mean:.4g}" + (f" +- {sd:.2g}" if sd else ""))
    if c.effect == "wrong_parameter" and "factor" in c.parameters:
        parts.append(_looks_like(*c.parameters["factor"], dt))
    return ", ".join(filter(None, parts))


def _table(d, record, unit):
    """The diagnosis as a table for a terminal."""
    lines = [f"{record.file}, column {record.column}: {len(record.error)} samples at "
             f"{record.dt:g} s; beside it: {', '.join(record.columns) or 'nothing'}",
             f"verdict: {d.verdict}"
             + (", alone or with another effect" if d.causes[0].probability < SURE
                and d.verdict != "undecided" else "")]
    if d.before.p_value > 0.05 and d.verdict == "none":
        lines.append("the simulator describes the record: a gap as large has the "
                     f"chance {d.before.p_value:.2g}")
    elif d.before.p_value > 0.05:
        lines.append("no place stands out by itself (a gap as large has the chance "
                     f"{d.before.p_value:.2g}): only the search for each effect tells")
    else:
        lines.append(f"gap: {d.rms_before:.3g} standard deviations where it stands out "
                     f"(p = {d.before.p_value:.2g}; 1 is no gap)")
    shown = {c.effect + (f" ({c.column})" if c.column and c.column not in c.effect
                         else ""): c for c in d.causes[:6]
             if c.probability >= LISTED or c.effect in ("none", "unknown")}
    width = max(map(len, shown)) + 2
    lines.append(f"{'cause':<{width}}probability    ln B  size, in {unit}, s, Hz")
    for name, c in shown.items():
        log_bayes = "" if c.effect in ("none", "unknown") else f"{c.log_bayes:.1f}"
        lines.append(f"{name:<{width}}{c.probability:>11.3f}{log_bayes:>8}  "
                     + _words(c, record.dt))
    lines.append(f"{'where':<16}{'at':<30}{'before':>8}{'after':>8}{'p':>10}"
                 "   standard deviations")
    s = d.before.statistics
    for i in _outstanding(d.before):
        before, after = (abs(g.distance[i]) for g in (d.before, d.after))
        lines.append(f"{s.place[i]:<16}{_at(s, i):<30}{before:>8.1f}{after:>8.1f}"
                     f"{d.before.p_place[s.place[i]]:>10.2g}")
    if np.isfinite(d.closed):
        lines.append(f"closed by adding {_added_names(d)}: {_percent(d)} of the gap, "
                     f"{d.nats_per_sample:.2g} nats a sample; left: p = "
                     f"{d.after.p_value:.2g}")
    if d.held_out:
        h = d.held_out
        lines.append("the last third, by a fit of the others: "
                     + (f"closed {_percent(h)}, " if np.isfinite(h.closed) else
                        "nothing stands out, ")
                     + f"{h.gain:+.2g} nats a sample (a regression on {LAGS} samples "
                     f"and all columns: {h.reference:+.2g}); errors are "
                     f"{h.ratio_before:.3g} of what is calculated before, "
                     f"{h.ratio_after:.3g} after")
    named = [c.effect for c in d.causes if c.effect in CATALOGUE][:2]
    for name in named if d.verdict == "undecided" else named[:1]:
        e = CATALOGUE[name]
        if d.verdict != "none":
            lines.append(f"{name} is confused with {e.resembles}; "
                         f"to tell: {e.experiment}")
    lines += [f"{one.effect.name} is that with the {one.variant} of {one.column}"
              for one in d.final.signatures if one.effect.build is _curved]
    for column in {s.column for s in d.final.signatures if s.column}:
        low, high = _clusters(d.scene.columns[column])
        if high:
            lines.append(f"{column} is {low[0]:.4g} to {low[1]:.4g} or {high[0]:.4g} "
                         f"to {high[1]:.4g}, never between: whatever else changed "
                         "with it explains the record as well")
    if d.verdict == "undecided":
        lines.append(f"a record of about {float(f'{d.needed_duration:.2g}'):g} s would "
                     "tell the first two apart, if the odds grow as they did")
    if d.verdict == "unknown":
        i = _outstanding(d.after)[0]
        lines.append("what is left fits no effect of the catalogue: look at "
                     f"{s.place[i].replace('_', ' ')}, {_at(s, i)}")
    return "\n".join(lines) + "\n"


def _percent(part):
    """What is closed of a gap, and its interval, as text."""
    low, high = part.closed_interval
    return f"{100 * part.closed:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"


def _at(s, i):
    """Where statistic number i looks, as text."""
    (low, high), unit = s.at[i], s.column[i] or UNITS[s.place[i]]
    if s.place[i] == "amplitude" and max(-low, high) >= FAR:
        if high - low >= 2.0 * FAR:
            return "all of it"
        return f"below {high:.3g} {unit}" if low <= -FAR else f"beyond {low:.3g} {unit}"
    return (f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}") + f" {unit}"


def _clusters(x):
    """Ends of the lower and the upper cluster of a column, the latter () if one is all:
    two are apart by more than half of the range.
    """
    x = np.sort(x)
    at = int(np.diff(x).argmax())
    if x[at + 1] - x[at] < 0.5 * (x[-1] - x[0]):
        return (x[0], x[-1]), ()
    return (x[0], x[at]), (x[at + 1], x[-1])


def _added_names(d):
    return "+".join(c.effect for c in d.found) or "nothing"


def _draw_diagnosis(plt, d, record, unit):
    """Log-score gain over time; Allan deviation in the simulated bands before and
    after; residuals against what the cause is about.
    """
    scene = d.scene
    fig, axes = plt.subplots(1, 3, figsize=(15.0, 4.4))
    fig.suptitle(f"{pathlib.Path(record.file).name}, {record.column}: {d.verdict}")
    left, middle, right = axes
    gain = np.nan_to_num(d.after.log_score - d.before.log_score)
    left.plot(scene.time, np.cumsum(gain), "k-")
    left.set(xlabel="time, s", title=f"gain of the simulator with {_added_names(d)}",
             ylabel="log score, one step ahead, sum, nats")

    tau, adev = allan_deviation(scene.y, scene.dt)
    m = np.round(tau / scene.dt).astype(int)
    for acc, gap, colour, label in (
            (d.base, d.before, "tab:red", "simulator as it was"),
            (d.final, d.after, "tab:blue", f"with {_added_names(d)}")):
        h, added = as_simulated(acc, scene, gap.theta)
        drawn = simulate_effects([h], [added], scene, 60, 1).error
        curves = np.sqrt([allan_variance(drawn, scene.dt, k) for k in m])
        middle.fill_between(tau, *np.nanquantile(curves, [0.05, 0.95], axis=1),
                            color=colour, alpha=0.3, linewidth=0,
                            label=f"{label}, 90 % of records")
    middle.loglog(tau, adev, "k.-", label="record")
    middle.set(xlabel="averaging time, s", ylabel=f"Allan deviation, {unit}",
               xscale="log", yscale="log")
    middle.legend(frameon=False)

    i = _outstanding(d.before)[0]
    place, column = d.before.statistics.place[i], d.before.statistics.column[i]
    for z, colour, label in ((d.before.z, "tab:red", "before"),
                             (d.after.z, "tab:blue", "after")):
        x, value = _residual_curve(z, scene, place, column)
        right.plot(x, value, ".-", color=colour, label=label, alpha=0.8)
    labels = dict(
        time=("time, s", "mean residual, standard errors"),
        frequency=("frequency, Hz", "power of the residuals"),
        averaging_time=("lag, s", "correlation of the residuals"),
        lag=("lag, s", "correlation of the residuals"),
        amplitude=("residual, standard deviations", "samples over those expected"),
        covariate=(column, "mean residual, standard errors"))
    right.set(xlabel=labels[place][0], ylabel=labels[place][1],
              title=f"where it stands out: {place.replace('_', ' ')}")
    if place == "frequency":
        right.set(xscale="log", yscale="log")
    right.legend(frameon=False)
    for ax in axes:
        ax.grid(True, which="major", alpha=0.3)
    return fig


def _residual_curve(z, scene, place, column):
    """Residuals against the coordinate of a place."""
    seen = ~np.isnan(z)
    z0 = np.where(seen, z, 0.0)
    if place == "frequency":
        power = np.abs(np.fft.rfft(z0))**2 / max(seen.sum(), 1)
        edges = np.unique(np.geomspace(1, len(power), 60).astype(int))
        frequency = np.fft.rfftfreq(len(z), scene.dt)
        return ([frequency[a:b].mean() for a, b in zip(edges[:-1], edges[1:])],
                [power[a:b].max() if b - a < 3 else power[a:b].mean()
                 for a, b in zip(edges[:-1], edges[1:])])
    if place in ("lag", "averaging_time"):
        lags = np.arange(1, min(40, len(z) // 4))
        return lags * scene.dt, [np.mean(z0[k:] * z0[:-k]) for k in lags]
    if place == "amplitude":
        edges = np.linspace(-6.0, 6.0, 25)
        count = np.histogram(z0[seen].clip(-5.99, 5.99), edges)[0]
        expected = np.diff(ndtr(edges)) * seen.sum()
        return 0.5 * (edges[1:] + edges[:-1]), (count + 0.5) / (expected + 0.5)
    x = scene.columns[column] if place == "covariate" else scene.time
    parts = [part for part in np.array_split(np.argsort(x, kind="stable"), 32)
             if seen[part].any()]
    return ([x[part].mean() for part in parts],
            [z0[part].sum() / np.sqrt(seen[part].sum()) for part in parts])


COMMANDS = dict(identify=_identify, criteria=_criteria_command,
                simulate=_simulate_command, diagnose=_diagnose_command)


def main(argv=None):
    """Run the command line; returns the exit status: 0 done, 2 bad input."""
    options = _parser().parse_args(argv)
    try:
        COMMANDS[options.command](options)
        sys.stdout.flush()
    except BrokenPipeError:    # the reader has had enough, as `head` has
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except (ValueError, OSError, OverflowError) as problem:
        print(f"sensorid: {' '.join(str(problem).split())}", file=sys.stderr)
        return 2
    except MemoryError as problem:
        print(f"sensorid: too large for the memory: {problem}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, SystemError) as problem:
        cause = problem    # compiled code turns an interrupt into SystemErrors
        while isinstance(cause, SystemError):
            cause = cause.__cause__
        if not isinstance(cause, KeyboardInterrupt):
            raise
        kept = getattr(options, "checkpoint", None)
        print("sensorid: interrupted" + (
            f"; finished trials are kept in {kept}, the same command goes on from there"
            if kept else ""), file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    _parser().parse_args()    # help and misuse end here
    from sensorid import main as _main    # under this name compiled code is cached
    sys.exit(_main())
