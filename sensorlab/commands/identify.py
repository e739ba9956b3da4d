"""python -m sensorid identify"""

import pathlib

import numpy as np

from sensorid import (
    MODELS, SUMMARY, Parameter, allan_misfit, decide, decided, default_hypotheses,
    identify, matrices, summary_rows)
from sensorlab.commands import compose
from sensorlab.commands.shared import (
    as_quoted, check_outputs, in_unit, progress_bar, read, refuse_effects, write_json,
    write_text)
from sensorlab.drawings import draw_identify, matplotlib_for_files, save
from sensorlab.gap.effects import Simulator
from sensorlab.modelfiles import Model, model_text, read_model
from sensorlab.tables import Table, show
from sensorlab.units import quote_table


def run(options):
    if options.compose:
        return compose.run(options)
    model = read_model(options.model, options.dt) if options.model else None
    refuse_effects(options.model, model)
    if model and options.hypotheses is not None:
        raise ValueError("--hypotheses names defaults and --model brings its own: "
                         "give one of them")
    check_outputs([options.record, options.model], options.json, options.save_model,
                  plot=options.plot)
    plt = matplotlib_for_files() if options.plot else None
    record, unit = in_unit(read(options, model), options, model)
    y, dt = record.error, record.dt
    names = ("white_noise,random_walk,markov" if options.hypotheses is None
             else options.hypotheses)
    names = MODELS if names == "all" else names.split(",")
    hypotheses = (model.simulator.hypotheses if model else
                  default_hypotheses(y, dt, names))
    posterior = identify(y, dt, hypotheses, progress=progress_bar)
    misfit = allan_misfit(y, dt, posterior.best)

    best = posterior.best
    quotes = as_quoted([(p.symbol, *part) for p, *part in zip(
        best.hypothesis.parameters, best.mean, np.sqrt(np.diag(best.covariance)))],
        dt, unit, options)
    chosen = decide(posterior)
    result = dict(
        record=dict(file=record.file, column=record.column, samples=len(y), dt=dt),
        decision=None if chosen is None else hypotheses[chosen].name,
        hypotheses=[dict(
            name=e.hypothesis.name, probability=float(posterior.probability[k]),
            log_evidence=float(e.log_evidence),
            parameters={p.symbol: dict(mean=float(m), sd=float(sd)) for p, m, sd in zip(
                e.hypothesis.parameters, e.mean, np.sqrt(np.diag(e.covariance)))},
            matrices=matrices(e, dt), nodes_per_sd=e.nodes_per_sd.tolist(),
            settled=e.settled)
            for k, e in enumerate(posterior.estimates)],
        allan_misfit=dict(tau=misfit.tau, ratio=misfit.ratio, sd=misfit.sd),
        quoted=[q._asdict() for q in quotes])
    if options.json:
        write_json(options.json, result)
    if options.save_model:
        write_text(options.save_model, model_text(Model(
            dt, unit, Simulator((_narrowed(posterior.best),)),
            pathlib.Path(record.file).name)))
    if plt:
        save(draw_identify(record, posterior, unit), options.plot)
    show(f"{record.heading}, {dt * len(y):g} s; {np.isnan(y).sum()} missing",
         Table(SUMMARY, tuple(summary_rows(posterior, unit)), (1,)),
         decided(posterior), misfit.sentence)
    if "no hypothesis describes" in misfit.sentence and not model:
        print("identify --compose says what its noise is the sum of")
    if quotes:
        print(f"{best.hypothesis.name}, as data sheets quote it:\n"
              + quote_table(quotes))


def _narrowed(e):
    """The hypothesis of an estimate with ranges of two standard deviations to
    either side.
    """
    sds = np.sqrt(np.diag(e.covariance))
    return e.hypothesis._replace(parameters=tuple(
        Parameter(p.symbol, max(p.low, m - 2 * sd), min(p.high, m + 2 * sd), p.log)
        if p.free else p
        for p, m, sd in zip(e.hypothesis.parameters, e.mean, sds)))
