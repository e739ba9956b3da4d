"""Audit. The error probability after 2000 s, of which the paper prints three values (0,
2 and 10 %), against what it leaves unsaid: the sampling interval, the prior of the
initial state and the grid. On a coarse grid the real and the calculated probability
part."""

import functools

import matplotlib.pyplot as plt
import numpy as np

import figures
import sensorid
from figures.table import paper

def markov_from_zero(dt, tau_m, sigma_m, sigma_v=0.0):
    """A Markov process that starts at 0, as the random walk does."""
    m = sensorid.markov(dt, tau_m, sigma_m, sigma_v)
    return m._replace(P0=0.0 * m.P0)


INTERVALS = 1.0, 0.5, 0.2, 0.1     # s
PRIORS = {"bias 0.1 u": dict(bias_sigma=0.1), "bias 1 u": dict(),
          "bias 10 u": dict(bias_sigma=10.0),
          "Markov from 0": dict(markov=markov_from_zero)}
NODES = 3, 4, 5, 6, 8, 12, 16         # an axis, evenly spaced as in the paper
CASES = 1, 2, 3


@functools.cache
def _error(number, dt, nodes=None, **change):
    """Real and calculated error probability after 2000 s with standard errors.

    `nodes` evenly spaced ones an axis, or as many as resolve the posterior.
    """
    hypotheses = figures.case(number, **change)
    grids = nodes and [sensorid.uniform_grid(h, dt, nodes) for h in hypotheses]
    c = sensorid.criteria(hypotheses, dt, figures.DURATION, figures.size["trials"],
                          figures.SEED, times=[figures.DURATION], grids=grids,
                          progress=figures.size["progress"]).error_probability
    return c.real[0], c.calculated[0], c.real_se[0], c.calculated_se[0]


def compute():
    """Error probabilities [condition, case, (real, calculated, their standard
    errors)]."""
    dt = figures.size["dt"]
    intervals = [[_error(n, step) for n in CASES] for step in INTERVALS if step >= dt]
    priors = [[_error(n, dt, **change) for n in CASES] for change in PRIORS.values()]
    nodes = [[_error(n, dt, count) for n in (2, 3)] for count in NODES]
    return np.array(intervals), np.array(priors), np.array(nodes)


def draw(intervals, priors, nodes):
    fig, (left, middle, right) = plt.subplots(1, 3, figsize=(12.0, 4.4), sharey=True)
    steps = INTERVALS[:len(intervals)]
    for ax, x, values, cases in ((left, steps, intervals, CASES),
                                 (middle, np.arange(len(PRIORS)), priors, CASES),
                                 (right, NODES, nodes, (2, 3))):
        for column, number in enumerate(cases):
            colour = figures.COLOURS[number - 1]
            real, calculated, real_se, calculated_se = values[:, column].T
            ax.errorbar(x, real, real_se, fmt="o-", color=colour, capsize=3,
                        label=f"case {number}, real")
            ax.errorbar(x, calculated, calculated_se, fmt="s--", color=colour,
                        capsize=3, label=f"case {number}, calculated",
                        markerfacecolor="white")
        for number in CASES:
            ax.axhline(paper(f"error_case{number}").value,
                       color=figures.COLOURS[number - 1], linestyle=":", linewidth=1.5)
    left.plot([], [], ":", color="0.4", label="printed in the paper")
    left.set(xscale="log", xlabel="sampling interval, s", xticks=steps,
             xticklabels=steps,
             ylabel=f"error probability after {figures.DURATION:g} s",
             title="sampling interval")
    left.minorticks_off()
    middle.set(xticks=range(len(PRIORS)),
               xlabel="standard deviation of the bias, or start of the process",
               title=f"prior of the initial state, dt = {figures.size['dt']:g} s")
    middle.set_xticklabels(PRIORS, rotation=15)
    right.set(xscale="log", xlabel="nodes an axis, evenly spaced", xticks=NODES,
              xticklabels=NODES, title=f"grid, dt = {figures.size['dt']:g} s")
    right.minorticks_off()
    left.legend(fontsize="small")
    return fig


def main():
    figures.save(draw(*compute()), "audit")
