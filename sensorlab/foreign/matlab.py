"""imuSensor of MATLAB, in the JSON that its function loadparams reads.

Formula (imuSensor, section Algorithms,
https://www.mathworks.com/help/nav/ref/imusensor-system-object.html; in the class
fusion.internal.IMUSensorSimulator setupBandwidth and setStdDev*):

    bandwidth = rate / 2 where NoiseType is "double-sided", the default; else rate
    white noise        NoiseDensity sqrt(bandwidth) w_k
    random walk        b_k = b_{k-1} + RandomWalk / sqrt(bandwidth) u_k
    bias instability   c_k = a c_{k-1} + BiasInstability v_k, a = 0.5 by default
    y = ConstantBias + their sum, cut at +-MeasurementRange, rounded to Resolution

from 0, with standard normal w, u, v. So with the default "double-sided" NoiseDensity is
sqrt(2) N and RandomWalk K / sqrt(2) of IEEE Std 952; with "single-sided" they are N and
K. The default bias instability is no flicker noise: it is forgotten in two samples.
"""

import numpy as np

from sensorlab.foreign.parts import ACCELEROMETER, GYROSCOPE, Part, noise, number

KEYS = "NoiseDensity", "BiasInstability", "RandomWalk"
SENSORS = {"Gyroscope": GYROSCOPE, "Accelerometer": ACCELEROMETER}


def parts(raw):
    """Axes of a file by name; {} if it is none of MATLAB's."""
    found = {}
    for product, sensors in raw.items() if isinstance(raw, dict) else ():
        for key, (name, unit) in SENSORS.items():
            values = sensors.get(key) if isinstance(sensors, dict) else None
            if isinstance(values, dict) and any(k in values for k in KEYS):
                for i, axis in enumerate("xyz"):
                    found[f"{product}/{name}.{axis}"] = _part(values, i, unit)
    return found


def _part(values, i, unit):
    own = {key: value[i] if isinstance(value, list) and len(value) == 3 else value
           for key, value in values.items()}
    sided = own.get("NoiseType", "double-sided")
    if sided not in ("double-sided", "single-sided"):
        raise ValueError(f"NoiseType is {sided!r}: double-sided or single-sided")
    a, gain = _filter(own.get("BiasInstabilityCoefficients"))

    def drawn(dt):
        bandwidth = 1.0 / dt if sided == "single-sided" else 0.5 / dt
        return noise(
            bias=abs(number(own, "ConstantBias", 0.0, -np.inf)),
            lsb=number(own, "Resolution", 0.0),
            limit=number(own, "MeasurementRange", np.inf),
            sigma_v=number(own, "NoiseDensity", 0.0) * np.sqrt(bandwidth),
            sigma_w=number(own, "RandomWalk", 0.0) / np.sqrt(bandwidth),
            tau_m=-dt / np.log(a),
            sigma_m=number(own, "BiasInstability", 0.0) * gain / np.sqrt(1.0 - a * a))
    return Part(unit, None, drawn)


def _filter(coefficients):
    """Factor and gain of the first-order filter of the bias instability."""
    if coefficients is None:
        return 0.5, 1.0
    try:
        (one, a), gain = coefficients["Denominator"], np.ravel(
            coefficients["Numerator"]).astype(float)
        if float(one) == 1.0 and -1.0 < float(a) < 0.0 and gain.size == 1:
            return -float(a), float(gain[0])
    except (KeyError, TypeError, ValueError):
        pass
    raise ValueError("BiasInstabilityCoefficients must be of first order here: "
                     "Numerator a number, Denominator [1, -a] with 0 < a < 1")
