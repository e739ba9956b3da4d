"""p-values where there is no gap."""

from types import SimpleNamespace

import generator
import numba
import numpy as np
import pytest
from conftest import DT, MODEL, member
from numpy.testing import assert_allclose
from scipy.stats import binom, kstest, norm

import sensorid
from sensorlab import CATALOGUE, Found, Scene, Simulator
from sensorlab.gap import (
    account, backward, closure, distance, known, linear, places, probes, readings,
    scans, signatures)
from sensorlab.gap.members import members


@pytest.mark.thorough
@pytest.mark.parametrize("steps", [0.0, 1.4])    # of a lattice, in the noise
def test_p_values_of_records_without_an_effect_are_uniform(steps):
    p = []
    for k, y in enumerate(sensorid.simulate(MODEL, DT, 1000, 60, seed=21).error):
        if steps:    # nearly as coarse as can be without more than a further noise
            lsb = steps * np.std(np.diff(y)) / np.sqrt(2.0)
            y = lsb * np.round(y / lsb)
        r = generator.record(31, k)
        scene = Scene(y, DT, dict(temperature=r["temperature"][:1000]))
        fit = known.with_readings(scene, members(Simulator(MODEL), scene), (),
                                       readings.readings(scene))
        gap = distance.distance(scene, fit)
        assert (gap.theta == fit.theta).all() and bool(fit.readings) == bool(steps)
        p.append(gap.p_value)
    assert kstest(p, "uniform").pvalue > 1e-3
    assert np.sum(np.array(p) < 0.05) <= binom.ppf(0.999, 60, 0.05)


@pytest.mark.parametrize("N", [1024, 1021])    # a spectrum of a prime length is slow
def test_statistics_of_white_residuals_are_standard_normal(N):
    rng = np.random.default_rng(N)
    z = rng.standard_normal((600, N))
    z[:, rng.random(N) < 0.1] = np.nan
    scene = Scene(z[0], DT, {})
    h = members(Simulator(MODEL), scene)[0]
    own = linear.filter_of(h, scene, (), np.array([p.mean for p in h.parameters]),
                           np.isnan(z[0]))
    found = places.statistics(z, z, scene, probes.probes(scene, own, 0))
    listed = np.isin(found.place, ("time", "frequency"))
    assert listed.sum() > 60 + 32
    value = found.value[:, listed]
    assert np.abs(value.mean(0)).max() < 0.25    # some are of a maximum
    assert np.abs(value.std(0) - 1.0)[:-1].max() < 0.2
    # the last is a maximum over lines that cross: it is as that of fewer, now and then
    assert 1.0 < value[:, -1].std() < 1.4


def test_a_record_alone_is_whitened_as_one_of_many():
    rng = np.random.default_rng(6)
    scene = Scene(rng.normal(size=300), DT, {})
    h = member(scene, MODEL[0], "narrow_band_noise", "correlated_noise")
    theta = np.array([p.mean for p in h.parameters])
    y, gap = rng.normal(size=(3, 300)), np.arange(300) % 17 == 3
    y[:, gap] = np.nan
    own = linear.filter_of(h, scene, (), theta, gap)
    u = rng.normal(size=(3, 260))
    for k in range(3):
        assert_allclose(own.whitened(y[k:k + 1])[0], own.whitened(y)[k], rtol=1e-11)
        assert_allclose(own.whitened_back(u[k:k + 1], 40)[0],
                        own.whitened_back(u, 40)[k], rtol=1e-9, atol=1e-12)


def test_residuals_that_go_back_through_the_filter_are_held_against_whitened_probes():
    rng = np.random.default_rng(6)
    y, first = rng.standard_normal(300), 90
    y[150:160] = np.nan
    scene = Scene(y, DT, dict(temperature=np.sin(0.02 * np.arange(300.0))))
    h, gap = members(Simulator(MODEL), scene)[0], np.isnan(y)
    wave = linear.Signature(Found(CATALOGUE["sinusoid"]), np.column_stack(
        [np.cos(0.3 * scene.time), np.sin(0.3 * scene.time)]), 2.0)
    theta = np.array([p.mean for p in h.parameters])
    own = linear.filter_of(h, scene, (wave,), theta, gap)
    late = scene.cut(slice(first, None))
    held = probes.probes(late, own, first)
    assert len(held.listed) == 32 + 5 + 2 + 1
    # the filter as a matrix, column by column
    every = np.eye(300)
    every[:, gap] = np.nan
    matrix = np.nan_to_num(own.whitened(every)).T
    rows = np.zeros((len(held.listed), 300))
    rows[:32, first:] = np.arange(210) >= held.shifts[:, None]
    rows[32:, first:] = held.curves
    white = (rows @ matrix.T)[:, first:]
    white /= np.linalg.norm(white, axis=1)[:, None]
    z = np.where(gap[first:], 0.0, rng.standard_normal((3, 210)))
    assert_allclose(held.products(z), white @ z.T, atol=1e-9)
    assert_allclose(held.whitened_curves(), white[32:], atol=1e-9)


def test_a_regression_by_parts_is_least_squares(monkeypatch):
    monkeypatch.setattr(closure, "TOGETHER", 70)
    rng = np.random.default_rng(8)
    even, y = rng.standard_normal((5, 400)), rng.standard_normal(400)
    rows = even * [[1.0], [1e-6], [3.0], [1e5], [1.0]]
    at = np.flatnonzero(rng.random(400) < 0.7)
    expected = y - np.linalg.lstsq(even[:, at].T, y[at])[0] @ even
    residual = closure.regression(lambda part: rows[:, part], y, at)
    assert_allclose(residual(np.arange(400)), expected, atol=1e-9)


def test_statistics_of_lags_and_ties_are_those_of_plain_sums():
    rng = np.random.default_rng(4)
    y = np.round(rng.standard_normal((3, 200)), 1)
    y[1, 20:30] = np.nan
    z, seen = np.nan_to_num(y), ~np.isnan(y)
    r = places._Residuals(z, seen, seen.sum(1), y, Scene(y[0], DT, {}))
    size = np.where(seen, np.minimum(np.abs(z) - np.sqrt(2.0 / np.pi), 5.0), 0.0)
    expected = [(x[:, k:] * x[:, :-k]).sum(1) / np.sqrt(r.count)
                for k in places.LAGS if k < 50 for x in (z, size)]
    found = list(places._in_lag(r, *places._power(r, slice(0, 200))))
    assert_allclose([one.value for one in found[:len(expected)]], expected, atol=1e-12)
    circular = [(z * np.roll(z, k, 1)).sum(1) / np.sqrt(r.count) for k in range(65)]
    octaves = found[len(expected):]
    for low, one in zip((4, 8, 16, 32), octaves, strict=True):
        sizes = np.abs(circular[low + 1:2 * low + 1])
        assert low + 1 + sizes.argmax(0)[0] == round(one.low / DT)
        p = 1.0 - (1.0 - 2.0 * norm.sf(sizes.max(0)))**low
        assert_allclose(norm.sf(one.value), p, atol=1e-9)
    *_, ties = places._in_amplitude(r)
    assert ties.value.tolist() == (np.diff(y) == 0.0).sum(1).tolist()


def test_what_comes_again_later_stands_out_at_its_lag():
    rng = np.random.default_rng(5)
    noise = rng.standard_normal(1525)
    y = np.cumsum(0.05 * rng.standard_normal(1500)) + 0.5 * (
        noise[25:] + 0.4 * noise[:-25])
    scene = Scene(y, DT, {})
    h = [sensorid.hypothesis("random_walk", sigma_w=(0.02, 0.2), sigma_v=(0.25, 1.0))]
    found = distance.distance(scene, account.account(scene, members(
        Simulator(h), scene)))
    largest = np.abs(found.distance).argmax()
    assert found.statistics.place[largest] == "lag"
    assert found.statistics.at[largest].tolist() == [25.0 * DT, 25.0 * DT]
    assert found.p_value < 1e-6


def test_a_line_that_sweeps_stands_out_where_it_begins_and_ends():
    rng, N, dt = np.random.default_rng(6), 2000, 0.1
    t, scene = dt * np.arange(N), Scene(np.zeros(N), dt, {})
    z = rng.standard_normal((40, N))
    # of a line of that power a matched filter has a score of 12
    z[:20] += np.sqrt(2.0 * 12.0**2 / N) * np.sin(
        2.0 * np.pi * (0.8 * t + 0.5 * (3.5 - 0.8) * t**2 / t[-1]))
    (one,) = places._moving_line(places._Residuals(
        z, np.ones(z.shape, bool), np.full(40, N), z, scene))
    swept, others = np.split(one.value, 2)
    assert swept.mean() > others.mean() + 4.0 * others.std()
    assert_allclose((one.low, one.high), (0.8, 3.5), atol=0.35)    # three lines
    # plain sums along every line
    power = rng.exponential(size=(5, 7, 2))
    largest, ends = np.zeros(2), np.zeros((2, 2), int)
    places._largest_track(1, 2, power, largest, ends)
    sums = {(a, b): sum(power[k, int(np.floor(a + (b - a) * (k + 0.5) / 5 + 0.5)), 1]
                        for k in range(5)) for a in range(7) for b in range(7)}
    assert tuple(ends[:, 1]) == max(sums, key=sums.get)
    assert_allclose(largest[1], max(sums.values()))


def test_what_was_not_fitted_shows_no_gap_where_there_is_none():
    h = [sensorid.hypothesis("markov", tau_m=(50.0, 1000.0), sigma_m=(0.3, 2.0),
                             sigma_v=(0.25, 1.0))]
    squares = []
    for seed in range(6):
        y = sensorid.simulate(h, DT, 1500, seed=seed).error[0]
        scene = Scene(y, DT, {})
        fit = account.account(Scene(y[:1000], DT, {}), members(Simulator(h), scene))
        gap = distance.distance(scene, fit, 99, 1000 + seed, 1000)
        assert len(gap.statistics.place) == gap.null.shape[1] and gap.p_value > 1e-3
        squares.append(np.mean(gap.distance**2))
    # over 40 seeds 1.00, and 0.23 from one to the next
    assert abs(np.mean(squares) - 1.0) < 4.0 * 0.23 / np.sqrt(6)


def of_no_record():
    """A `_Ruler` without marks, for statistics and gains that are made up."""
    fit = SimpleNamespace(setting=SimpleNamespace(acc=SimpleNamespace(readings=())))
    return distance._Ruler(fit, None, None)


def test_each_simulated_record_is_as_far_off_as_one_that_the_others_know_nothing_of(
        monkeypatch):
    monkeypatch.setattr(distance, "LINEAR", 0.0)
    rng = np.random.default_rng(3)
    B, d, S = 12, 2, 5
    s = rng.standard_normal((B, d))
    T = 3.0 + s @ rng.standard_normal((d, S)) + rng.standard_normal((B, S))
    _, null = of_no_record().marked(T, s, SimpleNamespace(value=T[:1], least=0.0))
    for b in range(B):
        others = np.arange(B) != b
        X, own = np.column_stack([np.ones(B), s]), np.append(1.0, s[b])
        past, square, *_ = np.linalg.lstsq(X[others], T[others], rcond=None)
        spread = square / (B - 1 - 1 - d) * (1.0 + own @ np.linalg.inv(
            X[others].T @ X[others]) @ own)
        # a real record is fitted: only the mean of B others is off
        assert_allclose(null[b], np.sqrt((1.0 + 1.0 / B) / spread) * (
            T[b] - own @ past), rtol=1e-9)


def test_what_no_refit_follows_leaves_all_else_as_it_is():
    rng, B = np.random.default_rng(5), 99
    slope, noise = np.array([[40.0], [-40.0], [0.0]]), 0.1

    def laid(B):    # two gains that are nearly one, and one that nothing hangs on
        both = rng.standard_normal((B, 1))
        s = np.hstack([both, both + 0.1 * rng.standard_normal((B, 1)),
                       rng.standard_normal((B, 1))])
        return s @ slope + noise * rng.standard_normal((B, 1)), s
    T, s = laid(B)
    ruler, _ = of_no_record().marked(T, s, SimpleNamespace(value=T[:1], least=0.0))
    T, s = laid(50)
    s[:, 2] = 30.0    # out of the range of its parameter
    assert np.sqrt(np.mean(ruler.distances(T, s)**2)) < 1.5
    # five times what a refit changes
    assert ruler.distances(T + 20.0, s).min() > 5.0


@pytest.mark.thorough
def test_few_simulated_records_make_no_gap():
    p = []
    for k, y in enumerate(sensorid.simulate(MODEL, DT, 600, 100, seed=22).error):
        scene = Scene(y, DT, {})
        fit = account.account(scene, members(Simulator(MODEL), scene))
        p.append(distance.distance(scene, fit, 30, 100 + k).p_value)
    assert kstest(p, "uniform").pvalue > 1e-3
    assert np.sum(np.array(p) < 0.3) <= binom.ppf(0.999, 100, 0.3)


def test_the_error_of_a_p_value_is_its_spread_over_sets_of_simulated_records():
    y = sensorid.simulate(MODEL[1:], DT, 600, seed=5).error[0]
    scene = Scene(y + 1.2 * (np.arange(600) % 40 == 0), DT, {})
    fit = account.account(scene, members(Simulator(MODEL), scene))
    gaps = [distance.distance(scene, fit, 80, seed) for seed in range(24)]
    spread = np.std([np.log(gap.p_value) for gap in gaps])
    told = np.mean([distance.log_p_error(gap) for gap in gaps])
    assert 0.5 < spread / told < 2.0 and spread > 0.05


def test_simulated_records_that_are_added_are_those_that_follow():
    y = sensorid.simulate(MODEL[1:], DT, 600, seed=5).error[0]
    scene = Scene(0.5 * np.round(y / 0.5), DT, {})
    fit = account.account(scene, members(Simulator(MODEL), scene))
    whole = distance.distance(scene, fit, 50, before=distance.distance(scene, fit, 10))
    part = distance.distance(scene, fit, 20, before=distance.distance(scene, fit, 10))
    more = distance.distance(scene, fit, 50, before=distance.distance(scene, fit, 10),
                             near=part)
    for name in ("distance", "null", "beside"):
        assert_allclose(getattr(more, name), getattr(whole, name), rtol=1e-6, atol=1e-9)


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="one thread only")
def test_the_number_of_threads_changes_no_bit():
    y = sensorid.simulate(MODEL[1:], DT, 700, seed=5).error[0]
    scene, told = Scene(y, DT, {}), []
    fit = account.account(scene, members(Simulator(MODEL), scene))
    solved = backward.solve(fit.member, scene, (), fit.sample.nodes(5))
    listed = signatures.families(scene, [CATALOGUE[name] for name in (
        "bias_step", "pulse", "sinusoid", "turn_on_transient")])
    before = numba.get_num_threads()
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            gap = distance.distance(scene, fit, 9)
            told.append(np.concatenate([gap.null.ravel(), gap.z, *(
                scans.family_bayes(scene, family, solved, solved.node(0),
                                   signatures.bayes_table())[0]
                for family in listed)]))
    finally:
        numba.set_num_threads(before)
    assert np.array_equal(*told)


def test_a_root_is_found_though_the_slopes_that_are_told_are_wrong():
    true, root = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([30.0, 5.0])

    def missed(at):
        return true @ (at - root), 5.0 * np.eye(2)
    at = distance._root(missed, [np.ones(2)], np.ones(2), 24)
    assert np.linalg.norm(missed(at)[0]) < np.sqrt(5.0) * distance.THERE


def test_a_search_without_a_root_stays_where_it_was_best():
    def missed(at):
        return np.array([2.0 + np.abs(at[0] - 3.0)]), np.eye(1)
    at = distance._root(missed, [np.ones(1)], np.ones(1), 24)
    assert missed(at)[0] <= missed(np.ones(1))[0]
    assert distance._root(lambda at: (np.array([np.nan]), np.eye(1)), [np.ones(1)],
                          np.ones(1), 24) == 1.0


def test_what_no_record_has_is_no_gap():
    assert 0.3 < distance._tail(0.0, np.zeros(49)) < 0.6
    assert distance._tail(1.0, np.zeros(50)) == 1e-15
