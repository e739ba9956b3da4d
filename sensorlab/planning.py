"""How long must be recorded: the same sensor under other conditions, and the sensor of
a record at hand.
"""

import inspect
from typing import NamedTuple

import numpy as np

from sensorid import Parameter, criteria_grid, identify, posteriors, simulate


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


# ---- the sensor of a record at hand

AHEAD = 16       # times the record: how far ahead one looks by default
STOPS = 25       # record lengths
TOGETHER = 64    # trials at a time
BAND = 0.05, 0.5, 0.95


class Outlook(NamedTuple):
    """How well a parameter will be known, against record length."""

    label: str             # hypothesis.parameter
    probability: float     # of the hypothesis, by the record at hand
    now: float             # relative standard deviation by that record
    time: np.ndarray       # (T,) s, from the length of that record on
    rsd: np.ndarray        # (3, T) of such sensors: 5 %, 50 % and 95 % have less


class Length(NamedTuple):
    """The record length at which a relative standard deviation is expected."""

    label: str
    target: float
    duration: float    # s, for half of such sensors; NaN where none in question does
    interval: tuple    # (2,) s, for 5 % and for 95 %; infinite where none does
    reached: tuple     # (3,) relative standard deviations of the longest record


def for_longer(hypotheses, ratio):
    """Default hypotheses of a record, with priors as `default_hypotheses` gives them to
    a record so many times as long: slower and weaker processes show in it.
    """
    low = dict(sigma_w=1.0 / ratio, sigma_m=ratio**-0.5, sigma_n=ratio**-0.5)
    high = dict(tau_m=ratio, tau_n=ratio)
    return tuple(h._replace(parameters=tuple(
        p._replace(low=p.low * low.get(p.symbol, 1.0),
                   high=p.high * high.get(p.symbol, 1.0)) for p in h.parameters))
        for h in hypotheses)


def outlook(y, dt, hypotheses, duration=None, trials=100, seed=0, progress=None):
    """How well the parameters of the sensor of a record will be known by longer ones.

    Parameters
    ----------
    y : (N,) array
        The record at hand, u.
    dt : float
        Sampling interval, s.
    hypotheses : sequence of Hypothesis
        All are kept: what holds if one of them is right is said for each.
    duration : float, optional
        Longest record in question, s; by default AHEAD times that at hand.
    trials : int
        Sensors drawn from the posterior of each hypothesis.
    seed : int
    progress : function of (done, all), optional

    Returns
    -------
    tuple of Outlook
        One for each unknown parameter of each hypothesis.

    Raises
    ------
    ValueError
        If `duration` is not longer than the record, or there are too few trials.

    Notes
    -----
    The relative standard deviation of a record is that of its posterior, Eqs. (13) and
    (14). Its law over records to come is found by trials: parameters from the
    posterior of the record at hand, Eq. (3), a new record of these parameters, its
    posterior under the prior of the hypothesis.
    """
    duration = AHEAD * dt * len(y) if duration is None else duration
    samples = int(round(duration / dt))
    if not samples > len(y):
        raise ValueError(f"--duration {duration:g} s: the record has {dt * len(y):g} s "
                         "already, a longer one is in question")
    if trials < 20:
        raise ValueError(f"{trials} trials: of fewer than 20 there are no quantiles")
    stops = np.unique(np.round(np.geomspace(len(y), samples, STOPS)).astype(int))
    posterior = identify(y, dt, hypotheses)
    chunks = [(k, first) for k in range(len(posterior.estimates))
              for first in range(0, trials, TOGETHER)]
    found, grids = [[] for _ in posterior.estimates], {}
    for done, (k, first) in enumerate(chunks, 1):
        e = posterior.estimates[k]
        if k not in grids:
            around = _around(e)
            grids = {k: criteria_grid(around, dt, samples, seed)[0]}
        truths = _drawn(e, trials, seed)
        records = np.concatenate([
            simulate([h], dt, samples, 1, seed, number).error for number, h in
            enumerate(truths[first:first + TOGETHER], first)])
        found[k].append(np.stack([_relative(mean, cov) for _, mean, cov in posteriors(
            grids[k], records, stops)], 1))
        if progress:
            progress(done, len(chunks))
    result = []
    for probability, e, parts in zip(posterior.probability, posterior.estimates, found):
        rsd = np.quantile(np.concatenate(parts), BAND, axis=0)
        now = _relative(e.mean[None], e.covariance[None])[0]
        result += [Outlook(f"{e.hypothesis.name}.{p.symbol}", float(probability),
                           float(now[column]), dt * stops, rsd[:, :, column])
                   for column, p in enumerate(e.hypothesis.parameters) if p.free]
    return tuple(result)


def _relative(mean, covariance):
    """Relative standard deviations (L, p)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)) / np.abs(mean)


def _drawn(e, trials, seed):
    """Hypotheses of known parameters, drawn from the point masses of an estimate:
    evenly by their cumulative weight.
    """
    rng = np.random.default_rng(seed)
    at = (np.arange(trials) + rng.random()) / trials
    picked = e.theta[np.searchsorted(np.cumsum(e.weight), at).clip(0, len(e.theta) - 1)]
    return [e.hypothesis._replace(parameters=tuple(
        p._replace(low=v, high=v, log=False) if p.free else p
        for p, v in zip(e.hypothesis.parameters, map(float, theta))))
        for theta in rng.permutation(picked)]


FAR = 3.0    # standard deviations: of the sensors from the mean, and of the posteriors
             # of longer records from the sensor


def _around(e):
    """The hypothesis with its prior cut to where posteriors of longer records are."""
    own = []
    for column, p in enumerate(e.hypothesis.parameters):
        if p.free:
            z = np.log(e.theta[:, column]) if p.log else e.theta[:, column]
            middle = e.weight @ z
            wide = 2.0 * FAR * np.sqrt(e.weight @ (z - middle)**2)
            low, high = middle - wide, middle + wide
            low, high = np.exp([low, high]) if p.log else (low, high)
            p = p._replace(low=max(p.low, float(low)), high=min(p.high, float(high)))
        own.append(p)
    return e.hypothesis._replace(parameters=tuple(own))


def length(one, target):
    """`Length` at which an `Outlook` meets a target."""
    crossing = []
    for curve in one.rsd:
        curve = np.minimum.accumulate(curve)
        met = np.flatnonzero(curve <= target)
        crossing.append(np.inf if not len(met) else one.time[0] if not met[0] else
                        np.exp(np.interp(-np.log(target), -np.log(curve),
                                         np.log(one.time))))
    low, middle, high = map(float, crossing)
    return Length(one.label, target, middle if np.isfinite(middle) else np.nan,
                  (low, high), tuple(map(float, one.rsd[:, -1])))
