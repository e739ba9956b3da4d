"""gnss-ins-sim: the dictionary that its class IMU takes, saved as JSON.

Formula (gnss_ins_sim/pathgen/pathgen.py, gyro_gen and bias_drift; units in
gnss_ins_sim/sim/imu_model.py):

    y = b + c_k + arw / sqrt(dt) w_k
    c_k = (1 - dt / tau) c_{k-1} + drift sqrt(1 - exp(-2 dt / tau)) u_k,   c_0 = 0

with drift the b_stability, tau the b_corr and standard normal w, u. Without b_corr the
drift is one more white noise, drift u_k, whatever the rate. Early versions had
dt drift u_k in place of the last term.
"""

import numpy as np

from sensorlab.foreign.parts import ACCELEROMETER, GYROSCOPE, Part, noise, number

DEG = np.pi / 180.0
# prefix of the keys, name of the white noise, units of it and of a bias
SENSORS = {GYROSCOPE: ("gyro", "arw", DEG / 60.0, DEG / 3600.0),
           ACCELEROMETER: ("accel", "vrw", 1.0 / 60.0, 1.0)}


def parts(raw):
    """Axes of a file by name; {} if it is none of gnss-ins-sim's."""
    return {f"{name}.{axis}": _part(raw, i, unit, *keys)
            for (name, unit), keys in SENSORS.items() if isinstance(raw, dict)
            and f"{keys[0]}_b_stability" in raw for i, axis in enumerate("xyz")}


def _part(raw, i, unit, prefix, white, density_unit, bias_unit):
    own = {key: value[i] if isinstance(value, list) and len(value) == 3 else value
           for key, value in raw.items()}
    density = number(own, f"{prefix}_{white}") * density_unit
    drift = number(own, f"{prefix}_b_stability") * bias_unit
    bias = abs(number(own, f"{prefix}_b", least=-np.inf)) * bias_unit
    tau = number(own, f"{prefix}_b_corr", np.inf)

    def drawn(dt):
        sigma_v = density / np.sqrt(dt)
        if np.isinf(tau):
            return noise(bias=bias, sigma_v=np.hypot(sigma_v, drift))
        if tau <= dt:
            raise ValueError(f"{prefix}_b_corr is {tau:g} s: it must be longer than "
                             f"the sampling interval, {dt:g} s")
        log_a = np.log1p(-dt / tau)
        steady = np.expm1(-2.0 * dt / tau) / np.expm1(2.0 * log_a)    # 1, but for dt^2
        return noise(bias=bias, sigma_v=sigma_v, tau_m=-dt / log_a,
                     sigma_m=drift * np.sqrt(steady), sigma_0=0.0)
    return Part(unit, None, drawn)
