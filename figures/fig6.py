"""Figure 6. (a) Real and calculated RSD of the system noise of the random walk in the
three cases; (b) of the white noise in case 3, for both models."""

import matplotlib.pyplot as plt

import figures
from figures.fig5 import draw_cases


def main():
    fig, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.2))
    draw_cases(left, "random_walk.sigma_w")
    c = figures.case_criteria(3)
    for colour, model in zip(figures.COLOURS, ("random_walk", "markov")):
        figures.draw_pair(right, c.time, figures.curve(c, f"{model}.sigma_v"), colour,
                          model.replace("_", " "))
    left.set(ylabel=r"RSD of $\sigma_w \in$ [0.04, 0.15] u", title="Figure 6a",
             yscale="log", ylim=(3e-3, 0.6))
    right.set(xlabel="time, s", ylabel=r"RSD of $\sigma_v \in$ [0.25, 1] u",
              title="Figure 6b", yscale="log", ylim=(3e-3, 0.6))
    right.legend(fontsize="small")
    figures.save(fig, "fig6")
