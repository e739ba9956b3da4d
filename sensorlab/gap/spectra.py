"""The spectrum of residuals: what another member would gain by Whittle's likelihood.

It tells whether a process is worth a filter, where the frequency of a band is to be
drawn, which is known to a thousandth of its prior or better, and where about the
posterior of a member is, so that few nodes of the filter are needed to know it.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.fft import prev_fast_len
from scipy.special import logsumexp, ndtr, ndtri
from scipy.stats.qmc import LatinHypercube

from sensorid import at_quantiles, brief, free_columns, mesh, middles
from sensorlab.gap.evidence import MAX_CLIMB, or_nothing
from sensorlab.gap.filters import predict
from sensorlab.gap.kernels.arithmetic import spectrum
from sensorlab.gap.kernels.lanes import KERNEL, in_threads
from sensorlab.gap.parts import leaked, processes
from sensorlab.gap.processes import MIN_TURN


class Sought(NamedTuple):
    """A uniform prior that is drawn where a law of even parts of its range has mass."""

    symbol: str
    low: float
    high: float
    mass: np.ndarray    # (B,) of the parts

    free, log = True, False
    __repr__ = brief

    def quantile(self, u):
        """Value below which the law, not the prior, has the probability u, 0..1."""
        below = np.append(0.0, np.cumsum(self.mass))
        return np.interp(u, below / below[-1], np.linspace(
            self.low, self.high, len(below)))

    def log_ratio(self, value):
        """ln of the prior over the law at a value."""
        part = (value - self.low) / (self.high - self.low) * len(self.mass)
        part = np.clip(part.astype(int), 0, len(self.mass) - 1)
        return -np.log(self.mass[part] * len(self.mass) / self.mass.sum())

    @property
    def mean(self):
        """Of the prior."""
        return 0.5 * (self.low + self.high)

    @property
    def sd(self):
        """Of the prior."""
        return (self.high - self.low) / np.sqrt(12.0)


class Spectrum(NamedTuple):
    """Residuals of a member, and the member itself, by frequency."""

    frequency: np.ndarray    # (F,) Hz
    power: np.ndarray        # (F,) of the normal scores; of the member, its mean is 1
    density: np.ndarray      # (F,) of the member: that of white noise is its variance
    count: np.ndarray        # (F,) frequencies that each stands for

    __repr__ = brief


def residual_spectrum(h, scene, signatures, theta):
    """`Spectrum` of a member at theta (p,)."""
    z = predict(h, scene, signatures, theta[None], whole=False).z[0, 0]
    z = z[:prev_fast_len(len(z))]
    inside = slice(1, (len(z) + 1) // 2)    # both ends have one degree of freedom only
    frequency = np.fft.rfftfreq(len(z), scene.dt)[inside]
    power = np.abs(np.fft.rfft(np.nan_to_num(z))[inside])**2 / np.sum(~np.isnan(z))
    return Spectrum(frequency, power, _densities(h, scene, theta[None], frequency)[0],
                    np.ones(len(power)))


def _densities(h, scene, theta, frequency):
    """Spectra (M, F) of a member at theta (M, p), as a record of the scene shows them.
    """
    own, angle = processes(h, scene, theta), 2.0 * np.pi * frequency * scene.dt
    turn, density = 2.0 - 2.0 * np.cos(angle), own.r + leaked(
        own, len(scene.y), np.exp(-1j * angle))
    for a, q in zip(own.a.T[..., None], own.q.T[..., None]):
        density += (q / ((1.0 - a)**2 + a * turn)).real
    return np.abs(density)    # where they cancel, what is left is rounding


def promise(richer, scene, seen, theta):
    """A member with a further process, its last effect, and Whittle's ln B of that
    process; the frequency of a band is `Sought`. The rest of the member stays at
    theta (p,), where the record has the spectrum `seen` without it, but for its scale.
    """
    seen = seen._replace(power=seen.power / seen.power.mean())
    if richer.effects[-1].effect.search == "band":
        return _with_law(richer, scene, seen)
    return richer, _log_bayes(richer, scene, _binned(seen), theta)


BINS = 256     # of frequency, in which the spectrum of a process is smooth
NODES = 24     # of the only parameter of a process
NODES_OF_TWO = 9    # of each of two


def _binned(seen, bands=()):
    """The spectrum by bins of even width on a logarithmic axis, and about frequencies
    of bands by bins that are finer the nearer they are.
    """
    last, step = len(seen.power) + 1, seen.frequency[0]
    away = np.geomspace(1, last, BINS // 2)
    ends = np.concatenate([np.geomspace(1, last, BINS + 1), *(
        f / step + sign * away for f in bands for sign in (-1.0, 1.0))])
    ends = np.unique(np.clip(ends, 1, last).astype(int)) - 1
    count = np.diff(ends)
    return Spectrum(*(np.add.reduceat(part, ends[:-1]) / count for part in seen[:3]),
                    count)


def _log_bayes(richer, scene, seen, theta):
    own = tuple(richer.effects[-1].values.values())
    each = NODES if len(own) == 1 else NODES_OF_TWO
    grid = mesh(*len(own) * [middles(each)])
    nodes = np.hstack([np.tile(theta, (len(grid), 1)), at_quantiles(own, grid)])
    ratio = _densities(richer, scene, nodes, seen.frequency) / seen.density
    total = seen.count.sum()
    with np.errstate(invalid="ignore"):    # next to nothing may be less by rounding
        gain = or_nothing(-total * np.log((seen.power / ratio) @ seen.count / total) - (
            np.log(ratio) @ seen.count))
    # as for an account, no more than by Akaike's correction
    return min(logsumexp(gain) - np.log(len(gain)), gain.max() - len(own))


TAU_STEP, SIGMA_STEP = 2.5, 2.0    # ratio of one node of a band to the next
REACH = 12    # half widths of a band to either side of its middle that are looked at
FINE = 3      # middles tried in a half width
PARTS = 16    # of a half width, over which the spectrum is averaged
LEAST_LEFT = 1e-15    # of the power beside a band: less is lost in rounding


def _with_law(richer, scene, seen):
    """The member with the frequency of its band sought, and ln B of the band."""
    *others, band = richer.effects
    frequency, tau, sigma = band.values.values()
    total = np.full(len(seen.power), -np.inf)
    variance = _nodes(sigma, SIGMA_STEP)**2
    taus = _nodes(tau, TAU_STEP)
    for value in taus:
        gain = _band_gains(seen, scene.dt, value, variance)
        gain[2.0 * np.pi * seen.frequency * value < MIN_TURN] = 0.0
        total = np.logaddexp(total, gain - np.log(len(taus)))
    middle = frequency.low + (frequency.high - frequency.low) * middles(len(total))
    gain = np.interp(middle, seen.frequency, total)
    # wider than Whittle's posterior, which is not the true one
    law = [np.exp(power * gain - logsumexp(power * gain)) for power in (1.0, 0.5, 0.0)]
    sought = Sought(frequency.symbol, frequency.low, frequency.high, np.mean(law, 0))
    return richer._replace(effects=(*others, band._replace(values={
        **band.values, frequency.symbol: sought}))), logsumexp(gain) - np.log(len(gain))


def _nodes(p, step):
    """Values of a parameter at even quantiles, a ratio of about `step` apart."""
    count = int(np.ceil(np.log(p.high / p.low) / np.log(step))) if p.free else 1
    return p.quantile(middles(count))


def _band_gains(seen, dt, tau, variance):
    """ln of the mean Bayes factor (F,) over variances of bands of correlation time tau
    about every frequency.
    """
    a, step = np.exp(-dt / tau), seen.frequency[0]
    width = 1.0 / (2.0 * np.pi * tau * step)    # half of a band, in frequencies
    count = max(int(width / PARTS), 1)
    frequency, power, density = (_means(part, count) for part in seen[:3])
    F, width, step = len(power), width / count, step * count
    away = np.arange(min(int(REACH * width) + 2, F)) * step
    shape = 0.5 * (1.0 - a**2) / (1.0 + a**2 - 2.0 * a * np.cos(
        2.0 * np.pi * away * dt))
    tried = np.arange(0, F, max(int(width / FINE), 1))    # middles of bands
    gain = np.empty((len(tried), len(variance)))
    in_threads(_gain_bands, len(tried), power, density, count, shape, tried, variance,
               gain)
    return np.interp(seen.frequency, frequency[tried], logsumexp(
        gain, axis=1) - np.log(len(variance)))


def _means(values, count):
    """Means of so many neighbours each."""
    first = np.arange(0, len(values), count)
    return np.add.reduceat(values, first) / np.diff(np.append(first, len(values)))


@njit(**KERNEL)
def _gain_bands(first, last, power, density, count, shape, middles, variance, gain):
    """Whittle's gain (middles, variances) of bands of a shape (reach,), the scale of
    all else free; each part of the spectrum stands for `count` frequencies.
    """
    F, reach = len(power), len(shape) - 1
    lanes = -(-len(variance) // 8) * 8    # a multiple is vectorised as a whole
    less, log_ratio, product, added = (np.empty(lanes), np.empty(lanes),
                                       np.empty(lanes), np.zeros(lanes))
    for v in range(len(variance)):
        added[v] = variance[v]
    most = np.log10(1.0 + variance.max() * shape.max() / density.min())
    together = max(int(min(300.0 / most, 64.0)), 1)    # ratios of one logarithm
    for j in range(first, last):
        at = middles[j]
        for v in range(len(less)):
            less[v], log_ratio[v], product[v] = 0.0, 0.0, 1.0
        begin, end = max(at - reach, 0), min(at + reach + 1, F)
        turn = begin % together    # counted: a remainder takes as long as all else
        for k in range(begin, end):
            share = shape[abs(k - at)] / density[k]
            for v in range(len(less)):
                ratio = 1.0 + added[v] * share
                less[v] += power[k] * (1.0 - 1.0 / ratio)
                product[v] *= ratio
            if turn == 0:
                for v in range(len(less)):
                    log_ratio[v] += np.log(product[v])
                    product[v] = 1.0
            turn = turn + 1 if turn + 1 < together else 0
        for v in range(len(variance)):
            left = max(1.0 - less[v] / F, LEAST_LEFT)
            gain[j, v] = -count * (
                F * np.log(left) + log_ratio[v] + np.log(product[v]))


CANDIDATES = 512    # nodes of the new parameters of which the best are climbed from
CLIMBED = 3         # of these, if they are so far apart, in standard deviations: ...
APART = 1.0
SCATTERED = 8       # parameters, of which that many nodes may come near the best


def posterior_law(h, scene, signatures, other, theta, known):
    """Mean (d,) and covariance (d, d), in the coordinates of `integrate`, of about the
    posterior of a member, by Whittle's likelihood.

    Another member has its posterior about theta (p,): what it leaves of the record is
    white there, so that nothing leaks from one frequency to the next. `known` are these
    coordinates of parameters by key, from which the search starts; where something may
    stand for what is new, from anywhere, too.
    """
    keys = [h.keys[c] for c in free_columns(h.parameters)]
    new = [axis for axis, key in enumerate(keys) if key not in known]
    seen = _binned(residual_spectrum(other, scene, signatures, theta), [
        _middle(one.values["frequency"], known.get((one.key, "frequency")))
        for one in h.effects if one.effect.search == "band"])
    turn = 2.0 - 2.0 * np.cos(2.0 * np.pi * seen.frequency * scene.dt)

    def told(x):
        """Log posteriors (M,) at x (M, d), and ln of the spectra (M, F) there over that
        of the other member.
        """
        theta, gain = at_quantiles(h.parameters, ndtr(x)), np.empty(len(x))
        own, log_ratio = processes(h, scene, theta), np.empty((len(x), len(turn)))
        # what leaks matters where there is little: at half the sampling rate, if at all
        leak = np.maximum(leaked(own, len(scene.y), np.array([-1.0])), 0.0)
        _whittle(own.a, own.q, (own.r + leak)[:, 0], turn, *seen[1:], log_ratio, gain)
        for column, p in enumerate(h.parameters):
            if isinstance(p, Sought):
                gain += p.log_ratio(theta[:, column])
        return or_nothing(gain) - 0.5 * (x**2).sum(1), log_ratio

    def scattered(count, axes):
        return ndtri(LatinHypercube(len(axes), rng=0).random(count))
    start = np.array([[known.get(key, 0.0) for key in keys]])
    if new:
        near = np.repeat(start, min(NODES**len(new), CANDIDATES), axis=0)
        near[:, new] = scattered(len(near), new)
        starts = near[_high_and_apart(told(near)[0], near)]
        start, *_, height = _climbed(told, seen, starts, new)
        start = start[[height.argmax()]]
    if len(keys) <= SCATTERED and _is_of_white(h, other) and hardly_white(
            other, scene, theta, seen):
        anywhere = scattered(CANDIDATES, keys)
        start = np.vstack([start, anywhere[[told(anywhere)[0].argmax()]]])
    modes, covariances, height = _climbed(told, seen, start, range(len(keys)))
    return modes[height.argmax()], covariances[height.argmax()]


def _high_and_apart(height, x):
    """Numbers of the highest of some points x (M, d), apart from each other."""
    result, height = [], height.copy()
    for _ in range(CLIMBED):
        result.append(int(height.argmax()))
        height[((x - x[result[-1]])**2).sum(1) < APART**2] = -np.inf
    return result


SHIFT = 1e-3    # in standard deviations of a prior: ln of a spectrum is linear in it
DAMPED = np.append(0.0, np.geomspace(1.0, 1e6, 7))
SHORTER = 0.5**np.arange(1.0, 7.0)    # steps, where a spectrum is far from the record's
LAST = 0.1    # nats: a step that promises less, or gains less, is the last


def _climbed(told, seen, x, axes):
    """Modes (S, d) uphill from x (S, d) along some axes, covariances (S, m, m) of these
    axes in the normal laws there, and the heights (S,).

    Fisher's scoring: of spectra S the expected information is the sum of g g' over all
    frequencies, g the derivatives of ln S (P. Whittle, Ark. Mat. 2, 1953), and 1 from
    the prior N(0, I); each step is tried damped and shorter, all of them at once.
    """
    x, axes, left = x.copy(), list(axes), np.arange(len(x))
    covariance, height = np.empty((len(x), len(axes), len(axes))), np.empty(len(x))
    shifts = np.vstack([np.zeros(x.shape[1]), SHIFT * np.eye(x.shape[1])[axes]])

    def at_each(points):
        S, K, d = points.shape
        return (part.reshape(S, K, *part.shape[1:]) for part in told(
            points.reshape(S * K, d)))
    for _ in range(MAX_CLIMB):
        heights, log_ratio = at_each(x[left, None] + shifts)
        height[left] = heights[:, 0]
        with np.errstate(invalid="ignore", over="ignore"):
            g = _if_finite((log_ratio[:, 1:] - log_ratio[:, :1]) / SHIFT)
            excess = _if_finite(seen.power * np.exp(-log_ratio[:, 0]) - 1.0)
        slope = np.einsum("sif, sf -> si", g, seen.count * excess) - x[left][:, axes]
        width, turn = np.linalg.eigh(np.eye(len(axes)) + np.einsum(
            "sif, sjf -> sij", g, seen.count * g))
        covariance[left] = np.einsum("sik, sjk -> sij", turn / width[:, None], turn)
        push = np.einsum("sik, si -> sk", turn, slope)
        on = 0.5 * (push**2 / width).sum(1) >= LAST
        if not on.any():
            break
        left, width, turn, push = left[on], width[on], turn[on], push[on]
        damped = push[:, None] / (width[:, None] + DAMPED[:, None])
        moves = np.concatenate([damped, damped[:, :1] * SHORTER[:, None]], axis=1)
        tries = np.repeat(x[left, None], moves.shape[1], axis=1)
        tries[..., axes] += np.einsum("sik, smk -> smi", turn, moves)
        heights, _ = at_each(tries)
        up = heights.max(1) >= height[left] + LAST
        x[left[up]] = tries[up, heights[up].argmax(1)]
        left = left[up]
        if not up.any():
            break
    return x, covariance, height


def _if_finite(values):
    """Values, and 0 where they are none: where spectra cancel."""
    return np.where(np.isfinite(values), values, 0.0)


def _is_of_white(h, other):
    """Has a member something that is told by spectra of white noise, that another has
    not?
    """
    there = {one.key for one in other.effects}
    return any(one.effect.search == "spectrum" and one.key not in there
               for one in h.effects)


MOSTLY_WHITE = 0.5    # of the variance of an innovation


def hardly_white(h, scene, theta, seen):
    """Is little of what a member cannot predict white noise at theta (p,), where it has
    the spectrum `seen`? Then it stands for what passes a low-pass, say.
    """
    innovation = np.exp(np.average(np.log(seen.density), weights=seen.count))
    return processes(h, scene, theta[None]).r[0, 0] < MOSTLY_WHITE * innovation


def _middle(frequency, x):
    """Where a band is looked for, Hz: where it is known to be, or most probable."""
    if x is not None or not isinstance(frequency, Sought):
        return frequency.quantile(ndtr(x or 0.0))
    part = (frequency.mass.argmax() + 0.5) / len(frequency.mass)
    return frequency.low + part * (frequency.high - frequency.low)


@njit(**KERNEL)
def _whittle(a, q, r, turn, power, density, count, log_ratio, gain):
    """Whittle's likelihoods of nodes, for residuals of a member of this density, and ln
    of their spectra over that.
    """
    for m in range(len(a)):
        total = 0.0
        for k in range(len(turn)):
            ratio = (r[m] + spectrum(a[m], q[m], turn[k])) / density[k]
            log_ratio[m, k] = np.log(ratio)
            total -= count[k] * (power[k] / ratio + log_ratio[m, k])
        gain[m] = total
