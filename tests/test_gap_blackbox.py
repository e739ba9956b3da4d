"""A simulator that is known by its records."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from conftest import DT, WHITE, dense, large, thorough
from numpy.testing import assert_allclose
from scipy.signal import lfilter

import sensorid
import sensorlab
from sensorlab import Scene
from sensorlab.gap import blackbox, words
from sensorlab.gap.distance import distance
from sensorlab.gap.joint import NEAR, SHARE, surface_of
from sensorlab.gap.members import members
from sensorlab.gap.twins import less_shared
from sensorlab.gap.wrong import Beyond


def sensor(rng, n=2000, sigma=0.5, lines=(0.9,)):
    """Rounded, with lines, a slow process and white noise."""
    t, x = np.arange(n), np.zeros(n)
    w = 0.05 * rng.standard_normal(n)
    for i in range(1, n):
        x[i] = 0.98 * x[i - 1] + w[i]
    y = x + sigma * rng.standard_normal(n) + sum(
        0.3 * np.sin(line * t + rng.uniform(0, 6)) for line in lines)
    return 0.25 * np.round(y / 0.25)


@pytest.fixture(scope="module")
def known():
    y = sensor(np.random.default_rng(5))
    return y, sensorlab.simulator_from(y[None], DT)


@pytest.mark.large
def test_a_record_beside_itself_has_no_gap(known):
    y, simulator = known
    assert "quantization" in [one.name for one in simulator.effects[0]]
    d = sensorlab.diagnose(y, DT, simulator)
    assert d.verdict == "none" and d.before.p_value > 0.99


@pytest.mark.large
def test_what_both_have_is_no_gap_and_what_one_has_is(known):
    y, simulator = known
    other = sensor(np.random.default_rng(6))
    assert sensorlab.diagnose(other, DT, simulator).verdict in (
        "none", "undecided")
    other[900:] += 1.0
    assert "bias_step" in sensorlab.diagnose(other, DT, simulator).verdict.split("+")


def vibrating(rng, n, frequency=1.3, amplitude=0.6):
    """A line in white noise."""
    t = 0.1 * np.arange(n)
    return 0.5 * rng.standard_normal(n) + amplitude * np.sin(
        2.0 * np.pi * frequency * t + rng.uniform(0.0, 6.0))


@pytest.mark.parametrize("seed", [
    thorough(1003), *map(thorough, (1004, 1001, 1006))])
def test_a_line_is_known_no_better_than_a_short_record_tells(seed):
    rng = np.random.default_rng(seed)
    theirs, y = vibrating(rng, 500), vibrating(rng, 2500)
    simulator = sensorlab.simulator_from(theirs[None], 0.1)
    (line,), = simulator.effects
    frequency = line.values["frequency"]
    assert frequency.low < 1.3 < frequency.high
    # its standard error: D. Rife, R. Boorstyn, IEEE Trans. Inf. Theory 20, 1974
    amplitude = np.hypot(*(np.mean(theirs * wave(2.0 * np.pi * 1.3 * 0.1 * np.arange(
        500))) * 2.0 for wave in (np.sin, np.cos)))
    sd = np.sqrt(6.0) * 0.5 / (np.pi * amplitude * 50.0 * np.sqrt(500.0))
    half = 0.5 * (frequency.high - frequency.low)
    assert half == pytest.approx(np.sqrt(3.0) * sd, rel=0.15)
    d = sensorlab.diagnose(y, 0.1, simulator)
    assert d.verdict == "none" and not d.shared


@pytest.mark.large
def test_a_line_that_moved_is_no_gap_and_is_told_of():
    rng = np.random.default_rng(7)
    theirs, y = vibrating(rng, 1000, 1.4), vibrating(rng, 1000, 1.3, 0.8)
    simulator = sensorlab.simulator_from(theirs[None], 0.1)
    d = sensorlab.diagnose(y, 0.1, simulator)
    assert d.verdict == "none" and d.before.p_value > 0.01 and not d.found
    (line,) = d.shared
    assert line.name == "sinusoid" and abs(line.values["frequency"][0] - 1.3) < 0.002
    y[600:] += 1.5
    d = sensorlab.diagnose(y, 0.1, simulator)
    assert d.verdict == "bias_step" and d.closure.closed > 0.9
    assert [one.name for one in d.shared] == ["sinusoid"]
    said = sensorlab.table(d, sensorlab.Recording("a.csv", "error", y, 0.1), "u")
    assert "sinusoid of 1.3 Hz is no gap" in said


@pytest.mark.large
def test_a_parameter_that_moved_leaves_no_gap_behind(known):
    # the simulator's own record lies far from the fit of this one
    y, simulator = known
    other = sensor(np.random.default_rng(8), sigma=0.9)
    d = sensorlab.diagnose(other, DT, simulator)
    assert d.verdict == "wrong_parameter" and d.remainder.where == -1


@pytest.mark.thorough
def test_a_process_at_an_end_of_its_range_does_not_stand_for_a_filter():
    # noise of which neighbours have a part in common, as after a short filter: a Markov
    # process cannot be as fast
    w = 0.41 * np.random.default_rng(2).standard_normal((2, 4001))
    y, other = 0.05 * np.round((w[:, 1:] + 0.18 * w[:, :-1]) / 0.05)
    simulator = sensorlab.simulator_from(y[None], DT)
    assert "bandwidth" in [one.name for one in simulator.effects[0]]
    assert sensorlab.diagnose(other, DT, simulator).verdict == "none"


@pytest.mark.thorough
def test_a_line_that_moved_is_no_other_line(known):
    y, simulator = known
    assert "sinusoid" in [one.name for one in simulator.effects[0]]
    for lines, verdict in (((0.86,), "none"), ((0.9, 0.86), "sinusoid")):
        other = sensor(np.random.default_rng(8), lines=lines)
        d = sensorlab.diagnose(other, DT, simulator)
        assert d.verdict == verdict


@pytest.mark.thorough
def test_a_line_that_all_their_records_have_at_one_frequency_is_missed_elsewhere():
    """And theirs is gone."""
    own = np.array([sensor(np.random.default_rng(k)) for k in range(3)])
    simulator = sensorlab.simulator_from(own, DT)
    for line, verdict in (
            (0.9, "none"), (1.0, "sinusoid+wrong_parameter")):
        y = sensor(np.random.default_rng(7), lines=(line,))
        d = sensorlab.diagnose(y, DT, simulator)
        assert d.verdict == verdict


@pytest.mark.parametrize("records, apart", [
    (2, 0.0), large(2, 0.2), large(3, 0.1), (3, 0.4), (6, 0.3)])
def test_a_range_holds_what_a_further_record_has(records, apart):
    """As often as it says, or more often, and no farther than need be."""
    rng, sd, hits, trials = np.random.default_rng(2), 0.1, 0, 400
    parameter = sensorid.Parameter("sigma_w", 0.01, 100.0, True)
    for _ in range(trials):
        truth = rng.normal(0.0, apart, records + 1)
        samples = [SimpleNamespace(
            theta=np.exp(at + sd * np.array([[-1.0], [1.0]])), weight=np.full(2, 0.5))
            for at in truth[1:] + sd * rng.standard_normal(records)]
        (p,) = blackbox._ranges((parameter,), samples)
        hits += p.low <= np.exp(truth[0]) <= p.high
    assert hits / trials > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / trials)


@pytest.fixture(scope="module")
def slow():
    """A record with slow noise, weak enough that it may be faster and stronger, and the
    simulator that is known by it.
    """
    h = sensorid.hypothesis("markov", tau_m=20.0, sigma_m=0.4, sigma_v=1.0)
    (y,) = sensorid.simulate([h], DT, 700, seed=8).error
    return y, sensorlab.simulator_from(y[None], DT)


def exact(y, theta, bias_sigma):
    """Log-likelihoods (M,), but for a constant, by the dense covariance."""
    result = []
    for one in theta:
        C = dense(one, len(y), bias_sigma)
        result.append(-0.5 * (np.linalg.slogdet(C)[1] + y @ np.linalg.solve(C, y)))
    return np.array(result)


def test_a_simulator_knows_how_its_parameters_hang_together(slow):
    y, simulator = slow
    (h,) = members(simulator, Scene(y, DT, {}))
    assert [symbol for _, symbol in simulator.joint.keys] == [
        "tau_m", "sigma_m", "sigma_v"]
    u = np.random.default_rng(1).random((60, 3))
    theta = np.array([p.quantile(x) for p, x in zip(h.parameters, u.T)]).T
    told, true = h.log_joint(theta) / SHARE, exact(y, theta, 1e3)
    near = true > true.max() - 12.0
    assert near.sum() > 20 and true.min() < true.max() - 12.0
    off = told - true - np.mean((told - true)[near])
    assert np.sqrt(np.mean(off[near]**2)) < 0.2
    assert (told[~near] < told.max() - 8.0).all()


def test_what_may_be_wrong_says_nothing_of_the_others(slow):
    y, simulator = slow
    (h,) = members(simulator, Scene(y, DT, {}))
    p = h.parameters[2]
    loose = h.with_prior(("", "sigma_v"), Beyond(
        "sigma_v", 0.01 * p.low, 100.0 * p.high, p.low, p.high))
    middle = np.array([one.mean for one in h.parameters])
    theta = np.tile(middle, (4, 1))
    theta[:, 0] = np.linspace(h.parameters[0].low, h.parameters[0].high, 6)[1:-1]
    told = loose.log_joint(theta * [1.0, 1.0, 7.0])
    every = np.linspace(p.low, p.high, 41)[1::2]
    true = [np.logaddexp.reduce(SHARE * exact(
        y, [(*one[:2], x) for x in every], 1e3)) for one in theta]
    assert_allclose(told - told[0], true - true[0], atol=0.2)


@pytest.mark.parametrize("width, axes, is_to_be_had", [
    (0.3, 2, True), (0.03, 2, True), (0.1, 3, True), (0.03, 4, False)])
def test_a_surface_is_near_a_bent_ridge_or_there_is_none(width, axes, is_to_be_had):
    def ridge(place):
        x = 4.0 * (place - 0.5)
        across = (x[:, 1] - np.sin(1.3 * x[:, 0])) / width
        return 7.0 - 0.5 * (across**2 + (x**2).sum(1) - x[:, 1]**2)
    rng = np.random.default_rng(3)
    x = rng.standard_normal((800, axes))
    x[:, 1] = np.sin(1.3 * x[:, 0]) + width * x[:, 1]
    known, place = np.split(0.5 + 0.25 * x, 2)
    surface = surface_of(ridge, known, ridge(known), 256)
    assert (surface is not None) == is_to_be_had
    if is_to_be_had:
        place = place[(np.abs(place - 0.5) < 0.5).all(1)]
        off = surface(place) - ridge(place) + 7.0
        assert np.sqrt(np.mean((off - off.mean())**2)) < 0.1
        everywhere = rng.random((4000, axes))
        low = ridge(everywhere) < 7.0 - 2.0 * NEAR
        assert low.sum() > 400 and surface(everywhere[low]).max() < -NEAR


def slow_noise(rng, tau, sigma, n=1500):
    a = np.exp(-1.0 / tau)
    return lfilter([sigma * np.sqrt(1.0 - a * a)], [1.0, -a],
                   rng.standard_normal(n + 200))[200:]


@pytest.mark.thorough
def test_noise_hides_in_no_corner_of_the_ranges():
    # each range of its slow noise holds what is put in, but no record of it is both as
    # fast and as strong
    rng = np.random.default_rng(1)
    theirs, y = (rng.standard_normal(1500) + slow_noise(rng, 40.0, 0.7)
                 for _ in range(2))
    simulator = sensorlab.simulator_from(theirs[None], DT)
    tau, sigma, _ = simulator.hypotheses[0].parameters
    assert tau.low < 6.0 < tau.high and sigma.low < 0.55 < sigma.high
    for more, verdict in ((0.0, "none"), (0.55, "correlated_noise")):
        d = sensorlab.diagnose(y + slow_noise(rng, 6.0, more), DT, simulator)
        assert d.verdict == verdict


@pytest.mark.thorough
def test_a_walk_that_was_described_as_a_drift_is_not_surely_missing():
    h = sensorid.hypothesis("random_walk", sigma_w=0.014, sigma_v=1.0)
    theirs, y = (sensorid.simulate([h], DT, n, seed=seed).error[0]
                 for n, seed in ((1500, 1004), (6000, 5004)))
    simulator = sensorlab.simulator_from(theirs[None], DT)
    assert [one.name for one in simulator.effects[0]] == ["second_order_drift"]
    d = sensorlab.diagnose(y, DT, simulator)
    none = next(c for c in d.causes if not c.found)
    assert d.verdict in ("none", "undecided") and none.probability > 0.2


def test_records_that_agree_are_a_narrower_range_than_their_scatter_alone():
    means, sds = np.array([-0.18, 0.02, 0.16]), np.full(3, 0.1)
    beside = blackbox._half_beside(means, sds)
    assert 2.0 * 0.1 < beside < 0.8 * blackbox._half(means)
    assert_allclose(blackbox._half_beside(means + 5.0, sds), beside)


@pytest.mark.parametrize("added, verdicts, said", [
    (lambda i: i / 2000.0, ("rate_ramp", "rate_ramp or second_order_drift"),
     "neighbours are multiples"),
    (lambda i: 0.15 * np.sin(2.3 * i), ("sinusoid",), "the record does not: its own")])
def test_what_was_added_after_the_rounding_is_all_there_is(known, added, verdicts,
                                                           said):
    y, simulator = known
    other = sensor(np.random.default_rng(9)) + added(np.arange(2000))
    d = sensorlab.diagnose(other, DT, simulator)
    assert d.verdict in verdicts
    assert any(said in line and "after it was rounded" in line
               for line in words.advice(d, "u"))


def test_gaps_measured_with_more_records_than_before_stand_beside_each_other(known):
    y, simulator = known
    d = sensorlab.diagnose(y, DT, simulator)
    before = distance(d.scene, d.base, 40)
    after = distance(d.scene, d.base, 60, before=before)
    gap = less_shared(after, before.ruler.measured(y[None] - d.scene.known))
    assert len(gap.null) == len(gap.beside) == 60


def test_what_only_the_simulators_records_have_is_no_gap_of_the_record(known):
    y, simulator = known
    d = sensorlab.diagnose(y, DT, simulator)
    gap = distance(d.scene, d.base, 60)
    odd = np.where(np.arange(len(gap.distance)) % 7, 0.0, 9.0)
    for own in (odd, -odd, np.random.default_rng(2).standard_normal(len(odd))):
        assert less_shared(gap, own[None]).p_value >= gap.p_value
    shared = gap._replace(distance=odd)
    assert less_shared(shared, odd[None]).p_value > 0.9
    assert_allclose(less_shared(shared, -odd[None]).distance, odd)


def on_a_weak_walk(seed):
    rng = np.random.default_rng(seed)
    return rng.standard_normal(1200) + np.cumsum(0.01 * rng.standard_normal(1200))


@pytest.mark.parametrize("own, seed", [(1, 104), large(2, 102)])
def test_a_walk_that_one_record_does_not_show_is_no_gap_in_the_next(own, seed):
    y = on_a_weak_walk(own)[None]
    first = sensorlab.diagnose(y[0], DT).final
    assert first.member.hypothesis.name == "white_noise"    # hardly likelier
    simulator = sensorlab.simulator_from(y, DT)
    assert simulator.hypotheses[0].name in ("random_walk", "markov")
    assert sensorlab.diagnose(on_a_weak_walk(seed), DT, simulator).verdict == "none"


def test_few_records_tell_how_wide_their_parameters_spread():
    rng = np.random.default_rng(7)
    y = np.array([sigma * rng.standard_normal(500) for sigma in (0.8, 1.0, 1.2)])
    (h,) = sensorlab.simulator_from(y, DT).hypotheses
    (p,) = [p for p in h.parameters if p.symbol == "sigma_v"]
    # Student's law of two degrees of freedom, of the logarithms
    half = 4.3 * np.sqrt(4.0 / 3.0) * np.std(np.log([0.8, 1.0, 1.2]), ddof=1)
    assert_allclose(np.log(p.high / p.low), 2.0 * half, rtol=0.15)


def test_a_factor_on_all_standard_deviations_is_in_them(monkeypatch):
    said = [sensorid.hypothesis("random_walk", sigma_w=0.1, sigma_v=0.5)]
    y = 9.80665 * sensorid.simulate(said, DT, 1500, seed=4).error
    monkeypatch.setattr(blackbox, "diagnose", lambda y, dt, columns:
                        sensorlab.diagnose(y, dt, said, columns))
    simulator = sensorlab.simulator_from(y, DT)
    assert simulator.effects == ((),)
    (_, p) = simulator.hypotheses[0].parameters
    assert 4.4 < p.low < 4.90333 < p.high < 5.4


@pytest.mark.large
@pytest.mark.parametrize("times, verdict", [(1.0, "none"), (3.0, "wrong_parameter")])
def test_a_line_of_several_records_has_the_amplitude_that_they_tell(times, verdict):
    rng, t = np.random.default_rng(3), np.arange(3000)

    def record(amplitude):
        return rng.standard_normal(3000) + amplitude * np.cos(
            0.34 * np.pi * t + rng.uniform(-np.pi, np.pi))
    simulated, y = np.array([record(0.5) for _ in range(4)]), record(0.5 * times)
    d = sensorlab.diagnose(y, 0.1, sensorlab.simulator_from(simulated, 0.1))
    assert d.verdict == verdict
    for one in d.found:
        assert one.values["parameter"][0] == "sinusoid.amplitude"
        assert abs(one.values["factor"][0] - times) < 0.3


@pytest.mark.large
def test_a_stronger_effect_than_theirs_is_not_shared():
    rng = np.random.default_rng(1)
    theirs, y = rng.standard_normal((2, 3000))
    theirs[[500, 1300, 2200]] += [4.0, -4.5, 4.0]
    y[rng.choice(3000, 21, replace=False)] += 6.0 * rng.standard_normal(21)
    simulator = sensorlab.simulator_from(theirs[None], DT)
    assert not simulator.effects[0]
    d = sensorlab.diagnose(y, DT, simulator)
    assert d.verdict == "outliers"


@pytest.mark.parametrize("effect", [
    thorough("noise_ramp"), large("noise_sensitivity")])
def test_noise_that_follows_something_is_sought_in_the_simulators_record(effect):
    rng, turn = np.random.default_rng(1), np.linspace(-1.0, 1.0, 2000)
    theirs, y = rng.standard_normal((2, 2000))
    columns = {}
    if effect == "noise_sensitivity":
        turn = np.sin(4.0 * np.pi * turn)
        columns = dict(temperature=25.0 + 5.0 * turn)
    simulator = sensorlab.simulator_from(theirs[None], DT, columns)
    d = sensorlab.diagnose(y * 1.7**turn, DT, simulator, columns)
    assert d.verdict == effect


def behind_a_filter(rng, tau, lsb, n=2000):
    """White noise of variance 1 before a low-pass, then rounded."""
    a = np.exp(-0.01 / tau)
    return lsb * np.round(lfilter([1.0 - a], [1.0, -a], rng.normal(size=n + 50))[50:]
                          * np.sqrt((1.0 + a) / (1.0 - a)) / lsb)


@pytest.mark.thorough
def test_what_their_record_shows_weakly_is_no_gap():
    # of six records of one law, that which shows the low-pass least
    rng = np.random.default_rng(5)
    y, *others = (behind_a_filter(rng, 0.0045, 0.1) for _ in range(7))
    theirs = min(others, key=lambda z: np.mean(z[1:] * z[:-1]))
    simulator = sensorlab.simulator_from(theirs[None], 0.01)
    assert not any(one.name == "bandwidth" for one in simulator.effects[0])
    d = sensorlab.diagnose(y, 0.01, simulator)
    assert d.verdict == "none"


def test_counts_that_both_have_are_no_gap_where_one_is_smoother():
    rng = np.random.default_rng(1)
    theirs = 0.08 * np.round(rng.normal(size=2000) / 0.08)
    a = np.exp(-0.01 / 0.0085)
    y = 0.08 * np.round(lfilter([1.0 - a], [1.0, -a], rng.normal(size=2000)) / 0.08)
    d = sensorlab.diagnose(y, 0.01, sensorlab.simulator_from(theirs[None], 0.01))
    assert d.verdict == "bandwidth"


@pytest.mark.large
def test_a_factor_on_counts_coarser_than_the_noise_and_on_the_noise_is_named():
    """What such counts leave of the simulator's noise says nothing of this record."""
    def counts(seed):
        return 2.0 * np.round(0.5 * slow_and_white(np.random.default_rng(seed)))

    def slow_and_white(rng):
        drift = lfilter([1.0], [1.0, -0.998], 0.06 * rng.standard_normal(6000))
        return drift[2000:] + rng.standard_normal(4000)
    theirs = np.array([counts(1), counts(2)])
    simulator = sensorlab.simulator_from(theirs, DT)
    d = sensorlab.diagnose(9.80665 * counts(3), DT, simulator)
    assert d.verdict == "wrong_parameter+wrong_parameter"


@pytest.mark.parametrize("kind", ["repeated_samples", large("interpolated_samples")])
def test_what_says_nothing_new_widens_no_range(kind):
    """Of several records, too, samples that repeat or lie between others are left out.
    """
    h = sensorid.hypothesis("random_walk", sigma_w=0.05, sigma_v=0.5, bias_sigma=1.0)
    raw = sensorid.simulate([h], DT, 1001, trials=4, seed=2).error
    i = np.arange(2000) / 2.0
    *records, last = [np.interp(i, np.arange(1001), one) for one in raw] if (
        kind == "interpolated_samples") else raw[:, np.floor(i).astype(int)]
    simulator = sensorlab.simulator_from(np.array(records), DT)
    assert [one.name for one in simulator.effects[0]] == [kind]
    for p in simulator.hypotheses[0].parameters:
        if p.symbol == "sigma_v":
            assert p.low < 0.5 < p.high < 2.0 * p.low
    d = sensorlab.diagnose(last, DT, simulator)
    assert d.verdict == "none"


def stuck_at_random(y, seed):
    y = y.copy()
    for begin in np.random.default_rng(seed).integers(0, len(y) - 40, 12):
        y[begin:begin + 30] = y[begin]
    return y


@pytest.mark.parametrize("size", [0.0, thorough(1.5)])
def test_samples_of_its_own_are_stuck_in_every_record(size):
    """Were those of the one left out of the other, what sticks there would hide all."""
    h = sensorid.hypothesis("random_walk", sigma_w=0.02, sigma_v=1.0, bias_sigma=1.0)
    theirs, y = sensorid.simulate([h], 0.01, 3000, trials=2, seed=10).error
    level = np.cumsum(np.random.default_rng(3).random(3000) < 1.0 / 150.0) % 2
    records = stuck_at_random(theirs, 1)[None]
    d = sensorlab.diagnose(
        stuck_at_random(y + size * level, 2), 0.01,
        sensorlab.simulator_from(records, 0.01))
    assert d.verdict == ("random_telegraph" if size else "none")
    assert (d.before.p_value < 1e-3) == bool(size)


@pytest.mark.parametrize("records, message", [
    (None, "an array .L, N. of numbers"), ("a", "an array .L, N. of numbers"),
    (pd.DataFrame(np.ones((2, 99))), "record 0 of the simulator: .* not all the same"),
    ([], "an array .L, N. of numbers"), ([np.arange(99.0), np.arange(98.0)],
                                         "each record as long as the others"),
    (np.ones((2, 2, 500)), "an array .L, N. of numbers"),
    ([np.arange(99.0), np.ones(99)], "record 1 of the simulator: .* not all the same"),
    ([[1.0, 2.0]], "record 0 of the simulator: .* at least 64")])
def test_what_are_no_records_of_a_simulator_gets_one_sentence(records, message):
    with pytest.raises(ValueError, match=message):
        sensorlab.simulator_from(records, DT)
    if records is not None:    # without, there are none
        with pytest.raises(ValueError, match=message):
            sensorlab.diagnose(np.arange(99.0), DT, WHITE, simulated=records)
