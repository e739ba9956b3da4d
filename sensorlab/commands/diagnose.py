"""python -m sensorid diagnose"""

import pathlib

from sensorlab.commands.many import (
    answers, conclude, refuse_workers, write_answers, write_models, write_pages,
    write_picture, write_table)
from sensorlab.commands.progress import progress_line, say_beforehand
from sensorlab.commands.shared import (
    RECORDED, as_quoted, check_folder, check_outputs, covariates_of, read_each,
    refuse_unused, simulated_records, write_json, write_text)
from sensorlab.drawings import draw_diagnosis, matplotlib_for_files, save
from sensorlab.gap.augmented import augmented
from sensorlab.gap.blackbox import simulator_from
from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.costs import forewarning
from sensorlab.gap.curves import view
from sensorlab.gap.diagnosis import diagnose
from sensorlab.gap.effects import Scene, describe
from sensorlab.gap.known import check_scene, default_simulator
from sensorlab.gap.report import report
from sensorlab.gap.words import told
from sensorlab.modelfiles import check_onsets, read_model
from sensorlab.pages import page, provenance
from sensorlab.readers import Unread, unread
from sensorlab.several.work import diagnosed, model_of
from sensorlab.tables import show
from sensorlab.units import quote_table


def run(options):
    if options.effects:
        return _list_effects(options)
    if not options.records:
        raise ValueError("diagnose needs a record (--effects alone does without)")
    model = read_model(options.model, options.dt) if options.model else None
    folder = _checked_folder(options)
    if folder:
        matplotlib_for_files()
    records = read_each(options, model, covariates_of(options))
    refuse_workers(options, records)
    _say_axes(records)
    if len(records) == 1 and options.checkpoint is None:
        return _one(options, model, *records, folder)
    several = answers(options, [_call(options, model, record) for record in records])
    try:
        if folder:
            folder.mkdir(exist_ok=True)
            write_answers(folder / "report.json", several)
            write_table(folder / "table.csv", several)
            write_models(folder / "model", several)
            write_picture(folder / "report.png", several)
            write_pages(folder, several, options.typed)
    finally:    # a file that cannot be written loses no answer
        conclude(several)
    if folder:
        print(f"{folder}: report.html, report.NAME.html, report.png, report.json, "
              "table.csv, model.NAME.json")


def _call(options, model, record):
    """Work for one of several records."""
    simulated = None
    if options.simulated and not isinstance(record, Unread):
        try:
            simulated = simulated_records(options, record)
        except (ValueError, OSError) as problem:
            record = unread(record.file, record.column, problem)
    return (diagnosed, record, model and model.simulator, simulated, options.seed,
            _files(options, record) if options.out else None)


def _files(options, record):
    """What a diagnosis is made from: what each file is, and its name."""
    return (("record", record.file), ("simulator", options.model),
            ("simulated records", options.simulated))


def _one(options, model, record, folder):
    """The record that is alone, at length."""
    unit = record.unit
    try:
        check_scene(record.error, record.dt, record.columns)
    except ValueError as problem:
        raise ValueError(f"{record.file}: {problem}") from None
    simulated = simulated_records(options, record) if options.simulated else None
    simulator = _simulator(model, simulated, record)
    try:
        say_beforehand(forewarning(len(record.error), len(record.columns)))
        check_onsets(simulator, Scene(record.error, record.dt, {}))
        with progress_line() as progress:
            d = diagnose(record.error, record.dt, simulator, record.columns,
                         seed=options.seed, progress=progress)
    except ValueError as problem:
        raise ValueError(f"{options.model or record.file}: {problem}") from None
    simulator = augmented(d)
    (h,) = simulator.hypotheses
    quotes = as_quoted([(p.symbol, p.mean, p.sd) for p in h.parameters], record,
                       options)
    try:
        if folder:
            _write(folder, options, d, record, simulator)
    finally:    # a file that cannot be written loses no answer
        show(*told(d, record, unit))
        if quotes:
            show(f"{h.name}:", quote_table(quotes))
    if folder:
        print(f"{folder}: report.html, report.png, report.json, model.json")


def _write(folder, options, d, record, simulator):
    """The files of a diagnosis, and of the simulator with what was found."""
    folder.mkdir(exist_ok=True)
    write_text(folder / "model.json", model_of(record, simulator))
    write_json(folder / "report.json", report(d, record))
    seen = view(d)
    save(draw_diagnosis(d, seen, record, record.unit), folder / "report.png")
    write_text(folder / "report.html", page(
        d, record, record.unit, provenance(_files(options, record), options.typed),
        seen))


def _say_axes(records):
    """Which columns are not taken as covariates, once."""
    found = [record for record in records if not isinstance(record, Unread)]
    axes = {name for record in found for name in record.axes}
    axes = [name for name in dict.fromkeys(
        name for record in found for name in (record.column, *record.axes))
        if name in axes]    # in the order of the file
    if axes:
        print(f"other axes are no covariates of an axis ({', '.join(axes)}): "
              "--covariates takes them")


def _checked_folder(options):
    """The folder of --out, if it can be written; None without."""
    if options.out is None:
        return None
    folder = pathlib.Path(options.out)
    check_folder(folder)
    if folder.is_dir():
        check_outputs([*options.records, options.model, options.simulated],
                      *(folder / name for name in (
                          "report.html", "report.json", "report.png", "model.json",
                          "table.csv")))
    return folder


def _simulator(model, simulated, record):
    """What the record is compared with."""
    if model:
        return model.simulator
    if simulated is not None:
        return simulator_from(simulated, record.dt)
    return default_simulator(record.error, record.dt)


def _list_effects(options):
    refuse_unused(options, "model", "simulated", "covariates", "out", "checkpoint",
                  "workers", "seed", "report", why="does nothing beside --effects")
    scene = None
    if options.records:
        records = read_each(options, beside=None)
        if len(records) > 1:
            raise ValueError(f"--effects takes one record, not {len(records)}")
        scene = Scene(records[0].error, records[0].dt, records[0].columns)
        check_scene(scene.y, scene.dt, scene.columns)
    else:
        refuse_unused(options, *RECORDED, "unit", "scale", why="goes with a record")
    print("y is the error, u its unit, t the time, T the duration, dt the sampling "
          "interval.\nThe prior of a size, slope, coefficient or amplitude is highest "
          "at 4 standard errors,\nfalls from there on and is 0 at 0.\n")
    print("\n".join(describe(effect, scene) for effect in CATALOGUE.values()))
