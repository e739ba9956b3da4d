"""Covariances of sensor_msgs/Imu."""

import numpy as np

from sensorlab.exports.bound import averaging_times
from sensorlab.exports.text import Choice, export, of_numbers

FIELDS = dict(gyroscope="angular_velocity_covariance",
              accelerometer="linear_acceleration_covariance")


def ros(axes, choice=Choice()):
    """Covariances of a message, as YAML."""
    body = []
    for axis in axes:
        m = averaging_times(axis, choice.horizon)
        variance = float(np.max(m * axis.allan_variance(m)))
        body.append(f"{FIELDS[axis.kind]}: [" + ", ".join(
            f"{variance * (i == j):.6e}" for i in range(3) for j in range(3))
            + f"]    # white alone: {axis.parts[0]**2:.6e}")
    return export(axes, (
        "Convention: variance per sample, row-major (sensor_msgs/msg/Imu); who reads "
        "it takes the samples for independent. So it is that of the white noise whose "
        f"integral, up to {choice.horizon:g} s with the bias from as long a time at "
        "rest before, is nowhere less uncertain than the sensor's."), body,
        of_numbers(axes, choice, "a white noise"))
