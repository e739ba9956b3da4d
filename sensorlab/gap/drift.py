"""Drift: what a gap costs whoever integrates the sensor's output."""

from typing import NamedTuple

import numpy as np

from sensorid import side_by_side
from sensorlab.gap.draws import simulate_effects
from sensorlab.gap.effects import BLOCK

HORIZONS = 1.0, 10.0, 60.0, 600.0    # s
MIN_WINDOWS = 4    # of a horizon, in a record
RECORDS = 40       # simulated records of which the middle one counts


class Drift(NamedTuple):
    """rms of the error integrated over a horizon, its mean over the record less: u s.
    """

    horizon: float         # s
    record: float
    simulator: float       # the middle one of RECORDS simulated records
    with_effects: float


def drift(scene, simulators, seed=0):
    """`Drift` at every horizon of HORIZONS that a record has four of, of a record and
    of its simulators without and with what was found; what is known is in all of them.
    """
    lengths = [round(h / scene.dt) for h in HORIZONS]
    lengths = [m for m in lengths if 1 <= m <= len(scene.y) // MIN_WINDOWS]
    own = integrated(scene.y[None] + scene.known, scene.dt, lengths)[0]
    drawn = []
    for simulator in simulators:
        block = int(np.clip(BLOCK // len(scene.y), 1, RECORDS // 2))

        def of_some(first, simulator=simulator, block=block):
            return integrated(simulate_effects(
                simulator, scene, min(block, RECORDS - first), seed, first
            ).error + scene.known, scene.dt, lengths)
        drawn.append(np.median(np.vstack(side_by_side(of_some, range(
            0, RECORDS, block))), 0))
    return tuple(Drift(m * scene.dt, *map(float, values))
                 for m, *values in zip(lengths, own, *drawn))


def integrated(y, dt, lengths):
    """rms (R, len(lengths)) of records (R, N) less their means, integrated over windows
    of so many samples that follow one another; a missing sample adds nothing.
    """
    y = np.nan_to_num(y - np.nanmean(y, axis=1, keepdims=True))
    result = [dt * np.sqrt(np.mean(np.add.reduceat(
        y[:, :y.shape[1] // m * m], np.arange(0, y.shape[1] // m * m, m), axis=1)**2,
        axis=1)) for m in lengths]
    return np.column_stack(result) if result else np.empty((len(y), 0))
