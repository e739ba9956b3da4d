"""Evidence by sampling against grids, quadrature and sums."""

import generator
import naive
import numpy as np
import pytest
from conftest import DT, MODEL, member
from numpy.testing import assert_allclose
from scipy.signal import butter, lfilter
from scipy.special import logsumexp, ndtri
from scipy.stats import multivariate_normal

import sensorid
from sensorlab import Scene
from sensorlab.gap import account, changes, evidence, filters, screens
from sensorlab.gap.catalogue import CATALOGUE, MIN_SIDE


@pytest.mark.large
@pytest.mark.parametrize("k", [0, 1])
def test_importance_sampling_finds_the_evidence_of_the_grid(k):
    y = sensorid.simulate(MODEL[k:k + 1], DT, 1000, seed=8).error[0]
    scene = Scene(y, DT, {})
    for h in MODEL:
        exact = sensorid.identify(y, DT, [h]).estimates[0]
        h, errors = member(scene, h), []
        for seed in range(8):
            s = evidence.integrate(
                lambda theta, h=h: filters.log_likelihoods(
                    h, scene, (), theta)[:, None],
                h.parameters, seed=seed)
            errors.append(s.log_evidence[0] - exact.log_evidence)
            assert_allclose(s.weight @ s.theta, exact.mean,
                            atol=0.6 * np.sqrt(np.diag(exact.covariance)).max())
        assert abs(np.mean(errors)) < 0.1 and np.std(errors) < 0.2


def test_importance_sampling_of_a_sharp_correlated_gaussian():
    parameters = tuple(sensorid.Parameter(s, 0.0, 1.0) for s in "abc")
    C = 1e-4 * np.array([[1.0, 0.8, 0.0], [0.8, 1.0, 0.3], [0.0, 0.3, 1.0]])
    law = multivariate_normal([0.3, 0.6, 0.5], C)
    s = evidence.integrate(lambda theta: law.logpdf(theta).reshape(-1, 1), parameters)
    assert abs(s.log_evidence[0]) < 0.25    # the prior is 1 over the unit cube
    assert_allclose(s.weight @ s.theta, [0.3, 0.6, 0.5], atol=0.004)


def test_a_guess_of_a_far_sharper_posterior_needs_few_points():
    """As of a long record: a guess too wide, and off by some of its own widths."""
    parameters = tuple(sensorid.Parameter(s, 0.0, 1.0) for s in "abcd")
    law = multivariate_normal([0.3, 0.6, 0.5, 0.8], 1e-8)
    asked = []

    def log_likelihood(theta):
        asked.append(len(theta))
        return law.logpdf(theta).reshape(-1, 1)
    at = ndtri(law.mean)
    guess = at + 4e-4 * np.array([1.0, -1.0, 1.0, -1.0]), np.diag(np.full(4, 2e-7))
    s = evidence.integrate(log_likelihood, parameters, [guess], effort=0.25)
    assert abs(s.log_evidence[0]) < 0.6 and sum(asked) < 400
    del asked[:]    # a rival that is better than its peak can ever be
    evidence.integrate(log_likelihood, parameters, [guess], floor=60.0, effort=0.25)
    assert len(asked) == 1


def test_what_a_guess_says_nothing_of_is_sought_before_all_is_hopeless():
    """The points of a guess that has one parameter as in its prior miss a sharp law."""
    parameters = tuple(sensorid.Parameter(s, 0.0, 1.0) for s in "abcd")
    law = multivariate_normal([0.3, 0.6, 0.5, 0.8], 1e-6)

    def log_likelihood(theta):
        return law.logpdf(theta).reshape(-1, 1)
    at, width = np.append(ndtri(law.mean[:3]), 0.0), np.append(np.full(3, 1e-5), 1.0)
    s = evidence.integrate(log_likelihood, parameters, [(at, np.diag(width))],
                           floor=-4.0)
    assert abs(s.log_evidence[0]) < 0.6


def test_a_climb_finds_mode_and_covariance_of_a_gaussian():
    C = np.array([[0.04, 0.03, 0.0], [0.03, 0.05, 0.001], [0.0, 0.001, 1e-4]])
    law = multivariate_normal([0.5, -1.0, 2.0], C)
    mode, cov = evidence.climb(law.logpdf, np.array([-2.0, 2.0, 0.0]))
    assert_allclose(mode, law.mean, atol=1e-6)
    assert_allclose(cov, C, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("factor, taken", [(1.0, False), (1.3, False), (100.0, True)])
def test_a_climb_takes_no_curvature_where_a_law_is_right(factor, taken):
    d, asked = 12, []
    root = np.random.default_rng(2).uniform(0.02, 0.05, (d, d))
    C = root @ root.T + np.diag(np.linspace(0.01, 0.1, d))**2
    law = multivariate_normal(np.linspace(-1.0, 1.0, d), C)

    def log_posterior(x):
        asked.append(len(x))
        return law.logpdf(x)
    start = law.mean + 2.0 * np.linalg.cholesky(C)[:, 0]
    mode, cov = evidence.climb(log_posterior, start, law=(start, factor * C))
    assert law.logpdf(mode) > law.logpdf(law.mean) - 0.2
    assert_allclose(cov, C if taken else factor * C, rtol=1e-4, atol=1e-7)
    assert (max(asked) > 1 + 2 * d) is taken


def stepped(effect, n=300):
    """White noise that doubles at sample 120, or halves, or a walk that is driven ten
    times as much from there on, on a bias; scene and hypothesis with all but the onset
    known.
    """
    if effect == "walk_step":
        rng = np.random.default_rng(3)
        walk = np.cumsum(rng.standard_normal(n) * np.where(np.arange(n) < 120, 0.2, 2.0)
                         )
        scene = Scene(0.7 + walk + rng.standard_normal(n), DT, {})
        h = member(scene, sensorid.hypothesis("random_walk", sigma_w=0.2, sigma_v=1.0),
                   effect)
        return scene, h.fixed({(effect, "ratio"): 10.0})
    noise, early = np.random.default_rng(3).standard_normal(n), np.arange(n) < 120
    scene = Scene(0.7 + noise * np.where(early == bool(effect), 2.0, 1.0), DT, {})
    h = sensorid.hypothesis("random_walk", sigma_w=0.05, sigma_v=1.0)
    h = member(scene, h).with_effect(CATALOGUE["noise_step"], effect)
    return scene, h.fixed({("noise_step", "ratio"): 2.0})


CHANGES = pytest.mark.parametrize("effect", ["", "before the onset", "walk_step"])


@pytest.mark.large
@CHANGES
def test_onsets_are_drawn_from_their_law(effect):
    scene, h = stepped(effect)
    u = (np.arange(4000) + 0.5) / 4000
    theta, log_ratio = changes.onset_law(h, scene, ())(
        sensorid.at_quantiles(h.parameters, u[:, None]))
    assert abs(np.mean(np.exp(log_ratio)) - 1.0) < 0.01    # prior over law, under it
    weight = np.exp(log_ratio + (ll := filters.log_likelihoods(h, scene, (), theta))
                    - ll.max())
    assert weight.sum()**2 / (weight @ weight) > 2000    # nearly the posterior itself


@CHANGES
def test_evidence_of_an_unknown_onset_is_the_sum_over_all(effect):
    scene, h = stepped(effect)
    known = [p.low for p in h.parameters]
    every = np.array([[*known[:2], (i + 0.5) * DT, known[3]]
                      for i in range(MIN_SIDE, len(scene.y) - MIN_SIDE)])
    exact = logsumexp(filters.log_likelihoods(h, scene, (), every)) - np.log(
        len(every))
    s = evidence.integrate(
        lambda theta: filters.log_likelihoods(h, scene, (), theta)[:, None],
        h.parameters, move=changes.onset_law(h, scene, ()))
    assert abs(s.log_evidence[0] - exact) < 0.1


@pytest.mark.parametrize("form", ["digital", "digital first order", "second order"])
@pytest.mark.parametrize("ratio", [0.35, 0.6, 1.3, 3.0])
def test_onsets_behind_a_low_pass_are_drawn_where_their_mass_is(ratio, form):
    """Where it is as if loud, what is stopped at half the rate is long remembered."""
    w = np.random.default_rng(5).standard_normal(3000)
    w[1700:] *= ratio
    order = 1 if "first" in form else 2
    scene = Scene(lfilter(*butter(order, 0.4), w), DT, {})
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=1.0)).with_effect(
        CATALOGUE["bandwidth"], form).with_effect(CATALOGUE["noise_step"])
    tau = DT / (2.0 * np.tan(0.2 * np.pi))    # of the bilinear transform
    h = h.fixed({("noise_step", "ratio"): ratio, (h.effects[0].key, "tau"): tau})
    onset, theta = h.keys.index(h.onsets[0]), np.array([p.low for p in h.parameters])
    every = np.tile(theta, (len(w) - 2 * MIN_SIDE, 1))
    every[:, onset] = DT * (np.arange(MIN_SIDE, len(w) - MIN_SIDE) + 0.5)
    exact = logsumexp(filters.log_likelihoods(h, scene, (), every)) - np.log(len(every))
    u = (np.arange(400) + 0.5) / 400
    drawn, log_ratio = changes.onset_law(h, scene, ())(
        sensorid.at_quantiles(h.parameters, u[:, None]))
    weight = filters.log_likelihoods(h, scene, (), drawn) + log_ratio
    assert abs(logsumexp(weight) - np.log(len(u)) - exact) < 0.3


@pytest.mark.large
def test_evidence_of_an_unknown_onset_does_not_hang_on_the_seed():
    made = generator.record(77, 208, ["noise_step"], 2)
    h = member(Scene(made["error"] - made["error"].mean(), DT, {}), MODEL[0],
               "noise_step")
    law = changes.onset_law(h, h.scene, ())
    said = [evidence.integrate(
        lambda theta: filters.log_likelihoods(h, h.scene, (), theta)[:, None],
        h.parameters, move=law, seed=seed).log_evidence[0] for seed in range(12)]
    assert np.ptp(said) < 2.0


@pytest.mark.parametrize("broken_from", [0, 90])
def test_an_onset_is_drawn_where_a_filter_breaks_down(broken_from):
    samples, nodes = 200, 40
    gain = np.where(np.arange(samples) < broken_from, 0.0, -np.inf)
    peak = gain[::changes.ONSET_BIN]
    for u in sensorid.middles(nodes):
        onset, density = changes._draw_onset(gain, peak, u)
        assert 0.0 < onset <= samples and np.isfinite(density)
        assert u < changes.STRAY_SHARE or onset <= (broken_from or samples)
    y, one = np.random.default_rng(0).standard_normal(samples), np.ones((2, nodes))
    decays = np.zeros((2, 10, nodes, 1))
    decays[:, 0], decays[:, 2] = 0.5, 0.1
    r = one * [[1.0], [-0.1]]    # its variances are negative
    onset, density = changes.draw_onsets(
        y, np.ones(1), decays, np.zeros(1, int), 0.0 * one[..., None], r, 25.0 * one,
        sensorid.middles(nodes), 8, 150)
    assert ((8 < onset) & (onset <= 150)).all() and np.isfinite(density).all()


def test_a_screen_of_bursts_is_the_sum_over_all_histories():
    rng = np.random.default_rng(4)
    first, second = rng.standard_normal((2, 9))
    begin, end = np.array([0.1, 0.4]), np.array([0.3, 0.2])
    told, gain = np.empty((2, 9)), np.zeros(2)
    screens._sum_histories(first, second, begin, end, told, gain)
    for k in range(2):
        paths, chance = naive.histories(begin[k], end[k], 9)
        law = np.exp(np.where(paths, second, first).sum(1))
        assert_allclose(gain[k], np.log(chance @ law))
        assert_allclose(told[k, -1], (chance * law) @ paths[:, -1] / (chance @ law))


@pytest.mark.large
@pytest.mark.parametrize("number, effects", [
    (1194, ["random_telegraph"]), (1, ["random_telegraph"]),
    (5, ["correlated_noise", "outliers"]), (6, ["outliers", "random_telegraph"])])
def test_importance_sampling_finds_the_mode(number, effects):
    """The true parameters cannot be more likely than the likeliest node."""
    r = generator.record(2026, number, effects, level=3)
    scene = Scene(r["error"], DT, {})
    (h,) = [h for h in MODEL if h.name == r["base"]]
    h = member(scene, h, *effects)
    truth = {("", symbol): value for symbol, value in r["parameters"].items()}
    truth |= {(e, symbol): value for e in effects
              for symbol, value in r["truth"][e].items()}
    theta = np.array([[truth[key] for key in h.keys]])
    acc = account.account(scene, [h])
    assert acc.peak > filters.log_likelihoods(h, scene, (), theta)[0]
    assert acc.samples[0].log_evidence[0] > acc.peak - 25.0    # not one point alone


def test_the_error_of_an_evidence_is_its_spread_over_seeds():
    def log_likelihood(theta):
        return -0.5 * ((theta - 0.3) / 0.02)**2
    parameters = (sensorid.Parameter("a", 0.0, 1.0),)
    samples = [evidence.integrate(log_likelihood, parameters, seed=seed)
               for seed in range(40)]
    spread = np.std([s.log_evidence[0] for s in samples])
    told = np.mean([s.error[0] for s in samples])
    assert 0.4 < spread / told < 1.6 and spread < 0.2


def test_points_are_drawn_where_one_parameter_is_known_a_million_times_as_well():
    cov, rng = np.diag([1.0, 1e-14]), np.random.default_rng(0)
    x, log_density = evidence._drawn(np.array([0.5, 2.0]), cov, 1000, rng)
    assert np.abs(x[:, 1] - 2.0).max() < 1e-4
    # in two dimensions the peak of Student's law is that of the normal one
    wide = np.prod(np.sqrt(1.2 * np.diag(cov) + 1e-12))
    assert abs(log_density(np.array([[0.5, 2.0]]))[0] + np.log(
        2.0 * np.pi * wide)) < 1e-4
