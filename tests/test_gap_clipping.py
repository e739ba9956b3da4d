"""Limits: whether a record has them, and what lies beyond."""

import numpy as np
import pytest
from conftest import large, thorough
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import lfilter
from scipy.stats import norm

import sensorid
import sensorlab
from sensorlab.gap import clipping
from sensorlab.gap.effects import Scene
from sensorlab.gap.readings import readings, recorded


def limits_seen(y):
    return [r.found.values["limits"] for r in readings(Scene(y, 0.01, {}))
            if "limits" in r.found.values]


@pytest.mark.parametrize("share", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("factor", [0.0, 0.95])
def test_what_lies_beyond_limits_has_the_law_of_the_rest(share, factor):
    rng, ratios = np.random.default_rng(1), []
    for _ in range(20):
        x = rng.standard_normal(2000) + 0.3 * lfilter(
            [1.0], [1.0, -factor], rng.standard_normal(2000)) + 40.0
        low, high = np.quantile(x, [0.5 * share, 1.0 - 0.5 * share])
        y = np.clip(x, low, high)
        filled = clipping.unclipped(y, low, high)
        inside = (y > low) & (y < high)
        assert_array_equal(filled[inside], y[inside])
        assert np.all((filled <= low) | (filled >= high) | inside)
        ratios.append([filled.std() / x.std(),
                       np.diff(filled).std() / np.diff(x).std()])
    error = np.std(ratios, axis=0) / np.sqrt(20)
    assert np.all(np.abs(np.mean(ratios, axis=0) - 1.0) < 4.0 * error + 0.005)
    assert np.all(y[inside].std() < 0.97 * x.std())    # which the rest alone has not


@pytest.mark.parametrize("limits", [(-np.inf, 1.0), (-1.0, 2.0)])
def test_what_lies_beyond_the_limits_of_counts_has_the_law_of_counts(limits):
    x = np.random.default_rng(9).standard_normal(40_000)
    y, clipped = np.round(x), np.round(np.clip(x, *limits))
    filled = clipping.unclipped(clipped, *limits, 1.0)
    assert_array_equal(filled, np.round(filled))
    for code in (-3.0, -2.0, 1.0, 2.0, 3.0):
        count, true = np.sum(filled == code), np.sum(y == code)
        assert abs(count - true) < 5.0 * np.sqrt(true) + 0.05 * true    # fitted
    mean, sd = clipping.latent_law(clipped, limits, 1.0)
    assert abs(mean) < 0.03 and abs(sd - 1.0) < 0.03


def test_draws_beyond_a_limit_are_of_the_cut_normal_law():
    y = np.minimum(np.random.default_rng(2).standard_normal(40000), 1.0)
    filled = clipping.unclipped(y, -np.inf, 1.0)[y == 1.0]
    mean = norm.pdf(1.0) / norm.sf(1.0)
    sd = np.sqrt(1.0 + mean - mean**2)
    error = sd / np.sqrt(len(filled))
    assert abs(filled.mean() - mean) < 5.0 * error    # the law itself is estimated
    assert abs(filled.std() - sd) < 0.05 * sd


def test_what_is_missing_stays_so_and_draws_are_the_same_again():
    y = np.minimum(np.random.default_rng(3).standard_normal(500), 1.5)
    y[100:110] = np.nan
    filled = clipping.unclipped(y, -np.inf, 1.5)
    assert_array_equal(np.isnan(filled), np.isnan(y))
    clipping._unclipped.cache_clear()
    assert_array_equal(clipping.unclipped(y, -np.inf, 1.5), filled)
    short = clipping.unclipped(np.minimum(y[:100], 0.5), -np.inf, 0.5)
    assert np.all(np.isnan(short) == (y[:100] >= 0.5))


@pytest.mark.parametrize("x", [
    np.sin(0.1 * np.arange(500.0)), np.exp(0.2 * np.arange(500.0)),
    np.arange(500.0) % 2.0, 1e12 + np.sin(0.1 * np.arange(500.0))])
def test_what_has_no_noise_is_unclipped_without_end_or_error(x):
    high = np.quantile(x, 0.8)
    filled = clipping.unclipped(np.minimum(x, high), -np.inf, high)
    assert np.all(filled[x < high] == x[x < high])
    assert np.all((filled[x >= high] >= high) | np.isnan(filled[x >= high]))


@pytest.mark.parametrize("lsb, limit", [(0.5, 1.5), (0.8, 1.6), (1.0, 1.0)])
def test_counts_as_coarse_as_the_noise_show_a_limit(lsb, limit):
    rng = np.random.default_rng(6)
    for _ in range(20):
        x = 0.2 * rng.uniform(-1.0, 1.0) + rng.standard_normal(1500)
        assert not limits_seen(lsb * np.round(x / lsb))
        y = lsb * np.round(np.minimum(x, limit) / lsb)
        assert limits_seen(y) == [[-np.inf, limit]]


@pytest.mark.parametrize("lsb", [0.1, 0.4, 1.0])
def test_a_calmer_part_at_one_end_is_no_limit(lsb):
    rng, late = np.random.default_rng(7), np.arange(3000) >= 1500
    for _ in range(20):
        x = np.where(late, 3.0 + 0.4 * rng.standard_normal(3000),
                     rng.standard_normal(3000))
        assert not limits_seen(lsb * np.round(x / lsb))


@pytest.mark.parametrize("lsb", [0.1, 0.2])
def test_what_is_folded_is_not_limited(lsb):
    rng = np.random.default_rng(8)
    for _ in range(10):
        x = 1.0 - np.abs(1.0 - rng.standard_normal(1500))
        assert not limits_seen(lsb * np.round(x / lsb))


@pytest.mark.parametrize("lsb", [0.02, 0.2, thorough(0.1), thorough(0.5)])
def test_a_limit_shows_on_any_lattice_but_a_tail_does_not(lsb):
    rng = np.random.default_rng(4)
    for _ in range(20):
        x = rng.standard_normal(3000) + 0.2 * np.cumsum(
            0.1 * rng.standard_normal(3000))
        x = lsb * np.round(x / lsb)
        assert not limits_seen(x)
        high = lsb * np.round(np.quantile(x, 0.97) / lsb)
        ((low, seen),) = limits_seen(np.minimum(x, high))
        assert low == -np.inf
        assert_allclose(seen, high)


@pytest.mark.parametrize("lsb, share", [
    thorough(0.4, 0.1), thorough(0.6, 0.1), thorough(0.25, 0.03)])
def test_a_limit_shows_where_a_walk_wanders_beyond(lsb, share):
    """Which codes next to the last one are met most hangs on where it was for long."""
    found = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = 0.1 * np.cumsum(rng.standard_normal(3000)) + 0.5 * rng.standard_normal(3000)
        high = lsb * np.round(np.quantile(x, 1.0 - share) / lsb)
        x = lsb * np.round(x / lsb)
        assert not limits_seen(x)
        seen = limits_seen(np.minimum(x, high))
        found += bool(seen)
        assert all(low == -np.inf and np.isclose(end, high) for low, end in seen)
    assert found > 10


@pytest.mark.thorough
@pytest.mark.parametrize("scatter", [8.0, 30.0])
def test_what_is_folded_or_begins_again_at_its_other_end_has_no_limit(scatter):
    rng = np.random.default_rng(6)
    for _ in range(20):
        x = np.round(scatter * rng.standard_normal(3000))
        assert not limits_seen(np.abs(x))
        end = np.round(1.5 * scatter)
        assert not limits_seen((x + end) % (2.0 * end) - end)
        for lsb in (1.0, 0.05):
            ((low, _),) = limits_seen(recorded(
                lsb * np.maximum(x, 0.0), 0.01, {}).y)
            assert low == 0.0


@pytest.mark.parametrize("share", [large(0.03), 0.15])
def test_beneath_limits_the_noise_is_right_and_a_line_is_found(share):
    rng, time = np.random.default_rng(5), 0.01 * np.arange(3000)
    x = rng.standard_normal(3000)
    known = [sensorid.hypothesis("white_noise", sigma_v=1.0)]
    for line in (0.0, 0.3):
        y = x + line * np.cos(2.0 * np.pi * 7.3 * time)
        low, high = np.quantile(y, [0.5 * share, 1.0 - 0.5 * share])
        d = sensorlab.diagnose(np.clip(y, low, high), 0.01, known)
        assert d.verdict == ("saturation+sinusoid" if line else "saturation")
    amplitude, sd = d.found[-1].values["amplitude"]
    assert abs(amplitude - 0.3) < 3.0 * sd < 0.1
