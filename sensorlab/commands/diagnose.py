"""python -m sensorid diagnose"""

import pathlib

from sensorid import default_hypotheses
from sensorlab.commands.shared import (
    as_quoted, check_outputs, in_unit, progress_bar, read, refuse_unused,
    simulated_records, write_json, write_text)
from sensorlab.drawings import draw_diagnosis, matplotlib_for_files, save
from sensorlab.gap.blackbox import simulator_from
from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.curves import view
from sensorlab.gap.diagnosis import augmented, check_scene, diagnose
from sensorlab.gap.effects import Scene, Simulator, describe
from sensorlab.gap.report import report
from sensorlab.gap.words import told
from sensorlab.modelfiles import Model, check_onsets, model_text, read_model
from sensorlab.pages import page, provenance
from sensorlab.tables import show
from sensorlab.units import quote_table


def run(options):
    if options.effects:
        refuse_unused(options, "model", "simulated", "covariates", "out",
                      why="does nothing beside --effects")
        if options.record is None:
            refuse_unused(options, "column", "dt", "resample", "allow_missing",
                          why="goes with a record")
        return _list_effects(options)
    if options.record is None:
        raise ValueError("diagnose needs a record (--effects alone does without)")
    model = read_model(options.model, options.dt) if options.model else None
    folder = _checked_folder(options)
    if folder:
        matplotlib_for_files()
    beside = None if options.covariates is None else [
        part for part in options.covariates.split(",") if part]
    record, unit = in_unit(read(options, model, beside), options, model)
    simulated = simulated_records(options, record.dt) if options.simulated else None
    simulator = _simulator(model, simulated, record)
    try:
        check_onsets(simulator, Scene(record.error, record.dt, {}))
        d = diagnose(record.error, record.dt, simulator, record.columns,
                     seed=options.seed, progress=progress_bar, simulated=simulated)
    except ValueError as problem:
        raise ValueError(f"{options.model or record.file}: {problem}") from None
    simulator = augmented(d)
    (h,) = simulator.hypotheses
    quotes = as_quoted([(p.symbol, p.mean, p.sd) for p in h.parameters], record.dt,
                       unit, options)
    if folder:
        folder.mkdir(exist_ok=True)
        write_text(folder / "model.json",
                   model_text(Model(record.dt, unit, simulator,
                                    pathlib.Path(record.file).name)))
        write_json(folder / "report.json", report(d, record))
        seen, files = view(d), [("record", record.file), ("simulator", options.model),
                                ("simulated records", options.simulated)]
        save(draw_diagnosis(d, seen, record, unit), folder / "report.png")
        write_text(folder / "report.html", page(
            d, record, unit, provenance(files, options.typed), seen))
    show(*told(d, record, unit))
    if quotes:
        print(f"{h.name}, as data sheets quote it:\n" + quote_table(quotes))
    if folder:
        print(f"{folder}: report.html, report.png, report.json, model.json")


def _checked_folder(options):
    """The folder of --out, if it can be written; None without."""
    if options.out is None:
        return None
    folder = pathlib.Path(options.out)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is a file: a folder is needed")
    check_outputs([], *([folder / "report.json"] if folder.is_dir() else [folder]))
    check_outputs([options.record, options.model, options.simulated],
                  *(folder / name for name in (
                      "report.html", "report.json", "model.json") if folder.is_dir()))
    return folder


def _simulator(model, simulated, record):
    """What the record is compared with."""
    if model:
        return model.simulator
    if simulated is not None:
        return simulator_from(simulated, record.dt)
    return Simulator(default_hypotheses(record.error, record.dt))


def _list_effects(options):
    scene = None
    if options.record is not None:
        record = read(options, None, None)
        scene = Scene(record.error, record.dt, record.columns)
        check_scene(scene.y, scene.dt, scene.columns)
    print("y is the error, u its unit, t the time, T the duration, dt the sampling "
          "interval.\nThe prior of a size, slope, coefficient or amplitude is highest "
          "at 4 standard errors,\nfalls from there on and is 0 at 0.\n")
    print("\n".join(describe(effect, scene) for effect in CATALOGUE.values()))
