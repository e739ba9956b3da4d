"""ROS 1 bags, ROS 2 bags (a folder, .db3) and MCAP files, by rosbags."""

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from sensorlab.readers.messages import collect, collected

MAX_MESSAGE, MAX_VECTOR = 4096, 8    # bytes, numbers: longer ones are pictures, clouds,
                                     # maps and covariances
STAMP, RECEIVED = "header/stamp [ns]", "received/stamp [ns]"


def read(file):
    """Groups of all topics; the clock is the header's stamp, where it is set."""
    topics = {}    # topic -> columns
    with AnyReader([file], default_typestore=get_typestore(Stores.LATEST)) as bag:
        for connection, received, raw in bag.messages():
            if len(raw) <= MAX_MESSAGE:
                message = bag.deserialize(raw, connection.msgtype)
                collect(topics.setdefault(connection.topic, {}),
                        [(RECEIVED, received), *_numbers(message)])
    return [collected(columns, topic, STAMP if STAMP in columns and all(columns[STAMP])
                      else RECEIVED) for topic, columns in topics.items()]


def _numbers(message, above=""):
    """Numbers of a message by their path; a stamp in ns."""
    for name, value in vars(message).items():
        path = above + name
        if name == "stamp" and hasattr(value, "nanosec"):
            yield f"{path} [ns]", value.sec * 10**9 + value.nanosec
        elif isinstance(value, np.ndarray):
            if value.ndim == 1 and len(value) <= MAX_VECTOR:
                yield from ((f"{path}[{k}]", v) for k, v in enumerate(value.tolist()))
        elif isinstance(value, (int, float)):
            yield path, value
        elif hasattr(value, "__msgtype__"):
            yield from _numbers(value, f"{path}/")
