"""What readings hide is seen in the values themselves."""

import math
from typing import NamedTuple

import numpy as np

from sensorlab.gap.effects import lattice


class Reading(NamedTuple):
    """An effect of the reading that a record shows."""

    effect: str
    value: dict          # lsb, limits or spans
    log_bayes: float     # a continuous simulator never repeats a value
    masked: np.ndarray   # (N,) samples that say nothing of the rest
    opaque: bool         # it hides what else there may be


COINCIDENCE = 23.0    # nats: what one repeated value in double precision is worth,
                      # about ln(1e10 distinguishable values in the noise)


COARSE = 0.1          # of the white noise: a finer lattice is how a file was printed
HIDDEN = 0.05         # of the samples: more clipped ones are not missing at random, as
                      # the filters assume; nor is rounding by more than the noise a
                      # white noise of its own (B. Widrow, I. Kollar, "Quantization
                      # Noise", 2008)


def lattice_and_noise(y):
    """`lattice` of a record, and the standard deviation of its noise without it."""
    seen, lsb = y[~np.isnan(y)], lattice(y)
    return lsb, np.sqrt(max(np.mean(np.diff(seen)**2) / 2.0 - lsb**2 / 12.0, 0.0))


def readings(scene):
    """Quantization, saturation and stuck samples of a record, as a tuple of Reading."""
    y, N, found = scene.y, len(scene.y), []
    seen = y[~np.isnan(y)]
    lsb, noise = lattice_and_noise(y)
    # saturation: the last value is met far more often than a tail allows
    clipped, limits = np.zeros(N, bool), []
    for sign in (-1.0, 1.0):
        end = sign * np.max(sign * seen)
        before = np.sum(np.abs(y - (end - sign * lsb)) < 0.5 * lsb)
        full = np.sum(y == end) >= 3 + 2.0 * before + 6.0 * np.sqrt(before)
        limits.append(float(end) if full else sign * np.inf)
        clipped |= (y == end) & full
    # stuck: a run of equal values longer than chance; its first is a reading
    same = np.append(False, np.diff(y) == 0.0) & ~clipped
    start = np.flatnonzero(same & ~np.append(False, same[:-1]))
    length = np.flatnonzero(same & ~np.append(same[1:], False)) + 1 - start
    enough = 2
    if lsb:    # a value in the middle of its cell stays there by chance
        tie = math.erf(lsb / max(2.0 * np.sqrt(2.0) * noise, 1e-9 * lsb))
        enough = (max(2.0, np.log(1e-4 / N) / np.log(tie)) if lsb < 2.0 * noise
                  else np.inf)
    spans = [(begin - 1, n + 1) for begin, n in zip(start, length) if n >= enough]
    stuck = np.zeros(N, bool)
    for begin, n in spans:
        stuck[begin + 1:begin + n] = True
    if clipped.any():
        found.append(Reading("saturation", dict(limits=limits),
                             COINCIDENCE * clipped.sum(), clipped,
                             bool(clipped.mean() > HIDDEN)))
    if spans:
        spans = [[float(begin * scene.dt), int(n)] for begin, n in spans]
        found.append(Reading("stuck", dict(spans=spans), COINCIDENCE * stuck.sum(),
                             stuck, False))
    if lsb > COARSE * noise:
        found.append(Reading("quantization", dict(lsb=lsb), COINCIDENCE * N,
                             np.zeros(N, bool), bool(lsb > noise)))
    return tuple(found)


def without_readings(y, found):
    """Records (R, N) with NaN where a reading says nothing more of the true value."""
    y = y.copy()
    for r in found:
        if r.effect == "saturation":
            y[(y <= r.value["limits"][0]) | (y >= r.value["limits"][1])] = np.nan
        elif r.effect == "stuck":
            y[:, r.masked] = np.nan
    return y


def with_quantization(h, lsb):
    """Hypothesis whose white noise includes that of rounding, lsb^2 / 12."""
    def model(dt, **values):
        filt = h.model(dt, **values)
        return filt._replace(Psi=np.sqrt(filt.Psi**2 + lsb**2 / 12.0))
    return h._replace(model=model)
