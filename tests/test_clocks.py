"""Time stamps of any unit, and the even clock behind them."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sensorlab.readers.clocks import clock, duration, in_seconds, unit_of

I = np.arange(1000)
RNG = np.random.default_rng(5)


@pytest.mark.parametrize("name, unit", [
    ("time", ()), ("t", ()), ("Timestamp", ()), ("TimeUS", "us"), ("time_ms", "ms"),
    ("timestamp [ns]", "ns"), ("#timestamp [ns]", "ns"), ("time (s)", "s"),
    ("timestamp_\u00b5s", "us"), ("seconds", "s"), ("header/stamp [ns]", "ns"),
    ("Time since boot [usec]", "us"), ("SampleUS", "us"), ("t_sec", "s"),
    ("seconds_elapsed", "s"), ("imu/time", ()), ("time [h]", "h"),
    ("GPS TOW [s]", "s"), ("iTOW", ()), ("time of week [ms]", "ms"), ("Zeit [s]", "s"),
    ("time [0.1 ms]", "0.1 ms"), ("t (1/100 s)", "0.01 s")])
def test_a_clock_and_its_unit_are_known_by_name(name, unit):
    found = unit_of(name)
    assert found == unit or found[0] == unit


@pytest.mark.parametrize("name", ["error", "temperature", "s", "mag_t", "us", "",
                                  "settings", "rate [rad/s]", "gyro_x", "times_two",
                                  "GPS week", "T", "T [degC]", "t0", "T_s", "hour",
                                  "min"])
def test_what_is_no_clock_is_not_taken_for_one(name):
    assert unit_of(name) is None


@pytest.mark.parametrize("time, said", [
    (0.01 * I, "dt 10 ms from time"),
    (1.7e9 + 0.01 * I, "dt 10 ms from time"),
    (1_700_000_000_000 + 10 * I, "dt 10 ms from time, taken as ms"),
    (1_700_000_000_000_000 + 10_000 * I, "dt 10 ms from time, taken as us"),
    (1_700_000_000_000_000_000 + 10_000_000 * I, "dt 10 ms from time, taken as ns"),
    ((4000 * I).astype(np.uint64), "dt 4 ms from time, taken as us"),
    (5_000_000.0 * I, "dt 5 ms from time, taken as ns"),
    (60 * I, "dt 60 s from time"), (I, "dt 1 s from time"),
    (10 * I, "dt 10 ms from time, taken as ms"), (10.0 * I, "dt 10 s from time"),
    (1_700_000_000 + 3600 * I, "dt 3600 s from time"),
    (46_000.0 + I / 8_640_000, "dt 10 ms from time, taken as d"),
    (740_000.0 + I / 864_000, "dt 100 ms from time, taken as d"),
    (pd.date_range("2026-01-31", periods=1000, freq="5ms").to_numpy(),
     "dt 5 ms from time, dates"),
    (pd.date_range("2026-01-31", periods=1000, freq="5ms", tz="UTC").map(
        lambda d: d.isoformat()).to_numpy(object), "dt 5 ms from time, dates")])
def test_units_are_told_by_their_size_and_said(time, said):
    assert clock("time", time).said == said


def test_a_name_goes_before_the_size():
    assert clock("time_ms", 4000 * I).said == "dt 4 s from time_ms"


def test_nanoseconds_of_an_epoch_keep_their_last_digit():
    stamps = 1_700_000_000_000_000_001 + 7 * I.astype(np.int64)
    assert_allclose(in_seconds("t [ns]", stamps)[0], 7e-9 * I, rtol=1e-12)


@pytest.mark.parametrize("bits, apart", [(16, 250), (24, 10**5), (32, 10**7)])
def test_a_counter_that_begins_anew_runs_on(bits, apart):
    found = clock("time_us", (2**bits - 3000 + apart * I) % 2**bits)
    assert found.slots is None and found.dt == pytest.approx(1e-6 * apart)
    assert found.said.endswith("from time_us, unwrapped")


def test_jumps_back_are_no_counter():
    with pytest.raises(ValueError, match="does not increase from sample 499"):
        clock("time_us", np.append(250 * I[:500], 10**6 + 250 * I[:500]) % 10**6)


def test_a_gap_is_no_time_of_day():
    time = np.append(0.01 * I[:900], 10_000 + 0.01 * I[:900])
    with pytest.raises(ValueError, match="spread over 10009 s: cut the gap"):
        clock("time", time)


def test_jitter_up_to_half_an_interval_is_even():
    time = 0.01 * I + RNG.uniform(-0.0045, 0.0045, 1000)
    found = clock("time", np.maximum.accumulate(time))
    assert found.slots is None and "off by up to" in found.said
    assert_allclose(found.dt, 0.01, rtol=1e-4)


def test_stamps_that_were_rounded_are_even():
    found = clock("time", np.round(0.004 * I, 2))
    assert found.slots is None
    assert_allclose(found.dt, 0.004, rtol=2e-3)    # of the last stamp


def test_gaps_of_a_clock_that_jitters_become_missing():
    keep = np.delete(I, [5, 6, 700])
    time = 0.01 * keep + RNG.uniform(-0.001, 0.001, len(keep))
    found = clock("time", time)
    assert_array_equal(found.slots, keep)
    assert_array_equal(np.flatnonzero(np.isnan(found.placed(time))), [5, 6, 700])


@pytest.mark.parametrize("resample", [False, True])
def test_bursts_are_sorted_by_the_mean_rate(resample):
    arrival = np.ceil(0.01 * I / 0.064) * 0.064 + 0.002 * (I % 6)    # as of a port
    found = clock("t", np.sort(arrival), resample)
    assert "at the mean rate" in found.said and "bursts" in found.said
    assert found.slots is None
    assert_allclose(found.dt, 0.01, rtol=0.01)


def test_an_uneven_clock_is_taken_at_its_mean_step_if_asked():
    time = np.cumsum(RNG.choice([0.5, 0.8, 1.7], 1000))
    with pytest.raises(ValueError, match="the record is uneven: the step after"):
        clock("time", time)
    found = clock("time", time, resample=True)
    assert_allclose(found.dt, np.diff(time).mean(), rtol=1e-9)
    seen = found.placed(3.0 * time)
    even = time[0] + found.dt * np.arange(len(seen))
    off = (seen - 3.0 * even)[~np.isnan(seen)]
    assert np.abs(off).max() <= 1.5 * found.dt * (1.0 + 1e-6)


def test_white_noise_at_uneven_times_stays_white():
    time = np.cumsum(RNG.uniform(0.5, 1.5, 20000))
    y = RNG.standard_normal(20000)
    seen = clock("time", time, resample=True).placed(y)
    assert 0.05 < np.isnan(seen).mean() < 0.3
    assert np.nanvar(seen) == pytest.approx(1.0, abs=0.05)
    assert abs(np.nanmean(seen[1:] * seen[:-1])) < 0.03    # interpolated, 0.18


def test_stamps_that_mostly_stand_still_are_taken_at_the_mean():
    assert clock("t", np.array([-1.0, 0.0, 0.0, 0.0]), resample=True).dt == 1.0 / 3.0


def test_bursts_whose_stamps_are_whole_milliseconds_are_bursts():
    found = clock("time_ms", 50 * (I // 5) + 2 * (I % 5))
    assert found.slots is None and "at the mean rate" in found.said
    assert_allclose(found.dt, 0.01, rtol=0.01)
    lost = clock("time_ms", 10 * np.delete(I, I[100:950]))    # one gap is a gap
    assert_array_equal(lost.slots, np.delete(I, I[100:950]))


def test_gaps_of_any_length_leave_the_rest_even():
    """As in a log of ArduPilot: steps that jitter by 15 %, and a reboot."""
    part = np.repeat([0, 1, 2], [400, 350, 250])
    time = 0.02 * I + np.array([0.0, 8.373, 422.53])[part]
    found = clock("time", time + RNG.uniform(-0.0029, 0.0029, 1000))
    # gaps are taken for whole numbers of steps: up to half a step each, of 1000 steps
    assert_allclose(found.dt, 0.02, rtol=1e-3)
    assert "but for 2 gaps" in found.said
    assert_array_equal(np.diff(found.slots)[np.diff(part) == 0], 1)
    assert_allclose(found.slots * found.dt, time, atol=0.012)


def test_bursts_far_apart_are_bursts():
    time = np.sort(0.64 * (I // 64) + 1e-6 * (I % 64))
    assert "at the mean rate" in clock("t", time).said


def test_a_gap_in_a_short_record_is_no_burst():
    time = np.cumsum(np.r_[RNG.uniform(0.6, 1.4, 20), 100.3, RNG.uniform(0.6, 1.4, 19)])
    with pytest.raises(ValueError, match="the record is uneven"):
        clock("t", time)


@pytest.mark.parametrize("time, message", [
    (np.r_[I, 3.0], r"does not increase from sample 999 \(999 s after the first\)"),
    (np.r_[I[:9], I[8:]], "does not increase from sample 8"),
    (np.zeros(50), "is the same for all 50 samples"), (np.zeros(1), "has 1 samples"),
    (np.r_[-1e308, I, 1e308], "time runs from -1e.308 to 1e.308: no record is"),
    (np.r_[I, 1e9], "cut the gap after sample 999 out"),
    (np.r_[0.0, np.nan, I[2:]], "time of sample 1 is nan: a number is needed"),
    (np.array(["2026-01-31", "yesterday"], object), "'yesterday': neither a number"),
    (np.array(["2026-01-31", "NaT"], "datetime64[ns]"), "time of sample 1 is NaT")])
def test_what_is_no_clock_gets_one_sentence(time, message):
    with pytest.raises(ValueError, match=message):
        clock("time", time)


@pytest.mark.parametrize("seconds, text", [
    (2.0, "2 s"), (0.1, "100 ms"), (0.0099999, "9.9999 ms"), (1e-6, "1 us"),
    (1e-9, "0.001 us"), (0.99999, "0.99999 s")])
def test_a_duration_is_told_in_its_unit(seconds, text):
    assert duration(seconds) == text


def test_the_bursts_of_a_real_serial_port(real):
    with np.load(real / "mpu6050_static10min_temp.npz") as z:
        found = clock("t", z["t"], resample=True)
    assert found.slots is None and "at the mean rate, 99.32 Hz" in found.said
    with np.load(real / "xsens_mti_multipos.npz") as z:    # 9.0 to 10.4 ms
        assert_allclose(clock("t", z["t"]).dt, 0.01, rtol=2e-4)


@pytest.mark.parametrize("rate, apart", [(833, 1e-3), (952, 1e-3), (800, 1e-3),
                                         (75, 0.01), (67.3, 0.01)])
def test_stamps_coarser_than_an_interval_are_even(rate, apart):
    found = clock("time", apart * np.floor((np.arange(2000) / rate) / apart + 0.3))
    assert found.slots is None and found.dt == pytest.approx(1.0 / rate, rel=1e-4)


@pytest.mark.parametrize("tick", [0.011, 0.015, 0.015625, 0.018])
def test_a_clock_that_counts_in_up_to_two_intervals_tells_the_mean_rate(tick):
    found = clock("time", tick * np.floor(0.01 * np.arange(3000) / tick + 1e-9))
    assert found.slots is None and found.dt == pytest.approx(0.01, rel=1e-4)
    assert f"counts in steps of {1e3 * tick:g} ms" in found.said


@pytest.mark.parametrize("start, step", [(1700000000, 1), (1700000000, 10), (0, 3600),
                                         (1700000000, 300), (0, 86400)])
def test_seconds_of_slow_records_are_seconds(start, step):
    found = clock("timestamp", start + step * np.arange(500))
    assert found.dt == step and not found.guess


def test_samples_that_are_lost_at_random_are_missing():
    kept = np.flatnonzero(np.random.default_rng(5).random(3000) > 0.1)
    found = clock("time", 0.001 * kept)
    assert found.dt == pytest.approx(0.001) and len(found.placed(kept)) == 1 + (
        kept[-1] - kept[0])


def test_stamps_of_single_precision_are_even():
    found = clock("time", (1e5 + 0.01 * I).astype(np.float32))
    assert found.slots is None and found.dt == pytest.approx(0.01, rel=1e-4)


def test_a_clock_of_two_rates_is_uneven():
    t = np.append(0.01 * np.arange(1500), 15.0 + np.arange(1500) / 70)
    with pytest.raises(ValueError, match="uneven: the step .* 0.0142857 s where 0.01"):
        clock("time", t)


def test_whole_seconds_tell_the_mean_rate_and_stand_against_no_interval():
    found = clock("secs", np.floor(0.02 * I))
    assert not found.even and found.dt == pytest.approx(0.02, rel=3e-3)
    found = clock("secs", np.floor(0.01 * np.arange(3000)))    # most steps are 0
    assert not found.even and found.dt == pytest.approx(0.01, rel=2e-3)


@pytest.mark.parametrize("time", [
    (np.arange(200) * 300 - 32000).astype(np.int16),
    pd.to_timedelta(300 * np.arange(200), unit="s").to_numpy()])
def test_small_integers_and_durations_are_clocks(time):
    assert clock("time [s]", time).dt == pytest.approx(300.0)


def test_an_interval_is_the_number_that_stamps_count_in():
    assert clock("t", np.round(0.01 * np.arange(2000), 6)).dt == 0.01
