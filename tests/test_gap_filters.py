"""Filters of the gap against dense Gaussians and sums over all histories."""

import itertools

import generator
import naive
import numpy as np
import pytest
from conftest import DT, MODEL, dense, large, member, paper_case, through_low_pass
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import multivariate_normal, norm

import sensorid
from sensorlab import CATALOGUE, Found, Scene
from sensorlab.gap import backward, filters, linear, parts, scans, signatures
from sensorlab.gap.catalogue import MIN_PULSE
from sensorlab.gap.kernels import adjoint, arithmetic, mixtures, told, whitening
from sensorlab.gap.processes import join


def test_severity_is_that_of_the_dense_covariance():
    s = np.sin(0.05 * np.arange(200.0)) + 0.01 * np.arange(200.0)
    p = dict(tau_m=300.0, sigma_m=0.9, sigma_v=0.4)
    expected = s @ np.linalg.solve(dense(p.values(), 200), s)
    # the generator's process starts one step earlier: stationary all the same
    assert_allclose(generator.information(s, "markov", p), expected, rtol=1e-9)


def test_mixture_filter_without_jumps_is_the_dense_gaussian(short):
    scene, h, theta, C, seen = short
    expected = multivariate_normal(cov=C[np.ix_(seen, seen)]).logpdf(scene.y[seen])
    assert_allclose(filters.predict(h, scene, (), theta).log_likelihood,
                    expected, rtol=1e-10)


def test_signatures_in_the_bank_and_in_the_mixture_filter_say_the_same(short):
    scene, h, theta, C, seen = short
    t = scene.time
    columns = np.column_stack([np.cos(0.3 * t), np.sin(0.3 * t)])
    found = linear.Signature(Found(CATALOGUE["sinusoid"]), columns, 2.0)
    C = (C + 4.0 * columns @ columns.T)[np.ix_(seen, seen)]
    expected = multivariate_normal(cov=C).logpdf(scene.y[seen])
    assert_allclose(filters.log_likelihoods(h, scene, (found,), theta), expected,
                    rtol=1e-9)
    assert_allclose(filters.predict(h, scene, (found,), theta).log_likelihood,
                    expected, rtol=1e-9)


def test_plain_filters_are_the_mixture_filters_without_jumps(short):
    scene, _, _, _, seen = short
    h = member(scene, paper_case(3)[1], "noise_step")
    theta = np.array([[300.0, 0.9, 0.4, 80.3, 2.0], [90.0, 0.5, 0.7, 120.0, 0.3]])
    found = linear.Signature(Found(CATALOGUE["sinusoid"]), np.column_stack(
        [np.cos(0.3 * scene.time), np.sin(0.3 * scene.time)]), 2.0)
    y = scene.y + np.random.default_rng(2).standard_normal((11, 200))    # same gaps
    plain = filters.predict(h, scene, (found,), theta, y)
    y[3, 150] = np.nan                            # no longer
    mixed = filters.predict(h, scene, (found,), theta, y)
    same, until = np.arange(11) != 3, np.s_[3, :, :150]
    assert_allclose(plain.log_likelihood[same], mixed.log_likelihood[same], rtol=1e-12)
    for one, other in ((plain.z, mixed.z), (plain.log_score, mixed.log_score)):
        assert_allclose(one[same], other[same], rtol=1e-9, atol=1e-9)
        assert_allclose(one[until], other[until], rtol=1e-9, atol=1e-9)
    assert np.array_equal(np.isnan(plain.z[0, 0]), ~seen)
    assert_allclose(filters.filtered(h, scene, (found,), theta, y[:3]),    # the bank's
                    plain.log_likelihood[:3], rtol=1e-9)


def test_a_filter_without_noise_has_variances_all_the_same():
    # a low-pass of next to no noise, beside constants that are known after a few steps
    own = np.zeros((8, 5))
    own[0] = [1.97171336, 0.0, 1.0, 1.0, 1.0]
    own[1, :2] = [-0.972107865, 1.0]
    own[2, 0] = own[6, 0] = 2e-21
    own[4], own[5, :2] = [1e-16, 1e-16, 1.35544998e-4, 2.6e-6, 2.6e-6], 0.9998e-16
    N = 6000
    H = np.column_stack([np.ones(N), np.zeros(N), np.ones(N), *(
        wave(0.03 * np.arange(N)) for wave in (np.cos, np.sin))])
    gain, f = np.empty((N, 5)), np.empty(N)
    whitening.plain_gains(H, own, np.array([1, 0, 2, 3, 4]), np.zeros(0, int),
                          np.zeros(1), np.zeros(N, bool), gain, f)
    assert f.min() > 0.0 and np.isfinite(gain).all()


@pytest.mark.large
def test_a_change_of_what_drives_the_states_is_that_of_the_general_bank(short):
    """Two ways that share no line: matrices of every sample, and one number more."""
    scene, *_, seen = short
    h = member(scene, sensorid.hypothesis(
        "two_markov", tau_m=300.0, sigma_m=0.9, tau_n=5.0, sigma_n=0.6, sigma_v=0.4),
        "correlated_noise", "walk_step")
    theta = np.array([[300.0, 0.9, 5.0, 0.6, 0.4, 9.0, 0.7, 80.3, 5.0],
                      [300.0, 0.9, 5.0, 0.6, 0.4, 3.0, 0.3, 120.0, 0.2]])
    t = scene.time
    rows = np.array([scene.y, np.where(seen, np.cos(0.3 * t), np.nan)])
    # base states alone: the matrices of a step are taken before another joins
    b = sensorid.bank(h, DT, theta)
    assert b.Q.shape == (2, 200, 3, 3)
    whole = next(sensorid.filter_bank(b, rows, [200], [(0, 1)]))
    one = backward.solve(h, scene, (), theta)
    for mine, its in zip(linear.summed(one.bank, one.parts, rows, [(0, 1)]), whole):
        assert_allclose(mine, its, rtol=1e-9)
    white = filters.predict(h, scene, (), theta)
    assert_allclose(white.log_likelihood[0], one.base, rtol=1e-10)
    assert_allclose(filters.log_likelihoods(h, scene, (), theta), one.base, rtol=1e-10)


def test_outliers_in_white_noise_are_an_independent_mixture():
    h = sensorid.hypothesis("white_noise", sigma_v=0.5, bias_sigma=0.0)
    scene = Scene(np.random.default_rng(1).standard_normal(300), DT, {})
    h = member(scene, h, "outliers")
    rate, sigma = 0.05, 3.0
    p = filters.predict(h, scene, (), np.array([[0.5, rate, sigma]]))
    narrow = (1 - rate) * norm.pdf(scene.y, scale=0.5)
    wide = rate * norm.pdf(scene.y, scale=np.hypot(0.5, sigma))
    assert_allclose(p.log_score[0, 0], np.log(narrow + wide), rtol=1e-10)
    assert_allclose(p.odd[0, 0], wide / (narrow + wide), rtol=1e-10)
    cdf = (1 - rate) * norm.cdf(scene.y, scale=0.5) + rate * norm.cdf(
        scene.y, scale=np.hypot(0.5, sigma))
    assert_allclose(norm.cdf(p.z[0, 0]), cdf, rtol=1e-9)


@pytest.mark.parametrize("names", [
    ["outliers"], ["noise_step", "outliers"], ["random_telegraph"],
    ["noise_step", "noise_bursts"], ["random_steps"]])
def test_unrolled_mixture_filters_are_the_general_ones(short, names, monkeypatch):
    scene, *_ = short
    h = member(scene, paper_case(3)[1], *names)
    u = np.random.default_rng(1).uniform(0.1, 0.9, (6, len(h.parameters)))
    theta = sensorid.at_quantiles(h.parameters, u)
    found = [linear.Signature(Found(CATALOGUE["sinusoid"]), np.cos(
        0.3 * scene.time)[:, None], 2.0)]
    y = scene.y + np.random.default_rng(2).standard_normal((3, 200))
    y[1, 190:] = np.nan
    y[2, ::20] += 9.0

    def answers():
        return (filters.predict(h, scene, found, theta, y),
                filters.predict_first(h, scene, found, theta, y, False, 2),
                filters.log_likelihoods(h, scene, found, theta))
    fast, general = answers(), mixtures._filter_mixtures
    monkeypatch.setattr(mixtures, "_filter_mixtures", None)
    answers()    # not one of them is general
    monkeypatch.setattr(mixtures, "_filter_mixtures", general)
    for most in ("UNROLLED_OUTLIERS", "UNROLLED_LEVELS"):
        monkeypatch.setattr(mixtures, most, 0)
    for one, other in zip(fast, answers()):
        for part, expected in zip(one, other) if isinstance(one, tuple) else (
                (one, other),):
            if part is not None:
                assert_allclose(part, expected, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("missing", [0, large(3)])
@pytest.mark.parametrize("first, bias, off", [
    ([0.3], 3.0, 1.0), ([40.0], 3.0, 1.0), ([40.0], 50.0, 1.0),
    ([40.0, 40.0], 50.0, 4.0), ([-40.0, 30.0], 50.0, 4.0)])
def test_first_samples_may_be_outliers_as_any_others(first, bias, off, missing):
    """The sum over all sets of outliers; a filter keeps one law of a level that nobody
    knows yet, which costs it so many nats: without a look back, 80 to 95.
    """
    rng, rate, sigma, wide, n = np.random.default_rng(5), 0.01, 0.5, 20.0, 11
    y = 2.0 + sigma * rng.standard_normal(n)
    y[:len(first)] += first
    scene = Scene(np.append(np.full(missing, np.nan), y), DT, {})
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=sigma,
                                          bias_sigma=bias), "outliers")
    told = filters.predict(h, scene, (), np.array([[sigma, rate, wide]]))
    sets = np.array(list(itertools.product((0, 1), repeat=n)))
    each = np.array([
        multivariate_normal(np.zeros(n), np.diag(sigma**2 + wide**2 * odd) + bias**2
                            ).logpdf(y) + np.log(np.where(odd, rate, 1 - rate)).sum()
        for odd in sets])
    exact = np.logaddexp.reduce(each)
    assert_allclose(told.log_likelihood[0, 0], exact, atol=off)
    odd = np.exp(np.logaddexp.reduce(each[sets[:, 0] == 1]) - exact)
    assert_allclose(told.odd[0, 0, missing], odd, atol=0.02)


@pytest.mark.parametrize("known", [0, 1])
@pytest.mark.parametrize("name", ["random_steps", "random_telegraph", "outliers"])
@pytest.mark.parametrize("base", ["random_walk", "white_noise"])
def test_levels_that_only_noise_moves_are_one_state(base, name, known, monkeypatch):
    rng = np.random.default_rng(6)
    y = np.cumsum(0.1 * rng.standard_normal(400)) + 0.5 * rng.standard_normal(400)
    y[100:120], scene = np.nan, Scene(np.zeros(400), DT, {})
    ranges = dict(random_walk=dict(sigma_w=(0.05, 0.2)), white_noise={})[base]
    h = member(scene, sensorid.hypothesis(base, **ranges, sigma_v=(0.25, 1.0),
                                          bias_sigma=2.0), name)
    theta = sensorid.at_quantiles(
        h.parameters, rng.uniform(0.1, 0.9, (5, len(h.parameters))))
    found = [linear.Signature(Found(CATALOGUE["sinusoid"]), np.cos(
        0.3 * scene.time)[:, None], 2.0)] * known
    one = filters.predict(h, scene, found, theta, y[None])
    monkeypatch.setattr(filters, "_with_one_level", lambda own, H: (own, H))
    for part, other in zip(one, filters.predict(h, scene, found, theta, y[None])):
        assert_allclose(part, other, rtol=1e-6, atol=1e-9)


def test_steps_far_from_the_prior_of_the_bias_are_no_matter_of_rounding():
    """What is known of a bias and of steps apart would grow till it hides their sum."""
    t = np.arange(1000) / 1000.0
    scene = Scene(120.0 * (t - 2.0)**2 + np.random.default_rng(1).standard_normal(1000),
                  1.0, {})
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=(0.5, 2.0),
                                          bias_sigma=5.0), "random_steps")
    told = filters.log_likelihoods(h, scene, (), np.array([[1.0, 58.0, 7.3],
                                                           [1.0, 58.1, 7.3]]))
    assert np.isfinite(told).all() and np.ptp(told) < 1.0


def test_tail_is_that_of_the_normal_law_as_far_as_there_are_numbers():
    score = np.linspace(0.0, 37.0, 2001)
    expected = norm.sf(score)
    actual = np.array([told.tail(one) for one in score])
    near = score < 8.0
    assert_allclose(actual[near], expected[near], rtol=1e-10)
    assert_allclose(actual, expected, rtol=2e-9)    # rounding of ten squares
    assert told.tail(40.0) == 0.0


def test_telegraph_in_white_noise_is_a_hidden_markov_chain():
    h = sensorid.hypothesis("white_noise", sigma_v=0.5, bias_sigma=0.0)
    y = np.random.default_rng(2).standard_normal(10)
    scene = Scene(y, DT, {})
    h = member(scene, h, "random_telegraph")
    dwell, size = 4.0, 1.5
    change = 0.5 * (1.0 - np.exp(-2.0 * DT / dwell))
    total = 0.0
    for path in itertools.product((0, 1), repeat=10):    # every history of the level
        path = np.array(path)
        flips = np.count_nonzero(np.diff(path))
        total += (0.5 * change**flips * (1 - change)**(9 - flips)
                  * norm.pdf(y, (path - 0.5) * size, 0.5).prod())
    p = filters.predict(h, scene, (), np.array([[0.5, dwell, size]]))
    assert_allclose(p.log_likelihood[0, 0], np.log(total), rtol=1e-10)


@pytest.mark.parametrize("variant", [
    "digital", large("second order"), large("digital first order")])
@pytest.mark.parametrize("name, own", [("random_telegraph", (4.0, 1.5)),
                                       ("noise_bursts", (7.0, 3.0, 1.5))])
def test_a_level_beside_states_whose_noises_are_correlated(name, own, variant):
    scene = Scene(np.random.default_rng(2).standard_normal(100), DT, {})
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=1.0)).with_effect(
        CATALOGUE["bandwidth"], variant).with_effect(CATALOGUE[name])
    one = filters.log_likelihoods(h, scene, (), np.array([[1.0, DT, *own]]))
    # with more states than are unrolled, of which some do nothing
    for _ in range(3):
        h = h.with_effect(CATALOGUE["correlated_noise"])
    still = 3 * (5.0, 1e-12)
    assert_allclose(one, filters.log_likelihoods(
        h, scene, (), np.array([[1.0, DT, *own, *still]])), rtol=1e-8)


def test_bursts_of_noise_in_white_noise_are_a_hidden_markov_chain():
    h = sensorid.hypothesis("white_noise", sigma_v=0.5, bias_sigma=0.0)
    y = np.random.default_rng(2).standard_normal(10)
    y[4] = np.nan
    scene = Scene(y, DT, {})
    h, quiet, duration, sigma = member(scene, h, "noise_bursts"), 7.0, 3.0, 1.5
    begin, end = 1.0 - np.exp(-DT / quiet), 1.0 - np.exp(-DT / duration)
    paths, chance = naive.histories(begin, end, 10)
    assert_allclose(chance.sum(), 1.0)
    law = np.where(np.isnan(y), 1.0, norm.pdf(y, 0.0, np.sqrt(
        0.25 + paths * sigma**2))).prod(1)
    p = filters.predict(h, scene, (), np.array([[0.5, quiet, duration, sigma]]))
    assert_allclose(p.log_likelihood[0, 0], np.log(chance @ law), rtol=1e-10)
    loud = mixtures.smoothed(p.second[0, 0], begin, end)
    assert_allclose(loud, (chance * law) @ paths / (chance @ law), rtol=1e-9)
    # the predictive law of the last sample, from all others
    first = np.where(np.isnan(y), 1.0, norm.pdf(y, 0.0, np.sqrt(
        0.25 + paths * sigma**2)))[:, :9].prod(1)
    cdf = norm.cdf(y[9], 0.0, np.sqrt(0.25 + paths[:, 9] * sigma**2))
    assert_allclose(norm.cdf(p.z[0, 0, 9]), (chance * first) @ cdf / (chance @ first),
                    rtol=1e-9)


def dense_gaussian(h, theta, y):
    """Log density of what is known of a record (N,) under a hypothesis at theta (p,),
    and its covariance^-1 times the record.
    """
    f, seen, N = h.filter(DT, theta), ~np.isnan(y), len(y)
    C = h.bias_sigma**2 + naive.covariance(f.Phi[0], f.Gamma, f.H,
                                           f.Psi * np.ones((N, 1)), f.P0, N)
    C, y = C[np.ix_(seen, seen)], y[seen]
    return multivariate_normal(cov=C).logpdf(y), np.linalg.solve(C, y)


@pytest.mark.large
@pytest.mark.parametrize("variant", [
    "second order", "digital", "digital first order", "exponential"])
@pytest.mark.parametrize("more", [
    (), ("narrow_band_noise",), ("correlated_noise", "narrow_band_noise")])
def test_processes_of_two_states_are_those_of_the_dense_gaussian(more, variant):
    y = np.random.default_rng(2).standard_normal(60)
    y[20:25] = np.nan
    scene = Scene(y, DT, {}, rounding=0.01)    # a low-pass leaves less
    h = member(scene, MODEL[1], "narrow_band_noise", *more).with_effect(
        CATALOGUE["bandwidth"], variant)
    # no two bands are alike
    theta = np.array([p.quantile(0.9 - 0.05 * k) for k, p in enumerate(h.parameters)]
                     )[None]
    expected, residual = dense_gaussian(h, theta[0], y)
    assert_allclose(filters.predict(h, scene, (), theta).log_likelihood, expected,
                    rtol=1e-9)
    assert_allclose(filters.log_likelihoods(h, scene, (), theta), expected, rtol=1e-9)
    assert_allclose(backward.solve(h, scene, (), theta).residual[0, ~np.isnan(y)],
                    residual, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("change, own", [
    ("noise_step", dict(onset=15.0, ratio=ratio)) for ratio in (0.3, 1.25, 5.0)] + [
    ("noise_ramp", dict(ratio=4.0)), ("walk_step", dict(onset=15.0, ratio=5.0))])
@pytest.mark.parametrize("tau", [0.1, 0.25, 1.0])
@pytest.mark.parametrize("variant", CATALOGUE["bandwidth"].variants)
def test_what_is_low_passed_and_changes_is_the_dense_gaussian(variant, tau, change,
                                                              own):
    y = np.random.default_rng(2).standard_normal(60)
    y[20:23] = np.nan
    scene = Scene(y, DT, {}, rounding=0.01)    # a low-pass leaves less
    h = member(scene, MODEL[0], change).with_effect(CATALOGUE["bandwidth"], variant)
    at = dict(sigma_w=0.05, sigma_v=0.5, tau=tau, **own)
    theta = np.array([[at.get(symbol, p.low) for (_, symbol), p in zip(
        h.keys, h.parameters)]])
    expected, residual = dense_gaussian(h, theta[0], y)
    assert_allclose(filters.predict(h, scene, (), theta).log_likelihood, expected,
                    rtol=1e-6)
    assert_allclose(filters.log_likelihoods(h, scene, (), theta), expected, rtol=1e-6)
    assert_allclose(backward.solve(h, scene, (), theta).residual[0, ~np.isnan(y)],
                    residual, rtol=1e-4, atol=1e-6 * np.abs(residual).max())


@pytest.mark.parametrize("variant", CATALOGUE["bandwidth"].variants)
def test_what_is_low_passed_may_change_its_variance(variant):
    scene = Scene(np.random.default_rng(2).standard_normal(60), DT, {})
    h = member(scene, MODEL[1], "noise_step").with_effect(CATALOGUE["bandwidth"],
                                                          variant)
    theta = np.array([p.mean for p in h.parameters])[None]
    assert parts.processes(h, scene, theta).a.shape[0] == 1
    assert np.isfinite(filters.log_likelihoods(h, scene, (), theta)).all()


def test_the_axes_of_a_process_of_two_states_do_not_matter():
    y = np.random.default_rng(2).standard_normal((2, 60))
    y[:, 20:25] = np.nan
    r, outlier = np.array([[0.3], [0.2]]), np.array([[0.05, 9.0]] * 2)
    jump = np.array([[0.1, 0.2, 0.7, 0.4, 0.8, 0.0]] * 2)
    band = sensorid.shaping_filter(*np.array([
        [[0.6, -0.7], [0.7, 0.6]], [[0.5, 0.1], [0.0, 0.4]]]), [1.0, 0.0], 0.0, None,
        [[1.0, 0.2], [0.2, 0.8]])
    said = []
    for axes in (np.eye(2), np.array([[1.0, 0.4], [-0.8, 0.7]])):
        back = np.linalg.inv(axes)
        turned = sensorid.shaping_filter(axes @ band.Phi[0] @ back,
                                         axes @ band.Gamma[0], band.H[0] @ back, 0.0,
                                         None, axes @ band.P0 @ axes.T)
        h = sensorid.hypothesis(lambda dt: join(turned, (0.9, 0.4, 1.0)), "turned")
        one = parts.parts_of(h, sensorid.bank(h, DT, np.empty((2, 0))))
        assert_array_equal(one.pair, [1, 0, 2])
        one.own[10, :, 2] = 1.0    # it steps
        out = np.full((2, 2, 5, 60), np.nan)
        total = mixtures.mixture_filters(y, np.tile(one.h, (60, 1)), one.own, one.pair,
                                        one.rise, r, outlier, jump, out)
        said.append((total, out, *adjoint.adjoint(
            np.nan_to_num(y), 1.0 - np.isnan(y[0]), one.h, one.own, one.pair, one.rise,
            r)))
    for one, other in zip(*said):
        assert_allclose(one, other, rtol=1e-9, atol=1e-11)


def test_a_filter_that_is_no_sum_of_processes_has_no_modes():
    ramp = sensorid.hypothesis("rate_ramp", slope=1.0, sigma_v=1.0)
    assert parts.equivalent_modes(sensorid.bank(ramp, DT, np.array([[1.0, 1.0]]))
                                  ) is None

    def from_rest(dt, sigma_m):    # turns, but is not yet as wide as it will be
        return sensorid.shaping_filter([[0.5, -0.5], [0.5, 0.5]], [[sigma_m], [0.0]],
                                       [1.0, 0.0])
    h = sensorid.hypothesis(from_rest, sigma_m=1.0)
    assert parts.equivalent_modes(sensorid.bank(h, DT, np.array([[1.0]]))) is None


def test_telegraph_on_a_walk_is_close_to_the_sum_over_all_histories():
    h = sensorid.hypothesis("random_walk", sigma_w=0.1, sigma_v=0.3, bias_sigma=0.5)
    dwell, size, n = 5.0, 2.0, 10
    change = 0.5 * (1.0 - np.exp(-2.0 * DT / dwell))
    paths = np.array(list(itertools.product((0, 1), repeat=n)))
    flips = np.count_nonzero(np.diff(paths, axis=1), axis=1)
    prior = 0.5 * change**flips * (1 - change)**(n - 1 - flips)
    t = np.arange(1, n + 1)
    C = 0.01 * np.minimum.outer(t, t) + 0.09 * np.eye(n) + 0.25
    law = multivariate_normal(cov=C)
    rng, errors = np.random.default_rng(4), []
    for path in paths[rng.choice(len(paths), 60, p=prior)]:
        y = law.rvs(random_state=rng) + (path - 0.5) * size
        exact = np.log(prior @ law.pdf(y - (paths - 0.5) * size))
        scene = Scene(y, DT, {})
        own = member(scene, h, "random_telegraph")
        p = filters.predict(own, scene, (), np.array([[0.1, 0.3, dwell, size]]))
        errors.append(p.log_likelihood[0, 0] - exact)
    # one Gaussian a level instead of one a history: half a nat for a change of level
    changes = n * change
    assert abs(np.mean(errors)) < 0.5 * changes and np.std(errors) < 1.0


@pytest.mark.large
def test_steps_on_a_walk_are_close_to_the_sum_over_all_histories():
    h = sensorid.hypothesis("random_walk", sigma_w=0.1, sigma_v=0.3, bias_sigma=0.5)
    dwell, sigma, n = 5.0, 2.0, 10
    begin = 1.0 - np.exp(-DT / dwell)
    paths = np.array(list(itertools.product((0, 1), repeat=n)))
    prior = (begin**paths * (1.0 - begin)**(1 - paths)).prod(1)
    t = np.arange(1, n + 1)
    walk = 0.01 * np.minimum.outer(t, t) + 0.09 * np.eye(n) + 0.25
    below = np.tri(n)
    laws = [multivariate_normal(cov=walk + sigma**2 * (below * path) @ below.T)
            for path in paths]
    rng, errors = np.random.default_rng(4), []
    for k in rng.choice(len(paths), 60, p=prior):
        y = laws[k].rvs(random_state=rng)
        exact = np.log(prior @ [law.pdf(y) for law in laws])
        own = member(Scene(y, DT, {}), h, "random_steps")
        p = filters.predict(own, own.scene, (), np.array([[0.1, 0.3, dwell, sigma]]))
        errors.append(p.log_likelihood[0, 0] - exact)
    assert abs(np.mean(errors)) < 0.2 and np.std(errors) < 0.5


@pytest.mark.parametrize("form", [
    "digital", large("digital first order"), large("exponential")])
@pytest.mark.parametrize("effect", ["outliers", "noise_bursts"])
def test_noise_before_a_low_pass_is_as_the_sum_over_all_histories(form, effect):
    n, bias_sigma, tau = 10, 0.05, 1.0
    tau_m, sigma_m, sigma_v = markov = 10.0, 0.2, 0.3
    L, t = through_low_pass(form, tau, 80), np.arange(80)    # of noise that has gone on
    noise = (L @ (sigma_v**2 * np.eye(80) + sigma_m**2 * np.exp(
        -abs(np.subtract.outer(t, t)) / tau_m)) @ L.T)[-n:, -n:] + bias_sigma**2
    if effect == "outliers":
        rate, sigma = 0.1, 4.0
        paths = np.array(list(itertools.product((0, 1), repeat=n)))
        prior, values = (rate**paths * (1.0 - rate)**(1 - paths)).prod(1), (rate, sigma)
    else:
        quiet, duration, sigma = values = 8.0, 5.0, 1.5
        paths, prior = naive.histories(*-np.expm1([-DT / quiet, -DT / duration]), n)
    laws = [multivariate_normal(cov=noise + sigma**2 * (L[:n, :n] * path) @ L[:n, :n].T)
            for path in paths]
    h = sensorid.hypothesis("markov", tau_m=tau_m, sigma_m=sigma_m, sigma_v=sigma_v,
                            bias_sigma=bias_sigma)
    theta, errors, gains = np.array([[*markov, tau, *values]]), [], []
    rng = np.random.default_rng(4)
    for k in rng.choice(len(paths), 40, p=prior):
        y = laws[k].rvs(random_state=rng)
        own = member(Scene(y, DT, {}), h).with_effect(
            CATALOGUE["bandwidth"], form).with_effect(
            CATALOGUE[effect], "before the low-pass")
        exact = np.log(prior @ [law.pdf(y) for law in laws])
        errors.append(filters.log_likelihoods(own, own.scene, (), theta)[0] - exact)
        gains.append(exact - laws[0].logpdf(y))    # the first has none
    assert abs(np.mean(errors)) < 0.2 and np.std(errors) < 0.5 < np.mean(gains)


@pytest.mark.parametrize("when", ["after the onset", "before the onset"])
@pytest.mark.parametrize("form", ["digital", "digital first order", "exponential"])
def test_noise_that_changes_passes_what_a_process_passes(form, when):
    """The likelihood is that of a dense covariance."""
    n, bias_sigma, tau, first, ratio = 30, 0.5, 1.0, 12, 3.0
    tau_m, sigma_m, sigma_v = markov = 10.0, 0.2, 0.3
    L, number = through_low_pass(form, tau, 100), np.arange(100) - (100 - n)
    loud = (number >= first) == (when == "after the onset")
    law = multivariate_normal(cov=bias_sigma**2 + (L @ (
        np.diag(sigma_v**2 * np.where(loud, ratio**2, 1.0)) + sigma_m**2 * np.exp(
            -abs(np.subtract.outer(number, number)) / tau_m)) @ L.T)[-n:, -n:])
    h = sensorid.hypothesis("markov", tau_m=tau_m, sigma_m=sigma_m, sigma_v=sigma_v,
                            bias_sigma=bias_sigma)
    for y in law.rvs(3, random_state=np.random.default_rng(5)):
        own = member(Scene(y, DT, {}), h).with_effect(
            CATALOGUE["bandwidth"], form).with_effect(CATALOGUE["noise_step"], when)
        assert [one.variant for one in own.effects] == [form, when]
        told = filters.log_likelihoods(own, own.scene, (), np.array([[
            *markov, tau, first * DT, ratio]]))
        assert told[0] == pytest.approx(law.logpdf(y), abs=1e-6)


@pytest.mark.parametrize("form", [
    "digital", large("digital first order"), large("exponential")])
@pytest.mark.parametrize("effect", ["random_telegraph", "random_steps"])
def test_a_level_passes_a_low_pass_as_the_sum_over_all_histories_does(form, effect):
    n, bias_sigma, sigma_v, tau, dwell, size = 10, 0.05, 0.3, 1.0, 5.0, 2.0
    L = through_low_pass(form, tau, 80)    # of noise that has gone on for long
    noise = sigma_v**2 * (L @ L.T)[-n:, -n:] + bias_sigma**2
    if effect == "random_telegraph":
        change = 0.5 * (1.0 - np.exp(-2.0 * DT / dwell))
        paths, prior = naive.histories(change, change, n + 1)
        level = (paths - 0.5) * size
        rest = level[:, :1]    # before the first sample
        mean = rest + (level[:, 1:] - rest) @ L[:n, :n].T
        one = multivariate_normal(cov=noise)
        off, apart = 0.05, 0.2

        def drawn(k):
            return mean[k] + one.rvs(random_state=rng)

        def density(y):
            return prior @ one.pdf(y - mean)
    else:
        begin = 1.0 - np.exp(-DT / dwell)
        paths = np.array(list(itertools.product((0, 1), repeat=n)))
        prior = (begin**paths * (1.0 - begin)**(1 - paths)).prod(1)
        below = L[:n, :n] @ np.tri(n)
        laws = [multivariate_normal(cov=noise + size**2 * (below * path) @ below.T)
                for path in paths]
        off, apart = 0.2, 0.5

        def drawn(k):
            return laws[k].rvs(random_state=rng)

        def density(y):
            return prior @ [law.pdf(y) for law in laws]
    h = sensorid.hypothesis("white_noise", sigma_v=sigma_v, bias_sigma=bias_sigma)
    theta, errors = np.array([[sigma_v, tau, dwell, size]]), []
    rng = np.random.default_rng(4)
    for k in rng.choice(len(paths), 40, p=prior):
        y = drawn(k)
        own = member(Scene(y, DT, {}), h).with_effect(
            CATALOGUE["bandwidth"], form).with_effect(CATALOGUE[effect])
        errors.append(filters.log_likelihoods(own, own.scene, (), theta)[0]
                      - np.log(density(y)))
    assert abs(np.mean(errors)) < off and np.std(errors) < apart, errors


def with_every_age(y, dwell, sigma):
    """Log-likelihood of a level with steps in white noise of 1, with one Gaussian for
    every time of the last step; all of them together are the next one to step.
    """
    p, total = -np.expm1(-1.0 / dwell), 0.0
    mean, variance, weight = np.zeros(1), np.zeros(1), np.ones(1)
    for value in y:
        both = weight @ mean
        spread = weight @ (variance + (mean - both)**2) + sigma**2
        mean, variance, weight = (np.append(mean, both), np.append(variance, spread),
                                  np.append(weight * (1 - p), p))
        f, e = variance + 1.0, value - mean
        own = weight * norm.pdf(e, 0.0, np.sqrt(f))
        total += np.log(own.sum())
        mean, variance, weight = (mean + variance / f * e, variance / f,
                                  own / own.sum())
        kept = (weight > 1e-9) | (np.arange(len(weight)) > len(weight) - 9)
        mean, variance, weight = mean[kept], variance[kept], weight[kept]
    return total


@pytest.mark.parametrize("sigma", [0.7, 1.5, 5.0])
def test_steps_that_one_sample_does_not_prove_are_seen_later(sigma):
    rng, n, dwell = np.random.default_rng(7), 1500, 100.0
    y = rng.standard_normal(n) + np.cumsum((rng.random(n) < 1.0 / dwell) * (
        sigma * rng.standard_normal(n)))
    own = member(Scene(y, 1.0, {}), sensorid.hypothesis("white_noise", sigma_v=1.0),
                 "random_steps")
    theta = np.array([[1.0, dwell, sigma], [1.0, 2.0 * dwell, sigma]])
    told = filters.log_likelihoods(own, own.scene, (), theta)
    exact = [with_every_age(y, *row[1:]) for row in theta]
    assert_allclose(told, exact, atol=1.2)
    assert_allclose(told[1] - told[0], exact[1] - exact[0], atol=0.6)


def with_every_switch(y, size, dwell, bias):
    """Log densities (N,) of samples of telegraph noise in white noise of 1 with a bias
    of this standard deviation, with one Gaussian for each level and every time of the
    last switch; all of them of a level together are the next one to switch.
    """
    change, result = -0.5 * np.expm1(-2.0 / dwell), []
    mean, variance = np.zeros(2), np.full(2, bias**2)
    weight, level = np.full(2, 0.5), np.arange(2)
    for i, value in enumerate(y):
        parts = [(mean, variance, weight * (1.0 - change), level)]
        for own in range(2):
            w, at = weight * (level == own), level == own
            share = w / w.sum()
            both = share @ mean
            spread = share @ (variance + (mean - both)**2)
            parts.append(([both], [spread], [w.sum() * change], [1 - own]))
            assert at.any()
        mean, variance, weight, level = map(np.concatenate, zip(*parts))
        f, e = variance + 1.0, value - mean - (level - 0.5) * size
        own = weight * norm.pdf(e, 0.0, np.sqrt(f))
        result.append(np.log(own.sum()))
        mean, variance = mean + variance / f * e, variance / f
        weight = np.maximum(own / own.sum(), 1e-200)
        kept = (weight > 1e-8) | (np.arange(len(weight)) > len(weight) - 25)
        mean, variance, weight, level = (part[kept] for part in (
            mean, variance, weight, level))
    return np.array(result)


@pytest.mark.parametrize("size, dwell, seed", [(2.5, 300.0, 0), (1.0, 300.0, 0),
                                               (5.0, 300.0, 4), (1.0, 50.0, 1)])
def test_telegraph_is_known_as_well_where_the_bias_is_not(size, dwell, seed):
    rng, n, bias = np.random.default_rng([seed, 5]), 3000, 3.0
    switch = rng.random(n) < -0.5 * np.expm1(-2.0 / dwell)
    level = (np.cumsum(switch) + rng.integers(2)) % 2 - 0.5
    y = rng.standard_normal(n) + size * level + bias * rng.standard_normal()
    h = sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=bias)
    own = member(Scene(y, 1.0, {}), h, "random_telegraph")
    seen = filters.predict(own, own.scene, (), np.array([[1.0, dwell, size]]))
    exact = with_every_switch(y, size, dwell, bias)
    assert abs(seen.log_likelihood[0, 0] - exact.sum()) < 1.0
    assert_allclose(seen.log_score[0, 0].sum(), seen.log_likelihood[0, 0], rtol=1e-9)
    assert np.quantile(abs(seen.log_score[0, 0] - exact), 0.99) < 0.2


def test_records_that_begin_at_either_level_are_told_of_alike(monkeypatch):
    y = np.random.default_rng(8).standard_normal((3, 60)) + 2.0 * (
        np.arange(60) // 20 % 2)
    y[:, 7] = np.nan
    h = sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=3.0)
    own = member(Scene(y[0], 1.0, {}), h, "random_telegraph")
    theta = np.array([[1.0, 30.0, 2.0], [1.0, 20.0, 1.0]])
    whole = filters.predict(own, own.scene, (), theta, y)
    monkeypatch.setattr(mixtures, "AT_ONCE", 1)
    for one in (filters.predict(own, own.scene, (), theta, y),
                filters.predict(own, own.scene, (), theta, y, whole=False)):
        assert_array_equal(one.z, whole.z)
        assert_array_equal(one.log_likelihood, whole.log_likelihood)
    assert_allclose(np.nansum(whole.log_score, axis=2), whole.log_likelihood,
                    rtol=1e-12)
    assert_allclose(filters.log_likelihoods(own, own.scene, (), theta),
                    whole.log_likelihood[0], rtol=1e-12)


def test_a_long_record_tells_by_its_head_at_which_level_it_begins():
    rng, n = np.random.default_rng(3), 5 * mixtures.HEAD
    level = np.cumsum(rng.random(n) < 0.005) % 2
    theta = np.array([[1.0, 200.0, 2.0], [1.0, 100.0, 1.8], [1.0, 5e3, 0.1]])
    h = sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=3.0)
    own = member(Scene(rng.standard_normal(n) + 2.0 * level, 1.0, {}), h,
                 "random_telegraph")
    assert_allclose(filters.log_likelihoods(own, own.scene, (), theta),
                    filters.predict(own, own.scene, (), theta).log_likelihood[0],
                    rtol=1e-10)


def test_long_records_are_told_of_as_by_filters_of_either_level(monkeypatch):
    rng, n = np.random.default_rng(5), 5 * mixtures.HEAD
    level = np.cumsum(rng.random((3, n)) < 0.005, axis=1) % 2
    level[1] = 1 - level[1]
    y = rng.standard_normal((3, n)) + [[2.0], [2.0], [0.1]] * level
    y[:, [7, 5000]] = np.nan
    h = sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=3.0)
    own = member(Scene(y[0], 1.0, {}), h, "random_telegraph")
    theta = np.array([[1.0, 200.0, 2.0], [1.0, 100.0, 1.8], [1.0, 150.0, 2.1]])
    filtered = []
    monkeypatch.setattr(mixtures, "_told_of_begins", lambda y, *rest, own=(
        mixtures._told_of_begins): filtered.append(len(y)) or own(y, *rest))
    for whole in True, False:
        by_head = filters.predict(own, own.scene, (), theta, y, whole)
        assert filtered.pop() == 1    # the last has no level that its head shows
        with monkeypatch.context() as m:
            m.setattr(mixtures, "SURE_NATS", np.inf)
            by_both = filters.predict(own, own.scene, (), theta, y, whole)
        assert filtered.pop() == 3
        for one, other in zip(by_head[:4 if whole else 2], by_both):
            assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_backward_pass_gives_every_step_and_every_weighted_sum(short):
    scene, h, theta, C, seen = short
    solved = backward.solve(h, scene, (), theta)
    inverse = np.zeros((200, 200))
    inverse[np.ix_(seen, seen)] = np.linalg.inv(C[np.ix_(seen, seen)])
    y = np.where(seen, scene.y, 0.0)
    assert_allclose(solved.residual[0], inverse @ y, atol=1e-9)
    onsets = signatures.Family(CATALOGUE["bias_step"], "")
    found = scans.scores(scene, onsets, solved)
    for onset in (1, 2, 3, 30, 55, 150, 197, 198, 199):
        s = (np.arange(200) >= onset).astype(float)
        J = s @ inverse @ s
        # with few samples on a side it is no step
        gain = (s @ inverse @ y)**2 / J if MIN_PULSE <= onset <= 200 - MIN_PULSE else 0
        assert_allclose(found.gain[0, onset - 1], gain, rtol=1e-7)
        assert_allclose(found.size[0, onset - 1], s @ inverse @ y / J, rtol=1e-7)
        assert_allclose(found.sd[0, onset - 1], J**-0.5, rtol=1e-7)


def test_products_of_rows_do_not_depend_on_how_they_are_shared_out():
    rng = np.random.default_rng(4)
    rows, columns = rng.standard_normal((5, 5001)), rng.standard_normal((7, 5001))
    whole = arithmetic.row_products(rows, columns)
    assert_allclose(whole, rows @ columns.T, atol=1e-11)
    one_by_one = [arithmetic.row_products(row[None], columns)[0] for row in rows]
    assert_array_equal(whole, one_by_one)
    assert_allclose(arithmetic.row_products(rows, columns[:2]), whole[:, :2],
                    atol=1e-11)


@pytest.mark.parametrize("name", [None, "correlated_noise"])
def test_what_records_share_gives_the_likelihoods_of_each(name):
    y = sensorid.simulate(MODEL[1:], DT, 400, 3, seed=4).error
    y[:, 100:120] = np.nan
    scene = Scene(y[0], DT, {})
    h = member(scene, MODEL[1], *([name] if name else []))
    count = len(sensorid.free_columns(h.parameters))
    theta = sensorid.at_quantiles(h.parameters, np.random.default_rng(5).uniform(
        0.2, 0.8, (4, count)))
    t = np.arange(400)
    signatures = [linear.Signature(None, columns, 2.0) for columns in (
        np.column_stack([np.cos(t), np.sin(t)]), (t / 1e4)[:, None])]
    known = linear.shared(h, scene, signatures, theta, np.isnan(y[0]))
    assert_allclose(known.log_likelihoods(y), filters.filtered(
        h, scene, signatures, theta, y), rtol=1e-11)
