"""Recordings of any source behind one door: `read`; of several axes: `read_axes`.

    clocks       time stamps -> an even sampling interval
    dates        times as loggers write them, in nanoseconds
    channels     one row of numbers among the arrays of a source
    axes         which of them are the axes of a sensor
    covariates   what was recorded beside a channel
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
from sensorlab.readers import (
    apart, arrays, axes, channels, clocks, covariates, objects, text)

APART = {".mat": "matlab", ".h5": "matlab", ".hdf5": "matlab", ".parquet": "parquet",
         ".pq": "parquet", ".bag": "rosbag", ".db3": "rosbag", ".mcap": "rosbag",
         ".ulg": "px4", ".bin": "ardupilot"}


class Unread(NamedTuple):
    """A channel of a source that is no record."""

    file: str
    column: str
    problem: str    # what is wrong with it, in a sentence


def unread(file, column, problem):
    """`Unread`, as it may be shown."""
    return Unread(*map(printable, (file, column, problem)))


class Recording(NamedTuple):
    """A channel of a source, evenly sampled; missing samples are NaN."""

    file: str
    column: str
    error: np.ndarray    # (N,) u
    dt: float            # s
    columns: dict = {}   # what was recorded beside it, if asked for
    unit: str = ""       # u, where the source says it
    clock: str = ""      # where dt comes from, in words
    axes: tuple = ()     # further columns that are none of these: other axes
    left_out: tuple = ()    # why others are none of these, in words

    @property
    def heading(self):
        """What was read, in one line."""
        return (f"{self.file}, column {self.column}: {len(self.error)} samples, "
                + (self.clock or f"dt {self.dt:g} s"))

    def __repr__(self):
        return f"<Recording {self.heading}>"


def read(source, channel="error", dt=None, resample=False, allow_missing=False,
         beside=(), missing=()):
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
        `dt`; if given, the samples count as evenly spaced, unless even stamps say
        something else.
    resample : bool
        Take each sample of an unevenly sampled record at the nearest of even times;
        where there is none, or of several all but the nearest, it is missing.
    allow_missing : bool
        Take NaN, masked and empty values as missing samples.
    beside : sequence of str, or None
        Further columns wanted, as NAME or as NAME=COLUMN to give one another name; of
        other topics as topic/field. None for all that hold numbers but, beside an axis
        of a sensor, the other axes. Where samples are missing they are interpolated.
    missing : float, or sequence of float
        Values that stand for missing samples, such as -9999; 0 of the channel alone.

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
        return _recording(origin, groups, _channel(groups, channel), dt, resample,
                          allow_missing, beside, missing)
    except ValueError as problem:
        raise ValueError(f"{origin}: {problem}") from None


def read_axes(source, channel="all", dt=None, resample=False, allow_missing=False,
              beside=None, missing=()):
    """`Recording`s of several channels of a source, which is opened once.

    Parameters are those of `read`, but `channel` may be names, comma-separated, the
    name of an array, a topic or a message for all its axes, or "all". What is wrong
    with one of several channels is returned in its place, as `Unread`.
    """
    origin, groups = _opened(source)
    try:
        found = ([_channel(groups, channel)] if channel == "error" and _alone(groups)
                 else axes.find_several(groups, channel))
    except ValueError as problem:
        raise ValueError(f"{origin}: {problem}") from None
    result = []
    for one in found:
        try:
            result.append(_recording(origin, groups, one, dt, resample, allow_missing,
                                     beside, missing))
        except ValueError as problem:
            result.append(unread(origin, one.name, f"{origin}: {problem}"))
    return result


def read_rows(source, channel="error", dt=None, missing=()):
    """Recordings of the channel of this name or, where there is none, of all rows of
    the array `error`; `missing` as for `read`.
    """
    origin, groups = _opened(source)
    try:
        try:
            rows = [_channel(groups, channel)]
        except ValueError:
            rows = []
        if not rows or rows[0].array == "error":
            rows = ([_channel(groups, "error")] if _alone(groups) else
                    axes.find_several(groups, "error"))
        return [_recording(origin, groups, c, dt, False, True, (), missing)
                for c in rows]
    except ValueError as problem:
        raise ValueError(f"{origin}: {problem}") from None


def plain_name(column):
    """The name of a column without its unit."""
    return channels.UNIT.sub("", column)


def _channel(groups, wanted):
    return channels.find(groups, (wanted == "error" and _alone(groups)) or wanted)


def _alone(groups):
    """Name of the only channel that there is, beside a clock known as one, or None."""
    every = [c for group in groups for c in channels.channels(group)
             if c.array != group.clock]
    return every[0].name if len(every) == 1 else None


def _opened(source):
    """Name and groups of a source."""
    if not isinstance(source, (str, pathlib.Path)):
        groups = objects.groups(source)
        if groups is None:
            raise ValueError(f"a {type(source).__name__} is no source of records: give "
                             "a file, an array or a table")
        return objects.name_of(source), groups
    file = pathlib.Path(source)
    folder_of_ros = (file / "metadata.yaml").is_file()
    if file.exists() and not (file.is_file() or file.is_dir()):
        raise ValueError(f"{file} is no file but a pipe or a device: write what comes "
                         "from it into a file first")
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


def _recording(origin, groups, channel, dt, resample, allow_missing, beside, missing):
    from sensorid import check_record    # not for the readers in their own processes
    error, missing = channel.values.astype(float), _numbers(missing)
    columns, others = covariates.beside(groups, channel, beside)
    if beside is None:
        columns = {name: x for name, x in columns.items() if not np.isnan(x).all()}
    clock = _clock(channel, resample) if dt is None else _given(channel, dt)
    for name, x in {channel.name: error, **columns}.items():
        holes = int(np.isnan(x).sum())
        if holes and not allow_missing:
            raise ValueError(f"{name} holds {holes} NaN or empty values, the first at "
                             f"sample {np.argmax(np.isnan(x))}; --allow-missing takes "
                             "them as missing")
    even = clock.placed(_less(error, missing))
    check_record(even, clock.dt)
    missing = [value for value in missing if value]    # a rate may rest
    columns = {printable(name): _filled(clock.placed(_less(x, missing)))
               for name, x in columns.items()}
    return Recording(printable(origin), printable(channel.name), even, float(clock.dt),
                     columns, printable(channel.unit), printable(clock.said),
                     tuple(map(printable, others)), tuple(map(
                         printable, covariates.left_out(channel)
                         if beside is None else ())))


def _numbers(missing):
    """Values that stand for missing samples, one or several, as numbers."""
    try:
        return np.atleast_1d(np.asarray(missing, float)).tolist()
    except (TypeError, ValueError):
        raise ValueError(f"missing is {missing!r}: a number, or several, are needed, "
                         "for which the samples are lost") from None


def _less(x, missing):
    """Without values that stand for missing samples."""
    return np.where(np.isin(x, missing), np.nan, x)


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
    stamps, own = clocks.stamps(group.arrays, group.clock, samples), None
    if "dt" in group.arrays and not (stamps and group.arrays["dt"].size == samples):
        own = _number("dt", group.arrays["dt"])
    if stamps:
        name, times = stamps
        if name in group.refused and times.dtype.kind == "f":
            raise ValueError(group.refused[name])
        clock = clocks.clock(printable(name), times, resample)
        if own is not None and not abs(clock.dt - own) <= SAME * own:
            raise ValueError(f"{name} says dt = {clock.dt:g} s, but the scalar "
                             f"dt is {own:g} s: leave one out")
        return clock
    if own is None:
        for name, x in group.arrays.items():
            if clocks.unit_of(name) is not None:
                raise ValueError(f"{x.size} times in {name} for {samples} samples of "
                                 f"{channel.name}")
        raise ValueError("neither a column time nor dt: give the sampling interval "
                         "with --dt")
    return clocks.Clock(own, f"dt {clocks.duration(own)}")


SAME = 0.01    # relative: two sampling intervals that are the same


def _given(channel, dt):
    """The clock of a sampling interval that was given, if no even stamps disagree."""
    try:
        dt = float(np.squeeze(dt))
    except (TypeError, ValueError):
        raise ValueError(f"dt is {dt!r}: a number of seconds is needed") from None
    stamps = clocks.stamps(channel.group.arrays, channel.group.clock,
                           len(channel.values))
    try:
        clock = stamps and clocks.clock(printable(stamps[0]), stamps[1])
    except ValueError:    # it is given because they tell nothing
        clock = None
    # a unit that was only guessed is none
    units = 10.0**np.arange(-9, 10, 3) if clock and clock.guess else 1.0
    if clock and clock.even and not np.any(np.abs(units * clock.dt - dt) <= SAME * dt):
        raise ValueError(f"{stamps[0]} says dt = {clock.dt:g} s, but {dt:g} s is given:"
                         " leave one of the two out")
    return clocks.Clock(dt, f"dt {clocks.duration(dt)} as given")


def _number(name, x):
    """A scalar of a source."""
    if x.dtype.kind not in "iuf":
        raise ValueError(f"{name} does not hold real numbers")
    if x.size != 1:
        raise ValueError(f"{name} holds {x.size} numbers, not one")
    return float(x.ravel()[0])


Record, read_record = Recording, read    # the same by other names
