"""The sealed check: every record of data/withheld is diagnosed and its report written;
only then are the labels opened.

Left: records named rightly by severity, with 95 % intervals, and false alarms. Middle:
are the probabilities true? Right: fraction of the gap that is closed.
"""

import csv
import hashlib
import json
import pathlib
import sys

import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import beta

import figures
import sensorlab
from figures import save

DATA = pathlib.Path(__file__).parent.parent / "data" / "withheld"
OUTSIDE, PAIR = 9, 5    # the labels' levels for effects outside the catalogue; pairs
ADOPTED = dict(burst="vibration_burst")    # kinds that the catalogue has by now


def interval(k, n):
    """Exact 95 % interval of a proportion (Clopper and Pearson)."""
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return low, high


def ratio(nats):
    """Signal-to-noise ratio that a matched filter gives an effect of so many nats."""
    return np.sqrt(2.0 * nats)


def compute():
    """Reports of all records, by number; those already written are kept."""
    folder = figures.OUTPUT / "withheld"
    folder.mkdir(parents=True, exist_ok=True)
    seal = hashlib.sha256((DATA / "labels.csv").read_bytes()).hexdigest()
    print(f"labels sealed: sha256 {seal}", file=sys.stderr)
    source = hashlib.sha256(b"".join(f.read_bytes() for f in sorted((
        DATA.parent.parent / "sensorlab").rglob("*.py")))).hexdigest()
    model = sensorlab.read_model(DATA / "model.json")
    names = np.load(DATA / "records.npz")["name"]
    reports = {}
    for number, name in enumerate(names):
        file = folder / f"{name}.json"
        kept = json.loads(file.read_text()) if file.exists() else {}
        if kept.get("source") != source:
            record = sensorlab.read_record(DATA / "records.npz", f"error[{number}]",
                                          beside=None)
            d = sensorlab.diagnose(record.error, record.dt, model.simulator,
                                  record.columns)
            kept = {**sensorlab.report(d, record), "source": source}
            kept["record"]["file"] = "data/withheld/records.npz"
            file.write_text(json.dumps(kept, indent=1))
        reports[str(name)] = kept
        if figures.size["progress"]:
            figures.size["progress"](number + 1, len(names))
    assert hashlib.sha256((DATA / "labels.csv").read_bytes()).hexdigest() == seal
    return reports


def labels():
    """What was done to every record."""
    with open(DATA / "labels.csv", newline="") as stream:
        return list(csv.DictReader(stream))


def labelled(reports):
    """Rows of (effects, level, truth, report), read when all reports are written."""
    return [(row["effects"], int(row["level"]),
             json.loads(row["info"]).get("truth") or {} if row["info"] else {},
             reports[row["record"]]) for row in labels()]


def right(effects, report):
    """Is the verdict the truth? Outside the catalogue: does it force no name?"""
    names = {ADOPTED.get(effect, effect) for effect in effects.split("+")}
    if not names <= {*sensorlab.CATALOGUE, "none"}:
        return report["verdict"] in ("unknown", "undecided")
    return set(report["verdict"].split("+")) == names


def leaves_room(report):
    """Does a verdict say that something else may be there?"""
    return bool({"unknown", "undecided"} & set(report["verdict"].split("+")))


def false_alarm(effects, report):
    """Was an effect, or an unknown one, said where there is none?"""
    return effects == "none" and report["verdict"] not in ("none", "undecided")


def errors(rows):
    """(symbol, error, error in reported sd) of the parameters of single effects named
    rightly."""
    found = []
    for effects, _, truth, report in rows:
        if effects in truth and right(effects, report):
            reported = report["causes"][0]["parameters"]
            for symbol, value in truth[effects].items():
                one = reported.get(symbol)
                if isinstance(value, float) and one and one["sd"]:
                    mean = one["mean"]
                    if symbol == "amplitude":    # of either sign: the phase tells
                        mean = np.copysign(mean, value)
                    error = mean - value
                    found.append((f"{effects}.{symbol}", error, error / one["sd"]))
    return found


def calibration(rows):
    """(probability of the first cause, was it right) of every record."""
    return np.array([(report["causes"][0]["probability"],
                      right(effects, {"verdict": report["causes"][0]["effect"]}))
                     for effects, _, _, report in rows])


def calibration_error(pairs, weight=1.0, bins=10):
    """Expected calibration error; `weight` (R,) is what every record counts."""
    at = np.minimum((pairs[:, 0] * bins).astype(int), bins - 1)
    weight = np.broadcast_to(weight, len(pairs))
    off = weight * (pairs[:, 0] - pairs[:, 1])
    return sum(abs(off[at == b].sum()) for b in set(at)) / weight.sum()


def table(rows, share=None):
    """The result as text.

    However many records without an effect there are, in the calibration they weigh as
    if they were this share of all.
    """
    lines = []

    def line(text, hits):
        k, n = int(np.sum(hits)), len(hits)
        if n:
            low, high = interval(k, n)
            lines.append(f"{text:<44}{k:>4} of {n:<5}{100 * k / n:5.1f} % "
                         f"[{100 * low:.1f}, {100 * high:.1f}]")
    none = [r for r in rows if r[0] == "none"]
    line("said an effect where there is none", [false_alarm(r[0], r[3]) for r in none])
    for level in (1, 2, 3, 4):
        line(f"named rightly, level {level}", [
            right(r[0], r[3]) for r in rows if r[1] == level and "+" not in r[0]])
    line("two effects, both named",
         [right(r[0], r[3]) for r in rows if r[1] == PAIR])
    outside = [r for r in rows if r[1] == OUTSIDE]
    line("outside the catalogue: unknown or undecided",
         [right(r[0], r[3]) for r in outside if r[0] not in ADOPTED])
    line("  the same, or unknown beside a name",
         [leaves_room(r[3]) for r in outside if r[0] not in ADOPTED])
    for kind, name in ADOPTED.items():
        line(f"{kind}, adopted since as {name}",
             [right(r[0], r[3]) for r in outside if r[0] == kind])
    for level in (3, 4):
        closed = [r[3]["gap"]["closed"] for r in rows if r[1] == level
                  and right(r[0], r[3]) and r[3]["gap"]["closed"] is not None]
        if closed:
            lines.append(f"closed fraction, median, level {level}:     "
                         f"{np.median(closed):.2f} of {len(closed)} records")
    off = errors(rows)
    line("parameters within two reported sd", [abs(z) <= 2.0 for _, _, z in off])
    duration = rows[0][3]["record"]["samples"] * rows[0][3]["record"]["dt"]
    near = errors([r for r in rows if r[1] == 3])
    for symbol, within, text in (
            ("bias_step.onset", 0.01 * duration, "onset within 1 % of the record"),
            ("sinusoid.frequency", 1.0 / duration, "frequency within 1 / T")):
        line(f"{text}, level 3", [abs(e) < within for name, e, _ in near
                                  if name == symbol])
    none, weight = np.array([r[0] == "none" for r in rows]), np.ones(len(rows))
    if share is not None and 0 < none.sum() < len(rows):
        weight[none] = share / (1.0 - share) * np.sum(~none) / np.sum(none)
    lines.append("expected calibration error:                 "
                 f"{calibration_error(calibration(rows), weight):.3f}")
    return "\n".join(lines)


def draw(rows):
    fig, (left, middle, last) = plt.subplots(1, 3, figsize=(13.0, 4.2))
    groups = [("none", [r for r in rows if r[0] == "none"])] + [
        (f"level {level}", [r for r in rows if r[1] == level and "+" not in r[0]])
        for level in (1, 2, 3, 4)] + [
        ("pairs", [r for r in rows if r[1] == PAIR]),
        ("outside", [r for r in rows if r[1] == OUTSIDE])]
    groups = [(name, part) for name, part in groups if part]
    for at, (_, part) in enumerate(groups):
        hits = [right(r[0], r[3]) for r in part]
        low, high = interval(sum(hits), len(hits))
        left.bar(at, np.mean(hits), color="tab:blue", alpha=0.7)
        left.plot([at, at], [low, high], "k-")
    left.set_xticks(range(len(groups)), [name for name, _ in groups], rotation=30)
    left.set(ylabel="fraction right", ylim=(0.0, 1.03), title="verdicts")
    pairs = calibration(rows)
    edges = np.linspace(0.0, 1.0, 6)
    for low, high in zip(edges[:-1], edges[1:]):
        own = pairs[(pairs[:, 0] > low) & (pairs[:, 0] <= high)]
        if len(own):
            ends = interval(int(own[:, 1].sum()), len(own))
            middle.plot([own[:, 0].mean()] * 2, ends, "k-", linewidth=1)
            middle.plot(own[:, 0].mean(), own[:, 1].mean(), "o", color="tab:blue",
                        markersize=3 + np.sqrt(len(own)))
    middle.plot([0, 1], [0, 1], "--", color="0.6")
    middle.set(xlabel="probability of the first cause", ylabel="fraction right",
               title="are the probabilities true?")
    for level in (2, 3, 4):
        closed = sorted(r[3]["gap"]["closed"] for r in rows if r[1] == level
                        and right(r[0], r[3]) and r[3]["gap"]["closed"] is not None)
        if closed:
            last.plot(closed, np.linspace(0, 1, len(closed)), "o-",
                      label=f"level {level}")
    last.set(xlabel="fraction of the gap closed", ylabel="fraction of records",
             title="effects named rightly", xlim=(-0.05, 1.05))
    last.legend()
    return fig


def main():
    rows = labelled(compute())
    print(table(rows))
    save(draw(rows), "withheld")
