"""Recordings as files hold them."""

import csv
import pathlib
import warnings
from typing import NamedTuple

import numpy as np

from sensorid import MIN_SAMPLES, check_record


class Record(NamedTuple):
    """A column of a file, evenly sampled; missing samples are NaN."""

    file: str
    column: str
    error: np.ndarray    # (N,) u
    dt: float            # s
    columns: dict = {}   # what was recorded beside it, if asked for


def read_record(file, column="error", dt=None, resample=False, allow_missing=False,
                beside=()):
    """Record from a CSV file with a header, or from .npz, .mat or .npy.

    Parameters
    ----------
    file : path
        A CSV header names the columns; .npz and .mat hold arrays of such names and,
        optionally, a scalar `dt`; .npy holds the error alone.
    column : str
        Column or array of the sensor error; a row of a 2-D array as in "error[0]".
    dt : float, optional
        Sampling interval, s. By default it comes from the column `time` or the scalar
        `dt`; if given, the samples count as evenly spaced and `time` is not read.
    resample : bool
        Interpolate an unevenly sampled record linearly onto even times.
    allow_missing : bool
        Take NaN and empty cells as missing samples.
    beside : sequence of str, or None
        Further columns wanted, as NAME or as NAME=COLUMN to give one another name; None
        for all that hold numbers. Where samples are missing they are interpolated.

    Returns
    -------
    Record
        A gap of whole sampling intervals in `time` becomes missing samples.

    Raises
    ------
    ValueError, OSError
        With one sentence on what is wrong with the file.
    """
    file = pathlib.Path(file)
    if not file.is_file():
        raise ValueError(f"{file}: no such file" + ", but a folder" * file.is_dir())
    name, row = column, None
    if column.endswith("]") and column.rpartition("[")[2][:-1].isdigit():
        name, row = column.rpartition("[")[0], int(column.rpartition("[")[2][:-1])
    arrays = _read_arrays(file, name, with_time=dt is None,
                          others=None if beside is None else [
                              part.rpartition("=")[2] for part in beside])
    if arrays.get(name) is None:
        raise ValueError(f"{file}: no column {name!r} among {', '.join(arrays)}; "
                         "choose one with --column")
    error = arrays[name]
    if error.ndim == 2 and error.shape[1] == 1:
        error = error[:, 0]
    if error.ndim == 1 and row is not None:
        raise ValueError(f"{file}: {name} is one row of numbers: leave [{row}] out")
    if error.ndim == 2 and (row is not None or len(error) == 1):
        if not (row or 0) < len(error):
            raise ValueError(f"{file}: {name} has the rows 0 to {len(error) - 1}, "
                             f"not {row}")
        error = error[row or 0]
    if error.ndim != 1 or error.dtype.kind not in "iuf":
        raise ValueError(
            f"{file}: {name} is an array of {error.dtype} of shape {error.shape}: a "
            f"record is one row of numbers, such as --column '{name}[0]'")
    shape = np.shape(arrays[name])
    error = error.astype(float)
    columns = _columns_beside(file, arrays, name, row or 0, shape, len(error), beside)
    time = arrays.get("time")
    holes = int(np.isnan(error).sum())
    if holes and not allow_missing:
        raise ValueError(f"{file}: {column} holds {holes} NaN or empty values, "
                         f"the first at sample {np.argmax(np.isnan(error))}; "
                         "--allow-missing takes them as missing")
    if dt is None and arrays.get("time") is not None:
        dt, error = _even(file, _numbers(file, "time", arrays), error, resample)
    elif dt is None:
        if "dt" not in arrays:
            raise ValueError(f"{file}: neither a column time nor dt: "
                             "give the sampling interval with --dt")
        dt = _numbers(file, "dt", arrays)
        if dt.size != 1:
            raise ValueError(f"{file}: dt holds {dt.size} numbers, not one")
        dt = float(dt[0])
    try:
        check_record(error, dt)
    except ValueError as problem:
        raise ValueError(f"{file}: {problem}") from None
    if len(columns) and time is not None and len(time) == len(next(
            iter(columns.values()))) != len(error):
        even = time[0] + dt * np.arange(len(error))
        columns = {name: np.interp(even, time, x) for name, x in columns.items()}
    return Record(str(file), column, error, float(dt), columns)


def _columns_beside(file, arrays, name, row, shape, samples, beside):
    """The further columns of a file by their names; rows of arrays as name[k]."""
    columns = {}
    for key, x in arrays.items():
        if key in (name, "time", "dt") or x is None or x.dtype.kind not in "iuf":
            continue
        x = np.asarray(x, float)
        if x.ndim == 2 and x.shape == shape:
            columns[key] = x[row]
        elif x.ndim == 2 and x.shape[1] == samples:
            columns.update((f"{key}[{k}]", part) for k, part in enumerate(x))
        elif x.shape == (samples,):
            columns[key] = x
    if beside is None:
        return columns
    for part in beside:
        new, _, old = part.rpartition("=")
        if old not in columns:
            raise ValueError(f"{file}: no column {old!r} of {samples} numbers beside "
                             f"{name}; there are {', '.join(columns) or 'none'}")
        columns[new or old] = columns.pop(old)
    wanted = [part.rpartition("=")[0] or part for part in beside]
    return {key: columns[key] for key in wanted}


def _numbers(file, name, arrays):
    """An array of a file as floats in one row."""
    if np.asarray(arrays[name]).dtype.kind not in "iuf":
        raise ValueError(f"{file}: {name} does not hold real numbers")
    return np.asarray(arrays[name], float).ravel()


def _read_arrays(file, name, with_time, others=()):
    """Arrays of a file by name; None for those that are not needed."""
    needed = [name, "time", "dt"] if with_time else [name]
    needed += [part.partition("[")[0] for part in others or ()]
    kind = file.suffix.lower()
    if kind == ".npy":
        return {name: loaded(file, np.load)}
    if kind == ".npz":
        with loaded(file, np.load) as archive:
            return {key: archive[key] if others is None or key in needed else None
                    for key in archive.files}
    if kind == ".mat":
        from scipy.io import loadmat
        return {key: np.squeeze(value) for key, value in loaded(file, loadmat).items()
                if not key.startswith("__")}
    return _read_csv(file, needed, everything=others is None)


def loaded(file, load):
    """A NumPy or MATLAB file, or a sentence on what is wrong with it."""
    try:
        return load(file)
    except Exception as problem:    # each format raises its own
        raise ValueError(f"{file}: cannot be read as {file.suffix}: "
                         f"{str(problem).splitlines()[0]}") from None


def _read_csv(file, wanted, everything=False):
    """The wanted columns of a CSV file as arrays; None for the ones it only names.

    Everything means all columns whose first cell is a number.
    """
    with open(file, newline="", encoding="utf-8-sig", errors="replace") as stream:
        skip, header = 0, ""
        for header in stream:
            skip += 1
            if header.strip() and not header.startswith("#"):
                break
        first = next((line for line in stream if line.strip()), "")
    delimiter = next((d for d in (",", ";", "\t") if d in header), ",")
    names = [name.strip().strip('"') for name in header.strip().split(delimiter)]
    if not header.isprintable() and not header.strip("\r\n\t").isprintable():
        raise ValueError(f"{file}: not a CSV file in UTF-8")
    if all(_is_number(name) or not name for name in names):
        raise ValueError(f"{file}: no header: the first line must name the columns, "
                         "such as time,error")
    if everything:
        cells = first.strip("\r\n").split(delimiter)
        wanted = [wanted[0], *(n for n, cell in zip(names, cells)
                               if n and n not in wanted and _is_number(cell)),
                  *wanted[1:]]
    present = [name for name in dict.fromkeys(wanted) if name in names]
    twice = [name for name in present if names.count(name) > 1]
    if twice:
        raise ValueError(f"{file}: the header names {twice[0]} more than once")
    if wanted[0] in present:
        at = [names.index(name) for name in present]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")    # on files without a row: told below
                table = np.loadtxt(file, delimiter=delimiter, skiprows=skip,
                                   usecols=at, ndmin=2, encoding="utf-8-sig")
        except ValueError:
            table = _read_cells(file, delimiter, skip, at, present)
        return {**dict.fromkeys(names), **dict(zip(present, table.T))}
    return dict.fromkeys(names)


def _is_number(text):
    try:
        float(text)
        return True
    except ValueError:
        return False


MISSING = "", "NA", "N/A", "NULL"    # cells that count as NaN


def _read_cells(file, delimiter, skip, at, names):
    """Cell by cell: missing ones are NaN, and what is no number is named with its line.
    """
    rows = []
    with open(file, newline="", encoding="utf-8-sig", errors="replace") as stream:
        for number, row in enumerate(csv.reader(stream, delimiter=delimiter), 1):
            if number <= skip or not "".join(row).strip() or row[0].startswith("#"):
                continue
            if len(row) <= max(at):
                raise ValueError(f"{file}, line {number}: {len(row)} cells, but column "
                                 f"{names[np.argmax(at)]} is number {max(at) + 1}")
            cells = [row[column].strip() for column in at]
            for name, cell in zip(names, cells):
                if cell.upper() not in MISSING and not _is_number(cell):
                    raise ValueError(f"{file}, line {number}: {cell!r} "
                                     f"in column {name} is not a number")
            rows.append([np.nan if cell.upper() in MISSING else float(cell)
                         for cell in cells])
    return np.array(rows).reshape(-1, len(at))


JITTER = 0.1    # of a sampling interval: what a time stamp may be off


def _even(file, time, error, resample):
    """dt and the record on evenly spaced times; gaps become NaN."""
    if len(time) != len(error):
        raise ValueError(f"{file}: {len(time)} times for {len(error)} samples")
    if not np.isfinite(time).all():
        raise ValueError(f"{file}: time of sample {np.argmin(np.isfinite(time))} is "
                         f"{time[np.argmin(np.isfinite(time))]}: a number is needed")
    step = np.diff(time)
    bad = np.flatnonzero(~(step > 0.0))
    if bad.size:
        raise ValueError(f"{file}: time does not increase from sample {bad[0]} "
                         f"({time[bad[0]]:g} s) to the next "
                         f"({time[bad[0] + 1]:g} s): sort the record, "
                         "or give --dt if it is evenly sampled")
    if len(time) < 2:
        raise ValueError(f"{file}: the record has {len(time)} samples: "
                         f"at least {MIN_SAMPLES} are needed")
    middle = np.median(step)
    if (time[-1] - time[0]) / middle > 100 * len(time):
        raise ValueError(f"{file}: {len(time)} samples, usually {middle:g} s apart, "
                         f"are spread over {time[-1] - time[0]:g} s: cut the gap after "
                         f"sample {step.argmax()} out")
    count = np.maximum(np.round(step / middle), 1.0)
    dt = (time[-1] - time[0]) / count.sum()
    off = np.abs(step - count * dt)
    if resample:
        dt = middle
        even = np.arange(time[0], time[-1] + 1e-6 * dt, dt)
        after = np.searchsorted(time, even).clip(1, len(time) - 1)
        value = np.interp(even, time, error)
        value[time[after] - time[after - 1] > 2.5 * dt] = np.nan
        return dt, value
    if off.max() > JITTER * dt:
        raise ValueError(f"{file}: the record is uneven: "
                         f"the step after sample {off.argmax()} is "
                         f"{step[off.argmax()]:g} s where {middle:g} s is usual; "
                         "--resample interpolates it, --dt takes the samples as even")
    index = np.append(0, np.cumsum(count)).astype(int)
    even = np.full(index[-1] + 1, np.nan)
    even[index] = error
    return dt, even
