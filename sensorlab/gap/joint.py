"""How the parameters of a simulator hang together, as far as its own record tells.

Alone, each may lie anywhere in its range. Slow noise may be weak and fast, or strong
and slow; ranges alone let it be strong and fast, too, which no record of it is.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.stats.qmc import LatinHypercube

from sensorid import brief, free_columns
from sensorlab.gap.evidence import effort, log_sum
from sensorlab.gap.filters import log_likelihoods


class Joint(NamedTuple):
    """Log-likelihood of a simulator's own record, as a function of its parameters."""

    keys: tuple                 # (effect, symbol) of d parameters, as of a `Member`
    low: np.ndarray             # (d,) ends of their ranges
    high: np.ndarray            # (d,)
    surface: RBFInterpolator    # of it, over where in the ranges they are

    __repr__ = brief

    def at(self, h, theta):
        """It (M,) at parameters theta (M, p) of a `Member`, less a constant. Of those
        that the member lacks, or that may leave their ranges, as wrong ones may, the
        simulator has any: the mean likelihood counts.
        """
        prior = dict(zip(h.keys, h.parameters))
        known = np.array([key in prior and least <= prior[key].low and (
            prior[key].high <= most) for key, least, most in zip(
                self.keys, self.low, self.high)])
        own = np.zeros((len(theta), len(known)))
        own[:, known] = theta[:, [h.keys.index(key) for key, yes in zip(
            self.keys, known) if yes]]
        if known.all():
            return self.surface(_place(own, self.low, self.high))
        own = np.repeat(own, AVERAGED, axis=0)
        u = LatinHypercube(int(np.sum(~known)), rng=0).random(AVERAGED)
        low, high = self.low[~known], self.high[~known]
        own[:, ~known] = np.tile(low + u * (high - low), (len(theta), 1))
        return log_sum(self.surface(_place(own, self.low, self.high)).reshape(
            -1, AVERAGED), axis=1) - np.log(AVERAGED)


AVERAGED = 64    # parameters that stand for a range
NODES = 256      # in all ranges, beside those of the posterior
MARGIN = 0.5     # of a range, beyond its ends, where nodes of the posterior count
DEEPEST = 60.0   # nats below the best node, from which on one tells nothing


def joint_of(scene, acc, ranges):
    """`Joint` of an account of the scene in which a simulator's own record is, and the
    ranges of all of its parameters; None where none has one.

    Between nodes, by cubic radial functions beside a parabola, it is good to 0.03 nats
    where the posterior is, and to 0.2 within 12 nats of its peak, for four parameters
    and for eight.
    """
    h = acc.member
    columns = [c for c in free_columns(ranges) if h.parameters[c].free]
    if not columns or any(one.effect.factor for one in h.effects):
        return None
    low, high = (np.array([getattr(ranges[c], end) for c in columns])
                 for end in ("low", "high"))
    place = LatinHypercube(len(columns), rng=0).random(round(NODES * effort(scene)))
    theta = np.tile(acc.theta, (len(place), 1))
    theta[:, columns] = _value(place, low, high)
    own = acc.sample
    place = np.vstack([place, _place(own.theta[:, columns], low, high)])
    value = np.append(log_likelihoods(h, scene, acc.signatures, theta),
                      own.log_likelihood[:, 0])
    counts = (np.abs(place - 0.5) <= 0.5 + MARGIN).all(1) & (
        value > value.max() - DEEPEST)
    place, first = np.unique(place[counts], axis=0, return_index=True)
    d = len(columns)
    parabola = (d + 1) * (d + 2) // 2    # its coefficients
    return Joint(tuple(h.keys[c] for c in columns), low, high, RBFInterpolator(
        place, value[counts][first] - value.max(), kernel="cubic",
        degree=2 if len(place) >= 2 * parabola else 1))


def _place(theta, low, high):
    """Where in their ranges parameters (M, d) are, 0..1; by logarithms, if they are
    positive.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(low > 0.0, np.log(theta / low) / np.log(high / low),
                        (theta - low) / (high - low))


def _value(place, low, high):
    """The parameters (M, d) at these places."""
    with np.errstate(invalid="ignore"):
        return np.where(low > 0.0, low * (high / low)**place,
                        low + place * (high - low))
