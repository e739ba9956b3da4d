import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from conftest import large, paper_case
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import multivariate_normal

import naive
import sensorid as s

THETA = {
    "random_walk": [(0.1, 0.5), (0.04, 0.25), (0.3, 0.0)],
    "markov": [(30.0, 1.0, 0.5), (400.0, 1.5, 0.0), (2.0, 0.5, 0.9)],
}


def log_likelihoods(h, theta, dt, y, stops, bias_sigma=1.0):
    """(stops, C, M) from the module."""
    bank = s.bank(h, dt, np.array(theta))
    return np.array([s.log_likelihood(1.0, u.count, u.chi2, u.score, u.information,
                                      u.log_det, (0.0, bias_sigma**2))
                     for u in s.filter_bank(bank, y, stops)])


def make(name, theta, bias_sigma=1.0):
    symbols = dict(random_walk=("sigma_w", "sigma_v"),
                   markov=("tau_m", "sigma_m", "sigma_v"))
    return s.hypothesis(name, bias_sigma=bias_sigma, **dict(zip(symbols[name], theta)))


@pytest.mark.parametrize("name", THETA)
@pytest.mark.parametrize("records", [1, 40])
def test_bank_equals_the_naive_two_state_filter(name, records):
    h = make(name, THETA[name][0])
    y = s.simulate([h], 0.5, 300, records, seed=1).error
    y[:, 100:107] = np.nan
    stops = [1, 2, 50, 103, 300]
    actual = log_likelihoods(h, THETA[name], 0.5, y, stops)
    for record in range(0, records, 13):
        for column, theta in enumerate(THETA[name]):
            node = naive.Node(theta, *getattr(naive, name)(theta, 0.5, 1.0))
            expected = []
            for i, sample in enumerate(y[record], 1):
                node.step(sample)
                if i in stops:
                    expected.append(node.log_likelihood)
            assert_allclose(actual[:, record, column], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", THETA)
def test_bank_equals_the_dense_gaussian(name):
    h = make(name, THETA[name][0])
    y = s.simulate([h], 1.0, 60, 3, seed=2).error
    actual = log_likelihoods(h, THETA[name], 1.0, y, [60])[0]
    for column, theta in enumerate(THETA[name]):
        C = naive.covariance(*getattr(naive, name)(theta, 1.0, 1.0), 60)
        assert_allclose(actual[:, column], multivariate_normal(cov=C).logpdf(y),
                        rtol=1e-9)


@pytest.mark.parametrize("states", [1, 2])
def test_products_of_pairs_are_those_of_the_dense_covariance(states):
    def process(dt, tau_m, sigma_m, sigma_v):    # the second state is idle
        m = s.markov(dt, tau_m, sigma_m, sigma_v)
        return m if states == 1 else s.shaping_filter(
            np.diag([m.Phi[0, 0, 0], 0.0]), [[m.Gamma[0, 0, 0]], [0.0]], [1.0, 0.0],
            sigma_v, P0=np.diag([sigma_m**2, 0.0]))
    n, pairs = 200, [(0, 1), (2, 0), (2, 2)]
    y, t = np.random.default_rng(8).standard_normal((3, n)), np.arange(n)
    y[:, 50:55] = np.nan
    seen = ~np.isnan(y[0])
    h = s.hypothesis(process, tau_m=30.0, sigma_m=1.0, sigma_v=0.5)
    b = s.bank(h, 1.0, np.array(THETA["markov"])[[0, 2]])
    sums = list(s.filter_bank(b, y, [100, n], pairs))[-1]
    for node, (tau, sigma_m, sigma_v) in enumerate(
            np.array(THETA["markov"])[[0, 2]]):
        C = sigma_m**2 * np.exp(-abs(t[:, None] - t) / tau) + sigma_v**2 * np.eye(n)
        per_C = np.linalg.inv(C[np.ix_(seen, seen)])
        expected = y[:, seen] @ per_C @ y[:, seen].T
        assert_allclose(sums.products[:, node], [expected[i, j] for i, j in pairs],
                        rtol=1e-9, atol=1e-9)


def test_bank_equals_statsmodels():
    from statsmodels.tsa.statespace.mlemodel import MLEModel
    theta = 30.0, 1.0, 0.5
    Phi, Gamma, H, Psi, P0 = naive.markov(theta, 1.0, 1.0)
    y = s.simulate([make("markov", theta)], 1.0, 2000, 1, seed=3).error
    model = MLEModel(y[0], k_states=2, k_posdef=1, transition=Phi, selection=Gamma,
                     design=H, state_cov=np.eye(1), obs_cov=Psi**2)
    model.initialize_known(np.zeros(2), Phi @ P0 @ Phi.T + Gamma @ Gamma.T)
    model.ssm.tolerance = 0
    actual = log_likelihoods(make("markov", theta), [theta], 1.0, y, [2000])
    assert_allclose(actual[0, 0, 0], model.loglike([]), rtol=1e-9)


def test_general_kernel_equals_the_dense_gaussian():
    h = s.hypothesis("two_markov", tau_m=20.0, sigma_m=1.0, tau_n=3.0, sigma_n=0.5,
                     sigma_v=0.2)
    theta = [p.low for p in h.parameters]
    f = h.model(1.0, *theta)
    y = s.simulate([h], 1.0, 50, 5, seed=4).error
    y[:, 20:24] = np.nan
    seen = ~np.isnan(y[0])
    C = 1.0 + naive.covariance(f.Phi[0], f.Gamma[0], f.H, f.Psi[:, None], f.P0, 50)
    expected = multivariate_normal(cov=C[np.ix_(seen, seen)]).logpdf(y[:, seen])
    assert_allclose(log_likelihoods(h, [theta], 1.0, y, [9, 50])[1, :, 0], expected,
                    rtol=1e-9)


def test_general_kernel_follows_matrices_that_vary_with_time():
    rng = np.random.default_rng(5)
    n = 30
    Phi, Gamma = rng.uniform(-0.5, 0.9, (n, 2, 2)), rng.uniform(0.1, 1, (n, 2, 1))
    H, Psi, m0, P0 = (rng.normal(size=(n, 2)), rng.uniform(0.2, 1, n), [1.0, -2.0],
                      np.diag([1, 2.0]))
    h = s.hypothesis(lambda dt: s.shaping_filter(Phi, Gamma, H, Psi, m0, P0),
                     name="moving")
    y = s.simulate([h], 1.0, n, 2, seed=6).error
    actual = log_likelihoods(h, np.empty((1, 0)), 1.0, y, [7, n])[-1]
    for record in range(2):
        # the bias last
        x, P, total = np.array([*m0, 0.0]), np.diag([1.0, 2.0, 1.0]), 0.0
        for i in range(n):
            F, G, h_i = (np.eye(3), np.vstack([Gamma[i], [[0.0]]]),
                         np.array([*H[i], 1.0]))
            F[:2, :2] = Phi[i]
            x, P = F @ x, F @ P @ F.T + G @ G.T
            f, nu = h_i @ P @ h_i + Psi[i]**2, y[record, i] - h_i @ x
            x, P = x + P @ h_i * nu / f, P - np.outer(P @ h_i, P @ h_i) / f
            total -= 0.5 * (np.log(2 * np.pi * f) + nu**2 / f)
        assert_allclose(actual[record, 0], total, rtol=1e-9)


def test_the_kernels_agree_also_after_gains_have_converged():
    h = make("markov", (30.0, 1.0, 0.5))
    theta = [(30.0, 1.0, 0.5), (5.0, 0.5, 0.7)]
    y = s.simulate([h], 1.0, 20001, 1, seed=7).error
    record = log_likelihoods(h, theta, 1.0, y, [15000, 20001])
    trials = log_likelihoods(h, theta, 1.0, np.repeat(y, 2, 0), [15000, 20001])[:, :1]
    assert_allclose(record, trials, rtol=1e-11)

    def general(dt, tau_m, sigma_m, sigma_v):    # an idle second state
        m = s.markov(dt, tau_m, sigma_m, sigma_v)
        return s.shaping_filter(np.diag([m.Phi[0, 0, 0], 0.0]),
                                [[m.Gamma[0, 0, 0]], [0.0]], [1.0, 0.0], sigma_v,
                                P0=np.diag([sigma_m**2, 0.0]))

    g = s.hypothesis(general, tau_m=30.0, sigma_m=1.0, sigma_v=0.5)
    assert_allclose(log_likelihoods(g, theta, 1.0, y, [15000, 20001]), record,
                    rtol=1e-11)


@pytest.mark.large
def test_results_are_the_same_bits_for_any_stops_trials_and_threads(tmp_path):
    h = paper_case(3)[1]
    g = s.grid(h, 0.1, 9)
    y = s.simulate(paper_case(3), 0.1, 700, 70, seed=8).error
    bank = s.bank(h, 0.1, g.theta)
    whole = list(s.filter_bank(bank, y, [128, 384, 700]))[-1]
    part = next(s.filter_bank(bank, y[40:45], [700]))
    assert_array_equal(whole.information, part.information)
    assert_array_equal(part.chi2, next(s.filter_bank(bank, y, [700])).chi2[40:45])
    assert_allclose(whole.chi2[40:45], part.chi2, rtol=1e-13)
    code = ("import numpy as np, sensorid as s, conftest\n"
            "h = conftest.paper_case(3)\n"
            "y = s.simulate(h, 0.1, 700, 70, seed=8).error\n"
            "g = s.grid(h[1], 0.1, 9)\n"
            "u = next(s.filter_bank(s.bank(h[1], 0.1, g.theta), y, [700]))\n"
            f"np.save({str(tmp_path / 'one.npy')!r}, u.chi2)\n")
    subprocess.run([sys.executable, "-c", code], check=True,
                   cwd=os.path.dirname(__file__),
                   env={**os.environ, "NUMBA_NUM_THREADS": "1"})
    assert_array_equal(np.load(tmp_path / "one.npy"),
                       next(s.filter_bank(bank, y, [700])).chi2)


def test_kernels_run_as_plain_python():
    code = ("import numpy as np, sensorid as s\n"
            "h = s.hypothesis('markov', tau_m=(6, 50), sigma_m=(0.5, 1.5), "
            "sigma_v=(0.25, 1))\n"
            "y = s.simulate([h], 1.0, 20, 1, seed=1).error[0]\n"
            "g = s.grid(h, 1.0, 3)\n"
            "u = next(s.filter_bank(s.bank(h, 1.0, g.theta), y[None], [20]))\n"
            "print(repr(u.chi2[0, 4]))\n")
    outputs = [subprocess.run([sys.executable, "-c", code], check=True,
                              capture_output=True, text=True,
                              env={**os.environ, "NUMBA_DISABLE_JIT": flag}).stdout
               for flag in "01"]
    numbers = [float(text.strip().removeprefix("np.float64(").rstrip(")"))
               for text in outputs]
    assert_allclose(*numbers, rtol=1e-12)


def test_wrong_stops_and_ragged_gaps_are_refused():
    bank = s.bank(make("random_walk", (0.1, 0.5)), 1.0, np.array([(0.1, 0.5)]))
    with pytest.raises(ValueError, match=r"stops \[3, 2\] do not increase within 1..5"):
        s.filter_bank(bank, np.zeros((1, 5)), [3, 2])
    y = np.zeros((2, 5))
    y[1, 3] = np.nan
    with pytest.raises(ValueError, match="missing in some records only"):
        s.filter_bank(bank, y, [5])


def test_processes_abreast_equal_the_general_filter():
    rng = np.random.default_rng(6)
    y = rng.standard_normal((3, 300)).cumsum(1)
    y[:, 40:55] = np.nan
    h = s.hypothesis("two_markov", tau_m=(60.0, 1500.0), sigma_m=(0.5, 1.5),
                            tau_n=(1.0, 60.0), sigma_n=(0.1, 1.0), sigma_v=(0.25, 1.0))
    theta = np.column_stack([rng.uniform(p.low, p.high, 50) for p in h.parameters])
    b = s.bank(h, 1.0, theta)
    b = b._replace(r=b.r * rng.uniform(0.5, 2.0, 300))    # the noise may vary in time
    assert s.modes(b) is not None
    # states of which one hardly turns into the other go through the general filter
    general = b._replace(Phi=b.Phi + [[0.0, 1e-30], [0.0, 0.0]])
    assert s.modes(general) is None
    for one, two in zip(s.filter_bank(b, y, [100, 300]),
                        s.filter_bank(general, y, [100, 300])):
        for part, other in zip(one, two):
            assert_allclose(part, other, rtol=1e-10)


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("n", [2, large(3), large(5), 6])
def test_unrolled_loops_do_what_a_dense_covariance_does(monkeypatch, n, mixed):
    rng = np.random.default_rng(n)
    Phi = np.diag(rng.uniform(0.3, 0.95, n))
    for k in range(0, n - 1 if mixed else 0, 2):    # pairs of states that turn
        Phi[k:k + 2, k:k + 2] = 0.9 * np.array([[0.8, 0.6], [-0.6, 0.8]])
    G, H, P0 = np.diag(rng.uniform(0.1, 0.5, n)), rng.uniform(0.5, 1.0, n), np.diag(
        rng.uniform(0.5, 2.0, n))
    G, P0 = G + 0.05 * mixed, P0 + 0.1 * mixed
    h = s.hypothesis(lambda dt: s.shaping_filter(Phi, G, H, 0.7, P0=P0), name="sum")
    y, pairs, N = rng.standard_normal((3, 1203)), [(0, 1), (2, 0)], 131
    y[:, 50:55] = np.nan
    b = s.bank(h, 1.0, np.empty((20, 0)))
    (few,) = s.filter_bank(b, y[:, :N], [N], pairs)
    seen = ~np.isnan(y[0, :N])
    C = naive.covariance(Phi, G, H[None], np.array([[0.7]]), P0, N)[np.ix_(seen, seen)]
    expected = y[:, :N][:, seen] @ np.linalg.solve(C, y[:, :N][:, seen].T)
    assert_allclose(few.chi2, np.repeat(expected.diagonal()[:, None], 20, 1), rtol=1e-9)
    assert_allclose(few.products[:, 7], [expected[one] for one in pairs], rtol=1e-9)
    assert_allclose(few.log_det[19], np.linalg.slogdet(C)[1], rtol=1e-9)
    ones = np.linalg.solve(C, np.ones(len(C)))
    assert_allclose(few.information, ones.sum(), rtol=1e-9)
    assert_allclose(few.score[:, 0], y[:, :N][:, seen] @ ones, rtol=1e-9)
    many = list(s.filter_bank(b, y, [701, 1203], pairs))
    for nodes in (1, 3):    # of few nodes, records have places of their own
        few = s.Bank(*(part[:nodes] for part in b))
        assert s._may_spread(few, 3, 2) or n > 4 and nodes > 1
        for one, other in zip(many, s.filter_bank(few, y, [701, 1203], pairs)):
            for part, its in zip(one[1:], other[1:]):
                assert_allclose(part[..., :nodes], its, rtol=1e-9)
    for most in ("UNROLLED", "UNROLLED_CHAIN"):
        monkeypatch.setattr(s, most, 0)
    for one, other in zip(many, s.filter_bank(b, y, [701, 1203], pairs)):
        for part, its in zip(one, other):
            assert_allclose(part, its, rtol=1e-10)


@pytest.mark.parametrize("n, mixed", [
    (1, False), (2, True), large(5, False), large(6, True)])
@pytest.mark.parametrize("stops", [[900], [333, 900]])
def test_noise_that_changes_seldom_does_what_a_dense_covariance_does(n, mixed, stops):
    rng = np.random.default_rng(n)
    Phi = np.diag(rng.uniform(0.3, 0.95, n))
    if mixed:
        Phi[:2, :2] = 0.9 * np.array([[0.8, 0.6], [-0.6, 0.8]])
    G, H, P0 = np.diag(rng.uniform(0.1, 0.5, n)), np.ones(n), np.diag(
        rng.uniform(0.5, 2.0, n))
    h = s.hypothesis(lambda dt: s.shaping_filter(Phi, G, H, 0.7, P0=P0), name="sum")
    y, b = rng.standard_normal((2, 900)), s.bank(h, 1.0, np.empty((3, 0)))
    y[:, 400:431] = np.nan
    later = np.arange(900) >= np.array([[401], [333], [898]])    # no whole handfuls
    b = b._replace(r=b.r * np.where(later, 3.0, 1.0))
    *_, sums = s.filter_bank(b, y, stops, [(0, 1)])
    *_, alone = s.filter_bank(b, y[:1], stops)
    *_, abreast = s.filter_bank(b, np.repeat(y, 40, 0), stops)
    seen = ~np.isnan(y[0])
    own, even = y[:, seen], naive.covariance(Phi, G, H[None], np.zeros((1, 1)), P0, 900)
    for node in range(3):
        C = (even + np.diag(b.r[node]))[np.ix_(seen, seen)]
        expected, ones = own @ np.linalg.solve(C, own.T), np.linalg.solve(
            C, np.ones(len(C)))
        assert_allclose(sums.chi2[:, node], expected.diagonal(), rtol=1e-9)
        assert_allclose(sums.products[0, node], expected[0, 1], rtol=1e-8)
        assert_allclose(sums.score[:, node], own @ ones, rtol=1e-8)
        assert_allclose(sums.information[node], ones.sum(), rtol=1e-9)
        assert_allclose(sums.log_det[node], np.linalg.slogdet(C)[1], rtol=1e-9)
        for other in (alone, abreast):
            for part in ("chi2", "score"):
                assert_allclose(getattr(other, part)[[0, -1], node], getattr(
                    sums, part)[[0, -1 if other is abreast else 0], node], rtol=1e-8)
            assert_allclose(other.log_det, sums.log_det, rtol=1e-9)


@pytest.mark.parametrize("first", [1, 2, large(3)])
@pytest.mark.parametrize("stops", [[900], [300, 900]])
def test_noise_that_changes_in_the_first_samples_alone(first, stops):
    psi = np.full(900, 0.5)
    psi[:first] = 2.0 + np.arange(first)
    h = s.hypothesis(lambda dt: s.shaping_filter(
        [[0.9]], [[0.3]], [1.0], psi, P0=[[1.0]]), "start")
    y = np.random.default_rng(1).standard_normal((1, 900))
    *_, sums = s.filter_bank(s.bank(h, 1.0, np.empty((1, 0))), y, stops)
    one = np.ones((1, 1))
    C = np.diag(psi**2) + naive.covariance(
        0.9 * one, 0.3 * one, one, 0.0 * one, one, 900)
    assert_allclose(sums.chi2[0, 0], y[0] @ np.linalg.solve(C, y[0]), rtol=1e-9)
    assert_allclose(sums.log_det[0], np.linalg.slogdet(C)[1], rtol=1e-9)


def test_matrices_for_fewer_samples_than_a_record_are_refused():
    h = s.hypothesis(lambda dt: s.shaping_filter([[0.9]], [[0.3]], [1.0], np.linspace(
        0.5, 1.0, 20)), "short")
    with pytest.raises(ValueError, match="matrices for 20 samples, the record has 400"):
        next(s.filter_bank(s.bank(h, 1.0, np.empty((1, 0))), np.ones((1, 400)), [400]))


@pytest.mark.parametrize("name", ["white_noise", "random_walk", "markov",
                                  "random_walk_markov", "two_markov"])
def test_a_bank_of_all_nodes_at_once_equals_its_filters(name):
    (h,) = s.default_hypotheses(np.arange(50.0)**2, 0.1, [name])
    theta = s.at_quantiles(h.parameters, np.random.default_rng(1).random((7, 5))[
        :, :len(h.parameters)])
    b = s.bank(h, 0.1, theta)
    for node, row in enumerate(theta):
        filt = h.filter(0.1, row)
        expected = s.shaping_filter(*filt)    # the shapes are those it checks
        Q = expected.Gamma @ expected.Gamma.swapaxes(1, 2)
        for part, one in zip(b, (expected.Phi, Q, expected.H, expected.Psi**2,
                                 expected.m0, expected.P0)):
            assert_allclose(part[node], one, rtol=1e-13)


def test_a_bank_is_the_same_after_it_has_filtered():
    theta = np.tile([0.1, 0.5], (s.GROUP, 1))
    b = s.bank(s.hypothesis("random_walk", sigma_w=0.1, sigma_v=0.5), 1.0,
                      theta)
    b = b._replace(r=np.tile(b.r, (1, 50)), P0=b.P0 + 1.0)
    before = [part.copy() for part in b]
    next(s.filter_bank(b, np.ones((1, 50)), [50]))
    for part, other in zip(b, before):
        assert_array_equal(part, other)


@pytest.mark.parametrize("own, expected", [({}, "passive"), (
    {"OMP_WAIT_POLICY": "active"}, "active")])
def test_a_copied_module_waits_passively_unless_told_otherwise(tmp_path, own, expected):
    shutil.copy(s.__file__, tmp_path)
    env = {k: v for k, v in os.environ.items() if k != "OMP_WAIT_POLICY"}
    done = subprocess.run([sys.executable, "-c", "import sensorid, os; "
                           "print(os.environ['OMP_WAIT_POLICY'])"], cwd=tmp_path,
                          env={**env, **own}, capture_output=True, text=True)
    assert done.stdout.strip() == expected, done.stderr


def test_states_end_at_zero_where_a_record_does():
    # 0.9^2560 is 1e-117: on the way to what processors are slow with
    a, n = 0.9, 20 * s.TILE
    y = np.zeros((1, n, s.LANES))
    y[0, 0] = 1.0
    node = np.zeros((1, 4, s.GROUP))
    node[0, 0], node[0, 2] = a, 1.0
    state = np.zeros((1, 1, 1, 3 * s.LANES))
    state[..., :s.LANES] = 1.0
    s._advance_trials(y.reshape(1, -1), np.ones(n), -1, node,
                      np.zeros((1, 4, s.GROUP)), state)
    assert not state[..., :s.LANES].any()
    x = np.ones((1, 2, 1, s.GROUP))
    part = np.zeros((1, 1, s.GROUP))
    node = part[:, :, None]    # of one state
    s._advance_abreast(np.zeros((2, n)), np.ones(n), 0, s.NO_PAIRS,
                       np.array([[0, 0]]), np.zeros((1, 1, s.GROUP), int),
                       node[:, :, None] + a, node[:, :, None],
                       node + 1.0, [np.array([0])], part + 1.0, x, node.copy(),
                       np.zeros((1, 2, 2, s.GROUP)), np.zeros((1, 0, s.GROUP)))
    assert not x[:, 0].any()    # of ones: no more, once their innovation is constant


def test_little_work_wakes_no_second_thread(monkeypatch):
    asked = []
    monkeypatch.setattr(s, "get_num_threads", lambda: 2)
    monkeypatch.setattr(s, "set_num_threads", asked.append)
    b = s.bank(make("markov", THETA["markov"][0]), 1.0, np.array(THETA["markov"]))
    many = s.SMALL // 8 + 1
    for records, stops, expected in ((1, [50, 100], [1, 2, 1, 2]), (8, [many], [2, 2]),
                                     (8, [many - 1, many], [1, 2, 1, 2])):
        asked.clear()
        for _ in s.filter_bank(b, np.zeros((records, stops[-1])), stops):
            assert asked[-1] == 2    # whoever goes on here has all of them
        assert asked == expected


@pytest.mark.parametrize("theta", [[0.1, 0.5], [[0.1]], 0.1])
def test_a_bank_is_of_nodes_with_all_parameters(theta):
    h = s.hypothesis("random_walk", sigma_w=(0.04, 0.15), sigma_v=(0.25, 1.0))
    with pytest.raises(ValueError, match=r"\(M, 2\) is needed"):
        s.bank(h, 0.1, theta)
