"""Two effects at a time."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sensorid
import sensorlab
from sensorlab.gap import pairs

DT, N = 0.1, 2000
TIME = DT * np.arange(N)
WHITE = [sensorid.hypothesis("white_noise", sigma_v=(0.7, 1.3))]
WARM = 25.0 + np.sin(2.0 * np.pi * TIME / 130.0 + 1.0)
SHAPES = dict(bias_step=TIME > 70.0, temperature=WARM,
              pulse=(TIME > 50.0) & (TIME < 80.0),
              turn_on_transient=np.exp(-TIME / 25.0))


def sized(names, nats):
    """The shapes, each so large that it is worth so many nats beside the others."""
    for name in names:
        rows = np.column_stack([np.ones(N), *(
            SHAPES[other] for other in names if other != name)])
        left = SHAPES[name] - rows @ np.linalg.lstsq(rows, SHAPES[name])[0]
        yield np.sqrt(2.0 * nats / (left @ left)) * SHAPES[name]


@pytest.mark.thorough
@pytest.mark.parametrize("names", [
    ("bias_step", "temperature"), ("pulse", "temperature"),
    ("bias_step", "turn_on_transient")])
def test_two_signatures_are_not_taken_for_a_walk(names):
    noise = np.random.default_rng(5).standard_normal(N)
    y = noise + sum(sized(names, 85.0))
    d = sensorlab.diagnose(y, DT, WHITE, dict(temperature=WARM))
    assert sorted(d.verdict.split("+")) == sorted(names)
    walks = [effect for name, effect in sensorlab.CATALOGUE.items()
             if name in ("random_walk", *names)]
    alone = sensorlab.diagnose(y, DT, WHITE, dict(temperature=WARM), walks[-1:])
    assert alone.verdict == "random_walk"    # which describes the record as well
    assert alone.after.p_value > 0.01


@pytest.mark.thorough
def test_outliers_on_a_drift_are_no_random_steps():
    rng = np.random.default_rng(0)
    y = 0.05 * rng.standard_normal(1500) + 0.3 * rng.standard_normal(1500) * (
        rng.random(1500) < 0.01)
    warm = WARM[:1500]
    d = sensorlab.diagnose(y + 0.04 * (warm - warm.mean()), 0.01, [
        sensorid.hypothesis("white_noise", sigma_v=0.05)], dict(temperature=warm))
    assert sorted(d.verdict.split("+")) == ["outliers", "temperature"]


def test_gains_of_pairs_are_those_of_least_squares():
    rng = np.random.default_rng(3)
    z = rng.standard_normal((8, 60))
    z[5] = z[2]    # as if twice in the list
    first, last = np.array([1, 2, 4, 5, 6]), np.array([1, 3, 4, 5, 7])
    gains = pairs._gains(z @ z.T, first, last)
    for i in range(5):
        for k in range(5):
            own = np.unique([first[i], last[i], first[k], last[k]])
            if i == k or {i, k} == {1, 3}:
                assert gains[i, k] == -np.inf
            else:
                fit = np.linalg.lstsq(z[own].T, z[0])[0] @ z[own]
                assert_allclose(gains[i, k], fit @ fit, rtol=1e-9)


def telegraph(rng, dwell, size):
    """Two levels that change at random."""
    return size * (np.cumsum(rng.random(N) < DT / dwell) % 2)


@pytest.mark.thorough
@pytest.mark.parametrize("shape, seed", [("bias_step", 1), ("pulse", 2)])
def test_a_level_that_jumps_is_found_beside_a_signature(shape, seed):
    """As a pair, or in the place of a process that had seemed to explain it."""
    rng = np.random.default_rng(seed)
    y = rng.standard_normal(N) + telegraph(rng, 5.0, 1.5) + 3.0 * SHAPES[shape]
    d = sensorlab.diagnose(y, DT, WHITE)
    assert sorted(d.verdict.split("+")) == sorted([shape, "random_telegraph"])


@pytest.mark.thorough
def test_small_steps_at_random_are_no_walk_and_no_others():
    rng = np.random.default_rng(4)
    at = rng.random(N) < 0.01
    y = rng.standard_normal(N) + np.cumsum(at * rng.standard_normal(N) * 2.0)
    d = sensorlab.diagnose(y, DT, WHITE)
    assert d.verdict == "random_steps"
    assert sensorlab.diagnose(
        y + 5.0 * rng.standard_normal(N) * (rng.random(N) < 0.01), DT, WHITE
    ).verdict in ("random_steps+outliers", "outliers+random_steps")
