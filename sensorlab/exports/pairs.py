"""Programs that know two numbers of a sensor: noise density and random walk."""

import numpy as np

from sensorlab.exports.text import Choice, export, of_numbers, pair_of

LEAST_WALK = 1e-3    # of the standard deviation at the horizon, where none is needed


def _numbers(axes, choice):
    """(axis, pair); the walk is never 0, which Kalibr and OpenVINS refuse."""
    for axis in axes:
        pair = pair_of(axis, choice)
        least = LEAST_WALK * np.sqrt(3.0) * pair.density / choice.horizon
        yield axis, pair._replace(walk=max(pair.walk, least))


def _lost(axes, choice):
    """What is lost in two numbers of which the walk is never 0."""
    yield from of_numbers(axes, choice)
    for axis, written in _numbers(axes, choice):
        walk = pair_of(axis, choice).walk
        if walk < written.walk:
            yield (f"a walk of {walk:g} of the {axis.kind}: the program needs one "
                   f"above 0, {written.walk:.6e} is written, {LEAST_WALK:g} of the "
                   f"error at {choice.horizon:g} s")


def kalibr(axes, choice=Choice()):
    """imu.yaml of Kalibr."""
    return export(axes, (
        "Convention: continuous, two-sided: noise per sample = noise_density / "
        "sqrt(dt), step of the bias = random_walk * sqrt(dt). "
        "https://github.com/ethz-asl/kalibr/wiki/IMU-Noise-Model"),
        [*_kalibr_lines(axes, choice), "rostopic: /imu0",
         f"update_rate: {1.0 / axes[0].dt:g}"], _lost(axes, choice), choice=choice)


def openvins(axes, choice=Choice()):
    """kalibr_imu_chain.yaml of OpenVINS."""
    body = ["imu0:", *("  " + line for line in _kalibr_lines(axes, choice)),
            f"  update_rate: {1.0 / axes[0].dt:g}", "  rostopic: /imu0", "  T_i_b:",
            *(f"    - [{', '.join('1.0' if i == j else '0.0' for j in range(4))}]"
              for i in range(4))]
    return export(axes, (
        "Convention: as Kalibr's, continuous and two-sided: noise per sample = "
        "noise_density / sqrt(dt), step of the bias = random_walk * sqrt(dt) "
        "(ov_msckf/src/sim/Simulator.cpp, get_next_imu). T_i_b is to be filled in."),
        body, _lost(axes, choice), choice=choice, head="%YAML:1.0")


def _kalibr_lines(axes, choice):
    for axis, pair in _numbers(axes, choice):
        yield f"{axis.kind}_noise_density: {pair.density:.6e}"
        yield f"{axis.kind}_random_walk: {pair.walk:.6e}"


def vins(axes, choice=Choice()):
    """Lines of a configuration of VINS-Mono or VINS-Fusion."""
    body = []
    for axis, pair in _numbers(axes, choice):
        short = "gyr" if axis.kind == "gyroscope" else "acc"
        body += [f"{short}_n: {pair.density * np.sqrt(2.0 / axis.dt):.6e}",
                 f"{short}_w: {pair.walk / np.sqrt(axis.dt):.6e}"]
    return export(axes, (
        f"Convention: per sample, for a rate of {1.0 / axes[0].dt:g} Hz. One step of "
        "dt adds (dt n)^2 / 2 to the variance of the integral and (dt w)^2 to that of "
        "the bias (vins_estimator/src/factor/integration_base.h, midPointIntegration), "
        "so n = density sqrt(2 / dt) and w = walk / sqrt(dt): a density written there "
        f"is too small by {np.sqrt(2.0 / axes[0].dt):.3g} at this rate."), body,
        of_numbers(axes, choice), choice=choice)


def gtsam(axes, choice=Choice()):
    """Parameters of GTSAM's CombinedImuFactor, in Python."""
    body = ["import gtsam", "import numpy as np", "",
            "params = gtsam.PreintegrationCombinedParams.MakeSharedU(9.80665)"]
    for axis, pair in _numbers(axes, choice):
        sensor, bias = (("Gyroscope", "BiasOmega") if axis.kind == "gyroscope" else
                        ("Accelerometer", "BiasAcc"))
        body += [f"params.set{sensor}Covariance({pair.density**2:.6e} * np.eye(3))",
                 f"params.set{bias}Covariance({pair.walk**2:.6e} * np.eye(3))"]
    return export(axes, (
        "Convention: continuous and two-sided, as squares: one step of dt adds "
        "covariance * dt to the variance of the integral and bias covariance * dt to "
        "that of the bias (gtsam/navigation/CombinedImuFactor.cpp, "
        "integrateMeasurement)."), body, of_numbers(axes, choice), choice=choice)


PX4_INTERVAL = 0.01    # s, EKF2_PREDICT_US
PX4_RANGES = dict(EKF2_GYR_NOISE=(1e-4, 0.1), EKF2_ACC_NOISE=(0.01, 1.0),
                  EKF2_GYR_B_NOISE=(0.0, 0.01), EKF2_ACC_B_NOISE=(0.0, 0.01))


def px4(axes, choice=Choice()):
    """Parameter file of PX4's EKF2."""
    values = {}
    for axis, pair in _numbers(axes, choice):
        short = "GYR" if axis.kind == "gyroscope" else "ACC"
        for name, value in ("NOISE", pair.density), ("B_NOISE", pair.walk):
            values[f"EKF2_{short}_{name}"] = round(    # as it is written
                value / PX4_INTERVAL**0.5, 9)
    outside = [f"{name} {value:.3g} is outside of what PX4 takes, "
               f"{PX4_RANGES[name][0]:g} to {PX4_RANGES[name][1]:g}"
               for name, value in values.items()
               if not PX4_RANGES[name][0] <= value <= PX4_RANGES[name][1]]
    return export(axes, (
        "Convention: per prediction of the filter, every EKF2_PREDICT_US = 10 ms "
        "whatever the rate of the sensor. One step of dt adds (dt NOISE)^2 to the "
        "variance of the integral and (dt B_NOISE)^2 to that of the bias "
        "(src/modules/ekf2/EKF/covariance.cpp, predictCovariance), so both are density "
        "and walk over sqrt(10 ms): ten times an Allan deviation."),
        [f"1\t1\t{name}\t{value:.9f}\t9" for name, value in values.items()],
        [*of_numbers(axes, choice), *outside], choice=choice)
