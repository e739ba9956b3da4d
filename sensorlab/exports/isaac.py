"""Noise of an observation, for Isaac Lab."""

import numpy as np

from sensorlab.exports.bound import averaging_times
from sensorlab.exports.text import Choice, export, jumps, readings, slow_and_fast


def isaac(axes, choice=Choice()):
    """Configurations of Isaac Lab's noise, in Python."""
    body = ["from isaaclab.utils.noise import "
            "GaussianNoiseCfg, NoiseModelWithAdditiveBiasCfg", ""]
    lost = []
    for axis in axes:
        slow, fast = slow_and_fast(axis, choice)
        white = np.sqrt(axis.parts[0]**2 + sum(p.drive**2 / (1.0 - p.a**2)
                                               for p in fast))
        lost += [*jumps(axis), *readings(axis)]
        if fast:
            lost.append(f"correlation times of the {axis.kind} below "
                        f"{0.1 * choice.horizon:g} s: white noise of the same variance "
                        "stands for them")
        if any(p.drive for p in slow):
            lost.append(f"the drift of the {axis.kind} within an episode: its root "
                        f"mean square over {choice.horizon:g} s stands in the bias")
        body += [f"{axis.kind} = NoiseModelWithAdditiveBiasCfg(",
                 f"    noise_cfg=GaussianNoiseCfg(mean=0.0, std={white:.9g}),",
                 "    bias_noise_cfg=GaussianNoiseCfg(mean=0.0, "
                 f"std={_bias(axis, slow, choice.horizon):.9g}, "
                 "operation=\"abs\"))"]
    return export(axes, (
        f"Convention: std is per observation, here every {axes[0].dt:g} s; the bias is "
        "drawn at every reset. With the operation \"add\", its default, it would be "
        "added to that of the episode before "
        "(isaaclab/utils/noise/noise_model.py)."), body, lost)


def _bias(axis, slow, horizon):
    """Root mean square of bias and slow processes, over the horizon from the start."""
    i = np.unique(np.linspace(1, averaging_times(axis, horizon)[-1], 500).astype(int))
    square = axis.bias**2
    for p in slow:
        grown = i if p.a == 1.0 else -np.expm1(2.0 * i * np.log(p.a)) / (1.0 - p.a**2)
        square += np.mean(p.a**(2.0 * i) * p.start**2 + p.drive**2 * grown)
    return float(np.sqrt(square))
