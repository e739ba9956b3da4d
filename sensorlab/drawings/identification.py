"""The picture of `identify`."""

import pathlib

import numpy as np

from sensorid import (
    GAMMA, MIN_SAMPLES, allan_deviation, identify, model_allan_variance)
from sensorlab.drawings.style import INK, legend_above, new_figure, styled


@styled
def draw_identify(record, posterior, unit):
    """Allan deviations of the record and of every hypothesis;
    probability against length.
    """
    y, dt = record.error, record.dt
    fig, (left, right) = new_figure(10.0, 4.4, 2)
    tau, adev = allan_deviation(y, dt, per_octave=2)
    left.loglog(tau, adev, ".-", color=INK, label="record")
    m = np.unique(np.geomspace(1, max(len(y) // 3, 1), 40).astype(int))
    lengths = [n for n in len(y) // 2**np.arange(6, -1, -1) if n >= MIN_SAMPLES
               and (~np.isnan(y[:n])).sum() >= MIN_SAMPLES
               and np.nanmin(y[:n]) < np.nanmax(y[:n])]
    hypotheses = [e.hypothesis for e in posterior.estimates]
    history = np.array([identify(y[:n], dt, hypotheses).probability for n in lengths])
    for k, e in enumerate(posterior.estimates):
        filt = e.hypothesis.filter(dt, e.mean)
        left.loglog(m * dt, np.sqrt(model_allan_variance(filt, m)), color=f"C{k}",
                    label=f"{e.hypothesis.name}, {posterior.probability[k]:.3f}")
        right.semilogx(np.array(lengths) * dt, history[:, k], "o-", color=f"C{k}",
                       label=e.hypothesis.name)
    right.axhline(GAMMA, color="0.6", linestyle=":", label=f"decided from {GAMMA} on")
    left.set(xlabel="averaging time, s", ylabel=f"Allan deviation, {unit}")
    right.set(xlabel="length of the record used, s", ylabel="probability",
              ylim=(-0.03, 1.03))
    legend_above(left, f"{pathlib.Path(record.file).name}, {record.column}")
    legend_above(right, "Probability of each error model")
    return fig
