"""What the paper prints, what we get, and where the two differ, why."""

import csv
import pathlib
from typing import NamedTuple

import numpy as np

import figures

PAPER = pathlib.Path(__file__).parent.parent / "data" / "paper.csv"

REASONS = {
    "error_case1": "see the audit: at dt = 1 s it is far larger, so dt was small; "
                   "dt = 0.1 s is ours",
    "error_case2": "within 'about' for dt = 0.1-0.2 s, see the audit",
    "error_case3": "only a coarse grid gives 10 %, and then real and calculated part, "
                   "see the audit",
    "rsd_ratio_sigma_v": "the random walk moves more between samples and hides more of "
                         "the noise",
    "rsd_ratio_sigma_w": "part of the white noise is taken for the walk; small beside "
                         "case 1",
}


class Printed(NamedTuple):
    """A number printed in the paper."""

    key: str
    time: float
    value: float
    statement: str


def printed():
    """All rows of data/paper.csv."""
    lines = [line for line in PAPER.read_text().splitlines()
             if not line.startswith("#")]
    return [Printed(row["key"], float(row["time"]), float(row["value"]),
                    row["statement"])
            for row in csv.DictReader(lines)]


def paper(key):
    """One row of data/paper.csv."""
    return next(row for row in printed() if row.key == key)


def _ratio(a, b):
    """Ratio of two real RSDs at the end, with its standard error."""
    value = a.real[-1] / b.real[-1]
    return value, value * np.hypot(a.real_se[-1] / a.real[-1],
                                   b.real_se[-1] / b.real[-1])


def compute():
    """(row of the paper, ours, its standard error) for every printed number."""
    cases = {n: figures.case_criteria(n) for n in (1, 2, 3)}
    ours = {f"error_case{n}": (c.error_probability.real[-1],
                               c.error_probability.real_se[-1])
            for n, c in cases.items()}
    for model, symbol in (("markov", "tau_m"), ("markov", "sigma_m"),
                          ("random_walk", "sigma_w")):
        ours[f"rsd_ratio_{symbol}"] = _ratio(
            *(figures.curve(cases[n], f"{model}.{symbol}") for n in (3, 2)))
    ours["rsd_ratio_sigma_v"] = _ratio(*(figures.curve(cases[3], f"{model}.sigma_v")
                                         for model in ("random_walk", "markov")))
    return [(row, *ours[row.key]) for row in printed()]


def main():
    print(f"\n{'paper':>6}  {'ours +- s.e.':<18}statement; where they differ by more "
          "than 2 s.e., why")
    for row, value, se in compute():
        print(f"{row.value:>6.2f}  {f'{value:.4f} +- {se:.4f}':<18}{row.statement}")
        if abs(value - row.value) > 2.0 * se and row.key in REASONS:
            print(f"{'':<26}-> {REASONS[row.key]}")
    for number in (1, 2, 3):
        c = figures.case_criteria(number)
        worst = max(abs(k.z).max() for k in (c.error_probability, *c.rsd))
        end = "; ".join(
            f"{label} {k.real[-1]:.3f}+-{k.real_se[-1]:.3f} "
            f"(calculated {k.calculated[-1]:.3f})"
            for label, k in zip(("error", *c.labels), (c.error_probability, *c.rsd)))
        print(f"case {number} at {c.time[-1]:g} s: {end}; nodes {c.nodes}; "
              f"real and calculated differ by {worst:.1f} s.e. at most, over all times")
