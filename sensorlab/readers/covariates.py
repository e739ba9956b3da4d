"""What was recorded beside a channel: in its own table or message, or in others, by
their clocks.
"""

from os.path import commonprefix

import numpy as np

from sensorlab.readers.axes import vectors
from sensorlab.readers.channels import MIN_SAMPLES, UNIT, channels, find, real
from sensorlab.readers.clocks import since_zero, stamps, tells_time

NAMED = {"temperature", "rate", "acceleration"}    # that effects are looked for by
AXES = "xyz"    # what they are called of another axis: rate_y
SHORT = dict(temp="temperature")
UNCOVERED = 0.1    # of a record: a column of another clock that leaves more of it out
                   # is none


def beside(groups, channel, wanted=None):
    """What was recorded beside a channel: dict of name -> (N,) array of float, and the
    names of other axes, which are not among them unless they are wanted.

    Wanted are names, NAME=COLUMN to give another name, or None for all of the same
    group that hold numbers. Units are no part of the names. Of an array of the same
    shape it is the same axis.
    """
    own, axes = _of_group(channel)
    if wanted is None:
        return _by_known_names({name: x for name, x in own.items() if name not in axes
                                and not _counts(x)}), axes
    chosen = {}
    for part in wanted:
        new, _, old = part.rpartition("=")
        if old in channel.group.refused:
            raise ValueError(channel.group.refused[old])
        short = old if old in own else UNIT.sub("", old)
        if short in own:
            chosen[new or short] = own[short]
        else:
            name, x = _of_another(groups, channel, old, own)
            chosen[new or name] = x
    return _by_known_names(chosen), ()


def _by_known_names(columns):
    """Columns, of which Temperature, or temp, is the temperature, and so on."""
    result = {}
    for name, x in columns.items():
        known = SHORT.get(name.lower(), name.lower())
        result[known if known in NAMED and known not in columns and known not in result
               else name] = x
    return result


def _of_group(channel):
    """Columns of the channel's own group, and which of them are other axes."""
    group, samples = channel.group, len(channel.values)
    shape = group.arrays[channel.array].shape
    every = list(channels(group))
    triads = vectors([c.name for c in every])
    of_axes = {name for one in triads for name in one}
    is_axis = channel.name in of_axes and channel.array != "error"
    known = _by_axis(channel, triads) if is_axis else {}
    found, axes = {}, []
    for c in every:
        if (c.array == channel.array or c.array in group.refused
                or not real(c.values) or len(c.values) != samples
                or c.array == group.clock or tells_time(c.array)):
            continue
        same = len(shape) == 2 and group.arrays[c.array].shape == shape
        named = known.get(c.name)
        if named != c.array and named in group.arrays:    # there is one of that name
            named = None
        if not same or c.axis == channel.axis or named:
            name = c.array if same else c.name.removeprefix(f"{group.name}/")
            short = UNIT.sub("", name)
            name = named or (name if short in found else short)
            found[name] = c.values.astype(float)
            if is_axis and c.name in of_axes and not named and name not in NAMED:
                axes.append(name)
    return found, tuple(axes)


def _by_axis(channel, triads):
    """Names that effects are looked for by, by the name of a channel: rate_x is the
    rate of gyro_x, and rate_y that of another axis; but not beside acceleration_x,
    which is recorded as it is.
    """
    mine = [triad for triad in triads if channel.name in triad[:3]]
    if not mine or any(_quantity(channel.group, triad) in NAMED for triad in mine):
        return {}
    at = {triad.index(channel.name) for triad in mine}
    return {name: quantity if k in at else f"{quantity}_{axis}"
            for triad in triads for k, (axis, name) in enumerate(zip(AXES, triad))
            if (quantity := _quantity(channel.group, triad)) in NAMED
            and (k in at or quantity != "temperature")}


def _quantity(group, triad):
    """What the names of three axes have in common, without a unit."""
    names = [UNIT.sub("", name.removeprefix(f"{group.name}/")) for name in triad[:3]]
    before, after = (commonprefix([name[::turn] for name in names])[::turn]
                     for turn in (1, -1))
    return (before + after).strip("_-./ []").lower()


def left_out(channel):
    """Why columns of a channel's own group are not among those beside it, in words:
    such as hold numbers, but for a few cells or for their length, and those that
    effects are looked for by. Text beside a record is none.
    """
    group, samples = channel.group, len(channel.values)
    for name, x in group.arrays.items():
        known = UNIT.sub("", name) in NAMED
        if name in (channel.array, group.clock) or tells_time(name) or x.ndim > 2 or (
                x.size < MIN_SAMPLES):
            continue
        if name in group.refused:
            if known or real(x):
                yield group.refused[name]
        elif not real(x):
            if known or x.dtype.kind in "bc":
                yield f"{name} holds no real numbers"
        elif samples not in x.shape:
            yield f"{name} has {max(x.shape)} values for {samples} samples"
        elif np.isnan(x).all():
            yield f"{name} holds no number"


def _counts(x):
    """Does a column only count the samples?"""
    step = np.diff(x)
    return len(step) > 1 and step[0] > 0.0 and bool((step == step[0]).all()) and (
        x[0] == round(x[0]) and step[0] == round(step[0]))


def _of_another(groups, channel, wanted, own):
    """Name and values of a channel on another clock, at the times of this one."""
    try:
        other = find([g for g in groups if g is not channel.group], wanted)
    except ValueError as problem:
        raise ValueError(
            f"no column {wanted!r} of {len(channel.values)} numbers beside "
            f"{channel.name}; there are {', '.join(own) or 'none'} (--covariates "
            "NAME=COLUMN says which it is)"
            + (f"; in other topics: {problem}" if len(groups) > 1 else "")) from None
    t, s = (_times(c) for c in (channel, other))
    x, order = other.values.astype(float), np.argsort(s, kind="stable")
    order = order[~np.isnan(x[order])]
    if not len(order):
        raise ValueError(f"{other.name} holds no numbers")
    outside = np.mean((t < s[order[0]]) | (t > s[order[-1]]))
    if outside > UNCOVERED:
        raise ValueError(f"{other.name} was not recorded in {100 * outside:.0f} % of "
                         f"the time of {channel.name}: it tells nothing there")
    return UNIT.sub("", other.array), np.interp(t, s[order], x[order])


def _times(channel):
    """When the samples of a channel were taken, s, as its clock counts."""
    clock = stamps(channel.group.arrays, channel.group.clock, len(channel.values))
    if not clock:
        raise ValueError(f"{channel.name} has no clock: columns of other topics are "
                         "taken by their time")
    return since_zero(*clock)
