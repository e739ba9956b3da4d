"""What records have in common: a vibration at one frequency, one thermometer, a knock
at one time. It is named once.
"""

from typing import NamedTuple

import numpy as np

# what an effect on one axis shares with the same on another; sizes differ
SHARED = ("frequency", "onset", "duration", "quiet", "tau", "lsb", "vertex", "dwell",
          "window", "cutoff")
AGREE = 3.0      # standard deviations of a difference
ALIKE = 0.02     # relative: two values without one


class Common(NamedTuple):
    """An effect that several records share."""

    effect: str
    column: str        # that it comes from, "" where none
    parameters: dict   # symbol -> dict(mean, sd), of what they share
    records: tuple     # numbers of the rows


def common(rows):
    """`Common`s of the effects found in rows of diagnoses, the widest first.

    An effect is shared where it comes from the same column, or where all that says when
    or at which frequency it acts agrees: within AGREE standard deviations, and two
    frequencies within what the record can tell apart, 1 / duration.
    """
    groups = []    # of [(number of the row, effect as report.json has it)]
    for number, row in enumerate(rows):
        for one in row.answer.get("found", ()):
            part = number, one, _finest(row.answer["record"])
            for group in groups:
                if number not in [n for n, *_ in group] and all(
                        _same(part, other) for other in group):
                    group.append(part)
                    break
            else:
                groups.append([part])
    found = [Common(group[0][1]["effect"], group[0][1]["column"] or "",
                    _together([one for _, one, _ in group]),
                    tuple(n for n, *_ in group))
             for group in groups if len(group) > 1]
    return tuple(sorted(found, key=lambda c: -len(c.records)))


def _finest(record):
    """What a record can tell apart, by symbol."""
    return dict(frequency=1.0 / (record["samples"] * record["dt"]), onset=record["dt"])


def _same(part, other):
    """Are two found effects the same, but for their size?"""
    (_, one, finest), (_, two, _) = part, other
    if (one["effect"], one["column"]) != (two["effect"], two["column"]):
        return False
    symbols = _symbols(one)
    return bool(symbols or one["column"]) and all(
        _agree(one["parameters"][s], two["parameters"][s], finest.get(s, 0.0))
        for s in symbols)


def _symbols(one):
    return [s for s in SHARED if s in one["parameters"]]


def _agree(one, two, finest):
    sds = one["sd"] or 0.0, two["sd"] or 0.0
    least = finest if all(sds) else max(finest, ALIKE * abs(one["mean"]))
    return abs(one["mean"] - two["mean"]) <= max(AGREE * np.hypot(*sds), least)


def _together(group):
    """Weighted means of what they share."""
    result = {}
    for symbol in _symbols(group[0]):
        mean, sd = np.array([(one["parameters"][symbol]["mean"],
                              one["parameters"][symbol]["sd"] or 0.0)
                             for one in group]).T
        weight = 1.0 / sd**2 if (sd > 0.0).all() else np.ones(len(sd))
        result[symbol] = dict(mean=float(weight @ mean / weight.sum()),
                              sd=float(weight.sum()**-0.5) if (sd > 0.0).all() else 0.0)
    return result
