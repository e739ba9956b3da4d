"""Parquet files, by pandas."""

import pandas

from sensorlab.readers.objects import frame


def read(file):
    return [frame(pandas.read_parquet(file))]
