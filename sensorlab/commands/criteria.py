"""python -m sensorid criteria"""

import csv
import io
import itertools

import numpy as np

from sensorid import check_targets, check_trials, criteria, record_length
from sensorlab.commands.progress import progress_bar
from sensorlab.commands.shared import (
    check_folder, check_outputs, refuse_effects, refuse_unused, targets, write_json,
    write_text)
from sensorlab.drawings import draw_criteria, draw_design, matplotlib_for_files, save
from sensorlab.modelfiles import read_model
from sensorlab.planning import at_condition
from sensorlab.rivals import ALGORITHMS
from sensorlab.tables import Table, show


def run(options):
    model = read_model(options.model)
    refuse_effects(options.model, model)
    check_outputs([options.model], options.csv, plot=options.plot, json=options.json)
    if options.checkpoint is not None:
        check_folder(options.checkpoint)
    if options.target is not None or options.target_rsd:
        return _targets_command(options, model)
    refuse_unused(options, "design", "csv", why="goes with --target or --target-rsd")
    plt = matplotlib_for_files() if options.plot else None
    result = criteria(model.simulator.hypotheses, model.dt, options.duration,
                      500 if options.trials is None else options.trials, options.seed,
                      algorithms=_algorithms(options.algorithms),
                      checkpoint=options.checkpoint, progress=progress_bar)
    if options.json:
        def by_label(parts):
            return dict(zip(result.labels, parts))
        write_json(options.json, dict(
            time=result.time, trials=result.trials, seed=options.seed, unit=model.unit,
            error_probability=result.error_probability._asdict(),
            rsd=by_label(c._asdict() for c in result.rsd),
            algorithms={name: {key: by_label(part) if isinstance(part, tuple) else part
                               for key, part in r._asdict().items()}
                        for name, r in result.rivals.items()}))
    if plt:
        save(draw_criteria(result), options.plot)
    _show(result, options, model)


def _show(result, options, model):
    """The criteria as tables."""
    _say_posterior(options, model)
    error = result.error_probability
    times = np.unique(np.linspace(0, len(result.time) - 1, 12).astype(int))
    show(f"{result.trials} trials of {options.duration:g} s at {model.dt:g} s, seed "
         f"{options.seed}; real / calculated, +- standard error",
         Table(("time, s", "error probability", *(f"RSD {label}"
                                                  for label in result.labels)), tuple(
             (f"{result.time[i]:.4g}", *(
                 f"{c.real[i]:.4f} / {c.calculated[i]:.4f} +- {c.real_se[i]:.4f}"
                 for c in (error, *result.rsd))) for i in times), (0,), keys=1))
    for name, r in result.rivals.items():
        show("", f"{name}, on the same trials; excess: over the Bayesian error "
             "probability; efficiency: Bayesian variance over its own",
             Table(("time, s", "error probability", "excess", *(
                 f"efficiency {label}" for label in result.labels)), tuple(
                 (f"{result.time[i]:.4g}", f"{r.error_probability[i]:.4f}",
                  f"{r.excess[i]:+.4f} +- {r.excess_se[i]:.4f}", *(
                      f"{e[i]:.2f} +- {se[i]:.2f}"
                      for e, se in zip(r.efficiency, r.efficiency_se)))
                 for i in times), (0,), keys=1))


def _say_posterior(options, model):
    if model.posterior_of:
        print(f"{options.model} is the posterior of {model.posterior_of}, not a prior: "
              "the criteria are those of a sensor that is known so well already")


def _algorithms(text):
    names = list(ALGORITHMS) if text == "all" else (text or "").split(",")
    unknown = [name for name in names if name and name not in ALGORITHMS]
    if unknown:
        raise ValueError(f"--algorithms {', '.join(unknown)}: choose from "
                         + ", ".join(ALGORITHMS) + ", or all")
    return {name: ALGORITHMS[name] for name in names if name}


def _targets_command(options, model):
    """How long must be recorded: one answer, or a table over conditions."""
    rsd = {name: value for name, (value, *_) in targets(
        "--target-rsd", options.target_rsd, most=1).items()}
    design = targets("--design", options.design)
    if set(design) - {"dt", "sigma_v"}:
        raise ValueError(f"--design {', '.join(design)}: dt and sigma_v can be varied")
    refuse_unused(options, "algorithms", why="goes with criteria, not with a target")
    if not design:
        refuse_unused(options, "plot",
                      why="goes with --design: a single answer is no picture")
    given = model.simulator.hypotheses
    conditions = [(sigma_v, *at_condition(given, model.dt, dt, sigma_v))
                  for dt, sigma_v in itertools.product(design.get("dt", [None]),
                                                       design.get("sigma_v", [None]))]
    trials = 4000 if options.trials is None else options.trials
    for _, hypotheses, interval in conditions:    # refuse them before the work
        check_targets(hypotheses, options.target, rsd)
        check_trials(hypotheses, interval, options.duration, trials)
    plt = matplotlib_for_files() if options.plot else None
    rows, lines = [], []
    for sigma_v, hypotheses, interval in conditions:
        answer = record_length(hypotheses, interval, options.duration, options.target,
                               rsd, trials, options.seed,
                               checkpoint=options.checkpoint, progress=progress_bar)
        varied = (f"{sigma_v:g}",) if sigma_v else ()
        for n in answer:
            rows.append(dict(dt=interval, sigma_v=sigma_v, **n._asdict()))
            found = (f"{n.duration:.4g} [{n.interval[0]:.4g}, {n.interval[1]:.4g}]"
                     if n.duration == n.duration else
                     f"not within {options.duration:g}, {n.reached:.4g} there")
            lines.append((f"{interval:g}", *varied, f"{n.label} {n.target:g}", found,
                          n.reason or ""))
    if options.json:
        write_json(options.json, dict(seed=options.seed, trials=trials, needed=rows))
    if options.csv:
        names = "dt", "sigma_v", "label", "target", "duration", "low", "high", "reached"
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(names)
        table.writerows(["" if v is None or v != v else v for v in (
            r["dt"], r["sigma_v"], r["label"], r["target"], r["duration"],
            *r["interval"], r["reached"])] for r in rows)
        write_text(options.csv, text.getvalue())
    if plt:
        save(draw_design(rows, options.duration, model.unit), options.plot)
    _say_posterior(options, model)
    white = (f"sigma_v, {model.unit} at {model.dt:g} s",) * ("sigma_v" in design)
    if not any(reason for *_, reason in lines):
        lines = [line[:-1] for line in lines]
    show(f"shortest record [95 % interval], {trials} trials of {options.duration:g} s "
         f"at most, seed {options.seed}",
         Table(("dt, s", *white, "wanted", "record, s", "why")[:len(lines[0])],
               tuple(lines)))
