"""A sensor axis in another program's file, and what our models are called for it."""

from typing import Callable, NamedTuple

import numpy as np

from sensorid import as_number, markov

GYROSCOPE, ACCELEROMETER = ("gyroscope", "rad/s"), ("accelerometer", "m/s^2")


class Part(NamedTuple):
    """One axis of a sensor in a file."""

    unit: str
    dt: float          # s; None where the file does not say
    noise: Callable    # of dt: the hypotheses of a model file, and their bias_sigma


def markov_from_start(dt, tau_m, sigma_m, sigma_0=0.0, sigma_v=0.0):
    """First-order Markov process, Eq. (22), that starts from N(0, sigma_0^2) and not in
    its steady state.
    """
    return markov(dt, tau_m, sigma_m, sigma_v)._replace(P0=np.array([[sigma_0**2]]))


FOREIGN = dict(markov_from_start=markov_from_start)    # models beside MODELS


def noise(bias=0.0, lsb=0.0, limit=np.inf, **parameters):
    """Hypotheses of a model file from the parameters that are not 0.

    sigma_v, sigma_w per sample; tau_m, sigma_m; sigma_0 where the process does not
    start in its steady state. `limit` is that of the values to either side.
    """
    parameters = {symbol: float(value) for symbol, value in parameters.items()}
    if not parameters.get("sigma_w"):
        parameters.pop("sigma_w", None)
    if not parameters.get("sigma_m"):
        for symbol in ("tau_m", "sigma_m", "sigma_0"):
            parameters.pop(symbol, None)
    name = ("markov_from_start" if "sigma_0" in parameters else
            "_".join(word for word, symbol in (("random_walk", "sigma_w"),
                                               ("markov", "sigma_m"))
                     if symbol in parameters) or "white_noise")
    effects = []
    if np.isfinite(limit):
        effects.append(dict(name="saturation",
                            parameters=dict(limits=[-limit, limit])))
    if lsb:
        effects.append(dict(name="quantization", parameters=dict(lsb=lsb)))
    return dict(bias_sigma=float(bias), hypotheses=[
        dict(name=name, parameters=parameters, effects=effects)])


def number(values, key, default=None, least=0.0):
    """A number of a file by its key.

    Raises
    ------
    ValueError
        If it is not there (and has no default), no number, or below the least.
    """
    if key not in values and default is None:
        raise ValueError(f"{key} is missing")
    found = values.get(key, default)
    try:
        found = float(found) if isinstance(found, str) else found    # 2e-5 in YAML
    except ValueError:
        pass
    found = as_number(found, key)
    if not found >= least:
        raise ValueError(f"{key} is {found:g}: it must be >= {least:g}")
    return found


def interval(dt):
    """A sampling interval, s, that can be one.

    Raises
    ------
    ValueError
        If it is not known, or not positive.
    """
    if dt is None:
        raise ValueError("the file says no sampling rate: give --dt")
    if not 0.0 < dt < np.inf:
        raise ValueError(f"the sampling interval is {dt:g} s: it must be > 0")
    return dt


def walk(raw, path=""):
    """Every dictionary within a JSON or YAML value, with its path."""
    left, seen = [(path, raw)], set()    # an alias of YAML may hold itself
    while left:
        path, raw = left.pop(0)
        if not isinstance(raw, (dict, list)) or id(raw) in seen:
            continue
        seen.add(id(raw))
        if isinstance(raw, dict):
            yield path, raw
        left += [(f"{path}/{key}" if path else str(key), value) for key, value in
                 (raw.items() if isinstance(raw, dict) else enumerate(raw))]
