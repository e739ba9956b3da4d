"""How long for my sensor? From the first ten minutes of a recording of 2 h 46 min, the
spread of every parameter after the whole of it: foretold and found.

Six axes of an ADIS16405, run 1, means over 1 s. The recordings are not part of the
project; they are looked for in shared/data/real beside it, without them there is no
figure. `python -m figures plan` goes on where it was interrupted.

Gyro Y ends 3.6 times worse than the middle of what is foretold, and that is the record:
its walk is 0.0028 +- 0.0009 deg/s per root sample in the first ten minutes and 0.0015
in the whole run, 0.0002 to 0.0020 in stretches of ten minutes from 1200, 2600, 4200,
5600, 7000 and 8400 s, and its mean moves by 0.04 deg/s at 3000 s. Foretold from each of
these six, tau_m and sigma_m of the whole run lie inside the 90 %.
"""

import matplotlib.pyplot as plt
import numpy as np

import figures
import sensorid
from figures import real, save
from sensorlab.planning import for_longer, outlook

AVERAGED, SHORT, TRIALS, SEED = 100, 600, 100, 1997
MIN_PROBABILITY = 0.05    # of a hypothesis that the whole run does not rule out


def means(kind, axis):
    """1 s means of run 1."""
    with np.load(real.REAL / "adis16405_run1.npz") as z:
        y = z[f"{kind}_counts"][axis] * float(z[f"{kind}_lsb"])
    return y[:len(y) // AVERAGED * AVERAGED].reshape(-1, AVERAGED).mean(1)


def one_axis(kind, axis, trials=TRIALS):
    """Rows of label, probability early and late, and relative standard deviations:
    early, foretold (5, 50, 95 %), found.
    """
    y, dt = means(kind, axis), real.DT * AVERAGED
    early = y[:SHORT]
    hypotheses = for_longer(sensorid.default_hypotheses(early, dt), len(y) / SHORT)
    foretold = outlook(early, dt, hypotheses, dt * len(y), trials, SEED)
    late, found = sensorid.identify(y, dt, hypotheses), {}
    for probability, e in zip(late.probability, late.estimates):
        for p, mean, sd in zip(e.hypothesis.parameters, e.mean,
                               np.sqrt(np.diag(e.covariance))):
            found[f"{e.hypothesis.name}.{p.symbol}"] = float(probability), sd / mean
    return [dict(label=o.label, early=o.probability, late=found[o.label][0], now=o.now,
                 foretold=o.rsd[:, -1].tolist(), found=float(found[o.label][1]))
            for o in foretold]


def compute():
    """{axis: rows}; what was found before is kept."""
    kept, keep = figures.kept("plan")
    axes = real.AXES if figures.size["trials"] >= 500 else real.AXES[:1]
    for done, (kind, axis) in enumerate(axes, 1):
        key = f"{kind} {'xyz'[axis]}"
        if key not in kept:
            keep(key, one_axis(kind, axis))
        if figures.size["progress"]:
            figures.size["progress"](done, len(axes))
    return kept


def believed(rows):
    """The rows of hypotheses that the whole run does not rule out."""
    return [row for row in rows if row["late"] >= MIN_PROBABILITY]


def inside(row):
    """Does what was found lie in the band that was foretold, to a hundredth of it?"""
    low, _, high = row["foretold"]
    return 0.99 * low <= row["found"] <= 1.01 * high


def table(result):
    lines = [f"{'axis':<9}{'parameter':<24}{'p early':>8}{'late':>7}{'now':>8}"
             f"{'foretold':>10} [5 %, 95 %]       {'found':>8}"]
    for axis, rows in result.items():
        for row in rows:
            low, middle, high = row["foretold"]
            lines.append(
                f"{axis:<9}{row['label']:<24}{row['early']:>8.2f}{row['late']:>7.2f}"
                f"{row['now']:>8.3f}{middle:>10.4f} [{low:.4f}, {high:.4f}] "
                f"{row['found']:>10.4f}{'' if inside(row) else '  outside'}")
    for text, picked in (("not ruled out by the whole run", believed),
                         ("ruled out by it", lambda rows: [
                             row for row in rows if row not in believed(rows)])):
        own = [row for rows in result.values() for row in picked(rows)]
        if own:
            off = np.log([row["found"] / row["foretold"][1] for row in own])
            lines.append(f"hypotheses {text}: {sum(map(inside, own))} of {len(own)} "
                         "inside the 90 % band; found over foretold, rms factor "
                         f"{np.exp(np.sqrt(np.mean(off**2))):.2f}")
    return "\n".join(lines)


def draw(result):
    fig, ax = plt.subplots(figsize=(6.0, 5.4))
    labels = sorted({row["label"] for rows in result.values()
                     for row in believed(rows)})
    for number, label in enumerate(labels):
        own = [row for rows in result.values() for row in believed(rows)
               if row["label"] == label]
        low, middle, high = np.array([row["foretold"] for row in own]).T
        ax.errorbar([row["found"] for row in own], middle,
                    (middle - low, high - middle), fmt="o", color=f"C{number}",
                    label=label, capsize=3)
    ends = np.array([0.005, 2.0])
    ax.plot(ends, ends, "--", color="0.5", label="as foretold")
    ax.set(xscale="log", yscale="log", xlabel="relative standard deviation found after "
           "2 h 46 min", ylabel="foretold by ten minutes, 90 %")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter("{x:g}")
    ax.legend()
    return fig


def main():
    if not real.REAL.is_dir():
        print("plan: the recordings are not beside this checkout: no figure")
        return
    result = compute()
    print(table(result))
    save(draw(result), "plan")
