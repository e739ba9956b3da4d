"""How the parameters of a simulator hang together, as far as its own record tells.

Alone, each may lie anywhere in its range. Slow noise may be weak and fast, or strong
and slow; ranges alone let it be strong and fast, too, which no record of it is.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.stats.qmc import LatinHypercube

from sensorid import Parameter, at_quantiles, brief, free_columns
from sensorlab.gap.evidence import effort, log_sum, or_nothing
from sensorlab.gap.filters import log_likelihoods


class Joint(NamedTuple):
    """Log-likelihood of a simulator's own record, as a function of its parameters."""

    keys: tuple                 # (effect, symbol) of d parameters, as of a `Member`
    low: np.ndarray             # (d,) ends of their ranges
    high: np.ndarray            # (d,)
    surface: RBFInterpolator    # of it, over where in the ranges they are

    __repr__ = brief

    def at(self, h, theta):
        """SHARE of it (M,) at parameters theta (M, p) of a `Member`, less a constant.
        Of those that the member lacks, or that may leave their ranges, as wrong ones
        may, the simulator has any: the mean likelihood counts.
        """
        prior = dict(zip(h.keys, h.parameters))
        known = np.array([key in prior and least <= prior[key].low and (
            prior[key].high <= most) for key, least, most in zip(
                self.keys, self.low, self.high)])
        own = np.zeros((len(theta), len(known)))
        for column in np.flatnonzero(known):
            own[:, column] = h.value(theta, *self.keys[column])
        if known.all():
            return self._in(own)
        own = np.repeat(own, AVERAGED, axis=0)
        u = LatinHypercube(int(np.sum(~known)), rng=0).random(AVERAGED)
        low, high = self.low[~known], self.high[~known]
        own[:, ~known] = np.tile(low + u * (high - low), (len(theta), 1))
        return log_sum(self._in(own).reshape(-1, AVERAGED), axis=1) - np.log(AVERAGED)

    def _in(self, theta):
        """The same at parameters (M, d) in their ranges; between nodes it is never
        higher than at the highest.
        """
        return SHARE * np.minimum(self.surface(_place(
            theta, self.low, self.high)), 0.0)


SHARE = 0.5      # that counts: records of a real sensor are about as far apart as one
                 # tells; each parameter alone is then as free as in its range
AVERAGED = 32    # parameters that stand for a range
ROUND = 256      # nodes of a round, fewer for a long record
MAX_ROUNDS = 6
SIEVED = 16      # times as many places, of which those that seem high are taken
GOOD = 0.1       # nats: root mean square error at which no further round is needed
USABLE = 1.0     # beyond it the ranges alone are what is known
NEAR = 12.0      # nats below the peak, within which a surface must be good
DEEPEST = 60.0   # below which a node tells nothing
MARGIN = 0.5     # of a range, beyond its ends, where nodes count


def joint_of(scene, acc, ranges):
    """`Joint` of an account of the scene in which a simulator's own record is, and the
    ranges of all of its parameters; None where none has one, or no surface is near.
    """
    h, columns = acc.member, free_columns(ranges)
    if not columns or any(one.effect.factor for one in h.effects):
        return None
    low, high = (np.array([getattr(ranges[c], end) for c in columns])
                 for end in ("low", "high"))
    placed = [Parameter(p.symbol, p.low, p.high, p.low > 0.0) for p in ranges]

    def log_likelihood(place):
        return or_nothing(log_likelihoods(
            h, scene, acc.signatures, at_quantiles(placed, place)))
    own = acc.sample
    surface = surface_of(log_likelihood, _place(own.theta[:, columns], low, high),
                         own.log_likelihood[:, 0], round(ROUND * effort(scene)))
    return surface and Joint(tuple(h.keys[c] for c in columns), low, high, surface)


def surface_of(log_likelihood, place, value, count):
    """A function (M, d) -> (M,) near a log-likelihood in the unit cube, less its peak,
    through what is known at some places (m, d) and at `count` more a round, first in
    all of the cube, then where it seems to be high; None if it stays far from it.
    """
    d = place.shape[1]
    tried = LatinHypercube(d, rng=0).random(count)
    told = log_likelihood(tried)
    for number in range(1, MAX_ROUNDS):
        place, value = np.vstack([place, tried]), np.append(value, told)
        surface = _through(place, value)
        tried = LatinHypercube(d, rng=number).random(SIEVED * count)
        tried = tried[surface(tried) > -NEAR][:count]
        if not len(tried):
            return surface
        told = log_likelihood(tried)
        error = np.sqrt(np.mean((surface(tried) - told + value.max())**2))
        if error < GOOD:
            return surface
    return surface if error < USABLE else None


def _through(place, value):
    """The function through values at places, less the highest: a parabola and cubic
    radial functions.
    """
    known = (np.abs(place - 0.5) <= 0.5 + MARGIN).all(1) & (
        value > value.max() - DEEPEST)
    place, first = np.unique(place[known].round(6), axis=0, return_index=True)
    d = place.shape[1]
    parabola = (d + 1) * (d + 2) // 2    # its coefficients
    return RBFInterpolator(place, value[known][first] - value.max(), kernel="cubic",
                           degree=2 if len(place) >= 2 * parabola else 1)


def _place(theta, low, high):
    """Where in their ranges parameters (M, d) are, 0..1; by logarithms, if they are
    positive.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(low > 0.0, np.log(theta / low) / np.log(high / low),
                        (theta - low) / (high - low))
