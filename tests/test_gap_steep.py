"""A low-pass of third order or more is seen, filled in, named and held against a
record; filters by scipy, records by hand.
"""

import numpy as np
import pytest
from conftest import large, thorough
from numpy.testing import assert_allclose, assert_array_equal
from scipy import signal

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Scene
from sensorlab.gap.readings import readings
from sensorlab.gap.steep import Steep, filled, log_odds_of_another, steep_low_pass

N, DT = 4000, 0.01
SIMULATOR = [sensorid.hypothesis("white_noise", sigma_v=(0.3, 3.0))]


def noise(seed, n=N + 1000):
    return np.random.default_rng(seed).standard_normal(n)


def low_passed(y, poles, cutoff):
    return signal.sosfilt(signal.butter(poles, 2.0 * cutoff, output="sos"), y)[-N:]


def rounded(y, lsb):
    return lsb * np.round(y / lsb) if lsb else y


FILTERS = dict(    # of as many poles as their edges may have, least and most
    third=(lambda y, f: low_passed(y, 3, f), 3, 3),
    fourth=(lambda y, f: low_passed(y, 4, f), 4, 5),
    eighth=(lambda y, f: low_passed(y, 8, f), 7, 9),
    both_ways=(lambda y, f: signal.sosfiltfilt(
        signal.butter(4, 2.0 * f, output="sos"), y)[-N:], 5, 8),
    taps=(lambda y, f: signal.lfilter(signal.firwin(121, 2.0 * f), 1.0, y)[-N:], 8, 20),
    elliptic=(lambda y, f: signal.sosfilt(signal.ellip(
        5, 0.3, 50.0, 2.0 * f, output="sos"), y)[-N:], 5, 20))


@pytest.mark.parametrize("cutoff, counts", [
    (0.06, 0.0), (0.3, 0.3), *(thorough(*others) for others in (
        (0.06, 0.1), (0.06, 0.3), (0.12, 0.0), (0.12, 0.1), (0.12, 0.3), (0.3, 0.0),
        (0.3, 0.1)))])
@pytest.mark.parametrize("name", FILTERS)
def test_a_steep_low_pass_is_seen(name, cutoff, counts):
    through, fewest, most = FILTERS[name]
    y = through(noise(1), cutoff)
    seen = steep_low_pass(100.0 + rounded(y, counts * y.std()))
    assert seen.cutoff == pytest.approx(cutoff, rel=0.15)
    assert fewest <= seen.poles <= most and seen.log_bayes > 15.0
    again = through(noise(2), cutoff)
    assert log_odds_of_another(again, seen.cutoff, seen.poles) < 10.0
    assert log_odds_of_another(again, 1.3 * seen.cutoff, seen.poles) > 20.0


def markov(a):
    return signal.lfilter([1.0], [1.0, -a], noise(4))


@pytest.mark.parametrize("y", [
    noise(3), low_passed(noise(3), 1, 0.1), low_passed(noise(3), 2, 0.1),
    low_passed(noise(3), 2, 0.03), signal.lfilter([0.3], [1.0, -0.7], noise(3)),
    signal.lfilter([1.0], [1.0, -1.5, 0.9], noise(3)),    # a resonance
    low_passed(noise(3), 2, 0.1) + 0.1 * markov(0.99)[-N:],
    np.cumsum(noise(3)), np.cumsum(np.cumsum(noise(3))), np.diff(noise(3)),
    noise(3) + 3.0 * markov(0.999), np.convolve(noise(3), np.full(8, 0.125), "valid"),
    noise(3)[:300]])
def test_what_is_no_steep_low_pass_is_none(y):
    for lsb in (0.0, 0.1 * np.diff(y).std(), 0.5 * np.diff(y).std()):
        assert steep_low_pass(rounded(y, lsb)) == Steep()


@pytest.mark.parametrize("name, y", [
    ("repeated_samples", np.repeat(noise(3)[:1000], 4)), ("interpolated_samples", (
        np.interp(np.arange(N), np.arange(0, N, 5), noise(3)[:800]))),
    ("moving_average", np.convolve(np.convolve(noise(3), np.full(
        8, 0.125)), np.full(8, 0.125), "valid")[:N])])
def test_what_has_zeros_of_its_own_is_what_it_is(name, y):
    for lsb in (0.0, 0.01):
        found, *_ = readings(Scene(rounded(y, lsb), DT, {}))
        assert found.found.name == name


def test_neither_gaps_nor_what_stands_out_hide_it():
    y, rng = low_passed(noise(5), 4, 0.1), np.random.default_rng(0)
    y[1200:1300] = np.nan
    assert steep_low_pass(y).poles == 4
    y[rng.random(N) < 0.01] = np.nan
    y[[400, 1500, 2900]] = 10.0, -8.0, 50.0
    assert steep_low_pass(y).poles == 4
    whole = filled(y[None], 0.1, 4)[0]
    assert_array_equal(np.isnan(whole), np.isnan(y))


def test_what_it_took_of_white_noise_is_filled_in():
    # the power of 40 records together, in 20 bands: by chance +- 0.016
    y = np.stack([2.0 * low_passed(noise(seed), 4, 0.12) for seed in range(40)])
    y += 0.1 * np.random.default_rng(0).standard_normal(y.shape)    # behind it
    power = np.mean(np.abs(np.fft.rfft(filled(y, 0.12, 4)))**2 / N, 0)[1:]
    for band in np.array_split(power, 20):
        assert band.mean() == pytest.approx(4.0, rel=0.12)
    assert power.mean() == pytest.approx(4.0, rel=0.04)


def test_what_is_filled_in_hangs_on_the_record_alone():
    y = np.stack([low_passed(noise(seed), 4, 0.12) for seed in range(3)])
    together = filled(y, 0.12, 4)
    assert_array_equal(filled(y[1:2], 0.12, 4)[0], together[1])
    added = together - y
    assert abs(np.corrcoef(added)[0, 1]) < 0.1
    assert_array_equal(filled(y, 0.5, 4), y)


def test_it_is_as_strong_as_a_simulator_says_unless_the_record_contradicts():
    y = low_passed(noise(6), 4, 0.12)[None]
    free, within, beyond = (np.std(filled(y, 0.12, 4, white) - y) for white in (
        None, (1.0, 1.0), (2.0, 2.0)))
    # 320 of 2000 frequencies tell of its variance
    assert free == pytest.approx(within, rel=0.1) and free != within
    assert beyond == free
    assert within == pytest.approx(np.sqrt(1.0 - 2.0 * 0.12), rel=0.03)


def test_what_is_filled_in_changes_as_the_noise_does():
    size = np.where(np.arange(2 * N) < 1.3 * N, 1.0, 3.0)
    y = np.stack([signal.sosfilt(signal.butter(4, 0.24, output="sos"), size * noise(
        seed, 2 * N)) for seed in range(20)])
    whole = filled(y, 0.12, 4)
    for part, variance in ((slice(0, N), 1.0), (slice(int(1.4 * N), None), 9.0)):
        power = np.mean(np.abs(np.fft.rfft(whole[:, part]))**2, 0)[1:] / len(y[0, part])
        for band in np.array_split(power, 10):
            assert band.mean() == pytest.approx(variance, rel=0.12)


def test_the_reading_is_a_butterworth_filter_at_rest_at_first():
    y, scene = noise(7)[:300], Scene(np.zeros(300), 0.1, {})
    read = np.stack([y, y + 5.0])
    CATALOGUE["steep_low_pass"].reading(scene, read, cutoff=1.5, poles=4)
    sections = signal.butter(4, 1.5, fs=10.0, output="sos")
    expected, _ = signal.sosfilt(sections, y, zi=signal.sosfilt_zi(sections) * y[0])
    assert_allclose(read[0], expected, atol=1e-9)
    assert_allclose(read[1], read[0] + 5.0, atol=1e-9)
    CATALOGUE["steep_low_pass"].reading(scene, read, cutoff=5.0, poles=4)
    assert_allclose(read[0], expected, atol=1e-9)


@pytest.mark.parametrize("effect, counts", [
    *(large(effect, 0.2) for effect in ("bias_step", "none", "sinusoid", "noise_step")),
    *(thorough(effect, 0.0) for effect in ("none", "sinusoid", "noise_step")),
    thorough("random_walk", 0.0), thorough("random_walk", 0.2)])
def test_it_is_named_alone_beside_what_passes_it(effect, counts):
    rng, t = np.random.default_rng(8), DT * np.arange(N)
    y = noise(9)
    y[-N:] += dict(none=0.0, bias_step=0.5 * (t > 22.0),
                   sinusoid=0.3 * np.sin(2.0 * np.pi * 3.3 * t),
                   noise_step=1.5 * (t > 25.0) * rng.standard_normal(N),
                   random_walk=np.cumsum(0.03 * rng.standard_normal(N)))[effect]
    d = sensorlab.diagnose(rounded(low_passed(y, 4, 0.12), counts), DT, SIMULATOR)
    lattice = {"quantization"} if counts else set()
    assert set(d.verdict.split("+")) == {"steep_low_pass", effect, *lattice} - {"none"}
    values = {one.name: one.values for one in d.found}
    assert values["steep_low_pass"]["cutoff"][0] == pytest.approx(12.0, rel=0.1)
    assert d.closure.closed > 0.9
    if effect == "bias_step":
        assert abs(values["bias_step"]["onset"][0] - 22.0) < 1.0


@pytest.mark.large
def test_samples_that_are_stuck_behind_it_are_named():
    y = low_passed(noise(14), 4, 0.12)
    y[2000:2040] = y[2000]
    d = sensorlab.diagnose(y, DT, SIMULATOR)
    assert set(d.verdict.split("+")) == {"steep_low_pass", "stuck"}


@pytest.mark.parametrize("counts", [large(0.0), thorough(0.2)])
def test_a_low_pass_of_the_simulator_is_held_against_a_record(counts):
    def record(seed, poles=4, cutoff=0.12):
        return rounded(low_passed(noise(seed), poles, cutoff), counts)
    first = sensorlab.diagnose(record(10), DT, SIMULATOR)
    simulator = sensorlab.augmented(first)
    assert sensorlab.diagnose(record(11), DT, simulator).verdict == "none"
    for changed, symbol, factor in ((dict(cutoff=0.2), "cutoff", 0.2 / 0.12),
                                    (dict(poles=16), "poles", 4.0)):
        d = sensorlab.diagnose(record(12, **changed), DT, simulator)
        assert d.verdict == "wrong_parameter"
        values = d.found[0].values
        assert values["parameter"][0] == f"steep_low_pass.{symbol}"
        assert values["factor"][0] == pytest.approx(factor, rel=0.3)
    values = sensorlab.diagnose(noise(13), DT, simulator).found[0].values
    assert values["parameter"][0] == "steep_low_pass.cutoff"    # it has none
    assert values["factor"][0] == pytest.approx(0.5 / 0.12, rel=0.1)
