"""Samples that were interpolated from others."""

import numpy as np
import pytest
from conftest import DT, MODEL, large, thorough
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, resample_poly, savgol_filter

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Found, Scene, Simulator
from sensorlab.gap import readings
from sensorlab.gap.interpolated import interpolated, on_samples
from sensorlab.gap.resampled import less_resampling

N = 4000
GIVEN = dict(    # times, in samples, at which a sensor gives a value
    evenly=np.arange(0.0, N + 5.0, 5.0), evenly_late=np.arange(1.0, N + 2.0, 2.0),
    between=np.arange(0.0, N + 4.0, 10.0 / 3.0), unevenly=np.append(0.0, np.cumsum(
        np.random.default_rng(4).uniform(2.6, 4.5, N // 2))))


def noise(samples, seed=3):
    rng = np.random.default_rng(seed)
    return 0.5 * rng.standard_normal(samples) + np.cumsum(
        0.05 * rng.standard_normal(samples))


def filled(y, mean, seed=5, share=0.03):
    """A record with straight lines in gaps of that mean length; what was lost (N,)."""
    rng, lost = np.random.default_rng(seed), np.zeros(len(y), bool)
    while lost.mean() < share:
        first = rng.integers(1, len(y) - 200)
        lost[first:first + rng.geometric(1.0 / mean)] = True
    i = np.arange(len(y))
    return np.interp(i, i[~lost], y[~lost]), lost


@pytest.mark.parametrize("digits", [15, 3])
@pytest.mark.parametrize("offset", [0.0, 1e4])
def test_gaps_that_were_filled_are_found(digits, offset):
    for mean in (1, 5, 30):
        y, lost = filled(noise(N) + offset, mean)
        lines = interpolated(np.round(y, digits))
        assert not lines.every
        if digits == 15:
            assert (lines.own == lost).all()
        else:    # rounded lines that are short may be chance
            start = np.flatnonzero(lost)
            assert lines.own[start].mean() > {1: -1.0, 5: 0.6, 30: 0.95}[mean]
            assert np.mean(~lost[lines.own]) < 0.05 if lines.own.any() else mean == 1


@pytest.mark.parametrize("lsb", [0.05, 0.25])
def test_gaps_in_a_record_of_counts_are_found(lsb):
    """Where many samples lie on lines by chance, on steps of whole counts."""
    for values in (noise(N), lfilter(*butter(2, 0.5), noise(N))):
        counts = lsb * np.round(values / lsb)
        assert not interpolated(counts).own.any()
        y, lost = filled(counts, 30)
        own = interpolated(y).own
        assert not own[~lost].any() and own[lost].mean() > 0.9


@pytest.mark.parametrize("digits", [15, 3])
@pytest.mark.parametrize("kind", GIVEN)
def test_what_was_interpolated_to_a_higher_rate_is_found(kind, digits):
    at, raw = GIVEN[kind], noise(len(GIVEN[kind]))
    y = np.round(np.interp(np.arange(N), at, raw), digits)
    lines = interpolated(on_samples(y))
    if kind.startswith("evenly"):
        assert (lines.every, lines.first) == (at[1] - at[0], at[0])
    own = np.flatnonzero(~lines.own)[2:-2]
    # at the nearest sample, and as it was given
    assert len(own) == pytest.approx(np.sum(at < N), rel=0.01 if digits > 3 else 0.3)
    nearest = np.abs(own[:, None] - at).argmin(1)
    given = np.abs(own - at[nearest]) <= 0.5
    assert given.mean() > (0.99 if digits > 3 else 0.9)
    off = on_samples(y)[own] - raw[nearest]
    assert np.median(np.abs(off)) < (1e-9 if digits > 3 else 2e-3)


@pytest.mark.parametrize("every", [2, 5, 10])
def test_lines_are_found_in_a_file_of_few_digits(every):
    """Of which the last is a tenth of the noise."""
    y = np.interp(np.arange(N) / every, np.arange(N), noise(N))
    between = interpolated(0.05 * np.round(y / 0.05))
    assert (between.every, between.first, between.order) == (every, 0, 1)


@pytest.mark.parametrize("every", [14, 16, 25])
def test_what_is_too_far_apart_for_one_look_is_found_by_two(every):
    """Samples that are given lie on curves, too: every second one of every eighth."""
    raw = noise(N // every + 1)
    spline = CubicSpline(every * np.arange(len(raw)), raw)(np.arange(N - 7))
    between = interpolated(spline[3:])
    assert (between.every, between.first, between.order) == (every, every - 3, 3)


@pytest.mark.parametrize("every", [2, 3, 5])
def test_smooth_curves_are_found(every):
    raw = noise(N // every + 1)
    spline = CubicSpline(every * np.arange(len(raw)), raw)(np.arange(N - 7))
    fir = resample_poly(raw, every, 1)
    for y, digits in ((spline, 15), (fir, 15), (np.round(fir, 3), 3)):
        for first in (0, 1, every - 1):
            between = interpolated(np.append(y[-first % every:], np.nan))
            assert (between.every, between.first, between.order) == (every, first, 3)
            assert between.own.mean() == pytest.approx(1.0 - 1.0 / every, abs=0.001)


def others():
    """Records of which nothing was interpolated."""
    rng, t = np.random.default_rng(2), np.arange(2.0 * N)
    w = rng.standard_normal(2 * N)
    for lsb in (0.0, 1e-3, 0.01, 0.1, 0.3, 1.0, 3.0):
        for raw in (w, 0.1 * np.cumsum(w) + w, 0.01 * np.cumsum(np.cumsum(w)),
                    lfilter(*butter(4, 0.05), w), lfilter(*butter(2, 0.01), w),
                    100.0 * np.sin(0.03 * t) + 0.1 * w, 0.37 * t + 0.1 * w,
                    w * np.exp(rng.standard_normal(16)).repeat(N // 8),
                    1e4 + 0.01 * w, 1e-4 * t**2 + 0.05 * w):
            y = lsb * np.round(raw / lsb) if lsb else raw
            if np.ptp(y):
                yield y
                yield y + 1.234e-4 * t
                yield (y * 1.2345).astype(np.float32)
    for lsb in (0.3, 1.0, 2.0):    # an angle, less its drift; a polynomial through some
        for samples in (150, 300, 1000):
            for own in w[:6 * samples].reshape(6, samples):
                counts = lsb * np.round(own / lsb)
                yield np.cumsum(counts - counts.mean())
                yield savgol_filter(counts, 11, 2)


def test_a_line_of_few_samples_lies_between_none():
    for samples in range(3, 40):
        assert not interpolated(np.arange(samples) / 8.0).own.any()


@pytest.mark.thorough
def test_nothing_is_between_others_by_chance():
    for number, y in enumerate(others()):
        assert not interpolated(readings.recorded(
            np.asarray(y, float), DT, {}).y).own.any(), number


@pytest.mark.parametrize("mean", [thorough(1), large(5), thorough(30)])
def test_a_gap_that_was_filled_is_no_calm(mean):
    y, lost = filled(noise(N), mean, share=0.1)
    d = sensorlab.diagnose(y, DT, MODEL[:1])
    assert d.verdict == "interpolated_samples"
    frequency, phase = (d.found[0].values[one][0] for one in ("frequency", "phase"))
    assert phase is None
    assert frequency == pytest.approx(np.mean(~lost) / DT)
    again = sensorlab.diagnose(filled(noise(N, 8), mean, 6, share=0.1)[0], DT,
                               sensorlab.augmented(d))
    assert again.verdict in ("none", "wrong_parameter")


@pytest.mark.parametrize("kind, effect", [
    ("evenly_late", "bias_step"), large("evenly_late", "none"), large("evenly", "none"),
    large("between", "sinusoid"), large("unevenly", "none")])
def test_what_is_beside_it_is_named(kind, effect):
    at = GIVEN[kind]
    raw = noise(len(at)) + dict(none=0.0, bias_step=1.5 * (at > 0.6 * N),
                                sinusoid=0.3 * np.sin(0.2 * at))[effect]
    d = sensorlab.diagnose(np.interp(np.arange(N), at, raw), DT, [
        sensorid.hypothesis("random_walk", sigma_w=(0.005, 0.5), sigma_v=(0.2, 1.0))])
    assert set(d.verdict.split("+")) - {"none"} == {"interpolated_samples", effect} - {
        "none"}


@pytest.mark.parametrize("lsb", [large(0.5), large(0.15), large(1.0)])
def test_counts_were_there_before_their_lines(lsb):
    raw = lsb * np.round(noise(N // 4 + 1) / lsb)
    y = np.interp(np.arange(N) / 4.0, np.arange(len(raw)), raw)
    d = sensorlab.diagnose(y, DT, [
        sensorid.hypothesis("random_walk", sigma_w=(0.005, 0.5), sigma_v=(0.2, 1.0))])
    assert d.verdict == "interpolated_samples+quantization"
    assert d.found[1].values["lsb"][0] == pytest.approx(lsb) and d.after.p_value > 0.01


@pytest.mark.parametrize("phase, order", [(0.0, 1), (2.0, 1), (None, 1), (1.0, 3)])
def test_the_reading_draws_lines_between_what_was_given(phase, order):
    scene = Scene(np.zeros(3000), 0.1, {})
    one = Found(CATALOGUE["interpolated_samples"],
                values=dict(frequency=2.5, phase=phase, order=order))
    h = sensorid.hypothesis("white_noise", sigma_v=1.0)
    raw, y = (sensorlab.simulate_effects(
        Simulator((h,), (own,)), scene, 2, seed=1).error for own in ((), (one,)))
    for given, own in zip(raw, y):
        at = np.flatnonzero(given == own)
        assert len(at) == pytest.approx(750, abs=75)    # sd 24 where it is at random
        shape = {1: np.interp(np.arange(3000), at, given[at]),
                 3: CubicSpline(at, given[at])(np.arange(3000))}[order]
        assert_allclose(own[at[0]:at[-1]], shape[at[0]:at[-1]], atol=1e-12)
        between = interpolated(own)
        assert between.every == (0 if phase is None else 4)
        assert between.order == order and not between.own[at[1:-1]].any()


def resampled(raw, ratio, lsb=0.0, begin=0.3):
    """A record (N,) at a rate that is higher by a ratio, through NumPy's lines."""
    y = np.interp(begin + np.arange(N) / ratio, np.arange(len(raw)), raw)
    return lsb * np.round(y / lsb) if lsb else y


@pytest.mark.parametrize("lsb", [0.0, 1e-6, 0.1, 0.25])
@pytest.mark.parametrize("ratio", [
    1.03, large(1.07), large(1.2), 1.37, 1.5, large(1.8), 1.95])
def test_what_was_resampled_to_a_little_higher_rate_is_found(ratio, lsb):
    """Its knots are what was given, but for what rounding leaves; its rate is known."""
    for seed in range(2):
        raw = noise(N, seed)
        y = less_resampling(resampled(raw, ratio, lsb))
        own = ~interpolated(y).own
        assert own.mean() == pytest.approx(1.0 / ratio, rel=0.01)
        at = np.arange(1, int(N / ratio))
        nearest = np.round((at - 0.3) * ratio).astype(int)
        assert np.std(y[nearest] - raw[at]) < 2.0 * lsb / np.sqrt(12.0) + 1e-9


@pytest.mark.parametrize("samples", [thorough(250000)])
def test_a_long_record_that_was_resampled_is_told_to_its_end(samples):
    """Its pace, that its head tells, is known to more than a turn at its end."""
    raw = noise(200000)
    i = np.arange(samples) / 1.31
    y = less_resampling(0.2 * np.round(np.interp(i, np.arange(200000), raw) / 0.2))
    at = np.arange(1, int(i[-1]))
    off = y[np.round(at * 1.31).astype(int)] - raw[at]
    assert np.std(off[:1000]) == pytest.approx(np.std(off[-1000:]), rel=0.2)
    assert np.std(off) < 2.0 * 0.2 / np.sqrt(12.0)


def test_what_was_not_resampled_stays_as_it_is():
    rng, raw, i = np.random.default_rng(2), noise(N), np.arange(N)
    line = 3.0 * np.sin(2.0 * np.pi * 0.173 * i)
    for y in (raw, np.cumsum(raw), 0.5 * np.round(2.0 * raw), raw + line, line,
              lfilter(*butter(2, 0.4), raw), np.repeat(raw, 2), raw[i // 3],
              raw[np.floor(i / 1.5).astype(int)], np.where(rng.random(N) < 0.1, 0, raw),
              np.zeros(N), 0.1 * i, raw[:20]):
        assert less_resampling(y) is y


def test_gaps_of_what_was_resampled_stay():
    y = resampled(noise(N), 1.4)
    y[1000:1100] = y[3000] = np.nan
    own = less_resampling(y)
    lost, seen = np.isnan(y), ~np.isnan(own)
    assert np.isnan(own[lost]).all() and (~seen & ~lost).sum() <= 2
    assert 0.5 < np.mean(own[seen] != y[seen])
    assert np.abs(own[seen]).max() < 1.5 * np.abs(y[seen]).max()


@pytest.mark.parametrize("ratio, lsb, effect", [(1.5, 0.1, "none"), *(
    thorough(ratio, lsb, effect) for ratio, lsb in ((1.07, 0.1), (1.8, 0.0))
    for effect in ("none", "bias_step", "sinusoid"))])
def test_what_is_in_a_resampled_record_is_named_beside_it(ratio, lsb, effect):
    rng, t = np.random.default_rng(6), np.arange(N)
    raw = rng.standard_normal(N) + np.cumsum(0.01 * rng.standard_normal(N))
    raw += dict(none=0.0, bias_step=1.5 * (t > 1100),
                sinusoid=0.4 * np.sin(0.3 * t))[effect]
    simulator = [sensorid.hypothesis("random_walk", sigma_w=(0.001, 0.02),
                                     sigma_v=(0.5, 2.0))]
    d = sensorlab.diagnose(resampled(raw, ratio, lsb), 0.01, simulator)
    assert set(d.verdict.split("+")) == {"interpolated_samples", effect} - {"none"}
    values = {one.name: one.values for one in d.found}
    assert values["interpolated_samples"]["frequency"][0] == pytest.approx(
        100.0 / ratio, rel=0.01)
    if effect == "sinusoid":
        assert values["sinusoid"]["frequency"][0] == pytest.approx(
            0.3 / ratio * 100.0 / 2.0 / np.pi, rel=0.01)
