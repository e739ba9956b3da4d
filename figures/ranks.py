"""Ranks. The rank of the true value in its posterior, for every parameter of the
hypotheses of two processes: uniform where the posterior is right, below the diagonal or
above it where it is biased. Shaded: 99 % of such curves (Kolmogorov and Smirnov).

Records of 500 samples at 1 s drawn from the prior; record number k from the seed
(SEED, k), as `simulate` does. `python -m figures ranks` goes on where it was
interrupted.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import kstest, kstwo

import figures
import sensorid

SEED = 1997
SAMPLES = 500
HYPOTHESES = (
    sensorid.hypothesis("random_walk_markov", sigma_w=(0.04, 0.15), tau_m=(3.0, 60.0),
                        sigma_m=(0.5, 1.5), sigma_v=(0.25, 1.0)),
    sensorid.hypothesis("two_markov", tau_m=(3.0, 20.0), sigma_m=(0.5, 1.5),
                        tau_n=(40.0, 300.0), sigma_n=(0.5, 1.5), sigma_v=(0.25, 1.0)))


def compute(records=1000):
    """{hypothesis: ranks (records, p)} and how many posteriors were settled."""
    kept, keep = figures.kept("ranks")
    records = records if figures.size["trials"] >= 500 else 10
    for number in range(records):
        for h in HYPOTHESES:
            if f"{h.name} {number}" not in kept:
                T = sensorid.simulate([h], 1.0, SAMPLES, 1, SEED, number)
                e = sensorid.resolve(h, 1.0, T.error[0])
                ranks = e.weight @ (e.theta < T.theta[0])
                keep(f"{h.name} {number}", [e.settled, *ranks.tolist()])
        if figures.size["progress"]:
            figures.size["progress"](number + 1, records)
    rows = {h.name: np.array([kept[f"{h.name} {number}"] for number in range(records)])
            for h in HYPOTHESES}
    return ({name: row[:, 1:] for name, row in rows.items()},
            sum(int(row[:, 0].sum()) for row in rows.values()))


def table(ranks, settled):
    """The result as text: of each parameter p of a uniform rank, and the mean rank."""
    lines, n = [], sum(map(len, ranks.values()))
    for h in HYPOTHESES:
        for p, rank in zip(h.parameters, ranks[h.name].T):
            lines.append(
                f"{h.name + '.' + p.symbol:<28}p {kstest(rank, 'uniform').pvalue:.3f}"
                f"   mean rank {rank.mean():.3f} +- {(12.0 * len(rank))**-0.5:.3f}")
    return "\n".join([*lines, f"settled {settled} of {n}"])


def draw(ranks, settled):
    fig, axes = plt.subplots(1, 2, figsize=(10.0, 4.2), sharey=True)
    for ax, h in zip(axes, HYPOTHESES):
        n = len(ranks[h.name])
        even = (np.arange(n) + 0.5) / n
        for p, rank, colour in zip(h.parameters, ranks[h.name].T, figures.COLOURS):
            ax.plot(even, np.sort(rank) - even, color=colour, label=p.symbol)
        ax.axhspan(-kstwo.ppf(0.99, n), kstwo.ppf(0.99, n), color="0.5", alpha=0.15)
        ax.set(xlabel="rank of the true value", title=f"{h.name}, {n} records")
        ax.legend(ncols=2)
    axes[0].set(ylabel="sorted rank less its expectation")
    return fig


def main():
    result = compute()
    print(table(*result))
    figures.save(draw(*result), "ranks")
