"""Recordings of any source behind one door: `read`.

    clocks       time stamps -> an even sampling interval
    channels     one row of numbers among the arrays of a source
    messages     the messages of a log as arrays
    arrays       .npy, .npz
    text         CSV and its dialects
    objects      arrays, DataFrames, Series, xarray
    matlab, parquet, rosbag, px4, ardupilot
                 read in a process of their own, see `apart`

A reader is a function `read(file)` that returns a list of `channels.Group`.
"""

import pathlib
from typing import NamedTuple

import numpy as np

from sensorlab.printable import printable
from sensorlab.readers import apart, arrays, channels, clocks, objects, text

APART = {".mat": "matlab", ".h5": "matlab", ".hdf5": "matlab", ".parquet": "parquet",
         ".pq": "parquet", ".bag": "rosbag", ".db3": "rosbag", ".mcap": "rosbag",
         ".ulg": "px4", ".bin": "ardupilot"}


class Recording(NamedTuple):
    """A channel of a source, evenly sampled; missing samples are NaN."""

    file: str
    column: str
    error: np.ndarray    # (N,) u
    dt: float            # s
    columns: dict = {}   # what was recorded beside it, if asked for
    unit: str = ""       # u, where the source says it
    clock: str = ""      # where dt comes from, in words

    @property
    def heading(self):
        """What was read, in one line."""
        return (f"{self.file}, column {self.column}: {len(self.error)} samples, "
                + (self.clock or f"dt {self.dt:g} s"))


def read(source, channel="error", dt=None, resample=False, allow_missing=False,
         beside=()):
    """`Recording` of one channel of a file or of an object.

    Parameters
    ----------
    source : path, or array, DataFrame, Series, DataArray, Dataset, dict of arrays
        Text with or without a header, packed or not; .npz, .npy, .mat, .parquet; ROS
        bags, .mcap; .ulg of PX4; .bin of ArduPilot.
    channel : str
        Name of a column or an array, with the path to it where there is one, such as
        imu/angular_velocity/x; axis k of an array as name[k], whichever of its sides
        is that of the samples.
    dt : float, optional
        Sampling interval, s. By default it comes from the time stamps or from a scalar
        `dt`; if given, the samples count as evenly spaced and no stamp is read.
    resample : bool
        Interpolate an unevenly sampled record linearly onto even times.
    allow_missing : bool
        Take NaN, masked and empty values as missing samples.
    beside : sequence of str, or None
        Further columns wanted, as NAME or as NAME=COLUMN to give one another name; None
        for all that hold numbers. Where samples are missing they are interpolated.

    Returns
    -------
    Recording
        A gap of whole sampling intervals between stamps becomes missing samples.

    Raises
    ------
    ValueError, OSError
        With one sentence on what is wrong with the source.
    """
    origin, groups = _opened(source)
    try:
        return _recording(origin, _channel(groups, channel), dt, resample,
                          allow_missing, beside)
    except ValueError as problem:
        raise ValueError(f"{origin}: {problem}") from None


def read_rows(source, dt=None):
    """Recordings of all rows of the array `error`, or of the one column of that name.
    """
    origin, groups = _opened(source)
    try:
        rows = [c for group in groups for c in channels.channels(group)
                if c.array == "error"] or [_channel(groups, "error")]
        return [_recording(origin, c, dt, False, True, ()) for c in rows]
    except ValueError as problem:
        raise ValueError(f"{origin}: {problem}") from None


def _channel(groups, wanted):
    every = [c for group in groups for c in channels.channels(group)]
    alone = len(every) == 1 and wanted == "error"
    return channels.find(groups, every[0].name if alone else wanted)


def _opened(source):
    """Name and groups of a source."""
    if not isinstance(source, (str, pathlib.Path)):
        groups = objects.groups(source)
        if groups is None:
            raise ValueError(f"a {type(source).__name__} is no source of records: give "
                             "a file, an array or a table")
        return type(source).__name__, groups
    file = pathlib.Path(source)
    folder_of_ros = (file / "metadata.yaml").is_file()
    if not (file.is_file() or folder_of_ros):
        raise ValueError(f"{file}: no such file" + ", but a folder" * file.is_dir())
    kind = file.suffix.lower()
    try:
        if folder_of_ros or kind in APART:
            return str(file), apart.read_apart(
                "rosbag" if folder_of_ros else APART[kind], file)
        return str(file), (arrays if kind in (".npy", ".npz") else text).read(file)
    except Exception as problem:    # each library raises its own
        raise ValueError(f"{file}: cannot be read as {kind or 'text'}: {problem}"
                         ) from None


def _recording(origin, channel, dt, resample, allow_missing, beside):
    from sensorid import check_record    # not for the readers in their own processes
    error = channel.values.astype(float)
    columns = {name: x for name, x in channels.beside(channel, beside).items()
               if beside is not None or not np.isnan(x).all()}
    for name, x in {channel.name: error, **columns}.items():
        holes = int(np.isnan(x).sum())
        if holes and not allow_missing:
            raise ValueError(f"{name} holds {holes} NaN or empty values, the first at "
                             f"sample {np.argmax(np.isnan(x))}; --allow-missing takes "
                             "them as missing")
    if dt is None:
        clock = _clock(channel, resample)
    else:
        clock = clocks.Clock(float(dt), f"dt {clocks.duration(dt)} as given")
    even = clock.placed(error)
    check_record(even, clock.dt)
    columns = {printable(name): _filled(clock.placed(x)) for name, x in columns.items()}
    return Recording(printable(origin), printable(channel.name), even, float(clock.dt),
                     columns, printable(channel.unit), printable(clock.said))


def _filled(x):
    """Interpolated where there are no values."""
    gaps = np.isnan(x)
    if gaps.any() and not gaps.all():
        x = np.where(gaps, np.interp(np.arange(len(x)), np.flatnonzero(~gaps),
                                     x[~gaps]), x)
    return x


def _clock(channel, resample):
    """The clock of a channel's group: its stamps or its scalar dt, which must agree."""
    group, samples = channel.group, len(channel.values)
    names = [name for name in group.arrays if clocks.unit_of(name) is not None]
    names.sort(key=lambda name: (name != group.clock, name != "time"))
    fitting = [n for n in names if group.arrays[n].shape in ((samples,), (samples, 1),
                                                             (1, samples))]
    own = None
    if "dt" in group.arrays and not (fitting and group.arrays["dt"].size == samples):
        own = _number("dt", group.arrays["dt"])
    if names and not fitting and own is None:
        raise ValueError(f"{group.arrays[names[0]].size} times in {names[0]} for "
                         f"{samples} samples of {channel.name}")
    if fitting:
        stamps = group.arrays[fitting[0]].ravel()
        if fitting[0] in group.refused and stamps.dtype.kind == "f":
            raise ValueError(group.refused[fitting[0]])
        clock = clocks.clock(printable(fitting[0]), stamps, resample)
        if own is not None and not abs(clock.dt - own) <= 0.01 * own:
            raise ValueError(f"{fitting[0]} says dt = {clock.dt:g} s, but the scalar "
                             f"dt is {own:g} s: leave one out, or give --dt")
        return clock
    if own is None:
        raise ValueError("neither a column time nor dt: give the sampling interval "
                         "with --dt")
    return clocks.Clock(own, f"dt {clocks.duration(own)}")


def _number(name, x):
    """A scalar of a source."""
    if x.dtype.kind not in "iuf":
        raise ValueError(f"{name} does not hold real numbers")
    if x.size != 1:
        raise ValueError(f"{name} holds {x.size} numbers, not one")
    return float(x.ravel()[0])


Record, read_record = Recording, read    # the same by other names
