"""What the commands share: reading their record, checking their outputs."""

import json
import os
import pathlib
import re
import sys

import numpy as np

from sensorid import MODELS, write_whole
from sensorlab.commands.cache import forgive
from sensorlab.commands.options import STDOUT
from sensorlab.commands.progress import announce_compilation
from sensorlab.gap.costs import available
from sensorlab.gap.dropouts import dropouts
from sensorlab.gap.report import finite
from sensorlab.readers import (
    SAME, Unread, plain_name, read as read_source, read_axes, read_rows, unread)
from sensorlab.rest import LARGE, at_rest
from sensorlab.units import check_report, factor, fits, kind_of, quoted


forgive()
announce_compilation()


def read(options, model=None, beside=()):
    """The record that the options name, with further columns, at the sampling interval
    of the model if there is one.
    """
    record = read_source(
        options.record, options.column, _interval(options, options.record, model),
        options.resample, options.allow_missing, beside, options.missing)
    _tell_of_lost([record], options)
    record = _as_asked(record, options, model)
    _tell_of_motion([record], options)
    return record


def covariates_of(options):
    """Columns that the options name, NAME or NAME=COLUMN; None if they say nothing."""
    return None if options.covariates is None else [
        part for part in options.covariates.split(",") if part]


def read_each(options, model=None, beside=()):
    """The records of all sources and channels that the options name, in the unit that
    they ask for; `Unread` where one of several is none.
    """
    found, sources = [], _sources(options.records)
    for source in sources:
        try:
            found += read_axes(
                source, options.column, _interval(options, source, model),
                options.resample, options.allow_missing, beside, options.missing)
        except (ValueError, OSError) as problem:
            found.append(unread(source, options.column, problem))
    _tell_of_lost([one for one in found if not isinstance(one, Unread)], options)
    for number, one in enumerate(found):
        if not isinstance(one, Unread):
            try:
                found[number] = in_unit(_as_asked(one, options, model), options, model)
            except (ValueError, OSError) as problem:
                found[number] = unread(one.file, one.column, problem)
    _tell_of_motion([one for one in found if not isinstance(one, Unread)], options)
    problems = {getattr(one, "problem", None) for one in found}
    if len(problems) == 1 and None not in problems:    # nothing else to be said
        raise ValueError(*problems)
    return found


RECORDS = {".csv", ".txt", ".tsv", ".gz", ".bz2", ".xz", ".npy", ".npz", ".mat", ".h5",
           ".hdf5", ".parquet", ".pq", ".bag", ".db3", ".mcap", ".ulg", ".bin"}


def _sources(named):
    """Files, those of a folder for its name, each once."""
    result = []
    for name in named:
        folder = pathlib.Path(name)
        if not folder.is_dir() or (folder / "metadata.yaml").is_file():    # of ROS 2
            result.append(name)
            continue
        inside = sorted(str(f) for f in folder.iterdir()
                        if f.suffix.lower() in RECORDS and f.name[0] != ".")
        if not inside:
            raise ValueError(f"{name}: no record in this folder")
        result += inside
    return list({os.path.realpath(file): file for file in result}.values())


def _interval(options, source, model):
    """The sampling interval to be taken, or None for that of the source."""
    if options.dt is not None:
        refuse_unused(options, "resample", why="does nothing beside --dt, which takes "
                                               "the samples as even")
    elif model and pathlib.Path(source).suffix.lower() == ".npy":
        return model.dt
    return options.dt


def _as_asked(record, options, model):
    """The part of a record that is asked for, if it fits the model."""
    record = _part(record, options)
    if model and _apart(record.dt, model.dt):
        raise ValueError(f"{record.file} is sampled at {record.dt:g} s, "
                         f"but the model is for dt = {model.dt:g} s: "
                         "its noises per sample do not apply")
    return record


def _apart(one, other):
    """Are two sampling intervals not the same?"""
    return abs(one - other) > SAME * other


def _part(record, options):
    """The part of a record between --from and --to, averaged by --average."""
    N, m = len(record.error), options.average
    # 0.3 s are three samples of 0.1 s, whatever their quotient is in binary digits
    first = 0 if options.start is None else int(np.ceil(
        options.start / record.dt - ROUNDING))
    last = N if options.end is None else int(np.floor(
        options.end / record.dt + ROUNDING))
    last = min(last, N) - max(min(last, N) - first, 0) % m
    if not 0 <= first < last:
        raise ValueError(f"--from, --to and --average {m} leave nothing of the "
                         f"{N * record.dt:g} s of {record.file}")
    return _averaged(record, m, slice(first, last))


def _tell_of_lost(records, options):
    """Say once what to do about a constant that stands for lost samples of records that
    are to be identified or averaged, where none is known, or of what is beside them.
    """
    said, itself = [], options.command == "identify" or options.average > 1
    for one in records:
        if itself:
            said.append(_of_lost(one.column, one.error))
        said += [_of_lost(name, x, or_zero=False)    # a rate may rest
                 for name, x in one.columns.items()]
    for sentence in filter(None, dict.fromkeys(said)):
        print(f"sensorid: {sentence}", file=sys.stderr)


def _of_lost(name, x, or_zero=True):
    """The sentence about the dropouts of a column, or "" if there are none."""
    lost = dropouts(x)
    if not lost.own.any() or not (lost.value or or_zero):
        return ""
    value = f"{lost.value:g}"
    value = value if float(value) == lost.value else repr(lost.value)
    return (f"{lost.own.sum()} samples of {name} are {value}, unlike all others: if "
            f"these were lost, --missing {value} takes them as missing")


def _tell_of_motion(records, options):
    """Say once of every sensor that it was moved, and where it was at rest."""
    sensors = {}
    for one in records:
        sensors.setdefault((one.file, one.dt, len(one.error)), []).append(one)
    for (file, dt, N), axes in sensors.items():
        moved = [one.column for one in axes
                 if np.diff(at_rest(one.error, dt)).sum() < N]
        if not moved:
            continue
        still = at_rest([one.error for one in axes], dt)
        longest = still[np.argsort(-np.diff(still)[:, 0])[:1]]    # if there is any
        print(f"sensorid: {file}: {', '.join(moved)} may show a motion, which is no "
              f"error of the sensor, {1.0 - np.diff(still).sum() / N:.0%} of the time "
              f"(changes within a second of more than {LARGE:.0f} times the noise)",
              *(f"the longest stretch at rest is --from {first:.10g} --to {last:.10g}"
                for first, last in longest * dt + (options.start or 0.0)),
              sep="; ", file=sys.stderr)


ROUNDING = 1e-6    # of a sample


def _averaged(record, m, part):
    """A part of a record, as means of m samples."""
    def mean(x):
        if m == 1:
            return x[part]
        x = x[part].reshape(-1, m)
        count = np.maximum((~np.isnan(x)).sum(1), 1)
        return np.where(np.isnan(x).all(1), np.nan, np.nansum(x, 1) / count)
    clock = record.clock or f"dt {record.dt:g} s"
    if m > 1:
        clock += f"; means of {m}, dt {m * record.dt:g} s"
    if part.start:
        clock += f"; times are since {part.start * record.dt:g} s"
    return record._replace(error=mean(record.error), dt=m * record.dt, clock=clock,
                           columns={name: mean(x)
                                    for name, x in record.columns.items()})


RECORDED = ("column", "dt", "start", "end", "average", "resample", "missing",
            "allow_missing")
UNSET = dict(column="error", average=1, seed=0, scale=(1.0,))    # where it is not None


def refuse_unused(options, *names, why):
    """Refuse options that would do nothing in this command."""
    for name in names:
        value = getattr(options, name)
        if value not in (None, False, []) and value != UNSET.get(name):
            said = dict(start="from", end="to").get(name, name.replace("_", "-"))
            raise ValueError(f"--{said} {why}")


def refuse_interval(file, model, dt):
    """Refuse a sampling interval that is not that of a model which says its own."""
    if dt is not None and _apart(dt, model.dt):
        raise ValueError(f"{file} is for dt = {model.dt:g} s, not for {dt:g} s: leave "
                         "--dt out")


def check_memory(samples, records=1):
    """Refuse records that the machine cannot hold."""
    if 8 * samples * records > available():
        raise MemoryError(f"{records} records of {samples:.0f} samples take "
                          f"{8e-9 * samples * records:.3g} GB")


GYRO = re.compile(r"gyr|angular|omega|(?:^|[/_.:])[gw]_?(?:[xyz]\b|RS)", re.I)
ACCEL = re.compile(r"acc|(?:^|[/_.:])a_?(?:[xyz]\b|RS)", re.I)


def _of_kind(values, option, record, options):
    """The one of the values of an option that is for the sensor of this record."""
    units = (options.unit or "").split(",")
    if len(values) == 1:
        return values[0]
    kinds = [kind_of(unit) for unit in units] if options.unit else []
    if sorted(kinds) != ["accelerometer", "gyroscope"] or len(values) != 2:
        raise ValueError(f"--{option} has {len(values)} values: one is needed, or two "
                         "beside --unit of a gyroscope and of an accelerometer, such "
                         "as --unit deg/s,mg")
    for kind, known in (("gyroscope", GYRO), ("accelerometer", ACCEL)):
        if known.search(record.column):
            return values[kinds.index(kind)]
    raise ValueError(f"{record.column} may be a gyroscope or an accelerometer: give "
                     f"one --{option}")


def in_unit(record, options, model=None):
    """The record times --scale, in the unit of the model if it has one.

    The unit is that of the model, else --unit, else that of the file, else "u". What
    the file says is no other unit than --unit, unless --scale makes it that.
    """
    times = _of_kind(options.scale, "scale", record, options)
    if not (np.isfinite(times) and times):
        raise ValueError(f"--scale is {times:g}: a finite number other than 0 is "
                         "needed")
    given = options.unit and _of_kind(options.unit.split(","), "unit", record, options)
    unit = given or record.unit or "u"
    scaled = abs(times) != 1.0    # to whatever unit it is in then
    if not scaled and given and _is_other(record.unit, given):
        raise ValueError(f"{record.column} of {record.file} is in {record.unit}, not in"
                         f" {given}: leave --unit out, or give --scale as well")
    if given:
        _check_kind(record.column, given)
    if model and model.unit != "u":
        if unit not in ("u", model.unit) and (given or not scaled):
            times *= factor(unit, model.unit)
        unit = model.unit
    record = record._replace(error=times * record.error, unit=unit)
    if options.unit or options.report:
        if unit == "u":
            raise ValueError("--report needs the unit of the record: "
                             "give it with --unit")
        check_report(unit, report_units(options, record))
    return record


def _is_other(own, given):
    """Is the unit that a file says another one than what is given? One that is none of
    a gyroscope or an accelerometer, such as counts, may be.
    """
    try:
        return bool(own) and not np.isclose(factor(own, given), 1.0)
    except ValueError:
        return bool(_kind(own) and _kind(given))


def _kind(unit):
    """"gyroscope", "accelerometer" or "", whichever has records in this unit."""
    try:
        return kind_of(unit)
    except ValueError:
        return ""


def _check_kind(column, unit):
    """Refuse a unit of one kind of sensor for a channel that is the other by name."""
    kind = _kind(unit)
    own, other, said = ((GYRO, ACCEL, "an accelerometer") if kind == "gyroscope" else
                        (ACCEL, GYRO, "a gyroscope"))
    if kind and other.search(column) and not own.search(column):
        raise ValueError(f"{column} is {said} by its name, {unit} the unit of a {kind}:"
                         " give a unit for each kind, such as --unit deg/s,mg, or one "
                         "channel with --column")


def report_units(options, record):
    """Units to quote parameters in, beside the usual ones; None if none are quoted.

    Where there are records of two kinds, those that fit this one.
    """
    if isinstance(record, Unread) or not (options.unit or options.report):
        return None
    wanted = [part for part in (options.report or "").split(",") if part]
    return [r for r in wanted
            if "," not in (options.unit or "") or fits(r, record.unit)]


def as_quoted(parameters, record, options):
    """Parameters as the field quotes them, if --unit or --report asks for it."""
    wanted = report_units(options, record)
    return () if wanted is None else quoted(parameters, record.dt, record.unit, wanted)


def refuse_effects(file, model):
    """Refuse a model file that only simulate and diagnose understand."""
    if model and model.simulator.effects:
        raise ValueError(f"{file} has effects: only simulate and diagnose know them, "
                         "take them out for anything else")


def hypothesis_names(options):
    """Names of default hypotheses, of those commands that take a model instead."""
    if options.model:
        refuse_unused(options, "hypotheses", why="names defaults and --model brings "
                                                 "its own: give one of them")
    names = options.hypotheses or "white_noise,random_walk,markov"
    return tuple(MODELS) if names == "all" else tuple(names.split(","))


def targets(option, texts, most=1000):
    """Sorted numbers by name from texts NAME=V,V,..."""
    result = {}
    for text in texts:
        name, _, values = text.rpartition("=")
        try:
            numbers = sorted(float(v) for v in values.split(","))
        except ValueError:
            numbers = []
        if (not name or name in result or not 1 <= len(numbers) <= most
                or not all(0.0 < v < np.inf for v in numbers)):
            raise ValueError(f"{option} {text}: NAME=NUMBER is needed, once for each "
                             "name, and numbers > 0")
        result[name] = numbers
    return result


PICTURES = ".png", ".pdf", ".svg", ".jpg"


def check_outputs(inputs, *outputs, plot=None, json=None):
    """Refuse before the work what could not be written after it; `json` may be the
    standard output.
    """
    if plot is not None and pathlib.Path(plot).suffix.lower() not in PICTURES:
        raise ValueError(f"{plot}: a picture is one of {', '.join(PICTURES)}")
    if json != STDOUT:
        outputs = json, *outputs
    outputs = [file for file in (*outputs, plot) if file is not None]
    taken = {os.path.realpath(file) for file in inputs if file}
    for file in outputs:
        if file == STDOUT:
            raise ValueError(f"{STDOUT} is standard output, where only --json can "
                             "print: name a file")
        refuse_link(file)
        if os.path.realpath(file) in taken:
            raise ValueError(f"{file} is named twice: "
                             "an output must be a file of its own")
        taken.add(os.path.realpath(file))
        folder = pathlib.Path(file).absolute().parent
        if os.path.isdir(file):
            raise ValueError(f"{file} is a folder: a file is needed")
        if not folder.is_dir() or not os.access(folder, os.W_OK):
            raise ValueError(f"{file} cannot be written: "
                             "no such folder, or no right to")
        if not os.path.exists(file):
            _try_to_write(pathlib.Path(os.path.realpath(file)))


def _try_to_write(file):
    """Refuse a new file that its folder does not take: by its name, or any."""
    try:
        file.touch(exist_ok=False)
        file.unlink()
    except OSError as problem:
        raise ValueError(f"{file} cannot be written: {problem.strerror}") from None


def check_folder(folder):
    """Refuse a folder that cannot be written to."""
    folder = pathlib.Path(folder)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is a file: a folder is needed")
    if not folder.is_dir():
        check_outputs([], folder)


def refuse_link(file):
    """Refuse to write through a link to a file, or to one that may be; devices such as
    /dev/stdout are linked.
    """
    if os.path.islink(file) and (os.path.isfile(file) or not os.path.exists(file)):
        raise ValueError(f"{file} is a link to {os.path.realpath(file)}: links are not "
                         "followed, name the file itself")


def write_text(file, text):
    """Write a text whole or not at all."""
    refuse_link(file)
    write_whole(file, lambda stream: stream.write(
        text.encode(errors="backslashreplace")))


def write_json(file, value):
    """Write a value as JSON, whole or not at all."""
    text = json.dumps(finite(value), indent=1, allow_nan=False)
    if file == STDOUT:
        print(text, file=sys.__stdout__, flush=True)
    else:
        write_text(file, text)


def simulated_records(options, record):
    """Records (L, N) of the simulator behind --simulated, for a record in the unit of
    that record.

    A column of the same name is a recording of the same kind: it is averaged and scaled
    as the record. Rows of `error`, and what says its own unit, are taken as they are.
    """
    rows = read_rows(options.simulated, record.column, options.dt, options.missing)
    recorded = plain_name(rows[0].column) == plain_name(record.column) != "error"
    if recorded:
        m = options.average
        rows = [_averaged(row, m, slice(0, len(row.error) // m * m)) for row in rows]
    own = rows[0].dt
    if _apart(own, record.dt):
        raise ValueError(f"{options.simulated} is sampled at {own:g} s, the record at "
                         f"{record.dt:g} s")
    if rows[0].unit and record.unit != "u":
        times = factor(rows[0].unit, record.unit)
    else:
        times = _of_kind(options.scale, "scale", record, options) if recorded else 1.0
    return np.array([times * row.error for row in rows])
