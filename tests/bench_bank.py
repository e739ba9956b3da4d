"""pytest tests/bench_bank.py --benchmark-enable -n 0: the bank against its peers.

Every peer runs the two-state filter of Eqs. (22)-(23) in float64 at as much of the same
work as it does in about a second. Log-likelihoods are compared before anything is
timed, and whatever compiles has compiled. `conftest.py` prints the table: filter
updates (steps of one node on one record) a second for records x nodes x samples, and
the ratio to ours in the same run. The peak is that of a loop of fused multiply-adds and
of a matrix product on the same cores; an update costs five multiply-adds.
"""

import numpy as np
import pytest
from conftest import RATES
from numba import njit, prange
from numpy.testing import assert_allclose

import naive
import sensorid as s

DT = 1.0
H = s.hypothesis("markov", tau_m=(60.0, 1500.0), sigma_m=(0.5, 1.5),
                 sigma_v=(0.25, 1.0))
Y = s.simulate([H], DT, 20000, 128, seed=1).error
THETA = s.uniform_grid(H, DT, 10).theta


def two_state(theta):
    """Phi, Q, H, R of the two-state filter and the covariance of x_1."""
    Phi, Gamma, design, Psi, P0 = naive.markov(theta, DT, 1.0)
    Q = Gamma @ Gamma.T
    return Phi, Q, design, Psi**2, Phi @ P0 @ Phi.T + Q


def ours(Y, theta):
    u = next(s.filter_bank(s.bank(H, DT, theta), Y, [Y.shape[1]]))
    return s.log_likelihood(1.0, u.count, u.chi2, u.score, u.information, u.log_det,
                            (0.0, 1.0))


def naive_twin(Y, theta):
    result = np.empty((len(Y), len(theta)))
    for column, node_theta in enumerate(theta):
        for row, y in enumerate(Y):
            node = naive.Node(node_theta, *naive.markov(node_theta, DT, 1.0))
            for sample in y:
                node.step(sample)
            result[row, column] = node.log_likelihood
    return result


def statsmodels(Y, theta):
    from statsmodels.tsa.statespace.mlemodel import MLEModel
    result = np.empty((len(Y), len(theta)))
    for column, node_theta in enumerate(theta):
        Phi, Q, design, R, P1 = two_state(node_theta)
        for row, y in enumerate(Y):
            model = MLEModel(y, k_states=2, transition=Phi, selection=np.eye(2),
                             design=design, state_cov=Q, obs_cov=R)
            model.initialize_known(np.zeros(2), P1)
            model.ssm.tolerance = 0
            result[row, column] = model.loglike([])
    return result


def simdkalman(Y, theta):
    package = pytest.importorskip("simdkalman")
    result = []
    for node_theta in theta:
        Phi, Q, design, R, P1 = two_state(node_theta)
        kf = package.KalmanFilter(Phi, Q, design, R)
        result.append(kf.compute(Y, 0, initial_value=np.zeros(2), initial_covariance=P1,
                                 smoothed=False, log_likelihood=True).log_likelihood)
    return np.stack(result, 1) - 0.5 * s.LOG_2PI * Y.shape[1]    # it leaves 2 pi out


def dynamax(Y, theta):
    jax = pytest.importorskip("jax")
    pytest.importorskip("dynamax")
    from dynamax.linear_gaussian_ssm import inference as lgssm
    jax.config.update("jax_enable_x64", True)

    def one(y, Phi, Q, design, R, P1):
        params = lgssm.ParamsLGSSM(
            initial=lgssm.ParamsLGSSMInitial(mean=jax.numpy.zeros(2), cov=P1),
            dynamics=lgssm.ParamsLGSSMDynamics(
                weights=Phi, bias=jax.numpy.zeros(2),
                input_weights=jax.numpy.zeros((2, 0)), cov=Q),
            emissions=lgssm.ParamsLGSSMEmissions(
                weights=design, bias=jax.numpy.zeros(1),
                input_weights=jax.numpy.zeros((1, 0)), cov=R))
        return lgssm.lgssm_filter(params, y[:, None]).marginal_loglik

    matrices = [np.stack(part) for part in zip(*(two_state(t) for t in theta))]
    if dynamax not in COMPILED:
        over_nodes = jax.vmap(one, (None, 0, 0, 0, 0, 0))
        COMPILED[dynamax] = jax.jit(jax.vmap(over_nodes, (0,) + 5 * (None,)))
    return np.asarray(COMPILED[dynamax](Y, *matrices))


def jax_scan(Y, theta):
    """The same scalar recursion by hand: vmap over nodes and records of lax.scan."""
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)

    def step(carry, y):
        x1, x2, p11, p12, p22, total, a, q, r = carry
        g1, g2 = p11 + p12, p12 + p22
        f, nu = g1 + g2 + r, y - x1 - x2
        k1, k2 = g1 / f, g2 / f
        total = total - 0.5 * (s.LOG_2PI + jax.numpy.log(f) + nu * nu / f)
        return (a * (x1 + k1 * nu), x2 + k2 * nu, a * a * (p11 - k1 * g1) + q,
                a * (p12 - k1 * g2), p22 - k2 * g2, total, a, q, r), None

    def one(y, a, q, r, p1):
        return jax.lax.scan(step, (0.0, 0.0, p1, 0.0, 1.0, 0.0, a, q, r), y)[0][5]

    if jax_scan not in COMPILED:
        over_nodes = jax.vmap(one, (None, 0, 0, 0, 0))
        COMPILED[jax_scan] = jax.jit(jax.vmap(over_nodes, (0,) + 4 * (None,)))
    Phi, Q, _, R, P1 = (np.stack(part) for part in zip(*(two_state(t) for t in theta)))
    return np.asarray(COMPILED[jax_scan](Y, Phi[:, 0, 0], Q[:, 0, 0], R[:, 0, 0],
                                         P1[:, 0, 0]))


def celerite2(Y, theta):
    """Quasi-separable Gaussian process: the bias is a process that never decays."""
    package = pytest.importorskip("celerite2")
    result, time = np.empty((len(Y), len(theta))), DT * np.arange(Y.shape[1])
    for column, (tau_m, sigma_m, sigma_v) in enumerate(theta):
        kernel = (package.terms.RealTerm(a=sigma_m**2, c=1.0 / tau_m)
                  + package.terms.RealTerm(a=1.0, c=0.0))
        process = package.GaussianProcess(kernel)
        process.compute(time, diag=np.full(len(time), sigma_v**2))
        result[:, column] = [process.log_likelihood(y) for y in Y]
    return result


COMPILED = {}
PEERS = [(ours, 128, 1000, 20000), (ours, 1, 1000, 20000), (jax_scan, 128, 200, 2000),
         (celerite2, 1, 50, 20000),
         (dynamax, 32, 50, 2000), (simdkalman, 128, 2, 2000),
         (statsmodels, 4, 50, 2000), (naive_twin, 2, 4, 2000)]


@pytest.mark.parametrize("bank, records, nodes, samples", PEERS)
def test_bank(benchmark, bank, records, nodes, samples):
    assert_allclose(bank(Y[:2, :200], THETA[:2]), naive_twin(Y[:2, :200], THETA[:2]),
                    rtol=1e-8 if bank is dynamax else 1e-9)    # it adds 1e-9 to f
    work = Y[:records, :samples], THETA[:nodes]
    bank(*work)
    benchmark.pedantic(bank, work, rounds=3)
    if benchmark.stats:
        name = f"{bank.__name__}, {records} x {nodes} x {samples}"
        RATES[name] = records * nodes * samples / benchmark.stats.stats.min


@njit(parallel=True, error_model="numpy", fastmath={"contract"})
def multiply_add(x, repeats):
    """16 * 128 * repeats fused multiply-adds on every core, states in registers."""
    for core in prange(len(x)):
        row = x[core]
        for _ in range(repeats):
            for t in range(128):
                v = row[t]
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                v = v * 0.999 + 1e-3
                row[t] = v


def test_peak_of_a_loop(benchmark):
    import numba
    x = np.zeros((numba.get_num_threads(), 128))
    multiply_add(x, 1000)
    assert_allclose(x, 1.0 - 0.999**16000, rtol=1e-9)
    benchmark.pedantic(multiply_add, (x, 200_000), rounds=3)
    if benchmark.stats:
        RATES["peak of a compiled loop / 5"] = (
            16 * x.size * 200_000 / 5 / benchmark.stats.stats.min)


def test_peak_of_a_matrix_product(benchmark):
    A = np.random.default_rng(1).normal(size=(2500, 2500))
    benchmark.pedantic(A.dot, (A,), rounds=3)
    if benchmark.stats:
        RATES["peak of a matrix product / 5"] = 2500**3 / 5 / benchmark.stats.stats.min


@pytest.mark.parametrize("samples", [10**5, 10**6, 10**7])
def test_one_long_record(benchmark, samples):
    """The whole posterior over three structures."""
    truth = s.hypothesis("markov", tau_m=20.0, sigma_m=0.1, sigma_v=1.0)
    y = s.simulate([truth], 0.01, samples, seed=1).error[0]
    hypotheses = s.default_hypotheses(y, 0.01)
    s.identify(y[:1000], 0.01, hypotheses)
    answer = benchmark.pedantic(s.identify, (y, 0.01, hypotheses), rounds=1)
    assert s.decide(answer) == 2
    if benchmark.stats:
        RATES[f"identify, {samples} samples, s"] = benchmark.stats.stats.min


def test_maximum_likelihood_of_one_structure_with_statsmodels(benchmark):
    """One state, 100 000 samples, three parameters."""
    from statsmodels.tsa.statespace.mlemodel import MLEModel
    truth = s.hypothesis("markov", tau_m=20.0, sigma_m=0.1, sigma_v=1.0, bias_sigma=0.0)
    y = s.simulate([truth], 0.01, 10**5, seed=1).error[0]

    class Markov(MLEModel):
        start_params = np.log([5.0, 0.3, 0.5])
        param_names = ["ln tau_m", "ln sigma_m", "ln sigma_v"]

        def update(self, params, **kwargs):
            tau_m, sigma_m, sigma_v = np.exp(super().update(params, **kwargs))
            a = np.exp(-0.01 / tau_m)
            self["transition", 0, 0], self["obs_cov", 0, 0] = a, sigma_v**2
            self["state_cov", 0, 0] = sigma_m**2 * (1.0 - a * a)

    model = Markov(y, k_states=1, design=[[1.0]], selection=[[1.0]],
                   initialization="stationary")
    fit = benchmark.pedantic(model.fit, kwargs=dict(disp=False), rounds=1)
    assert abs(np.exp(fit.params[2]) - 1.0) < 0.02
    if benchmark.stats:
        RATES["statsmodels, maximum likelihood, 100000 samples, s"] = (
            benchmark.stats.stats.min)
