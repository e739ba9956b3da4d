"""Scaling. Time of the criteria of case 3 against the number of trials, samples and
nodes; the exponents are slopes of a straight line through the logarithms."""

import time

import matplotlib.pyplot as plt
import numpy as np

import figures
import sensorid

BASE = dict(trials=256, samples=10000, nodes=24)    # nodes an axis: 600 in all
FACTORS = 1, 2, 4, 8


def _seconds(trials, samples, nodes):
    H = figures.case(3)
    grids = [sensorid.grid(h, 0.1, nodes) for h in H]
    started = time.perf_counter()
    sensorid.criteria(H, 0.1, 0.1 * samples, trials, figures.SEED, grids=grids,
                      times=[0.1 * samples])
    return time.perf_counter() - started


def compute():
    """For trials, samples and nodes: (value, s) rows."""
    _seconds(64, 100, 8)
    result = {}
    for name in ("trials", "samples"):
        values = [BASE[name] * f for f in FACTORS]
        result[name] = np.array([(v, _seconds(**{**BASE, name: v})) for v in values])
    sides = [24, 34, 48, 68]
    result["nodes"] = np.array([(side + side**2, _seconds(**{**BASE, "nodes": side}))
                                for side in sides])
    return result


def exponents(result):
    """Slopes of ln time over ln value."""
    return {name: np.polyfit(*np.log(rows.T), 1)[0] for name, rows in result.items()}


def draw(result):
    fig, ax = plt.subplots()
    slopes = exponents(result)
    for colour, (name, rows) in zip(figures.COLOURS, result.items()):
        ax.loglog(rows[:, 0] / rows[0, 0], rows[:, 1], "o-", color=colour,
                  label=f"{name} from {rows[0, 0]:g}: exponent {slopes[name]:.2f}")
    ax.set(xlabel="factor", ylabel="time of the criteria, s",
           title=f"case 3, from {BASE['trials']} trials, {BASE['samples']} samples, "
                 f"{BASE['nodes'] + BASE['nodes']**2} nodes")
    ax.legend()
    return fig


def main():
    result = compute()
    for name, slope in exponents(result).items():
        print(f"time ~ {name}^{slope:.2f}")
    figures.save(draw(result), "scaling")
