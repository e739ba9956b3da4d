"""Figure 8. RSD of every parameter for all algorithms on the same trials in the three
cases, above the Bayesian Cramer-Rao bound; small below each, the efficiency: the
variance of the Bayesian estimate over that of the algorithm."""

import matplotlib.pyplot as plt

import figures
from figures import suboptimal
from figures.fig5 import CASES

SHOWN = {"random_walk.sigma_w": r"random walk, $\sigma_w$",
         "markov.tau_m": r"Markov, $\tau_m$", "markov.sigma_m": r"Markov, $\sigma_m$",
         "markov.sigma_v": r"Markov, $\sigma_v$"}


def main():
    fig, axes = plt.subplots(6, 4, figsize=(15.0, 13.0), sharex=True,
                             height_ratios=[2, 1] * 3)
    for row, (number, name) in enumerate(CASES.items()):
        c, bound, bound_se = suboptimal.compute(number)
        for column, (key, symbol) in enumerate(SHOWN.items()):
            top, bottom = axes[2 * row:2 * row + 2, column]
            if key not in c.labels:
                top.set_axis_off()
                bottom.set_axis_off()
                continue
            at = c.labels.index(key)
            figures.draw_pair(top, c.time, c.rsd[at], "black", "Bayesian")
            top.plot(c.time, bound[:, at], ":", color="0.3",
                     label="Cramér–Rao bound")
            top.fill_between(c.time, bound[:, at] - bound_se[:, at],
                             bound[:, at] + bound_se[:, at], color="0.3", alpha=0.15,
                             linewidth=0)
            for k, (rival, r) in enumerate(c.rivals.items()):
                if rival == "bic":    # estimates as AIC does
                    continue
                for ax, value, se in ((top, r.rsd, r.rsd_se),
                                      (bottom, r.efficiency, r.efficiency_se)):
                    ax.errorbar(c.time, value[at], se[at], color=f"C{k}", marker="o",
                                markersize=3, capsize=2,
                                label=suboptimal.NAMES[rival].replace("ML, AIC", "ML"))
            bottom.axhline(1.0, color="black", linewidth=1.0)
            suboptimal.label(top, f"case {number}: {symbol}")
            bottom.set(ylabel="efficiency", ylim=(0, 1.25))
            top.set(ylabel="RSD", yscale="log", xlabel="")
            if number == 3:
                bottom.set_xlabel("time, s")
            print(f"case {number}, {key}, {c.time[-1]:g} s: bound {bound[-1, at]:.4f}, "
                  f"Bayesian {c.rsd[at].real[-1]:.4f}; efficiency " + ", ".join(
                      f"{rival} {r.efficiency[at][-1]:.2f} "
                      f"+- {r.efficiency_se[at][-1]:.2f}"
                      for rival, r in c.rivals.items() if rival != "bic"))
    axes[0, 3].legend(*axes[0, 0].get_legend_handles_labels(), loc="center")
    figures.save(fig, "fig8")
