"""Figure 5. Real and calculated RSD of the Markov process in the three cases: (a)
correlation time; (b) standard deviation."""

import matplotlib.pyplot as plt

import figures

CASES = {1: "no white noise", 2: r"$\sigma_v$ = 0.5 u known",
         3: r"$\sigma_v \in$ [0.25, 1] u unknown"}
PANELS = ("markov.tau_m", r"RSD of $\tau_m \in$ [1, 25] min"), (
    "markov.sigma_m", r"RSD of $\sigma_m \in$ [0.5, 1.5] u")


def draw_cases(ax, label):
    """RSD of one parameter in all cases that have it."""
    for colour, (number, name) in zip(figures.COLOURS, CASES.items()):
        c = figures.case_criteria(number)
        if label in c.labels:
            figures.draw_pair(ax, c.time, figures.curve(c, label), colour,
                              f"{number}: {name}")
    ax.set(xlabel="time, s", ylim=(0, None))
    ax.legend(fontsize="small")


def main():
    fig, axes = plt.subplots(1, 2, figsize=(10.0, 4.2))
    for ax, letter, (label, name) in zip(axes, "ab", PANELS):
        draw_cases(ax, label)
        ax.set(ylabel=name, title=f"Figure 5{letter}")
    figures.save(fig, "fig5")
