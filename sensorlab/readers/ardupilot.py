"""DataFlash logs of ArduPilot (.bin), by pymavlink.

Every message has its `TimeUS` in microseconds since the start, a raw sample of ACC and
GYR its `SampleUS` as well; where a sensor is there several times the messages carry its
number, here IMU, IMU#1 and so on.
Messages: https://ardupilot.org/copter/docs/logmessages.html
"""

from pymavlink.DFReader import DFReader_binary

from sensorlab.readers.messages import collect, collected

CLOCKS = "SampleUS", "TimeUS"


def read(file):
    kinds = {}    # name of the message -> columns
    with DFReader_binary(str(file)) as log:
        while (message := log.recv_msg()) is not None:
            number = getattr(message, message.fmt.instance_field or "", 0) or 0
            name = message.get_type() + f"#{number}" * (number != 0)
            collect(kinds.setdefault(name, {}), (
                (key, value) for key, value in message.to_dict().items()
                if isinstance(value, (int, float))))
    return [collected(columns, name, clock) for name, columns in kinds.items()
            for clock in [c for c in CLOCKS if c in columns][:1]]
