"""Kalibr's imu.yaml; the files of EuRoC and OpenVINS have the same keys.

Formula (https://github.com/ethz-asl/kalibr/wiki/IMU-Noise-Model; the white noise also
in kalibr_common/ConfigReader.py, ImuParameters.getGyroStatistics):

    y = b_k + noise_density / sqrt(dt) * w_k
    b_k = b_{k-1} + random_walk * sqrt(dt) * u_k

with standard normal w, u. So a noise density is the N of IEEE Std 952 (two-sided), a
random walk its K. The bias of the start is not given.
"""

import numpy as np

from sensorlab.foreign.parts import ACCELEROMETER, GYROSCOPE, Part, noise, number, walk


def parts(raw):
    """Axes of a file by name; {} if it is none of Kalibr's."""
    found = {}
    for path, values in walk(raw):
        for name, unit in (GYROSCOPE, ACCELEROMETER):
            if f"{name}_noise_density" in values:
                found[f"{path}/{name}" if path else name] = _part(values, name, unit)
    return found


def _part(values, name, unit):
    density = number(values, f"{name}_noise_density")
    drift = number(values, f"{name}_random_walk", 0.0)
    rate = next((number(values, key) for key in ("update_rate", "rate_hz")
                 if key in values), 0.0)
    return Part(unit, 1.0 / rate if rate else None, lambda dt: noise(
        sigma_v=density / np.sqrt(dt), sigma_w=drift * np.sqrt(dt)))
