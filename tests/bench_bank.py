"""pytest tests/bench_bank.py --benchmark-enable: the filter bank against slower twins.

Results are compared before anything is timed. A round is one record of 500 samples
through some nodes; `updates_per_second` in the extra info makes rows comparable.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import naive
import sensorid as s

DT, N = 1.0, 500
H = s.hypothesis("markov", tau_m=(60.0, 1500.0), sigma_m=(0.5, 1.5),
                 sigma_v=(0.25, 1.0))
Y = s.simulate([H], DT, N, 256, seed=1).error
THETA = s.uniform_grid(H, DT, 10).theta


def ours(records, nodes):
    u = next(s.filter_bank(s.bank(H, DT, THETA[:nodes]), Y[:records], [N]))
    return s.log_likelihood(1.0, u.count, u.chi2, u.score, u.information, u.log_det,
                            (0.0, 1.0))


def reference(records, nodes):
    result = np.empty((records, nodes))
    for column, theta in enumerate(THETA[:nodes]):
        for row in range(records):
            node = naive.Node(theta, *naive.markov(theta, DT, 1.0))
            for y in Y[row]:
                node.step(y)
            result[row, column] = node.log_likelihood
    return result


def statsmodels(records, nodes):
    from statsmodels.tsa.statespace.mlemodel import MLEModel
    result = np.empty((records, nodes))
    for column, theta in enumerate(THETA[:nodes]):
        Phi, Gamma, design, Psi, P0 = naive.markov(theta, DT, 1.0)
        for row in range(records):
            model = MLEModel(Y[row], k_states=2, k_posdef=1, transition=Phi,
                             selection=Gamma, design=design, state_cov=np.eye(1),
                             obs_cov=Psi**2)
            model.initialize_known(np.zeros(2), Phi @ P0 @ Phi.T + Gamma @ Gamma.T)
            model.ssm.tolerance = 0
            result[row, column] = model.loglike([])
    return result


@pytest.mark.parametrize("bank, records, nodes", [
    (reference, 2, 2), (statsmodels, 4, 8), (ours, 1, 1000), (ours, 256, 1000)])
def test_bank(benchmark, bank, records, nodes):
    few = min(records, 2), min(nodes, 2)
    assert_allclose(bank(*few), reference(*few), rtol=1e-9)
    bank(records, nodes)    # compiles
    benchmark.extra_info["updates_per_second"] = None
    benchmark(bank, records, nodes)
    if benchmark.stats:
        rate = records * nodes * N / benchmark.stats["min"]
        benchmark.extra_info["updates_per_second"] = f"{rate:.3g}"
