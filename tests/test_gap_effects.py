"""Effects as they are written: covariances, spectra, simulated records."""

import numpy as np
import pytest
from conftest import DT, MODEL, member, through_low_pass
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm, solve_continuous_lyapunov, solve_triangular
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Found, Scene, Simulator, simulate_effects
from sensorlab.gap import backward, filters, members
from sensorlab.gap.effects import fixed, signature_of
from sensorlab.gap.processes import flicker_processes
from sensorlab.gap.shapes import less_noise


def shaped(numerator, denominator, lag):
    """Covariance at some lags of white noise through a rational filter."""
    pulse = np.zeros(2000)
    pulse[0] = 1.0
    response = lfilter(numerator, denominator, pulse)
    return np.correlate(response, response, "full")[1999:][lag]


def driven(p0, a, times):
    """Covariance of a Markov process of the variance p0 at first whose noise has so
    many times the variance that keeps it, at every sample.
    """
    response = a**np.subtract.outer(np.arange(len(times)), np.arange(len(times)))
    response = np.tril(response)
    at_first = a**np.arange(1, len(times) + 1)
    return p0 * (np.outer(at_first, at_first) + (1.0 - a * a) * (
        response * times) @ response.T)


def butterworth(tau, times):
    """Covariance of white noise through a Butterworth low-pass of second order, sampled
    every second, which is `times` (N,) as strong from one sample to the next; at rest
    it passes whole.
    """
    A = np.array([[0.0, 1.0], [-1.0 / tau**2, -np.sqrt(2.0) / tau]])
    turn = [expm(A * k) for k in range(400)]
    P = solve_continuous_lyapunov(A, np.diag([0.0, -1.0]))
    own = np.array([(Phi @ P)[0, 0] for Phi in turn])
    P /= 2.0 * own.sum() - own[0]
    Q, result = P - turn[1] @ P @ turn[1].T, np.empty((len(times), len(times)))
    for i, strength in enumerate(times):
        P = turn[1] @ P @ turn[1].T + strength**2 * Q
        for j in range(i, len(times)):
            result[i, j] = result[j, i] = (turn[j - i] @ P)[0, 0]
    return result


@pytest.mark.large
@pytest.mark.parametrize("tau", [0.33, 0.5, 9.0])
@pytest.mark.parametrize("variant", [
    "digital first order", "digital", "exponential"])
@pytest.mark.parametrize("model, theta", [
    ("random_walk", dict(sigma_w=0.1)),
    ("random_walk_markov", dict(sigma_w=0.1, tau_m=12.0, sigma_m=0.6))])
def test_all_processes_pass_a_digital_low_pass(model, theta, variant, tau):
    """Against covariances through SciPy's filter, far from where it begins."""
    N, sigma_v, wide = 600, 0.4, 1e3
    t = np.arange(N)
    lag = np.abs(np.subtract.outer(t, t))
    cov = sigma_v**2 * np.eye(N)
    cov += theta["sigma_w"]**2 * np.minimum.outer(t + 1, t + 1)
    if "tau_m" in theta:
        cov += theta["sigma_m"]**2 * np.exp(-lag / theta["tau_m"])
    L = through_low_pass(variant, tau, N)
    late = slice(N - 150, N)
    own = (L @ cov @ L.T)[late, late]    # and a constant, of which nothing is known
    y = np.linalg.cholesky(own) @ np.random.default_rng(3).standard_normal(150) + 2.0
    y[60:65] = np.nan
    seen, scene = ~np.isnan(y), Scene(y, 1.0, {})
    h = member(scene, sensorid.hypothesis(model, bias_sigma=wide, sigma_v=sigma_v,
                                          **theta)).with_effect(
        CATALOGUE["bandwidth"], variant)
    theta = np.array([[*(p.low for p in h.parameters[:-1]), tau]])
    root = np.linalg.cholesky(own[np.ix_(seen, seen)])
    z, one = solve_triangular(root, np.column_stack([y[seen], np.ones(seen.sum())]),
                              lower=True).T
    spread = 1.0 / wide**2 + one @ one
    expected = -0.5 * (seen.sum() * np.log(2.0 * np.pi) + np.log(spread * wide**2)
                       + z @ z - (z @ one)**2 / spread) - np.log(np.diag(root)).sum()
    for log_likelihood in (
            filters.log_likelihoods(h, scene, (), np.repeat(theta, 3, 0)),
            filters.predict_first(h, scene, (), theta, y[None]).log_likelihood[0]):
        assert_allclose(log_likelihood, expected, atol=0.02)
    drawn = h.filter(1.0, theta[0])
    assert np.linalg.eigvalsh(np.squeeze(drawn.P0))[0] > -1e-12


def test_what_is_found_after_a_low_pass_passes_it_unless_it_is_of_white_noise():
    scene = Scene(np.random.default_rng(2).standard_normal(300), 1.0, {})
    white = member(scene, sensorid.hypothesis("white_noise", sigma_v=1.0))
    walk, own = CATALOGUE["random_walk"], Simulator(
        (white.hypothesis,), ((Found(CATALOGUE["bandwidth"], variant="digital",
                                     values=dict(tau=2.0)),),))
    found = white.with_effect(CATALOGUE["bandwidth"], "digital")
    first = white.with_effect(walk).with_effect(CATALOGUE["bandwidth"], "digital")

    def told(h):
        at = dict(tau=2.0, sigma_w=0.1, sigma_v=1.0)
        theta = np.array([[at[symbol] for _, symbol in h.keys]])
        return filters.log_likelihoods(h, scene, (), theta)[0]
    assert told(found.with_effect(walk)) == pytest.approx(told(first))
    behind = found.behind_low_passes(white).with_effect(walk)
    assert behind.effects[0].variant == "digital white noise"
    assert abs(told(behind) - told(first)) > 1.0
    (given,) = members.members(own, scene)    # that of the simulator stays as it is
    assert given.behind_low_passes(given).effects == given.effects


@pytest.mark.parametrize("name, variant", [
    ("random_walk", ""), ("correlated_noise", ""), ("bias_instability", ""),
    ("narrow_band_noise", ""), ("bandwidth", "first order"), ("blue_noise", ""),
    ("bandwidth", "second order"), ("noise_step", ""), ("noise_sensitivity", "value"),
    ("noise_sensitivity", "square"), ("noise_ramp", ""), ("walk_step", ""),
    ("noise_step", "before the onset")])
def test_processes_have_the_covariance_that_is_written(name, variant):
    x = 0.02 * np.arange(-80.0, 120.0)
    scene, effect = Scene(np.zeros(200), DT, dict(rate=x)), CATALOGUE[name]
    h = member(scene, MODEL[1]).with_effect(effect, variant, "rate" * bool(
        effect.column))
    t, eye = np.arange(200), np.eye(200)
    lag = np.abs(t[:, None] - t)
    base, a = 0.81 * np.exp(-lag / 300.0), np.exp(-0.5)
    own, expected = {
        ("random_walk", ""): ((0.1,), base + 0.16 * eye + 0.01 * np.minimum.outer(
            t + 1, t + 1)),
        ("correlated_noise", ""): ((7.0, 0.6), base + 0.16 * eye
                                   + 0.36 * np.exp(-lag / 7.0)),
        # sigma is over two decades
        ("bias_instability", ""): ((0.6,), base + 0.16 * eye + 0.18 * np.pi / np.log(
            10.0) * sum(own * np.exp(-lag / tau) for tau, own in zip(
                *flicker_processes(200)))),
        ("narrow_band_noise", ""): ((0.12, 30.0, 0.6), base + 0.16 * eye + 0.36
                                    * np.exp(-lag / 30.0)
                                    * np.cos(2.0 * np.pi * 0.12 * lag)),
        ("bandwidth", "first order"): ((2.0,), base + 0.16 * np.tanh(0.25) * np.exp(
            -lag / 2.0)),
        ("bandwidth", "second order"): ((2.0,), base + 0.16 * butterworth(
            2.0, np.ones(200))),
        ("blue_noise", ""): ((2.0, 0.6), base + 0.16 * eye + 0.36 * 0.5 * (
            1.0 + a) * shaped([1.0, -1.0], [1.0, -a], lag)),
        ("noise_step", ""): ((120.0, 3.0), base + 0.16 * eye * np.where(
            t >= 120, 9, 1)),
        ("noise_step", "before the onset"): ((120.0, 3.0), base + 0.16 * eye * np.where(
            t < 120, 9, 1)),
        ("noise_sensitivity", "value"): ((3.0, 0.5, 4.0), base + 0.16 * eye * 9.0**((
            x - 0.5) / 4.0)),
        ("noise_sensitivity", "square"): ((3.0, 0.5, 4.0), base + 0.16 * eye * (
            1.0 + 8.0 * (x - 0.5)**2 / 16.0)),
        ("noise_ramp", ""): ((3.0, 50.0, 100.0), base + 0.16 * eye * 9.0**((
            t - 50.0) / 100.0)),
        ("walk_step", ""): ((120.0, 3.0), 0.16 * eye + driven(0.81, np.exp(
            -1.0 / 300.0), np.where(t >= 120, 9, 1))),
    }[name, variant]
    theta = np.array([[300.0, 0.9, 0.4, *own]])
    y = np.random.default_rng(5).standard_normal(200)
    y[50:60] = np.nan
    seen = ~np.isnan(y)
    dense = multivariate_normal(cov=(expected + 1.0)[np.ix_(seen, seen)])
    scene = scene._replace(y=y)
    for log_likelihood in (
            filters.log_likelihoods(h, scene, (), theta),
            filters.predict(h, scene, (), theta).log_likelihood[0]):
        assert_allclose(log_likelihood, dense.logpdf(y[seen]), rtol=1e-8)
    assert_allclose(backward.solve(h, scene, (), theta).base, dense.logpdf(y[seen]),
                    rtol=1e-8)


@pytest.mark.parametrize("effects, form", [
    (("bandwidth", "noise_step"), ""), (("noise_step", "bandwidth"), ""),
    (("bandwidth", "noise_step"), "before the onset"),
    (("bandwidth", "noise_sensitivity"), "square"),
    (("noise_sensitivity", "bandwidth"), "square")])
@pytest.mark.parametrize("variant", ["first order", "second order"])
def test_a_change_of_the_noise_passes_the_low_pass(variant, effects, form):
    n, past, tau = 200, 200, 2.0
    x = np.sin(0.05 * np.arange(n)) + 0.2
    h = member(Scene(np.zeros(n), DT, dict(rate=x)), MODEL[1])
    for name in effects:
        h = h.with_effect(CATALOGUE[name], variant if name == "bandwidth" else form,
                          "rate" * (name == "noise_sensitivity"))
    times = np.where((np.arange(n) < 120) == bool(form), 3.0, 1.0)
    if form == "square":
        times = np.hypot(1.0, np.sqrt(8.0) * x / 1.5)
    times = np.append(np.full(past, times[0]), times)
    if variant == "first order":
        a = np.exp(-1.0 / tau)
        response = lfilter([1.0 - a], [1.0, -a], np.eye(past + n), axis=0)
        low_passed = (response * times**2) @ response.T
    else:
        low_passed = butterworth(tau, times)
    low_passed = 0.16 * low_passed[past:, past:]
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    own = dict(bandwidth=(tau,), noise_step=(120.0, 3.0),
               noise_sensitivity=(3.0, 0.0, 1.5))
    theta = np.array([300.0, 0.9, 0.4, *own[effects[0]], *own[effects[1]]])
    y = np.random.default_rng(5).standard_normal(n)
    expected = multivariate_normal(
        cov=0.81 * np.exp(-lag / 300.0) + low_passed + 1.0).logpdf(y)
    scene = h.scene._replace(y=y)
    assert_allclose(filters.log_likelihoods(h, scene, (), theta[None]), expected,
                    rtol=1e-8)
    assert_allclose(backward.solve(h, scene, (), theta[None]).base, expected, rtol=1e-8)
    own = next(sensorid.filter_bank(sensorid.bank(h, DT, theta[None]), y[None], [n]))
    assert_allclose(sensorid.log_likelihood(
        1.0, own.count, own.chi2, own.score, own.information, own.log_det, (0.0, 1.0)),
        expected, rtol=1e-8)


@pytest.mark.parametrize("samples", [300, 4000, 10**5, 10**7])
def test_flicker_noise_has_the_spectrum_of_the_standard(samples):
    decades = np.floor(np.log10(0.1 * samples)) + 1.0
    scene = Scene(np.broadcast_to(0.0, samples), DT, {})
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=1.0),
               "bias_instability")
    b = sensorid.bank(h, DT, np.array([[1.0, 1.0]]))
    a, q = (np.diagonal(m[0, 0])[1:, None] for m in (b.Phi, b.Q))
    k = np.unique(np.geomspace(1, samples / 5, 2000).astype(int))
    S = (q / np.abs(1.0 - a * np.exp(-2j * np.pi / samples * k))**2).sum(0)
    B2 = np.pi / (decades * np.log(10.0))    # of sigma = 1
    off = S / (B2 / (2.0 * np.pi * k / samples)) - 1.0
    # k periodograms an e-fold show a ripple of off by k off^2 / 4 nats: by a tenth, but
    # where the fastest process ends
    assert (np.abs(off) < 0.03 + 1.1 * np.sqrt(0.4 / k)).all()


ADDED = dict(
    rate_ramp=("", dict(slope=0.01)), bias_step=("", dict(onset=400.0, size=2.0)),
    turn_on_transient=("", dict(tau=100.0, size=3.0)),
    sinusoid=("", dict(frequency=0.05, amplitude=1.0, phase=0.5)),
    temperature=("temperature", dict(coefficient=0.2)),
    thermal_lag=("temperature", dict(coefficient=0.2, tau=40.0)),
    scale_factor=("rate", dict(coefficient=0.01)),
    thermal_scale_factor=("rate", dict(coefficient=0.001)),
    misalignment=("rate_y", dict(coefficient=0.02)),
    nonlinearity=("rate", dict(coefficient=1e-3)),
    latency=("rate", dict(coefficient=0.1)),
    lag=("rate", dict(coefficient=0.1, tau=3.0)),
    g_sensitivity=("acceleration", dict(coefficient=0.3)),
    covariate=("pressure", dict(coefficient=0.3)))


def test_simulated_signatures_are_what_is_written():
    n = 800
    t = np.arange(n) * DT
    rng = np.random.default_rng(3)
    columns = {name: rng.standard_normal(n).cumsum() for name in (
        "temperature", "rate", "acceleration", "pressure", "rate_y")}
    scene = Scene(np.zeros(n), DT, columns)
    T, rate = columns["temperature"], columns["rate"]
    lag, a = [T[0]], np.exp(-1.0 / 40.0)
    for x in T[1:]:
        lag.append(a * lag[-1] + (1 - a) * x)
    expected = dict(
        rate_ramp=0.01 * t, bias_step=2.0 * (t >= 400.0),
        turn_on_transient=3.0 * np.exp(-t / 100.0),
        sinusoid=np.cos(2 * np.pi * 0.05 * t + 0.5), temperature=0.2 * (T - T.mean()),
        thermal_lag=0.2 * (lag - np.mean(lag)),
        scale_factor=0.01 * (rate - rate.mean()),
        thermal_scale_factor=0.001 * (rate - rate.mean()) * (T - T.mean()),
        misalignment=0.02 * (columns["rate_y"] - columns["rate_y"].mean()),
        nonlinearity=1e-3 * (rate**2 - np.mean(rate**2)),
        latency=0.1 * np.append(0.0, np.diff(rate)),
        lag=0.1 * (np.append(np.full(3, rate[0]), rate[:-3]) - rate),
        g_sensitivity=0.3 * (columns["acceleration"] - columns["acceleration"].mean()),
        covariate=0.3 * (columns["pressure"] - columns["pressure"].mean()))
    plain = simulate_effects(Simulator(MODEL[:1]), scene, 2, seed=5).error
    assert_array_equal(plain, sensorid.simulate(MODEL[:1], DT, n, 2, seed=5).error)
    for name, (column, values) in ADDED.items():
        one = Found(CATALOGUE[name], column, "", values)
        with_effect = simulate_effects(Simulator(MODEL[:1], ((one,),)), scene, 2,
                                       seed=5).error
        assert_allclose(with_effect - plain, np.tile(expected[name], (2, 1)),
                        atol=1e-12, err_msg=name)


def test_a_lag_is_less_what_comes_at_once_where_that_is_compensated():
    T = np.random.default_rng(3).standard_normal(300).cumsum()
    scene = Scene(np.zeros(300), DT, dict(temperature=T))
    late, behind = (signature_of(scene, Found(
        CATALOGUE["thermal_lag"], "temperature", variant, {}), dict(
            coefficient=0.2, tau=40.0)) for variant in ("lagged value", "lag"))
    assert_allclose(behind, late - 0.2 * (T - T.mean()), atol=1e-12)


def test_a_lag_is_a_delay_or_a_low_pass():
    N, dt, tau = 4000, 0.01, 0.3
    t = dt * np.arange(N)

    def late(x):
        """What follows a motion, by form."""
        return {variant: x + columns[:, 0] for variant, columns in CATALOGUE[
            "lag"].columns(Scene(np.zeros(N), dt, {}), x, tau)}
    for variant, X in late(5.0 + 3.0 * t).items():    # of a ramp, all are tau late
        away = -tau if variant == "delay of the column" else tau
        assert_allclose(X[1000:-100], (5.0 + 3.0 * (t - away))[1000:-100], atol=0.02)
    twice, once = np.sqrt(2.0) / tau, 1.0 / tau    # rad/s of the cut-offs, where 1 / 2
    for omega, variant, behind, gain in (          # of the power passes
            (twice, "delay", twice * tau, 1.0),
            (twice, "second order", np.pi / 2.0, np.sqrt(0.5)),
            (once, "first order", np.pi / 4.0, np.sqrt(0.5))):
        assert_allclose(late(np.sin(omega * t))[variant][1000:], (
            gain * np.sin(omega * t - behind))[1000:], atol=0.02)


def test_simulated_noises_have_the_variance_that_is_written():
    h = sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=0.0)
    scene = Scene(np.zeros(20000), DT, {})

    def altered(*effects, beside={}):
        return simulate_effects(Simulator((h,), (effects,)), scene._replace(
            columns=beside), seed=2).error[0]

    def drawn(effect, variant="", **values):
        return altered(Found(CATALOGUE[effect], variant=variant, values={
            k: sensorid.Parameter(k, v, v) for k, v in values.items()}))
    y = drawn("noise_step", onset=10000.0, ratio=2.0)
    assert_allclose([y[:10000].std(), y[10000:].std()], [1.0, 2.0], rtol=0.03)
    assert_allclose(drawn("correlated_noise", tau=5.0, sigma=2.0).var(), 5.0, rtol=0.1)
    x = np.repeat([-3.0, 0.0, 4.0], [5000, 10000, 5000])
    turned = altered(Found(CATALOGUE["noise_sensitivity"], "rate", "square", fixed(
        ratio=3.0, about=0.0, per=4.0)), beside=dict(rate=x))
    assert_allclose([turned[own].std() for own in (x < 0.0, x == 0.0, x > 0.0)],
                    [np.sqrt(1.0 + 8.0 * 9.0 / 16.0), 1.0, 3.0], rtol=0.03)
    y = drawn("bandwidth", tau=3.0)
    a = np.exp(-1 / 3)
    assert_allclose(y.var(), (1 - a) / (1 + a), rtol=0.05)
    assert drawn("narrow_band_noise", frequency=0.02, tau=5.0, sigma=9.0).var() < 1.1
    y = drawn("narrow_band_noise", frequency=0.2, tau=5.0, sigma=2.0)
    seen = [np.mean(y[k:] * y[:len(y) - k]) for k in (0, 2, 5)]
    assert_allclose(seen, [5.0, 4.0 * np.exp(-0.4) * np.cos(0.8 * np.pi),
                           4.0 * np.exp(-1.0)], atol=0.15)
    y = drawn("bandwidth", tau=1.0, variant="second order")
    # a record of this length is off by 1.6 %, standard deviation of 64 of them
    assert_allclose(y.var(), butterworth(1.0, np.ones(1))[0, 0], rtol=3.0 * 0.016)
    y = drawn("blue_noise", tau=2.0, sigma=3.0)
    seen = [np.mean(y[k:] * y[:len(y) - k]) for k in (0, 1)]
    assert_allclose(seen, [10.0, -4.5 * (1.0 - np.exp(-0.5))], rtol=0.05)
    assert_allclose(drawn("outliers", rate=0.02, sigma=8.0).var(), 2.28, rtol=0.25)
    y = drawn("random_telegraph", dwell=30.0, size=6.0)
    assert_allclose(y.var(), 10.0, rtol=0.1)
    assert np.count_nonzero(np.diff(y > 0.0)) == pytest.approx(20000 / 30, rel=0.15)
    y = drawn("noise_bursts", quiet=60.0, duration=20.0, sigma=7.0)
    assert_allclose(y.var(), 1.0 + 0.25 * 49.0, rtol=0.15)
    # the size is alike as long as a burst lasts
    size = y**2 - y.var()
    seen = np.mean(size[10:] * size[:-10]) / np.mean(size[1:] * size[:-1])
    assert_allclose(seen, np.exp(-9.0 / 15.0), atol=0.12)
    steps = np.diff(drawn("random_steps", dwell=40.0, sigma=50.0))
    far = np.abs(steps) > 6.0
    assert far.mean() == pytest.approx(0.9 * (1.0 - np.exp(-1.0 / 40.0)), rel=0.1)
    assert steps[far].std() == pytest.approx(53.0, rel=0.1)    # without the small ones
    y = altered(*(Found(CATALOGUE[name], values=values) for name, values in (
        ("saturation", dict(limits=[-1.0, 2.0])),
        ("quantization", dict(lsb=0.25)),
        ("dropouts", dict(value=-9.0, spans=[[40.0, 3], [60.0, 1]])),
        ("stuck", dict(spans=[[100.0, 20]])))))
    assert (np.flatnonzero(y == -9.0) == [40, 41, 42, 60]).all()
    y = y[y != -9.0]
    assert y.min() == -1.0 and y.max() == 2.0 and len(np.unique(y)) <= 13
    assert (y[96:116] == y[96]).all()
    h = sensorid.hypothesis("random_walk", sigma_w=0.1, sigma_v=0.0)
    y = drawn("walk_step", onset=10000.0, ratio=9.0)
    assert_allclose([np.diff(y[:10000]).std(), np.diff(y[10000:]).std()], [0.1, 0.9],
                    rtol=0.03)


@pytest.mark.parametrize("name, variant", [
    (e.name, v) for e in CATALOGUE.values() if e.model and not e.reading
    for v in e.variants or ("",)])
def test_a_bank_with_effects_is_that_of_its_filters(name, variant):
    scene = Scene(np.sin(np.arange(200.0)), DT, dict(rate=np.arange(-100.0, 100.0)))
    h = sensorid.hypothesis("markov", tau_m=(1.0, 100.0), sigma_m=(0.1, 1.0),
                            sigma_v=(0.5, 2.0))
    effect = CATALOGUE[name]
    m = member(scene, h).with_effect(
        effect, variant, "rate" * bool(effect.column)).with_effect(CATALOGUE[
            "bias_instability" if name != "bias_instability" else "correlated_noise"])
    theta = sensorid.at_quantiles(m.parameters, np.random.default_rng(1).random(
        (7, len(m.parameters))))
    assert m.elementwise
    b = sensorid.bank(m, DT, theta)
    for node, row in enumerate(theta):
        one = sensorid.shaping_filter(*m.filter(DT, row))
        for part, expected in zip(b, (one.Phi, one.Gamma @ one.Gamma.swapaxes(1, 2),
                                      one.H, one.Psi**2, one.m0, one.P0)):
            assert_allclose(part[node], expected, rtol=1e-12)


def test_a_low_pass_does_not_smooth_the_rounding():
    scene = Scene(np.zeros(100), DT, {})
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=2.0))
    h = h.joined(Found(CATALOGUE["quantization"], values=fixed(lsb=1.2)))
    filt = h.with_effect(CATALOGUE["bandwidth"]).filter(DT, np.array([2.0, 1.2, 5.0]))
    assert_allclose(filt.Psi, np.sqrt(1.2**2 / 12.0))    # all the rest is correlated


def test_of_two_levels_a_simulator_takes_one():
    both = [Found(CATALOGUE[name], values=fixed(**values)) for name, values in (
        ("random_telegraph", dict(dwell=30.0, size=6.0)),
        ("noise_bursts", dict(quiet=60.0, duration=20.0, sigma=7.0)))]
    with pytest.raises(ValueError, match="takes one of them"):
        simulate_effects(Simulator(MODEL[:1], (tuple(both),)), Scene(
            np.zeros(100), DT, {}))


def wander(n, fast=0.004):
    rng = np.random.default_rng(3)
    return np.cumsum(fast * rng.standard_normal(n)) + np.sin(np.arange(n) / 700.0)


@pytest.mark.parametrize("noise, lsb", [(0.05, 0.0), (0.05, 0.06), (0.2, 0.0)])
def test_a_thermometer_is_taken_less_its_noise(noise, lsb):
    true = wander(4000)
    x = true + noise * np.random.default_rng(4).standard_normal(4000)
    x = lsb * np.round(x / lsb) if lsb else x
    assert np.std(less_noise(x) - true) < 0.3 * np.std(x - true)
    if noise > 0.1:    # of a part of it, more is noise: what moves is not told from it
        assert_array_equal(less_noise(x[:800]), x[:800])
        return
    # the best that knows the walk and the noise, by least squares
    n = 800
    walk = 0.004**2 * np.minimum.outer(np.arange(n), np.arange(n)) + 1.0
    best = walk @ np.linalg.solve(walk + np.var(x - true) * np.eye(n), x[:n])
    assert np.std(less_noise(x[:n]) - true[:n]) < 1.25 * np.std(best - true[:n])


@pytest.mark.parametrize("x", [
    wander(4000), np.zeros(100), np.random.default_rng(5).standard_normal(4000),
    np.sin(np.arange(4000.0))], ids=["walk", "nothing", "noise", "wave"])
def test_a_column_that_shows_no_noise_beside_what_moves_is_as_it_is(x):
    assert_array_equal(less_noise(x), x)


@pytest.mark.large
def test_the_noise_of_a_thermometer_makes_no_lag():
    rng, N = np.random.default_rng(6), 4000
    true = 3.0 * np.sin(np.arange(N) / 500.0)
    y = rng.standard_normal(N) + 0.15 * true
    T = true + 0.4 * rng.standard_normal(N)
    d = sensorlab.diagnose(y, DT, [sensorid.hypothesis(
        "white_noise", sigma_v=(0.3, 3.0))], dict(temperature=T))
    assert d.verdict == "temperature"
    assert d.found[0].values["coefficient"][0] == pytest.approx(0.15, rel=0.15)
