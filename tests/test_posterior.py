import numpy as np
import pytest
from conftest import paper_case, thorough
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.stats import kstest

import naive
import sensorid as s
from sensorlab import rivals


def naive_identification(hypotheses, y, dt, nodes):
    """The reference implementation on uniform grids of the paper."""
    banks = []
    for h in hypotheses:
        make = getattr(naive, h.name)
        theta = s.uniform_grid(h, dt, nodes).theta
        if theta.shape[1] < dict(random_walk=2, markov=3)[h.name]:
            theta = np.column_stack([theta, np.zeros(len(theta))])    # no white noise
        banks.append([naive.Node(t, *make(t, dt, h.bias_sigma)) for t in theta])
    answer = naive.Identification(banks)
    for sample in y:
        answer.step(sample)
    return answer


@pytest.mark.parametrize("number", [1, 2, 3])
def test_posterior_on_the_papers_grid_equals_the_reference_implementation(number):
    H = paper_case(number)
    y = s.simulate(H, 1.0, 60, 1, seed=number).error
    expected = naive_identification(H, y[0], 1.0, 4)
    evidences = []
    for k, h in enumerate(H):
        g = s.uniform_grid(h, 1.0, 4)
        p = g.theta.shape[1]
        evidence, mean, cov = next(s.posteriors(g, y, [60]))
        evidences.append(evidence[0])
        naive_mean, naive_cov = expected.parameters(k)
        assert_allclose(mean[0], naive_mean[:p], rtol=1e-9)
        assert_allclose(cov[0], naive_cov[:p, :p], rtol=1e-6, atol=1e-12)
    assert_allclose(s.probabilities(evidences), expected.probability, rtol=1e-9)


def dense(h, dt, Y, nodes):
    """Log evidence and moments on a grid of midpoints in theta: no scale, no zoom."""
    free = [c for c, p in enumerate(h.parameters) if p.free]
    axes = [h.parameters[c].low + (h.parameters[c].high - h.parameters[c].low)
            * (np.arange(nodes) + 0.5) / nodes for c in free]
    z = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(free))
    theta = np.array([p.high for p in h.parameters]) * np.ones((len(z), 1))
    theta[:, free] = z
    u = next(s.filter_bank(s.bank(h, dt, theta), Y, [Y.shape[1]]))
    results = []
    for chi2, score in zip(u.chi2, u.score):
        L = s.log_likelihood(1.0, u.count, chi2, score, u.information, u.log_det,
                             (0.0, h.bias_sigma**2))
        w = np.exp(L - L.max())
        evidence = L.max() + np.log(w.mean())
        w /= w.sum()
        mean = w @ theta
        results.append((evidence, mean, np.sqrt(w @ (theta - mean)**2)))
    return results


@pytest.mark.parametrize("number, samples, nodes", [
    (1, 300, {1: 4000, 2: 400}), (2, 1000, {1: 4000, 2: 250}),
    thorough(3, 1000, {2: 400, 3: 75})])
def test_zoomed_posterior_equals_a_dense_grid(number, samples, nodes):
    H = paper_case(number)
    Y = s.simulate(H, 0.1, samples, 12, seed=20 + number).error
    references = [dense(h, 0.1, Y, nodes[sum(p.free for p in h.parameters)]) for h in H]
    for y, *reference in zip(Y, *references):
        answer = s.identify(y, 0.1, H)
        assert_allclose(answer.probability, s.probabilities([r[0] for r in reference]),
                        atol=0.01)
        best = int(answer.probability.argmax())
        e, (_, mean, sd) = answer.estimates[best], reference[best]
        free = [p.free for p in e.hypothesis.parameters]
        assert (np.abs(e.mean - mean)[free] < 0.1 * sd[free]).all()
        assert_allclose(np.sqrt(np.diag(e.covariance))[free], sd[free], rtol=0.05)
        assert (e.nodes_per_sd >= s.NODES_PER_SD).all()


@pytest.mark.parametrize("count, chi2, score, information", [
    (3, 2.0, 0.5, 0.7), (40, 9.0, 3.0, 20.0), (5000, 1200.0, 11.0, 3.0),
    (200, 900.0, -4.0, 1.0), (200, 2.0, 0.1, 1.0)])
@pytest.mark.parametrize("bias", [(0.0, 1.0), (-3.0, 100.0), (0.2, 0.0)])
def test_scale_integral_equals_adaptive_quadrature(count, chi2, score, information,
                                                   bias):
    low, high, power = np.log(0.25), np.log(1.0), 2.0
    u = np.linspace(low, high, 4001)

    def f(x):
        return power * x + s.log_likelihood(np.exp(2 * x), count, chi2, score,
                                            information, 0.3, bias)

    top = f(u).max()
    peak = u[f(u).argmax()]
    total, first = (quad(lambda x: np.exp(f(x) - top + k * x), low, high, points=[peak],
                         epsabs=0, limit=500)[0] for k in (0, 1))
    mass, mean, _ = s._node_mass(count, np.array([chi2]), np.array([score]),
                                 np.array([[information, 0.3, -1.0, low, high,
                                            np.exp(2.0 * low), np.exp(2.0 * high)]]),
                                 np.array([[[low, high, 0.0]]]), power, bias)
    assert_allclose(mass[0], top + np.log(total) - 1.0, atol=2e-4)
    assert_allclose(mean[0], first / total, rtol=1e-4)


def test_a_record_far_outside_a_range_ends_at_its_edge():
    y = np.random.default_rng(0).normal(size=10**6).cumsum()
    least, most = 0.5, 2.0
    h = s.hypothesis("white_noise", sigma_v=(least, most), bias_sigma=0.0)
    answer = s.identify(y, 1.0, [h])
    chi2 = y @ y / most**2
    slope = (chi2 - len(y)) / most    # of ln f(Y / sigma_v) where the range ends
    wanted = -0.5 * (len(y) * np.log(2.0 * np.pi * most**2) + chi2) - np.log(
        slope * (most - least))
    (e,) = answer.estimates
    assert_allclose(e.mean, most, rtol=1e-8)
    assert e.log_evidence == pytest.approx(wanted, rel=1e-12)
    assert answer.probability == 1.0


def test_point_masses_have_the_moments_of_the_estimate():
    H = paper_case(3)
    y = s.simulate(H, 0.1, 2000, 1, seed=3).error[0]
    for e in s.identify(y, 0.1, H).estimates:
        mean = e.weight @ e.theta
        assert_allclose(mean, e.mean, rtol=1e-8)
        away = e.theta - mean
        assert_allclose(np.einsum("j,ja,jb", e.weight, away, away), e.covariance,
                        rtol=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("number", [1, 3])
def test_point_masses_have_the_quantiles_of_the_posterior(number):
    """The rank of the truth is uniform, for every parameter."""
    for h in paper_case(number):
        T = s.simulate([h], 1.0, 300, 200, seed=30 + number)
        ranks = []
        for y, truth in zip(T.error, T.theta):
            e = s.identify(y, 1.0, [h]).estimates[0]
            ranks.append(e.weight @ (e.theta < truth))
        for column, p in enumerate(h.parameters):
            # 1 / 32 for the points; of four or six tests one fails in 200
            ks = kstest(np.array(ranks)[:, column], "uniform")
            assert ks.statistic < 1.63 / np.sqrt(200) + 1 / 32, (h.name, p.symbol)


@pytest.mark.parametrize("high", [1e2, 1e4, 1e6])
def test_a_range_from_zero_may_end_far_away(high):
    N, y = 300, np.random.default_rng(0).normal(0.0, 0.5, 300)
    sigma = np.linspace(0.3, 0.8, 4001)    # the bias, and what is about the mean
    ll = -0.5 * (N * np.log(2.0 * np.pi) + (N - 1) * np.log(sigma**2)
                 + N * np.var(y) / sigma**2 + np.log(sigma**2 + N)
                 + N * np.mean(y)**2 / (sigma**2 + N))
    mass = np.exp(ll - ll.max())
    log_evidence = ll.max() + np.log(mass.sum() * (sigma[1] - sigma[0]))
    mean = mass @ sigma / mass.sum()
    sd = np.sqrt(mass @ (sigma - mean)**2 / mass.sum())
    (e,) = s.identify(y, 1.0, s.hypothesis("white_noise", sigma_v=(0.0, high),
                                           bias_sigma=1.0)).estimates
    assert e.settled
    assert_allclose(e.log_evidence, log_evidence - np.log(high), atol=2e-3)
    assert_allclose(e.mean[0], mean, rtol=1e-3)
    assert_allclose(np.sqrt(e.covariance[0, 0]), sd, rtol=0.01)


def test_a_level_of_noise_whose_prior_is_about_zero_is_no_scale():
    def model(dt, c, sigma_v):
        return s.shaping_filter([[0.9]], [[c]], [1.0], sigma_v)
    y = s.simulate([s.hypothesis(model, c=0.8, sigma_v=0.5)], 1.0, 200, seed=1).error[0]
    both, half = (s.identify(y, 1.0, s.hypothesis(
        model, c=ends, sigma_v=(0.1, 2.0))).best for ends in ((-2.0, 2.0), (0.0, 2.0)))
    assert_allclose(both.log_evidence, half.log_evidence, atol=1e-3)    # by symmetry
    assert_allclose(both.covariance[0, 0], half.mean[0]**2 + half.covariance[0, 0],
                    rtol=1e-2)
    assert_allclose(both.mean[1], half.mean[1], rtol=1e-3)


def test_a_known_parameter_leaves_the_others_settled():
    truth = s.hypothesis("random_walk", sigma_w=0.1, sigma_v=0.3)
    h = s.hypothesis("random_walk", sigma_w=(0.01, 0.5), sigma_v=0.3)
    assert all(s.identify(y, 1.0, h).best.settled
               for y in s.simulate([truth], 1.0, 200, trials=20).error)


def test_state_equals_the_reference_implementation():
    H = [s.hypothesis("random_walk", sigma_w=0.1, sigma_v=0.5),
         s.hypothesis("markov", tau_m=20.0, sigma_m=1.0, sigma_v=0.5, bias_sigma=2.0)]
    y = s.simulate(H, 1.0, 50, 1, seed=1).error[0] + 3.0
    y[20:25] = np.nan
    for h, e in zip(H, s.identify(y, 1.0, H).estimates):
        theta = [p.low for p in h.parameters]
        node = naive.Node(theta, *getattr(naive, h.name)(
            theta, 1.0, e.hypothesis.bias_sigma))
        for sample in y:
            node.step(sample)
        mean, cov = s.estimate_state(y, e, 1.0)
        assert_allclose(mean, node.x, rtol=1e-8)
        assert_allclose(cov, node.P, rtol=1e-8)
        masked = np.ma.masked_array(np.where(np.isnan(y), 1e3, y), np.isnan(y))
        assert_allclose(s.estimate_state(masked, e, 1.0)[0], mean, rtol=1e-12)


def test_a_large_bias_costs_no_accuracy():
    H = paper_case(3, bias_sigma=1e6)
    y = s.simulate(paper_case(3), 0.1, 3000, 1, seed=9).error[0]
    near, far = s.identify(y, 0.1, H), s.identify(y + 1e5, 0.1, H)
    assert_allclose(far.probability, near.probability, atol=1e-4)
    flat = paper_case(3, bias_sigma=1e12)
    both = np.array([y, y + 1e8])
    for h in flat:
        for law in next(s.posteriors(s.grid(h, 0.1, 16), both, [3000])):
            assert_allclose(law[1], law[0], rtol=1e-5, atol=1e-9)
    (one, fits), (other, far_fits) = (rivals.akaike(own, 0.1, flat) for own in both)
    assert one == other
    assert_allclose(np.hstack(far_fits), np.hstack(fits), rtol=1e-3)    # they are flat


@pytest.mark.parametrize("N, sd_away", [(20, 5.0), (50, 10.0), (200, 10.0)])
def test_a_bias_far_outside_its_prior_leaves_the_noise_right(N, sd_away):
    """White noise alone has its likelihood in closed form."""
    bias_sigma, low, high = 0.3, 0.2, 2.0
    y = np.random.default_rng(N).normal(sd_away * bias_sigma, 0.6, N)
    square, mean = np.sum((y - y.mean())**2), y.mean()

    def log_likelihood(sigma):
        spread = sigma**2 + N * bias_sigma**2
        return -0.5 * (N * np.log(2.0 * np.pi) + (N - 1) * np.log(sigma**2)
                       + np.log(spread) + square / sigma**2 + N * mean**2 / spread)
    sigma = np.linspace(low, high, 20_001)
    peak, mode = log_likelihood(sigma).max(), sigma[log_likelihood(sigma).argmax()]
    total, first, second = (quad(lambda x: x**k * np.exp(log_likelihood(x) - peak), low,
                                 high, points=[mode], epsrel=1e-10)[0]
                            for k in range(3))
    e = s.identify(y, 1.0, s.hypothesis("white_noise", sigma_v=(low, high),
                                        bias_sigma=bias_sigma)).estimates[0]
    sd = np.sqrt(second / total - (first / total)**2)
    assert_allclose(e.log_evidence, np.log(total / (high - low)) + peak, atol=0.003)
    assert_allclose(e.mean[0], first / total, atol=0.01 * sd)
    assert_allclose(np.sqrt(e.covariance[0, 0]), sd, rtol=0.02)


def test_decision_needs_the_threshold():
    H = paper_case(2)
    answer = s.identify(s.simulate(H, 0.1, 500, 1, seed=1).error[0], 0.1, H)
    for probability, expected in (((0.1, 0.9), 1), ((0.25, 0.75), None)):
        assert s.decide(answer._replace(probability=np.array(probability))) == expected
    assert s.decide(answer._replace(probability=np.array([0.4, 0.6])), gamma=0.5) == 1


def test_a_coarse_answer_is_not_silent():
    h = s.hypothesis("markov", tau_m=(60, 1500), sigma_m=(0.5, 1.5), sigma_v=0.5)
    y = s.simulate([h], 0.1, 20000, 1, seed=1).error[0]
    assert not s.resolve(h, 0.1, y, max_nodes=20).settled
    assert s.resolve(h, 0.1, y).settled


THREE_AXES = s.hypothesis("random_walk_markov", prior="log", sigma_w=(0.01, 0.5),
                          tau_m=(2.0, 50.0), sigma_m=(0.1, 2.0), sigma_v=(0.2, 2.0))
FOUR_AXES = s.hypothesis("two_markov", tau_m=(2.0, 20.0), sigma_m=(0.3, 2.0),
                         tau_n=(20.0, 200.0), sigma_n=(0.3, 2.0), sigma_v=(0.25, 1.0))


def test_drawn_nodes_equal_dense_covariances_at_draws_of_the_prior():
    y = s.simulate([THREE_AXES], 1.0, 40, 1, seed=8).error[0]
    rng, i = np.random.default_rng(1), np.arange(1.0, 41.0)
    low, high = np.array([p[1:3] for p in THREE_AXES.parameters]).T
    theta = low * (high / low)**rng.random((20000, 4))
    w2, tau, m2, v2 = (theta**[2, 1, 2, 2]).T[..., None, None]
    C = (w2 * np.minimum(i[:, None], i) + m2 * np.exp(-np.abs(i[:, None] - i) / tau)
         + v2 * np.eye(40) + 1.0)
    _, log_det = np.linalg.slogdet(C)
    ll = -0.5 * (40 * np.log(2.0 * np.pi) + log_det
                 + np.linalg.solve(C, np.tile(y[:, None], (20000, 1, 1)))[..., 0] @ y)
    w = np.exp(ll - ll.max())
    e = s.resolve(THREE_AXES, 1.0, y)
    assert e.settled
    se = w.std() / w.mean() / np.sqrt(len(w))
    assert abs(e.log_evidence - ll.max() - np.log(w.mean())) < 4.0 * se + s.SETTLED
    w /= w.sum()
    mean, sd = w @ theta, np.sqrt(np.diag(e.covariance))
    se = np.sqrt(w**2 @ (theta - mean)**2)
    assert (np.abs(e.mean - mean) < 4.0 * se + s.SETTLED * sd).all()
    assert_allclose(np.sqrt(w @ (theta - mean)**2), sd, rtol=0.1)


@pytest.mark.parametrize("h, seed", [
    thorough(THREE_AXES, 1), thorough(FOUR_AXES, 3)])
def test_settled_means_that_more_nodes_say_the_same(h, seed, monkeypatch):
    y = s.simulate([h], 1.0, 300, 1, seed=seed).error[0]
    said, few = s.resolve(h, 1.0, y), s.resolve(h, 1.0, y, max_nodes=500)
    assert said.settled and not few.settled
    error = 4.0 * 0.5 * s.SETTLED    # four standard errors
    monkeypatch.setattr(s, "SETTLED", 0.01)
    best = s.resolve(h, 1.0, y, max_nodes=100000)
    sd = np.sqrt(np.diag(best.covariance))
    assert abs(said.log_evidence - best.log_evidence) < error
    assert (np.abs(said.mean - best.mean) < error * sd).all()
    assert (np.abs(said.weight @ said.theta - said.mean) < error * sd).all()


@pytest.mark.thorough
def test_ranks_of_two_processes_are_uniform(tmp_path, monkeypatch):
    """1000 records: python -m figures ranks"""
    import figures
    from figures import ranks
    monkeypatch.setattr(figures, "OUTPUT", tmp_path)
    of, settled = ranks.compute(100)
    assert settled == 200
    for rank in np.hstack(list(of.values())).T:    # of nine tests one fails in 200
        assert kstest(rank, "uniform").pvalue > 0.005 / 9


@pytest.mark.parametrize("y, dt, message", [
    (np.zeros(100), 1.0, "is constant"), (np.arange(5.0), 1.0, "has 5 samples"),
    (np.arange(100.0), -1.0, "sampling interval is -1.0 s"),
    (np.full(100, np.inf), 1.0, "infinite values"),
    (np.zeros((3, 50)), 1.0, "has shape"),
    (np.arange(99.0), "1", "interval is 1 s: it must be a number"),
    (np.arange(99.0), np.timedelta64(1, "s"), "must be a number > 0"),
    (1e-18 * np.arange(99.0), 1.0, "9.8e-17: choose a unit in which it varies by more"),
    (1e15 * np.arange(99.0), 1.0, r"9.8e\+16: choose a unit"),
    (np.r_[np.arange(9.0), np.full(50, np.nan)], 1.0, "has 9 samples")])
def test_a_useless_record_is_refused(y, dt, message):
    with pytest.raises(ValueError, match=message):
        s.identify(y, dt, paper_case(2))


def in_unit(h, unit):
    """A hypothesis with all its sigmas in another unit."""
    return h._replace(bias_sigma=h.bias_sigma * unit, parameters=tuple(
        p._replace(low=p.low * unit, high=p.high * unit)
        if p.symbol.startswith("sigma") else p for p in h.parameters))


@pytest.mark.parametrize("unit", [4.848e-6, 1e-12, 1e9])
def test_answers_do_not_depend_on_the_unit(unit):
    """Of deg/h in rad/s, and of what no one uses."""
    h = [*paper_case(2), s.hypothesis(
        "random_walk_markov", sigma_w=(0.001, 0.1), tau_m=(10, 500), sigma_m=(0.3, 2),
        sigma_v=(0.1, 1)), s.hypothesis("markov", tau_m=(10, 500), sigma_m=1.0,
                                        sigma_v=0.5, prior="log")]
    y = s.simulate(h, 1.0, 600, seed=4).error[0]
    plain, scaled = s.identify(y, 1.0, h), s.identify(
        unit * y, 1.0, [in_unit(one, unit) for one in h])
    assert_allclose(scaled.probability, plain.probability, rtol=1e-3)
    for one, other in zip(plain.estimates, scaled.estimates):
        factor = np.array([unit if p.symbol.startswith("sigma") else 1.0
                           for p in one.hypothesis.parameters])
        assert_allclose(other.mean / factor, one.mean, rtol=1e-3)
        assert_allclose(np.diag(other.covariance) / factor**2,
                        np.diag(one.covariance), rtol=1e-3, atol=1e-12)


def test_criteria_do_not_depend_on_the_unit():
    h = [s.hypothesis("random_walk", sigma_w=(0.04, 0.15), sigma_v=(0.25, 1)),
         s.hypothesis("markov", tau_m=(20, 300), sigma_m=(0.5, 1.5), sigma_v=(0.25, 1))]
    plain, scaled = (s.criteria([in_unit(one, u) for one in h], 0.1, 100, trials=32)
                     for u in (1.0, 4.848e-6))
    for one, other in zip(plain.rsd, scaled.rsd):
        assert_allclose(other.real, one.real, rtol=1e-4)
        assert_allclose(other.calculated, one.calculated, rtol=1e-4)


def test_what_is_no_hypothesis_is_refused():
    y = np.random.default_rng(5).standard_normal(99)
    for given in ("random_walk", ["random_walk"], [5]):
        with pytest.raises(ValueError, match="is no hypothesis: hypothesis.name"):
            s.identify(y, 1.0, given)
    with pytest.raises(ValueError, match="at least one is needed"):
        s.identify(y, 1.0, [])
    with pytest.raises(ValueError, match="unknown hypothesis 5"):
        s.hypothesis(5)
    with pytest.raises(ValueError, match="differ by too many orders of magnitude"):
        s.identify(y, 1.0, s.hypothesis("white_noise", sigma_v=(1e-300, 1e-299)))
    alone = s.hypothesis("white_noise", sigma_v=(0.1, 9.0))
    assert s.identify(y, 1.0, alone).best.log_evidence == (
        s.identify(y, 1.0, [alone]).best.log_evidence)


def test_a_bias_that_was_not_given_is_as_wide_as_the_offset_of_a_record():
    y = 66.0 + 0.5 * np.random.default_rng(5).standard_normal(500)

    def probability(**given):
        answer = s.identify(y, 1.0, [
            s.hypothesis("white_noise", sigma_v=(0.1, 1.0), **given),
            s.hypothesis("random_walk", sigma_w=(1e-4, 1.0), sigma_v=(0.1, 1.0),
                         **given)])
        return answer.probability[0]
    assert probability() > 0.9 > 0.1 > probability(bias_sigma=1.0)
    assert_allclose(probability(), probability(bias_sigma=66.0), atol=0.02)
