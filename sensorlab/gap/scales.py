"""One factor on all standard deviations: what a record tells of it, all else given."""

from typing import Callable, NamedTuple

import numpy as np

from sensorid import Parameter, brief
from sensorlab.gap.filters import log_likelihoods


class ScaleLaw(NamedTuple):
    """How `integrate` draws a factor on all standard deviations.

    A record tells the factor times a standard deviation far better than either: in a
    simulator of wide ranges a thin bent ridge, on which a sample would stay where it
    began. Drawn is the factor over what is likeliest at the other parameters, about 1.
    """

    moved: Callable    # theta (M, p) with its factor times what is likeliest there, and
                       # ln prior of that over that of the factor as it was (M,)
    flat: tuple = ()

    __repr__ = brief

    def __call__(self, theta):
        return self.moved(theta)


def column_of_scale(h):
    """Number of the parameter of a hypothesis that is a factor on all standard
    deviations, of no range of its own; None if it has none.
    """
    for one in h.effects:
        if one.effect.factor:
            at = h.keys.index((one.key, "factor"))
            if not isinstance(h.parameters[at], Parameter):
                return at
    return None


def scale_law(h, scene, signatures):
    """`ScaleLaw` of a hypothesis; None if it has no such factor."""
    at = column_of_scale(h)
    if at is None:
        return None

    def likeliest(theta, near):
        for _ in range(1 + h.has_jumps):    # with jumps, only what is near tells it
            near = likeliest_scales(h, scene, signatures, theta, at, near)
        return near
    usual = likeliest(np.array([[p.mean for p in h.parameters]]), np.ones(1))

    def moved(theta):
        theta, before = theta.copy(), theta[:, at]
        theta[:, at] *= likeliest(theta, usual)
        # an exponential law of the logarithm
        return theta, np.abs(np.log(before)) - np.abs(np.log(theta[:, at]))
    return ScaleLaw(moved)


NEARBY = 1.1    # times a factor, another one


def likeliest_scales(h, scene, signatures, theta, at, near):
    """Likeliest factor (M,) on all standard deviations, in column `at` of theta (M, p),
    at the other parameters, as the likelihoods `near` some factor (M,) or (1,) tell; it
    itself, where a filter breaks down.

    All variances grow with its square: ln f(Y) of n samples is -n ln f - S / 2 f^2 and
    what does not depend on it, so that two factors tell S, and f^2 is S / n. With jumps
    this is nearly so.
    """
    def told(factor):
        there = theta.copy()
        there[:, at] = factor
        return log_likelihoods(h, scene, signatures, there)
    n = np.count_nonzero(~np.isnan(scene.y))
    more = told(NEARBY * near) - told(near) + n * np.log(NEARBY)
    with np.errstate(invalid="ignore"):
        scale = np.sqrt(2.0 * more / (1.0 - NEARBY**-2) / n)
    return near * np.where(scale > 0.0, scale, 1.0)
