"""python -m sensorid diagnose"""

import json
import pathlib

import numpy as np

from sensorid import _write, default_hypotheses
from sensorlab.gap.effects import (
    CATALOGUE, Scene, describe, signature_of, with_processes)
from sensorlab.gap.account import as_simulated
from sensorlab.gap.diagnosis import check_scene, diagnose
from sensorlab.gap.report import _table, report
from sensorlab.records import _loaded, read_record
from sensorlab.modelfiles import Model, model_text, read_model, simulator_from
from sensorlab.drawings import _draw_diagnosis, _matplotlib, _save
from sensorlab.commands.shared import _check_outputs, _read, progress_bar


def run(options):
    if options.effects:
        return _list_effects(options)
    if options.record is None:
        raise ValueError("diagnose needs a record (--effects alone does without)")
    model = read_model(options.model) if options.model else None
    folder = None
    if options.out is not None:
        folder = pathlib.Path(options.out)
        if folder.exists() and not folder.is_dir():
            raise ValueError(f"{folder} is a file: a folder is needed")
        _check_outputs([], *([folder / "report.json"] if folder.is_dir() else [folder]))
        _check_outputs([options.record, options.model, options.simulated],
                       *(folder / name for name in ("report.json", "model.json")
                         if folder.is_dir()))
    plt = _matplotlib() if folder else None
    beside = None if options.covariates is None else [
        part for part in options.covariates.split(",") if part]
    record = _read(options, model, beside)
    y, dt, known = record.error, record.dt, ()
    unit = model.unit if model else "u"
    if model:
        hypotheses, known = _with_effects(options.model, model, record)
        scene = Scene(y, dt, record.columns)
        for one in known:
            y = y - signature_of(scene, one, {k: p.low
                                              for k, p in one.parameters.items()})
    elif options.simulated:
        hypotheses = simulator_from(_simulated(options, dt), dt)
    else:
        hypotheses = default_hypotheses(y, dt)
    d = diagnose(y, dt, hypotheses, record.columns, seed=options.seed,
                 progress=progress_bar)
    print(_table(d, record, unit), end="")
    if folder:
        folder.mkdir(exist_ok=True)
        sample = d.final.samples[d.final.best]
        sd = np.sqrt(sample.weight @ (sample.theta - d.final.theta)**2)
        # a uniform range of this half-width has that standard deviation
        h, added = as_simulated(d.final, d.scene, d.after.theta, np.sqrt(3.0) * sd)
        text = model_text(Model(dt, unit, (h,), ((*known, *added),)))
        answer = json.dumps(report(d, record), indent=1, allow_nan=False)
        _write(folder / "model.json", lambda stream: stream.write(text.encode()))
        _write(folder / "report.json", lambda stream: stream.write(answer.encode()))
        _save(_draw_diagnosis(plt, d, record, unit), folder / "report.png")
        print(f"{folder}: report.json, report.png, model.json")


def _list_effects(options):
    scene = None
    if options.record is not None:
        record = _read(options, None, None)
        scene = Scene(record.error, record.dt, record.columns)
        check_scene(*scene)
    print("y is the error, u its unit, t the time, T the duration, dt the sampling "
          "interval.\nThe prior of a size, slope, coefficient or amplitude is highest "
          "at 4 standard errors,\nfalls from there on and is 0 at 0.\n")
    print("\n".join(describe(effect, scene) for effect in CATALOGUE.values()))


def _with_effects(file, model, record):
    """Hypotheses of a model file with its processes and jumps, and its signatures."""
    if not model.effects:
        return model.hypotheses, ()
    added = model.effects[0]
    if any(other != added for other in model.effects):
        raise ValueError(f"the hypotheses of {file} have different effects: "
                         "diagnose takes one set for all")
    for one in added:
        name, kind = one.effect.name, one.effect.kind
        if kind == "reading":
            raise ValueError(f"{file} has {name}, which a record shows by itself: "
                             "take it out to diagnose one")
        if kind == "signature" and any(p.free for p in one.parameters.values()):
            raise ValueError(f"{name} of {file} has a range: diagnose needs a number")
        if one.column and one.column not in record.columns:
            raise ValueError(f"{name} of {file} needs a column {one.column}: beside "
                             f"the error is {', '.join(record.columns) or 'nothing'}")
    scene = Scene(record.error, record.dt, record.columns)
    return (tuple(with_processes(scene, h, added) for h in model.hypotheses),
            tuple(one for one in added if one.effect.kind == "signature"))


def _simulated(options, dt):
    """Records (L, N) of a black-box simulator."""
    file = pathlib.Path(options.simulated)
    if file.suffix.lower() == ".npz" and file.is_file():
        with _loaded(file, np.load) as archive:
            if "error" in archive.files and archive["error"].ndim == 2:
                own = float(archive["dt"]) if "dt" in archive.files else dt
                if abs(own - dt) > 0.01 * dt:
                    raise ValueError(f"{file} is sampled at {own:g} s, "
                                     f"the record at {dt:g} s")
                return np.asarray(archive["error"], float)
    simulated = read_record(file, "error", options.dt)
    if abs(simulated.dt - dt) > 0.01 * dt:
        raise ValueError(f"{file} is sampled at {simulated.dt:g} s, "
                         f"the record at {dt:g} s")
    return simulated.error[None]
