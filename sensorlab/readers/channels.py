"""Channels: one row of numbers among the arrays of a source."""

import difflib
import re
from typing import NamedTuple

from sensorlab.readers.clocks import unit_of

UNIT = re.compile(r"\s*[\[(]\s*(?!\d+\s*[\])])([^\[\]()]+?)\s*[\])]$")    # no index
INDEX = re.compile(r"\[\d+\]$")
INERTIAL = re.compile(r"gyr|acc|angular|omega|(?:^|[/_.])[gaw]_?[xyz]\b", re.I)
MIN_SAMPLES = 16    # fewer are no record


class Group(NamedTuple):
    """Arrays of a source that share a clock: a table, a topic, a message."""

    arrays: dict         # name -> array
    name: str = ""       # of the group, "" if it is the only one
    clock: str = ""      # name of the time stamps, "" where it must be guessed
    refused: dict = {}   # name -> why an array cannot be read


def fields(arrays):
    """The same arrays, but of one with named fields each field: by its own name where
    it is the only array, else by name/field.
    """
    found = {}
    for name, x in arrays.items():
        above = f"{name}/" * (len(arrays) > 1)
        found.update({above + field: x[field] for field in x.dtype.names}
                     if x.dtype.names else {name: x})
    return found


class Channel(NamedTuple):
    """One row of numbers and where it is found."""

    group: Group
    array: str     # name of its array
    axis: int      # of the array; 0 if it has one only
    name: str      # as a user would say it

    @property
    def values(self):
        return axes(self.array, self.group.arrays[self.array])[self.axis]

    @property
    def unit(self):
        found = UNIT.search(self.array)
        return found.group(1) if found else ""


def axes(name, x):
    """Rows (A, N) of an array: samples run along its longer side, but those of `error`
    along its rows, as `simulate` writes them, unless that is too few.
    """
    if x.ndim != 2:
        return x.reshape(1, -1)
    rows, columns = x.shape
    if rows <= columns or name == "error" and columns >= MIN_SAMPLES:
        return x
    return x.T


def channels(group):
    """All channels of a group: arrays of one or two dimensions, axis by axis."""
    above = f"{group.name}/" if group.name else ""
    for array, x in group.arrays.items():
        if x.ndim == 1 or x.ndim == 2 and x.size:
            number = len(axes(array, x))
            for k in range(number):
                yield Channel(group, array, k,
                              above + array + f"[{k}]" * (number > 1))
    for array in group.refused.keys() - group.arrays.keys():
        yield Channel(group, array, 0, above + array)


def find(groups, wanted):
    """The one channel of this name: its whole name, with or without the unit, or the
    end of its path, parts of which may be left out; of several axes or members name[k]
    is number k.

    Raises
    ------
    ValueError
        If there is none, or more than one; says which there are.
    """
    every = [c for group in groups for c in channels(group)]
    for names in (lambda c: (path(c.name), (c.array,)),
                  lambda c: (path(UNIT.sub("", c.name)), (UNIT.sub("", c.array),)),
                  lambda c: ends(path(c.name)),
                  lambda c: [path(wanted)] * leads(path(wanted), path(c.name))):
        fitting = [c for c in every if {path(wanted), (wanted,)} & {*names(c)}]
        if len(fitting) == 1:
            return _readable(fitting[0])
        if fitting:
            raise ValueError(f"{wanted} may be {listed(fitting)}: choose one with "
                             "--channel")
    parent, number = re.fullmatch(r"(.*?)(?:\[(\d{1,9})\])?", wanted, re.S).groups()
    members = [c for c in every if path(parent) in (
        *ends(path(c.name)[:-1]), *ends(path(INDEX.sub("", c.name))))]
    if number and int(number) < len(members):
        return _readable(members[int(number)])
    if members:
        raise ValueError(f"{wanted} is not one of {listed(members)}: choose one with "
                         "--channel")
    known = [c.name for c in every]
    near = difflib.get_close_matches(wanted, known, 1)
    shown = sorted((c for c in every if unit_of(c.array) is None),
                   key=lambda c: not INERTIAL.search(c.name))
    raise ValueError(f"no column {wanted!r} among {listed(shown) or 'none'}"
                     + (f" (did you mean {near[0]}?)" if near else "")
                     + "; choose one with --channel")


def path(name):
    """The parts of a path with / or dots."""
    return tuple(re.split("[/.]", name.strip("/")))


def leads(some, path):
    """Does a path end with the last of some of its parts, which come in order?"""
    rest = iter(path)
    return len(some) > 1 and some[-1:] == path[-1:] and all(p in rest for p in some)


def ends(path):
    """A path and all that it ends with: a b c, b c, c."""
    return [path[k:] for k in range(len(path))]


SHOWN = 24    # names in a message


def listed(some):
    """Names of channels, as many as a message holds."""
    names = [c.name for c in some]
    return ", ".join(names[:SHOWN]) + (
        f", ... ({len(names)} in all)" if len(names) > SHOWN else "")


def _readable(channel):
    """The channel, if it can be read and holds numbers."""
    if channel.array in channel.group.refused:
        raise ValueError(channel.group.refused[channel.array])
    if not real(channel.values):
        raise ValueError(f"{channel.name} holds {channel.values.dtype}: "
                         "real numbers are needed")
    return channel


def real(x):
    """Does an array hold real numbers?"""
    return x.dtype.kind in "iuf"
