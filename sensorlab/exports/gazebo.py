"""Noise blocks of SDF, for Gazebo."""

import numpy as np

from sensorlab.exports.text import Choice, export, jumps, pair_of, readings, start

PLACES = dict(gyroscope="angular_velocity", accelerometer="linear_acceleration")
FOR_EVER = 1e9    # s, correlation time of a bias that is a walk


def gazebo(axes, choice=Choice()):
    """A sensor of SDF with one noise block for each axis."""
    body, lost, several = ['<sensor name="imu" type="imu">',
                           f"  <update_rate>{1.0 / axes[0].dt:g}</update_rate>",
                           "  <imu>"], [], False
    for axis in axes:
        place = PLACES[axis.kind]
        values, why = _values(axis, choice)
        several |= len(axis.parts[1]) > 1
        lost += why
        block = "".join(f"<{key}>{value:.9g}</{key}>" for key, value in values.items())
        kind = "gaussian_quantized" if axis.lsb else "gaussian"
        body += [f"    <{place}>",
                 *(f'      <{i}><noise type="{kind}">{block}</noise></{i}>'
                   for i in "xyz"), f"    </{place}>"]
    return export(axes, (
        "Convention: stddev is per sample. dynamic_bias_stddev s is a density, "
        "u/s/sqrt(Hz): the bias is a Markov process of standard deviation "
        "s sqrt(tau / 2) and tau dynamic_bias_correlation_time; bias_stddev is that of "
        "its first value, which fades with tau (GaussianNoiseModel.cc, ApplyImpl, of "
        "gz-sensors and of Gazebo classic; their first versions have no dynamic bias)."
        ),
        [*body, "  </imu>", "</sensor>"], lost, begin="<!-- ", end=" -->",
        choice=choice if several else None)


def _values(axis, choice):
    """Elements of a noise block, and what they do not say."""
    unrounded = axis._replace(lsb=0.0)    # Gazebo rounds by itself
    white, processes = unrounded.parts
    lost = [*jumps(axis), *readings(unrounded)]
    begin, s, tau = start(axis, choice), 0.0, 0.0
    if len(processes) > 1:
        pair = pair_of(axis, choice)
        white, s, tau = pair.density / np.sqrt(axis.dt), pair.walk, FOR_EVER
        lost.append(f"{len(processes)} processes of the {axis.kind}: Gazebo has one, "
                    "so white noise and a walk bound the error")
    elif processes:
        a, drive, of_process = processes[0]
        tau = -axis.dt / np.log(a) if a < 1.0 else FOR_EVER
        s = drive / np.sqrt(-0.5 * tau * np.expm1(-2.0 * axis.dt / tau))
        begin = np.hypot(of_process, axis.bias)
        if a < 1.0 and axis.bias:
            lost.append(f"a constant bias of the {axis.kind}, of standard deviation "
                        f"{axis.bias:.4g} {axis.unit}: Gazebo's fades with the "
                        "correlation time")
            begin = of_process
    values = dict(mean=0.0, stddev=white, bias_mean=0.0, bias_stddev=begin)
    if s:
        values |= dict(dynamic_bias_stddev=s, dynamic_bias_correlation_time=tau)
    return values | (dict(precision=axis.lsb) if axis.lsb else {}), lost
