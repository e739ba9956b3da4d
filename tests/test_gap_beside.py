"""What a simulator has already does not hide what it lacks."""

import types

import numpy as np
import pytest
from conftest import DT
from numpy.testing import assert_array_equal

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Found, Scene, Simulator, simulate_effects
from sensorlab.gap.account import fixed, with_clusters

SIZES = dict(
    bandwidth=dict(tau=2.0), noise_step=dict(onset=1500.0, ratio=1.8),
    outliers=dict(rate=0.01, sigma=4.0), bias_instability=dict(sigma=1.2),
    ringing=dict(onset=1500.0, duration=60.0, frequency=0.1, amplitude=4.0, phase=0.4),
    narrow_band_noise=dict(frequency=0.12, tau=30.0, sigma=0.6),
    noise_bursts=dict(quiet=150.0, duration=30.0, sigma=1.5))


def effect(name):
    values, one = SIZES[name], CATALOGUE[name]
    return Found(one, values=values if one.columns else fixed(**values))


@pytest.mark.large
@pytest.mark.parametrize("known, missing", [
    ("bandwidth", "noise_step"), ("noise_step", "bandwidth"), ("outliers", "ringing"),
    ("narrow_band_noise", "bias_instability"), ("narrow_band_noise", "noise_bursts"),
    ("noise_bursts", "bandwidth")])
def test_what_is_missing_is_named_beside_what_is_known(known, missing):
    scene = Scene(np.zeros(3000), DT, {})
    truth = sensorid.hypothesis("markov", tau_m=300.0, sigma_m=0.9, sigma_v=0.5)
    ranges = sensorid.hypothesis("markov", tau_m=(60, 1500), sigma_m=(0.5, 1.5),
                                 sigma_v=(0.25, 1))
    (y,) = simulate_effects(Simulator((truth,), ((effect(known), effect(missing)),)),
                            scene, seed=18).error
    d = sensorlab.diagnose(y, DT, Simulator((ranges,), ((effect(known),),)))
    assert d.verdict == missing, d.causes[:3]
    for symbol, (mean, sd) in d.found[0].values.items():
        if symbol in SIZES[missing] and symbol != "phase":
            assert abs(mean - SIZES[missing][symbol]) < 4.0 * sd, symbol


def test_outliers_that_come_together_are_not_masked():
    y, rng = np.zeros(4000), np.random.default_rng(3)
    alone, together = rng.choice(1500, 30, replace=False), np.arange(2000, 2010)
    scene = Scene(y, DT, {})
    masked = y.copy()
    masked[alone], masked[together] = np.nan, np.nan
    rate = types.SimpleNamespace(rate=np.array([0.01]))
    told = with_clusters(scene, types.SimpleNamespace(
        theta=np.zeros(1), member=types.SimpleNamespace(jumps=lambda theta: rate)),
        scene._replace(y=masked))
    assert_array_equal(np.flatnonzero(np.isnan(told.y)), np.sort(alone))
