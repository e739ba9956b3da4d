"""The axes of a sensor: channels whose names differ by x, y and z alone."""

import re

from sensorlab.readers.channels import (
    INDEX, INERTIAL, channels, ends, find, leads, listed, path)

SYSTEMS = (    # names of three axes, and of what makes a quaternion of them
    ("x", "y", "z", "w"), ("X", "Y", "Z", "W"), ("[0]", "[1]", "[2]", "[3]"),
    ("roll", "pitch", "yaw", "w"))


def vectors(names):
    """Names that differ by the axis alone: three of an axis each, or the four of a
    quaternion.
    """
    present, found = set(names), []
    for name in names:
        for first, *others in SYSTEMS:
            for at in re.finditer(re.escape(first), name):
                whole = [name, *(name[:at.start()] + axis + name[at.end():]
                                 for axis in others)]
                if present.issuperset(whole[:3]):
                    found.append(whole[:3 + (whole[-1] in present)])
    return found


def axes_in(some):
    """Those of some channels that are axes: of inertial sensors, if names tell."""
    rows = [c for c in some if c.array != "error"]    # of error they are records
    triads = [v for v in vectors([c.name for c in rows]) if len(v) == 3]
    triads = [triad for triad in triads if INERTIAL.search(triad[0])] or triads
    names = {name for triad in triads for name in triad}
    return [c for c in rows if c.name in names]


def find_several(groups, wanted):
    """Channels by their names, comma-separated; the name of an array, a topic or a
    message stands for its axes, `all` for those of the source, or the rows of `error`.

    Raises
    ------
    ValueError
        If there is none, or if it is open which are meant.
    """
    try:
        return [find(groups, wanted)]    # a comma may be part of a name
    except ValueError:
        parts = [part.strip() for part in wanted.split(",") if part.strip()]
    found = {}
    for part in parts or [wanted]:
        for c in _all(groups) if part == "all" else _named(groups, part):
            found[c.group.name, c.array, c.axis] = c
    return list(found.values())


def _all(groups):
    every = [[*channels(group)] for group in groups]
    rows = [c for own in every for c in own if c.array == "error"]
    if rows:
        return rows
    sets = [axes for axes in map(axes_in, every) if axes]
    inertial = [axes for axes in sets if INERTIAL.search(axes[0].name)]
    sets = inertial or sets
    if len(sets) == 1:
        return sets[0]
    if sets:
        raise ValueError("all: there are axes in "
                         + ", ".join(axes[0].group.name for axes in sets)
                         + ": choose with --channel")
    raise ValueError("all: no names differ by x, y, z alone among "
                     f"{listed([c for own in every for c in own]) or 'none'}: "
                     "choose with --channel NAME,NAME,...")


def _named(groups, name):
    """The channel of a name, or all axes of what it names."""
    try:
        return [find(groups, name)]
    except ValueError:
        every = [c for group in groups for c in channels(group)]
        rows = [c for c in every if path(name) in ends(path(INDEX.sub("", c.name)))
                and INDEX.search(c.name)]
        inside = [c for c in every if path(name) in (
            path(c.group.name), *ends(path(c.name)[:-1]))
            or leads(path(name), path(c.name)[:-1])]
        for some in (rows, axes_in(inside)):
            if some and len({(c.group.name, INDEX.sub("", c.array)
                              if some is rows else "") for c in some}) == 1:
                return some
        raise
