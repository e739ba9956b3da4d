"""python -m sensorid simulate"""

import numpy as np

from sensorid import write_whole
from sensorlab.commands.shared import check_outputs, read
from sensorlab.gap.diagnosis import check_columns
from sensorlab.gap.effects import Scene, simulate_effects
from sensorlab.modelfiles import read_model


def run(options):
    model = read_model(options.model, options.dt)
    check_outputs([options.model, options.like], options.out)
    if options.records < 1 or options.samples is not None and options.samples < 1:
        raise ValueError("--records and --samples must be at least 1")
    needed = sorted({one.column for _, effects in model.simulator.pairs
                     for one in effects} - {""})
    if needed and not options.like:
        raise ValueError(f"the effects of {options.model} need the column"
                         f"{'s' * (len(needed) > 1)} {', '.join(needed)}: "
                         "give a record that has them with --like")
    scene = Scene(np.zeros(options.samples or 0), model.dt, {})
    if options.like:
        options.record = options.like
        like = read(options, model, beside=needed)
        scene = Scene(like.error, model.dt, like.columns)
        check_columns(like.error, like.columns)
    trials = simulate_effects(model.simulator, scene, options.records, options.seed)
    names = np.array([h.name for h in model.simulator.hypotheses])
    write_whole(options.out, lambda stream: np.savez(
        stream, error=trials.error, dt=model.dt, hypothesis=names[trials.hypothesis],
        theta=trials.theta))
    print(f"{options.out}: error {trials.error.shape}, dt {model.dt:g} s")
