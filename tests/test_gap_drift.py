"""The integrated error against its closed form."""

import numpy as np
from conftest import WHITE
from numpy.testing import assert_allclose

from sensorlab import Scene, Simulator
from sensorlab.gap import drift


def test_integrated_white_noise_grows_with_the_root_of_the_horizon():
    y = 3.0 * np.random.default_rng(0).standard_normal((400, 4096))
    found = drift.integrated(y, 0.1, [16, 256])
    m = np.array([16.0, 256.0])    # samples; the mean of all 4096 is taken away
    exact = 0.1 * 3.0 * np.sqrt(m * (1.0 - m / 4096.0))
    # 400 records of 256 and 16 windows; a standard error of rms / sqrt(2 windows)
    assert_allclose(np.sqrt((found**2).mean(0)), exact,
                    rtol=5.0 / np.sqrt(2 * 400 * 16))


def test_horizons_that_a_record_does_not_hold_are_left_out():
    y = np.random.default_rng(1).standard_normal(100)
    (short, long) = drift.drift(Scene(y, 1.0, {}), [Simulator(tuple(WHITE))] * 2)
    assert (short.horizon, long.horizon) == (1.0, 10.0)
    assert_allclose(short.record, y.std(), rtol=1e-12)
    assert short.simulator == short.with_effects
