"""DataFlash logs of ArduPilot (.bin), by pymavlink.

Every message has its `TimeUS` in microseconds since the start; where a sensor is there
several times the messages carry its number, here IMU, IMU#1 and so on.
Messages: https://ardupilot.org/copter/docs/logmessages.html
"""

import numpy as np
from pymavlink.DFReader import DFReader_binary

from sensorlab.readers.channels import Group

CLOCK = "TimeUS"


def read(file):
    rows = {}    # name -> list of values; fields are those of the first
    with DFReader_binary(str(file)) as log:
        while (message := log.recv_msg()) is not None:
            number = getattr(message, message.fmt.instance_field or "", 0) or 0
            name = message.get_type() + f"#{number}" * (number != 0)
            rows.setdefault(name, []).append(message.to_dict())
    return [_group(name, table) for name, table in rows.items() if CLOCK in table[0]]


def _group(name, rows):
    arrays = {}
    for key, first in rows[0].items():
        if isinstance(first, (int, float)):
            arrays[key] = np.array([row[key] for row in rows])
    return Group(arrays, name, CLOCK)
