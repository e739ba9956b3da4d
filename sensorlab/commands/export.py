"""python -m sensorid export"""

import sys

from sensorlab.commands.shared import check_outputs, write_text
from sensorlab.exports import TARGETS
from sensorlab.exports.axis import axis
from sensorlab.exports.text import Choice
from sensorlab.modelfiles import read_model


def run(options):
    check_outputs(options.models, options.out)
    axes = []
    for file in options.models:
        model = read_model(file, options.dt)
        try:
            axes.append(axis(model, options.unit, options.duration))
        except ValueError as problem:
            raise ValueError(f"{file}: {problem}") from None
    kinds = [a.kind for a in axes]
    if len(set(kinds)) < len(kinds):
        raise ValueError(f"two models of a {kinds[0]}: one of a gyroscope and one of "
                         "an accelerometer can stand in a file")
    if max(a.dt for a in axes) > 1.001 * min(a.dt for a in axes):
        raise ValueError("the models are for dt = "
                         + " and ".join(f"{a.dt:g} s" for a in axes)
                         + ": one file has one rate")
    result = TARGETS[options.to](axes, Choice(options.pair, options.horizon))
    if options.out is None:
        print(result.text, end="")
    else:
        write_text(options.out, result.text)
        print(f"{options.out}: for {options.to}")
    for lost in result.lost:
        print(f"sensorid: lost in {options.to}: {lost}", file=sys.stderr)
