"""Noise of Isaac Lab's observations, as env.yaml holds it.

Formula (source/isaaclab/isaaclab/utils/noise/noise_model.py: gaussian_noise,
uniform_noise, NoiseModelWithAdditiveBias), the operation being "add":

    y = mean + std w_k, or n_min + (n_max - n_min) u_k with u even on 0..1
    plus a bias drawn once a reset in the same way

So the noise is per observation, whatever the rate, and nothing drifts in an episode. A
bias of the operation "add", the default, is added to that of the episode before: it
walks from reset to reset; "abs" draws it afresh.
"""

import numpy as np

from sensorlab.foreign.parts import Part, noise, number, walk

UNITS = dict(ang_vel="rad/s", lin_acc="m/s^2")    # by the name of an observation


def parts(raw):
    """Observations with noise by name; {} if there are none."""
    if not isinstance(raw, dict):
        return {}
    sim = raw.get("sim") if isinstance(raw.get("sim"), dict) else {}
    dt = (number(sim, "dt") * number(raw, "decimation", 1.0)
          if "dt" in sim else None)
    return {path: _part(path, values["noise"], dt) for path, values in walk(raw)
            if isinstance(values.get("noise"), dict)}


def _part(path, values, dt):
    sigma_v, mean = _moments(values.get("noise_cfg") or values)
    bias = np.hypot(mean, np.hypot(*_moments(values.get("bias_noise_cfg") or {})))
    unit = next((u for word, u in UNITS.items() if word in path), "u")
    return Part(unit, dt, lambda dt: noise(bias=bias, sigma_v=sigma_v))


def _moments(values):
    """Standard deviation and mean of a noise."""
    if not isinstance(values, dict):
        raise ValueError(f"a noise of Isaac Lab is {values!r}: its keys are needed")
    if values.get("operation", "add") == "scale":
        raise ValueError("a noise of the operation \"scale\" multiplies the signal: "
                         "it is no error at rest")
    if "n_max" in values:
        low, high = (number(values, key, least=-np.inf) for key in ("n_min", "n_max"))
        return (high - low) / np.sqrt(12.0), 0.5 * (low + high)
    if "bias" in values:
        return 0.0, number(values, "bias", least=-np.inf)
    return number(values, "std", 0.0), number(values, "mean", 0.0, -np.inf)
