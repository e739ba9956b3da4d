"""What pictures of a diagnosis show: curves and points, without a picture."""

from typing import NamedTuple

import numpy as np
from scipy.fft import next_fast_len
from scipy.signal import lfilter
from scipy.special import ndtr

from sensorid import allan_deviation, allan_variance, brief
from sensorlab.gap.backward import solve
from sensorlab.gap.closure import threshold
from sensorlab.gap.draws import simulate_effects
from sensorlab.gap.effects import BLOCK, LONG_RECORD, signature_of
from sensorlab.gap.filters import predict
from sensorlab.gap.implied import as_simulated, in_place
from sensorlab.gap.parts import processes
from sensorlab.gap.readings import as_read
from sensorlab.gap.standins import (
    LEVEL_AS_NOISE, STEPS_AS_WALK, gaussian, stand_in)
from sensorlab.gap.words import outstanding


class View(NamedTuple):
    """All that is shown of a diagnosis."""

    through: object       # Through: what was found, as the record shows it; or None
    odd: np.ndarray       # (N,) samples that are outliers, more likely than not
    allan: object         # Banded
    spectrum: object      # Banded
    added: tuple          # of Added, one for every signature that was found
    places: tuple         # of Place, largest first
    residuals: tuple      # of Residuals: before, and after if anything was found

    __repr__ = brief


class Through(NamedTuple):
    """The sum of effects, as a record shows them."""

    names: tuple
    y: np.ndarray    # (N,) u


class Banded(NamedTuple):
    """A curve of the record, and where 90 % of those of simulated records lie."""

    x: np.ndarray         # (K,)
    record: np.ndarray    # (K,)
    before: np.ndarray    # (2, K)
    after: object         # (2, K), or None where nothing was found


class Added(NamedTuple):
    """What a signature should add to the whitened record, and what the record shows;
    both less what all else explains, in standard deviations of a sample.
    """

    name: str
    expected: np.ndarray    # (N,) for the size that was found: the slope is 1
    seen: np.ndarray        # (N,)
    means: np.ndarray       # (3, BINS) of expected and seen, standard error of the
                            # latter, over parts that tell as much each
    slope: float            # least squares, in sizes found
    sd: float


class Place(NamedTuple):
    """The largest distance of one place, before and after, and what a record without a
    gap exceeds in one of twenty.
    """

    name: str
    before: float
    after: float
    limit: float


class Residuals(NamedTuple):
    """Residuals against the coordinate of the place where they stand out most."""

    place: str
    column: str
    x: np.ndarray
    value: np.ndarray


def view(d):
    """The `View` of a diagnosis."""
    allan, spectrum = _bands(d)
    return View(_through(d), _odd(d), allan, spectrum, _added(d), _places(d),
                _residuals(d))


# ---- the record, and what was found in it

SLOW = 10.0    # samples of correlation from which on a process is seen in a record


def _through(d):
    """`Through` of the signatures and of the expectation of the slow processes that
    were found; None where neither was.
    """
    (effects,) = as_simulated(d.final, d.scene, d.after.theta).effects
    parts = [(one.name, _of_size(d.scene, one)) for one in effects
             if one.effect.columns]
    if len(d.final.member.effects) > len(d.base.member.effects):
        parts += _slow_processes(d)
    if not parts:
        return None
    names, drawn = zip(*parts)
    return Through(tuple(dict.fromkeys(names)), sum(drawn))


def _of_size(scene, one):
    """What an effect with columns adds (N,) at the numbers that it has."""
    return signature_of(scene, one, {symbol: p.low for symbol, p in one.values.items()})


def _slow_processes(d):
    """Names and expectations (N,) of the slow processes that effects added."""
    masked, hypotheses = gaussian(as_read(d.scene, d.final.readings), d.final)
    h = hypotheses[d.final.best]
    theta = d.final.member.matching(h, d.after.theta)[None]
    w = solve(h, masked, d.final.signatures, theta).residual[0]
    # what a reading adds is not slow, and last
    slow = h._replace(effects=tuple(one for one in h.effects if not one.effect.reading))
    h, theta = slow, h.matching(slow, theta[0])[None]
    first = sum(not (one.effect.jumps or one.effect.reading)
                for one in d.base.member.effects)
    a, q, p0 = (part[0] for part in processes(h, masked, theta)[:3])
    ends, in_turn = [], h.in_turn    # numbers of the processes with ever more effects
    for count in range(len(in_turn) + 1):
        less = h._replace(effects=tuple(in_turn[:count]))
        ends.append(processes(less, masked, h.matching(less, theta[0])[None]).a.shape[1]
                    )
    added = [one.key for one in h.effects[first:]]
    return [(_own_name(one), _times_covariance(w, a[k], q[k], p0[k]))
            for one, low, high in zip(in_turn, ends[:-1], ends[1:])
            for k in range(low, high) if one.key in added
            and a[k].real > np.exp(-1.0 / SLOW)]


def _own_name(one):
    """Name of an effect; that of a level is lost where it counts as noise."""
    return {LEVEL_AS_NOISE.name: "random_telegraph", STEPS_AS_WALK.name: "random_steps"
            }.get(one.name, one.name)


def _times_covariance(w, a, q, p0):
    """C w of a process x_i = a x_(i-1) + N(0, q), x_0 of variance p0: C = L D L'; of a
    complex one what is real, as its conjugate adds the rest.
    """
    back = lfilter([1.0], [1.0, -a], w[::-1])[::-1] * q
    back[0] *= (a * a * p0 + q) / q if q else 0.0
    return lfilter([1.0], [1.0, -a], back).real


def _odd(d):
    """(N,) which samples are outliers, more likely than not."""
    if not d.final.member.has_jumps:
        return np.zeros(len(d.scene.y), bool)
    seen = as_read(d.scene, d.final.readings)
    return predict(d.final.member, seen, d.final.signatures, d.after.theta[None]
                   ).odd[0, 0] > 0.5


def envelope(x, y, points):
    """(x, y) of a long curve with few points: the least and the largest of each part.
    """
    if len(y) <= 2 * points:
        return x, y
    step = -(-len(y) // points)
    whole = len(y) // step * step
    parts = np.where(np.isnan(y[:whole]), np.inf, y[:whole]).reshape(-1, step)
    low = parts.min(1)
    high = -np.where(np.isnan(y[:whole]), np.inf, -y[:whole]).reshape(-1, step).min(1)
    both = np.column_stack([low, high])
    both[~np.isfinite(both)] = np.nan
    return np.repeat(x[:whole:step], 2), both.ravel()


def block_means(x, y, step):
    """Means of x and y over blocks of so many samples; NaN where none is seen."""
    x, y = (part[:len(part) // step * step].reshape(-1, step) for part in (x, y))
    seen = (~np.isnan(y)).sum(1)
    return x.mean(1), np.where(seen > 0, np.nansum(y, 1) / np.maximum(seen, 1), np.nan)


# ---- Allan deviation and spectrum, with the simulators' bands

RECORDS = 60          # simulated records behind a band
FEWEST = 20           # of a long record
BANDS = 80            # parts of the frequency axis, at even ratios
INSIDE = 0.05, 0.95   # of the simulated records are below an end of a band


def _bands(d):
    """`Banded` of Allan deviation, and of the root of the spectrum."""
    scene = d.scene
    tau, adev = allan_deviation(scene.y, scene.dt)
    m = np.round(tau / scene.dt).astype(int)
    frequency, density = noise_density(scene.y[None], scene.dt)
    accounts = [(d.base, d.before)] + [(d.final, d.after)] * bool(d.found)
    bands = [_simulated(scene, in_place(as_simulated(acc, scene, gap.theta), acc,
                                        scene), m) for acc, gap in accounts]
    bands += [(None, None)] * (2 - len(bands))
    return tuple(Banded(x, own, *before_and_after) for x, own, before_and_after in zip(
        (tau, frequency), (adev, density[0]), zip(*bands)))


def _simulated(scene, simulator, m):
    """Ends of the bands (2, K) of Allan deviation and spectrum of a simulator."""
    count = RECORDS if len(scene.y) <= LONG_RECORD else FEWEST
    block = int(np.clip(BLOCK // len(scene.y), 1, count))
    adev, density = [], []
    for first in range(0, count, block):
        drawn = simulate_effects(simulator, scene, min(block, count - first), 1, first
                                 ).error
        adev.append(np.sqrt(allan_variance(drawn, scene.dt, m)))
        density.append(noise_density(drawn, scene.dt)[1])
    return [np.nanquantile(np.vstack(part), INSIDE, axis=0) for part in (adev, density)]


def noise_density(y, dt):
    """Frequencies (K,), Hz, and one-sided noise densities (R, K), u / sqrt(Hz), of
    records (R, N); means over bands of even ratio, a missing sample adds nothing.

    Examples
    --------
    White noise of 1 u at 100 Hz has sqrt(2 / 100) u / sqrt(Hz):

    >>> y = np.random.default_rng(0).standard_normal((1, 10000))
    >>> frequency, density = noise_density(y, 0.01)
    >>> round(float(density[0, -20:].mean()), 2)
    0.14
    """
    N = y.shape[1]
    window = np.hanning(N)
    weight = np.where(np.isnan(y), 0.0, window)
    part = weight * np.nan_to_num(y - np.nanmean(y, axis=1, keepdims=True))
    n = next_fast_len(N, real=True)
    power = 2.0 * dt * np.abs(np.fft.rfft(part, n))**2 / (weight**2).sum(1)[:, None]
    frequency = np.fft.rfftfreq(n, dt)
    edges = np.unique(np.round(np.geomspace(1, len(frequency), BANDS + 1)).astype(int))
    count = np.diff(edges)
    return (np.add.reduceat(frequency, edges[:-1])[:len(count)] / count,
            np.sqrt(np.add.reduceat(power[:, :edges[-1]], edges[:-1], axis=1) / count))


# ---- added variables

BINS = 12    # parts of the samples that tell as much each of a size


def _added(d):
    """`Added` of every signature that was found, in the order found."""
    acc = d.final
    masked, hypotheses = stand_in(as_read(d.scene, acc.readings), acc)
    h = hypotheses[acc.best]
    theta = acc.member.matching(h, d.after.theta)[None]
    (effects,) = as_simulated(acc, d.scene, d.after.theta).effects
    drawn = [one for one in effects if one.effect.columns]
    result = []
    for number in range(len(d.base.signatures), len(acc.signatures)):
        one = drawn[number]
        shape = _of_size(d.scene, one)
        others = acc.signatures[:number] + acc.signatures[number + 1:]
        both = np.array([masked.y, np.where(np.isnan(masked.y), np.nan, shape)])
        seen, expected = predict(h, masked, others, theta, both).z[:, 0]
        result.append(_binned(one.name, expected, seen))
    return tuple(result)


def _binned(name, expected, seen):
    """`Added` from what is expected and seen of the samples."""
    there = ~np.isnan(seen)
    expected, seen = expected[there], seen[there]
    order = np.argsort(expected)
    told = np.cumsum(expected[order]**2)
    part = np.minimum((BINS * told / told[-1]).astype(int), BINS - 1)
    count = np.bincount(part, minlength=BINS)
    means = [np.bincount(part, x[order], minlength=BINS) / np.maximum(count, 1)
             for x in (expected, seen)]
    full = count > 0
    return Added(name, expected, seen,
                 np.array([*means, 1.0 / np.sqrt(np.maximum(count, 1))])[:, full],
                 float(expected @ seen / told[-1]), float(told[-1]**-0.5))


# ---- where it stands out

def _places(d):
    """`Place` of all that there are."""
    limit, s = float(threshold(d.before)), d.before.statistics
    places = np.array(s.place)
    return tuple(Place(s.place[i], abs(float(d.before.distance[i])), float(
        np.abs(d.after.distance[places == s.place[i]]).max()), limit)
        for i in outstanding(d.before))


SHOWN_BY = dict(    # what shows an effect best
    outliers="amplitude", noise_step="time", noise_ramp="time")


def _residuals(d):
    """`Residuals` before, and after if anything was found."""
    i = outstanding(d.before)[0]
    place, column = d.before.statistics.place[i], d.before.statistics.column[i]
    place = next((SHOWN_BY[one.name] for one in d.found if one.name in SHOWN_BY), place)
    scores = [d.before.z] + [d.after.z] * bool(d.found)
    return tuple(Residuals(place, column, *_residual_curve(z, d.scene, place, column))
                 for z in scores)


SEGMENTS = 32    # of time or of a column


def _residual_curve(z, scene, place, column):
    """Coordinates of a place, and what residuals z are there."""
    seen = ~np.isnan(z)
    z0 = np.where(seen, z, 0.0)
    if place in ("frequency", "averaging_time"):
        frequency, density = noise_density(z[None], scene.dt)
        return frequency, density[0]**2 / (2.0 * scene.dt)
    if place == "lag":
        lags = np.arange(1, min(40, len(z) // 4))
        return lags * scene.dt, np.array([np.mean(z0[k:] * z0[:-k]) for k in lags])
    if place == "amplitude":
        edges = np.linspace(-6.0, 6.0, 25)
        count = np.histogram(z0[seen].clip(-5.99, 5.99), edges)[0]
        expected = np.diff(ndtr(edges)) * seen.sum()
        return 0.5 * (edges[1:] + edges[:-1]), (count + 0.5) / (expected + 0.5)
    x = scene.columns[column] if place == "covariate" else scene.time
    parts = [part for part in np.array_split(np.argsort(x, kind="stable"), SEGMENTS)
             if seen[part].any()]
    at = np.array([x[part].mean() for part in parts])
    count = np.array([seen[part].sum() for part in parts])
    if place == "time":
        return at, np.sqrt([(z0[part]**2).sum() for part in parts] / count)
    return at, np.array([z0[part].sum() for part in parts]) / np.sqrt(count)
