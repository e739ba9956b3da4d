"""ROS 1 bags, ROS 2 bags (a folder, .db3) and MCAP files, by rosbags."""

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from sensorlab.readers.channels import Group

MAX_MESSAGE = 4096    # bytes: longer ones are pictures, clouds and maps
STAMP = "header/stamp [ns]"


def read(file):
    rows = {}    # topic -> list of dicts
    with AnyReader([file], default_typestore=get_typestore(Stores.LATEST)) as bag:
        for connection, received, raw in bag.messages():
            if len(raw) <= MAX_MESSAGE:
                row = dict(_numbers(bag.deserialize(raw, connection.msgtype)))
                row["received [ns]"] = received
                rows.setdefault(connection.topic, []).append(row)
    return [_group(topic, table) for topic, table in rows.items()]


def _numbers(message, above=""):
    """Numbers of a message by their path; a stamp in ns."""
    for name, value in vars(message).items():
        path = above + name
        if name == "stamp" and hasattr(value, "nanosec"):
            yield f"{path} [ns]", value.sec * 10**9 + value.nanosec
        elif isinstance(value, np.ndarray) and value.ndim == 1:
            yield from ((f"{path}[{k}]", v) for k, v in enumerate(value.tolist()))
        elif isinstance(value, (int, float)):
            yield path, value
        elif hasattr(value, "__msgtype__"):
            yield from _numbers(value, f"{path}/")


def _group(topic, rows):
    """The messages of a topic; its clock is the header's stamp, where it is set."""
    names = [name for name in rows[0] if all(name in row for row in rows)]
    arrays = {name: np.array([row[name] for row in rows]) for name in names}
    stamped = STAMP in arrays and arrays[STAMP].all()
    return Group(arrays, topic, STAMP if stamped else "received [ns]")
