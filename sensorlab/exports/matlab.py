"""gyroparams and accelparams of MATLAB's imuSensor."""

import numpy as np

from sensorlab.exports.text import Choice, export, jumps, pair_of, start

SENSORS = dict(gyroscope=("gyroparams", "Gyroscope"),
               accelerometer=("accelparams", "Accelerometer"))


def matlab(axes, choice=Choice()):
    """A script that makes an imuSensor."""
    body, lost, several = [], [], False
    for axis in axes:
        values, why = _values(axis, choice)
        lost += why
        several |= len(_markov(axis)) > 1
        body += [f"{axis.kind} = {SENSORS[axis.kind][0]}( ...",
                 ", ...\n".join(f"    '{key}', {text}" for key, text in values.items())
                 + ");"]
    sensors = ", ".join(f"'{SENSORS[a.kind][1]}', {a.kind}" for a in axes)
    body.append(f"imu = imuSensor('accel-gyro', 'SampleRate', {1.0 / axes[0].dt:g}, "
                f"{sensors});")
    return export(axes, (
        "Convention: NoiseType single-sided, with which noise per sample = "
        "NoiseDensity sqrt(rate) and step of the walk = RandomWalk / sqrt(rate): N and "
        "K of IEEE Std 952. With the default, double-sided, the same numbers give "
        "noise 1 / sqrt(2) and a walk sqrt(2) times as strong. A Markov process is the "
        "bias instability with its filter, from 0 (R2023b or later). imuSensor, "
        "section Algorithms."),
        body, lost, begin="% ", choice=choice if several else None)


def _markov(axis):
    return [p for p in axis.parts[1] if p.a < 1.0]


def _values(axis, choice):
    """Properties by name as MATLAB writes them, and what they do not say."""
    white, processes = axis._replace(lsb=0.0).parts    # MATLAB rounds by itself
    lost, markov = list(jumps(axis)), _markov(axis)
    walk = np.sqrt(sum(p.drive**2 for p in processes if p.a == 1.0) / axis.dt)
    density = white * np.sqrt(axis.dt)
    if len(markov) > 1:
        density, walk = pair_of(axis, choice)
        lost.append(f"{len(markov)} Markov processes of the {axis.kind}: MATLAB has "
                    "one, so white noise and a walk bound the error")
    values = dict(NoiseType="'single-sided'", NoiseDensity=f"{density:.9g}",
                  RandomWalk=f"{walk:.9g}")
    if len(markov) == 1:
        values |= dict(
            BiasInstability=f"{markov[0].drive:.9g}",
            BiasInstabilityCoefficients="struct('Numerator', 1, 'Denominator', "
                                        f"[1 {-markov[0].a:.12g}])")
    if start(axis, choice):
        lost.append(f"the value of the {axis.kind} at the start, of standard deviation "
                    f"{start(axis, choice):.4g} {axis.unit}: set ConstantBias to a "
                    "draw of it")
    if axis.lsb:
        values["Resolution"] = f"{axis.lsb:.9g}"
    if np.isfinite(axis.limits).any():
        if axis.limits[1] == -axis.limits[0]:
            values["MeasurementRange"] = f"{axis.limits[1]:.9g}"
        else:
            lost.append(f"limits {axis.limits[0]:.4g}, {axis.limits[1]:.4g} "
                        f"{axis.unit} of the {axis.kind}: MATLAB's are the same on "
                        "both sides")
    return values, lost
