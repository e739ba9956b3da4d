"""The identified sensor in the format of the program that uses it.

    axis           one axis of a sensor in SI units
    bound          the two numbers that bound it
    text           comments of the files, what all of them say
    pairs          programs of two numbers: Kalibr, OpenVINS, VINS, GTSAM, PX4
    gazebo, matlab, isaac, ros, arrays
                   programs that know more, or less

Every file says its convention in a comment, and what the program cannot have.
"""

from sensorlab.exports.arrays import numpy
from sensorlab.exports.gazebo import gazebo
from sensorlab.exports.isaac import isaac
from sensorlab.exports.matlab import matlab
from sensorlab.exports.pairs import gtsam, kalibr, openvins, px4, vins
from sensorlab.exports.ros import ros

TARGETS = {f.__name__: f for f in (
    kalibr, gazebo, matlab, px4, gtsam, openvins, vins, ros, isaac, numpy)}
