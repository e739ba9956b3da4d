"""python -m sensorid export"""

import sys

from sensorlab.commands.shared import (
    check_outputs, refuse_interval, refuse_unused, write_text)
from sensorlab.exports import TARGETS
from sensorlab.exports.axis import axis
from sensorlab.exports.text import Choice
from sensorlab.modelfiles import read_model


def run(options):
    check_outputs(options.models, options.out)
    if options.to in ("numpy", "ros", "isaac"):
        refuse_unused(options, "pair", why=f"does nothing for {options.to}: it knows "
                                           "more than two numbers, or fewer")
    if options.to == "numpy":
        refuse_unused(options, "horizon", why="does nothing for numpy: it gets the "
                                              "whole model")
    axes, flicker = [], False
    for file in options.models:
        model = read_model(file, options.dt)
        refuse_interval(file, model, options.dt)
        flicker |= any(one.name == "bias_instability" for _, effects in
                       model.simulator.pairs for one in effects)
        try:
            axes.append(axis(model, options.unit, 3600.0 if options.duration is None
                             else options.duration))
        except ValueError as problem:
            raise ValueError(f"{file}: {problem}") from None
    if not flicker:
        refuse_unused(options, "duration", why="goes with a bias_instability: no model "
                                               "has one")
    kinds = [a.kind for a in axes]
    if len(set(kinds)) < len(kinds):
        raise ValueError(f"two models of a {kinds[0]}: one of a gyroscope and one of "
                         "an accelerometer can stand in a file")
    if max(a.dt for a in axes) > 1.001 * min(a.dt for a in axes):
        raise ValueError("the models are for dt = "
                         + " and ".join(f"{a.dt:g} s" for a in axes)
                         + ": one file has one rate")
    result = TARGETS[options.to](axes, Choice(
        options.pair or "bound", 60.0 if options.horizon is None else options.horizon))
    if options.out is None:
        print(result.text, end="")
    else:
        write_text(options.out, result.text)
        print(f"{options.out}: for {options.to}")
    for lost in result.lost:
        print(f"sensorid: lost in {options.to}: {lost}", file=sys.stderr)
