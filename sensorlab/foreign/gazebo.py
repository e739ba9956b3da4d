"""Noise blocks of SDF, as Gazebo draws them.

Formula (gz-sensors src/GaussianNoiseModel.cc, ApplyImpl(_in, _dt); the same in
Gazebo classic, sensors/GaussianNoiseModel.cc):

    bias = +- N(bias_mean, bias_stddev^2)                     once, either sign alike
    phi = exp(-dt / tau),  sd = sqrt(-s^2 tau / 2 expm1(-2 dt / tau))
    bias = phi bias + N(0, sd^2)                              before every sample
    y = bias + N(mean, stddev^2), rounded to a multiple of precision

with s dynamic_bias_stddev and tau dynamic_bias_correlation_time. So stddev is per
sample, whatever the rate; s is no standard deviation but a density, u/s/sqrt(Hz): the
bias wanders by s sqrt(tau / 2); and the bias of the start fades with tau. Where s or
tau is 0 it stays. The first versions of gz-sensors do not know s and tau.
"""

import numpy as np

from sensorlab.foreign.parts import ACCELEROMETER, GYROSCOPE, Part, noise, number

PLACES = {"angular_velocity": GYROSCOPE, "linear_acceleration": ACCELEROMETER}


def parts(raw):
    """Axes of an XML tree by name; {} if it has no noise of an IMU."""
    if not hasattr(raw, "iter"):
        return {}
    found = {}
    for sensor in raw.iter("sensor"):
        said = sensor.find("update_rate")
        rate = 0.0 if said is None else _number(said)
        for place, (name, unit) in PLACES.items():
            for axis in "xyz":
                block = sensor.find(f"imu/{place}/{axis}/noise")
                if block is not None and block.get("type") != "none":
                    key = f"{sensor.get('name', 'imu')}/{name}.{axis}"
                    found[key] = _part(block, unit, rate)
    return found


def _part(block, unit, rate):
    values = {child.tag: _number(child) for child in block}

    def value(key):
        return number(values, key, 0.0, least=-np.inf if "mean" in key else 0.0)
    start = np.hypot(value("bias_mean"), value("bias_stddev"))
    s, tau = value("dynamic_bias_stddev"), value("dynamic_bias_correlation_time")
    rest = dict(sigma_v=value("stddev"), lsb=value("precision")
                if block.get("type") == "gaussian_quantized" else 0.0)

    def drawn(dt):
        if s and tau:
            return noise(bias=abs(value("mean")), tau_m=tau,
                         sigma_m=s * np.sqrt(tau / 2.0), sigma_0=start, **rest)
        return noise(bias=np.hypot(value("mean"), start), **rest)
    return Part(unit, 1.0 / rate if rate > 0.0 else None, drawn)


def _number(element):
    try:
        return float(element.text)
    except (TypeError, ValueError):
        raise ValueError(f"<{element.tag}> holds {element.text!r}: a number is needed"
                         ) from None
