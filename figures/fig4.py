"""Figure 4. Correlation time of the Markov process, three prior ranges in the ratio
1 : 5 : 25, no white noise. (a) RMS of the estimation error, s; (b) RSD against time
over the mean of tau_m: the three curves become one, as Eq. (22) depends on time over
tau_m alone."""

import functools

import matplotlib.pyplot as plt
import numpy as np

import figures
import sensorid

RANGES = (60.0, 300.0), (300.0, 1500.0), (1500.0, 7500.0)    # s


@functools.cache
def _compute(trials, dt):
    return [sensorid.criteria([figures.case(1, tau_m)[1]], dt, figures.DURATION, trials,
                              figures.SEED, progress=figures.size["progress"])
            for tau_m in RANGES]


def compute():
    """Criteria of the Markov hypothesis alone, one for each range."""
    return _compute(figures.size["trials"], figures.size["dt"])


def draw(results):
    fig, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.2))
    for colour, (low, high), c in zip(figures.COLOURS, RANGES, results):
        mean = 0.5 * (low + high)
        rsd = figures.curve(c, "markov.tau_m")
        rms = rsd._replace(**{part: getattr(rsd, part) * mean for part in (
            "real", "calculated", "real_se", "calculated_se")})
        name = rf"$\tau_m \in$ [{low / 60:g}, {high / 60:g}] min"
        figures.draw_pair(left, c.time, rms, colour, name)
        figures.draw_pair(right, c.time / mean, rsd, colour, name)
    left.set(xlabel="time, s", ylabel=r"RMS of the error of $\tau_m$, s", yscale="log",
             xscale="log", title="Figure 4a")
    right.set(xlabel=r"time / E{$\tau_m$}", ylabel=r"RSD of $\tau_m$", ylim=(0, None),
              xscale="log", title="Figure 4b")
    prior = np.diff(RANGES[0])[0] / np.sqrt(12) / np.mean(RANGES[0])
    right.axhline(prior, color="0.6", linestyle=":", label="prior")
    low, high = left.get_ylim()
    left.set_ylim(low, 6.0 * high)    # room for the legend
    left.legend(fontsize="small", loc="upper left", ncols=2)
    right.legend(fontsize="small")
    return fig


def main():
    figures.save(draw(compute()), "fig4")
