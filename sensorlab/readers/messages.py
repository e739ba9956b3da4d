"""Messages of a log, gathered into columns of numbers."""

from array import array

import numpy as np

from sensorlab.readers.channels import Group


def collect(columns, row):
    """Append the (name, number) pairs of a message to columns, name -> array."""
    for name, value in row:
        column = columns.setdefault(name, array("q" if isinstance(value, int) else "d"))
        try:
            column.append(value)
        except (TypeError, OverflowError):    # whole numbers no more
            columns[name] = array("d", [*column, value])


def collected(columns, name, clock):
    """Group of the columns that all messages had."""
    samples = len(columns[clock])
    return Group({key: np.asarray(x) for key, x in columns.items()
                  if len(x) == samples}, name, clock)
