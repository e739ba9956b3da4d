"""What Figures 1-3 have in common: (a) error probability, (b) Allan deviations of
samples."""

import matplotlib.pyplot as plt
import numpy as np

import figures
import sensorid


def allan_curves(examples):
    """Averaging times, s, Allan deviation of one 2000 s sample and its expectation,
    u."""
    dt, samples = figures.size["dt"], round(figures.DURATION / figures.size["dt"])
    result = []
    for number, (model, parameters) in enumerate(examples):
        h = sensorid.hypothesis(model, bias_sigma=figures.BIAS_SIGMA, **parameters)
        y = sensorid.simulate([h], dt, samples, seed=figures.SEED,
                              first=number).error[0]
        tau, adev = sensorid.allan_deviation(y, dt, per_octave=2)
        filt = h.model(dt, **parameters)
        m = np.round(tau / dt).astype(int)
        expected = np.sqrt(sensorid.model_allan_variance(filt, m))
        result.append((label(model, parameters), tau, adev, expected))
    return result


def label(model, parameters):
    """Legend in the paper's symbols."""
    symbol = dict(sigma_w=r"$\sigma_w$", sigma_m=r"$\sigma_m$", tau_m=r"$\tau_m$",
                  sigma_v=r"$\sigma_v$")
    text = ", ".join(
        f"{symbol[s]} = {v / 60:g} min" if s == "tau_m" else f"{symbol[s]} = {v:g} u"
        for s, v in parameters.items())
    return f"{'random walk' if model == 'random_walk' else 'Markov'}, {text}"


def draw_error(criteria, title):
    fig, ax = plt.subplots()
    figures.draw_pair(ax, criteria.time, criteria.error_probability, "tab:blue",
                      f"{criteria.trials} samples")
    ax.set(xlabel="time, s", ylabel="identification error probability", title=title,
           xscale="log", ylim=(-0.01, 0.55))
    ax.legend()
    return fig


def draw_allan(curves, title):
    fig, ax = plt.subplots()
    for colour, (name, tau, adev, expected) in zip(figures.COLOURS, curves):
        ax.loglog(tau, adev, "-", color=colour, label=name)
        ax.loglog(tau, expected, ":", color=colour)
    ax.plot([], [], ":", color="0.3", label="expectation")
    low, high = ax.get_ylim()
    ax.set(xlabel=r"averaging time $\tau$, s",
           ylabel=r"Allan deviation $\sigma(\tau)$, u", title=title,
           ylim=(low, high * 12))
    ax.legend(fontsize="small", loc="upper left", ncols=1)
    return fig


def run(number, title, examples):
    """Both panels of Figure `number`."""
    figures.save(draw_error(figures.case_criteria(number),
                            f"Figure {number}a. {title}"), f"fig{number}a")
    figures.save(draw_allan(allan_curves(examples), f"Figure {number}b. {title}"),
                 f"fig{number}b")
