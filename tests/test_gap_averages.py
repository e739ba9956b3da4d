"""A record that went through a moving average, against NumPy's convolution."""

import numpy as np
import pytest
from conftest import large
from numpy.testing import assert_allclose
from scipy import signal

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Found, Scene
from sensorlab.gap import readings
from sensorlab.gap.averages import averaged_over, undone

SIMULATOR = [sensorid.hypothesis("random_walk", sigma_w=(0.005, 0.05),
                                 sigma_v=(0.5, 2.0))]
DT, N = 0.01, 3000


def raw(seed, samples=N + 99):
    """White noise on a slow walk."""
    v, w = np.random.default_rng(seed).standard_normal((2, samples))
    return v + np.cumsum(0.02 * w)


def mean_of(y, n):
    return np.convolve(y, np.ones(n) / n, "valid")


@pytest.mark.parametrize("n", [3, 4, 10, 75])
def test_an_average_is_undone_but_for_a_pattern(n):
    y = raw(n, 3000 + n - 1)
    off = undone(mean_of(y, n), n) - y[n - 1:]
    assert_allclose(off[n:], off[:-n], atol=1e-10)
    assert np.std(off) < 3.0 * np.sqrt(n / 3000)
    several = np.stack([mean_of(y, n), 2.0 * mean_of(y, n) + 5.0])
    several[:, 1500:1507] = np.nan
    one, other = undone(several, n)
    assert_allclose(other, 2.0 * one + 5.0, atol=1e-9)
    off = one[1507:] - y[n - 1:][1507:]
    assert np.isnan(one).sum() == 7
    assert_allclose(off[n:], off[:-n], atol=1e-10)
    assert np.isnan(undone(several[:, 1501 - 2 * n:1507], n)).all()


@pytest.mark.parametrize("n", [3, 4, 10, 50, 100])
def test_an_average_is_seen(n):
    y = mean_of(raw(n, 4000 + n), n)
    for own in y, 1e6 + 1e-3 * y, np.round(y, 3 + (n > 50)):
        assert averaged_over(own)[0] == n
    assert averaged_over(np.round(y, 1))[0] == 0    # too few digits to undo it
    y[[700, 701]] = np.nan
    assert averaged_over(y)[0] == (n if n <= 3299 // 40 else 0)


@pytest.mark.parametrize("filtered", [
    signal.butter(2, 0.2), signal.cheby2(4, 40, 0.2), signal.iirnotch(2.0 / 3.0, 30.0),
    (signal.firwin(21, 0.2), [1.0]), ([1.0], [1.0]), ([0.2], [1.0, -0.8])])
def test_other_filters_are_no_average(filtered):
    for seed in range(5):
        y = signal.lfilter(*filtered, raw(seed))[99:]
        assert averaged_over(y) == (0, 0.0)


def test_what_is_held_or_interpolated_is_no_average():
    """Their spectra have the same zeros."""
    y = raw(0)
    assert averaged_over(np.repeat(y[:600], 5)) == (0, 0.0)
    assert averaged_over(np.interp(np.arange(N) / 5.0, np.arange(N), y[:N])) == (0, 0.0)
    line = np.sin(0.4 * np.pi * np.arange(N)) + 0.1 * y[:N]
    assert averaged_over(line) == (0, 0.0)
    assert averaged_over(y[:70]) == (0, 0.0)


def test_the_reading_is_the_mean_of_a_window_that_ends_with_the_sample():
    y, scene = raw(1)[:200], Scene(np.zeros(200), 0.1, {})
    for n in (1, 2, 5, 8):
        read = np.stack([y, y + 1.0])
        CATALOGUE["moving_average"].reading(scene, read, n * 0.1)
        assert_allclose(read[0, n - 1:], mean_of(y, n), atol=1e-12)
        assert_allclose(read[1], read[0] + 1.0, atol=1e-12)


@pytest.mark.parametrize("effect, n", [
    ("none", 10), ("bias_step", 5), *(large(effect, n) for n in (5, 20) for effect in (
        "sinusoid", "outliers", "random_telegraph", "noise_step", "quantization"))])
def test_what_went_through_an_average_is_named_beside_it(effect, n):
    rng, y = np.random.default_rng(n), raw(7)
    t = DT * np.arange(len(y))
    y += dict(none=0.0, bias_step=2.0 * (t > 12.0),
              sinusoid=0.4 * np.sin(2.0 * np.pi * 7.3 * t),
              outliers=15.0 * (rng.random(len(y)) < 0.005) * rng.standard_normal(
                  len(y)), random_telegraph=3.0 * (np.cumsum(
                      rng.random(len(y)) < 1.0 / 150.0) % 2),
              noise_step=1.2 * (t > 14.0) * rng.standard_normal(len(y)),
              quantization=np.round(y) - y)[effect]
    d = sensorlab.diagnose(mean_of(y, n)[-N:], DT, SIMULATOR)
    assert set(d.verdict.split("+")) == {"moving_average", effect} - {"none"}
    values = {one.name: one.values for one in d.found}
    assert values["moving_average"]["window"][0] == pytest.approx(n * DT)
    if effect == "quantization":
        assert values["quantization"]["lsb"][0] == pytest.approx(1.0)
    if effect == "bias_step":
        assert abs(values["bias_step"]["onset"][0] - 12.0 + 0.01 * (99 - n + 1)) < 0.2


@pytest.mark.parametrize("n, verdict, factor", [
    (5, "none", None), (8, "wrong_parameter", 1.6), (1, "wrong_parameter", 0.2)])
def test_an_average_of_the_simulator_is_held_against_a_record(n, verdict, factor):
    first = sensorlab.diagnose(mean_of(raw(1), 5)[-N:], DT, SIMULATOR)
    simulator = sensorlab.augmented(first)
    d = sensorlab.diagnose(mean_of(raw(2), n)[-N:], DT, simulator)
    assert d.verdict == verdict
    if factor:
        values = d.found[0].values
        assert values["parameter"][0] == "moving_average.window"
        assert values["factor"][0] == pytest.approx(factor)


def test_counts_before_an_average_are_told():
    y = mean_of(np.round(2.0 * raw(3)) / 2.0, 4)
    average, counts = readings.readings(Scene(y, DT, {}))
    assert isinstance(average.found, Found)
    assert average.found.values["window"] == pytest.approx(0.04)
    assert counts.found.values["lsb"] == pytest.approx(0.5)
    assert not counts.coarse and not counts.opaque
