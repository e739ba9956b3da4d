"""Clocks: the even sampling interval behind time stamps of any unit, with jitter, gaps
or bursts.
"""

import itertools
import re
from typing import NamedTuple

import numpy as np

from sensorlab.readers.dates import DAY, of_digits, of_texts, read_digits

UNITS = {    # word of a name -> (unit, s)
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), ("s", 1.0)),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisec", "millisecond",
                     "milliseconds"), ("ms", 1e-3)),
    **dict.fromkeys(("us", "\u00b5s", "\u03bcs", "usec", "usecs", "micros",
                     "microsec", "microsecond", "microseconds"), ("us", 1e-6)),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecond",
                     "nanoseconds"), ("ns", 1e-9)),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), ("min", 60.0)),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), ("h", 3600.0)),
    **dict.fromkeys(("d", "day", "days"), ("d", 86400.0))}
CLOCKS = {"time", "times", "timestamp", "timestamps", "stamp", "t", "date", "datetime",
          "utc", "epoch", "clock", "tow", "zeit"}
BESIDE = {"host", "sensor", "device", "system", "log", "boot", "gps", "local", "unix",
          "ros", "header", "since", "start", "elapsed", "in", "of", "the", "sample",
          "sampling", "arrival", "received", "recorded", "tv", "week", "i"}
WORDS = re.compile("(?:[A-Z]+(?![a-z])|[A-Z]?[a-z\u00b5\u03bc]+)[0-9]*")
FOLDERS = re.compile(r"^[^\[(]*/")    # before the name, as of a struct in a struct
MULTIPLE = re.compile(r"[\[(]\s*(\d*\.?\d+)(?:/(\d*\.?\d+))?\s*[a-zA-Z\u00b5\u03bc]")
EPOCH = 9.4e8, 4.2e9    # s: the years 1999 to 2103


def unit_of(name):
    """(unit, s) of a clock by its name, such as timestamp [ns] or TimeUS; () where the
    name says none, None where it is the name of no clock.
    """
    words = {word.lower() for word in WORDS.findall(FOLDERS.sub("", name))
             if word != "T"}
    units = sorted(words & UNITS.keys())
    if len(units) < 2 and words - {*units} <= CLOCKS | BESIDE and (
            words & CLOCKS or words == {"sample", "us"}    # an hour may be of a day
            or any(len(unit) > 2 and UNITS[unit][1] <= 1.0 for unit in units)):
        return _multiple(name, *UNITS[units[0]]) if units else ()
    return None


def _multiple(name, unit, scale):
    """A unit and its scale, s, with the number that may stand before it: [0.1 ms]."""
    number = MULTIPLE.search(name)
    if not number:
        return unit, scale
    over, under = (float(part or 1.0) for part in number.groups())
    return f"{over / under:g} {unit}", scale * over / under


def tells_time(name):
    """Is a column a clock, a part of one, or an interval, by its name?"""
    return unit_of(name) is not None or bool(
        {word.lower() for word in WORDS.findall(name)} & {"timestamp", "dt"})


class Clock(NamedTuple):
    """Where the samples of a record lie on an even grid."""

    dt: float    # s
    said: str    # where it comes from, in words
    slots: np.ndarray = None    # (N,) place of every sample on the grid, a whole number
                                # or, of an uneven clock, not; None: in turn
    guess: str = ""             # unit of the stamps, where only their size tells it
    even: bool = True           # do the stamps themselves lie on that grid?

    def placed(self, x):
        """Values (N,) on the grid, each at the nearest place; NaN where there is none.

        White noise stays white, which it would not if it were interpolated.
        """
        if self.slots is None:
            return x
        nearest = np.round(self.slots).astype(int)
        # of several, the nearest is the last, which stays
        order = np.argsort(-np.abs(self.slots - nearest), kind="stable")
        even = np.full(nearest[-1] + 1, np.nan)
        even[nearest[order]] = x[order]
        return even


WIDE = 2.5      # sampling intervals: a wider step tells nothing of an uneven clock
CLEAN = 0.25    # of an interval: steps this near to a multiple of it leave no doubt
MOST = 100      # times as many samples as there are: a record with more gaps is none
OFTEN = 0.02    # of the steps: a gap that comes again and again
RARE = 0.01     # of the steps: gaps that come now and then
REGULAR = 20    # gaps: as many come by chance in no such order that all stamps are
WITHIN = 0.6    # of a usual step, that stamps of an even clock are off a line
ADRIFT = 0.005    # of a record, that its clock may gain or lose: it wanders


@np.errstate(over="ignore", invalid="ignore")
def clock(name, time, resample=False):
    """`Clock` of the stamps of a record.

    Parameters
    ----------
    name : str
        Of the stamps; may say their unit.
    time : (N,) array
        Numbers, datetime64 or texts in ISO 8601.
    resample : bool
        Take samples at uneven stamps at the nearest even time, instead of refusing.

    Raises
    ------
    ValueError
        If they do not increase, or no even clock explains them.
    """
    t, source, guess = in_seconds(name, time)
    step = np.diff(t)
    if (step < 0.0).any() or 0 < (step == 0.0).sum() < 0.01 * len(step):
        k = int(np.argmax(step <= 0.0))
        todo = "sort the record" if (step < 0.0).any() else "leave one of them out"
        raise ValueError(f"time does not increase from sample {k} ({t[k]:g} s after "
                         f"the first) to the next ({t[k + 1]:g} s): {todo}, "
                         "or give --dt if it is evenly sampled")
    if not np.isfinite(t.sum()):
        raise ValueError(f"{name} runs from {time[0]} to {time[-1]}: no record is as "
                         "long")
    if len(t) < 2:
        raise ValueError(f"the record has {len(t)} samples: a line is needed for each")
    if t[-1] == 0.0:
        raise ValueError(f"{name} is the same for all {len(t)} samples: give the "
                         "sampling interval with --dt")
    usual = np.median(step) or step.mean()
    found = (_with_gaps(t, step, usual) or _with_jitter(t)
             or _in_pieces(t, step, usual) or _in_ticks(t, step)
             or _in_bursts(t, step))
    if found and found.slots is not None:
        wide = step > 1.5 * found.dt
        if wide.sum() >= REGULAR:    # steps of stamps that are coarser than an interval
            found = _with_jitter(t, WITHIN * found.dt) or found
        if found.slots is not None and wide.mean() > OFTEN:
            found = _in_bursts(t, step) or found    # most of it missing, over and over
    if found is None and t[-1] / usual > MOST * len(t):
        raise ValueError(f"{len(t)} samples, usually {usual:g} s apart, are spread "
                         f"over {t[-1]:g} s: cut the gap after sample {step.argmax()} "
                         "out")
    if found is None and not resample:
        off = np.abs(step - usual)
        raise ValueError(f"the record is uneven: the step after sample {off.argmax()} "
                         f"is {step[off.argmax()]:g} s where {usual:g} s is usual; "
                         "--resample takes each sample at the nearest even time, --dt "
                         "takes the samples as even")
    if found is None:
        dt = step.mean()
        if np.median(step) > 0.0:    # else most stamps stand still
            dt = step[step < WIDE * dt].mean()
        found = Clock(dt, ", uneven, each sample at the nearest even time", t / dt,
                      even=False)
    source += f", taken as {guess}" * bool(guess)
    return found._replace(dt=_of_few_digits(found.dt), guess=guess,
                          said=f"dt {duration(found.dt)} from {source}{found.said}")


def _of_few_digits(dt):
    """An interval of ten digits at most, if what follows is but rounding of a mean."""
    few = float(f"{dt:.10g}")
    return few if abs(few - dt) < ROUNDING * dt else dt


ROUNDING = 1e-13    # of an interval


def _with_gaps(t, step, usual):
    """The clock if all steps are multiples of an interval."""
    count = np.maximum(np.round(step / usual), 1.0)
    dt = t[-1] / count.sum()
    if np.abs(step - count * dt).max() > CLEAN * dt or count.sum() > MOST * len(t):
        return None
    slots = np.append(0, np.cumsum(count)).astype(int)
    if np.abs(t - dt * slots).max() > max(0.5 * dt, ADRIFT * t[-1]):    # of two rates
        return None
    return Clock(dt, "", slots if slots[-1] > len(step) else None)


def _with_jitter(t, most=None):
    """The clock if no stamp is half an interval off, or `most`, s, none missing."""
    i = np.arange(len(t))
    dt, start = np.polyfit(i, t, 1)
    off = np.abs(t - start - dt * i).max()
    if off > (most or 0.5 * dt):
        return None
    return Clock(dt, f", off by up to {100 * off / dt:.0f} % of it")


def _in_pieces(t, step, usual):
    """The clock if no stamp is half an interval off between a few gaps, which may be of
    any length.
    """
    gap = step > 1.5 * usual
    if not 0 < gap.sum() <= RARE * len(step):
        return None
    i, dt = np.arange(len(t)), step[~gap].mean()
    if not dt:    # stamps stand still
        return None
    first = np.append(0, np.flatnonzero(gap) + 1)
    off = t / dt - i
    low, high = np.minimum.reduceat(off, first), np.maximum.reduceat(off, first)
    start = np.round(0.5 * (low + high)).astype(int)
    if (high - low).max() > 1.0 or (np.diff(start) < 0).any() or (
            start[-1] > MOST * len(t)):
        return None
    slots = i + np.repeat(start - start[0], np.diff(np.append(first, len(t))))
    count = int(gap.sum())
    return Clock(dt, f" but for {count} gap{'s' * (count > 1)}, off by up to "
                     f"{50 * (high - low).max():.0f} % of it", slots)


def _in_ticks(t, step):
    """The clock at the mean rate if it counts in steps of up to two intervals, so that
    some samples have the stamp of the one before.
    """
    tick = step[step > 0.0].min()
    dt, start = np.polyfit(np.arange(len(t)), t, 1)
    off = np.abs(t - start - dt * np.arange(len(t))).max()
    away = np.abs(step / tick - np.round(step / tick)).max()
    if step.all() or not np.median(step) or away > CLEAN or off > WITHIN * tick:
        return None
    return Clock(dt, f", which counts in steps of {duration(tick)}", even=False)


def _in_bursts(t, step):
    """The clock at the mean rate if stamps are of the arrival of whole bursts, as on a
    serial port: most steps far below the mean, but never far off the mean rate.
    """
    i = np.arange(len(t))
    usual, dt = np.median(step), t[-1] / i[-1]
    if not usual:    # stamps stand still, the last for a part of its time
        dt = np.polyfit(i, t, 1)[0]
    off = np.abs(t - dt * i).max()
    if usual > 0.5 * dt or off > min(max(200 * dt, 1e-3 * t[-1]), 0.1 * t[-1]):
        return None
    return Clock(dt, f" at the mean rate, {1 / dt:.4g} Hz: the stamps come in bursts, "
                     f"usually {duration(usual)} apart, up to {off:.2g} s off",
                 even=False)


def stamps(arrays, known, samples):
    """(name, stamps) of the clock among the arrays of a group: the one that is known,
    else by its name, or two that are parts of one; None where none has as many stamps
    as there are samples.
    """
    names = [name for name, x in arrays.items() if unit_of(name) is not None
             and x.shape in ((samples,), (samples, 1), (1, samples))]
    names.sort(key=lambda name: (name != known, name != "time"))
    clocks = {name: arrays[name].ravel() for name in names}
    return (None if known in clocks else _joined(clocks)) or next(
        iter(clocks.items()), None)


def _joined(clocks):
    """A clock in two parts, which are whole seconds and what is beyond them, or a date
    and a time of day, as (names, timedelta64); None where there is none.
    """
    for whole, part in itertools.permutations(clocks, 2):
        x, y = clocks[whole], clocks[part]
        units = [unit_of(name) for name in (whole, part)]
        if all(units) and units[0][0] == "s" and _stem(whole) == _stem(part) and (
                all(one.dtype.kind in "iuf" and (one == np.round(one)).all()
                    for one in (x, y)) and (y >= 0).all()
                and (y < 1.0 / units[1][1] - 0.5).all()):
            ns = np.array([10**9 * int(one) for one in x]) + np.round(
                1e9 * units[1][1] * y).astype(np.int64)
            return f"{whole} and {part}", ns.astype("timedelta64[ns]")
        if _stem(whole) + "/" + _stem(part) in ("date/time", "date/utc"):
            days, time = _nanoseconds(x, "YYYYMMDD"), _nanoseconds(y, "hhmmss")
            if days is not None and time is not None and not (days % DAY).any():
                return f"{whole} and {part}", (days + time % DAY).astype(
                    "timedelta64[ns]")
    return None


def _stem(name):
    """The name of a clock without its unit."""
    return "".join(word.lower() for word in WORDS.findall(name)
                   if word.lower() not in UNITS)


def _nanoseconds(time, form):
    """Times, ns, of texts or of numbers with these digits, or None."""
    if time.dtype.kind in "iuf":
        return read_digits(time, form)
    try:
        return of_texts("", time)
    except ValueError:
        return None


def in_seconds(name, time):
    """Stamps in s after the first, what they are in words, and their unit where that
    is only guessed.

    A unit is taken from the name; without one an epoch is known by its size, whole
    numbers with steps of half hours are s, of 1000 and more us, from 10^6 on ns,
    integers with steps of 2 to 50 ms (20 to 500 Hz rather than every 2 to 50 s), digits
    of a date or of a time of day by their steps, days of a spreadsheet by both, all
    else is s.
    """
    time, scale, *told = _counted(name, time)
    return (time - time[:1]).astype(float) * scale, *told


def since_zero(name, time):
    """Stamps in s since the zero of their clock."""
    time, scale, *_ = _counted(name, time)
    return time.astype(float) * scale


def _counted(name, time):
    """Stamps as numbers, their unit in s, what they are in words, and the name of the
    unit where their size tells it and is not s.
    """
    kind = time.dtype.kind
    if kind in "mM" and np.isnat(time).any() or kind == "f" and not (
            np.isfinite(time).all()):
        k = int(np.argmax(np.isnat(time) if kind in "mM" else ~np.isfinite(time)))
        raise ValueError(f"time of sample {k} is {time[k]}: a number is needed")
    if kind == "m":    # since the start
        return time.astype("timedelta64[ns]").astype(np.int64), 1e-9, name, ""
    if kind == "M":
        time = time.astype("datetime64[ns]").astype(np.int64)
        return time, 1e-9, f"{name}, dates", ""
    if kind not in "iuf":
        return of_texts(name, time), 1e-9, f"{name}, dates", ""
    if kind in "iu":
        time = time.astype(np.int64)
    digits = None if unit_of(name) else of_digits(time)
    if digits:
        return digits[0], 1e-9, f"{name}, read as {digits[1]}", ""
    unit, scale = unit_of(name) or _plausible(time)
    guess = "" if unit_of(name) or unit == "s" else unit
    even = _unwrapped(time)
    return even, scale, name + ", unwrapped" * (even is not time), guess


def _unwrapped(time):
    """Stamps of a counter that began anew when its 16, 24 or 32 bits were full."""
    step = np.diff(time)
    back = step < 0
    if back.any() and not back.all() and time.min() >= 0:
        usual = np.median(step[~back])
        for size in (2**16, 2**24, 2**32):
            if time.max() < size and (step[back] + size > 0).all() and (
                    step[back] + size <= NEAR * usual).all():
                return time + size * np.append(0, np.cumsum(back))
    return time


NEAR = 10    # usual steps: a counter began anew if it went on within these


def _plausible(time):
    """(unit, s) of stamps whose name says none."""
    if not len(time):
        return UNITS["s"]
    largest, step = np.abs(time).max(), np.diff(time)
    usual = np.abs(np.median(step.astype(float)) or step.mean()) if len(step) else 0.0
    in_hours = len(step) and usual > 0.0 and not (step % HALF_AN_HOUR).any()
    for unit in ("s", "ms", "us", "ns"):
        if EPOCH[0] < largest * UNITS[unit][1] < EPOCH[1] and (
                unit != "s" or in_hours or 0.0 < usual < LEAST_US):
            return UNITS[unit]
    if any(low < time.min() and largest < high for low, high in DAYS) and (
            0.0 < usual < FAST):
        return UNITS["d"]
    if in_hours or not (time == np.round(time)).all():
        return UNITS["s"]
    if time.dtype.kind in "iu" and 2.0 <= usual <= 50.0:
        return UNITS["ms"]
    return UNITS["s" if usual < 1e3 else "us" if usual < 1e6 else "ns"]


HALF_AN_HOUR = 1800       # s: steps of this are no microseconds
LEAST_US = 500.0          # us: nothing is logged as fast as by smaller steps of these
DAYS = (25569, 73050), (719529, 767011)    # 1970 to 2100 in Excel and in MATLAB
FAST = 1e-4    # of a day, or s: no inertial sensor is logged as fast


def duration(seconds):
    """A time in its unit, as text."""
    for unit, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= 0.9995 * factor:
            break
    return f"{seconds / factor:.6g} {unit}"
