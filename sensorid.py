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

import sys

__version__ = "0.41.0"


def main(argv=None):
    """Run the command line; returns the exit status: 0 done, 2 bad input.

    All commands where `sensorlab` can be imported; where this file was copied alone,
    `identify` of a plain CSV.
    """
    try:
        from sensorlab.commands import main as whole
    except ModuleNotFoundError as missing:
        if missing.name != "sensorlab":
            raise
    else:
        return whole(argv)
    import argparse
    parser = argparse.ArgumentParser(prog="sensorid", description=__doc__.split("\n\n")[
        0] + " More commands and files: copy the folder sensorlab beside this one.")
    parser.add_argument("command", metavar="identify")
    parser.add_argument("record", nargs="?", help="CSV with a header: time,error")
    parser.add_argument("--column", default="error", help="of the error")
    parser.add_argument("--dt", type=float, help="sampling interval, s; without time")
    options, more = parser.parse_known_args(argv)
    try:
        if more or options.command != "identify" or not options.record:
            raise ValueError(
                "this file alone runs `identify RECORD.csv [--column C] [--dt S]`: for "
                "all else copy the folder sensorlab beside it, or install the project")
        from sensorid import identify_csv    # by name: compiled code is kept under it
        print(identify_csv(options.record, options.column, options.dt))
    except (ValueError, OSError) as problem:
        said = (f"{problem.filename}: {problem.strerror}" if isinstance(
            problem, OSError) and problem.filename else " ".join(
                str(problem).split()))
        print(f"sensorid: {said}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":    # before anything large is imported
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("sensorid: interrupted")


def __getattr__(name):
    """What stood in this file before 0.2 and stands in `sensorlab` now."""
    if not name.startswith("_"):
        try:
            import sensorlab
            return getattr(sensorlab, name)
        except (ModuleNotFoundError, AttributeError):
            pass
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}; diagnosis, "
                         "files and other algorithms are in the package sensorlab")


import contextlib
import functools
import hashlib
import inspect
import operator
import os
import pathlib
import pickle
import secrets
import sysconfig
import types
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from typing import Callable, NamedTuple

# threads that spin while they wait make small work 20 times slower beside other work
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import numpy as np
from numba import get_num_threads, njit, prange, set_num_threads
from scipy.optimize import brentq, isotonic_regression
from scipy.special import chdtri, gammaln, ndtr, ndtri

__all__ = [
    "MODELS", "ShapingFilter", "shaping_filter", "Parameter", "Hypothesis",
    "hypothesis", "default_hypotheses", "simulate", "grid", "uniform_grid", "bank",
    "filter_bank", "log_likelihood", "posteriors", "identify", "decide", "matrices",
    "estimate_state", "criteria", "record_length", "allan_variance", "allan_deviation",
    "model_allan_variance", "allan_misfit", "main"]

try:
    CACHE = bool(njit(cache=True)(lambda: None))
except RuntimeError:    # neither this folder nor the user's own cache can be written
    CACHE = False
# vectors are as wide as LLVM has it for a processor: 512 bits on Zen 5 (30 % less time
# than 256); NUMBA_CPU_FEATURES forces them in all code of a process, no module should
JIT = dict(cache=CACHE, error_model="numpy", fastmath={"contract"},
           no_cfunc_wrapper=True)    # nobody calls it from C, and it takes a tenth of
                                     # the time that compiling takes
# of what other compiled code calls: a second copy of its own may be rounded in another
# way, and which of the two a process takes would hang on what it has compiled itself
INSIDE = dict(JIT, forceinline=True)
LOG_2PI = np.log(2.0 * np.pi)


def as_samples(y):
    """Values as an array of floats, NaN where they are masked."""
    if np.ma.isMaskedArray(y):
        y = y.astype(float).filled(np.nan)
    if hasattr(y, "error"):
        raise ValueError(f"a {type(y).__name__} stands where an array of samples is "
                         "needed: give its .error")
    if np.asarray(y).dtype.kind not in "biuf":
        try:
            return np.asarray(np.asarray(y).tolist(), float)
        except (TypeError, ValueError) as error:
            raise ValueError(f"the record holds what is no real number ({error}): "
                             "numbers are needed, NaN where one is missing") from None
    return np.asarray(y, float)


def check_whole(value, what, least=0):
    """Refuse what is not a whole number, or several, from some number on."""
    whole = np.asarray(value)
    if whole.dtype.kind not in "iu" or (whole < least).any():
        raise ValueError(f"{what} {value}: whole numbers >= {least} are needed")


def check_seed(seed):
    """Refuse what is no seed of random numbers."""
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ValueError(f"the seed is {seed!r}: a whole number >= 0 is needed")


MIN_SAMPLES = 16    # fewer say nothing of any correlated process
SCALE = 1e-15, 1e15    # u, of values: products of their squares remain numbers


def is_number(x):
    """Is it one real number?"""
    return not np.ndim(x) and np.asarray(x).dtype.kind in "iuf"


def check_interval(dt):
    """Refuse what is no sampling interval."""
    if not (is_number(dt) and 0 < dt < np.inf):
        raise ValueError(f"the sampling interval is {dt} s: it must be a number > 0")


def check_axis(y):
    """Refuse what are no samples of one axis."""
    if y.ndim != 1:
        raise ValueError(f"the record has shape {y.shape}: "
                         "one axis of one sensor is needed")
    check_finite(y)


def check_finite(y):
    """Refuse samples of which some are infinite."""
    if np.isinf(y).any():
        raise ValueError(f"the record holds {np.isinf(y).sum()} infinite values, "
                         f"the first at sample {np.argmax(np.isinf(y))}: "
                         "remove them or mark them missing")


def check_record(y, dt):
    """Refuse what no model can be identified from."""
    check_interval(dt)
    check_axis(y)
    observed = y[~np.isnan(y)]
    if len(observed) < MIN_SAMPLES:
        raise ValueError(f"the record has {len(observed)} samples: "
                         f"at least {MIN_SAMPLES} are needed")
    if (observed == observed[0]).all():
        raise ValueError(f"the record is constant ({observed[0] + 0.0:g}): "
                         "there is no error model to identify, check the column")


def check_unit(y):
    """Refuse a record whose numbers are too small or too large to be worked with."""
    low, high = float(np.nanmin(y)), float(np.nanmax(y))
    if not SCALE[0] < high - low <= 2.0 * max(-low, high) < SCALE[1]:
        raise ValueError(f"the record runs from {low:g} to {high:g}: choose a unit in "
                         f"which it varies by more than {SCALE[0]:g} and less than "
                         f"{SCALE[1]:g}")


@contextlib.contextmanager
def one_thread_if(little):
    """With one thread where there is little work: where another process has the other
    cores, to wait for a second thread takes longer.
    """
    threads = get_num_threads()
    set_num_threads(1 if little else threads)
    try:
        yield
    finally:
        set_num_threads(threads)


def side_by_side(function, items):
    """function(item) of every item, in their order; as many at a time as there are
    threads, each of which has no further ones. What runs long in it must leave the
    interpreter to the others.
    """
    threads = min(get_num_threads(), len(items))
    if threads <= 1:
        return [function(item) for item in items]
    with ThreadPoolExecutor(threads, initializer=set_num_threads,
                            initargs=(1,)) as pool:
        return list(pool.map(function, items))


def brief(self):
    """repr of a result: numbers by six digits, what is long by its size."""
    def shown(value):
        if isinstance(value, (float, np.floating)):
            return f"{value:.6g}"
        if isinstance(value, np.ndarray) and value.size > 6:
            return f"array{value.shape}"
        if isinstance(value, (tuple, list, dict)) and len(value) > 6:
            return f"{type(value).__name__} of {len(value)}"
        if type(value) in (tuple, list):
            return f"({', '.join(map(shown, value))})"
        if isinstance(value, dict):
            return f"{{{', '.join(f'{k!r}: {shown(v)}' for k, v in value.items())}}}"
        return getattr(value, "name", None) or repr(value)
    return f"{type(self).__name__}(" + ", ".join(
        f"{name}={shown(value)}" for name, value in zip(self._fields, self)) + ")"


# ---- 1. Models -------------------------- paper Secs. 2 and 4, Eqs. (1)-(2), (21)-(23)

class ShapingFilter(NamedTuple):
    """Matrices of Eqs. (1)-(2); the leading axis is time, of one step or of all."""

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
        If the shapes do not fit, there are more than six states, or a number is none
        that such a filter can have.

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
    filt = ShapingFilter(Phi, Gamma, H, np.atleast_1d(np.array(Psi, float)), m0, P0)
    lengths = {len(m) for m in filt[:4]} - {1}
    if len(lengths) > 1:
        raise ValueError(f"Phi, Gamma, H and Psi are of {sorted(lengths)} samples: of "
                         "all samples, or one for all")
    if not all(np.isfinite(m).all() for m in filt):
        raise ValueError("a shaping filter has numbers that are not finite")
    # a bank asks for one at every node, most of them without P0
    if (filt.Psi < 0.0).any() or P0.any() and (not np.allclose(P0, P0.T) or (
            np.linalg.eigvalsh(P0)[0] < -1e-9 * np.abs(P0).max())):
        raise ValueError(f"Psi = {filt.Psi.min():g} and the eigenvalues of P0 must be "
                         ">= 0, and P0 symmetric: they are of noise")
    return filt


def sum_of(sigma_v, *processes):
    """Independent one-state processes in white noise; of each the transition factor,
    the standard deviation of w and the variance of x_0: numbers, or columns (M, 1).
    """
    n = len(processes)
    shape = np.broadcast_shapes((1,), *(np.shape(v) for one in processes for v in one))
    Phi, Gamma, P0 = diagonals = np.zeros((3, *shape, n, n))
    for s, process in enumerate(processes):
        for diagonal, value in zip(diagonals, process):
            diagonal[..., s, s] = value
    return ShapingFilter(Phi, Gamma, np.ones((1, n)), np.array(sigma_v, float, ndmin=1),
                         np.zeros(n), P0[..., 0, :, :])


def _markov(dt, tau_m, sigma_m):
    drive = sigma_m * np.sqrt(-np.expm1(-2.0 * dt / tau_m))
    return np.exp(-dt / tau_m), drive, sigma_m**2


def white_noise(dt, sigma_v):
    """White noise alone, Eq. (23) without a correlated part."""
    return sum_of(sigma_v, (0.0, 0.0, 0.0))


def random_walk(dt, sigma_w, sigma_v=0.0):
    """Random walk from 0, Eq. (21); sigma_w per sample."""
    return sum_of(sigma_v, (1.0, sigma_w, 0.0))


def markov(dt, tau_m, sigma_m, sigma_v=0.0):
    """First-order Markov process in its steady state, Eq. (22)."""
    return sum_of(sigma_v, _markov(dt, tau_m, sigma_m))


def random_walk_markov(dt, sigma_w, tau_m, sigma_m, sigma_v=0.0):
    """Random walk plus first-order Markov process."""
    return sum_of(sigma_v, (1.0, sigma_w, 0.0), _markov(dt, tau_m, sigma_m))


def two_markov(dt, tau_m, sigma_m, tau_n, sigma_n, sigma_v=0.0):
    """Two first-order Markov processes."""
    return sum_of(sigma_v, _markov(dt, tau_m, sigma_m), _markov(dt, tau_n, sigma_n))


def rate_ramp(dt, slope, sigma_w=0.0, sigma_v=0.0):
    """Ramp of a given slope, u/s (IEEE Std 952, rate ramp), on a random walk."""
    return shaping_filter([[1.0, dt], [0.0, 1.0]], [[sigma_w], [0.0]], [1.0, 0.0],
                          sigma_v, m0=[0.0, slope])


SUMS = white_noise, random_walk, markov, random_walk_markov, two_markov
MODELS = {model.__name__: model for model in (*SUMS, rate_ramp)}


class Parameter(NamedTuple):
    """A parameter: fixed where low == high, else uniform or log-uniform."""

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


def middles(count):
    """Quantiles of a prior in the middle of so many equal parts."""
    return (np.arange(count) + 0.5) / count


def mesh(*axes):
    """All points (M, d) of the values of d axes; the last one changes first."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(axes))


class Hypothesis(NamedTuple):
    """A structure of the error model with its priors, see `hypothesis`."""

    name: str
    model: Callable[..., ShapingFilter]
    parameters: tuple
    bias_sigma: float
    bias_given: bool = True    # or a record may widen it

    def filter(self, dt, theta):
        """Shaping filter at one value of the parameters."""
        return self.model(dt, **{p.symbol: value
                                 for p, value in zip(self.parameters, theta)})

    @property
    def elementwise(self):
        """Does `filter` take columns of parameters, of all nodes at once, too?"""
        return self.model in SUMS


def hypothesis(model, name=None, bias_sigma=None, prior="uniform", **parameters):
    """Hypothesis h_k of Eqs. (1)-(2): a shaping filter, a bias and priors.

    Parameters
    ----------
    model : str or function
        A name in MODELS, or a function of dt, s, and the parameters that returns a
        `shaping_filter`. Parameters called sigma_* are standard deviations.
    name : str, optional
        Label in tables and legends, by default the name of the model.
    bias_sigma : float >= 0, optional
        The constant bias is drawn from N(0, bias_sigma^2), u. By default 1, as in the
        paper; `identify` widens this default to the offset of a record if it is larger.
    prior : "uniform" or "log"
        Law of every parameter given as a range.
    **parameters : float, (low, high) or Parameter
        Known value, range of an unknown one, or range with a law of its own. Without
        sigma_v, u, the models in MODELS have no white noise.

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
    if not callable(model):
        if model not in MODELS:
            raise ValueError(f"unknown hypothesis {model!r}: "
                             f"known are {', '.join(MODELS)}")
        model = MODELS[model]
    name = name or getattr(model, "__name__", type(model).__name__)
    if not isinstance(name, str):
        raise ValueError(f"the name of a hypothesis is {name!r}: a text is needed, and "
                         "bias_sigma=, prior= and parameters by their names")
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
    bias_given, bias_sigma = bias_sigma is not None, (
        1.0 if bias_sigma is None else bias_sigma)
    if not 0.0 <= as_number(bias_sigma, f"bias_sigma of {name}") < LARGEST:
        raise ValueError(f"bias_sigma = {bias_sigma} of {name} is not a number >= 0 "
                         f"and less than {LARGEST:g}")
    priors = tuple(as_parameter(name, s, parameters[s], prior)
                   for s in known if s in parameters)
    h = Hypothesis(name, model, priors, float(bias_sigma), bias_given)
    at_most = h.filter(1.0, [p.high for p in priors])
    if not isinstance(at_most, ShapingFilter):
        raise ValueError(f"the model of {name} returns {type(at_most).__name__}: it is "
                         "to return what shaping_filter(Phi, Gamma, H, ...) makes")
    if not (at_most.Gamma.any() or at_most.Psi.any() or at_most.P0.any()):
        raise ValueError(f"all noises of {name} are zero: "
                         "give at least one sigma_* > 0")
    return h


def as_hypotheses(hypotheses):
    """One or several hypotheses as a tuple, or a sentence on what is none."""
    one = (isinstance(hypotheses, str) or hasattr(hypotheses, "filter")
           or not np.iterable(hypotheses))
    hypotheses = (hypotheses,) if one else tuple(hypotheses)
    for h in hypotheses:
        if not hasattr(h, "filter"):
            raise ValueError(f"{h!r} is no hypothesis: hypothesis(name, ...) makes one,"
                             " default_hypotheses(y, dt, names) several for a record")
        for p in h.parameters:
            if not p.low <= p.high:
                raise ValueError(f"{p.symbol} of {h.name} from {p.low} to {p.high}: "
                                 "two numbers, low <= high, are needed")
        if not h.bias_sigma >= 0.0:
            raise ValueError(f"bias_sigma = {h.bias_sigma} of {h.name}: a number >= 0 "
                             "is needed")
    if not hypotheses:
        raise ValueError("there is no hypothesis: at least one is needed")
    return hypotheses


def as_number(value, what):
    """`value` as a float, or a sentence on what it should be."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        raise ValueError(f"{what} is {value!r}: a number is needed")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"{what} is too large a number") from None


LARGEST = 1e50    # number of a model: fourth powers must be finite


def as_parameter(name, symbol, value, prior):
    """Prior of one parameter from a number or a range."""
    what = f"{symbol} of {name}"
    if isinstance(value, Parameter):
        prior, value = "log" if value.log else "uniform", value[1:3]
    if np.ndim(value) == 0:
        low = high = as_number(value, what)
    elif np.shape(value) == (2,):
        low, high = (as_number(v, what) for v in value)
    else:
        raise ValueError(f"{what} is {value!r}: give a number or a range [low, high]")
    if not (abs(low) < LARGEST and abs(high) < LARGEST):
        raise ValueError(f"{what} is {value!r}: both ends must be finite, and less than"
                         f" {LARGEST:g}")
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
    return Parameter(symbol, low, high, prior == "log" and low < high)


FASTEST = 3.0    # samples: the least correlation time that is looked for by default


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
        correlation time lies between 3 dt and the whole record: what is faster is white
        noise behind a low-pass.

    Raises
    ------
    ValueError
        If the record is too short, constant or not finite, or a name is unknown.
    """
    y = as_samples(y)
    check_record(y, dt)
    check_unit(y)
    seen = y[~np.isnan(y)]
    short = np.sqrt(np.mean(np.diff(seen)**2)) or np.ptp(seen) / len(seen)
    wide = max(np.std(seen), short)
    duration = dt * len(y)
    tau = min(FASTEST * dt, duration), duration
    bias_sigma = float(np.hypot(np.mean(seen), 3.0 * wide))
    slow = short / np.sqrt(len(y)), 3.0 * wide
    ranges = dict(sigma_v=(0.01 * short, 3.0 * wide),
                  sigma_w=(short / len(y), 1.5 * short),
                  tau_m=tau, tau_n=tau,
                  sigma_m=slow, sigma_n=slow)
    ranges["slope"] = Parameter("slope", -10.0 * wide / duration,
                                10.0 * wide / duration)
    names = (names,) if isinstance(names, str) else tuple(names)
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
            if symbol in ranges})._replace(bias_given=False)
        for name in names)


class Trials(NamedTuple):
    """Simulated records with the truth behind them."""

    error: np.ndarray         # (L, N), u
    hypothesis: np.ndarray    # (L,) number of the true hypothesis, from 0
    theta: np.ndarray         # (L, largest number of parameters), NaN where there
                              # is none


SHORT = 4000    # samples of a record that no thread of its own draws sooner


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
    seed, first : int >= 0
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
    hypotheses = as_hypotheses(hypotheses)
    check_interval(dt)
    check_seed(seed)
    try:
        error = np.empty((operator.index(trials), operator.index(samples)))
    except (TypeError, ValueError):
        raise ValueError(f"{trials!r} records of {samples!r} samples: whole numbers "
                         ">= 0 are needed") from None
    number = np.empty(trials, int)
    theta = np.full((trials, max(len(h.parameters) for h in hypotheses)), np.nan)

    @functools.lru_cache(2)    # where nothing is free, it is the same in all trials
    def filter_of(k, values):
        filt = hypotheses[k].filter(dt, np.frombuffer(values))
        return filt, *np.linalg.eigh(filt.P0)

    def draw(row):
        rng = np.random.default_rng(
            np.random.SeedSequence(seed, spawn_key=(first + row,)))
        k = number[row] = rng.integers(len(hypotheses))
        h = hypotheses[k]
        for column, p in enumerate(h.parameters):
            theta[row, column] = p.quantile(rng.random())
        bias = h.bias_sigma * rng.standard_normal()
        filt, variance, axes = filter_of(k, theta[row].tobytes())
        n, noises = filt.Gamma.shape[1:]
        x0 = filt.m0 + axes @ (np.sqrt(np.maximum(variance, 0.0))
                               * rng.standard_normal(n))
        w, v = rng.standard_normal((samples, noises)), rng.standard_normal(samples)
        error[row] = bias + _response(filt.Phi, filt.Gamma, filt.H, filt.Psi, x0, w, v)

    if samples <= SHORT:
        for row in range(trials):
            draw(row)
    else:    # NumPy draws without the lock
        side_by_side(draw, range(trials))
    return Trials(error, number, theta)


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
        for row in range(len(x)):
            x[row] = new[row]
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

FLOOR = 1e-8    # a uniform range from 0 is gridded from FLOOR * high: 1e-8 of its mass


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


ANYWHERE = 0.618    # its multiples are spread evenly over 0..1: quantiles of a prior
PLACES = 12         # at which a filter is asked whether it is linear in its noises


def _scale_parameter(h, dt):
    """Column of the parameter that serves as the scale, or None where none can.

    All noises must be free (or absent) and the filter must be linear in them.
    """
    sigma = [c for c, p in enumerate(h.parameters) if p.symbol.startswith("sigma")]
    if not sigma or any(not h.parameters[c].free and h.parameters[c].high > 0
                        for c in sigma):
        return None
    factors = dict(Phi=1.0, H=1.0, Gamma=2.0, Psi=2.0, P0=4.0, m0=2.0)

    def is_linear(place):
        once = np.array([p.quantile((place * ANYWHERE**column) % 1.0) for column, p in
                         enumerate(h.parameters, 1)])
        twice = once.copy()
        twice[sigma] *= 2.0
        one, two = h.filter(dt, once), h.filter(dt, twice)
        return not one.m0.any() and all(
            np.allclose(getattr(two, m), factor * getattr(one, m), rtol=1e-12, atol=0.0)
            for m, factor in factors.items())
    # 0 is special; those of MODELS are linear everywhere, if they are
    places = 1 if h.model in MODELS.values() else PLACES
    linear = all(map(is_linear, range(1, 1 + places)))
    return [c for c in sigma if h.parameters[c].free][-1] if linear else None


def _gregory(n):
    """Weights of n even ordinates: a trapezoid with third-order ends."""
    weight = np.ones(n)
    if n >= 6:
        weight[:3] = weight[:-4:-1] = 3 / 8, 7 / 6, 23 / 24
    elif n > 1:
        weight[0] = weight[-1] = 0.5
    return weight


class Box(NamedTuple):
    """Part of the space: axis a lies low..high above slope[a, :a] @ outer axes."""

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
    check_interval(dt)
    h, = as_hypotheses([h])
    prior = prior_box(h, dt)
    box = prior if box is None else box
    nodes = _nodes_of(h, nodes, len(prior.low))
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
    return _grid_of(h, dt, z, log_prior, step)[0]


def _nodes_of(h, nodes, axes):
    """Numbers of nodes (d,) along so many axes of a hypothesis."""
    check_whole(nodes, "numbers of nodes", 1)
    if np.shape(nodes) not in ((), (axes,)):
        raise ValueError(f"nodes along {np.size(nodes)} axes: a grid of {h.name} has "
                         f"{axes} here, give a number for each, or one for all")
    return np.broadcast_to(nodes, axes)


def _grid_of(h, dt, z, log_weight, step):
    """Nodes z (M, d) of quadrature weights exp(log_weight) as a `Grid`, and which of
    them lie inside the prior; step (M, d) is the distance of neighbours.
    """
    free, log, scale = _axes(h, dt)
    log_prior = log_weight.copy()
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
                log_prior[keep], limits[keep], float(power)), keep


def uniform_grid(h, dt, nodes):
    """The plain grid of the paper: evenly spaced in theta, equal weights, no scale.

    Takes and returns what `grid` does, with at least two nodes along each axis, one for
    every free parameter; nothing is integrated in closed form.
    """
    check_interval(dt)
    free = free_columns(h.parameters)
    axes = [np.linspace(h.parameters[c].low, h.parameters[c].high, max(n, 2))
            for c, n in zip(free, _nodes_of(h, nodes, len(free)))]
    z = mesh(*axes)
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
PART = 16      # of n states, so many times one to four do
TILE = 128     # samples; a TILE x LANES tile of data (32 KiB) stays in the L1 cache
STRETCH = 32   # samples after which gains of n-state filters may have settled
SETTLING = 256    # samples of which these gains are found at a time
UNROLLED = 8   # states of a filter whose loops LLVM unrolls, at most
UNROLLED_CHAIN = 5    # the same of its gains, where states mix
DUST = 1e-100  # states so small are 0: arithmetic with numbers below 1e-308, to which
               # they decay where a record is 0 for long, takes 40 times as long


class Sums(NamedTuple):
    """What a bank of M nodes knows of C records after `count` observed samples."""

    count: int
    chi2: np.ndarray           # (C, M)
    score: np.ndarray          # (C, M)
    information: np.ndarray    # (M,)
    log_det: np.ndarray        # (M,)
    products: np.ndarray = ()    # (P, M) sum nu nu/f of the pairs of records asked for


@njit(**INSIDE)
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
            weight = o / f      # one division: it takes as long as all else
            k = a * p * weight
            w[i, g] = weight
            c[i, g] = mu * weight
            ak[i, g] = k
            memory[0, g] = a * (a - k) * p + q
            memory[1, g] = a * e + k * mu
            memory[2, g] += mu * mu * weight
            product[g] *= o * f + (1.0 - o)
        if i % 8 == 7 or i == n - 1:
            for g in range(GROUP):
                memory[3, g] += np.log(product[g])
                product[g] = 1.0


@njit(**INSIDE)
def _drop_dust(state, count):
    """The first numbers of a state are 0 if they have nearly decayed: see `DUST`."""
    for g in range(count):
        if abs(state[g]) < DUST:
            state[g] = 0.0


@njit(**INSIDE)
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
    _drop_dust(state, LANES)


@njit(**INSIDE)
def _gains_stay(past, node, memory):
    """Have p and mu of a group stayed the same since their `past`?"""
    drift = 0.0
    for g in range(GROUP):
        drift = max(drift, abs(memory[1, g] - past[1, g]),
                    abs(memory[0, g] - past[0, g]) / (memory[0, g] + node[2, g]))
    return drift <= 1e-15


@njit(**INSIDE)
def _hold(node, memory, ak, w, c):
    """The constants that `_gains` gives while p and mu stay as they are."""
    for i in range(len(ak)):
        for g in range(GROUP):
            f = memory[0, g] + node[2, g]
            ak[i, g] = node[0, g] * memory[0, g] / f
            w[i, g] = 1.0 / f
            c[i, g] = (1.0 - memory[1, g]) / f


@njit(**INSIDE)
def _count_steady(samples, node, memory):
    """Information and log_det of samples through which p and mu stay as they are."""
    for g in range(GROUP):
        f, mu = memory[0, g] + node[2, g], 1.0 - memory[1, g]
        memory[2, g] += samples * mu * mu / f
        memory[3, g] += samples * np.log(f)


@njit(parallel=True, **JIT)
def _advance_trials(y, observed, last_gap, node, memory, state):
    """Move a one-state bank on by one stretch of data, trials abreast.

    y (blocks, n * LANES) sample-major within a block; node, memory (groups, 4, GROUP)
    as in `_gains`; state (groups, size, blocks, 3 * LANES) of the first `size` nodes of
    each group, which alone are wanted.
    """
    for group in prange(len(node)):
        _trials_of_group(y, observed, last_gap, node[group], memory[group],
                         state[group])


@njit(nogil=True, **INSIDE)
def _trials_of_group(y, observed, last_gap, node, memory, state):
    """One group of `_advance_trials`. Once p and mu no longer change, gains are
    constants of the node.
    """
    n, steady = len(observed), False
    ak, w, c = (np.empty((TILE, GROUP)), np.empty((TILE, GROUP)),
                np.empty((TILE, GROUP)))
    for first in range(0, n, TILE):
        last = min(first + TILE, n)
        if steady:
            _count_steady(last - first, node, memory)
        else:
            past = memory.copy()
            _gains(observed[first:last], node, memory, ak, w, c)
            steady = first > last_gap and _gains_stay(past, node, memory)
            if steady:
                _hold(node, memory, ak, w, c)
        for block in range(len(y)):
            tile = y[block, first * LANES:last * LANES]
            for g in range(len(state)):
                _trials_abreast(tile, node[0, g], ak, w, c, g, state[g, block])


@njit(**INSIDE)
def _nodes_abreast(y, node, ak, w, c, state):
    """Eqs. (4), (7) and the sums of GROUP nodes for one record, as for the trials."""
    for i in range(len(y)):
        for g in range(GROUP):
            nu = y[i] - state[g]
            state[g] = node[0, g] * state[g] + ak[i, g] * nu
            state[g + GROUP] += nu * w[i, g] * nu
            state[g + 2 * GROUP] += nu * c[i, g]
    _drop_dust(state, GROUP)


@njit(**INSIDE)
def _steady_abreast(y, a, ak, state):
    """The same once the gain is constant, with sums of nu^2 and nu unweighted; the
    number of samples is a multiple of four.
    """
    for i in range(0, len(y), 4):
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
    _drop_dust(state, GROUP)


@njit(nogil=True, **JIT)
def _record_of_group(y, rows, observed, last_gap, node, memory, state):
    """Move a group of one-state nodes on by one stretch of a few records, nodes
    abreast: gains are found once for all rows. Once p and mu no longer change, only the
    innovation is left of the recursion.

    y (C, n); rows (R, 2) are numbers of a record and of one that is added to it, -1 for
    none; node, memory (4, GROUP); state (R, 3 * GROUP).
    """
    n = len(observed)
    ak, w, c = (np.empty((TILE, GROUP)), np.empty((TILE, GROUP)),
                np.empty((TILE, GROUP)))
    gain, sums, tile = np.empty(GROUP), np.empty(3 * GROUP), np.empty(TILE)
    first, steady = 0, False
    while first < n and not (steady and first > last_gap):
        last = first + ((n - first) % TILE or TILE)    # the odd tile first
        past = memory.copy()
        _gains(observed[first:last], node, memory, ak, w, c)
        for row in range(len(rows)):
            _lay(y, rows[row], first, last, tile)
            _nodes_abreast(tile[:last - first], node, ak, w, c, state[row])
        first, steady = last, _gains_stay(past, node, memory)
    if first == n:
        return
    for g in range(GROUP):
        gain[g] = node[0, g] * memory[0, g] / (memory[0, g] + node[2, g])
    for row in range(len(rows)):
        sums[:] = 0.0
        for g in range(GROUP):
            sums[g] = state[row, g]
        for begin in range(first, n, TILE):
            _lay(y, rows[row], begin, begin + TILE, tile)
            _steady_abreast(tile, node[0], gain, sums)
        for g in range(GROUP):
            f, mu = memory[0, g] + node[2, g], 1.0 - memory[1, g]
            state[row, g] = sums[g]
            state[row, g + GROUP] += sums[g + GROUP] / f
            state[row, g + 2 * GROUP] += sums[g + 2 * GROUP] * mu / f
    _count_steady(n - first, node, memory)


@njit(nogil=True, **JIT)
def _lay_abreast(y, rows, lanes):
    """The records (C, n) of rows as blocks of lanes (blocks, n * LANES): those of a
    sample lie side by side.
    """
    n = y.shape[1]
    for first in range(0, n, TILE):    # that much stays in the cache
        for k in range(len(rows)):
            block, lane, one, other = k // LANES, k % LANES, rows[k, 0], rows[k, 1]
            for i in range(first, min(first + TILE, n)):
                lanes[block, i * LANES + lane] = y[one, i] + (
                    y[other, i] if other >= 0 else 0.0)


@njit(**INSIDE)
def _lay(y, row, first, last, tile):
    """Samples of a row of `_record_of_group`."""
    one, other = row
    for i in range(last - first):
        tile[i] = y[one, first + i] + (y[other, first + i] if other >= 0 else 0.0)


@njit(**INSIDE)
def _predict_abreast(at, entries, apart, Phi, Q, P, prior):
    """Eq. (5) for nodes of n states abreast: P (n, n, M), of which the lower half
    counts, becomes the predicted covariance of sample `at`. States that are `apart` do
    not mix.

    Inner loops ask an array for their length: it vectorises better than one known. A
    view of a row would count references, which takes as long as such a loop.
    """
    n, i, j = len(P), min(at, len(Phi) - 1), min(at, len(Q) - 1)
    if apart:
        for row in range(n):
            for s in range(row + 1):
                for g in range(P.shape[2]):
                    P[row, s, g] = (Phi[i, row, row, g] * P[row, s, g]
                                    * Phi[i, s, s, g] + Q[j, row, s, g])
        return
    prior[:] = 0.0
    for k in range(len(entries)):
        row, column = entries[k, 0], entries[k, 1]
        for s in range(n):
            low, high = min(column, s), max(column, s)
            for g in range(P.shape[2]):
                prior[row, s, g] += Phi[i, row, column, g] * P[high, low, g]
    for row in range(n):
        for s in range(row + 1):
            for g in range(P.shape[2]):
                P[row, s, g] = Q[j, row, s, g]
    for k in range(len(entries)):
        row, column = entries[k, 0], entries[k, 1]
        for s in range(row, n):
            for g in range(P.shape[2]):
                P[s, row, g] += prior[s, column, g] * Phi[i, row, column, g]


@njit(nogil=True, **JIT)
def _gains_abreast(observed, first, last_gap, entries, apart, Phi, Q, H, r, P, gain,
                   weight, log_det):
    """Eqs. (5), (6), (8) from sample `first` on, for M nodes abreast, until all gains
    stay what they are, `steady`: gain (., n, M) and 1 / f (., M) of `count` samples, 0
    where one is missing; P becomes the last filtered covariance; log_det (M,) grows.

    Arrays are copied by loops: the message of a failed assignment takes longer to
    compile than the rest.
    """
    n, M = P.shape[1:]
    timeless = len(Phi) == len(Q) == len(H) == len(r) == 1
    prior, Ph, past = np.empty((n, n, M)), np.empty((n, M)), np.empty((n, n, M))
    f, product = np.empty(M), np.ones(M)
    for i in range(len(observed)):
        o, at = observed[i], first + i
        own, noise = min(at, len(H) - 1), min(i, len(r) - 1)
        if i % STRETCH == 0:
            for row in range(n):
                for s in range(row + 1):
                    for g in range(len(f)):
                        past[row, s, g] = P[row, s, g]
        _predict_abreast(at, entries, apart, Phi, Q, P, prior)
        for g in range(len(f)):
            f[g] = r[noise, g]
        for row in range(n):
            for g in range(len(f)):
                Ph[row, g] = 0.0
            for s in range(n):
                low, high = min(row, s), max(row, s)
                for g in range(len(f)):
                    Ph[row, g] += P[high, low, g] * H[own, s, g]
            for g in range(len(f)):
                f[g] += H[own, row, g] * Ph[row, g]
        for g in range(len(f)):
            weight[i, g] = o / f[g]
            product[g] *= o * f[g] + (1.0 - o)
        for row in range(n):
            for g in range(len(f)):
                gain[i, row, g] = Ph[row, g] * weight[i, g]
            for s in range(row + 1):
                for g in range(len(f)):
                    P[row, s, g] -= gain[i, row, g] * Ph[s, g]
        if i % 8 == 7 or i == len(observed) - 1:
            for g in range(len(f)):
                log_det[g] += np.log(product[g])
                product[g] = 1.0
        if (timeless and i % STRETCH == STRETCH - 1 and i - STRETCH >= last_gap
                and _is_steady(past, P, gain[i], weight[i])):
            return i + 1, True
    return len(observed), False


@njit(**INSIDE)
def _is_steady(past, P, gain, weight):
    """Have filtered covariances stayed what they were, but for rounding?"""
    n = len(P)
    for row in range(n):
        for s in range(row + 1):
            for g in range(P.shape[2]):
                scale = ((P[row, row, g] + gain[row, g]**2 / weight[g])
                         * (P[s, s, g] + gain[s, g]**2 / weight[g]))
                if (P[row, s, g] - past[row, s, g])**2 > 1e-28 * scale:
                    return False
    return True


@njit(**INSIDE)
def _gain_unrolled(seen, states, chain, node):
    """Eqs. (5), (6), (8) for PART nodes and a sample, of as many states as another,
    unrolled as `_samples_unrolled` is: in one array, of which no row can be another.

    node has rows of PART: the diagonal of Phi, H, what is before and behind the
    diagonal (it counts in a `chain`); gain, 1 / f, the product of f so far, R; P, Q and
    Phi P of a chain, all n x n; P h.
    """
    n = len(states)
    gain, per_f, product, r, P = 4 * n, 5 * n, 5 * n + 1, 5 * n + 2, 5 * n + 3
    Q, prior, Ph = P + n * n, P + 2 * n * n, P + 3 * n * n
    for g in range(PART):
        if chain is not None:
            for row in range(n):
                for s in range(n):
                    k = P + row * n + s
                    new = node[row * PART + g] * node[k * PART + g]
                    if row > 0:
                        new += (node[(2 * n + row) * PART + g]
                                * node[(k - n) * PART + g])
                    if row < n - 1:
                        new += (node[(3 * n + row) * PART + g]
                                * node[(k + n) * PART + g])
                    node[(prior + row * n + s) * PART + g] = new
        for row in range(n):
            for s in range(row + 1):
                k = row * n + s
                if chain is None:
                    new = (node[row * PART + g] * node[(P + k) * PART + g]
                           * node[s * PART + g])
                else:
                    new = node[(prior + k) * PART + g] * node[s * PART + g]
                    if s > 0:
                        new += (node[(prior + k - 1) * PART + g]
                                * node[(2 * n + s) * PART + g])
                    if s < n - 1:
                        new += (node[(prior + k + 1) * PART + g]
                                * node[(3 * n + s) * PART + g])
                new += node[(Q + k) * PART + g]
                node[(P + k) * PART + g] = new
                node[(P + s * n + row) * PART + g] = new
        f = node[r * PART + g]
        for row in range(n):
            own = 0.0
            for s in range(n):
                own += node[(P + row * n + s) * PART + g] * node[(n + s) * PART + g]
            node[(Ph + row) * PART + g] = own
            f += node[(n + row) * PART + g] * own
        weight = seen / f
        node[per_f * PART + g] = weight
        node[product * PART + g] = node[product * PART + g] * (seen * f + (1.0 - seen))
        for row in range(n):
            own = node[(Ph + row) * PART + g] * weight
            node[(gain + row) * PART + g] = own
            for s in range(row + 1):
                new = node[(P + row * n + s) * PART + g] - (
                    own * node[(Ph + s) * PART + g])
                node[(P + row * n + s) * PART + g] = new
                node[(P + s * n + row) * PART + g] = new


@njit(nogil=True, **JIT)
def _gains_unrolled(observed, last_gap, states, chain, nodes, P, gain, weight, log_det):
    """`_gains_abreast` by `_gain_unrolled`: nodes (parts, rows of PART)."""
    n = len(states)
    for begin in range(0, len(observed), STRETCH):
        end = min(begin + STRETCH, len(observed))
        past = P.copy()    # past[:] = P has a message, which takes long to compile
        for part in range(len(nodes)):
            node, first = nodes[part], part * PART
            for i in range(begin, end):
                _gain_unrolled(observed[i], states, chain, node)
                for s in range(n):
                    for g in range(PART):
                        gain[i, s, first + g] = node[(4 * n + s) * PART + g]
                for g in range(PART):
                    weight[i, first + g] = node[5 * n * PART + g]
                if i % 8 == 7 or i == end - 1:
                    for g in range(PART):
                        log_det[first + g] += np.log(node[(5 * n + 1) * PART + g])
                        node[(5 * n + 1) * PART + g] = 1.0
            for row in range(n):
                for s in range(row + 1):
                    for g in range(PART):
                        k = 5 * n + 3 + row * n + s
                        P[row, s, first + g] = node[k * PART + g]
        if begin > last_gap and end == begin + STRETCH and _is_steady(
                past, P, gain[end - 1], weight[end - 1]):
            return end, True
    return len(observed), False


@njit(nogil=True, **JIT)
def _move_group(y, begin, end, first, pairs, entries, rows, Phi, H, gain, weight, x,
                sums, products):
    """Eqs. (4), (7) and the sums of a group from sample `begin` to `end`, with gains
    (., n, M) and 1 / f (., M) of these samples, or the only ones: any Phi.
    """
    columns, n, M = x.shape
    new, nu = np.empty((n, M)), np.empty((columns, M))
    for i in range(begin, end):
        at, own = min(first + i, len(Phi) - 1), min(first + i, len(H) - 1)
        k = min(i - begin, len(gain) - 1)
        for record in range(columns - 1, -1, -1):    # the ones first: they give mu
            for g in range(M):
                nu[record, g] = y[rows[record, g], i] if record < columns - 1 else 1.0
            new[:] = 0.0
            for entry in range(len(entries)):
                row, column = entries[entry, 0], entries[entry, 1]
                for g in range(M):
                    new[row, g] += Phi[at, row, column, g] * x[record, column, g]
            for s in range(n):
                for g in range(M):
                    nu[record, g] -= H[own, s, g] * new[s, g]
            for s in range(n):
                for g in range(M):
                    moved = new[s, g] + gain[k, s, g] * nu[record, g]
                    x[record, s, g] = moved if abs(moved) > DUST else 0.0
            for g in range(M):
                sums[record, 0, g] += weight[k, g] * nu[record, g]**2
            for g in range(M if record < columns - 1 else 0):
                sums[record, 1, g] += weight[k, g] * nu[record, g] * nu[columns - 1, g]
        for p in range(len(pairs)):
            for g in range(M):
                products[p, g] += weight[k, g] * nu[pairs[p, 0], g] * nu[pairs[p, 1], g]


@njit(**INSIDE)
def _samples_unrolled(states, abreast, chain, node, c, x, sums, nu, row):
    """`_move_group` for PART nodes and a few samples of record c, as many as the tuple
    `abreast` is long, of as many states as another: LLVM unrolls loops of known length,
    if they are short, and makes vectors of the loop around them.

    node has rows of PART: the diagonal of Phi, H, what is before and behind the
    diagonal (it counts in a `chain`), gains of every sample, their 1 / f and mu / f,
    and the samples.
    """
    n, count = len(states), len(abreast)
    weight = (4 + count) * n
    per_score, value = weight + count, weight + 2 * count
    for g in range(PART):
        chi2, score = sums[c, g], sums[c, PART + g]
        for j in range(count):
            own, before = node[(value + j) * PART + g], 0.0
            for s in range(n):
                old = x[c, s * PART + g]
                new = node[s * PART + g] * old
                if chain is not None:
                    if s > 0:
                        new += node[(2 * n + s) * PART + g] * before
                    if s < n - 1:
                        new += node[(3 * n + s) * PART + g] * x[c, (s + 1) * PART + g]
                    before = old
                x[c, s * PART + g] = new
                own -= node[(n + s) * PART + g] * new
            for s in range(n):
                x[c, s * PART + g] += node[((4 + j) * n + s) * PART + g] * own
            nu[row, j * PART + g] = own
            chi2 += node[(weight + j) * PART + g] * own * own
            score += node[(per_score + j) * PART + g] * own
        sums[c, g], sums[c, PART + g] = chi2, score


@njit(nogil=True, **JIT)
def _move_unrolled(y, begin, end, pairs, rows, states, abreast, chain, nodes, gain,
                   weight, x, sums, products):
    """`_move_group` by `_samples_unrolled`: nodes, x, sums, products (parts, ., rows of
    PART). Once mu does not change, it is a constant of the node, too.
    """
    n, count, columns, steady = len(states), len(abreast), x.shape[1], len(gain) == 1
    nu, past = np.empty((columns if len(pairs) else 1, count * PART)), np.empty(PART)
    gains, weights, spread = 4 * n, (4 + count) * n, (rows[0] != rows[0, 0]).any()
    mu, value = weights + count, weights + 2 * count
    for part in range(len(nodes)):
        node, first, flat = nodes[part], part * PART, False
        past[:] = np.inf
        for i in range(begin, end, count):
            for j in range(0 if steady and i > begin else count):
                k = 0 if steady else i - begin + j
                for g in range(PART):
                    node[(weights + j) * PART + g] = weight[k, first + g]
                for s in range(n):
                    for g in range(PART):
                        node[(gains + j * n + s) * PART + g] = gain[k, s, first + g]
            for c in range(columns - 1, -1, -1):    # the ones first: they give mu
                row, ones = c if len(pairs) else 0, c == columns - 1
                if ones and flat:
                    continue
                if ones:
                    node[mu * PART:value * PART] = 0.0
                for j in range(count):
                    if spread and not ones:
                        for g in range(PART):
                            node[(value + j) * PART + g] = y[rows[c, first + g], i + j]
                    else:
                        node[(value + j) * PART:(value + j + 1) * PART] = (
                            1.0 if ones else y[rows[c, 0], i + j])
                _samples_unrolled(states, abreast, chain, node, c, x[part], sums[part],
                                  nu, row)
                for g in range(count * PART if ones else 0):
                    node[mu * PART + g] = node[weights * PART + g] * nu[row, g]
            for p in range(len(pairs)):
                one, other = pairs[p]
                for j in range(count):
                    for g in range(PART):
                        products[part, p, g] += (
                            node[(weights + j) * PART + g] * nu[one, j * PART + g]
                            * nu[other, j * PART + g])
            if (i - begin) % STRETCH:
                continue
            for c in range(columns):
                _drop_dust(x[part, c], n * PART)
            if not steady or flat:
                continue
            drift = 0.0
            for g in range(PART):
                now = node[mu * PART + g] / node[weights * PART + g]
                drift = max(drift, abs(now - past[g]))
                past[g] = now
            flat = drift < 1e-15
            for g in range(PART if flat else 0):
                sums[part, columns - 1, g] += (
                    (end - i - count) * past[g] * node[mu * PART + g])


def _advance_abreast(y, observed, first, pairs, entries, *groups):
    """Move a bank of n-state filters on from sample `first`, Eqs. (4)-(8), nodes
    abreast.

    y (., n_samples); entries (K, 2) rows and columns of Phi that are not zero. Of every
    group: `rows` (C, M) of y that are records of a node, beside which there are ones;
    Phi, Q (1 or N, n, n, M), H (1 or N, n, M); `since` (R,) or None, and r (M or fewer,
    R), from which sample on the white noise has which variance, that of the last node
    for the rest; filtered state x (C + 1, n, M) and covariance P (n, n, M); sums
    (C + 1, 2, M) of nu^2/f and nu mu/f, the last row information and log_det; products
    (P, M) of nu nu/f of pairs (P, 2) of records.
    """
    side_by_side(lambda group: _advance_group(y, observed, first, pairs, entries,
                                              *group), list(zip(*groups)))


def _advance_group(y, observed, first, pairs, entries, rows, Phi, Q, H, since, r, x, P,
                   sums, products):
    """One group of `_advance_abreast`: unrolled where Phi is timeless and mixes none
    but neighbours, but for the last samples of a run where these are no whole handful.
    """
    n, samples = x.shape[1], y.shape[1]
    away = _reach(entries)
    unrolled = _is_unrolled(Phi, H, away)
    states, abreast = (0,) * n, (0,) * (4 if n <= 4 else 2)
    wholes, log_det = (x, sums, products[:, None]), sums[-1, 1].copy()
    if unrolled:
        count = len(abreast)
        nodes = _in_rows(Phi[0], H[0], np.zeros(((n + 3) * count, x.shape[2])))
        parts = [_in_parts(whole) for whole in wholes]
    for begin, end, *gains in _gains_of_group(
            observed, first, P, log_det, entries, away, Phi, Q, H, since, r):
        stop = begin
        if unrolled:
            stop = end - (end - begin) % len(abreast)
            _move_unrolled(y, begin, stop, pairs, rows, states, abreast,
                           () if away else None, nodes, *gains, *parts)
        if unrolled and (stop < end or end == samples):
            for whole, part in zip(wholes, parts):
                _join_parts(part, whole)
        if stop < end:
            _move_group(y, stop, end, first, pairs, entries, rows, Phi, H, *(
                part[min(stop - begin, len(part) - 1):] for part in gains), x, sums,
                products)
        if unrolled and stop < end < samples:
            parts = [_in_parts(whole) for whole in wholes]
    sums[-1, 1] = log_det


def _entries(b):
    """Rows and columns (K, 2) of Phi that are not zero at some node of a bank."""
    # a copy: of one layout, compiled once
    return np.argwhere(b.Phi.any((0, 1))).copy()


def _reach(entries):
    """How far the states are that mix at most."""
    return np.abs(entries[:, 0] - entries[:, 1]).max(initial=0)


def _is_unrolled(Phi, H, away):
    """Are filters of these matrices, first axis time, whose states mix with those at
    most so far `away`, moved on by `_move_unrolled`?
    """
    return len(Phi) == len(H) == 1 and away <= 1 and H.shape[1] <= UNROLLED


def _gains_of_group(observed, first, P, log_det, entries, away, Phi, Q, H, since, r):
    """(begin, end, gain, weight) of one stretch of samples after the other, of states
    that mix with those at most so far `away`. Where white noise changes seldom, gains
    settle in each run in between.
    """
    samples, seldom = len(observed), since is not None
    starts = np.maximum(since - first, 0) if seldom else [0]
    for number, (begin, end) in enumerate(zip(starts, [*starts[1:], samples])):
        if begin >= min(end, samples):
            continue
        for start, stop, *gains in _gains_of_run(
                observed[begin:end], first + begin, P, log_det, entries, away, Phi, Q,
                H, r[:, number:number + 1] if seldom else r):
            yield begin + start, begin + stop, *gains


def _gains_of_run(observed, first, P, log_det, entries, away, Phi, Q, H, r):
    """`_gains_of_group` of a run: once P no longer changes, one gain is for all the
    rest. Unrolled where few states mix with none but neighbours.
    """
    n, M = P.shape[1:]
    gain, weight = np.empty((SETTLING, n, M)), np.empty((SETTLING, M))
    even = r.shape[1] == 1
    timeless = even and len(Phi) == len(Q) == len(H) == 1
    unrolled = timeless and away <= 1 and n <= (UNROLLED_CHAIN if away else UNROLLED)
    if unrolled:
        full, zeros = np.indices((n, n)), np.zeros((n * n + n, M))
        square = P[full.max(0), full.min(0)].reshape(n * n, M)
        nodes = _in_rows(Phi[0], H[0], zeros[:n + 1], np.ones((1, M)), _abreast_at(
            r, M), square, Q[0].reshape(n * n, M), zeros)
    begin, steady, samples = 0, False, len(observed)
    last_gap = np.flatnonzero(observed == 0.0).max(initial=-1)
    while begin < samples and not steady:
        part, gap = observed[begin:begin + SETTLING], last_gap - begin
        if unrolled:
            count, steady = _gains_unrolled(part, gap, (0,) * n, () if away else None,
                                            nodes, P, gain, weight, log_det)
        else:
            at = first + begin
            count, steady = _gains_abreast(
                part, at, gap, entries, away == 0, Phi, Q, H, _abreast_at(
                    r if even else r[:, at:at + len(part)], M), P, gain, weight,
                log_det)
        yield begin, begin + count, gain[:count], weight[:count]
        begin += count
    if begin < samples:
        log_det -= (samples - begin) * np.log(weight[count - 1])
        yield begin, samples, gain[count - 1:count], weight[count - 1:count]


def _in_rows(Phi, H, *others):
    """Phi (n, n, M), H (n, M) and other rows (., M) as `_samples_unrolled` and
    `_gain_unrolled` take them: (parts, rows * PART).
    """
    n, M = H.shape
    node = np.zeros((4 * n, M))
    node[:n], node[n:2 * n] = np.moveaxis(np.diagonal(Phi), -1, 0), H
    node[2 * n + 1:3 * n] = np.moveaxis(np.diagonal(Phi, -1), -1, 0)
    node[3 * n:4 * n - 1] = np.moveaxis(np.diagonal(Phi, 1), -1, 0)
    return _in_parts(np.concatenate([node, *others])[None])[:, 0]


def _in_parts(whole):
    """(A, B, M) of a group as (M / PART, A, B * PART), a copy."""
    A, B, M = whole.shape
    return np.moveaxis(whole.reshape(A, B, M // PART, PART), 2, 0).reshape(
        M // PART, A, B * PART).copy()


def _join_parts(parts, whole):
    """`whole` (A, B, M) gets what its parts have: `_in_parts` undone."""
    A, B, M = whole.shape
    whole[:] = np.moveaxis(parts.reshape(M // PART, A, B, PART), 0, 2).reshape(A, B, M)


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
    if np.shape(theta)[1:] != (len(h.parameters),):
        raise ValueError(f"parameters of shape {np.shape(theta)}: (M, "
                         f"{len(h.parameters)}) is needed, for M nodes")
    if h.elementwise:
        def of_all(part, dimensions):
            result = np.empty((len(theta), *part.shape[-dimensions:]))
            result[:] = part
            return result
        Phi, Gamma, H, Psi, m0, P0 = map(of_all, h.filter(
            dt, np.transpose(theta)[..., None]), (3, 3, 2, 1, 1, 2))
    else:
        filters = [h.filter(dt, row) for row in theta]
        Phi, Gamma, H, Psi, m0, P0 = (np.stack(part) for part in zip(*filters))
    Psi *= Psi    # it may be long
    return Bank(Phi, Gamma @ np.swapaxes(Gamma, -1, -2), H, Psi, m0, P0)


def _is_scalar(b):
    """Does the one-state kernel apply, wherever white noise is even?"""
    timeless = b.Phi.shape[1] == b.Q.shape[1] == b.H.shape[1] == 1
    return b.Phi.shape[2] == 1 and timeless and np.all(b.H == 1.0) and not b.m0.any()


class Modes(NamedTuple):
    """Sums of n independent one-state processes in white noise, at M nodes."""

    a: np.ndarray     # (M, n) transition factors
    q: np.ndarray     # (M, n) variances of the process noises
    p0: np.ndarray    # (M, n) initial variances
    r: np.ndarray     # (M, 1 or N) variance of the white noise


def modes(b):
    """The filters of a bank as `Modes`, or None where they are no such sums."""
    off = ~np.eye(b.Phi.shape[2], dtype=bool)
    timeless = b.Phi.shape[1] == b.Q.shape[1] == b.H.shape[1] == 1
    if not timeless or np.any(b.H != 1.0) or b.m0.any() or (
            b.Phi[..., off].any() or b.Q[..., off].any() or b.P0[..., off].any()):
        return None
    parts = b.Phi[:, 0], b.Q[:, 0], b.P0    # copies: a diagonal cannot be written to
    return Modes(*(np.diagonal(m, 0, 1, 2).copy() for m in parts), b.r)


def filter_bank(b, y, stops, pairs=None):
    """Sums of a bank over records, at each of the given numbers of samples.

    Parameters
    ----------
    b : Bank
    y : (C, N) array
        Records, u. NaN marks a missing sample, the same in all of them.
    stops : increasing sequence of int, 1 <= stop <= N
    pairs : sequence of (int, int), optional
        Rows of y of which `products` are wanted. With them, even if there are none,
        the last bits of a row depend on how many rows there are: that is faster.

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
    y = as_samples(y)
    if y.ndim != 2:
        raise ValueError(f"the records have shape {y.shape}: (records, samples) is "
                         "needed")
    gap = np.isnan(y[:1])
    if (np.isnan(y) != gap).any():
        raise ValueError("samples are missing in some records only: filter these apart")
    if np.any(np.diff(stops) <= 0) or not 1 <= stops[0] <= stops[-1] <= y.shape[1]:
        raise ValueError(f"stops {list(stops)} do not increase within 1..{y.shape[1]}")
    for part in b[:4]:
        if 1 < part.shape[1] < y.shape[1]:
            raise ValueError(f"a shaping filter has matrices for {part.shape[1]} "
                             f"samples, the record has {y.shape[1]}: give one for all "
                             "samples, or one for each")
    return _sums(b, np.where(gap, 0.0, y) if gap[0].any() else y, 1.0 - gap[0], stops,
                 None if pairs is None else np.reshape(pairs, (-1, 2)).astype(int))


def _sums(b, y, observed, stops, pairs):
    """The loop of `filter_bank`: choose a kernel and advance from stop to stop."""
    since, ends = np.zeros(1, int), np.array(stops)
    run = _sums_spread if pairs is not None and _may_spread(
        b, len(y), len(pairs)) else _sums_abreast
    if _is_scalar(b):    # of others, every group has its own runs
        own, r = _even_runs(b.r)
        if own is not None:
            run = (_sums_pairs if pairs is not None else _sums_records if len(y) == 1
                   else _sums_trials)
            b, since, ends = b._replace(r=r), own, np.union1d(stops, own[1:])
    pairs = NO_PAIRS if pairs is None else pairs
    begins = np.append(0, ends[:-1])
    stretches = list(zip(begins, ends, np.searchsorted(since, begins, "right") - 1, [
        np.flatnonzero(observed[begin:end] == 0.0).max(initial=-1)
        for begin, end in zip(begins, ends)]))
    parts, stops = run(b, y, observed, stretches, pairs), set(stops)
    for begin, end, *_ in stretches:
        with one_thread_if(-(-len(b.r) // GROUP) * len(y) * (end - begin) <= SMALL):
            sums = next(parts)
        if end in stops:
            yield Sums(int(observed[:end].sum()), *sums)


def _even_runs(r):
    """Samples (R,) from which on white noise of variance r (M, 1 or N) is even, and its
    variances (M, R) from there on; None and r, where it changes so often that gains
    would not settle in between.
    """
    since, samples = np.append(0, np.flatnonzero((r[:, 1:] != r[:, :-1]).any(0)) + 1
                               ), r.shape[1]
    if 1 < samples < len(since) * SETTLING:
        return None, r
    return since, r[:, since]


SMALL = 10**5    # samples of records in groups of nodes: a few milliseconds


def _abreast(part):
    """Nodes of a bank, first axis, as groups: (groups, ..., M); a copy."""
    # loops around many cost less; of few, two threads have a part
    M = min(PART * -(-len(part) // (2 * PART)), 4 * PART)
    part = np.pad(part, [(0, -len(part) % M)] + [(0, 0)] * (part.ndim - 1), mode="edge")
    part = part.reshape(-1, M, *part.shape[1:])
    return np.moveaxis(part, 1, -1).copy()


def _abreast_at(r, M):
    """Variances (M or fewer, R) as (R, M), that of the last node for the rest."""
    return r.T.take(np.arange(M), axis=1, mode="clip")


def _one_by_one(part, nodes):
    """Groups (groups, ..., M) as nodes (nodes, ...)."""
    return np.concatenate(np.moveaxis(part, -1, 1))[:nodes]


NO_PAIRS = np.empty((0, 2), int)


def _start_abreast(b, rows, pairs=NO_PAIRS):
    """What `_advance_abreast` takes before the first sample: pairs, entries, rows, Phi,
    Q, H and white noise of a bank, x, P, sums and products.
    """
    rows = _abreast(rows.T)
    Phi, Q, H, m0, P = map(_abreast, (b.Phi, b.Q, b.H, b.m0, b.P0))
    M = Phi.shape[-1]
    since, r = zip(*(_even_runs(b.r[k:k + M]) for k in range(0, len(b.r), M)))
    x = np.repeat(m0[:, None], rows.shape[1] + 1, 1)
    x[:, -1] = 0.0
    return (pairs, _entries(b), rows, Phi, Q, H, since, r, x, P,
            np.zeros((*x.shape[:2], 2, x.shape[-1])),
            np.zeros((len(x), len(pairs), x.shape[-1])))


def _sums_abreast(b, y, observed, stretches, pairs):
    M = len(b.m0)
    start = _start_abreast(b, np.repeat(np.arange(len(y))[:, None], M, 1), pairs)
    for begin, end, *_ in stretches:
        _advance_abreast(np.ascontiguousarray(y[:, begin:end]), observed[begin:end],
                         begin, *start)
        own, products = (_one_by_one(part, M) for part in start[-2:])
        yield (own[:, :-1, 0].T, own[:, :-1, 1].T, own[:, -1, 0], own[:, -1, 1],
               products.T)


def _may_spread(b, records, pairs):
    """Does it pay to filter every record of a node in a place of its own?"""
    places = PART * (2 if b.H.shape[2] <= 4 else 1)    # gains take all the longer
    return (records > 2 and len(b.r) * (records + pairs) <= places
            and _is_unrolled(b.Phi[0], b.H[0], _reach(_entries(b)))
            and (b.r.shape[1] == 1 or len(b.r) == 1))    # it may be long


def _sums_spread(b, y, observed, stretches, pairs):
    """Sums of several records at few nodes: each record of a node has a place of its
    own among those that march abreast; those of the sums of pairs of them, too.
    """
    C, M = len(y), len(b.m0)
    y = np.vstack([y, y[pairs[:, 0]] + y[pairs[:, 1]]]) if len(pairs) else y
    count = len(y)
    spread = Bank(*(np.repeat(part, count, 0) if M > 1 else np.broadcast_to(
        part, (count, *part.shape[1:])) for part in b))
    start = _start_abreast(spread, np.tile(np.arange(count), M)[None])
    for begin, end, *_ in stretches:
        _advance_abreast(np.ascontiguousarray(y[:, begin:end]), observed[begin:end],
                         begin, *start)
        chi2, score, information, log_det = np.moveaxis(_one_by_one(
            start[-2], M * count).reshape(M, count, 4), 0, -1).swapaxes(0, 1)
        yield (chi2[:C], score[:C], information[0], log_det[0], 0.5 * (
            chi2[C:] - chi2[pairs[:, 0]] - chi2[pairs[:, 1]]))


def _scalar_nodes(b, size=GROUP):
    """node and memory of the one-state kernels: of so many nodes each, padded to whole
    groups; and r of all runs, which node gets.
    """
    M = len(b.r)
    at = np.minimum(np.arange(-(-M // size) * size), M - 1).reshape(-1, size)
    at = np.pad(at, ((0, 0), (0, GROUP - size)), mode="edge")
    a, q, p0 = (part.ravel()[at] for part in (b.Phi, b.Q, b.P0))
    zero = np.zeros_like(a)
    return (np.stack([a, q, zero, p0], 1), np.stack([a * a * p0 + q, zero, zero, zero],
                                                    1), b.r.T[:, at])


def _with_sums(count, pairs):
    """Rows of the one-state kernels: records (count) alone, then sums of two."""
    return np.vstack([[(row, -1) for row in range(count)], pairs])


def _sums_records(b, y, observed, stretches, pairs):
    """Sums of records, then those of the sums of pairs of them."""
    node, memory, r = _scalar_nodes(b)
    rows = _with_sums(len(y), pairs)
    state = np.zeros((len(node), len(rows), 3, GROUP))
    # of few groups, every thread has a part of the rows, and gains of its own
    parts = np.array_split(np.arange(len(rows)), min(len(rows), -(
        -get_num_threads() // len(node))))

    def advance(job):
        group, part = job
        own, past = state[group, part].reshape(len(part), -1), memory[group].copy()
        _record_of_group(now, rows[part], observed[begin:end], last_gap, node[group],
                         past, own)
        state[group, part] = own.reshape(len(part), 3, GROUP)
        return past

    for begin, end, even, last_gap in stretches:
        node[:, 2] = r[even]
        now = np.ascontiguousarray(y[:, begin:end])
        memory = np.stack(side_by_side(advance, [
            (group, part) for part in parts for group in range(len(node))]
            )[:len(node)])
        yield (*(np.moveaxis(state[:, :, part], 1, 0).reshape(len(rows), -1)[
                     :, :len(b.r)] for part in (1, 2)),
               *(memory[:, part].ravel()[:len(b.r)] for part in (2, 3)))


PIECE = 128 * TILE    # samples whose lanes are laid side by side at a time


def _sums_trials(b, y, observed, stretches, pairs):
    """Sums of records, then those of the sums of pairs of them."""
    size = min(GROUP, -(-len(b.r) // 2))    # of few nodes every thread has a part
    node, memory, r = _scalar_nodes(b, size)
    rows = _with_sums(len(y), pairs)
    records = len(rows)
    blocks = -(-records // LANES)
    state = np.zeros((len(node), size, blocks, 3, LANES))
    every = np.zeros(blocks * LANES * min(PIECE, y.shape[1]))
    for begin, end, even, last_gap in stretches:
        node[:, 2], last_gap = r[even], last_gap + begin
        for first in range(begin, end, PIECE):
            last = min(first + PIECE, end)
            lanes = every[:blocks * LANES * (last - first)].reshape(blocks, -1)
            _lay_abreast(y[:, first:last], rows, lanes)
            piece = lanes, observed[first:last], last_gap - first
            own = state.reshape(len(node), size, blocks, -1)
            if get_num_threads() > 1:
                _advance_trials(*piece, node, memory, own)
            else:    # that leaves the interpreter to others
                for group in zip(node, memory, own):
                    _trials_of_group(*piece, *group)
        yield (*(state[:, :, :, part].reshape(-1, blocks * LANES)[:len(b.r), :records].T
                 for part in (1, 2)),
               *(memory[:, part, :size].ravel()[:len(b.r)] for part in (2, 3)))


def _run_of_rows(rows, M):
    """What leaves fewer lanes idle: nodes, or rows, lie side by side. Rows must be laid
    so before, and take longer once gains are steady.
    """
    few = rows * -(-M // GROUP) < (1.3 * M + 4.0) * -(-rows // LANES)
    return _sums_records if few else _sums_trials


def _sums_pairs(b, y, observed, stretches, pairs):
    """2 r's = (r + s)'(r + s) - r'r - s's: the one-state kernels give squares."""
    C, (one, other) = len(y), pairs.T
    run = _run_of_rows(C + len(pairs), len(b.r))
    for chi2, score, *rest in run(b, y, observed, stretches, pairs):
        yield (chi2[:C], score[:C], *rest,
               0.5 * (chi2[C:] - chi2[one] - chi2[other]))


# ---- 4. Posterior ---------------------------------- paper Sec. 2, Eqs. (3), (10)-(14)

ABSCISSAE, WEIGHTS = np.polynomial.legendre.leggauss(16)
GAMMA = 0.8         # threshold of the decision, the paper's value
TAIL = 14.0         # nats below the mode at which a posterior is cut off: 1e-7 of it
SETTLED = 0.03      # nats, and standard deviations, that a finer grid may change
SCALE_POINTS = 16   # point masses of a node: quantiles are good to 1 / 32
MAX_ZOOMS = 60      # each halves a box or so; 1e-9 of the prior takes 30
MAX_AXES = 2        # of a grid that zooms in
NODES_PER_SD = 1.5  # along every axis; what the prior's edges need,
                    # a Gaussian needs 0.7


@njit(**JIT)
def log_likelihood(s2, count, chi2, score, information, log_det, bias):
    """ln f(Y / theta, scale) of Eq. (9) from the sums of a node at s2 = scale^2.

    The integral over the bias, N(mean, variance), of the Gaussian whose -2 ln is
    (chi2 - 2 score b + information b^2) / s2, up to constants. All arguments broadcast.
    """
    known, spread = _without_spread(s2, np.log(s2), count, chi2, score, information,
                                    log_det, bias)
    return known - 0.5 * np.log(spread)


@njit(**INSIDE)
def _without_spread(s2, log_s2, count, chi2, score, information, log_det, bias):
    """`log_likelihood` but for half of the logarithm of a number, and that number: its
    root takes less time.
    """
    mean, variance = bias
    spread = variance * information + s2
    pull = mean * (2.0 * score - mean * information)
    chi2 = chi2 - (variance * score * score + pull * s2) / spread
    return -0.5 * (count * LOG_2PI + (count - 1) * log_s2 + log_det + chi2 / s2), spread


@njit(**INSIDE)
def _scale_window(count, chi2, score, information, bias, least, most):
    """Mode of ln scale where scale^2 is within least..most, its exp(2 mode), and how
    far below and above it counts.

    The slope of the log posterior in u = ln scale is D exp(-2u) less `known`, about
    count; D hardly depends on u, so that four fixed-point steps find where it is 0.
    """
    mean, variance = bias
    pull = mean * (2.0 * score - mean * information)
    s2 = np.sqrt(least * most)
    for _ in range(4):
        spread = variance * information + s2
        known, part = count - variance * information / spread, s2 / spread
        D = max(chi2 - variance * score * score * (1.0 + part) / spread
                - pull * part * part, 0.0)
        s2 = min(most, max(least, D / known)) if known > 0.0 else most
    curvature = 2.0 * D / s2
    slope = abs(0.5 * curvature - known)
    width = 2.0 * TAIL / (slope + np.sqrt(slope * slope + 2.0 * TAIL * curvature)
                          + 1e-300)
    # few samples leave a slow upper tail
    return 0.5 * np.log(s2), s2, width, max(width, TAIL / max(known, 1e-3))


@njit(**INSIDE)
def _ramp(x):
    """Share of a node x spacings inside an edge: a linear interpolant's integral."""
    if x < 0.0:
        return 0.5 * max(1.0 + x, 0.0)**2
    return 1.0 - 0.5 * max(1.0 - x, 0.0)**2


@njit(**INSIDE)
def _node_mass(count, chi2, score, node, limits, power, bias):
    """Mass of every node for one record: log of it and mean and square of the scale.

    node (M, 7) as `_node_columns` has it; limits as in `Grid`. The scale is integrated
    by Gauss-Legendre over the part of its range that holds the posterior; nodes
    TAIL + 10 nats below the best keep a bound.
    """
    M, edges = limits.shape[:2]
    mass, first, second = np.empty(M), np.empty(M), np.empty(M)
    low, high, mode, peak = np.zeros(M), np.zeros(M), np.zeros(M), np.empty(M)
    for j in range(M):
        information, log_det, log_prior = node[j, 0], node[j, 1], node[j, 2]
        low[j], high[j] = node[j, 3], node[j, 4]
        width, s2 = 0.5, 1.0
        if low[j] < high[j]:
            mode[j], s2, below, above = _scale_window(
                count - power, chi2[j], score[j], information, bias, node[j, 5],
                node[j, 6])
            low[j], high[j] = (max(low[j], mode[j] - below),
                               min(high[j], mode[j] + above))
            width = 0.5 * (high[j] - low[j])
        known, spread = _without_spread(s2, 2.0 * mode[j], count, chi2[j], score[j],
                                        information, log_det, bias)
        peak[j] = power * mode[j] + known
        # a bound, if the scale is free, at its most probable value
        first[j], second[j] = np.sqrt(s2), s2
        mass[j] = log_prior + peak[j] + np.log(2.0 * width / np.sqrt(spread))
    best = np.max(mass)
    for j in range(M):
        if mass[j] > best - TAIL - 10.0 and low[j] < high[j]:
            information, log_det, log_prior = node[j, 0], node[j, 1], node[j, 2]
            total = mean = square = 0.0
            for point in range(len(ABSCISSAE)):
                u = low[j] + 0.5 * (high[j] - low[j]) * (1.0 + ABSCISSAE[point])
                s2 = np.exp(2.0 * u)
                known, spread = _without_spread(
                    s2, 2.0 * u, count, chi2[j], score[j], information, log_det, bias)
                g = WEIGHTS[point] * np.exp(power * u - peak[j] + known) / np.sqrt(
                    spread)
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


@njit(**INSIDE)
def _moments(mass, first, second, feature, exponent):
    """Log of the total mass; mean and covariance of the features, Eqs. (13), (14).

    feature (M, F) at scale 1, to be multiplied by scale**exponent (0 or 1).
    """
    M, F = feature.shape
    best = np.max(mass)
    total, mean, cov = 0.0, np.zeros(F), np.zeros((F, F))
    for j in range(M):
        if mass[j] > best - TAIL - 10.0:
            weight = np.exp(mass[j] - best)
            total += weight
            for row in range(F):
                mean[row] += weight * feature[j, row] * (
                    first[j] if exponent[row] else 1.0)
    mean /= total
    for j in range(M):
        if mass[j] > best - TAIL - 10.0:
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
def _posteriors(count, chi2, score, node, limits, power, mean_bias, variance, feature,
                exponent):
    """Log evidence (C,), means (C, F) and covariances (C, F, F) of C records, whose
    biases have the laws N(mean_bias (C,), variance).
    """
    C, F = len(chi2), len(exponent)
    log_evidence, mean, cov = np.empty(C), np.empty((C, F)), np.empty((C, F, F))
    for record in prange(C):
        mass, first, second = _node_mass(
            count, chi2[record].copy(), score[record].copy(),
            node, limits, power, (mean_bias[record], variance))
        log_evidence[record], mean[record], cov[record] = _moments(
            mass, first, second, feature, exponent)
    return log_evidence, mean, cov


def _node_columns(g, sums):
    """Information, log_det, log_prior of every node, the ends of its ln scale, and
    those of scale^2.
    """
    begin, end, blur = np.moveaxis(g.limits, -1, 0)
    low, high = (begin - blur).max(1), (end + blur).min(1)
    return np.column_stack([sums.information, sums.log_det, g.log_prior, low, high,
                            np.exp(2.0 * low), np.exp(2.0 * high)])


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
    h, y = g.hypothesis, as_samples(y)
    if y.ndim != 2:
        raise ValueError(f"records of shape {y.shape}: "
                         "(C, N) is needed, one is y[None]")
    check_whole(stops, "stops", 1)
    offset = np.nanmean(y, 1)    # leaves the sums of a large bias their digits
    for sums in filter_bank(bank(h, g.dt, g.theta), y - offset[:, None], stops):
        yield _posteriors(sums.count, np.ascontiguousarray(sums.chi2),
                          np.ascontiguousarray(sums.score), _node_columns(g, sums),
                          g.limits, g.power, -offset, h.bias_sigma**2, feature,
                          exponent)


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
    """What a record says of one hypothesis: point masses, Eq. (3), and moments."""

    hypothesis: Hypothesis
    log_evidence: float          # ln f(Y / h_k)
    mean: np.ndarray             # (p,) Eq. (13)
    covariance: np.ndarray       # (p, p) Eq. (14)
    theta: np.ndarray            # (M, p) point masses
    weight: np.ndarray           # (M,) mu^kj, sum to 1
    nodes_per_sd: np.ndarray     # (d,) along each axis of the last grid
    settled: bool                # a finer grid said the same, to SETTLED; where nodes
                                 # are drawn, two standard errors are below it
    updates: int                 # filter steps that it took, all grids together


class Posterior(NamedTuple):
    """Answer of `identify`."""

    dt: float
    samples: int
    probability: np.ndarray    # (K,) Eq. (10), equal prior probabilities
    estimates: tuple           # K of Estimate

    @property
    def best(self):
        """`Estimate` of the most probable hypothesis."""
        return self.estimates[int(self.probability.argmax())]


def tempered(log_prior, log_mass, enough):
    """The largest power beta <= 1 of a mass that spreads over `enough` equal weights,
    and the weights prior mass^beta, which sum to 1.
    """
    out = np.isneginf(log_mass)    # whatever the power
    excess = np.where(out, 0.0, log_mass - log_mass.max())

    def weights(beta):
        w = np.where(out, -np.inf, log_prior + beta * excess)
        w = np.exp(w - w.max())
        return w / w.sum()
    low, beta = (0.0, 1.0) if np.sum(weights(1.0)**2) * enough > 1.0 else (1.0, 1.0)
    for _ in range(50 if low < beta else 0):
        middle = 0.5 * (low + beta)
        low, beta = ((middle, beta) if np.sum(weights(middle)**2) * enough < 1.0
                     else (low, middle))
    beta = low or beta
    return beta, weights(beta)


# A box of three axes and more is mostly empty, and a weak process gives the posterior
# arms. Nodes are then drawn: from local laws, Student's t, each as wide as the
# posterior is near a node of the last round (G. Givens, A. Raftery, J. Am. Stat. Assoc.
# 91, 1996), and from the prior. In coordinates x, the box is N(0, I), without edges.

LAWS = 256
FREEDOM = 5.0    # degrees of freedom of Student's t


def _drawn(share, centre, root, count):
    """Points x (count, d) of a mixture of Student's t, the log of its density there,
    and as many normal scores; evenly spread (M. Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018).
    """
    d = centre.shape[1]
    ratio = brentq(lambda g: g**(d + 4) - g - 1.0, 1.0, 2.0)
    u = (0.5 + np.outer(np.arange(count), ratio**-np.arange(1.0, d + 4.0))) % 1.0
    own = np.searchsorted(np.cumsum(share)[:-1], u[:, d])
    t = ndtri(u[:, :d]) * np.sqrt(FREEDOM / chdtri(FREEDOM, u[:, d + 1:d + 2]))
    x = centre[own] + np.einsum("iab,ib->ia", root[own], t)
    density, power, inverse = np.zeros(count), 0.5 * (FREEDOM + d), np.linalg.inv(root)
    columns = np.ascontiguousarray(x.T)
    for one, at, R in zip(share * np.linalg.det(inverse), centre, inverse):
        z = R @ columns - (R @ at)[:, None]
        square = np.einsum("ai,ai->i", z, z)    # exp and log are faster than a power
        density += one * np.exp(-power * np.log1p(square / FREEDOM))
    return (x, np.log(density) + gammaln(power) - gammaln(0.5 * FREEDOM)
            - 0.5 * d * np.log(FREEDOM * np.pi), ndtri(u[:, d + 2]))


def _local_laws(x, w):
    """Shares, centres and roots of the prior and of the laws that points x (M, d) of
    weights w suggest: as wide as the nearest eighth of them.
    """
    at = middles(8 * LAWS)
    x, one = x[np.searchsorted(np.cumsum(w)[:-1], at)], np.eye(x.shape[1])
    root = np.linalg.cholesky(np.cov(x.T) + 1e-14 * one)
    z = np.linalg.solve(root, x.T).T
    distance = ((z[::8, None] - z)**2).sum(-1)
    near = z[np.argpartition(distance, LAWS, axis=1)[:, :LAWS]]
    near -= near.mean(1, keepdims=True)
    local = np.linalg.cholesky(near.swapaxes(1, 2) @ near / LAWS + 0.01 * one)
    return (np.append(0.1, np.full(LAWS, 0.9 / LAWS)),
            np.vstack([0.0 * one[:1], x[::8]]), np.stack([one, *(root @ local)]))


class _View(NamedTuple):
    """What a grid shows of a posterior."""

    box: Box           # holds it, or the tempered one
    tempered: bool     # the grid is too coarse to show the posterior itself
    cut: bool          # there is mass at an edge of the grid that the prior
                       # does not have


def _view(g, mass, box):
    """Where the posterior is, from its masses on a grid over `box`.

    A coarse grid sees nothing but its best node. The posterior is therefore raised to
    the largest power beta <= 1 that still spreads over about one node per standard
    deviation; what that broader law excludes is excluded. Where a box cut mass off, it
    grows by half.
    """
    z, d = g.coordinate, g.coordinate.shape[1]
    mass = mass - mass.max()
    # one node per standard deviation spreads over (2 sqrt(pi))**d of them
    beta, w = tempered(0.0, mass, 3.5**d)
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
    """Posterior of one hypothesis, on nodes that are refined until they resolve it.

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
    record = (y - offset)[None]
    run = _zoomed if len(prior_box(h, dt).low) <= MAX_AXES else _sampled
    return run(h, dt, record, (-offset, h.bias_sigma**2), max_nodes)


def _masses(g, record, bias):
    """What `_node_mass` says of the nodes of a grid, and what `_moments` makes of it,
    of parameters and coordinates.
    """
    sums = next(filter_bank(bank(g.hypothesis, g.dt, g.theta), record,
                            [record.shape[1]]))
    masses = _node_mass(sums.count, sums.chi2[0].copy(), sums.score[0].copy(),
                        _node_columns(g, sums), g.limits, g.power, bias)
    return masses, _moments(*masses, *_features(g))


def _zoomed(h, dt, record, bias, max_nodes):
    """`resolve` by a grid that zooms in on the posterior."""
    box, updates = prior_box(h, dt), 0
    d, p = len(box.low), len(h.parameters)
    nodes = [1, 32, 20][d]
    known = np.array([False, *(not q.free for q in h.parameters), *[False] * d])
    past, settled = np.inf, d == 0
    for _ in range(MAX_ZOOMS):
        g = grid(h, dt, nodes, box)
        updates += g.log_prior.size * record.size
        masses, (log_evidence, mean, cov) = _masses(g, record, bias)
        nodes_per_sd = np.minimum(_nodes_per_sd(g, cov), _edge_nodes(g, mean, cov))
        if settled:
            break
        view = _view(g, masses[0], box)
        shrunk = np.prod((view.box.high - view.box.low) / (box.high - box.low))
        if (nodes_per_sd >= NODES_PER_SD).all() and not view.tempered and not view.cut:
            # the average may hide a corner: believed when a finer grid says the same
            here, sd = np.append(log_evidence, mean), np.sqrt(np.diagonal(cov))
            settled = bool((abs(here - past) <= SETTLED * np.append(1.0, sd))[
                ~known[:len(here)]].all())
            if settled:
                break
            past, shrunk = here, 1.0
        if shrunk > 0.8 and not view.cut:
            nodes = int(np.ceil(1.4 * nodes))
            if nodes**d > max_nodes:
                break
        box = view.box
    at = ndtri(middles(SCALE_POINTS))[:, None]
    at /= np.sqrt(np.mean(at**2))
    return Estimate(h, log_evidence, mean[:p], cov[:p, :p],
                    *_point_masses(g, *masses, at), nodes_per_sd, settled, updates)


def _sampled(h, dt, record, bias, max_nodes):
    """`resolve` by nodes drawn from laws that learn where the posterior is."""
    box, updates = prior_box(h, dt), 0
    d, p = len(box.low), len(h.parameters)
    laws, count = (np.ones(1), np.zeros((1, d)), np.eye(d)[None]), min(2048, max_nodes)
    for _ in range(MAX_ZOOMS):
        x, log_law, at = _drawn(*laws, count)
        log_weight = (np.log(box.high - box.low) - 0.5 * x**2 - 0.5 * LOG_2PI).sum(1)
        g, inside = _grid_of(h, dt, box.low + ndtr(x) * (box.high - box.low),
                             log_weight - log_law - np.log(count), np.zeros_like(x))
        updates += len(g.theta) * record.size
        masses, (log_evidence, mean, cov) = _masses(g, record, bias)
        mass, first, _ = masses
        mean, cov, w = mean[:p], cov[:p, :p], np.exp(mass - log_evidence)
        away = g.theta * np.where(g.exponent, first[:, None], 1.0) - mean
        variance = np.append(1.0, np.diagonal(cov))    # of the evidence first
        error = w**2 @ np.column_stack([np.ones(len(w)), away])**2 / np.where(
            variance > 0.0, variance, 1.0)
        excess = np.sqrt(error.max()) / (0.5 * SETTLED)
        beta, tamed = tempered(g.log_prior, mass - g.log_prior, 0.1 * count)
        if beta == 1.0 and (excess < 1.0 or count == max_nodes):
            break
        laws = _local_laws(x[inside], tamed)
        if beta == 1.0:
            count = int(min(1.1 * count * max(excess**2, 1.0), 4 * count, max_nodes))
    nodes_per_sd = np.full(d, np.sum(w**2)**(-1.0 / d) / 3.5)
    return Estimate(h, log_evidence, mean, cov,
                    *_point_masses(g, *masses, at[None, inside]), nodes_per_sd,
                    beta == 1.0 and bool(excess < 1.0), updates)


def _point_masses(g, mass, first, second, at):
    """Point masses, Eq. (3): where the scale is integrated, of each node those `at`
    standard scores (points, 1 or M) of the normal law of its moments.
    """
    weight = np.exp(mass - mass.max())
    keep = weight > 1e-12 * weight.sum()
    weight, first, theta = weight[keep], first[keep], g.theta[keep]
    sd = np.sqrt(np.maximum(second[keep] - first**2, 0.0))
    at = np.broadcast_to(at if g.exponent.any() else 0.0, (len(at), len(mass)))[:, keep]
    theta = [theta * np.where(g.exponent, (first + t * sd)[:, None], 1.0) for t in at]
    return np.concatenate(theta), np.tile(weight / weight.sum() / len(at), len(at))


def identify(y, dt, hypotheses=None, progress=None):
    """Posterior of the error model of one record, Eqs. (3)-(14).

    Parameters
    ----------
    y : (N,) array
        Sensor error, u, evenly sampled; NaN marks a missing sample.
    dt : float
        Sampling interval, s.
    hypotheses : Hypothesis or sequence of Hypothesis, optional
        The K structures in question, by default `default_hypotheses`.
    progress : function of (done, all), optional
        Called after every hypothesis.

    Returns
    -------
    Posterior
        It ranks the hypotheses; `allan_misfit` tells whether any describes the record.

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
    y = as_samples(y)
    check_record(y, dt)
    check_unit(y)
    hypotheses = (default_hypotheses(y, dt) if hypotheses is None
                  else as_hypotheses(hypotheses))
    estimates = []
    for h in hypotheses:
        estimates.append(resolve(_with_room(h, y), dt, y))
        if progress:
            progress(len(estimates), len(hypotheses))
    evidence = [e.log_evidence for e in estimates]
    if not np.isfinite(evidence).any():
        raise ValueError("no hypothesis has a likelihood that is a number: the sigma_* "
                         "and the record differ by too many orders of magnitude")
    return Posterior(dt, len(y), probabilities(evidence), tuple(estimates))


UNEXPECTED = 3.0    # of an offset: times the standard deviation of bias and record


def _with_room(h, y):
    """The hypothesis, a bias that was not given as wide as a record's offset needs."""
    offset = abs(float(np.nanmean(y)))
    if h.bias_given or offset < UNEXPECTED * max(h.bias_sigma, np.nanstd(y)):
        return h
    return h._replace(bias_sigma=offset, bias_given=True)


def probabilities(log_evidence):
    """Eq. (10) with equal prior probabilities, over the last axis."""
    log_evidence = np.asarray(log_evidence)
    ratio = np.exp(log_evidence - log_evidence.max(-1, keepdims=True))
    return ratio / ratio.sum(-1, keepdims=True)


def decide(posterior, gamma=GAMMA):
    """Number of the most probable hypothesis h_k*; None below the threshold."""
    best = int(np.argmax(posterior.probability))
    return best if posterior.probability[best] >= gamma else None


def matrices(estimate, dt):
    """Phi, Gamma, H, Psi at the estimate, the bias as the last state, Eq. (21)."""
    check_interval(dt)
    filt = estimate.hypothesis.filter(dt, estimate.mean)
    n, noises = filt.Gamma.shape[1:]
    Phi = np.eye(n + 1)
    Phi[:n, :n] = filt.Phi[0]
    return dict(Phi=Phi.tolist(),
                Gamma=np.vstack([filt.Gamma[0], np.zeros((1, noises))]).tolist(),
                H=[*filt.H[0].tolist(), 1.0], Psi=float(filt.Psi[0]))


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

    Raises
    ------
    ValueError
        If the record is none that `identify` takes.
    """
    h, y = estimate.hypothesis, as_samples(y)
    check_record(y, dt)
    b = bank(h, dt, estimate.theta)
    observed = 1.0 - np.isnan(y)
    offset = np.nanmean(y)
    M = len(b.m0)
    start = _start_abreast(b, np.zeros((1, M), int))
    _advance_abreast(np.nan_to_num(y - offset)[None], observed, 0, *start)
    x, P, sums = (_one_by_one(part, M) for part in start[-4:-1])
    P = np.tril(P) + np.tril(P, -1).swapaxes(1, 2)
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

CHUNK = 128             # trials that go together; results do not depend on it
LONG_TRIAL = 100_000    # samples above which a chunk is one block of LANES


class Curve(NamedTuple):
    """A criterion against time, with Monte-Carlo standard errors."""

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

    Pilot trials of the hypothesis set the density: nine of ten shall have NODES_PER_SD,
    and a finer grid the same standard deviations, to AGREED: few samples leave the
    prior, whose edges a coarse grid blurs.
    Returns the grid and the nodes per standard deviation reached, (d,).
    """
    box, free = prior_box(h, dt), free_columns(h.parameters)
    nodes, dense = np.full(len(box.low), 12), None
    y = simulate([h], dt, samples, pilots, seed).error
    while True:
        g = grid(h, dt, nodes, box)
        _, _, cov = next(posteriors(g, y, [samples], coordinates=True))
        sd = np.sqrt(cov[:, free, free].mean(0))
        if dense and (abs(sd - dense[-1]) <= AGREED * sd).all():
            return dense[:2]
        reached = np.array([_nodes_per_sd(g, c) for c in cov])
        reached = np.quantile(reached, 0.1, axis=0) if len(nodes) else reached[0]
        if enough := (reached >= NODES_PER_SD).all():
            dense = g, reached, sd
        growth = 1.4 if enough else np.clip(
            1.05 * NODES_PER_SD / np.maximum(reached, 0.1), 1.0, 2.5)
        more = np.ceil(nodes * growth).astype(int)
        if np.prod(more) > max_nodes or not len(nodes):
            return g, reached
        nodes = more if enough else np.where(reached < NODES_PER_SD, more, nodes)


AGREED = 0.005    # of a standard deviation that a finer grid of criteria may change


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
    """Simulate and filter a part of the trials; a pure function."""
    trials = simulate(truths, dt, int(stops[-1]), last - first, seed, first)
    log_evidence, mean, variance, truth = [], [], [], []
    for k, g in enumerate(grids):
        evidence, means, covariances = (
            np.stack(part, 1) for part in zip(*posteriors(g, trials.error, stops)))
        log_evidence.append(evidence)
        mean.append(means)
        variance.append(np.diagonal(covariances, axis1=2, axis2=3))
        own = [q.symbol for q in truths[k].parameters] if k < len(truths) else []
        truth.append(np.column_stack([
            np.where(trials.hypothesis == k, trials.theta[:, own.index(q.symbol)],
                     np.nan) if q.symbol in own else np.full(len(trials.theta), np.nan)
            for q in g.hypothesis.parameters]))
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
    file = pathlib.Path(folder) / f"{fingerprint(__version__, arguments)[:32]}.npz"
    if file.exists():
        try:
            with np.load(file) as kept:
                return _Chunk(**kept)
        except Exception:    # damaged, in whatever way: worth no more than nothing
            pass
    chunk = _run_chunk(*arguments)
    write_whole(file, lambda stream: np.savez(stream, **chunk._asdict()))
    return chunk


def fingerprint(*parts):
    """SHA-256 of all that decides a result: values, and functions with their code,
    closures, defaults and the globals that they use; the same in every process.
    """
    digest = hashlib.sha256()
    try:
        _Contents(types.SimpleNamespace(write=digest.update), 4).dump(parts)
    except Exception as problem:
        raise ValueError("the checkpoint cannot tell these arguments from others "
                         f"({problem}): leave it out, or pass functions of plain "
                         "values") from None
    return digest.hexdigest()


LIBRARIES = tuple({sysconfig.get_path(key) for key in ("stdlib", "purelib", "platlib")})


class _Contents(pickle.Pickler):
    """Writes a function by its code and what it uses, classes and modules by their
    source; those of installed libraries by name and version.
    """

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.fast, self.met = True, []    # equal parts, equal bytes: no references

    def reducer_override(self, part):
        part = getattr(part, "py_func", getattr(part, "__wrapped__", part))
        if isinstance(part, types.CodeType):
            consts = [sorted(map(repr, c)) if isinstance(c, frozenset) else c
                      for c in part.co_consts]    # of a set the order is by chance
            return str, (part.co_code, part.co_names, part.co_freevars, consts)
        if part is str or not isinstance(
                part, (types.FunctionType, types.ModuleType, type)):
            return NotImplemented
        name = getattr(part, "__module__", part.__name__)
        file = getattr(sys.modules.get(name), "__file__", None) or ""
        library = file.startswith(LIBRARIES) or not file and name != "__main__"
        if library or not isinstance(part, types.FunctionType) or part in self.met:
            if not file and not library:
                raise ValueError(f"{part.__name__} is in no file")
            top = sys.modules.get(name.partition(".")[0])
            return str, (name, part.__name__, getattr(top, "__version__", ""),
                         b"" if library else pathlib.Path(file).read_bytes())
        self.met.append(part)
        names, codes = set(), [part.__code__]
        for code in codes:    # grows with the functions inside
            names.update(code.co_names)
            codes += [c for c in code.co_consts if isinstance(c, types.CodeType)]
        return str, (part.__code__, part.__defaults__, part.__kwdefaults__,
                     [cell.cell_contents for cell in part.__closure__ or ()],
                     [(n, part.__globals__[n]) for n in sorted(names)
                      if n in part.__globals__])


def write_whole(file, put):
    """Write a file whole or not at all."""
    if os.path.exists(file) and not os.path.isfile(file):    # a pipe or a device
        with open(file, "wb") as stream:
            return put(stream)
    file = pathlib.Path(os.path.realpath(file))
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f".{file.name[:50]}.{secrets.token_hex(4)}")
    new = open(part, "xb")    # no other's file, no link
    try:
        with new as stream:
            if file.exists():
                os.chmod(part, file.stat().st_mode & 0o7777)
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
        Times, s, at which the criteria are wanted, each rounded to whole samples.
    truths : sequence of Hypothesis, optional
        What the trials are drawn from, one for each hypothesis, where the algorithm
        shall be wrong about it. Parameters that both have are compared, by symbol.
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
    hypotheses, algorithms = as_hypotheses(hypotheses), algorithms or {}
    check_seed(seed)
    if not hasattr(algorithms, "values"):
        raise ValueError(f"algorithms are {algorithms!r}: a dict of functions is needed"
                         ", by their names")
    samples = check_trials(hypotheses, dt, duration, trials)
    if times is not None:
        stops = stops_at(times, dt)
    elif algorithms:
        first = min(max(samples / 32, MIN_COMPARED), samples)
        stops = np.unique(np.round(np.geomspace(first, samples, 6)).astype(int))
    else:
        stops = criteria_times(samples)
    if algorithms and stops[0] < MIN_COMPARED:
        raise ValueError(f"the first time has {stops[0]} samples: "
                         f"algorithms are compared from {MIN_COMPARED} samples on")
    if not 1 <= stops[0] <= stops[-1] <= samples:
        raise ValueError(f"times {stops[0] * dt:g} to {stops[-1] * dt:g} s "
                         f"do not lie within {dt:g} to {duration:g} s")
    for what, some in ("truths", truths), ("grids", grids):
        if some is not None and len(some) != len(hypotheses):
            raise ValueError(f"{len(some)} {what} of {len(hypotheses)} hypotheses: one "
                             "for each is needed")
    for h, g in zip(hypotheses, grids or ()):
        if (g.hypothesis, g.dt) != (h, dt):
            raise ValueError(f"a grid of {g.hypothesis.name} at {g.dt:g} s stands "
                             f"where one of {h.name}, with its priors, at {dt:g} s is "
                             "needed: make each by grid(h, dt, nodes)")
    if algorithms:    # refuse what they cannot do before the work
        short = simulate(truths or hypotheses, dt, int(stops[0]), 1, seed).error[0]
        for name, algorithm in algorithms.items():
            _check_answer(name, algorithm(short, dt, tuple(hypotheses)), hypotheses)
    reached = tuple(np.full(g.coordinate.shape[1], np.nan) for g in grids or ())
    if grids is None:
        grids, reached = zip(*(criteria_grid(h, dt, samples, seed) for h in hypotheses))
    chunk = _run_trials(truths or hypotheses, grids, algorithms, dt, stops, trials,
                        seed, executor, checkpoint, progress)
    return _criteria(hypotheses, grids, reached, dt * stops, algorithms, chunk)


def stops_at(times, dt):
    """Numbers of samples (T,) at times, s."""
    try:
        samples = np.atleast_1d(np.asarray(times, float)) / dt
    except (TypeError, ValueError):
        samples = np.full(1, np.nan)
    if not samples.size or samples.ndim > 1 or not np.isfinite(samples).all():
        raise ValueError(f"times {times!r}: one or more finite numbers, s, are needed")
    return np.unique(np.round(samples).astype(int))


def _check_answer(name, answer, hypotheses):
    """Refuse what an algorithm of somebody's own may not return."""
    try:
        choice, estimates = answer
        right = choice in range(len(hypotheses)) and [len(e) for e in estimates] == [
            len(h.parameters) for h in hypotheses]
    except (TypeError, ValueError):
        right = False
    if not right:
        raise ValueError(f"the algorithm {name} returns {answer!r}: the number of the "
                         "hypothesis that it chooses is needed, and its estimates, an "
                         "array (p,) for each hypothesis")


def check_trials(hypotheses, dt, duration, trials):
    """Number of samples of a trial, if all numbers make sense."""
    if not (is_number(dt) and is_number(duration) and 0 < dt <= duration < np.inf):
        raise ValueError(f"dt = {dt} s, duration = {duration} s: two numbers, "
                         "0 < dt <= duration, are needed")
    check_whole(trials, "numbers of trials")
    if trials < 8 * len(hypotheses):
        raise ValueError(f"{trials} trials of {len(hypotheses)} hypotheses: "
                         f"a criterion needs at least {8 * len(hypotheses)}")
    if not duration / dt < 2**31:
        raise ValueError(f"{duration:g} s at {dt:g} s are {duration / dt:.3g} samples: "
                         "record less, or sample more slowly")
    return int(round(duration / dt))


def check_executor(executor):
    """Refuse what runs nothing in other processes or threads."""
    if executor is not None and not hasattr(executor, "submit"):
        raise ValueError(f"the executor is {executor!r}: a concurrent.futures.Executor "
                         "is needed, or None")


def _run_trials(truths, grids, algorithms, dt, stops, trials, seed, executor=None,
                checkpoint=None, progress=None):
    """All trials as one `_Chunk`."""
    if checkpoint is not None and pathlib.Path(checkpoint).is_file():
        raise ValueError(f"the checkpoint {checkpoint} is a file: a folder is needed")
    check_executor(executor)
    size = CHUNK if stops[-1] <= LONG_TRIAL and not algorithms else LANES
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


MIN_COMPARED = 32    # samples; slopes of an Allan deviation need as many


def _criteria(hypotheses, grids, reached, time, algorithms, chunk):
    """Eqs. (15)-(20) from the trials."""
    probability = probabilities(chunk.log_evidence)
    wrong = (probability.argmax(-1) != chunk.hypothesis[:, None]).astype(float)
    error = _curve(wrong, 1.0 - probability.max(-1))
    labels, rsd, squares = [], [], []
    listed = [(h, p) for h in hypotheses for p in h.parameters]
    for column, (h, p) in enumerate(listed):
        own = ~np.isnan(chunk.truth[:, column])
        if p.free and own.any():
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
    hypotheses = as_hypotheses(hypotheses)
    check_seed(seed)
    targets = check_targets(hypotheses, error, rsd or {})
    samples = check_trials(hypotheses, dt, limit, trials)
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


def check_targets(hypotheses, error, rsd):
    """(label, target, column) of every target; column None is the error."""
    if error is None and not rsd:
        raise ValueError("no target is given: a target of the error probability "
                         "or of an RSD is needed")
    if error is not None and (len(hypotheses) < 2 or not 0.0 < error < 1.0):
        raise ValueError(f"error probability {error:g} of {len(hypotheses)} hypotheses:"
                         " 0 < target < 1 and two of them are needed")
    if rsd and not hasattr(rsd, "items"):
        raise ValueError(f"rsd is {rsd!r}: a dict of parameters and their RSD is "
                         'needed, such as {"sigma_w": 0.05}')
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


# ---- 6. Allan variance ----------------------------- IEEE Std 952, NIST SP 1065

def allan_variance(omega, dt, m):
    """Overlapping Allan variance of a rate record at averaging time tau = m * dt.

    Parameters
    ----------
    omega : (..., N) array
        Rate or specific force, u, evenly sampled; NaN marks a missing sample.
    dt : float
        Sampling interval, s.
    m : int, or array (K,) of them
        Samples per cluster, 1 <= m <= N / 2.

    Returns
    -------
    float, or array (...) or (..., K)
        sigma^2(tau), u^2, from the pairs of clusters that miss nothing; NaN if there
        are none.

    Raises
    ------
    ValueError
        If the record does not hold two clusters of m samples, or m is no whole number.

    Notes
    -----
    NIST SP 1065, Eq. (11), with the integrated rate as the phase.

    Examples
    --------
    A ramp of slope R has sigma^2 = (R * tau)^2 / 2:

    >>> allan_variance(np.arange(10.0), dt=1.0, m=2)
    2.0
    """
    omega = as_samples(omega)
    samples, clusters = omega.shape[-1], np.ravel(m)
    check_interval(dt)
    check_finite(omega)
    if clusters.dtype.kind not in "iu":
        raise ValueError(f"m is {m!r}: whole numbers of samples are needed")
    for one in clusters:
        if not 1 <= one <= samples // 2:
            raise ValueError(
                f"m = {one} does not fit a record of {samples} samples: the Allan "
                f"variance needs two clusters, so 1 <= m <= {samples // 2}")
    rows = np.ascontiguousarray(omega).reshape(-1, samples)
    variance = 0.5 * _differences_of_clusters(rows, clusters).reshape(
        (*omega.shape[:-1], *np.shape(m)))
    return variance if variance.ndim else float(variance)


@njit(nogil=True, **JIT)
def _differences_of_clusters(omega, m):
    """Mean squares (R, K) of (second mean of m - first mean of m) over all pairs of
    clusters of rows (R, N) that miss nothing.
    """
    rows, N = omega.shape
    result, sums, gone = np.empty((rows, len(m))), np.zeros(N + 1), np.zeros(N + 1)
    for row in range(rows):
        middle = _sum(omega[row]) / N    # about it, sums keep their digits
        whole = not np.isnan(middle)
        if not whole:
            middle = np.nanmean(omega[row])
        for i in range(N):
            value = omega[row, i] - middle
            missing = np.isnan(value)
            sums[i + 1] = sums[i] + (0.0 if missing else value)
            if not whole:
                gone[i + 1] = gone[i] + missing
        for k in range(len(m)):
            result[row, k] = _mean_square_of_whole(sums, m[k]) if whole else (
                _mean_square_apart(sums, gone, m[k]))
    return result


REORDERED = {**INSIDE, "fastmath": {"contract", "reassoc"}}


@njit(**REORDERED)
def _sum(values):
    total = 0.0
    for value in values:
        total += value
    return total


@njit(**REORDERED)
def _mean_square_of_whole(sums, m):
    """`_mean_square_apart` where nothing misses."""
    total = 0.0
    for i in range(2 * m, len(sums)):
        apart = sums[i] - 2.0 * sums[i - m] + sums[i - 2 * m]
        total += apart * apart
    return total / (len(sums) - 2 * m) / m**2


@njit(**REORDERED)
def _mean_square_apart(sums, gone, m):
    """Mean square of (second mean of m - first mean of m) from the sums of all samples
    before each, and the number of those that miss.
    """
    total, pairs = 0.0, 0
    for i in range(2 * m, len(sums)):
        apart = sums[i] - 2.0 * sums[i - m] + sums[i - 2 * m]
        if gone[i] == gone[i - 2 * m]:
            total += apart * apart
            pairs += 1
    return total / pairs / m**2


def allan_deviation(omega, dt, per_octave=1):
    """Averaging times, s, up to a third of the record, and Allan deviations, u, at so
    many an octave, at least 1.
    """
    omega = as_samples(omega)
    if omega.ndim != 1 or len(omega) < 2:
        raise ValueError(f"the record has shape {omega.shape}: two samples or more of "
                         "one axis of one sensor are needed")
    n = len(omega)
    if not 1 <= per_octave <= n:
        raise ValueError(f"{per_octave} averaging times per octave: 1 or more are "
                         f"needed, and no more than the samples, {n}")
    octaves = np.arange(0.0, np.log2(max(n // 3, 1)) + 1e-9, 1.0 / per_octave)
    m = np.unique(np.round(2.0**octaves).astype(int))
    adev = np.sqrt(allan_variance(omega, dt, m))
    return m[~np.isnan(adev)] * dt, adev[~np.isnan(adev)]


@njit(**JIT)
def mean_square(weight, Phi, Gamma, H, Psi, m0, P0):
    """Mean square of the sum of weight_i y_i of a shaping filter, from its derivatives
    to every noise, the last sample first.
    """
    n, total = len(m0), 0.0
    g, new = np.zeros(n), np.zeros(n)
    for i in range(len(weight) - 1, -1, -1):
        # a view of a matrix would count references, which takes as long as all else
        phi, gamma = min(i, len(Phi) - 1), min(i, len(Gamma) - 1)
        h, psi = min(i, len(H) - 1), min(i, len(Psi) - 1)
        total += (weight[i] * Psi[psi])**2
        for row in range(n):
            g[row] += weight[i] * H[h, row]
            new[row] = 0.0
        for column in range(Gamma.shape[2]):
            of_noise = 0.0
            for row in range(n):
                of_noise += g[row] * Gamma[gamma, row, column]
            total += of_noise * of_noise
        for row in range(n):
            for column in range(n):
                new[column] += Phi[phi, row, column] * g[row]
        for row in range(n):
            g[row] = new[row]
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
    samples.

    Examples
    --------
    White noise falls with the averaging time, Eq. (23):

    >>> round(float(model_allan_variance(white_noise(1.0, 2.0), 4)), 12)
    1.0
    """
    if np.asarray(m).dtype.kind not in "iu" or np.min(m) < 1:
        raise ValueError(f"m is {m!r}: whole numbers of samples from 1 on are needed")
    return np.reshape([mean_square(np.repeat([-1.0, 1.0], one) / (np.sqrt(2.0) * one),
                                   *filt) for one in np.ravel(m)], np.shape(m))


class Misfit(NamedTuple):
    """Where the Allan deviation of a record and that of its model differ most."""

    tau: float       # s; None where too much is missing
    ratio: float     # record over model
    sd: float        # difference in standard deviations
    sentence: str

    @property
    def described(self):
        """Is the model a description of the record, as far as is known?"""
        return self.sd is None or abs(self.sd) <= 5.0


def allan_misfit(y, dt, estimate):
    """Largest difference between the Allan deviations of a record and of its model.

    Octaves up to a tenth of the record. The standard deviation is that of white noise
    (edf of NIST SP 1065, Table 5), a lower bound for slower noises: a hint, not a test.
    """
    y = as_samples(y)
    missing = np.append(0, np.cumsum(np.isnan(y)))
    filt = estimate.hypothesis.filter(dt, estimate.mean)
    tau, adev = allan_deviation(y, dt)
    if not len(tau):
        return Misfit(None, None, None, "too many samples are missing for an Allan "
                      "deviation: the fit is not checked")
    keep = tau <= 0.1 * dt * len(y)
    tau, adev = (tau[keep], adev[keep]) if keep.any() else (tau[:1], adev[:1])
    m = np.round(tau / dt).astype(int)
    model = np.sqrt(model_allan_variance(filt, m))
    whole = [np.mean(missing[2 * n:] == missing[:-2 * n]) for n in m]    # of the pairs
    edf = ((1.5 * (len(y) - 1) / m - 2 * (len(y) - 2) / len(y))
           * 4 * m**2 / (4 * m**2 + 5)) * whole
    z = np.log(adev / model) * np.sqrt(2.0 * np.maximum(edf, 1.0))
    worst = int(np.abs(z).argmax())
    ratio = float(adev[worst] / model[worst])
    misfit = Misfit(float(tau[worst]), ratio, float(z[worst]), (
        "Allan deviation of the record over that of the most probable model: "
        f"{ratio:.3g} at tau = {tau[worst]:g} s, {abs(z[worst]):.1f} standard "
        "deviations, the largest of all octaves"))
    return misfit if misfit.described else misfit._replace(sentence=misfit.sentence + (
        "\nno hypothesis describes this record: something is left out"))


# ---- 7. Front door -------------------------- a plain CSV, where this file is alone

SUMMARY = "hypothesis", "probability", "parameters, mean +- standard deviation"


def summary(posterior, unit="u"):
    """The answer of `identify` as text."""
    rows = [SUMMARY, *summary_rows(posterior, unit)]
    return "\n".join([*(f"{name:<20}{probability:>11}  {text}"
                        for name, probability, text in rows), decided(posterior)])


def summary_rows(posterior, unit="u"):
    """Rows under `SUMMARY`, most probable hypothesis first."""
    for k in np.argsort(-posterior.probability):
        e = posterior.estimates[k]
        text = ", ".join(
            f"{p.symbol} = {m:.4g}" + (f" +- {sd:.2g}" if p.free else "")
            + (" s" if p.symbol.startswith("tau") else f" {unit}")
            + ("/s" if p.symbol == "slope" else "") + _at_an_end(p, m, sd)
            for p, m, sd in zip(e.hypothesis.parameters, e.mean,
                                np.sqrt(np.diag(e.covariance))))
        yield e.hypothesis.name, f"{posterior.probability[k]:.4f}", text
        if not e.settled:
            yield "", "", ("coarse: a finer grid than one of "
                           f"{e.nodes_per_sd.min():.2g} nodes per standard deviation "
                           "is needed")


def decided(posterior):
    """What `decide` says, in a sentence."""
    chosen = decide(posterior)
    return f"decision at threshold {GAMMA}: " + (
        "none, record longer" if chosen is None else
        posterior.estimates[chosen].hypothesis.name)


def _at_an_end(p, mean, sd):
    """A warning where a sharp posterior leans on an end of its prior."""
    if p.free and sd < 0.25 * p.sd and min(mean - p.low, p.high - mean) < 1.5 * sd:
        end = "low" if mean - p.low < p.high - mean else "high"
        return f" (at the {end} end of its range: widen the prior)"
    return ""


def identify_csv(file, column="error", dt=None):
    """`identify` of a CSV file with a header, without missing samples, as text.

    The columns are `time`, s, evenly spaced, and the error; any others are left alone.
    """
    try:
        with open(file, encoding="utf-8-sig") as stream:
            lines = stream.readlines()
    except UnicodeDecodeError:
        raise ValueError(f"{file}: no text: a CSV with a line of names, such as "
                         "time,error, is needed") from None
    if len(lines) < 2:
        raise ValueError(f"{file}: {len(lines)} lines: a line of names, such as "
                         "time,error, and one of numbers for every sample are needed")
    table = np.genfromtxt(lines, delimiter=",", names=True)
    names = table.dtype.names or ()
    needed = [column] if dt is not None else [column, "time"]
    strange = [name for name in needed if name not in names]
    if strange:
        raise ValueError(f"{file}: no column {strange[0]!r} among {', '.join(names)}: "
                         "the first line must name the columns, such as time,error")
    y = np.atleast_1d(table[column])
    if np.isnan(y).any():
        raise ValueError(f"{file}: sample {np.argmax(np.isnan(y))} of {column} is no "
                         "number: sensorlab reads records with missing samples")
    step = np.diff(table["time"]) if "time" in names else np.empty(0)
    if dt is not None and len(step) and abs(np.median(step) - dt) > 0.1 * dt:
        raise ValueError(f"{file}: the times are {np.median(step):g} s apart, --dt is "
                         f"{dt:g} s: leave it out")
    if dt is None:
        dt = float(np.mean(step)) if len(step) else 1.0
        if not (np.abs(step - dt) < 0.1 * dt).all():
            raise ValueError(f"{file}: the times are not evenly spaced: sensorlab "
                             "reads such a record, --dt takes the samples as even")
    posterior = identify(y, dt)
    return "\n".join([f"{file}, column {column}: {len(y)} samples at {dt:g} s",
                      summary(posterior), allan_misfit(y, dt, posterior.best).sentence])


for _result in (ShapingFilter, Trials, Grid, Box, Sums, Bank, Modes, Estimate,
                Posterior, Curve, Criteria, Rival, _Chunk):
    _result.__repr__ = brief
