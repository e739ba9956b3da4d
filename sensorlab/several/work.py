"""One record of many: what it gives, as a row that can be kept as JSON."""

import functools
import pathlib
from typing import NamedTuple

import numpy as np

from sensorid import (
    Parameter, allan_deviation, allan_misfit, allan_variance, decide,
    default_hypotheses, estimate_state, identify, matrices, model_allan_variance)
from sensorlab.gap.augmented import augmented
from sensorlab.gap.blackbox import simulator_from
from sensorlab.gap.diagnosis import diagnose
from sensorlab.gap.draws import simulate_effects
from sensorlab.gap.effects import Scene
from sensorlab.gap.implied import as_simulated
from sensorlab.gap.members import Simulator
from sensorlab.gap.report import report
from sensorlab.modelfiles import Model, check_onsets, model_text
from sensorlab.pages import page, provenance
from sensorlab.units import quoted

DRAWN = 20    # records behind a band of Allan deviations
INDEX = "report.html"    # the page above those of many records


class Row(NamedTuple):
    """What one record of many gave."""

    file: str
    column: str
    unit: str = "u"
    problem: str = ""    # why there is no answer, in a sentence
    answer: dict = {}    # as --json or report.json of this record alone
    model: str = ""      # text of the model file
    curves: dict = {}    # tau, s, and Allan deviations by label
    heard: str = ""      # clock and columns beside it, in words
    page: str = ""       # of HTML, if it is asked for


def _heard(record):
    """Clock and columns of a record, in words."""
    return (record.clock or f"dt {record.dt:g} s") + (
        f"; beside it: {', '.join(record.columns)}" * bool(record.columns))


def failed(record, problem):
    """The row of a record that gave no answer."""
    return Row(record.file, record.column, getattr(record, "unit", "") or "u",
               " ".join(problem.split()))


def identified(record, hypotheses=None, report_units=None):
    """`Row` of `identify`. Hypotheses may be names of defaults; parameters are quoted
    in units of the field, unless these are None.
    """
    if hypotheses and isinstance(hypotheses[0], str):
        hypotheses = default_hypotheses(record.error, record.dt, hypotheses)
    posterior = identify(record.error, record.dt, hypotheses)
    best = posterior.best
    tau, deviation = allan_deviation(record.error, record.dt)
    m = np.round(tau / record.dt).astype(int)
    model = np.sqrt(model_allan_variance(
        best.hypothesis.filter(record.dt, best.mean), m))
    return Row(record.file, record.column, record.unit or "u", "",
               identification(record, posterior, report_units),
               posterior_model(record, posterior),
               dict(tau=tau, record=deviation, model=[model, model]), _heard(record))


def identification(record, posterior, report_units=None, misfit=None):
    """The answer of `identify` as JSON has it."""
    y, dt = record.error, record.dt
    misfit = misfit or allan_misfit(y, dt, posterior.best)
    chosen = decide(posterior)
    return dict(
        record=dict(file=record.file, column=record.column, samples=len(y), dt=dt),
        decision=None if chosen is None else
        posterior.estimates[chosen].hypothesis.name,
        hypotheses=[dict(
            name=e.hypothesis.name, probability=float(posterior.probability[k]),
            log_evidence=float(e.log_evidence),
            parameters={symbol: dict(mean=mean, sd=sd)
                        for symbol, mean, sd in estimated(e)},
            matrices=matrices(e, dt), nodes_per_sd=e.nodes_per_sd.tolist(),
            settled=e.settled)
            for k, e in enumerate(posterior.estimates)],
        allan_misfit=dict(tau=misfit.tau, ratio=misfit.ratio, sd=misfit.sd),
        described=misfit.described,
        quoted=[] if report_units is None else [q._asdict() for q in quoted(
            estimated(posterior.best), dt, record.unit, report_units)])


def estimated(e):
    """(symbol, mean, sd) of the parameters of an estimate."""
    return [(p.symbol, float(mean), float(sd)) for p, mean, sd in zip(
        e.hypothesis.parameters, e.mean, np.sqrt(np.diag(e.covariance)))]


def posterior_model(record, posterior):
    """Text of a model file of the most probable hypothesis, with ranges of two standard
    deviations to either side. If nobody has said how large a bias may be, it is as
    large as that of the record.
    """
    h = posterior.best.hypothesis
    if not h.bias_given:
        mean, cov = estimate_state(record.error, posterior.best, record.dt)
        h = h._replace(bias_given=True, bias_sigma=float(np.sqrt(
            mean[-1]**2 + cov[-1, -1])))
    narrow = h._replace(parameters=tuple(
        Parameter(p.symbol, max(p.low, mean - 2 * sd), min(p.high, mean + 2 * sd),
                  p.log) if p.free else p
        for p, (_, mean, sd) in zip(h.parameters, estimated(posterior.best))))
    return model_of(record, Simulator((narrow,)))


def model_of(record, simulator):
    """Text of a model file of a simulator that comes from a record."""
    return model_text(Model(record.dt, record.unit or "u", simulator,
                            pathlib.Path(record.file).name))


def diagnosed(record, simulator=None, simulated=None, seed=0, files=None):
    """`Row` of `diagnose`; `simulated` are records of the simulator, where these are
    what is known of it. With files as `provenance` takes them it has a page that leads
    back to INDEX.
    """
    y, dt, unit = record.error, record.dt, record.unit or "u"
    if simulated is not None:
        simulator = _described(simulated.tobytes(), len(simulated), dt)
    if isinstance(simulator, Simulator):
        check_onsets(simulator, Scene(y, dt, {}))
    d = diagnose(y, dt, simulator, record.columns, seed=seed)
    html = "" if files is None else page(
        d, record, unit, provenance(files, above=INDEX))
    return Row(record.file, record.column, unit, "", report(d, record),
               model_of(record, augmented(d)), _bands(d), _heard(record), html)


@functools.lru_cache(6)    # several records are often compared with the same
def _described(data, records, dt):
    return simulator_from(np.frombuffer(data).reshape(records, -1), dt)


def _bands(d):
    """Allan deviation of a record and the bands of simulated ones, before and after."""
    tau, deviation = allan_deviation(d.scene.y, d.scene.dt)
    m = np.round(tau / d.scene.dt).astype(int)
    curves = dict(tau=tau, record=deviation)
    for name, acc, gap in (("simulator", d.base, d.before), ("with what was found",
                                                             d.final, d.after)):
        if name == "simulator" or d.found:
            drawn = simulate_effects(as_simulated(acc, d.scene, gap.theta), d.scene,
                                     DRAWN, 1).error
            each = np.sqrt(allan_variance(drawn, d.scene.dt, m))
            curves[name] = np.nanquantile(each, [0.05, 0.95], axis=0)
    return curves
