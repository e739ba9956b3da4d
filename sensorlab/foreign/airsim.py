"""settings.json of AirSim: every sensor of SensorType 2, an IMU.

Formula (AirLib/include/sensors/imu/ImuSimple.hpp, addNoise; units and defaults in
ImuSimpleParams.hpp, initializeFromSettings):

    y = b_k + arw / sqrt(dt) w_k,   b_{k+1} = b_k + stability / sqrt(tau) sqrt(dt) u_k

with dt at least 1 ms, b_0 = 0 and standard normal w, u. So the bias is a random walk
for ever, of K = stability / sqrt(tau): tau is no correlation time. VelocityRandomWalk
is said in mg and meant in mg/sqrt(Hz). Ours has its first step one sample earlier.
"""

import numpy as np

from sensorlab.foreign.parts import ACCELEROMETER, GYROSCOPE, Part, noise, number, walk

IMU = 2    # SensorType
DEG, G = np.pi / 180.0, 9.80665
# keys, defaults and units of white noise, bias stability and its time
SENSORS = {
    GYROSCOPE: (("AngularRandomWalk", 0.3, DEG / 60.0),
                ("GyroBiasStability", 4.6, DEG / 3600.0),
                ("GyroBiasStabilityTau", 500.0)),
    ACCELEROMETER: (("VelocityRandomWalk", 0.24, 1e-3 * G),
                    ("AccelBiasStability", 36.0, 1e-6 * G),
                    ("AccelBiasStabilityTau", 800.0))}


def parts(raw):
    """Axes of a file by name; {} if it is none of AirSim's."""
    return {f"{path}/{name}": _part(values, unit, *keys) for path, values in walk(raw)
            if values.get("SensorType") == IMU
            for (name, unit), keys in SENSORS.items()}


def _part(values, unit, white, stability, time):
    density = number(values, *white[:2]) * white[2]
    tau = number(values, *time, least=1e-9)
    drift = number(values, *stability[:2]) * stability[2] / np.sqrt(tau)
    return Part(unit, None, lambda dt: noise(
        sigma_v=density / np.sqrt(max(dt, 1e-3)),
        sigma_w=drift * np.sqrt(max(dt, 1e-3))))
