"""Where: statistics of a record, beside those of records of the fitted simulator.

A place is one of six ways to look: time, frequency, averaging time, lag, amplitude,
covariate. Each has statistics; the distance of a statistic is in standard deviations of
the simulated records, put through the same fit, and the p-value of a place is that of
its largest distance.
"""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.special import chdtr, chdtrc, log_ndtr, ndtr, ndtri, ndtri_exp
from scipy.stats import poisson

from sensorid import allan_variance, brief, free_columns
from sensorlab.gap.account import as_simulated, gaussian
from sensorlab.gap.catalogue import quantize
from sensorlab.gap.effects import BLOCK, Scene, Simulator, simulate_effects
from sensorlab.gap.filters import filtered, normal_score, predict
from sensorlab.gap.kernels import row_products
from sensorlab.gap.readings import COARSE, lattice_and_noise, without_readings
from sensorlab.gap.signatures import POSTERIOR_NODES

PLACES = "time", "frequency", "averaging_time", "lag", "amplitude", "covariate"
UNITS = dict(time="s", frequency="Hz", averaging_time="s", lag="s",
             amplitude="sigma", covariate="")
FAR_OUT = 40.0    # standard deviations: no normal score lies further out


# ---- normal scores

def _normal_tail(log_p):
    """Normal score of a small probability given by its logarithm."""
    return -ndtri_exp(np.minimum(log_p, -1e-12))


def _chi2_score(total, n):
    """Normal score of a chi2 of n degrees of freedom."""
    return normal_score(chdtr(n, total), chdtrc(n, total))


def _largest_score(log_tail, n):
    """Normal score of the largest of n, whose own tail probability is given."""
    none = n * np.log1p(-np.exp(np.minimum(log_tail, -1e-12)))
    return _normal_tail(np.where(log_tail < -20.0, log_tail + np.log(n),
                                 np.log(-np.expm1(none) + 1e-300)))


def _count_score(n, expected):
    """Normal score of a Poisson count, in the middle of its probability."""
    law = poisson(expected)
    return normal_score(0.5 * (law.cdf(n) + law.cdf(n - 1)),
                        0.5 * (law.sf(n) + law.sf(n - 1)))


# ---- statistics, a function for each place

class Statistics(NamedTuple):
    """S statistics of R records, and where each of them looks."""

    value: np.ndarray    # (R, S)
    place: tuple         # (S,) one of PLACES
    at: np.ndarray       # (S, 2) in the unit of the place
    column: tuple        # (S,) of a covariate, else ""
    least: np.ndarray    # (S,) standard deviation that each has at least

    __repr__ = brief


class _One(NamedTuple):
    """One statistic of R records."""

    low: float
    high: float
    value: np.ndarray    # (R,)
    column: str = ""
    least: float = 1e-3


class _Residuals(NamedTuple):
    """What the statistics are made of."""

    z: np.ndarray        # (R, N), 0 where missing
    seen: np.ndarray     # (R, N)
    count: np.ndarray    # (R,) samples seen, at least 1
    y: np.ndarray        # (R, N) the records themselves
    scene: Scene


def statistics(z, y, scene, white):
    """Statistics of residuals z (R, N), which are N(0, 1) and white if all is well.

    y (R, N) are the records themselves; white (S, N) whitened probes of unit norm.
    """
    seen = ~np.isnan(z)
    r = _Residuals(np.where(seen, z, 0.0), seen, np.maximum(seen.sum(1), 1), y, scene)
    held = [(place, _One(*ends, value, column)) for (place, ends, column, _), value in
            zip(probes(scene), row_products(white, r.z))]
    every = [*(("time", one) for one in _in_time(r)), *held,
             *(("frequency", one) for one in _in_frequency(r)),
             *(("averaging_time", one) for one in _in_averaging_time(r)),
             *(("lag", one) for one in _in_lag(r)),
             *(("amplitude", one) for one in _in_amplitude(r)),
             *(("covariate", one) for one in _in_covariates(r))]
    return Statistics(np.column_stack([one.value for _, one in every]),
                      tuple(place for place, _ in every),
                      np.array([[one.low, one.high] for _, one in every], float),
                      tuple(one.column for _, one in every),
                      np.array([one.least for _, one in every]))


POLYNOMIAL_DEGREE = 5      # in a column: thermal models are of the third
MAX_CROSSED_COLUMNS = 5    # whose products are looked at: of more there are too many
SHIFTS = 32                # of the level, at even times


def probes(scene):
    """(place, ends, column, (N,) array) that residuals are held against: shifts of the
    level, and functions of the covariates.
    """
    N = len(scene.y)
    result = [("time", (scene.time[i], scene.time[-1]), "",
               (np.arange(N) >= i).astype(float))
              for i in np.linspace(0, N, SHIFTS + 2).astype(int)[1:-1]]
    scaled = {name: 2.0 * (x - x.min()) / np.ptp(x) - 1.0
              for name, x in scene.columns.items() if np.ptp(x) > 0.0}
    curves = []
    for name, x in scaled.items():
        moved = np.append(0.0, np.diff(x))
        curves += [(name, f) for f in (
            *np.polynomial.legendre.legvander(x, POLYNOMIAL_DEGREE).T[1:], moved,
            np.sign(moved))]    # the sign: hysteresis
    if len(scaled) <= MAX_CROSSED_COLUMNS:    # one column may change what another does
        curves += [(name, x * z) for (name, x), (_, z) in itertools.combinations(
            (*scaled.items(), ("", scene.time / scene.time[-1] - 0.5)), 2)]
    for name, f in curves:
        if np.ptp(f) > 0.0:
            x = scene.columns[name]
            result.append(("covariate", (x.min(), x.max()), name, f - f.mean()))
    return result


def _in_time(r):
    """Mean, variance, largest line and spectrum by segment: what is stationary in the
    mean need not be at any one time.
    """
    time, N = r.scene.time, len(r.scene.y)
    for part in np.array_split(np.arange(N), int(np.clip(N // 64, 2, 16))):
        n = np.maximum(r.seen[:, part].sum(1), 1)
        ends = time[part[0]], time[part[-1]]
        yield _One(*ends, r.z[:, part].sum(1) / np.sqrt(n))
        yield _One(*ends, _chi2_score((r.z[:, part]**2).sum(1), n))
    for part in np.array_split(np.arange(N), int(np.clip(N // 256, 1, 12))):
        power = np.abs(np.fft.rfft(r.z[:, part]))**2 / np.maximum(
            r.seen[:, part].sum(1), 1)[:, None]
        ends = time[part[0]], time[part[-1]]
        yield _One(*ends, _largest_score(-power[:, 1:].max(1), len(power[0]) - 1))
        for band in np.array_split(power[:, 1:], 4, axis=1):
            yield _One(*ends, _chi2_score(2.0 * band.sum(1), 2 * band.shape[1]))


def _in_frequency(r):
    """Power, and the largest line, in bands of even width on a logarithmic axis."""
    power = np.abs(np.fft.rfft(r.z))**2 / r.count[:, None]
    frequency = np.fft.rfftfreq(len(r.scene.y), r.scene.dt)
    edges = np.unique(np.round(np.geomspace(1, len(frequency), 14)).astype(int))
    for low, high in itertools.pairwise(edges):
        band, n = power[:, low:high], high - low
        yield _One(frequency[low], frequency[high - 1],
                   _chi2_score(2.0 * band.sum(1), 2 * n))
        at = frequency[low + band.argmax(1)[0]]
        yield _One(at, at, _largest_score(-band.max(1), n))


def _in_averaging_time(r):
    """Allan deviations of the records by octave."""
    for octave in range(int(np.log2(max(len(r.scene.y) // 3, 1))) + 1):
        tau = 2**octave * r.scene.dt
        variance = allan_variance(r.y, r.scene.dt, 2**octave)
        yield _One(tau, tau, 0.5 * np.log(variance + 1e-300))


def _in_lag(r):
    """Correlations of the residuals and of their size."""
    size = np.abs(r.z) - np.sqrt(2.0 / np.pi)
    size = np.where(r.seen, np.minimum(size, 5.0), 0.0)
    for k in (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64):
        if k < len(r.scene.y) // 4:
            for x in (r.z, size):
                yield _One(k * r.scene.dt, k * r.scene.dt, np.einsum(
                    "ri, ri -> r", x[:, k:], x[:, :-k]) / np.sqrt(r.count))


def _in_amplitude(r):
    """The law of the residuals: classes, smooth departures, tails; repeated values."""
    R, count, classes = len(r.z), r.count, 12
    u = ndtr(r.z)
    at = np.minimum((classes * u).astype(int), classes - 1)
    inside = np.bincount((at + classes * np.arange(R)[:, None])[r.seen],
                         minlength=classes * R).reshape(R, classes)
    edges = np.clip(ndtri(np.linspace(0, 1, classes + 1)), -FAR_OUT, FAR_OUT)
    for low, high, number in zip(edges[:-1], edges[1:], inside.T):
        yield _One(low, high, number / np.sqrt(count / classes))
    # smooth departures from the predicted law (Neyman): the mean of cos(k pi u)
    last = np.where(r.seen, 1.0, 0.0)
    one = np.where(r.seen, np.cos(np.pi * u), 0.0)
    twice, this = 2.0 * one, one
    for _ in range(8):
        yield _One(-FAR_OUT, FAR_OUT, this.sum(1) / np.sqrt(0.5 * count))
        last, this = this, twice * this - last
    for low, high in ((-FAR_OUT, -3.0), (3.0, FAR_OUT), (-FAR_OUT, -4.0),
                      (4.0, FAR_OUT)):
        inside = ((r.z >= low) & (r.z < high)).sum(1)
        expected = count * ndtr(-min(abs(low), abs(high)))
        # most counts are 0: their own spread would make a single one stand out
        yield _One(low, high, _count_score(inside, expected), least=1.0)
    largest = np.abs(r.z).max(1)
    yield _One(largest[0], FAR_OUT,
               _largest_score(np.log(2.0) + log_ndtr(-largest), count))
    yield _One(-FAR_OUT, FAR_OUT, (np.clip(r.z, -5, 5)**3).sum(1) / np.sqrt(count))
    yield _One(-FAR_OUT, FAR_OUT, np.abs(r.z).sum(1) / np.sqrt(count))
    yield _One(0.0, 0.0, (np.diff(r.y) == 0.0).sum(1).astype(float), least=1.0)


def _in_covariates(r):
    """Does the size of the residuals go with a column?"""
    spread = np.where(r.seen, r.z**2 - 1.0, 0.0).clip(-1.0, 25.0)
    for name, x in r.scene.columns.items():
        if np.std(x) > 0.0:
            for f in (x, np.abs(x - x.mean())):
                f = (f - f.mean()) / (f.std() + 1e-300)
                yield _One(x.min(), x.max(), row_products(spread, f[None])[:, 0]
                           / np.sqrt(r.count), name)


# ---- the distance from the simulator

class Gap(NamedTuple):
    """Distance of a record from the records of a fitted simulator."""

    statistics: Statistics    # of the record
    distance: np.ndarray      # (S,) in standard deviations
    null: np.ndarray          # (B, S) the same of the simulated records
    p_place: dict             # place -> p-value
    p_value: float            # of the whole
    theta: np.ndarray         # parameters at which they were simulated
    z: np.ndarray             # (N,) normal scores of the record
    log_score: np.ndarray     # (N,) ln of its one-step-ahead densities

    __repr__ = brief

    def rms(self, where=slice(None)):
        """Root mean square of some distances; about 1 where nothing is missing."""
        return float(np.sqrt(np.mean(self.distance[where]**2)))


TRIALS = 199           # simulated records behind every p-value; half of them for a
LONG_RECORD = 20000    # record of more samples than this


class _Setting(NamedTuple):
    """What a record and simulated ones have in common on their way to statistics."""

    scene: Scene
    acc: object         # Account
    first: int          # sample from which on they are compared
    own: np.ndarray     # (1, N) the record less what readings hide
    fitted: Scene       # what the fit saw
    late: Scene         # what is compared
    printed: float      # spacing of the digits of the record, too fine for an effect

    def drawn(self, simulator, trials, seed, number=0):
        """Records (trials, N) as they are read, and less what says nothing."""
        read = simulate_effects(simulator, self.scene, trials, seed, number).error
        if self.printed:
            quantize(self.scene, read, self.printed)
        return read, without_readings(read, self.acc.readings)

    def simulator(self, *thetas):
        """The account's simulator at each theta, all equally probable."""
        parts = [as_simulated(self.acc, self.fitted, theta) for theta in thetas]
        return Simulator(tuple(p.hypotheses[0] for p in parts),
                         tuple(p.effects[0] for p in parts))


def distance(scene, acc, trials=None, seed=0, first=0):
    """`Gap` of a record to the simulator of an account, put through the same fit.

    The record and `trials` simulated ones are filtered at the posterior mean. Refitting
    each would change a statistic by its regression on the score, the derivative of the
    log-likelihood to the parameters; that is taken away instead, for all alike.

    With `first`, of the samples from that one on, which had no part in the fit: nothing
    is taken away, but the simulated records have parameters drawn from the posterior.
    """
    trials = trials or (TRIALS if len(scene.y) <= LONG_RECORD else TRIALS // 2)
    setting = _setting(scene, acc, first)
    fit = _Refit(setting, [] if first else free_columns(acc.member.parameters))
    truth = fit.truth(seed)
    simulator = setting.simulator(
        *(acc.sample.nodes(POSTERIOR_NODES) if first else [truth]))
    white = _whitened_probes(acc, scene, setting.own[0], setting.late)

    def compared(read, masked):
        """Predictions, statistics and gains of records."""
        part = predict(acc.member, scene, acc.signatures, acc.theta[None], masked)
        return part, statistics(part.z[:, 0, first:], read[:, first:], setting.late,
                                white), fit.gains(masked, part.log_likelihood)
    real, stats, gain = compared(scene.y[None], setting.own)
    T, s = [stats.value], [gain]
    block = int(np.clip(BLOCK // len(scene.y), 1, trials))
    for number in range(0, trials, block):
        _, part, gain = compared(*setting.drawn(
            simulator, min(block, trials - number), seed, number))
        T.append(part.value)
        s.append(gain)
    T, s = np.vstack(T), np.vstack(s)
    usable = np.isfinite(T).all(0)    # no two clusters may be without a gap
    T = _refitted(np.where(usable, T, 0.0), s)
    sd = np.maximum(T[1:].std(0, ddof=1), stats.least + 1e-9 * np.abs(T[0]))
    d = np.clip((T - T[1:].mean(0)) / sd, -1e3, 1e3)
    places = np.array(stats.place)
    p_place = {place: _tail(np.abs(d[:, own]).max(1)) for place in PLACES
               for own in [(places == place) & usable] if own.any()}
    p_value = -np.expm1(len(p_place) * np.log1p(-min(p_place.values())))
    return Gap(stats._replace(value=T[0]), d[0], d[1:], p_place,
               float(max(p_value, 1e-15)), truth, real.z[0, 0], real.log_score[0, 0])


def _setting(scene, acc, first):
    own = without_readings(scene.y[None], acc.readings)
    fitted, late = scene._replace(y=own[0]), scene
    if first:
        fitted = scene._replace(y=np.where(np.arange(len(scene.y)) < first, own[0],
                                           np.nan))
        late = Scene(scene.y[first:], scene.dt,
                     {name: x[first:] for name, x in scene.columns.items()})
    lsb, noise = lattice_and_noise(scene.y)
    return _Setting(scene, acc, first, own, fitted, late,
                    lsb if lsb <= COARSE * noise else 0.0)


class _Refit(NamedTuple):
    """The fit of an account, for records like that of its scene."""

    setting: _Setting
    free: list    # columns of the parameters that are fitted

    @property
    def step(self):
        """Half a posterior standard deviation (p,), to the side within the prior."""
        acc = self.setting.acc
        step = 0.5 * acc.sample.sd(acc.theta)
        high = [p.high for p in acc.member.parameters]
        return np.where(acc.theta + step < high, step, -step)

    def gains(self, masked, middle=None):
        """Gain (R, d) of a step in every parameter; `middle` (R, 1) is the
        log-likelihood at the posterior mean.
        """
        if not self.free:
            return np.zeros((len(masked), 0))
        acc, scene = self.setting.acc, self.setting.scene
        nodes = acc.theta + np.diag(self.step)[self.free]
        if middle is None:
            nodes = np.vstack([nodes, acc.theta])
        ll = filtered(acc.member, scene, acc.signatures, nodes, masked, 0)[0]
        return ll[:, :-1] - ll[:, -1:] if middle is None else ll - middle

    def truth(self, seed):
        """Parameters (p,) whose records give this fit.

        The fit ignores what rounding and clipping do beyond a further white noise, and
        the history of a level: indirect inference (C. Gourieroux, A. Monfort,
        E. Renault, J. Appl. Econometrics 8, 1993). What the record does not tell, the
        prior keeps in place.
        """
        acc, free = self.setting.acc, self.free
        truth = acc.theta.copy()
        level = acc.member.jumps(acc.theta[None]).half[0] > 0.0
        if not free or not (acc.readings or level):
            return truth
        step, sample = self.step[free], acc.sample
        cov = np.atleast_2d(np.cov((sample.theta[:, free] / step).T, ddof=0,
                                   aweights=sample.weight))
        for _ in range(4):    # with the same noises, or it would walk about
            _, masked = self.setting.drawn(self.setting.simulator(truth), 48,
                                           seed + 100)
            s = self.gains(np.vstack([self.setting.own, masked]))
            s[1:] = _without_tails(s[1:])
            told = np.cov(s[1:].T).reshape(len(free), -1)
            away = (truth - acc.theta)[free] / step
            move = cov @ (s[0] - s[1:].mean(0) + told @ away) - away
            length = np.sqrt(move @ np.linalg.pinv(cov) @ move)    # in deviations
            truth[free] = np.maximum(truth[free] + move * step / max(length, 1.0),
                                     0.5 * truth[free])
        return truth


def _without_tails(s):
    """Gains (B, d) with what lies far out put at three standard deviations: where a
    filter takes one level for the other, one record would outweigh all others.
    """
    middle = np.median(s, 0)
    sd = 1.4826 * np.median(np.abs(s - middle), 0)
    return np.clip(s, middle - 3.0 * sd, middle + 3.0 * sd)


def _refitted(T, s):
    """Statistics (1 + B, S), the record's first, less their regression on the gains
    s (1 + B, d) over the simulated records.
    """
    if not s.shape[1]:
        return T
    s = s - s[1:].mean(0)
    # singular gains are left out
    inverse = np.linalg.pinv(np.cov(s[1:].T).reshape(s.shape[1], -1), rcond=1e-6)
    s[0] *= min(1.0, 3.0 / np.sqrt(max(s[0] @ inverse @ s[0], 1e-300)))
    slope = inverse @ (s[1:].T @ (T[1:] - T[1:].mean(0))) / (len(T) - 2)
    return T - s @ slope


def _whitened_probes(acc, scene, y, late):
    """`probes` of the end of a scene through the filter of an account without its
    jumps, of unit norm.

    The normal scores of a column far smaller than the noise are its innovations.
    """
    _, hypotheses = gaussian(scene._replace(y=y), acc)
    h = hypotheses[acc.best]
    theta = acc.member.matching(h, acc.theta)[None]
    probe = np.array([p[3] for p in probes(late)])
    probe *= 1e-3 * scene.white / np.abs(probe).max(1)[:, None]
    first = len(y) - len(late.y)
    probe = np.where(np.isnan(y), np.nan, np.pad(probe, ((0, 0), (first, 0))))
    white = predict(h, scene, acc.signatures, theta, probe).z[:, 0, first:]
    white = np.where(np.isnan(white), 0.0, white)
    return white / (np.sqrt((white**2).sum(1))[:, None] + 1e-300)


def _tail(largest):
    """p-value of the first of several maxima among the others: Gumbel's law."""
    null = largest[1:]
    scale = np.std(null, ddof=1) * np.sqrt(6.0) / np.pi
    e = (largest[0] - np.mean(null)) / scale + np.euler_gamma
    return float(max(-np.expm1(-np.exp(-e)), 1e-15))
