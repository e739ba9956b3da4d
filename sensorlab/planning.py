"""The same sensor under other conditions: how long must it be recorded there?"""

import inspect

import numpy as np

from sensorid import Parameter


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
