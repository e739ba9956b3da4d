"""python -m sensorid simulate"""

import pathlib

import numpy as np

from sensorid import write_whole
from sensorlab.commands.shared import (
    RECORDED, check_memory, check_outputs, covariates_of, read, refuse_interval,
    refuse_unused)
from sensorlab.gap.draws import simulate_effects
from sensorlab.gap.effects import Scene
from sensorlab.gap.known import check_columns
from sensorlab.modelfiles import check_onsets, read_model


def run(options):
    model = read_model(options.model, options.dt)
    check_outputs([options.model, options.like], options.out)
    if pathlib.Path(options.out).suffix.lower() not in ("", ".npz"):
        raise ValueError(f"{options.out}: simulated records are arrays of a .npz file; "
                         f"name it {pathlib.Path(options.out).stem}.npz")
    needed = sorted({name for _, effects in model.simulator.pairs
                     for one in effects for name in one.needs})
    if options.like:
        options.record = options.like
        like = read(options, model, beside=_placed(needed, covariates_of(options)))
        scene = Scene(like.error, model.dt, like.columns)
        check_columns(like.error, like.columns)
        check_memory(len(like.error), options.records)
    else:
        refuse_unused(options, "covariates", *(
            name for name in RECORDED if name != "dt"),
                      why="goes with --like: no record is read here")
        refuse_interval(options.model, model, options.dt)
        if needed:
            raise ValueError(f"the effects of {options.model} need the column"
                             f"{'s' * (len(needed) > 1)} {', '.join(needed)}: "
                             "give a record that has them with --like")
        check_memory(options.samples, options.records)
        scene = Scene(np.zeros(options.samples), model.dt, {})
    check_onsets(model.simulator, scene)
    trials = simulate_effects(model.simulator, scene, options.records, options.seed)
    names = np.array([h.name for h in model.simulator.hypotheses])
    write_whole(options.out, lambda stream: np.savez(
        stream, error=trials.error, dt=model.dt, hypothesis=names[trials.hypothesis],
        theta=trials.theta))
    print(f"{options.out}: error {trials.error.shape}, dt {model.dt:g} s")


def _placed(needed, covariates):
    """Names of columns that are needed, as NAME=COLUMN where a list says so."""
    placed = {part.partition("=")[0].strip(): part for part in covariates or ()}
    for name in placed:
        if name not in needed:
            raise ValueError(f"--covariates {placed[name]}: the effects of the model "
                             f"need {', '.join(needed) or 'no column'}")
    return [placed.get(name, name) for name in needed]
