"""What the commands share: reading their record, checking their outputs."""

import json
import os
import pathlib
import sys

from sensorid import _write
from sensorlab.gap.report import _finite
from sensorlab.records import read_record


def progress_bar(done, total):
    """Progress on a terminal."""
    if sys.stderr.isatty():
        filled = 30 * done // total
        print(f"\r[{'#' * filled}{'.' * (30 - filled)}] {done}/{total}",
              end="\n" if done == total else "", file=sys.stderr, flush=True)


def _read(options, model=None, beside=()):
    """The record that the options name, with further columns, at the sampling interval
    of the model if there is one.
    """
    dt = options.dt
    if dt is None and model and pathlib.Path(options.record).suffix.lower() == ".npy":
        dt = model.dt
    record = read_record(options.record, options.column, dt, options.resample,
                         options.allow_missing, beside)
    if model and abs(record.dt - model.dt) > 0.01 * model.dt:
        raise ValueError(f"{options.record} is sampled at {record.dt:g} s, "
                         f"but the model is for dt = {model.dt:g} s: "
                         "its noises per sample do not apply")
    return record


def _refuse_effects(file, model):
    if model and model.effects:
        raise ValueError(f"{file} has effects: only simulate and diagnose know them, "
                         "take them out for anything else")


PICTURES = ".png", ".pdf", ".svg", ".jpg"


def _check_outputs(inputs, *outputs, plot=None):
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


def _write_json(file, value):
    text = json.dumps(_finite(value), indent=1, allow_nan=False)
    _write(file, lambda stream: stream.write(text.encode()))
