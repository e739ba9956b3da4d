"""Figure 7. Error probability of all algorithms on the same trials in the three cases;
below, what each adds to that of the Bayesian algorithm, +- one standard error."""

import matplotlib.pyplot as plt

import figures
from figures import suboptimal
from figures.fig5 import CASES


def main():
    fig, axes = plt.subplots(2, 3, figsize=(12.0, 6.6), sharex=True, sharey="row")
    for (top, bottom), (number, name) in zip(axes.T, CASES.items()):
        c, _, _ = suboptimal.compute(number)
        figures.draw_pair(top, c.time, c.error_probability, "black", "Bayesian")
        for k, (key, r) in enumerate(c.rivals.items()):
            for ax, value, se in ((top, r.error_probability, r.error_se),
                                  (bottom, r.excess, r.excess_se)):
                ax.errorbar(c.time, value, se, color=f"C{k}", marker="o", markersize=3,
                            capsize=2, label=suboptimal.NAMES[key])
        bottom.axhline(0.0, color="black", linewidth=1.0)
        suboptimal.label(top, f"Figure 7, case {number}: {name}")
        suboptimal.label(bottom, "")
        print(f"case {number}, {c.trials} trials, {c.time[-1]:g} s: Bayesian "
              f"{c.error_probability.real[-1]:.3f}; " + ", ".join(
                  f"{key} {r.error_probability[-1]:.3f} "
                  f"({r.excess[-1]:+.3f} +- {r.excess_se[-1]:.3f})"
                  for key, r in c.rivals.items()))
    axes[0, 0].set(ylabel="identification error probability", ylim=(0, None))
    axes[1, 0].set_ylabel("excess over the Bayesian algorithm")
    fig.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center",
               ncols=7)
    figures.save(fig, "fig7")
