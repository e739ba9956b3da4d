"""python -m sensorid identify"""

import pathlib

import numpy as np

from sensorid import (
    SUMMARY, allan_misfit, decided, default_hypotheses, identify, summary_rows)
from sensorlab.commands import compose
from sensorlab.commands.many import (
    answers, conclude, refuse_workers, write_answers, write_models, write_picture,
    write_table)
from sensorlab.commands.progress import progress_bar
from sensorlab.commands.shared import (
    as_quoted, check_outputs, hypothesis_names, read_each, refuse_effects, report_units,
    write_json, write_text)
from sensorlab.drawings import draw_identify, matplotlib_for_files, save
from sensorlab.modelfiles import read_model
from sensorlab.several.work import (
    estimated, identification, identified, posterior_model)
from sensorlab.tables import Table, show
from sensorlab.units import quote_table


def run(options):
    if options.compose:
        return compose.run(options)
    model = read_model(options.model, options.dt) if options.model else None
    refuse_effects(options.model, model)
    names = hypothesis_names(options)
    check_outputs([*options.records, options.model], options.save_model,
                  options.csv, plot=options.plot, json=options.json)
    plt = matplotlib_for_files() if options.plot else None
    records = read_each(options, model)
    refuse_workers(options, records)
    if len(records) == 1 and options.csv is None and options.checkpoint is None:
        return _one(options, model, *records, names, plt)
    hypotheses = model.simulator.hypotheses if model else names
    several = answers(options, [
        (identified, record, hypotheses, report_units(options, record))
        for record in records], usual=1)    # whose filters use all cores
    try:
        if options.json:
            write_answers(options.json, several)
        if options.csv:
            write_table(options.csv, several)
        if options.save_model:
            write_models(pathlib.Path(options.save_model).with_suffix(""), several)
        if plt:
            write_picture(options.plot, several)
    finally:    # a file that cannot be written loses no answer
        conclude(several)


def _one(options, model, record, names, plt):
    """The record that is alone, at length."""
    y, dt, unit = record.error, record.dt, record.unit
    hypotheses = (model.simulator.hypotheses if model else
                  default_hypotheses(y, dt, names))
    posterior = identify(y, dt, hypotheses, progress=progress_bar)
    misfit = allan_misfit(y, dt, posterior.best)
    try:
        if options.json:
            write_json(options.json, identification(
                record, posterior, report_units(options, record), misfit))
        if options.save_model:
            write_text(options.save_model, posterior_model(record, posterior))
        if plt:
            save(draw_identify(record, posterior, unit), options.plot)
    finally:    # a file that cannot be written loses no answer
        _show(options, model, record, posterior, misfit)


def _show(options, model, record, posterior, misfit):
    """What is known of one record."""
    y, dt, unit, best = record.error, record.dt, record.unit, posterior.best
    quotes = as_quoted(estimated(best), record, options)
    show(f"{record.heading}, {dt * len(y):g} s; {np.isnan(y).sum()} missing",
         Table(SUMMARY, tuple(summary_rows(posterior, unit)), (1,)),
         decided(posterior), misfit.sentence)
    if not (misfit.described or model):
        print("identify --compose says what its noise is the sum of")
    if quotes:
        show(f"{best.hypothesis.name}:", quote_table(quotes))
