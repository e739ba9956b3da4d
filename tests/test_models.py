import numpy as np
import pytest
from conftest import paper_case
from numpy.testing import assert_allclose, assert_array_equal

import naive
import sensorid as s


@pytest.mark.parametrize("name, theta", [
    ("random_walk", (0.1, 0.5)), ("markov", (20.0, 1.0, 0.5))])
def test_simulated_records_have_the_covariance_of_the_model(name, theta):
    h = s.hypothesis(name, bias_sigma=0.7, **dict(zip(
        dict(random_walk=("sigma_w", "sigma_v"),
             markov=("tau_m", "sigma_m", "sigma_v"))[name], theta)))
    L, n = 20000, 6
    y = s.simulate([h], 1.0, n, L, seed=4).error
    C = naive.covariance(*getattr(naive, name)(theta, 1.0, 0.7), n)
    se = np.sqrt((C**2 + np.outer(np.diag(C), np.diag(C))) / L)
    assert (np.abs(y.T @ y / L - C) < 4.5 * se).all()


def test_a_trial_does_not_depend_on_its_neighbours():
    H = paper_case(3)
    whole = s.simulate(H, 0.1, 50, 8, seed=3)
    part = s.simulate(H, 0.1, 50, 3, seed=3, first=4)
    assert_array_equal(part.error, whole.error[4:7])
    assert_array_equal(part.theta, whole.theta[4:7])


def test_parameters_are_drawn_from_their_ranges_and_hypotheses_equally():
    H = paper_case(3)
    T = s.simulate(H, 1.0, 1, 4000, seed=1)
    assert abs(T.hypothesis.mean() - 0.5) < 4 * 0.5 / np.sqrt(4000)
    for k, h in enumerate(H):
        for column, p in enumerate(h.parameters):
            drawn = T.theta[T.hypothesis == k, column]
            assert p.low <= drawn.min() and drawn.max() <= p.high
            assert abs(drawn.mean() - p.mean) < 4 * p.sd / np.sqrt(len(drawn))


def test_log_prior_has_the_mean_and_sd_of_a_log_uniform_law():
    p = s.Parameter("tau_m", 1.0, 100.0, True)
    x = np.exp(np.linspace(0, np.log(100), 200001))
    assert_allclose([p.mean, p.sd], [x.mean(), x.std()], rtol=1e-4)


def test_a_user_adds_a_time_varying_hypothesis():
    sway = np.sin(np.arange(300) / 20)

    def vibration(dt, sigma_g, sigma_v):
        """White noise of fixed level and a random gain of a known sway."""
        return s.shaping_filter([[1.0]], [[0.0]], sway[:, None], sigma_v,
                                P0=[[sigma_g**2]])

    H = [s.hypothesis(vibration, sigma_g=(0.5, 2.0), sigma_v=(0.1, 1.0)),
         s.hypothesis("white_noise", sigma_v=(0.1, 1.0))]
    T = s.simulate(H, 1.0, 300, 6, seed=2)
    answers = [s.identify(y, 1.0, H).probability.argmax() for y in T.error]
    assert_array_equal(answers, T.hypothesis)


@pytest.mark.thorough
def test_ready_hypotheses_simulate_and_identify_themselves():
    parameters = dict(
        white_noise=dict(sigma_v=(0.3, 3.0)), random_walk=dict(sigma_w=(0.3, 1.0)),
        markov=dict(tau_m=(3.0, 30.0), sigma_m=(5.0, 15.0), sigma_v=(0.01, 0.1)),
        random_walk_markov=dict(sigma_w=(0.5, 2.0), tau_m=(1.0, 3.0),
                                sigma_m=(10.0, 30.0)),
        two_markov=dict(tau_m=(1.0, 2.0), sigma_m=(5.0, 10.0), tau_n=(60.0, 120.0),
                        sigma_n=(50.0, 90.0)),
        rate_ramp=dict(slope=(0.1, 1.0), sigma_v=(0.5, 2.0)))
    assert set(parameters) == set(s.MODELS)
    H = [s.hypothesis(name, **p) for name, p in parameters.items()]
    T = s.simulate(H, 1.0, 400, 8, seed=5)
    answers = [s.identify(y, 1.0, H).probability.argmax() for y in T.error]
    assert len(set(T.hypothesis)) >= 5
    assert_array_equal(answers, T.hypothesis)


@pytest.mark.parametrize("arguments, message", [
    (("walk", dict()), "unknown hypothesis 'walk': known are white_noise"),
    (("random_walk", dict(sigma_w=(0.2, 0.1))),
     r"range \[0.2, 0.1\] .* is upside down"),
    (("random_walk", dict(sigma_v=1.0)), "sigma_w is not given"),
    (("random_walk", dict(sigma_w=1.0, tau=2.0)), "tau is none of them"),
    (("random_walk", dict(sigma_w=-1.0)), "must be >= 0"),
    (("markov", dict(sigma_m=1.0, tau_m=0.0)), "must be > 0"),
    (("random_walk", dict(sigma_w="big")),
     "a number is needed|give a number or a range"),
    (("random_walk", dict(sigma_w=(1, 2, 3))), "give a number or a range"),
    (("random_walk", dict(sigma_w=(0.0, np.inf))), "must be finite"),
    (("random_walk", dict(sigma_w=(0.0, 1.0), prior="log")), "with a log prior"),
    (("random_walk", dict(sigma_w=1.0, prior="flat")), "neither 'uniform' nor 'log'"),
    (("random_walk", dict(sigma_w=1.0, bias_sigma=-1.0)), "bias_sigma = -1.0"),
    (("random_walk", dict(sigma_w=0.0)), "all noises of random_walk are zero"),
    (("rate_ramp", dict(slope=(0.0, 1.0))), "all noises of rate_ramp are zero"),
    (("random_walk", dict(name=1.0, sigma_w=1.0)), "name of a hypothesis is 1.0"),
    ((lambda dt, a: a * dt, dict(a=1.0)), "returns float: it is to return"),
])
def test_a_wrong_hypothesis_is_refused(arguments, message):
    name, parameters = arguments
    with pytest.raises(ValueError, match=message):
        s.hypothesis(name, **parameters)


def test_a_filter_of_wrong_shape_is_refused():
    with pytest.raises(ValueError, match="a shaping filter of n states needs"):
        s.shaping_filter(np.eye(2), np.eye(2), [1.0])
    with pytest.raises(ValueError, match="1 <= n <= 6"):
        s.shaping_filter(np.eye(7), np.eye(7), np.ones(7))


@pytest.mark.parametrize("y, said", [
    ([], "the record has 0 samples"), ([np.nan] * 30, "the record has 0 samples"),
    ([2.0] * 30, "the record is constant")])
def test_no_priors_come_from_what_shows_nothing(y, said):
    with pytest.raises(ValueError, match=said):
        s.default_hypotheses(np.array(y), 1.0)


def test_default_priors_hold_the_truth_of_very_different_sensors():
    for unit in (1e-9, 1.0, 1e5):
        h = s.hypothesis("markov", tau_m=30.0, sigma_m=unit, sigma_v=2.0 * unit,
                         bias_sigma=unit)
        y = s.simulate([h], 0.01, 20000, 1, seed=1).error[0]
        H = s.default_hypotheses(y, 0.01)
        for truth, p in zip((30.0, unit, 2.0 * unit), H[2].parameters):
            assert p.low < truth < p.high
        answer = s.identify(y, 0.01, H)
        assert abs(answer.estimates[2].mean[2] / unit - 2.0) < 0.05


@pytest.mark.parametrize("change, message", [
    (dict(Phi=np.ones((5, 1, 1)), H=np.ones((4, 1))), r"of \[4, 5\] samples"),
    (dict(Phi=[[np.nan]]), "not finite"), (dict(P0=[[-1.0]]), "must be >= 0"),
    (dict(Psi=-1.0), "must be >= 0"), (dict(H=[1.0, 1.0]), "have shapes")])
def test_what_is_no_shaping_filter_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        s.shaping_filter(**dict(Phi=[[1.0]], Gamma=[[0.1]], H=[1.0]) | change)
