"""What a simulator has already does not hide what it lacks."""

import generator
import numpy as np
import pytest
from conftest import DT, diagnosed, large, member, thorough
from numpy.testing import assert_allclose, assert_array_equal

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Found, Scene, Simulator, simulate_effects
from sensorlab.gap import account, standins
from sensorlab.gap.effects import fixed

SIZES = dict(
    bandwidth=dict(tau=2.0), noise_step=dict(onset=1500.0, ratio=1.8),
    outliers=dict(rate=0.01, sigma=4.0), bias_instability=dict(sigma=1.2),
    ringing=dict(onset=1500.0, duration=60.0, frequency=0.1, amplitude=4.0, phase=0.4),
    random_telegraph=dict(dwell=100.0, size=2.0),
    narrow_band_noise=dict(frequency=0.12, tau=30.0, sigma=0.6),
    noise_bursts=dict(quiet=150.0, duration=30.0, sigma=1.5))

SAMPLES = dict(bias_instability=6000)    # 3000 may resemble one process


def effect(name):
    values, one = SIZES[name], CATALOGUE[name]
    return Found(one, values=values if one.columns else fixed(**values))


@pytest.mark.thorough
@pytest.mark.parametrize("known, missing", [
    ("bandwidth", "noise_step"), ("noise_step", "bandwidth"), ("outliers", "ringing"),
    ("narrow_band_noise", "bias_instability"), ("narrow_band_noise", "noise_bursts"),
    ("noise_bursts", "bandwidth"), ("random_telegraph", "bandwidth")])
def test_what_is_missing_is_named_beside_what_is_known(known, missing):
    scene = Scene(np.zeros(SAMPLES.get(missing, 3000)), DT, {})
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


@pytest.mark.parametrize("missing", [
    large(dict(name="bias_step", onset=1500.0, size=0.6)),
    thorough(dict(name="correlated_noise", tau=30.0, sigma=0.3)),
    large(dict(name="rate_ramp", slope=3e-4))])
def test_a_level_of_two_values_does_not_hide_what_is_slow(missing):
    one = CATALOGUE[missing.pop("name")]
    level = Found(CATALOGUE["random_telegraph"], values=fixed(dwell=150.0, size=1.0))
    white = sensorid.hypothesis("white_noise", sigma_v=(0.4, 0.8), bias_sigma=2.0)
    truth = sensorid.hypothesis("white_noise", sigma_v=0.6, bias_sigma=2.0)
    added = Found(one, values=missing if one.columns else fixed(**missing))
    (y,) = simulate_effects(Simulator((truth,), ((level, added),)), Scene(
        np.zeros(3000), DT, {}), seed=4).error
    d = sensorlab.diagnose(y, DT, Simulator((white,), ((level,),)))
    assert d.verdict == one.name, d.causes[:3]
    for symbol, (mean, sd) in d.found[0].values.items():
        assert abs(mean - missing[symbol]) < 4.0 * sd < 2.0 * missing[symbol], symbol


@pytest.mark.large
def test_a_process_is_found_beside_a_change_of_noise_at_an_unknown_time():
    made = generator.record(2026, 1370, ("correlated_noise", "noise_step"), 3)
    d = diagnosed(made, effects=[CATALOGUE[name] for name in made["truth"]])
    assert set(d.verdict.split("+")) == set(made["truth"]), d.causes[:3]


@pytest.mark.parametrize("names", [("walk_step", "sinusoid"),
                                   thorough(("outliers", "random_steps"))])
def test_what_is_strong_does_not_keep_another_from_being_sought(names):
    """A walk that changes shows in no spectrum; outliers are two steps each."""
    values = dict(walk_step=dict(onset=2500.0, ratio=4.0), outliers=SIZES["outliers"],
                  random_steps=dict(dwell=200.0, sigma=2.0),
                  sinusoid=dict(frequency=0.077, amplitude=0.25, phase=0.3))
    effects = [Found(CATALOGUE[name], values=values[name] if CATALOGUE[name].columns
                     else fixed(**values[name])) for name in names]
    truth = sensorid.hypothesis("random_walk", sigma_w=0.02, sigma_v=0.5)
    ranges = sensorid.hypothesis("random_walk", sigma_w=(0.01, 0.05),
                                 sigma_v=(0.25, 1.0), bias_sigma=5.0)
    (y,) = simulate_effects(Simulator((truth,), (tuple(effects),)), Scene(
        np.zeros(4000), DT, {}), seed=1).error
    d = sensorlab.diagnose(y, DT, [ranges], effects=[CATALOGUE[n] for n in names])
    assert set(d.verdict.split("+")) == set(names), d.causes[:3]


def test_outliers_that_come_together_are_not_masked():
    rng = np.random.default_rng(3)
    alone, together = rng.choice(1500, 30, replace=False), np.arange(2000, 2010)
    scene, y = Scene(np.zeros(4000), DT, {}), np.zeros(4000)
    y[alone], y[together] = np.nan, np.nan
    told = standins._with_clusters(scene, scene._replace(y=y), 0.01)
    assert_array_equal(np.flatnonzero(np.isnan(told.y)), np.sort(alone))


def stand_in(scene, h):
    return standins.stand_in(scene, account.account(scene, [h]))


def test_a_level_that_is_known_is_taken_away():
    rng = np.random.default_rng(5)
    level = 2.0 * (np.cumsum(rng.random(1000) < 0.01) % 2) - 1.0
    y = level + 0.3 * rng.standard_normal(1000)
    white = sensorid.hypothesis("white_noise", sigma_v=(0.1, 1), bias_sigma=0.0)
    scene = Scene(y, DT, {})
    h = member(scene, white, "random_telegraph")
    plain, (own,) = stand_in(scene, h)
    seen = ~np.isnan(plain.y)
    assert seen.mean() > 0.95 and not own.effects
    assert_allclose(plain.y[seen], (y - level)[seen], atol=0.1)
    # a level that drowns in noise becomes noise of its covariance
    scene = Scene(level + 3.0 * rng.standard_normal(1000), DT, {})
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=(1, 5)),
               "random_telegraph").fixed({("random_telegraph", "size"): 2.0})
    plain, (own,) = stand_in(scene, h)
    assert not np.isnan(plain.y).any()
    assert [one.name for one in own.effects] == ["level_as_noise"]
