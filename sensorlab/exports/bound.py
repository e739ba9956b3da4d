"""The two numbers that most programs know of a sensor, density and walk, so that what
they calculate is not less than what is true.

A program that takes the mean of h seconds at rest for the bias and then integrates for
h seconds has the error

    e(h) = sum of dt (y_i - mean of the h before),    rms e(h) = sqrt(2) h sigma(h),

with sigma the Allan deviation. White noise of density N and a random walk K have

    sigma^2(h) = N^2 / h + K^2 dt (2 m^2 + 1) / (6 m),   m = h / dt.

A pair *bounds* a model up to a horizon where its e(h) is nowhere smaller, from one
sample to the horizon. Among these, the smallest is the one whose mean square error is
least in excess: the mean over the averaging times, evenly in log, of the ratio of the
two variances. Both are linear in N^2 and K^2, so that is a linear programme. The
*fitted* pair is that of least squares of the same ratio about 1. Folklore takes ten
times the fitted one.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog, nnls

from sensorid import model_allan_variance, random_walk

TIMES = 200       # averaging times, at most: between them the bound holds to 5e-4
FOLKLORE = 10.0
LONGEST = 10**6   # samples of a horizon: a few seconds of work


class Pair(NamedTuple):
    """White noise and random walk, as in IEEE Std 952."""

    density: float    # N, u sqrt(s) = u / sqrt(Hz), two-sided
    walk: float       # K, u / sqrt(s)


def pairs(axis, horizon):
    """The pairs of an `Axis` by name: bound, fitted and x10."""
    m = averaging_times(axis, horizon)
    ratio = (np.column_stack(pair_variances(axis.dt, m))
             / axis.allan_variance(m)[:, None])
    size = ratio.max(axis=0)    # unknowns of the order of 1
    scaled, ones = ratio / size, np.ones(len(m))
    least = linprog(scaled.sum(axis=0), A_ub=-scaled, b_ub=-ones).x
    least /= (scaled @ least).min()    # the last digit of the solver
    fitted = _pair(nnls(scaled, ones)[0] / size)
    return dict(bound=_pair(least / size), fitted=fitted,
                x10=Pair(*(FOLKLORE * part for part in fitted)))


def averaging_times(axis, horizon):
    """Averaging times in samples, from one to the horizon, evenly in log.

    Raises
    ------
    ValueError
        If the horizon is shorter than a sample, or longer than LONGEST.
    """
    if not horizon >= axis.dt:
        raise ValueError(f"a horizon of {horizon:g} s is shorter than the sampling "
                         f"interval, {axis.dt:g} s")
    if horizon > LONGEST * axis.dt:
        raise ValueError(f"a horizon of {horizon:g} s holds more than {LONGEST} "
                         f"samples, {LONGEST * axis.dt:g} s: integrate for less")
    m = np.geomspace(1, round(horizon / axis.dt), TIMES)
    return np.unique(m.round().astype(int))


def pair_variances(dt, m):
    """Allan variances of N = 1 and of K = 1 at averaging times of m samples."""
    return 1.0 / (m * dt), dt * model_allan_variance(random_walk(dt, 1.0), m)


def _pair(squares):
    return Pair(*np.sqrt(np.maximum(squares, 0.0)).tolist())
