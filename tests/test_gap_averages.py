"""A record that went through a moving average, against NumPy's convolution."""

import numpy as np
import pytest
from conftest import large, thorough
from numpy.testing import assert_allclose
from scipy import signal

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Found, Scene
from sensorlab.gap import readings
from sensorlab.gap.averages import Average, averaged_over
from sensorlab.gap.unaveraged import undone

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
        assert averaged_over(own).taps == n
    y[[700, 701]] = np.nan
    assert averaged_over(y).taps == (n if n <= 3299 // 40 else 0)


@pytest.mark.parametrize("counts", [0.02, 0.2, None])
@pytest.mark.parametrize("n", [3, thorough(4), 8, thorough(16), 32])
def test_an_average_that_was_rounded_is_seen(n, counts):
    counts = counts or 16.0 / (n + 16.0)
    lsb = counts / np.sqrt(n)
    for seed in range(3):
        y = lsb * np.round(mean_of(raw(seed, 4000 + n), n) / lsb)
        found = averaged_over(y)
        assert found.taps == n
        assert found.counts == pytest.approx(counts, rel=0.1)


@pytest.mark.parametrize("n, counts", [
    (3, 0.0), (3, 0.2), (5, 0.02), (8, 0.2), (16, 0.0), (16, 0.1)])
def test_an_average_of_averages_is_seen(n, counts):
    """A triangular window, as signal.windows has it."""
    window = signal.windows.triang(2 * n - 1)
    window /= window.sum()
    for seed in range(3):
        y = np.convolve(raw(seed, 4000 + 2 * n), window, "valid")
        lsb = counts * np.linalg.norm(window)
        found = averaged_over(lsb * np.round(y / lsb) if lsb else y)
        assert (found.taps, found.times) == (n, 2)
        assert found.counts == pytest.approx(counts, rel=0.1)


@pytest.mark.parametrize("n, times, counts", [
    (4, 1, 1.0), (8, 1, 0.2), (8, 1, 1.0), (16, 1, 0.5), (5, 2, 0.3), (8, 2, 0.1)])
def test_what_is_undone_of_a_rounded_average_is_white(n, times, counts):
    """Its spectrum is that of white noise, and of what rounding adds to it."""
    v, window = np.random.default_rng(n).standard_normal((40, 4000)), np.ones(n) / n
    if times == 2:
        window = np.convolve(window, window)
    lsb = counts * np.linalg.norm(window)
    y = lsb * np.round(np.array([np.convolve(one, window, "valid") for one in v]) / lsb)
    own = undone(y, n, times, counts)
    assert np.isnan(own).sum() == 40 * len(window)
    f, power = signal.welch(own[:, len(window):], nperseg=256)
    level = power.mean(0)[2:-2] / 2.0
    expected = 1.0 + lsb**2 / 12.0
    assert_allclose(level, expected, rtol=0.12)    # of 40 * 30 segments: 3 %
    assert level.mean() == pytest.approx(expected, rel=0.02)


def test_what_is_slow_keeps_its_size_where_a_rounded_average_is_undone():
    y = mean_of(0.01 * np.arange(2000.0), 8)
    own = undone(y, 8, counts=0.5)
    assert_allclose(np.diff(own[400:]), 0.01, atol=1e-6)


@pytest.mark.parametrize("filtered", [
    signal.butter(2, 0.2), signal.cheby2(4, 40, 0.2), signal.iirnotch(2.0 / 3.0, 30.0),
    (signal.firwin(21, 0.2), [1.0]), ([1.0], [1.0]), ([0.2], [1.0, -0.8])])
def test_other_filters_are_no_average(filtered):
    for seed in range(5):
        y = signal.lfilter(*filtered, raw(seed))[99:]
        assert averaged_over(y) == Average()


def test_what_is_held_or_interpolated_is_no_average():
    """Their spectra have the same zeros."""
    y = raw(0)
    between = np.interp(np.arange(N) / 5.0, np.arange(N), y[:N])
    line = np.sin(0.4 * np.pi * np.arange(N)) + 0.1 * y[:N]
    for own in np.repeat(y[:600], 5), between, line, y[:70]:
        assert averaged_over(own) == Average()
        for lsb in (0.01, 0.1, 0.3):
            assert averaged_over(lsb * np.round(own / lsb)) == Average()


def test_the_reading_is_the_mean_of_a_window_that_ends_with_the_sample():
    y, scene = raw(1)[:200], Scene(np.zeros(200), 0.1, {})
    for n in (1, 2, 5, 8):
        read = np.stack([y, y + 1.0])
        CATALOGUE["moving_average"].reading(scene, read, n * 0.1)
        assert_allclose(read[0, n - 1:], mean_of(y, n), atol=1e-12)
        assert_allclose(read[1], read[0] + 1.0, atol=1e-12)


@pytest.mark.parametrize("effect, n", [
    ("none", 10), large("bias_step", 5), *(
        thorough(effect, n) for n in (5, 20) for effect in (
            "sinusoid", "outliers", "random_telegraph", "noise_step",
            "quantization"))])
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


@pytest.mark.parametrize("effect, n", [("none", 8), *(
    thorough(effect, n) for effect in ("bias_step", "sinusoid", "noise_step")
    for n in (4, 16))])
def test_what_went_through_an_average_that_was_rounded_is_named(effect, n):
    rng, y = np.random.default_rng(n), raw(7)
    t = DT * np.arange(len(y))
    y += dict(none=0.0, bias_step=2.0 * (t > 12.0),
              sinusoid=0.4 * np.sin(2.0 * np.pi * 7.3 * t),
              noise_step=1.2 * (t > 14.0) * rng.standard_normal(len(y)))[effect]
    lsb = 0.7 / np.sqrt(n)
    d = sensorlab.diagnose(lsb * np.round(mean_of(y, n)[-N:] / lsb), DT, SIMULATOR)
    assert set(d.verdict.split("+")) == {"moving_average", "quantization", effect} - {
        "none"}
    values = {one.name: one.values for one in d.found}
    assert values["moving_average"]["window"][0] == pytest.approx(n * DT)
    assert values["quantization"]["lsb"][0] == pytest.approx(lsb)
    assert d.closure.closed > 0.98


@pytest.mark.parametrize("n, verdict, factor, counts", [
    (5, "none", None, 0.1), (8, "wrong_parameter", 1.6, 0.0),
    large(1, "wrong_parameter", 0.2, 0.1), *(thorough(*others) for others in (
        (5, "none", None, 0.0), (8, "wrong_parameter", 1.6, 0.1),
        (1, "wrong_parameter", 0.2, 0.0)))])
def test_an_average_of_the_simulator_is_held_against_a_record(
        n, verdict, factor, counts):
    def record(seed, n):
        y = mean_of(raw(seed), n)[-N:]
        return counts * np.round(y / counts) if counts else y
    first = sensorlab.diagnose(record(1, 5), DT, SIMULATOR)
    simulator = sensorlab.augmented(first)
    d = sensorlab.diagnose(record(2, n), DT, simulator)
    assert d.verdict == verdict
    if factor:
        values = d.found[0].values
        assert values["parameter"][0] == "moving_average.window"
        assert values["factor"][0] == pytest.approx(factor)


@pytest.mark.large
@pytest.mark.parametrize("counts", [0.0, 0.05])
def test_the_mean_of_means_is_named_and_held_against_a_record(counts):
    def record(seed, times):
        y = mean_of(raw(seed), 5)
        y = (mean_of(y, 5) if times == 2 else y)[-N:]
        return counts * np.round(y / counts) if counts else y
    first = sensorlab.diagnose(record(1, 2), DT, SIMULATOR)
    assert set(first.verdict.split("+")) <= {"moving_average", "quantization"}
    values = first.found[0].values
    assert (values["window"][0], values["times"][0]) == (pytest.approx(0.05), 2)
    simulator = sensorlab.augmented(first)
    assert sensorlab.diagnose(record(2, 2), DT, simulator).verdict == "none"
    d = sensorlab.diagnose(record(3, 1), DT, simulator)
    assert d.verdict == "wrong_parameter"
    values = d.found[0].values
    assert values["parameter"][0] == "moving_average.times"
    assert values["factor"][0] == pytest.approx(0.5)


@pytest.mark.parametrize("times", [1, 2])
def test_counts_before_an_average_are_told(times):
    y = np.round(2.0 * raw(3)) / 2.0
    for _ in range(times):
        y = mean_of(y, 4)
    average, counts = readings.readings(Scene(y, DT, {}))
    assert isinstance(average.found, Found)
    assert average.found.values == dict(window=pytest.approx(0.04), times=times)
    assert not average.found.variant
    assert counts.found.values["lsb"] == pytest.approx(0.5)
    assert not counts.coarse and not counts.opaque


def of_simulator(taps, lsb, variant):
    return [Found(CATALOGUE["moving_average"], variant=variant,
                  values=dict(window=taps * DT, times=1)),
            Found(CATALOGUE["quantization"], values=dict(lsb=lsb))]


@pytest.mark.parametrize("lsb", [0.02, 0.08, 0.3])
@pytest.mark.parametrize("taps", [2, 3, 5])
@pytest.mark.parametrize("variant", ["", "before the rounding"])
def test_the_average_and_the_counts_of_a_simulator_are_no_gap(taps, lsb, variant):
    """Also those of two samples, and counts that are too fine, which nothing shows."""
    y = raw(4)
    y = mean_of(lsb * np.round(y / lsb), taps) if not variant else (
        lsb * np.round(mean_of(y, taps) / lsb))
    scene = Scene(y[-N:], DT, {})
    had, seen = readings.compared(scene, of_simulator(taps, lsb, variant))
    assert not any(one.log_bayes or one.instead for one in seen)
    assert {one.found.name for one in seen} == {one.found.name for one in had}
    # nor does what is undone gather the rounding error
    undone_too = readings.as_read(scene, seen).y
    assert np.nanstd(np.diff(undone_too)) < 1.7 * np.std(np.diff(raw(4)))


@pytest.mark.parametrize("variant", ["", "before the rounding"])
def test_counts_that_an_average_has_not_are_wrong(variant):
    scene = Scene(mean_of(raw(5), 4)[-N:], DT, {})
    _, seen = readings.compared(scene, of_simulator(4, 0.5, variant))
    (wrong,) = [one for one in seen if one.instead]
    assert wrong.found.name == "quantization" and wrong.factor == 0.0
    fine = 0.02 * np.round(raw(5) / 0.02)
    fine = mean_of(fine, 4) if not variant else 0.02 * np.round(mean_of(fine, 4) / 0.02)
    _, seen = readings.compared(Scene(fine[-N:], DT, {}), of_simulator(4, 0.5, variant))
    (wrong,) = [one for one in seen if one.instead]
    assert wrong.factor == pytest.approx(0.04)


@pytest.mark.large
def test_an_average_of_two_samples_beside_its_simulator_is_none():
    for seed, (lsb, variant) in enumerate((
            (0.02, "before the rounding"), (0.3, "before the rounding"), (0.3, ""))):
        y = raw(seed + 6)
        y = mean_of(lsb * np.round(y / lsb), 2) if not variant else (
            lsb * np.round(mean_of(y, 2) / lsb))
        simulator = sensorlab.Simulator(SIMULATOR, [of_simulator(2, lsb, variant)])
        assert sensorlab.diagnose(y[-N:], DT, simulator).verdict == "none", variant
