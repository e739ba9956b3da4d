"""The other algorithms against closed forms, statsmodels and published numbers."""

import numpy as np
import pytest
from conftest import paper_case, same
from numpy.testing import assert_allclose
from scipy.stats import binom, chi2
from statsmodels.tsa.statespace.structural import UnobservedComponents

import sensorid as s
from sensorlab import rivals


def test_lines_of_fixed_slope_give_the_published_parameters_of_navchip(real):
    """SMAC-Group/avar, example of the NavChip: one model for three axes."""
    f = np.load(real / "smac_allan_curves.npz")
    tau, adev = f["navchip_tau"], f["navchip_adev"]
    for axes, octaves, slope, factor, published in (
            (slice(0, 3), (1, 4), -1.0, 3**-0.5, 7.208553e-06),
            (slice(0, 3), (6, 8), -0.5, 1.0, 5.945877e-05),
            (slice(0, 3), (10, 13), 0.5, 3**0.5, 3.062325e-05),
            (slice(3, 6), (1, 6), -0.5, 1.0, 5.233402e-04),
            (slice(3, 6), (14, 16), 0.5, 3**0.5, 6.422082e-05)):
        part = slice(octaves[0] - 1, octaves[1])
        values = [rivals.allan_line(tau[part], row[part], slope) for row in adev[axes]]
        assert_allclose(factor * np.prod(values)**(1 / 3), published, rtol=1e-6)


def test_least_squares_find_the_published_parameters_of_navchip(real):
    """Its lines are unweighted means; least squares favour the first octaves, where
    the curve is no line: ten and twenty per cent."""
    f = np.load(real / "smac_allan_curves.npz")
    dt = 1.0 / float(f["navchip_fs"])
    h = s.hypothesis("random_walk", prior="log", sigma_w=(1e-8, 1e-2),
                     sigma_v=(1e-6, 1.0))
    part = np.r_[0:6, 13:16]    # the octaves of the published lines
    n = int(f["navchip_n"])
    fits = [rivals.fit_allan_variance(h, dt, f["navchip_tau"][part], row[part]**2, n)[0]
            for row in f["navchip_adev"][3:]]
    sigma_w, sigma_v = np.exp(np.mean(np.log(fits), axis=0))
    assert_allclose(sigma_v * np.sqrt(dt), 5.233402e-04, rtol=0.1)
    assert_allclose(sigma_w / np.sqrt(dt), 6.422082e-05, rtol=0.2)


def test_least_squares_of_adis16405_are_those_of_its_published_curve(real):
    run, f = np.load(real / "adis16405_run1.npz"), np.load(
        real / "smac_allan_curves.npz")
    y = run["gyro_counts"][0] * float(run["gyro_lsb"])
    tau = f["adis_tau"][:10]
    ours = [s.allan_variance(y, 0.01, round(t / 0.01)) for t in tau]
    h = s.hypothesis("random_walk", prior="log", sigma_w=(1e-8, 1.0),
                     sigma_v=(1e-6, 1e2))
    one, two = (rivals.fit_allan_variance(h, 0.01, tau, avar, len(y))[0]
                for avar in (ours, f["adis_adev"][0, :10]**2))
    assert_allclose(one, two, rtol=1e-3)


def test_least_squares_of_one_variance_have_their_closed_form():
    h = s.hypothesis("random_walk", sigma_w=(1e-3, 1.0))
    m = 2**np.arange(8)
    c = (2 * m**2 + 1) / (6 * m)    # of a unit walk
    avar = 0.04 * c * np.random.default_rng(1).uniform(0.5, 2.0, 8)
    freedom = np.maximum((1000 - 2 * m + 1) / (2 * m), 1.0)
    # of the model, the variance of an Allan variance is proportional to c^2 / freedom
    expected = np.sum(freedom * avar / c) / np.sum(freedom)
    (sigma_w,), _ = rivals.fit_allan_variance(h, 1.0, m, avar, 1000)
    assert_allclose(sigma_w**2, expected, rtol=1e-5)


def test_whittle_likelihood_of_a_walk_is_that_of_white_differences():
    h = s.hypothesis("random_walk", sigma_w=(0.01, 1.0))
    y = s.simulate([h], 1.0, 1001, seed=2).error[0]
    power = np.abs(np.fft.fft(np.diff(y)))[1:500]**2 / 1000
    _, ((sigma_w,),) = rivals.whittle(y, 1.0, (h,))
    assert_allclose(sigma_w, np.sqrt(power.mean()), atol=1e-3)


def test_whittle_sees_no_walk_in_white_noise():
    H = (s.hypothesis("white_noise", sigma_v=(0.1, 2.0)),
         s.hypothesis("random_walk", sigma_w=(0.0, 1.0), sigma_v=(0.1, 2.0)))
    y = s.simulate(H[:1], 1.0, 4000, 40, seed=5).error
    walks = sum(rivals.whittle(row, 1.0, H)[0] for row in y)
    # AIC: twice the gain is chi2 of one parameter, at its lower end half of the time
    assert walks <= binom.ppf(0.999, 40, 0.5 * chi2.sf(2.0, 1))


def test_whittle_likelihood_is_of_whole_records():
    y = np.random.default_rng(0).normal(size=50)
    y[7] = np.nan
    with pytest.raises(ValueError, match="without missing samples"):
        rivals.whittle(y, 1.0, (s.hypothesis("white_noise", sigma_v=(0.5, 2.0)),))


def test_fixed_hypotheses_have_nothing_to_estimate():
    H = (s.hypothesis("white_noise", sigma_v=1.0),
         s.hypothesis("random_walk", sigma_w=0.5, sigma_v=1.0))
    c = s.criteria(H, 1.0, 200.0, 32, algorithms=rivals.ALGORITHMS)
    assert all(r.error_probability[-1] < 0.5 for r in c.rivals.values())
    assert rivals.estimation_bound(H[0], 1.0, [10.0])[0].shape == (1, 0)


def test_maximum_likelihood_near_a_bound_is_not_on_it():
    h = s.hypothesis("random_walk", sigma_w=(0.04, 0.15))
    near = s.hypothesis("random_walk", sigma_w=0.148)
    for y in s.simulate([near], 0.1, 20000, 10, seed=6).error:
        step = np.diff(y)
        for algorithm in (rivals.akaike, rivals.whittle):
            _, ((sigma_w,),) = algorithm(y, 0.1, (h,))
            assert_allclose(sigma_w, min(np.sqrt(np.mean(step**2)), 0.15), atol=5e-5)


def test_maximum_likelihood_is_that_of_statsmodels():
    h = s.hypothesis("random_walk", bias_sigma=1e3, sigma_w=(0.01, 1.0),
                     sigma_v=(0.1, 2.0))
    true = s.hypothesis("random_walk", sigma_w=0.1, sigma_v=0.5)
    y = s.simulate([true], 1.0, 2000, seed=3).error[0]
    fit = UnobservedComponents(y, "local level").fit(disp=False)
    expected = np.sqrt(fit.params)[::-1]    # of the level, irregular
    _, (estimate,) = rivals.akaike(y, 1.0, (h,))
    assert_allclose(estimate, expected, atol=2e-3)


def test_slopes_name_white_noise_and_lean_the_right_way_otherwise():
    H = (s.hypothesis("white_noise", sigma_v=(0.1, 2.0)),
         s.hypothesis("random_walk", sigma_w=(0.01, 1.0), sigma_v=(0.1, 2.0)),
         s.hypothesis("markov", tau_m=(5.0, 500.0), sigma_m=(0.5, 3.0),
                      sigma_v=(0.1, 2.0)))
    chosen = np.zeros((3, 3))
    for k, model, parameters in (
            (0, "white_noise", {}), (1, "random_walk", dict(sigma_w=0.1)),
            (2, "markov", dict(tau_m=100.0, sigma_m=1.0))):
        truth = s.hypothesis(model, sigma_v=1.0, **parameters)
        for y in s.simulate([truth], 1.0, 4000, 60, seed=4).error:
            choice, estimates = rivals.allan_slopes(y, 1.0, H)
            chosen[k, choice] += 1
            assert abs(estimates[k][-1] - 1.0) < 0.3    # sigma_v
    assert chosen[0, 0] > 50
    assert chosen[1, 1] > chosen[2, 1] + 10
    with pytest.raises(ValueError, match="slopes are known of"):
        rivals.allan_slopes(y, 1.0, [s.hypothesis("rate_ramp", slope=1.0, sigma_v=1.0)])


@pytest.mark.thorough
def test_no_algorithm_beats_the_bayesian_one():
    c = s.criteria(paper_case(3), 1.0, 1000.0, 160, seed=6, times=[250.0, 1000.0],
                   algorithms=rivals.ALGORITHMS)
    for name, r in c.rivals.items():
        assert (r.excess > -3.0 * r.excess_se).all(), name
        for label, efficiency, se in zip(c.labels, r.efficiency, r.efficiency_se):
            assert (efficiency < 1.0 + 3.0 * se).all(), (name, label)
    # the paper: the two processes can hardly be told apart by the Allan variance
    assert c.rivals["slopes"].error_probability[-1] > 0.3


def constant(y, dt, hypotheses):
    """A user's algorithm: the first hypothesis, and the prior."""
    return 0, [np.array([p.mean for p in h.parameters]) for h in hypotheses]


def test_a_users_algorithm_joins_in_a_few_lines(tmp_path):
    H = paper_case(2)

    def run(**options):
        return s.criteria(H, 1.0, 100.0, 400, seed=7, times=[100.0],
                          algorithms=dict(mine=constant), **options)
    c = run(checkpoint=tmp_path)
    mine = c.rivals["mine"]
    truth = s.simulate(H, 1.0, 1, 400, 7)
    assert mine.error_probability[0] == np.mean(truth.hypothesis == 1)
    tau = truth.theta[truth.hypothesis == 1, 0]
    assert_allclose(mine.rsd[c.labels.index("markov.tau_m")][0], np.sqrt(
        np.sum((tau - 780.0)**2) / (len(tau) - 1)) / 780.0, rtol=1e-12)
    same(c, run(checkpoint=tmp_path))
    same(c, s.criteria(H, 1.0, 100.0, 400, seed=7, times=[100.0]))
    with pytest.raises(ValueError, match="compared from 32 samples"):
        s.criteria(H, 1.0, 20.0, 16, algorithms=dict(mine=constant))


@pytest.mark.large
def test_bound_of_the_variance_of_white_noise_has_its_closed_form():
    low, high, n = 0.5, 1.5, 200
    h = s.hypothesis("white_noise", bias_sigma=0.0, sigma_v=(low, high))
    u = np.linspace(0.0, 1.0, 100001)
    best = 0.0
    for power in (0.0, 2.0, 5.0):
        q = u**(1.0 + power) * (1.0 - u)
        information = 2.0 * n / (low + (high - low) * u)**2 * (high - low)**2
        J = np.mean(q * q * information + np.gradient(q, u)**2)
        best = max(best, (high - low) * np.mean(q) / np.sqrt(J))
    bound, se = rivals.estimation_bound(h, 1.0, [n], trials=3000, seed=1)
    assert abs(bound[0, 0] - best) < 4.0 * se[0, 0]
    assert se[0, 0] < 0.06 * best


def test_the_bound_lies_below_the_bayesian_rsd():
    H = paper_case(3)
    c = s.criteria(H, 1.0, 1000.0, 400, seed=8, times=[100.0, 1000.0])
    for h in H:
        bound, se = rivals.estimation_bound(h, 1.0, [100.0, 1000.0], 500, seed=9)
        for column, p in enumerate(h.parameters):
            rsd = c.rsd[c.labels.index(f"{h.name}.{p.symbol}")]
            assert (bound[:, column] < rsd.calculated + 3.0 * np.hypot(
                se[:, column], rsd.calculated_se)).all()
    with pytest.raises(ValueError, match="log-uniform"):
        rivals.estimation_bound(
            s.hypothesis("white_noise", sigma_v=(1, 2), prior="log"), 1.0, [10.0])
    with pytest.raises(ValueError, match="trials 3: whole numbers >= 32"):
        rivals.estimation_bound(H[0], 1.0, [10.0], 3)
