"""Effects that stand far above the noise: what is large has a sharp posterior, which a
coarse search misses, and may lie beyond what records usually show.
"""

import numpy as np
import pytest
from conftest import large, thorough

import sensorid
import sensorlab

N, DT = 3000, 0.01
TIME = DT * np.arange(N)
SIMULATOR = [sensorid.hypothesis("random_walk", sigma_w=(0.01, 0.05),
                                 sigma_v=(0.5, 2.0))]


def diagnosed(more=0.0, white=1.0, walk=0.02, missing=slice(0), n=N):
    rng = np.random.default_rng(7)
    y = white * rng.standard_normal(n) + np.cumsum(walk * rng.standard_normal(n)) + more
    y[missing] = np.nan
    return sensorlab.diagnose(y, DT, SIMULATOR)


def since(onset):
    return np.maximum(TIME - onset, 0.0)


def spikes(count, size):
    rng = np.random.default_rng(9)
    result = np.zeros(N)
    result[rng.choice(N, count, replace=False)] = size * rng.uniform(0.5, 1.0, count)
    return result


def noise_in(spans, size):
    inside = np.any([(TIME >= a) & (TIME < b) for a, b in spans], axis=0)
    return inside * size * np.random.default_rng(9).standard_normal(N)


STRONG = dict(
    single=("outliers", dict(more=spikes(1, 3e4))),
    few=("outliers", dict(more=spikes(5, 1e5))),
    louder=("noise_step", dict(white=np.where(TIME > 11.0, 300.0, 1.0))),
    restless=("walk_step", dict(walk=np.where(TIME > 11.0, 6.0, 0.02))),
    bursts=("noise_bursts", dict(more=noise_in([(5, 6), (11, 13), (24, 24.5)], 1e3))),
    telegraph=("random_telegraph", dict(more=1e3 * (np.searchsorted(
        [2.1, 5.4, 6.9, 9.2, 13.3, 14.1, 17.8, 21.2, 24.9, 26.0], TIME) % 2))),
    half_sine=("pulse", dict(more=1e3 * np.sin(np.clip(
        np.pi * (TIME - 12.003) / 2.4, 0.0, np.pi)))),
    gradual=("gradual_step", dict(more=-1e3 * np.expm1(-since(12.003) / 0.9))),
    decaying=("pulse", dict(more=1e3 * (TIME >= 12.0) * np.exp(-since(12.0) / 0.9))),
    ringing=("ringing", dict(more=1e3 * (TIME >= 12.0) * np.exp(
        -since(12.0) / 0.9) * np.cos(40.0 * since(12.0)))),
    vibration=("vibration_burst", dict(more=1e3 * np.sin(np.clip(
        np.pi * (TIME - 12.003) / 2.4, 0.0, np.pi))**2 * np.cos(90.0 * TIME))))


LARGE = ["few", "louder", "half_sine"]


@pytest.mark.parametrize("kind", [
    large(kind) if kind in LARGE else thorough(kind) for kind in STRONG])
def test_what_is_far_above_the_noise_is_named_alone(kind):
    effect, made = STRONG[kind]
    assert diagnosed(**made).verdict == effect


@pytest.mark.parametrize("at, size", [
    (0, 490.0), thorough(-1, 490.0), thorough(0, 40.0), thorough(-1, 40.0)])
def test_what_a_log_begins_or_ends_with_is_an_outlier(at, size):
    """Two levels fit it as well: what they cost counts in a simulator that has no room
    for it, too.
    """
    more = np.zeros(N)
    more[at] = -size
    assert diagnosed(more).verdict == "outliers"


@pytest.mark.parametrize("at", [60, thorough(N - 60)])
def test_a_sample_is_an_outlier_however_far_off_it_is(at):
    """A normal score ends at 37, by which two steps seem likelier."""
    more = np.zeros(N)
    more[at] = -1000.0
    assert diagnosed(more).verdict == "outliers"


@pytest.mark.parametrize("gap", [slice(0, 900), large(slice(800, 1300))])
def test_one_odd_sample_after_a_gap_is_no_rest_of_something_beyond_measure(gap):
    odd = np.zeros(N)
    odd[gap.stop] = 8.0
    for one in diagnosed(odd, missing=gap).found:
        assert one.values.get("size", (0.0,))[0] < 40.0


def test_a_transient_is_sought_of_which_the_first_sample_shows_a_thousandth():
    scene = sensorlab.Scene(np.append(np.full(700, np.nan), np.zeros(300)), 1.0, {})
    (tau,) = sensorlab.CATALOGUE["turn_on_transient"].parameters(scene)
    assert tau.low == 100.0


@pytest.mark.thorough
def test_a_vibration_for_minutes_of_a_long_record_is_a_burst_of_it():
    n = 60_000
    t = DT * np.arange(n)
    more = 1.2 * np.sin(np.clip(np.pi * (t - 200.0) / 180.0, 0.0, np.pi))**2 * np.cos(
        100.0 * t)
    assert diagnosed(more, n=n).verdict == "vibration_burst"
