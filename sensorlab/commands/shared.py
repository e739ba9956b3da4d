"""What the commands share: reading their record, checking their outputs."""

import json
import os
import pathlib
import sys

import numpy as np

from sensorid import write_whole
from sensorlab.commands.cache import forgive
from sensorlab.gap.report import finite
from sensorlab.readers import read as read_source, read_rows
from sensorlab.units import check_report, factor, quoted


forgive()


def progress_bar(done, total):
    """Progress on a terminal."""
    if sys.stderr and sys.stderr.isatty():
        filled = 30 * done // total
        print(f"\r[{'#' * filled}{'.' * (30 - filled)}] {done}/{total}",
              end="\n" if done == total else "", file=sys.stderr, flush=True)


def read(options, model=None, beside=()):
    """The record that the options name, with further columns, at the sampling interval
    of the model if there is one.
    """
    dt = options.dt
    if dt is not None:
        refuse_unused(options, "resample", why="does nothing beside --dt, which takes "
                                               "the samples as even")
    if dt is None and model and pathlib.Path(options.record).suffix.lower() == ".npy":
        dt = model.dt
    record = _part(read_source(options.record, options.column, dt, options.resample,
                               options.allow_missing, beside), options)
    if model and abs(record.dt - model.dt) > 0.01 * model.dt:
        raise ValueError(f"{options.record} is sampled at {record.dt:g} s, "
                         f"but the model is for dt = {model.dt:g} s: "
                         "its noises per sample do not apply")
    return record


def _part(record, options):
    """The part of a record between --from and --to, averaged by --average."""
    N, m = len(record.error), options.average
    first = 0 if options.start is None else int(np.ceil(options.start / record.dt))
    last = N if options.end is None else int(np.floor(options.end / record.dt))
    last = min(last, N) - max(min(last, N) - first, 0) % m
    if not 0 <= first < last:
        raise ValueError(f"--from, --to and --average {m} leave nothing of the "
                         f"{N * record.dt:g} s of {record.file}")

    if (first, last, m) == (0, N, 1):
        return record

    def averaged(x):
        x = x[first:last].reshape(-1, m)
        count = np.maximum((~np.isnan(x)).sum(1), 1)
        return np.where(np.isnan(x).all(1), np.nan, np.nansum(x, 1) / count)
    clock = record.clock or f"dt {record.dt:g} s"
    if m > 1:
        clock += f"; means of {m}, dt {m * record.dt:g} s"
    return record._replace(error=averaged(record.error), dt=m * record.dt, clock=clock,
                           columns={name: averaged(x)
                                    for name, x in record.columns.items()})


def refuse_unused(options, *names, why):
    """Refuse options that would do nothing in this command."""
    for name in names:
        if getattr(options, name) not in (None, False, "error"):
            raise ValueError(f"--{name.replace('_', '-')} {why}")


def check_memory(samples, records=1):
    """Refuse records that the machine cannot hold."""
    pages = [os.sysconf(name) for name in ("SC_PHYS_PAGES", "SC_PAGE_SIZE")
             if name in getattr(os, "sysconf_names", ())]
    if len(pages) == 2 and 8 * samples * records > pages[0] * pages[1]:
        raise MemoryError(f"{records} records of {samples} samples take "
                          f"{8e-9 * samples * records:.3g} GB")


def in_unit(record, options, model=None):
    """The record times --scale, in the unit of the model if it has one, and the unit.

    The unit is that of the model, else --unit, else that of the file, else "u".
    """
    if not (np.isfinite(options.scale) and options.scale):
        raise ValueError(f"--scale is {options.scale:g}: a finite number other than 0 "
                         "is needed")
    unit, times = options.unit or record.unit or "u", options.scale
    if model and model.unit != "u":
        if options.unit:
            times *= factor(options.unit, model.unit)
        unit = model.unit
    if options.unit or options.report:
        if unit == "u":
            raise ValueError("--report needs the unit of the record: "
                             "give it with --unit")
        check_report(unit, _report(options))
    return record._replace(error=times * record.error), unit


def as_quoted(parameters, dt, unit, options):
    """Parameters as the field quotes them, if --unit or --report asks for it."""
    if not (options.unit or options.report):
        return ()
    return quoted(parameters, dt, unit, _report(options))


def _report(options):
    return [part for part in (options.report or "").split(",") if part]


def refuse_effects(file, model):
    """Refuse a model file that only simulate and diagnose understand."""
    if model and model.simulator.effects:
        raise ValueError(f"{file} has effects: only simulate and diagnose know them, "
                         "take them out for anything else")


PICTURES = ".png", ".pdf", ".svg", ".jpg"


def check_outputs(inputs, *outputs, plot=None):
    """Refuse before the work what could not be written after it."""
    if plot is not None and pathlib.Path(plot).suffix.lower() not in PICTURES:
        raise ValueError(f"{plot}: a picture is one of {', '.join(PICTURES)}")
    outputs = [file for file in (*outputs, plot) if file is not None]
    taken = {os.path.realpath(file) for file in inputs if file}
    for file in outputs:
        if os.path.realpath(file) in taken:
            raise ValueError(f"{file} is named twice: "
                             "an output must be a file of its own")
        taken.add(os.path.realpath(file))
        folder = pathlib.Path(file).absolute().parent
        if (not folder.is_dir() or not os.access(folder, os.W_OK)
                or pathlib.Path(file).is_dir()):
            raise ValueError(f"{file} cannot be written: "
                             "no such folder, or no right to")


def write_text(file, text):
    """Write a text whole or not at all."""
    write_whole(file, lambda stream: stream.write(text.encode()))


def write_json(file, value):
    """Write a value as JSON, whole or not at all."""
    write_text(file, json.dumps(finite(value), indent=1, allow_nan=False))


def simulated_records(options, dt):
    """Records (L, N) of the simulator behind --simulated."""
    records = read_rows(options.simulated, options.dt)
    own = records[0].dt
    if abs(own - dt) > 0.01 * dt:
        raise ValueError(f"{options.simulated} is sampled at {own:g} s, the record at "
                         f"{dt:g} s")
    return np.array([record.error for record in records])
