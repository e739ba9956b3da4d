"""python -m sensorid identify --compose"""

from sensorlab.commands.progress import progress_line
from sensorlab.commands.shared import (
    check_outputs, read_each, refuse_unused, write_json, write_text)
from sensorlab.drawings import draw_diagnosis, matplotlib_for_files, save
from sensorlab.gap.augmented import augmented
from sensorlab.gap.curves import view
from sensorlab.gap.diagnosis import diagnose
from sensorlab.gap.report import report
from sensorlab.gap.words import described
from sensorlab.several.work import model_of
from sensorlab.tables import show


def run(options):
    """The error model of a record as a sum: a hypothesis and the effects it needs."""
    refuse_unused(options, "model", "hypotheses", "report", "csv", "checkpoint",
                  "workers",
                  why="does nothing beside --compose, which finds the sum by itself")
    check_outputs(options.records, options.save_model, plot=options.plot,
                  json=options.json)
    plt = matplotlib_for_files() if options.plot else None
    records = read_each(options)
    if len(records) > 1:
        raise ValueError(f"--compose takes one record at a time, not {len(records)}: "
                         "diagnose takes several")
    (record,), unit = records, records[0].unit
    with progress_line() as progress:
        d = diagnose(record.error, record.dt, progress=progress)
    simulator = augmented(d)
    (h,) = simulator.hypotheses
    try:
        if options.json:
            write_json(options.json, {
                **{key: value for key, value in report(d, record).items()
                   if key in ("record", "found", "gap")},
                "hypothesis": dict(name=h.name, parameters={
                    p.symbol: dict(mean=p.mean, sd=p.sd) for p in h.parameters})})
        if options.save_model:
            write_text(options.save_model, model_of(record, simulator))
        if plt:
            save(draw_diagnosis(d, view(d), record, unit), options.plot)
    finally:    # a file that cannot be written loses no answer
        show(record.heading, *described(d, h, unit))
