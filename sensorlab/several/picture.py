"""One figure of many records: Allan deviations, and what was found on which."""

import numpy as np
from sensorlab.drawings.style import AFTER, BEFORE, styled
from sensorlab.gap.verdict import RARE
from sensorlab.several.tables import names

PANELS = 12    # Allan deviations in a figure, those of the largest gaps
LINES = 80     # records in the matrix


@styled
def draw_several(rows):
    """Allan deviations of the records beside what explains them; probability of every
    hypothesis or effect on every record.
    """
    answered = [(name, r) for name, r in zip(names(rows), rows) if not r.problem]
    if not answered:
        raise ValueError("no record gave an answer: there is nothing to draw")
    shown = sorted(answered, key=lambda one: -_gap(one[1]))[:PANELS]
    shown = [one for one in answered if one in shown]
    columns = min(len(shown), 3)
    lines = -(-len(shown) // columns)
    height = max(2.7 * lines, 1.6 + 0.24 * min(len(answered), LINES), 4.0)
    from matplotlib.figure import Figure
    fig = Figure(figsize=(3.8 * columns + 4.6, height), layout="constrained")
    places = fig.add_gridspec(lines, columns + 1, width_ratios=[3.8] * columns + [3.4])
    for number, (name, row) in enumerate(shown):
        ax = fig.add_subplot(places[divmod(number, columns)])
        _draw_allan(ax, name, row)
        if number == 0:
            ax.legend(fontsize="x-small")
    if len(shown) < len(answered):
        fig.suptitle(f"left: the {PANELS} largest gaps of {len(answered)} records")
    _draw_matrix(fig.add_subplot(places[:, -1]), answered[:LINES])
    return fig


def _gap(row):
    """How far a record is from its simulator."""
    return row.answer.get("gap", {}).get("before") or 0.0


def _draw_allan(ax, name, row):
    tau = np.array(row.curves["tau"])
    for label, band in row.curves.items():
        if label not in ("tau", "record"):
            low, high = np.array(band, float)
            colour = BEFORE if label == "simulator" else AFTER
            ax.fill_between(tau, low, high, color=colour, alpha=0.3, linewidth=1.5,
                            label=label + ", 90 % of its records" * (label != "model"))
    ax.loglog(tau, row.curves["record"], "k.-", label="record")
    verdict = row.answer.get("verdict") or row.answer["decision"] or "undecided"
    effects = verdict.split("+")
    if len(effects) > 2:
        verdict = f"{effects[0]}+{len(effects) - 1} more"
    ax.set_title(f"{name}: {verdict}", fontsize="small")
    ax.set_xlabel("averaging time, s", fontsize="small")
    ax.set_ylabel(f"Allan deviation, {row.unit}", fontsize="small")


def _draw_matrix(ax, answered):
    """Probabilities, a line for every record."""
    chances = [_chances(row.answer) for _, row in answered]
    total = {}
    for chance in chances:
        for name, p in chance.items():
            total[name] = max(total.get(name, 0.0), p)
    heads = [name for name, p in sorted(total.items(), key=lambda one: -one[1])
             if p >= RARE]
    p = np.array([[chance.get(name, 0.0) for name in heads] for chance in chances])
    ax.grid(False)
    ax.imshow(p, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    ax.set_xticks(range(len(heads)), heads, rotation=60, ha="right", fontsize="small")
    ax.set_yticks(range(len(answered)), [name for name, _ in answered],
                  fontsize="small")
    if len(heads) * len(answered) <= 300:
        for i, j in np.argwhere(p >= 0.005):
            ax.text(j, i, f"{p[i, j]:.2f}", ha="center", va="center", fontsize=7,
                    color="white" if p[i, j] > 0.6 else "black")
    ax.set_title("probability", fontsize="small")


def _chances(answer):
    """Probability of every hypothesis, or of every effect in whatever company."""
    if "hypotheses" in answer:
        return {h["name"]: h["probability"] for h in answer["hypotheses"]}
    result = {}
    for cause in answer["causes"]:
        for effect in dict.fromkeys(cause["effect"].split("+")):
            result[effect] = result.get(effect, 0.0) + cause["probability"]
    return result
