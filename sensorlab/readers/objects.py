"""What Python programs hold: arrays, with masks, DataFrames and Series of pandas,
xarray, dictionaries of arrays. They are known by what they have, not imported.
"""

import pathlib

import numpy as np

from sensorlab.readers.channels import Group, fields


def name_of(source):
    """Name of a file, or what an object is called in its place."""
    if isinstance(source, (str, pathlib.Path)):
        return str(source)
    return type(source).__name__


def groups(source):
    """Groups of an object, or None if it is none of these."""
    kind = type(source).__module__.partition(".")[0]
    if kind == "xarray":
        return [_xarray(source)]
    if kind == "pandas" and hasattr(source, "columns"):
        return [frame(source)]
    if kind == "pandas" and hasattr(source, "to_frame"):
        return [frame(source.to_frame(source.name or "error"))]
    if isinstance(source, dict):
        return [Group(fields({str(name): _plain(x) for name, x in source.items()}))]
    if isinstance(source, (np.ndarray, list, tuple)):
        return [Group(fields(dict(error=_plain(source))))]
    return None


def _plain(x):
    """An array, NaN where it is masked."""
    if np.ma.isMaskedArray(x) and not x.dtype.names:
        return x.astype(float).filled(np.nan)
    return np.asarray(x)


def frame(table):
    """A DataFrame as a group; an index of times is its clock."""
    arrays, refused, clock = {}, {}, ""
    index = table.index
    if index.name is not None or index.dtype.kind in "Mm":
        name = str(index.name or "time")
        clock = name if index.dtype.kind in "Mm" else ""
        arrays[name] = _column(index.to_series())
    for position, name in enumerate(table.columns):
        name = "/".join(map(str, name)) if isinstance(name, tuple) else str(name)
        if name in arrays:
            refused[name] = f"the table has {name} more than once"
        arrays[name] = _column(table.iloc[:, position])
    return Group(arrays, clock=clock, refused=refused)


def _column(x):
    """A column as NumPy has it, whatever pandas keeps it in."""
    if getattr(x.dtype, "tz", None) is not None:
        x = x.dt.tz_convert(None)
    if x.dtype.kind in "iuf" and not isinstance(x.dtype, np.dtype):
        return x.to_numpy(float, na_value=np.nan) if x.hasnans else x.to_numpy(
            x.dtype.numpy_dtype if hasattr(x.dtype, "numpy_dtype") else float)
    return x.to_numpy()


def _xarray(source):
    """A DataArray or a Dataset; a coordinate of times is the clock."""
    parts = (dict(source.data_vars) if hasattr(source, "data_vars") else
             {str(source.name or "error"): source})
    arrays = {str(name): x.values for name, x in (*parts.items(),
                                                  *source.coords.items())}
    clock = next((str(name) for name, x in source.coords.items()
                  if x.values.dtype.kind in "Mm" and x.ndim == 1), "")
    return Group(arrays, clock=clock)
