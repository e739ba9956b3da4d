"""Logs of PX4 (.ulg), by pyulog.

Every message has its `timestamp` in microseconds since the start; of a sensor that is
there several times the second is NAME#1.
Format: https://docs.px4.io/main/en/dev_log/ulog_file_format
"""

from pyulog import ULog

from sensorlab.readers.channels import Group

CLOCK = "timestamp [us]"


def read(file):
    groups = []
    for part in ULog(str(file)).data_list:
        name = part.name + f"#{part.multi_id}" * (part.multi_id > 0)
        arrays = {CLOCK if key == "timestamp" else key: x
                  for key, x in part.data.items()}
        groups.append(Group(arrays, name, CLOCK))
    return groups
