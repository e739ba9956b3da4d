"""What readings do to a record is seen in the values themselves."""

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import log_ndtr

from sensorid import brief
from sensorlab.gap.catalogue import CATALOGUE, lattice
from sensorlab.gap.effects import Found


class Reading(NamedTuple):
    """An effect of the reading that a record shows."""

    found: Found         # its values: lsb, limits or spans
    log_bayes: float     # a continuous simulator never repeats a value
    masked: np.ndarray   # (N,) samples that say nothing of the rest
    opaque: bool         # it hides what else there may be

    __repr__ = brief


COINCIDENCE = 23.0    # nats: what one repeated value in double precision is worth,
                      # about ln(1e10 distinguishable values in the noise)
TAIL = 4              # values next to the last one, of which the fullest counts
COARSE = 0.1          # of the white noise: a finer lattice is how a file was printed
HIDDEN = 0.05         # of the samples: more clipped ones are not missing at random, as
                      # the filters assume
HIDING = 2.0          # of the white noise: a coarser lattice adds more than a further
                      # white noise (B. Widrow, I. Kollar, "Quantization Noise", 2008)


ROUNDING = 1e-9       # of the white noise: equal but for rounding


def readings(scene):
    """Quantization, saturation and stuck samples of a record from which nothing was
    taken away, as a tuple of Reading.
    """
    y, N = scene.y, len(scene.y)
    lsb, noise = lattice_and_noise(y)
    limits, clipped = _clipped(y, lsb, noise)
    spans, stuck = _stuck(y, lsb, noise, clipped)
    seen = []
    if clipped.any():
        seen.append(Reading(_found("saturation", limits=limits),
                            COINCIDENCE * float(clipped.sum()), clipped,
                            bool(clipped.mean() > HIDDEN)))
    if spans:
        spans = [[float(begin * scene.dt), int(n)] for begin, n in spans]
        seen.append(Reading(_found("stuck", spans=spans),
                            COINCIDENCE * float(stuck.sum()), stuck, False))
    if lsb > COARSE * noise:
        seen.append(Reading(_found("quantization", lsb=lsb), COINCIDENCE * N,
                            np.zeros(N, bool), bool(lsb > HIDING * noise)))
    return tuple(seen)


def _found(name, **values):
    return Found(CATALOGUE[name], values=values)


def lattice_and_noise(y):
    """`lattice` of a record, and the standard deviation of its noise without it."""
    seen, lsb = y[~np.isnan(y)], lattice(y)
    return lsb, np.sqrt(max(np.mean(np.diff(seen)**2) / 2.0 - lsb**2 / 12.0, 0.0))


def _clipped(y, lsb, noise):
    """Limits, infinite where there is none, and the samples (N,) that lie on one: the
    last value is met far more often than a tail allows.
    """
    seen = y[~np.isnan(y)]
    clipped, limits = np.zeros(len(y), bool), []
    for sign in (-1.0, 1.0):
        end = sign * np.max(sign * seen)
        # on a lattice, a few far out may meet on one value: what is next to it counts
        before = max(np.sum(np.abs(y - (end - sign * k * lsb)) < 0.5 * lsb)
                     for k in range(1, TAIL + 1))
        least = 3 if lsb < COARSE * noise else 3 * TAIL
        full = np.sum(y == end) >= least + 2.0 * before + 6.0 * np.sqrt(before)
        limits.append(float(end) if full else sign * np.inf)
        clipped |= (y == end) & full
    return limits, clipped


def latent_mean(y, found):
    """Mean of a record before it was clipped, if any of the `Found` is a limit, else
    None: the most likely one if its values are normal (J. Tobin, Econometrica 26,
    1958).
    """
    limits = [one.values["limits"] for one in found if "limits" in one.values]
    if not limits:
        return None
    ends, seen = limits[0], y[~np.isnan(y)]
    inside = seen[(seen > ends[0]) & (seen < ends[1])]
    clipped = [(sign, end, np.sum(sign * (seen - end) >= 0.0))
               for sign, end in zip((-1.0, 1.0), ends) if np.isfinite(end)]
    start = inside if len(inside) > 1 and np.ptp(inside) else seen

    def misfit(at):
        mean, sigma = at[0], np.exp(at[1])
        z = (inside - mean) / sigma
        return 0.5 * z @ z + len(inside) * at[1] - sum(
            count * log_ndtr(sign * (mean - end) / sigma)
            for sign, end, count in clipped)
    return float(minimize(misfit, [start.mean(), np.log(start.std())],
                          method="Nelder-Mead").x[0])


def _stuck(y, lsb, noise, clipped):
    """Runs (first sample, length) of equal values longer than chance, and the samples
    (N,) of them but the first, which is a reading.
    """
    same = np.append(False, np.diff(y) == 0.0) & ~clipped
    start = np.flatnonzero(same & ~np.append(False, same[:-1]))
    length = np.flatnonzero(same & ~np.append(same[1:], False)) + 1 - start
    enough = 2
    if lsb:    # a value in the middle of its cell stays there by chance
        tie = math.erf(lsb / max(2.0 * np.sqrt(2.0) * noise, 1e-9 * lsb))
        enough = (max(2.0, np.log(1e-4 / len(y)) / np.log(tie)) if lsb < 2.0 * noise
                  else np.inf)
    spans = [(begin - 1, n + 1) for begin, n in zip(start, length) if n >= enough]
    stuck = np.zeros(len(y), bool)
    for begin, n in spans:
        stuck[begin + 1:begin + n] = True
    return spans, stuck


def as_read(full, seen):
    """A scene less what readings hide."""
    if not seen:
        return full
    return full._replace(y=without_readings(full, full.y[None], seen)[0])


def without_readings(scene, y, seen):
    """Records (R, N) like that of a scene with NaN where a reading says nothing more of
    the true value.
    """
    y = y.copy()
    for one in seen:
        if "limits" in one.found.values:
            low, high = np.subtract(one.found.values["limits"], scene.known)
            least = ROUNDING * scene.white
            y[(y <= low + least) | (y >= high - least)] = np.nan
        else:
            y[:, one.masked] = np.nan
    return y
