"""Effects that are seen in the values themselves."""

import numpy as np
import pytest
from conftest import DT, MODEL, WHITE, large, thorough
from numpy.testing import assert_allclose
from scipy.signal import butter, lfilter
from scipy.stats import norm

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Found, Scene, Simulator
from sensorlab.gap import catalogue, clipping, readings, repeats, values, words
from sensorlab.gap.codes import uneven_codes


def test_readings_are_seen_and_what_is_none_is_not():
    rng = np.random.default_rng(9)
    y = np.cumsum(0.05 * rng.standard_normal(3000)) + 0.5 * rng.standard_normal(3000)
    for clean in (y, np.round(y, 4), y.astype(np.float32).astype(float)):
        assert readings.readings(Scene(clean, DT, {})) == ()
    lattice = 0.3 * np.round(y / 0.3) + 0.1
    (one,) = readings.readings(Scene(lattice, DT, {}))
    assert one.found.name == "quantization"
    assert one.found.values["lsb"] == pytest.approx(0.3)
    (one,) = readings.readings(Scene(np.clip(y, -1.0, 1.2), DT, {}))
    assert one.found.name == "saturation" and one.found.values["limits"] == [-1.0, 1.2]
    stuck = y.copy()
    stuck[700:730] = stuck[700]
    (one,) = readings.readings(Scene(stuck, DT, {}))
    assert one.found.name == "stuck" and one.found.values["spans"] == [[700.0, 30]]
    held = lattice.copy()
    held[700:760] = held[700]
    assert [r.found.name for r in readings.readings(Scene(held, DT, {}))] == [
        "stuck", "quantization"]


def test_only_clipping_and_a_coarse_lattice_mislead_the_fit():
    y = 0.5 * np.random.default_rng(9).standard_normal(3000)
    stuck = y.copy()
    stuck[700:730] = stuck[700]
    for shown, misled in ((0.5 * np.round(y / 0.5), False), (np.round(y), True),
                          (np.clip(y, -1.0, 1.2), True), (stuck, False)):
        (one,) = readings.readings(Scene(shown, DT, {}))
        assert readings.misleads(one, 0.5) == misled


@pytest.mark.parametrize("shape", [lambda t: 0.37 * (t > 0.6), lambda t: 1.7 * t])
def test_values_meet_by_chance_on_a_lattice_that_was_moved(shape):
    rng = np.random.default_rng(9)
    y = 0.3 * np.round(0.5 * rng.standard_normal(3000) / 0.3)
    y += shape(np.linspace(0.0, 1.0, 3000))
    (one,) = readings.readings(Scene(y, DT, {}))
    assert one.moved and one.found.values["lsb"] == pytest.approx(0.3, rel=1e-4)
    y[700:730] = y[700]
    stuck, _ = readings.readings(Scene(y, DT, {}))
    assert stuck.found.values["spans"] == [[700.0, 30]]


def test_values_meet_by_chance_in_the_part_that_nothing_was_added_to():
    rng = np.random.default_rng(10)
    y = 0.06 * np.round(0.5 * rng.standard_normal(4000) / 0.06)
    y[2000:] += 0.3 * rng.standard_normal(2000)
    assert values.runs(np.diff(y) == 0.0)[1].max() >= 2    # by chance
    assert readings.readings(Scene(y, DT, {})) == ()
    y[700:730] = y[700]
    (stuck,) = readings.readings(Scene(y, DT, {}))
    assert stuck.found.values["spans"] == [[700.0, 30]]


@pytest.mark.parametrize("lsb, own, verdict", [
    (0.4, 0.4, "none"), (0.2, 0.4, "wrong_parameter"), (0.0, 0.4, "wrong_parameter"),
    (0.0, 0.01, "none"), (0.4, None, "quantization")])
def test_rounding_of_the_simulator_is_compared_with_that_of_the_record(
        lsb, own, verdict):
    y = np.random.default_rng(3).normal(size=2000)
    y = lsb * np.round(y / lsb) if lsb else y
    known = [Found(CATALOGUE["quantization"], values=dict(lsb=own))] * bool(own)
    d = sensorlab.diagnose(y, DT, Simulator(WHITE, (tuple(known),)))
    assert d.verdict == verdict
    if verdict == "wrong_parameter":
        values = d.found[0].values
        assert values["parameter"][0] == "quantization.lsb"
        assert values["factor"][0] == pytest.approx(lsb / own)
        assert d.closure.closed > 0.5
    rounded = [one.values["lsb"] for one in sensorlab.augmented(d).effects[0]]
    assert rounded == pytest.approx([lsb or own] if lsb or own == 0.01 else [])


def test_what_else_is_missing_is_found_beside_a_wrong_rounding():
    y = np.random.default_rng(4).normal(size=2000) + np.sin(0.44 * np.arange(2000))
    own = Found(CATALOGUE["quantization"], values=dict(lsb=0.8))
    d = sensorlab.diagnose(y, DT, Simulator(WHITE, ((own,),)))
    assert d.verdict == "wrong_parameter+sinusoid"
    assert all(part.share > 0.1 and part.stays for part in d.parts)


@pytest.mark.large
def test_other_units_are_wrong_in_the_noises_and_in_the_rounding():
    rng = np.random.default_rng(5)
    y = np.cumsum(0.02 * rng.normal(size=3000)) + rng.normal(size=3000)
    own = Found(CATALOGUE["quantization"], values=dict(lsb=0.4))
    h = sensorid.hypothesis("random_walk", sigma_w=(0.01, 0.04), sigma_v=(0.8, 1.2))
    d = sensorlab.diagnose(9.80665e-3 * 0.4 * np.round(y / 0.4), DT,
                           Simulator((h,), ((own,),)))
    rounding, noises = d.found
    assert rounding.values["factor"][0] == pytest.approx(9.80665e-3)
    assert noises.values["parameter"][0] == "all"
    assert words.headline(d).startswith(
        "The simulator lacks the right lsb of its quantization and the right scale of "
        "all its standard deviations (")


def test_a_record_whose_samples_do_not_repeat_has_another_rate_than_its_simulator():
    y = np.random.default_rng(5).normal(size=2000)
    own = Found(CATALOGUE["repeated_samples"],
                values=dict(frequency=0.67 / DT, phase=0.0))
    d = sensorlab.diagnose(y, DT, Simulator(WHITE, ((own,),)))
    assert d.verdict == "wrong_parameter" and d.closure.closed > 0.8
    assert d.found[0].values == dict(parameter=("repeated_samples.frequency", 0.0),
                                     factor=(pytest.approx(1.0 / 0.67), 0.0))


def polled(y, rate, phase):
    """What a logger reads of a sensor that gives `rate` samples to each of its own."""
    last, result, k = None, [], -1
    for i, value in enumerate(y):
        if int(rate * i + phase) != k:
            k, last = int(rate * i + phase), value
        result.append(last)
    return np.array(result)


@pytest.mark.parametrize("rate, lsb", [
    (0.67, 0.0), (0.5, 0.0), (1 / 3, 0.0), (0.104, 0.0), (0.98, 0.0), (0.9303, 0.0),
    (0.67, 0.2), (0.5, 0.2), (0.104, 0.2), (0.9303, 0.2), (0.9859, 0.1),
    (0.9767, 0.06), (0.67, 0.7), (0.5, 0.7), (0.9, 0.7)])
def test_a_sensor_that_is_polled_too_fast_has_its_rate_read(rate, lsb):
    rng = np.random.default_rng(5)
    y = np.cumsum(0.05 * rng.standard_normal(3000)) + 0.5 * rng.standard_normal(3000)
    y = lsb * np.round(y / lsb) if lsb else y
    scene = Scene(polled(y, rate, 0.3), 0.01, {})
    one, *others = readings.readings(scene)
    assert one.found.name == "repeated_samples"
    assert [r.found.name for r in others] == ["quantization"] * (lsb > 0)
    assert one.found.values["frequency"] == pytest.approx(100.0 * rate, rel=1e-3)
    expected = np.append(False, np.diff(np.floor(rate * np.arange(3000) + 0.3)) == 0)
    assert np.mean(one.masked != expected) < 0.005
    again = y.copy()    # the simulator repeats as the record does
    catalogue.repeat(scene, again, **one.found.values)
    assert np.mean(again != scene.y) < 0.01


@pytest.mark.large
def test_what_moves_through_coarse_counts_repeats_nothing():
    """Its ties are as regular as those of a sensor that is polled too fast."""
    rng, t = np.random.default_rng(3), np.arange(4000)
    for size, frequency in ((5.0, 0.0816), (2.3, 0.1377), (1.0, 0.1826), (2.3, 0.0928),
                            (1.0, 0.4633), (5.0, 0.003)):
        for noise in (0.05, 0.15):
            y = np.round(size * np.sin(2.0 * np.pi * frequency * t + 1.0)
                         + noise * rng.standard_normal(4000) + rng.uniform())
            assert "repeated_samples" not in [
                r.found.name for r in readings.readings(Scene(y, DT, {}))]


@pytest.mark.parametrize("rate", [
    large(0.0), thorough(1.0), thorough(3.0), large(7.6), thorough(12.0)])
def test_an_angle_in_counts_repeats_nothing(rate):
    for seed in range(5):
        step = np.random.default_rng(seed).normal(rate, 7.0, 2000)
        y = np.cumsum(np.round(step))
        assert "repeated_samples" not in [
            r.found.name for r in readings.readings(Scene(y, DT, {}))]


@pytest.mark.parametrize("times", [2, 3, 7, 8, 9, 10, 12, 16, 25, 40])
def test_a_sensor_of_which_every_value_is_logged_so_often_has_its_rate_read(times):
    for samples in (2000, 6000):
        y = np.repeat(np.random.default_rng(times).standard_normal(
            samples // times + 1), times)[:samples]
        (one,) = readings.readings(Scene(y, 0.01, {}))
        assert one.found.values["frequency"] == pytest.approx(100.0 / times, rel=1e-3)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [11, 12])
def test_a_factor_beside_counts_of_three_sigmas_is_what_it_is(seed):
    rng = np.random.default_rng(seed)
    y = 0.3 + rng.standard_normal(2000) + 0.01 * np.cumsum(rng.standard_normal(2000))
    simulator = sensorid.hypothesis("random_walk", sigma_w=(0.003, 0.014),
                                    sigma_v=(0.97, 1.03), bias_sigma=1.0)
    d = sensorlab.diagnose(np.round(y / 3.0), 0.01, [simulator])
    assert d.verdict == "quantization+wrong_parameter"
    factor, sd = d.found[1].values["factor"]
    assert abs(factor - 1.0 / 3.0) < 3.0 * sd < 0.05


@pytest.mark.large
def test_a_dead_zone_repeats_nothing():
    rng = np.random.default_rng(1)
    y = rng.standard_normal(2000) + np.cumsum(0.02 * rng.standard_normal(2000))
    y[np.abs(y) < 0.4] = 0.0
    assert np.sum(np.diff(y) == 0.0) > 50
    assert not readings.readings(Scene(y, DT, {}))


@pytest.mark.large
def test_a_sensor_that_is_polled_too_fast_is_named_beside_its_noise():
    y = sensorid.simulate(MODEL[:1], DT, 2000, seed=8).error[0]
    onset = 8.0 * (np.arange(2000) >= 900)
    d = sensorlab.diagnose(polled(y + onset, 0.67, 0.3), DT, MODEL)
    assert set(d.verdict.split("+")) == {"repeated_samples", "bias_step"}
    d = sensorlab.diagnose(polled(y, 0.67, 0.3), DT, sensorlab.augmented(d))
    assert "repeated_samples" not in d.verdict    # the simulator has it


def held_at_random(y, share, rng):
    """Values that are those before them once more with a probability."""
    y = y.copy()
    for i in np.flatnonzero(rng.random(len(y)) < share):
        y[i] = y[i - 1] if i else y[i]
    return y


@pytest.mark.parametrize("share, lsb", [
    (0.02, 0.0), large(0.1, 0.06),
    thorough(0.3, 0.0), thorough(0.1, 0.15), thorough(0.25, 0.2)])
def test_samples_that_repeat_at_random_are_read(share, lsb):
    rng = np.random.default_rng(7)
    y = 0.5 * rng.standard_normal(4000) + np.cumsum(0.05 * rng.standard_normal(4000))
    y = held_at_random(lsb * np.round(y / lsb) if lsb else y, share, rng)
    one, *others = readings.readings(Scene(y, DT, {}))
    assert one.found.name == "repeated_samples" and one.found.values["phase"] is None
    assert [r.found.name for r in others] == ["quantization"] * (lsb > 0)
    sd = np.sqrt(np.mean(np.diff(y) == 0.0) / 4000)
    assert one.found.values["frequency"] == pytest.approx(
        (1.0 - share) / DT, abs=4.0 * sd)
    d = sensorlab.diagnose(y, DT, MODEL[:1])
    assert d.verdict == "+".join(r.found.name for r in (one, *others))
    assert d.after.p_value > 0.01
    assert "repeated_samples" not in sensorlab.diagnose(
        y, DT, sensorlab.augmented(d)).verdict


@pytest.mark.parametrize("lsb", [0.03, 0.1, 0.15])
def test_parts_of_a_record_on_lattices_of_their_own_repeat_nothing(lsb):
    """Nor do they end at limits: neighbours are equal, and few meet on the last value,
    by chance.
    """
    for seed in range(5):
        rng = np.random.default_rng(seed)
        y = lsb * np.round(rng.standard_normal(4000) / lsb)
        for moved in (y + np.repeat(rng.uniform(-0.5, 0.5, 10), 400),
                      y * np.where(np.arange(4000) < 1700, 1.0, 1.3217)):
            names = {r.found.name for r in readings.readings(Scene(moved, DT, {}))}
            assert names <= {"quantization"}


def lost_at_times(lsb, low_pass, seed, share=0.02):
    """A walk and white noise through a low-pass, in counts, and which of its samples
    are up to five times the one before them once more.
    """
    rng, lost = np.random.default_rng(seed), np.zeros(5000, bool)
    y = lfilter([np.sqrt(1.0 - low_pass**2)], [1.0, -low_pass], rng.standard_normal(
        5000)) + np.cumsum(0.01 * rng.standard_normal(5000))
    y = lsb * np.round(y / lsb)
    for at in np.flatnonzero(rng.random(4990) < share) + 1:
        if not lost[at]:
            lost[at:at + rng.integers(1, 6)] = True
    last = np.maximum.accumulate(np.where(lost, 0, np.arange(5000)))
    return y[last], lost


@pytest.mark.parametrize("lsb, low_pass", [
    (0.05, 0.0), (0.25, 0.0), (0.25, 0.5), (0.25, 0.8), (0.5, 0.0), (0.5, 0.3)])
def test_a_few_samples_lost_at_times_are_told_from_counts_that_meet(lsb, low_pass):
    for seed in range(3):
        y, lost = lost_at_times(lsb, low_pass, seed)
        seen = repeats.repeated_at_random(y)
        assert np.sum(seen & lost) > 0.4 * lost.sum()    # the rest may be chance
        assert np.sum(seen & ~lost) < 0.35 * seen.sum()


@pytest.mark.large
@pytest.mark.parametrize("low_pass", [0.0, 0.3, 0.6, 0.8, 0.9])
@pytest.mark.parametrize("lsb", [0.2, 0.5, 0.8, 1.2, 2.0])
def test_counts_that_meet_by_chance_are_no_lost_samples(lsb, low_pass):
    for seed in range(12):
        y, _ = lost_at_times(lsb, low_pass, seed, 0.0)
        assert not repeats.repeated_at_random(y).any()


def test_a_simulator_repeats_samples_at_random_where_no_record_does():
    h = sensorid.hypothesis("white_noise", sigma_v=1.0)
    one = Found(CATALOGUE["repeated_samples"], values=dict(frequency=0.7, phase=None))
    simulator, empty = Simulator((h,), ((one,),)), Scene(np.zeros(8000), 1.0, {})
    y = sensorlab.simulate_effects(simulator, empty, 3, seed=1).error
    same = np.diff(y) == 0.0
    assert_allclose(same.mean(1), 0.3, atol=0.02)    # sd 0.005
    assert np.mean(same[0] & same[1]) == pytest.approx(0.09, abs=0.015)
    assert (sensorlab.simulate_effects(simulator, empty, 1, seed=1, first=2).error[0]
            == y[2]).all()


def test_values_that_are_equal_by_chance_do_not_repeat():
    rng = np.random.default_rng(8)
    y = rng.standard_normal(4000)
    low = lfilter([0.2], [1.0, -0.8], y)
    quiet = y * np.repeat(np.exp(rng.standard_normal(40)), 100)
    part = np.round(3.0 * y)
    part[2500:] += 0.3 * rng.standard_normal(1500)
    uneven = converted(3.0 * y)
    for other in (np.round(3.0 * y), np.round(8.0 * low), np.round(4.0 * quiet), part,
                  np.round(rng.laplace(0.0, 3.0, 4000)), uneven, np.round(0.3 * y)):
        assert "repeated_samples" not in [
            r.found.name for r in readings.readings(Scene(other, DT, {}))]


def test_uneven_polling_shows_a_rate_but_ties_without_pattern_none():
    rng = np.random.default_rng(6)
    y = rng.standard_normal(4000)
    at = np.floor(0.67 * (np.arange(4000) + rng.uniform(-0.1, 0.1, 4000)) + 0.5)
    (one,) = readings.readings(Scene(y[np.unique(at, return_index=True)[1]][
        np.searchsorted(np.unique(at), at)], DT, {}))
    assert one.found.values["frequency"] == pytest.approx(0.67, rel=1e-3)
    ramp = np.round(0.31 * np.arange(4000) + 0.01 * y)    # a step now and then
    for other in (0.5 * np.round(2.0 * y), ramp, np.round(0.02 * ramp + y)):
        assert "repeated_samples" not in [
            r.found.name for r in readings.readings(Scene(other, DT, {}))]


@pytest.mark.parametrize("lsb, begins, length", [
    (0.3, range(50, 1500, 150), 8), (0.6, range(100, 1500, 370), 12),
    (1.0, range(100, 1500, 370), 20), (1.5, [600], 200), (1.8, [600], 200)])
def test_spans_among_counts_are_told_where_together_they_are_no_chance(
        lsb, begins, length):
    rng, told = np.random.default_rng(9), 0
    for _ in range(10):
        y = lsb * np.round((0.3 * rng.standard_normal() + np.cumsum(
            0.003 * rng.standard_normal(1500)) + rng.standard_normal(1500)) / lsb)
        nothing = np.zeros(1500, bool)
        assert repeats.stuck_spans(y, lsb, nothing)[0] == []
        for begin in begins:
            y[begin:begin + length] = y[begin]
        spans = repeats.stuck_spans(y, lsb, nothing)[0]
        told += sum(own <= begin and begin + length <= own + n < begin + length + 20
                    for own, n in spans for begin in begins)
    assert told > 0.9 * 10 * len(begins)


@pytest.mark.parametrize("calm", [    # of a count
    0.4, thorough(0.8), thorough(1.2), large(5.0)])
def test_values_meet_by_chance_where_a_record_is_calm(calm):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        sigma = np.where(np.arange(4000) % 1000 < 500, calm, 20.0)
        y = np.round(rng.uniform(-1.0, 1.0) + sigma * rng.standard_normal(4000))
        longest = values.runs(np.diff(y) == 0.0)[1].max()
        found = [r.found.name for r in readings.readings(Scene(y, DT, {}))]
        assert longest >= 2 and "stuck" not in found
    y[1700:1712], y[1712] = y[1700], y[1700] + 1.0    # where it is loud
    (stuck,) = [r for r in readings.readings(Scene(y, DT, {})) if r.masked.any()]
    assert stuck.found.values["spans"] == [[1700.0, 12]]


@pytest.mark.parametrize("lsb, printed", [(0.061, 0.01), (0.0152, 1e-7), (0.25, 1e-3)])
def test_a_lattice_is_seen_through_the_digits_that_were_printed(lsb, printed):
    y = np.random.default_rng(3).standard_normal(4000)
    y = printed * np.round(lsb * np.round(y / lsb) / printed)
    assert values.lattice(y) == pytest.approx(lsb, rel=0.01)
    scene = Scene(values.snapped(y), DT, {})
    assert len(np.unique(scene.y)) <= 1 + np.ptp(y) / (0.99 * lsb)
    assert "stuck" not in [r.found.name for r in readings.readings(scene)]


def test_digits_and_two_levels_far_apart_are_no_lattice():
    rng = np.random.default_rng(4)
    y = rng.standard_normal(4000)
    assert values.lattice(y) == 0.0
    assert values.lattice([float(f"{v:.6g}") for v in y] * np.ones(4000)) == 0.0
    poses = np.where(np.arange(4000) < 2000, 9.8, -9.8) + 0.01 * y
    assert values.lattice(poses) == 0.0
    assert values.lattice(np.round(y, 4)) == pytest.approx(1e-4)


def test_a_knock_far_from_all_other_values_makes_no_lattice():
    y = 0.030 + 0.0007 * np.random.default_rng(5).standard_normal(3200)
    y[[1000, 1001]] = 0.003, 0.004    # 21 digits below the least of the others
    assert values.lattice(np.round(y, 3)) == pytest.approx(0.001)


def markov_and_noise(rng, n=4000, tau=300.0, sigma_m=0.5, sigma_v=0.5):
    a = np.exp(-DT / tau)
    w = sigma_m * np.sqrt(1.0 - a * a) * rng.standard_normal(n)
    return lfilter([1.0], [1.0, -a], w) + sigma_v * rng.standard_normal(n)


def test_the_mean_of_a_clipped_record_is_that_before():
    y = 0.7 + np.random.default_rng(4).standard_normal(10_000)
    for limits in ([-np.inf, 1.0], [0.0, np.inf], [0.5, 1.2]):
        clipped = np.clip(y, *limits)
        mean = readings.latent_mean(clipped, readings.readings(Scene(clipped, DT, {})))
        assert mean == pytest.approx(0.7, abs=0.05)    # sd 0.01 to 0.014
    assert readings.latent_mean(y, []) is None


def test_the_mean_of_a_coarsely_rounded_record_is_that_before():
    y = 0.7 + np.random.default_rng(4).standard_normal(10_000)
    for lsb, coarse, opaque in ((1.9, False, False), (3.0, True, False)):
        rounded = lsb * np.round(y / lsb)
        (one,) = readings.readings(Scene(rounded, DT, {}))
        assert (one.coarse, one.opaque) == (coarse, opaque)
    assert abs(rounded.mean() - 0.7) > 0.05
    mean = readings.latent_mean(rounded, [one])
    assert mean == pytest.approx(0.7, abs=0.05)    # sd 0.016


def test_counts_hide_nothing_of_what_soon_passes_many():
    rng = np.random.default_rng(6)
    slow = 0.05 * rng.standard_normal(3000).cumsum() + rng.standard_normal(3000)
    smooth = lfilter(*butter(2, 0.03), rng.standard_normal(3300))[300:]
    for y, lsb, opaque in ((smooth, 0.7, False), (smooth, 2.5, True),
                           (slow, 4.5 / np.std(slow), True)):
        lsb = lsb * np.std(y)
        noise = np.sqrt(np.mean(np.diff(y)**2) / 2.0)
        (one,) = readings.readings(Scene(lsb * np.round(y / lsb), DT, {}))
        assert lsb > 4.0 * noise and one.opaque is opaque is not one.coarse


def test_of_few_codes_no_end_is_a_limit():
    rng = np.random.default_rng(3)
    for k in range(20):    # two codes or three are met
        y = 5.0 * np.round((rng.uniform(-2.5, 2.5) + rng.standard_normal(2000)) / 5.0)
        shown = readings.readings(Scene(y, DT, {})) if np.ptp(y) else ()
        assert "saturation" not in [r.found.name for r in shown]


@pytest.mark.parametrize("seed, quantiles", [(1, (0.15, 0.85)), (2, (0.0, 0.7))])
def test_the_simulator_of_a_clipped_record_has_the_noise_before(seed, quantiles):
    rng = np.random.default_rng(seed)
    y = 2.0 + markov_and_noise(rng)
    low, high = np.quantile(y, quantiles)
    h = sensorid.hypothesis("markov", tau_m=(60, 1500), sigma_m=(0.2, 1.5),
                            sigma_v=(0.1, 1.0), bias_sigma=3.0)
    d = sensorlab.diagnose(np.clip(y, low if quantiles[0] else -np.inf, high), DT, [h])
    assert d.verdict == "saturation"
    assert d.after.theta[2] == pytest.approx(0.5, rel=0.08)    # sd 0.013 if clipped
    assert d.final.theta[2] < 0.42    # what a fit makes of samples not lost at random
    last = d.drift[-1]
    assert 0.6 < last.with_effects / last.record < 1.7
    assert d.after.p_value > 0.01


@pytest.mark.thorough
@pytest.mark.parametrize("lsb", [0.1, 0.2])
def test_clipped_noise_on_a_coarse_lattice_is_seen(lsb):
    rng = np.random.default_rng(5)
    for _ in range(20):
        y = lsb * np.round(rng.standard_normal(20_000) / lsb)
        names = [r.found.name for r in readings.readings(Scene(y, DT, {}))]
        assert "saturation" not in names
        limits = np.quantile(y, [0.04, 0.96], method="nearest")
        one = readings.readings(Scene(np.clip(y, *limits), DT, {}))[0].found
        assert one.name == "saturation"
        assert_allclose(one.values["limits"], limits)


def test_what_two_ends_of_a_short_record_tell_adds_up():
    rng, told = np.random.default_rng(5), []
    for _ in range(20):
        y = 0.4 * np.round(rng.standard_normal(1000) / 0.4)
        assert np.isinf(clipping.limits_of(y, 0.4, 1.0)[0]).all()
        limits = np.quantile(y, [0.02, 0.98], method="nearest")
        y = np.clip(y, *limits)
        assert clipping.limits_of(y, 0.4, 1.0)[0] == list(limits)
        told += [clipping._abruptness(np.abs(y - end), 0.4) for end in limits]
    assert clipping.ABRUPT / 2 < min(told) < clipping.ABRUPT < max(told)


def test_a_sample_far_away_or_two_codes_alone_are_no_limit():
    y = 0.2 * np.round(np.random.default_rng(5).standard_normal(4000) / 0.2)
    for far in (1e4, 1e9, 1e13):
        y[7] = far
        readings.readings(Scene(y, DT, {}))
        assert not clipping.limits_of(y, 0.2, 1.0)[1].any()
    for codes in ([0.0], [0.0, 1.0], [0.0, 300.0]):
        assert not clipping._piles_up(np.repeat(codes, 50))


@pytest.mark.parametrize("seed", range(5))
def test_codes_of_uneven_width_are_no_limit(seed):
    rng = np.random.default_rng(seed)
    edges = -6.0 + np.cumsum(0.15 * rng.gamma(1.0, 1.0, 200))
    for noise in (rng.standard_normal(20_000), rng.laplace(size=20_000)):
        y = 0.15 * np.searchsorted(edges, noise)
        names = [r.found.name for r in readings.readings(Scene(y, DT, {}))]
        assert "saturation" not in names


@pytest.mark.parametrize("seed", [large(1), large(2)])
def test_a_clipped_walk_that_went_far_has_no_drift_beside(seed):
    rng = np.random.default_rng(seed)
    y = np.cumsum(0.1 * rng.standard_normal(20_000)) + 0.5 * rng.standard_normal(20_000)
    y = np.clip(y, *np.quantile(y, [0.01, 0.99]))
    assert abs(y.mean()) > 3.0    # of a bias of 1
    d = sensorlab.diagnose(y, DT, MODEL, effects=[CATALOGUE[name] for name in (
        "saturation", "second_order_drift", "turn_on_transient")])
    assert d.verdict == "saturation"


def test_outliers_beside_a_lattice_do_not_hide_it():
    rng = np.random.default_rng(9)
    y = 0.5 * np.round(rng.standard_normal(3000) / 0.5)
    at = rng.random(3000) < 0.005
    y[at] += 5.0 * rng.standard_normal(at.sum())
    (one,) = readings.readings(Scene(y, DT, {}))
    assert one.found.name == "quantization"
    assert one.found.values["lsb"] == pytest.approx(0.5)


@pytest.mark.parametrize("lsb, begin, end", [
    (0.12, 1000, 2600), thorough(0.9, 0, 2500), large(0.9, 100, 3800)])
def test_noise_on_a_part_of_a_rounded_record_makes_no_sample_stick(lsb, begin, end):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        y = lsb * np.round(rng.standard_normal(4000) / lsb)
        y[begin:end] += 0.5 * rng.standard_normal(end - begin)
        found = [r.found.name for r in readings.readings(Scene(y, DT, {}))]
        assert "stuck" not in found
    y[3850:3880], y[3880] = y[3850], y[3850] + lsb
    (stuck,) = readings.readings(Scene(y, DT, {}))
    assert stuck.found.values["spans"] == [[3850.0, 30]]


@pytest.mark.parametrize("size", [0.1885, 0.31, 0.072])
def test_a_level_that_came_after_the_rounding_is_no_limit(size):
    rng = np.random.default_rng(11)
    y = 0.05 * np.round(0.35 * rng.standard_normal(4000) / 0.05)
    y += size * (np.cumsum(rng.random(4000) < 0.005) % 2)
    (one,) = readings.readings(Scene(y, DT, {}))
    assert one.moved and one.found.values["lsb"] == pytest.approx(0.05, rel=1e-3)


WIDTHS = [0.3, 1.6, 0.4, 1.7]    # of codes that come again and again, in lsb


def converted(y, first=-40, count=80):
    """Values by a converter whose codes are not all as wide, one by one."""
    ends = first - 0.5 + np.cumsum([0.0, *(WIDTHS[k % 4] for k in range(count))])
    return np.array([first + np.sum(ends[1:] <= value) for value in y], float)


def noisy(rng, kind, n=4000):
    """Noise of three, about which something else is."""
    y = 3.0 * rng.standard_normal(n)
    return dict(
        white=lambda: y, walk=lambda: y + np.cumsum(0.1 * rng.standard_normal(n)),
        step=lambda: y + 9.0 * (np.arange(n) > n // 3),
        line=lambda: y + 5.0 * np.sin(0.02 * np.arange(n)),
        outliers=lambda: y + 60.0 * (rng.random(n) < 0.02) * rng.standard_normal(n),
        bursts=lambda: y * (1.0 + 4.0 * (np.cumsum(rng.random(n) < 0.01) % 2)),
        even=lambda: rng.uniform(-5.0, 5.0, n), laplace=lambda: rng.laplace(0, 3.0, n),
        quiet=lambda: y * np.repeat(np.exp(rng.standard_normal(n // 100)), 100))[kind]()


@pytest.mark.parametrize("kind", ["white", "walk", "step", "line", "outliers"])
def test_codes_of_uneven_width_are_read_whatever_else_there_is(kind):
    y = noisy(np.random.default_rng(3), kind)
    seen = readings.readings(Scene(0.25 * converted(y), DT, {}))
    if kind == "outliers":    # which are clipped to the first code
        assert seen[0].found.values["limits"][0] == -10.0
        seen = seen[1:]
    assert [r.found.name for r in seen] == ["quantization", "differential_nonlinearity"]
    assert seen[1].log_bayes > 100.0
    value, width = np.transpose(seen[1].found.values["codes"])
    assert_allclose(np.diff(value), 0.25)
    full = np.abs(4.0 * value) < 5.0    # where most samples are
    true = np.array(WIDTHS)[(np.round(4.0 * value[full]).astype(int) + 40) % 4]
    assert_allclose(4.0 * width[full], true, atol=0.3)


@pytest.mark.parametrize("kind", [
    "white", large("step"), large("line"),
    *map(thorough, ("walk", "bursts", "laplace", "outliers", "even", "quiet"))])
def test_codes_of_even_width_are_not_uneven(kind):
    for seed in range(20):
        y = np.round(noisy(np.random.default_rng(seed), kind))
        assert "differential_nonlinearity" not in [
            r.found.name for r in readings.readings(Scene(y, DT, {}))]


@pytest.mark.parametrize("kind", ["white", "walk", "step"])
def test_few_codes_of_uneven_width_are_read_if_noise_is_normal(kind):
    y = noisy(np.random.default_rng(3), kind) / 2.0
    seen = readings.readings(Scene(0.25 * converted(y), DT, {}))
    assert [r.found.name for r in seen] == ["quantization", "differential_nonlinearity"]
    value, width = np.transpose(seen[1].found.values["codes"])
    full = np.abs(4.0 * value) < 3.0
    true = np.array(WIDTHS)[(np.round(4.0 * value[full]).astype(int) + 40) % 4]
    assert_allclose(4.0 * width[full], true, atol=0.35)


@pytest.mark.parametrize("kind", [
    "white", "walk", "step", "line", "outliers", "bursts", "laplace", "quiet"])
@pytest.mark.parametrize("codes", [0.7, 1.0, 1.5])
def test_few_codes_of_even_width_are_not_uneven(kind, codes):
    for seed in range(5):
        y = noisy(np.random.default_rng(seed), kind) * codes / 3.0
        for record in (y, lfilter(*butter(2, 0.3), y)):
            assert not uneven_codes(np.round(record), 1.0)[0]


@pytest.mark.large
def test_a_converter_is_simulated_as_it_was_read():
    y = noisy(np.random.default_rng(4), "walk")
    codes = [[k - 40.0, WIDTHS[k % 4]] for k in range(80)]
    one = Found(CATALOGUE["differential_nonlinearity"], values=dict(codes=codes))
    again = y.copy()
    one.effect.reading(None, again, codes)
    assert_allclose(again, converted(y))
    h = sensorid.hypothesis("white_noise", sigma_v=3.0, bias_sigma=0.0)
    rounding = Found(CATALOGUE["quantization"], values=dict(lsb=1.0))
    empty = Scene(np.zeros(4000), DT, {})
    first, second = (sensorlab.simulate_effects(
        Simulator((h,), (order,)), empty, seed=2).error[0]
        for order in ((one, rounding), (rounding, one)))
    assert_allclose(first, second)    # codes come before rounding
    d = sensorlab.diagnose(first, DT, Simulator((h,), ((),)))
    assert d.verdict == "quantization+differential_nonlinearity"
    assert d.after.p_value > 0.01 and d.closure.closed > 0.7
    d = sensorlab.diagnose(first, DT, sensorlab.augmented(d))
    assert d.verdict == "none"


@pytest.mark.large
def test_codes_of_the_simulator_are_those_of_its_counts():
    codes = [[k - 40.0, WIDTHS[k % 4]] for k in range(80)]
    h = sensorid.hypothesis("white_noise", sigma_v=3.0, bias_sigma=5.0)
    simulator = Simulator((h,), ((
        Found(CATALOGUE["quantization"], values=dict(lsb=1.0)),
        Found(CATALOGUE["differential_nonlinearity"], values=dict(codes=codes))),))
    y = noisy(np.random.default_rng(4), "white")
    d = sensorlab.diagnose(converted(y), DT, simulator)
    assert d.verdict == "none"
    d = sensorlab.diagnose(np.round(y), DT, simulator)    # another converter
    (one,) = d.found
    assert one.values["parameter"][0] == "differential_nonlinearity.codes"
    assert one.values["factor"] == (0.0, 0.0) and d.verdict == "wrong_parameter"
    assert d.closure.closed > 0.9 and d.after.p_value > 0.01
    d = sensorlab.diagnose(lfilter([0.3], [1.0, -0.7], y).round(3), DT,
                           simulator)    # counts of another sensor
    assert "differential_nonlinearity" not in [r.found.name for r in d.final.readings]
    assert d.closure.closed > 0.9 and "unknown" not in d.verdict


@pytest.mark.parametrize("level", [large(0.0), 0.03])
def test_a_step_between_counts_coarser_than_the_noise_leaves_nothing(level):
    rng = np.random.default_rng(4)    # of 3, it is as likely gradual
    y = level + 0.05 * rng.standard_normal(4000)
    y[2400:] += 0.08
    d = sensorlab.diagnose(np.round(y, 1), 0.01, [
        sensorid.hypothesis("white_noise", sigma_v=(0.02, 0.2))])
    assert d.verdict == "quantization+bias_step"
    assert d.after.p_value > 0.01 and d.closure.closed > 0.9
    model = sensorlab.augmented(d)
    assert {one.name for one in model.effects[0]} == {"quantization", "bias_step"}


def test_what_a_logger_writes_for_no_value_is_no_limit():
    y = np.random.default_rng(5).standard_normal(3000)
    y[[100, 1500, 2500]] = -99.0
    assert [r.found.name for r in readings.readings(Scene(y, DT, {}))] == ["dropouts"]
    assert values.lattice(np.where(np.arange(3000) == 7, 2.0**31, y)) == 0.0
    with pytest.raises(ValueError, match=r"sample 7 is 2.14748e\+09, where half of"):
        sensorlab.diagnose(np.where(np.arange(3000) == 7, 2.0**31, y), DT, WHITE)


def test_the_noise_of_a_saved_model_is_that_before_coarse_rounding():
    """Against the likelihood of rounded normal values, the bias summed over."""
    y = 3.0 * np.round(np.random.default_rng(301).standard_normal(1000) / 3.0)
    sigma, bias = np.linspace(0.5, 2.0, 301)[:, None], np.linspace(-0.6, 0.6, 121)
    ln_p = sum(np.sum(y == code) * np.log(
        norm.cdf((code + 1.5 - bias) / sigma) - norm.cdf((code - 1.5 - bias) / sigma)
        + 1e-300) for code in np.unique(y))
    mass = np.exp(ln_p - ln_p.max()).sum(1)
    mean = mass @ sigma[:, 0] / mass.sum()
    d = sensorlab.diagnose(y, DT, [sensorid.hypothesis(
        "white_noise", sigma_v=(0.3, 3.0))])
    assert d.verdict == "quantization"
    model = sensorlab.augmented(d)
    (p,) = model.hypotheses[0].parameters
    assert p.mean == pytest.approx(mean, abs=0.03) and p.low < 1.0 < p.high
    drawn = sensorlab.simulate_effects(model, Scene(y, DT, {}), 20).error
    assert np.std(drawn, axis=1).mean() == pytest.approx(np.std(y), rel=0.1)


@pytest.mark.parametrize("digits, spacing", [
    ("%.3f", 1e-3), ("%.4g", 1e-3), ("%.3e", 1e-3), ("%.6g", 1e-5), ("%.17g", 0.0)])
def test_what_a_record_was_rounded_by_is_told_by_its_digits(digits, spacing):
    """Of significant ones, those of its largest values tell."""
    v = np.random.default_rng(5).standard_normal(4000)
    printed = np.array([float(digits % x) for x in v])
    scene = readings.recorded(printed, DT, {})
    assert scene.rounding == pytest.approx(spacing / np.sqrt(12.0))
    assert np.std(scene.y - v) == pytest.approx(scene.rounding, rel=0.05)
    assert np.abs(scene.y - printed).max() <= 0.501 * spacing


def test_counts_that_are_a_reading_are_no_digits():
    v = np.random.default_rng(5).standard_normal(4000)
    assert readings.recorded(0.25 * np.round(4.0 * v), DT, {}).rounding == 0.0
    # a tenth, of those above 1, would hide as much noise: they are left as they are
    printed = np.array([float(f"{x:.2g}") for x in v])
    assert np.abs(readings.recorded(printed, DT, {}).y - printed).max() < 1e-3


@pytest.mark.parametrize("spiky", [False, large(True)])
def test_a_strong_vibration_is_neither_interpolated_nor_averaged(spiky):
    """Whatever its frequency, and with odd samples beside it: least squares foretell
    it, and it stands beside a zero of some average.
    """
    for seed in range(24):
        rng = np.random.default_rng(seed)
        y = rng.standard_normal(3000) + 10.0**rng.uniform(0.0, 3.5) * np.cos(
            2.0 * np.pi * rng.uniform(0.02, 0.49) * np.arange(3000))
        y += spiky * (rng.random(3000) < 0.005) * 300.0 * rng.standard_normal(3000)
        assert not readings.readings(Scene(y, DT, {})), seed
