"""pytest tests/bench_gap.py --benchmark-enable -n 0: kernels of the gap, and why the
bank of `sensorid` does not take its steps from them.

Answers are compared before anything is timed, and whatever compiles has compiled.
`conftest.py` prints the table: seconds for 64 nodes on a record of 20 000 samples.
"""

import numpy as np
import pytest
from conftest import DT, MODEL, RATES, member
from numba import njit
from numpy.testing import assert_allclose

import sensorid as s
from sensorlab import Scene
from sensorlab.gap import backward, changes, filters, parts
from sensorlab.gap.kernels.lanes import (
    KERNEL, LANES, groups, in_threads, load, observe_covariance, observe_state, turn,
    turn_covariance, update_covariance, update_state)

SCENE = Scene(s.simulate(MODEL[:1], DT, 20000, seed=2).error[0], DT, {})


def nodes(h, count=64):
    """Theta at random quantiles of the prior."""
    u = np.random.default_rng(3).uniform(0.2, 0.8, (count, len(s.free_columns(
        h.parameters))))
    return s.at_quantiles(h.parameters, u)


@njit(**KERNEL)
def bank_of_steps(first, last, y, h, own, pair, r, sums):
    """chi2 and log_det (2, M) of a record without gaps and bias."""
    M, n = own.shape[1:]
    for group in range(first, last):
        node = np.minimum(group * LANES + np.arange(LANES), M - 1)
        parts = np.empty((6, n, LANES))
        P, x = np.empty((n, n, LANES)), np.zeros((n, LANES))
        Ph, f, nu = np.empty((n, LANES)), np.empty(LANES), np.empty(LANES)
        weight, gain = np.empty(LANES), np.empty(LANES)
        chi2, log_det = np.zeros(LANES), np.zeros(LANES)
        load(own, pair, node, parts, P)
        for i in range(len(y)):
            for g in range(LANES):
                f[g], nu[g] = r[min(group * LANES + g, M - 1)], y[i]
            turn_covariance(parts, pair, P)
            observe_covariance(parts, pair, h, P, Ph, f)
            turn(parts, pair, x)
            observe_state(h, x, nu)
            for g in range(LANES):
                weight[g] = 1.0 / f[g]
                gain[g] = nu[g] * weight[g]
                chi2[g] += nu[g] * gain[g]
                log_det[g] += np.log(f[g])
            update_state(x, Ph, gain)
            update_covariance(P, Ph, weight)
        for g in range(min(LANES, M - group * LANES)):
            sums[0, group * LANES + g] = chi2[g]
            sums[1, group * LANES + g] = log_det[g]


def of_steps(b):
    one = parts.parts_of(None, b)
    sums = np.empty((2, len(b.r)))
    in_threads(bank_of_steps, groups(len(b.r), LANES), SCENE.y, one.h, one.own,
               one.pair, one.r[:, 0].copy(), sums)
    return sums


def timed(benchmark, name, work):
    work()
    benchmark.pedantic(work, rounds=5)
    if benchmark.stats:
        RATES[f"{name}, s"] = benchmark.stats.stats.min


@pytest.mark.parametrize("effect", ["correlated_noise", "bias_instability"])
def test_a_bank_of_the_shared_steps(benchmark, effect):
    h = member(SCENE, MODEL[0], effect)
    b = s.bank(h, DT, nodes(h))
    own = next(s.filter_bank(b, SCENE.y[None], [len(SCENE.y)]))
    assert_allclose(of_steps(b), [own.chi2[0], own.log_det], rtol=1e-9)
    timed(benchmark, f"{effect}, a bank of the shared steps", lambda: of_steps(b))


@pytest.mark.parametrize("effect", ["correlated_noise", "bias_instability"])
def test_the_bank(benchmark, effect):
    h = member(SCENE, MODEL[0], effect)
    b = s.bank(h, DT, nodes(h))
    timed(benchmark, f"{effect}, the bank (with bias)", lambda: next(
        s.filter_bank(b, SCENE.y[None], [len(SCENE.y)])))


@pytest.mark.parametrize("effects", [["outliers"], ["random_telegraph"],
                                     ["outliers", "random_telegraph"]])
def test_filters_with_jumps(benchmark, effects):
    h = member(SCENE, MODEL[0], *effects)
    theta = nodes(h)
    timed(benchmark, "+".join(effects), lambda: filters.log_likelihoods(
        h, SCENE, (), theta))


def test_the_backward_pass(benchmark):
    h = member(SCENE, MODEL[0])
    theta = nodes(h)
    timed(benchmark, "backward pass", lambda: backward.solve(h, SCENE, (), theta))


def test_the_law_of_onsets(benchmark):
    h = member(SCENE, MODEL[0], "noise_step")
    theta = nodes(h)
    move = changes.onset_law(h, SCENE, ())
    timed(benchmark, "law of onsets", lambda: move(theta))
