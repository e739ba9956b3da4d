"""A digital low-pass that all of a sensor passes: what begins at once before it, or
follows a column, has edges as smooth as it leaves them.
"""

import functools
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter, ss2tf

from sensorlab.gap.effects import columns_of
from sensorlab.gap.kernels.adjoint import Shock
from sensorlab.gap.processes import digital, moved_by_level

ALTERED = 0.05    # of the spread of a column, that a low-pass takes away from it


class LowPass(NamedTuple):
    """A form of `bandwidth` that all passes, and its time constant."""

    variant: str
    tau: float    # s

    def _polynomials(self, dt):
        """Of z^-1: numerator and denominator."""
        return _polynomials(self.variant, dt / self.tau)

    def passed(self, columns, dt):
        """What comes out of columns (N, k) that were at rest before."""
        return lfilter(*self._polynomials(dt), columns - columns[0], axis=0
                       ) + columns[0]

    def alters(self, column, dt):
        """Is a column (N,) another where it has passed?"""
        x = column[:, None]
        return np.std(self.passed(x, dt) - x) > ALTERED * np.std(x)

    def back(self, rows, dt):
        """Rows (..., N) whose products with columns that are 0 at first are those of
        the given ones with what comes out of these.
        """
        return lfilter(*self._polynomials(dt), rows[..., ::-1])[..., ::-1]

    def power(self, turn, dt):
        """Of its response at turn = |1 - exp(-i w)|^2."""
        w = 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(turn), 1.0))
        back = np.exp(-1j * np.outer(np.arange(3), w))
        above, below = (p @ back[:len(p)] for p in self._polynomials(dt))
        return np.abs(above / below)**2

    def shock(self, dt):
        """A step as it is, and one that passes, as a `Shock`: less where they come to
        rest, its states decay.
        """
        A, _, C, _ = _states(self.variant, dt / self.tau)
        (moved,), _ = moved_by_level(self.variant, np.array([dt / self.tau]))
        m, n = 1 + len(A), len(A)
        turned = np.zeros((2, m))
        turned[0, 0], turned[0, 1:] = 1.0, np.diag(A)
        pair = np.arange(m)
        if n == 2:
            pair[1:] = 2, 1
            turned[1, 1:] = A[0, 1], A[1, 0]
        return Shock(turned, pair, np.append(1.0, C), np.array([
            np.eye(m)[0], np.append(1.0, moved)]))


def _states(variant, cut_off):
    """Matrices of s <- A s + B u, which puts out C s + D u."""
    filt = digital(variant, cut_off)
    (Phi,), (Gamma,), (H,) = filt.Phi, filt.Gamma, filt.H
    return Phi[:-1, :-1], Gamma[:-1], H[:-1], Gamma[-1]


@functools.lru_cache(16)    # of thousands of columns
def _polynomials(variant, cut_off):
    """Of z^-1: numerator and denominator."""
    A, B, C, D = _states(variant, cut_off)
    above, below = ss2tf(A, B, C[None] @ A, C[None] @ B + D)
    return above[0], below


def low_pass_of(member, theta):
    """The `LowPass` that all passes in a hypothesis at theta (p,), or None."""
    return next((LowPass(one.variant, float(member.value(theta, one.key, "tau")))
                 for one in member.effects if one.acts_on_all), None)


def low_pass_of_white(member, theta):
    """The `LowPass` that white noise passes, or None."""
    forms = {white: every for one in member.effects for every, white in
             one.effect.of_all}
    return next((LowPass(forms.get(one.variant, one.variant), float(member.value(
        theta, one.key, "tau"))) for one in member.effects if one.effect.of_all), None)


def families_passing(low_pass, listed):
    """Families of signatures of which a low-pass smooths the edges, as they pass it."""
    return [family._replace(low_pass=low_pass) for family in listed
            if family.effect.has_edges]


def signature_passing(low_pass, one, scene, every):
    """A `Signature` that passes a low-pass, or `every` that has edges, as it passes
    this one.
    """
    found = one.found
    passes = found.effect.has_edges and (found.low_pass or every)
    if not passes or one.given or found.low_pass == low_pass:
        return one
    found = found._replace(low_pass=low_pass)
    return one._replace(found=found, columns=columns_of(scene, found, found.values))
