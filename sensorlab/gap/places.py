"""Where: statistics of the record, beside those of records of the fitted simulator."""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.special import gammainc, log_ndtr, ndtr, ndtri, ndtri_exp

from sensorid import allan_variance, free_columns
from sensorlab.gap.effects import BLOCK, Scene, _quantize, simulate_effects
from sensorlab.gap.filters import _filtered, _products, predict
from sensorlab.gap.signatures import _resampled
from sensorlab.gap.account import _gaussian, as_simulated
from sensorlab.gap.readings import COARSE, lattice_and_noise, without_readings


class Statistics(NamedTuple):
    """S statistics of R records, and where each of them looks."""

    value: np.ndarray    # (R, S)
    place: tuple         # (S,) one of PLACES
    at: np.ndarray       # (S, 2) in the unit of the place
    column: tuple        # (S,) of a covariate, else ""
    least: np.ndarray    # (S,) standard deviation that each has at least


FAR = 40.0    # standard deviations: no normal score lies further out
PLACES = "time", "frequency", "averaging_time", "lag", "amplitude", "covariate"
UNITS = dict(time="s", frequency="Hz", averaging_time="s", lag="s",
             amplitude="sigma", covariate="")


def _normal_tail(log_p):
    """Normal score of a small probability given by its logarithm."""
    return -ndtri_exp(np.minimum(log_p, -1e-12))


def _chi2_score(total, n):
    """Normal score of a chi2 of n degrees of freedom (Wilson and Hilferty)."""
    return ((total / n)**(1 / 3) - 1.0 + 2.0 / (9.0 * n)) / np.sqrt(2.0 / (9.0 * n))


def _largest_score(log_tail, n):
    """Normal score of the largest of n, whose own tail probability is given."""
    none = n * np.log1p(-np.exp(np.minimum(log_tail, -1e-12)))
    return _normal_tail(np.where(log_tail < -20.0, log_tail + np.log(n),
                                 np.log(-np.expm1(none) + 1e-300)))


def _count_score(n, expected):
    """Normal score of a Poisson count, in the middle of its probability."""
    more, as_many = gammainc(n + 1.0, expected), gammainc(np.maximum(n, 0.5), expected)
    return -ndtri(np.maximum(0.5 * (more + np.where(n > 0, as_many, 1.0)), 1e-300))


SMOOTH = 5    # degree of the polynomials in a column: thermal models are of the third
FEW = 5       # columns at most whose products are looked at: of more there are too many


def probes(scene):
    """Columns (S, N) that residuals are held against: shifts, and the covariates."""
    N = len(scene.y)
    result = [("time", (scene.time[i], scene.time[-1]), "",
               (np.arange(N) >= i).astype(float))
              for i in np.linspace(0, N, 34).astype(int)[1:-1]]
    scaled = {name: 2.0 * (x - x.min()) / np.ptp(x) - 1.0
              for name, x in scene.columns.items() if np.ptp(x) > 0.0}
    curves = []
    for name, x in scaled.items():
        moved = np.append(0.0, np.diff(x))
        curves += [(name, f) for f in (*np.polynomial.legendre.legvander(
            x, SMOOTH).T[1:], moved, np.sign(moved))]    # the sign: hysteresis
    if len(scaled) <= FEW:    # what one column does may depend on another
        curves += [(name, x * z) for (name, x), (_, z) in itertools.combinations(
            (*scaled.items(), ("", scene.time / scene.time[-1] - 0.5)), 2)]
    for name, f in curves:
        if np.ptp(f) > 0.0:
            x = scene.columns[name]
            result.append(("covariate", (x.min(), x.max()), name, f - f.mean()))
    return result


def statistics(z, y, scene, white):
    """Statistics of residuals z (R, N), which are N(0, 1) and white if all is well.

    y (R, N) are the records themselves; white (S, N) whitened probes of unit norm.
    """
    R, N = z.shape
    value, where = [], []

    def put(place, low, high, column, statistic, least=1e-3):
        where.append((place, low, high, column, least))
        value.append(statistic)
    seen = ~np.isnan(z)
    z0 = np.where(seen, z, 0.0)
    count = np.maximum(seen.sum(1), 1)
    dt = scene.dt
    segments = int(np.clip(N // 64, 2, 16))
    for part in np.array_split(np.arange(N), segments):
        n = np.maximum(seen[:, part].sum(1), 1)
        ends = scene.time[part[0]], scene.time[part[-1]]
        put("time", *ends, "", z0[:, part].sum(1) / np.sqrt(n))
        put("time", *ends, "", _chi2_score((z0[:, part]**2).sum(1), n))
    listed = probes(scene)
    for (place, ends, column, _), statistic in zip(listed, _products(white, z0)):
        put(place, *ends, column, statistic)

    power = np.abs(np.fft.rfft(z0))**2 / count[:, None]
    frequency = np.fft.rfftfreq(N, dt)
    edges = np.unique(np.round(np.geomspace(1, len(frequency), 14)).astype(int))
    for low, high in zip(edges[:-1], edges[1:]):
        band = power[:, low:high]
        ends = frequency[low], frequency[high - 1]
        n = high - low
        put("frequency", *ends, "", _chi2_score(2.0 * band.sum(1), 2 * n))
        at = low + band.argmax(1)[0]
        put("frequency", frequency[at], frequency[at], "",
            _largest_score(-band.max(1), n))

    for part in np.array_split(np.arange(N), int(np.clip(N // 256, 1, 12))):
        # what is stationary in the mean need not be at any one time
        power = np.abs(np.fft.rfft(z0[:, part]))**2 / np.maximum(
            seen[:, part].sum(1), 1)[:, None]
        ends = scene.time[part[0]], scene.time[part[-1]]
        put("time", *ends, "", _largest_score(-power[:, 1:].max(1), len(power[0]) - 1))
        for band in np.array_split(power[:, 1:], 4, axis=1):
            put("time", *ends, "", _chi2_score(2.0 * band.sum(1), 2 * band.shape[1]))

    m = 2**np.arange(int(np.log2(max(N // 3, 1))) + 1)
    for k in m:
        put("averaging_time", k * dt, k * dt, "",
            0.5 * np.log(allan_variance(y, dt, k) + 1e-300))

    size = np.abs(z0) - np.sqrt(2.0 / np.pi)
    size = np.where(seen, np.minimum(size, 5.0), 0.0)
    for k in (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64):
        if k < N // 4:
            for x in (z0, size):
                put("lag", k * dt, k * dt, "", np.einsum(
                    "ri, ri -> r", x[:, k:], x[:, :-k]) / np.sqrt(count))

    u, classes = ndtr(z0), 12
    at = np.minimum((classes * u).astype(int), classes - 1)
    inside = np.bincount((at + classes * np.arange(R)[:, None])[seen],
                         minlength=classes * R).reshape(R, classes)
    edges = np.clip(ndtri(np.linspace(0, 1, classes + 1)), -FAR, FAR)
    for low, high, number in zip(edges[:-1], edges[1:], inside.T):
        put("amplitude", low, high, "", number / np.sqrt(count / classes))
    # smooth departures from the predicted law (Neyman): the mean of cos(k pi u)
    last, one = np.where(seen, 1.0, 0.0), np.where(seen, np.cos(np.pi * u), 0.0)
    twice, this = 2.0 * one, one
    for _ in range(8):
        put("amplitude", -FAR, FAR, "", this.sum(1) / np.sqrt(0.5 * count))
        last, this = this, twice * this - last
    for low, high in ((-FAR, -3.0), (3.0, FAR), (-FAR, -4.0), (4.0, FAR)):
        inside = ((z0 >= low) & (z0 < high)).sum(1)
        expected = count * ndtr(-min(abs(low), abs(high)))
        # most counts are 0: their own spread would make a single one stand out
        put("amplitude", low, high, "", _count_score(inside, expected), least=1.0)
    largest = np.abs(z0).max(1)
    put("amplitude", largest[0], FAR, "",
        _largest_score(np.log(2.0) + log_ndtr(-largest), count))
    put("amplitude", -FAR, FAR, "", (np.clip(z0, -5, 5)**3).sum(1) / np.sqrt(count))
    put("amplitude", -FAR, FAR, "", np.abs(z0).sum(1) / np.sqrt(count))
    put("amplitude", 0.0, 0.0, "", (np.diff(y) == 0.0).sum(1).astype(float), least=1.0)

    spread = np.where(seen, z0**2 - 1.0, 0.0).clip(-1.0, 25.0)
    for name, x in scene.columns.items():
        if np.std(x) > 0.0:
            for f in (x, np.abs(x - x.mean())):
                f = (f - f.mean()) / (f.std() + 1e-300)
                put("covariate", x.min(), x.max(), name,
                    _products(spread, f[None])[:, 0] / np.sqrt(count))
    return Statistics(np.column_stack(value), tuple(w[0] for w in where),
                      np.array([w[1:3] for w in where], float),
                      tuple(w[3] for w in where), np.array([w[4] for w in where]))


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

    def rms(self, where=slice(None)):
        """Root mean square of some distances; about 1 where nothing is missing."""
        return float(np.sqrt(np.mean(self.distance[where]**2)))


TRIALS = 199    # simulated records behind every p-value; half of them for a record
MANY = 20000    # of more samples than this


def distance(scene, acc, trials=None, seed=0, first=0):
    """`Gap` of a record to the simulator of an account, put through the same fit.

    The record and `trials` simulated ones are filtered at the posterior mean. Refitting
    each would change a statistic by its regression on the score, the derivative of the
    log-likelihood to the parameters; that is taken away instead, for all alike.

    With `first`, of the samples from that one on, which had no part in the fit: nothing
    is taken away, but the simulated records have parameters drawn from the posterior.
    """
    h, sample, theta = acc.hypotheses[acc.best], acc.samples[acc.best], acc.theta
    trials = trials or (TRIALS if len(scene.y) <= MANY else TRIALS // 2)
    free = [] if first else free_columns(h.parameters)
    symbols = [p.symbol for p in h.parameters]
    step = 0.5 * np.sqrt(sample.weight @ (sample.theta - theta)**2)
    step = np.where(theta + step < [p.high for p in h.parameters], step, -step)
    shifted = theta + np.diag(step)[free]
    own = without_readings(scene.y[None], acc.readings)
    fitted, late = scene._replace(y=own[0]), scene
    if first:
        fitted = scene._replace(y=np.append(own[0, :first], np.full(
            len(scene.y) - first, np.nan)))
        late = Scene(scene.y[first:], scene.dt,
                     {name: x[first:] for name, x in scene.columns.items()})
    lsb, noise = lattice_and_noise(scene.y)
    printed = lsb if lsb <= COARSE * noise else 0.0

    def simulator(*thetas):
        """Hypotheses with numbers for parameters, and the effects of each."""
        return tuple(zip(*(as_simulated(acc, fitted, one) for one in thetas)))

    def drawn(simulator, trials, seed, number=0):
        """Records of the simulator as they are read, and less what says nothing."""
        read = simulate_effects(*simulator, scene, trials, seed, number).error
        if printed:    # to so many digits, finer than would be an effect
            _quantize(scene, read, dict(lsb=printed))
        return read, without_readings(read, acc.readings)

    def predicted(masked):
        return predict(h, scene, acc.signatures, theta[None], masked)

    def scores(masked, middle=None):
        """Gains of a step in every parameter; `middle` is the filter at theta."""
        if not free:
            return np.zeros((len(masked), 0))
        nodes = shifted if middle else np.vstack([shifted, theta])
        ll = _filtered(h, scene, acc.signatures, nodes, masked, 0)[0]
        return ll - middle.log_likelihood if middle else ll[:, :-1] - ll[:, -1:]
    truth = theta.copy()
    if free and (acc.readings or "random_telegraph.size" in symbols):
        # the fit ignores what rounding and clipping do beyond a further white noise,
        # and a telegraph's history: simulate at the parameters whose records give this
        # fit (indirect inference; C. Gourieroux, A. Monfort, E. Renault, J. Appl.
        # Econometrics 8, 1993); what the record does not tell, the prior keeps in place
        cov = np.atleast_2d(np.cov((sample.theta[:, free] / step[free]).T, ddof=0,
                                   aweights=sample.weight))
        for attempt in range(4):
            masked = drawn(simulator(truth), 48, seed + 100 + attempt)[1]
            s = scores(np.vstack([own, masked]))
            told = np.cov(s[1:].T).reshape(len(free), -1)
            away = (truth - theta)[free] / step[free]
            move = cov @ (s[0] - s[1:].mean(0) + told @ away) - away
            length = np.sqrt(move @ np.linalg.pinv(cov) @ move)    # standard deviations
            truth[free] = np.maximum(
                truth[free] + move * step[free] / max(length, 1.0), 0.5 * truth[free])
    white = _whitened_probes(acc, scene, own[0], late)
    real = predicted(own)
    z = real.z[:, 0]
    stats = statistics(z[:, first:], late.y[None], late, white)
    T, s = [stats.value], [scores(own, real)]
    fixed = simulator(*(sample.theta[_resampled(sample.weight)] if first else [truth]))
    block = int(np.clip(BLOCK // len(scene.y), 1, trials))
    for number in range(0, trials, block):
        read, masked = drawn(fixed, min(block, trials - number), seed, number)
        part = predicted(masked)
        T.append(statistics(part.z[:, 0, first:], read[:, first:], late, white).value)
        s.append(scores(masked, part))
    T, s = np.vstack(T), np.vstack(s)
    usable = np.isfinite(T).all(0)    # no two clusters may be without a gap
    T = np.where(usable, T, 0.0)
    if free:
        s -= s[1:].mean(0)
        inverse = _inverse(s[1:])
        s[0] *= min(1.0, 3.0 / np.sqrt(max(s[0] @ inverse @ s[0], 1e-300)))
        T = T - s @ (inverse @ (s[1:].T @ (T[1:] - T[1:].mean(0))) / (trials - 1))
    sd = np.maximum(T[1:].std(0, ddof=1), stats.least + 1e-9 * np.abs(T[0]))
    d = (T - T[1:].mean(0)) / sd
    d = np.clip(d, -1e3, 1e3)
    places = np.array(stats.place)
    p_place = {place: _tail(np.abs(d[:, own]).max(1)) for place in PLACES
               for own in [(places == place) & usable] if own.any()}
    p_value = -np.expm1(len(p_place) * np.log1p(-min(p_place.values())))
    return Gap(stats._replace(value=T[0]), d[0], d[1:], p_place,
               float(max(p_value, 1e-15)), truth, z[0],
               real.log_score[0, 0])


def _inverse(scores):
    """Inverse covariance of scores (B, d); singular ones are left out."""
    return np.linalg.pinv(np.cov(scores.T).reshape(scores.shape[1], -1), rcond=1e-6)


def _whitened_probes(acc, scene, y, late):
    """`probes` of the end of a scene through the filter of an account without its
    jumps, of unit norm.

    The normal scores of a column far smaller than the noise are its innovations.
    """
    plain, hypotheses = _gaussian(scene._replace(y=y), acc)
    h = hypotheses[acc.best]
    values = dict(zip((p.symbol for p in acc.hypotheses[acc.best].parameters),
                      acc.theta))
    theta = np.array([[values[p.symbol] for p in h.parameters]])
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
