"""Rows of many records as a DataFrame and as a table for people."""

import os
import pathlib

import numpy as np

from sensorlab.gap.sizes import measured, number, values_text
from sensorlab.tables import Table


def names(rows):
    """A short name for every row: what tells it from the others."""
    files, columns = [r.file for r in rows], {r.column for r in rows}
    common = 0    # characters of the path to a topic that all have
    if len(columns) > 1:
        common = os.path.commonprefix(list(columns)).rfind("/") + 1
    stems = {f: pathlib.Path(f).stem for f in files}
    if len(set(stems.values())) < len(stems):
        stems = {f: f for f in files}
    if len(stems) == 1:
        return [r.column[common:] for r in rows]
    return [stems[r.file] if len(columns) == 1 else
            f"{stems[r.file]}:{r.column[common:]}" for r in rows]


def frame(rows):
    """A DataFrame: a line for every row, its problem last."""
    import pandas
    result = pandas.DataFrame([_line(row) for row in rows]).astype(
        dict(samples="Int64"), errors="ignore")
    return result[[*result.columns.drop("problem"), "problem"]]


def _line(row):
    if not row.answer:
        return dict(file=row.file, column=row.column, samples=None, unit=row.unit,
                    problem=row.problem)
    a = row.answer
    line = dict(a["record"], unit=row.unit)
    if "verdict" in a:
        gap, first = a["gap"], a["causes"][0]
        low, high = gap["closed_interval"]
        line |= dict(
            verdict=a["verdict"], probability=first["probability"],
            p_value=gap["p_value"], before=gap["before"], after=gap["after"],
            closed=gap["closed"], closed_low=low, closed_high=high,
            remainder=gap["remainder"]["share"],
            found="; ".join(_sizes(a["found"], row.unit)),
            needed_duration=a["needed_duration"])
    else:
        best = _best(a)
        line |= dict(decision=a["decision"], hypothesis=best["name"],
                     probability=best["probability"], described=a["described"])
        for symbol, value in best["parameters"].items():
            line |= {symbol: value["mean"], f"{symbol}_sd": value["sd"]}
        for q in a["quoted"]:
            label = f"{q['name']} [{q['unit']}]"
            line |= {label: q["mean"], f"{label} sd": q["sd"]}
    return dict(line, problem=row.problem)


def _best(answer):
    return max(answer["hypotheses"], key=lambda h: h["probability"])


def _sizes(found, unit):
    """Effects and their parameters, a text for each."""
    return [_effect(one["effect"], one["column"], one["parameters"], unit)
            for one in found]


def _effect(name, column, parameters, unit):
    return " ".join(filter(None, (name, column and f"({column})",
                                  _values(parameters, unit, column))))


def _values(parameters, unit, column=""):
    """Parameters of JSON as text; what is not finite is None there."""
    return values_text({symbol: (_finite(value["mean"]), value["sd"] or 0.0)
                        for symbol, value in parameters.items()}, unit, column)


def _finite(mean):
    if isinstance(mean, list) and len(mean) == 2:    # limits
        return [x if y is None else y for x, y in zip((-np.inf, np.inf), mean)]
    return np.nan if mean is None else mean


def told(several):
    """The rows, and what they have in common, as sentences and a `Table`."""
    rows, called = several.rows, names(several.rows)
    diagnosed = any("verdict" in row.answer for row in rows)
    heads, right = ((("record", "verdict", "gap, sd", "closed", "left", "found"),
                     (2, 3, 4)) if diagnosed else
                    (("record", "hypothesis", "probability", "parameters"), (2,)))
    lines = []
    for name, row in zip(called, rows):
        cells = (("no answer", *[""] * (len(heads) - 3), row.problem) if row.problem
                 else _diagnosed_lines(row) if diagnosed else _identified_cells(row))
        lines.append((name, *cells))
    return (*headings(rows, called), Table(heads, tuple(lines), right),
            *(shared(c, rows, called) for c in several.common))


def shared(c, rows, called):
    """What several records have in common, in a sentence."""
    unit = rows[c.records[0]].unit
    return (f"common to {_brief([called[n] for n in c.records])}: "
            + _effect(c.effect, c.column, c.parameters, unit))


def headings(rows, called):
    """Clock and covariates, once for all records that have the same."""
    groups = {}
    for name, row in zip(called, rows):
        if not row.problem:
            groups.setdefault((row.answer["record"]["samples"], row.heard), []).append(
                name)
    for (samples, heard), own in groups.items():
        yield f"{_brief(own)}: {samples} samples, {heard}"


def _brief(some, most=6):
    return ", ".join(some[:most]) + (
        f", ... {some[-1]} ({len(some)} in all)" if len(some) > most else "")


def diagnosed_cells(row):
    """Verdict, gap, shares closed and left, and the effects found, a text each."""
    a = row.answer
    gap = a["gap"]

    def share(x):
        return "" if x is None else f"{100 * x:.0f} %"
    before = "" if gap["before"] is None else number(gap["before"], 3)
    return (a["verdict"], before, share(gap["closed"]),
            share(gap["remainder"]["share"]), _sizes(a["found"], row.unit))


def _diagnosed_lines(row):
    verdict, *numbers, found = diagnosed_cells(row)
    return verdict.replace("+", "+\n"), *numbers, "\n".join(found)


def _identified_cells(row):
    a, best = row.answer, _best(row.answer)
    quotes = ",\n".join(f"{q['name']} {measured(q['mean'], q['sd'])} {q['unit']}"
                       for q in a["quoted"])
    return (best["name"], f"{best['probability']:.3f}",
            (quotes or _values(best["parameters"], row.unit))
            + "; undecided" * (a["decision"] is None)
            + "; does not describe the record" * (not a["described"]))
