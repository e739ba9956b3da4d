"""The other algorithms that the criteria compare the filter bank with, and the bound
that none of them can beat.

An algorithm is a function of a record (N,), dt and a tuple of hypotheses. It gives
the number of the hypothesis that it chooses, and one array (p,) of estimates for each
hypothesis. All of them know the ranges of the prior.
"""

import functools
import itertools

import numpy as np
from numba import njit
from scipy.optimize import least_squares, minimize
from scipy.special import gammaincinv, ndtri

from sensorid import (
    JIT, Parameter, allan_deviation, at_quantiles, bank, check_seed, check_whole,
    filter_bank, free_columns, log_likelihood, markov, model_allan_variance, modes,
    random_walk, simulate, stops_at, white_noise)
from sensorlab.gap.kernels.arithmetic import spectrum


def allan_line(tau, adev, slope):
    """Value at 1 s of the line of a given slope through part of an Allan deviation.

    By IEEE Std 952 it is sqrt(3) Q for slope -1 (quantization), N for -1/2 (angle
    random walk) and K / sqrt(3) for +1/2 (rate random walk).
    """
    return float(np.exp(np.mean(np.log(adev) - slope * np.log(tau))))


def allan_slopes(y, dt, hypotheses):
    """Model and parameters from the slopes of the Allan deviation.

    IEEE Std 952, Annex C: white noise has slope -1/2 and is read there, a random walk
    +1/2; a Markov process has a top of 0.437 q sqrt(T) at 1.89 T. The end of the
    curve, its last factor of four in averaging time, chooses the model.
    """
    tau, adev = allan_deviation(y, dt)
    x, curve = np.log(tau), np.log(adev)
    slope = np.diff(curve) / np.diff(x)
    end = np.polyfit(x[-3:], curve[-3:], 1)[0]
    nominal = {white_noise: -0.5, markov: 0.0, random_walk: 0.5}
    if any(h.model not in nominal for h in hypotheses):
        raise ValueError("slopes are known of white_noise, markov and random_walk "
                         "alone, not of " + ", ".join(h.name for h in hypotheses))

    def line(power, segments, otherwise):
        ends = np.flatnonzero(segments)
        ends = np.unique([ends, ends + 1]) if len(ends) else [otherwise]
        return allan_line(tau[ends], adev[ends], power)
    low = curve.argmin()
    top = low + curve[low:].argmax()
    falls = np.logical_and.accumulate(slope < -0.25)    # from the shortest time on
    rises = (slope > 0.25) & (np.arange(len(slope)) >= low)
    read = dict(sigma_v=line(-0.5, falls, 0) / np.sqrt(dt),
                sigma_w=line(0.5, rises, -1) * np.sqrt(3.0 * dt),
                tau_m=tau[top] / 1.89, sigma_m=adev[top] / (0.437 * np.sqrt(2.0)))
    return (int(np.argmin([abs(end - nominal[h.model]) for h in hypotheses])),
            [np.array([np.clip(read[p.symbol], p.low, p.high) for p in h.parameters])
             for h in hypotheses])


def allan_least_squares(y, dt, hypotheses):
    """Model and parameters from weighted least squares of the whole Allan variance.

    The generalized method of wavelet moments (S. Guerrier, J. Skaloud, Y. Stebler,
    M.-P. Victoria-Feser, J. Am. Stat. Assoc. 108, 2013): twice the variance of Haar
    wavelets is the Allan variance. The model is chosen by the wavelet variance
    information criterion with a diagonal covariance: the sum of squares plus 2 p.
    """
    tau, adev = allan_deviation(y, dt)
    fits = [fit_allan_variance(h, dt, tau, adev**2, np.sum(~np.isnan(y)))
            for h in hypotheses]
    costs = [cost + 2.0 * len(free_columns(h.parameters))
             for h, (_, cost) in zip(hypotheses, fits)]
    return int(np.argmin(costs)), [theta for theta, _ in fits]


def fit_allan_variance(h, dt, tau, avar, samples):
    """Weighted least squares of an Allan variance.

    Parameters
    ----------
    h : Hypothesis
        Model and ranges of its parameters.
    dt : float
        Sampling interval, s.
    tau : (J,) array
        Averaging times, s, whole multiples of dt.
    avar : (J,) array
        Overlapping Allan variance, u^2.
    samples : int
        Length of the record, which sets the weights: the degrees of freedom of a
        wavelet variance (D. Percival, A. Walden, "Wavelet Methods for Time Series
        Analysis", 2000, Sec. 8.4, the third approximation). They are those of the
        95 % intervals of the curve first, then those of the model so found.

    Returns
    -------
    theta : (p,) array
    cost : float
        Weighted sum of squares at theta.
    """
    m = np.round(np.asarray(tau) / dt).astype(int)
    half = 0.5 * np.maximum((samples - 2.0 * m + 1.0) / (2.0 * m), 1.0)
    low, high = avar * half / gammaincinv(half, [[0.975], [0.025]])
    sd = (high - low) / (ndtri(0.975) - ndtri(0.025))

    def expected(u):
        return model_allan_variance(h.filter(dt, at_quantiles(h.parameters, u)), m)

    def residual(u, sd):
        return (avar - expected(u)) / sd
    u = min(_coarse(h), key=lambda u: np.sum(residual(u, sd)**2))
    for step in range(2):
        if len(u):
            u = least_squares(residual, u, bounds=(0.0, 1.0), args=(sd,)).x
        sd = expected(u) / np.sqrt(half)
    return at_quantiles(h.parameters, u), float(np.sum(residual(u, sd)**2))


def akaike(y, dt, hypotheses):
    """Maximum likelihood within the ranges, model by AIC (H. Akaike, IEEE Trans.
    Automat. Contr. 19, 1974).
    """
    return _penalized(hypotheses, _maximum_likelihood(y, dt, hypotheses), 2.0)


def schwarz(y, dt, hypotheses):
    """Maximum likelihood within the ranges, model by BIC (G. Schwarz, Ann. Stat. 6,
    1978).
    """
    return _penalized(hypotheses, _maximum_likelihood(y, dt, hypotheses),
                      np.log(np.sum(~np.isnan(y))))


def _maximum_likelihood(y, dt, hypotheses):
    """(parameters, log-likelihood) of every hypothesis."""
    return _kept_fits(np.asarray(y, float).tobytes(), dt, tuple(hypotheses))


@functools.lru_cache(maxsize=2)    # both criteria look at the same fits
def _kept_fits(y, dt, hypotheses):
    y = np.frombuffer(y)

    def log_likelihoods(h, theta):
        return next(_likelihoods_at(h, dt, theta, y, [len(y)]))
    return [_maximize(h, log_likelihoods) for h in hypotheses]


def whittle(y, dt, hypotheses):
    """Model by AIC and parameters by Whittle's likelihood of the first differences.

    P. Whittle, Ark. Mat. 2, 1953. Differences are stationary for a random walk, too,
    and free of the bias. For sums of one-state processes without missing samples.
    """
    if np.ndim(y) != 1 or not np.isfinite(y).all():
        raise ValueError("Whittle's likelihood is of one record without missing "
                         "samples")
    n = len(y) - 1
    power = np.abs(np.fft.rfft(np.diff(y)))[1:(n + 1) // 2]**2 / n
    turn = 2.0 - 2.0 * np.cos(2.0 * np.pi * np.arange(1, (n + 1) // 2) / n)

    def log_likelihoods(h, theta):
        own = modes(bank(h, dt, theta))
        if own is None:
            raise ValueError(f"{h.name} is no sum of one-state processes: "
                             "Whittle's likelihood is of such sums alone")
        return _whittle(power, turn, n, own.a, own.q, own.r[:, 0])
    return _penalized(hypotheses, [_maximize(h, log_likelihoods) for h in hypotheses],
                      2.0)


ALGORITHMS = dict(slopes=allan_slopes, gmwm=allan_least_squares, aic=akaike,
                  bic=schwarz, whittle=whittle)


@njit(**JIT)
def _whittle(power, turn, n, a, q, r):
    """Whittle log-likelihood (M,) of a periodogram of n differences.

    Its expectation is the spectrum and, as the differences of the white noise do not
    go around in a circle, 2 r cos(w) / n: little, but all there is at low frequencies.
    """
    total = np.zeros(len(a))
    for node in range(len(a)):
        for j in range(len(power)):
            S = r[node] + spectrum(a[node], q[node], turn[j])
            S = S * turn[j] + r[node] * (2.0 - turn[j]) / n
            total[node] -= np.log(S) + power[j] / S
    return total


def _likelihoods_at(h, dt, theta, y, stops):
    """ln f(Y / theta) (M,) of one record at every stop."""
    offset = np.nanmean(y)    # leaves the sums of a large bias their digits
    for sums in filter_bank(bank(h, dt, theta), y[None] - offset, stops):
        yield log_likelihood(
            1.0, sums.count, sums.chi2[0], sums.score[0], sums.information,
            sums.log_det, (-offset, h.bias_sigma**2))


def _penalized(hypotheses, fits, penalty):
    """The choice by likelihood, less half a penalty per free parameter."""
    return (int(np.argmax([2.0 * top - penalty * len(free_columns(h.parameters))
                           for h, (_, top) in zip(hypotheses, fits)])),
            [theta for theta, _ in fits])


DERIVATIVE_STEP = 1e-5    # of a range


def _maximize(h, log_likelihoods):
    """Parameters (p,) in their ranges where a function of h and nodes (M, p) is
    largest.
    """
    nodes = _coarse(h)
    ll = log_likelihoods(h, at_quantiles(h.parameters, nodes))
    u = nodes[int(np.argmax(ll))]
    if not len(u):
        return at_quantiles(h.parameters, u), float(ll[0])

    def with_slope(u):
        """Minus the log-likelihood and its slope: one call of a bank."""
        around = np.clip(u + DERIVATIVE_STEP * np.vstack([
            np.zeros(len(u)), np.eye(len(u)), -np.eye(len(u))]), 0.0, 1.0)
        ll = -log_likelihoods(h, at_quantiles(h.parameters, around))
        up, down = around[1:].reshape(2, len(u), len(u)).diagonal(0, 1, 2)
        return ll[0], (ll[1:len(u) + 1] - ll[len(u) + 1:]) / (up - down)
    # in C alone: what calls BLAS wakes its threads, which wait for a busy core
    best = minimize(with_slope, u, jac=True, method="TNC",
                    bounds=[(0.0, 1.0)] * len(u), options=dict(ftol=1e-5))
    return at_quantiles(h.parameters, best.x), -float(best.fun)


def _coarse(h):
    """Nodes (M, d) of a coarse grid over the prior, in its quantiles."""
    return np.array(list(itertools.product((np.arange(4) + 0.5) / 4.0,
                                           repeat=len(free_columns(h.parameters)))))


FEWEST_TRIALS = 32    # of an expectation whose inverse is a bound: of few it is wide


def estimation_bound(h, dt, times, trials=2000, seed=0):
    """Bayesian Cramer-Rao bound: what no estimator's RSD, Eq. (20), can fall below.

    Parameters
    ----------
    h : Hypothesis
    dt : float
        Sampling interval, s.
    times : (T,) array
        Record lengths, s, each longer than the last.
    trials, seed : int
        For the expectations.

    Returns
    -------
    bound, se : (T, d) array
        For every parameter that is free, with its Monte-Carlo standard error.

    Raises
    ------
    ValueError
        If a prior is not uniform, or a time no finite number.

    Notes
    -----
    The bound of Van Trees needs a prior that vanishes at its ends. With weights q_i(u)
    that vanish at both ends of u_i instead and psi_i = q_i d ln f / du_i + dq_i / du_i,
    the variance of u_i is at least E{q_i}^2 [E{psi psi'}^-1]_ii under the uniform prior
    itself (E. Weinstein, A. J. Weiss, IEEE Trans. Inf. Theory 34, 1988). The largest of
    some weights is taken: the bound stays loose where the information varies much over
    the prior.
    """
    if any(p.free and p.log for p in h.parameters):
        raise ValueError(f"{h.name} has a log-uniform prior: "
                         "the bound is of uniform ones")
    check_whole(trials, "numbers of trials", FEWEST_TRIALS)
    check_seed(seed)
    stops = stops_at(times, dt)
    free = [p for p in h.parameters if p.free]
    if not free:
        return np.empty((2, len(stops), 0))
    d, step = len(free), 1e-4
    u = step + (1.0 - 2.0 * step) * np.random.default_rng(seed).random((trials, d))
    score = np.empty((trials, len(stops), d))
    for trial in range(trials):
        exact = h._replace(parameters=tuple(Parameter(p.symbol, v, v) for p, v in zip(
            h.parameters, at_quantiles(h.parameters, u[trial]))))
        y = simulate([exact], dt, int(stops[-1]), 1, seed, trial).error[0]
        around = u[trial] + step * np.vstack([np.eye(d), -np.eye(d)])
        every = _likelihoods_at(h, dt, at_quantiles(h.parameters, around), y, stops)
        for t, ll in enumerate(every):
            score[trial, t] = (ll[:d] - ll[d:]) / (2.0 * step)
    gain = np.array([p.high - p.low for p in free]) / [abs(p.mean) for p in free]
    best = np.zeros((3, len(stops), d))
    # weights u_i (1 - u_i) times powers of all, which look where little is known; one
    # half of the trials chooses, the other answers
    for power in np.array(list(itertools.product((0.0, 2.0, 5.0), repeat=d))):
        tilt = np.prod(u**power, axis=1)[:, None]
        q = tilt * u * (1.0 - u)
        slope = tilt * (1.0 + power - (2.0 + power) * u)
        psi = q[:, None] * score + slope[:, None]
        one, two = (_weighted_bound(q[half], psi[half])
                    for half in (slice(None, trials // 2), slice(trials // 2, None)))
        best = np.where(one[0] > best[0], (one[0], *two), best)
    return gain * best[1], gain * best[2]


def _weighted_bound(q, psi):
    """E q sqrt([E{psi psi'}^-1]_ii) and its standard error, (T, d)."""
    inverse = np.linalg.inv(np.einsum("lti,ltj->tij", psi, psi) / len(psi))
    square = np.diagonal(inverse, axis1=1, axis2=2)
    bound = q.mean(0) * np.sqrt(square)
    # the delta method: d[J^-1] = -J^-1 dJ J^-1; q varies as well
    pull = (0.5 * np.einsum("tij,ltj->lti", inverse, psi)**2 / square
            - (q / q.mean(0))[:, None])
    return bound, bound * pull.std(0, ddof=1) / np.sqrt(len(psi))
