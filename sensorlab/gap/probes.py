"""Probes: shifts of the level, and curves of the columns, that residuals are held
against.
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.special import eval_legendre

from sensorid import brief
from sensorlab.gap.effects import BLOCK
from sensorlab.gap.kernels.arithmetic import row_products
from sensorlab.gap.kernels.lanes import LANES
from sensorlab.gap.linear import Filter

SHIFTS = 32                # of the level, at even times
POLYNOMIAL_DEGREE = 5      # in a column: thermal models are of the third
MAX_CROSSED_COLUMNS = 5    # whose products are looked at: of more there are too many
WIDE = 4                   # blocks of samples that are whitened at a time


class Probes(NamedTuple):
    """What the residuals of the end of a record are held against, as a filter whitens
    it. It is not kept whitened: the residuals go back through the filter.
    """

    listed: tuple         # (place, ends, column) of each
    shifts: np.ndarray    # samples of the end at which the level shifts
    curves: np.ndarray    # (K, N) in single precision: a long record has many of them
    filter: Filter        # of the whole record
    first: int            # sample that the end begins with
    norm: np.ndarray      # (S,) of each, whitened

    __repr__ = brief

    def products(self, z):
        """Products (S, R) with residuals z (R, N)."""
        back = self.filter.whitened_back(z, self.first)
        of_curves = row_products(self.curves, back)
        between = np.add.reduceat(back, self.shifts, axis=1)
        after = between[:, ::-1].cumsum(1)[:, ::-1]    # sums from every shift on
        return np.vstack([after.T, of_curves]) / self.norm[:, None]

    def whitened_curves(self):
        """The curves whitened, (K, N), of unit norm; 0 in gaps. As the curves, they are
        to single precision: they are long.
        """
        white, done = np.empty_like(self.curves), 0
        for part in _few(self.curves, self.curves.shape[1]):
            own = slice(done, done + len(part))
            norm = self.norm[len(self.shifts):][own, None]
            white[own], done = self._whitened(part) / norm, own.stop
        return white

    def _whitened(self, rows):
        whole = np.zeros((len(rows), len(self.filter.gap)))
        whole[:, self.first:] = rows
        whole[:, self.filter.gap] = np.nan
        return np.nan_to_num(self.filter.whitened(whole)[:, self.first:])


def probes(scene, filter, first, like=None):
    """`Probes` of the end of a record from the sample `first` on, which is the scene;
    others are `like` them but for their filter, if these are known.
    """
    N = len(scene.y)
    listed, shifts, curves = like[:3] if like else _listed(scene)
    own = Probes(listed, shifts, curves, filter, first, None)
    parts = itertools.chain((np.arange(N) >= part[:, None] for part in _few(shifts, N)),
                            _few(curves, N))
    return own._replace(norm=1e-300 + np.sqrt(np.concatenate(
        [(own._whitened(part)**2).sum(1) for part in parts])))


def _listed(scene):
    """The first three parts of the `Probes` of a scene."""
    N, time = len(scene.y), scene.time
    shifts = np.linspace(0, N, SHIFTS + 2).astype(int)[1:-1]
    listed = [("time", (time[i], time[-1]), "") for i in shifts]
    curves = []
    for name, f in _curves(scene):
        if np.ptp(f) > 0.0:
            x = scene.columns[name]
            listed.append(("covariate", (x.min(), x.max()), name))
            curves.append((f - f.mean()).astype(np.float32))
    return tuple(listed), shifts, np.array(curves, np.float32).reshape(-1, N)


def _curves(scene):
    """(name, function (N,)) of the columns, and of all pairs of them and the time: one
    may change what another does.
    """
    scaled = {name: 2.0 * (x - x.min()) / np.ptp(x) - 1.0
              for name, x in scene.columns.items() if np.ptp(x) > 0.0}
    for name, x in scaled.items():
        for n in range(1, POLYNOMIAL_DEGREE + 1):
            yield name, eval_legendre(n, x)
        moved = np.append(0.0, np.diff(x))
        yield name, moved
        yield name, np.sign(moved)    # hysteresis
    if len(scaled) <= MAX_CROSSED_COLUMNS:
        time = scene.time / scene.time[-1] - 0.5
        for (name, x), (_, z) in itertools.combinations(
                (*scaled.items(), ("", time)), 2):
            yield name, x * z


def _few(rows, N):
    """Rows, as many at a time as are worked on where each has N samples."""
    most = int(np.clip(WIDE * BLOCK // N, 1, LANES))
    return (rows[begin:begin + most] for begin in range(0, len(rows), most))
