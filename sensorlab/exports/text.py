"""What all files say: the sensor, the convention, its pairs, what is lost."""

import textwrap
from typing import NamedTuple

import numpy as np

from sensorlab.exports.bound import pairs


class Export(NamedTuple):
    """A file for another program."""

    text: str
    lost: tuple    # of str: what the program cannot have of the model


class Choice(NamedTuple):
    """Which pair a program of two numbers gets."""

    pair: str = "bound"       # or fitted, x10
    horizon: float = 60.0     # s


def pair_of(axis, choice):
    return pairs(axis, choice.horizon)[choice.pair]


def export(axes, convention, body, lost=(), begin="# ", end="", choice=None, head=""):
    """A file: comments, then its body.

    Parameters
    ----------
    axes : sequence of Axis
    convention : str
        What the numbers mean to the program, and where that is written.
    body : sequence of str
        Lines.
    lost : sequence of str
        What the program cannot have, beside what no program has.
    begin, end : str
        Of a line of comment.
    choice : Choice, optional
        Where the program gets a pair.
    head : str
        What must stand in the first line of the file.
    """
    lost = tuple(dict.fromkeys([*lost, *(s for axis in axes for s in axis.strange)]))
    said = [f"{a.kind}: {a.name}, every {a.dt:g} s" for a in axes]
    said += _wrapped(convention, 84 - len(begin))
    for axis in axes if choice else ():
        said += _pair_table(axis, choice)
    said += [line for s in lost for line in _wrapped(f"Lost: {s}", 84 - len(begin))]
    comments = [f"{begin}{line}{end}".rstrip() for line in said]
    return Export("\n".join([*([head] if head else []), *comments, *body]) + "\n", lost)


def _wrapped(text, width):
    return textwrap.wrap(text, width, subsequent_indent="    ",
                         break_on_hyphens=False, break_long_words=False)


def _pair_table(axis, choice):
    yield (f"{axis.kind}: integrated error up to {choice.horizon:g} s, bias from as "
           "long a time at rest before")
    yield f"  {'':<8}{'density, ' + axis.unit + '/sqrt(Hz)':<28}{_walk_unit(axis)}"
    for name, pair in pairs(axis, choice.horizon).items():
        yield (f"  {name:<8}{pair.density:<28.6g}{pair.walk:<24.6g}"
               + "<- written" * (name == choice.pair))


def _walk_unit(axis):
    return "walk, " + {"rad/s": "rad/s^2", "m/s^2": "m/s^3"}[axis.unit] + "/sqrt(Hz)"


def of_numbers(axes, choice, instead="a walk"):
    """What is lost where a program knows two numbers, or one."""
    for axis in axes:
        _, processes = axis.parts
        if any(p.a < 1.0 for p in processes):
            yield (f"correlation times of the {axis.kind}: {instead} that bounds the "
                   "error stands for them")
        yield from jumps(axis)
        yield from readings(axis)
        begin = start(axis, choice)
        if begin:
            yield (f"the bias of the {axis.kind} at the start, of standard deviation "
                   f"{begin:.4g} {axis.unit}: give it as that of the initial bias, "
                   "where the program asks for one")


def slow_and_fast(axis, choice):
    """The processes of an axis: those that a program takes for its bias, with a
    correlation time of a tenth of the horizon and more, and the others.
    """
    _, processes = axis.parts
    slow = [p for p in processes
            if p.a == 1.0 or -axis.dt / np.log(p.a) >= 0.1 * choice.horizon]
    return slow, [p for p in processes if p not in slow]


def start(axis, choice):
    """Standard deviation of the bias at the start, slow processes among it."""
    slow, _ = slow_and_fast(axis, choice)
    return float(np.sqrt(axis.bias**2 + sum(p.start**2 for p in slow)))


def readings(axis):
    """Readings of an axis in words, for programs that have none."""
    if axis.lsb:
        yield (f"rounding to {axis.lsb:.4g} {axis.unit} of the {axis.kind}: white "
               "noise of the same variance stands for it")
    if np.isfinite(axis.limits).any():
        yield (f"limits {axis.limits[0]:.4g}, {axis.limits[1]:.4g} {axis.unit} of the "
               f"{axis.kind}")


def jumps(axis):
    """Noise that is not Gaussian in words, for programs that have none."""
    own = axis.jumps
    for there, name, instead in (
            (own.rate, "outliers", "white noise of the same variance"),
            (own.half, "the two levels", "a Markov process of the same covariance"),
            (own.step, "the steps", "a random walk of the same covariance"),
            (own.louder, "bursts of noise", "white noise of the same mean variance")):
        if there:
            yield f"{name} of the {axis.kind}: {instead} stands for them"
