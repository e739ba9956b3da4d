"""Lost samples for which a file has a constant."""

import numpy as np
import pytest
from conftest import large
from numpy.testing import assert_array_equal

import sensorid
import sensorlab
from sensorlab.gap.dropouts import dropouts

N = 4000
WHITE = np.random.default_rng(0).standard_normal(N)
LOST = np.random.default_rng(1).random(N) < 0.03
TIME = 0.01 * np.arange(N)


def counts(y, lsb):
    return lsb * np.round(y / lsb)


@pytest.mark.parametrize("y, lsb", [
    (WHITE, 0.0), (counts(WHITE, 0.05), 0.05),
    (counts(WHITE + 3.0, 0.3), 0.3),    # 3 sigma away is a code that is seldom met
    (20.0 * np.sin(TIME) + 0.1 * WHITE, 0.0),    # a motion goes through it
    (np.minimum(WHITE, 1.0), 0.0)
], ids=["doubles", "fine counts", "counts", "motion", "clipped"])
@pytest.mark.parametrize("value", [0.0, -9999.0, "between codes"])
def test_what_is_lost_is_seen(y, lsb, value):
    value = float(np.median(y)) + 0.4 * lsb if value == "between codes" else value
    told = dropouts(np.where(LOST, value, y))
    if value == 0.0 and lsb == 0.05:    # a code that is met as often
        assert not told.own.any()
        return
    assert_array_equal(told.own, np.where(LOST, value, y) == value)
    assert told.value == value


def test_a_constant_between_few_codes_is_seen():
    """It spoils the lattice of 30 codes, and no code of these is it."""
    for seed in range(10):
        y = counts(np.random.default_rng(seed).standard_normal(N), 0.2)
        y[LOST] = 0.313
        told = dropouts(y)
        assert told.value == 0.313 and told.own.sum() == LOST.sum()


@pytest.mark.parametrize("lsb", [0.0, 0.1, 1.0, 5.0])
def test_what_is_far_from_all_that_a_sensor_gives_is_lost(lsb):
    y = counts(WHITE, lsb) + 12.0 if lsb else WHITE + 12.0
    for value in (-9999.0, 0.0) if lsb < 5.0 else (-9999.0,):
        assert_array_equal(dropouts(np.where(LOST, value, y)).own, LOST)


@pytest.mark.parametrize("value, spells", [
    (0.0, [(700, 2)]), (0.0, [(700, 1), (2900, 1)]), (0.0, [(700, 8), (2900, 11)]),
    (-9999.0, [(700, 9)]), (-9999.0, [(700, 8), (2900, 11)])])
@pytest.mark.parametrize("lsb", [0.0, 0.04, 0.3])
def test_few_spells_far_from_all_that_a_sensor_gives_are_lost(lsb, value, spells):
    """A sensor that is stuck is so where it was: the first sample is lost, too."""
    y = counts(WHITE, lsb) + 900.0 if lsb else WHITE + 900.0
    for start, many in spells:
        y[start:start + many] = value
    assert_array_equal(dropouts(y).own, y == value)
    for others in ([value], [value + 0.3, value - 0.6], [y[:400].min()] * 7):
        assert not dropouts(np.append(y[y != value], others)).own.any()


@pytest.mark.parametrize("at", [1.6, 2.4, 5.0])
def test_spans_that_are_all_at_zero_are_lost(at):
    rng, begins = np.random.default_rng(8), range(100, N, 600)
    for _ in range(5):
        y = counts(at + rng.standard_normal(N), 1.0)
        for begin in begins:
            y[begin:begin + 25] = 0.0
        own = dropouts(y).own
        assert own[[range(begin, begin + 25) for begin in begins]].all()
        assert own.sum() < 25 * len(begins) + 20    # a reading beside them may be 0
        assert not dropouts(stuck(counts(at + rng.standard_normal(N), 1.0))).own.any()


def with_a_knock(y):
    y = y.copy()
    y[1000:1006] = 60.0
    return y


def level(seed, size):
    change = np.random.default_rng(seed).random(N) < 0.01
    return size * (np.cumsum(change) % 2)


def stuck(y):
    y = y.copy()
    for begin in range(50, N - 50, 400):
        y[begin:begin + 30] = y[begin]
    return y


@pytest.mark.parametrize("y", [
    WHITE, np.zeros(N), np.full(N, np.nan), np.array([1.0, 2.0, 1.0]),
    *(counts(WHITE, lsb) for lsb in (0.001, 0.1, 0.3, 1.0, 2.0, 5.0)),
    *(0.1 * np.trunc(10.0 * WHITE) for _ in range(1)),    # a code twice as wide
    np.clip(WHITE, -1.0, 1.0), np.maximum(WHITE, -0.3), np.abs(WHITE),
    np.where(np.abs(WHITE) < 0.3, 0.0, WHITE),    # a dead zone
    *(counts(level(2, 20.0) + sigma * WHITE, lsb)    # of two levels that are one code
      for sigma in (0.02, 0.5) for lsb in (0.1, 1.0, 3.0)), level(2, 20.0),
    np.clip(np.where(LOST, 50.0 * WHITE[::-1], WHITE), -60.0, 60.0),
    np.repeat(WHITE[:N // 4], 4), np.repeat(with_a_knock(WHITE)[:N // 4], 4),
    np.repeat(np.append(WHITE[:N // 8], 60.0), 8),    # as often as any other
    counts(with_a_knock(0.0 * TIME + 1.0) + 0.2 * WHITE, 1.0),
    *(counts(20.0 * (TIME > at) + 0.15 * WHITE, 1.0) for at in (1.0, 15.0)),
    stuck(WHITE), np.where(LOST, np.nan, WHITE)])
def test_what_a_sensor_gives_is_no_dropout(y):
    assert not dropouts(y).own.any()


@pytest.mark.parametrize("lsb", [0.0, 0.2, 1.0, 1.5])
def test_zeros_that_no_noise_reaches_are_lost_and_no_limit(lsb):
    """In a few spells, among values of which hardly any comes near."""
    rng = np.random.default_rng(5)
    y = 4.5 + WHITE + 0.3 * np.sin(TIME)
    y = counts(y, lsb) if lsb else y
    for start in rng.choice(N - 9, 12, replace=False):
        y[start:start + rng.integers(1, 6)] = 0.0
    assert_array_equal(dropouts(y).own, y == 0.0)
    assert_array_equal(dropouts(-y).own, y == 0.0)
    # a limit is met by what is foretold to be near, in however many spells
    for clipped in (np.maximum(WHITE + 2.5, 0.0), np.maximum(
            4.0 + 5.0 * np.sin(20.0 * TIME) + 0.3 * WHITE, 0.0)):
        assert not dropouts(counts(clipped, lsb) if lsb else clipped).own.any()


@pytest.mark.parametrize("value", [0.0, -9999.0])
@pytest.mark.parametrize("missing", ["", large("sinusoid")])
def test_nothing_but_lost_samples_is_missing(value, missing):
    ranges = sensorid.hypothesis("random_walk", sigma_w=(0.0007, 0.006),
                                 sigma_v=(0.005, 0.02), bias_sigma=1.0)
    truth = sensorid.hypothesis("random_walk", sigma_w=0.002, sigma_v=0.01,
                                bias_sigma=0.02)
    (y,) = sensorid.simulate([truth], 0.01, N, trials=1, seed=1).error
    y = y + 0.005 * np.sin(20.0 * TIME) * bool(missing)
    d = sensorlab.diagnose(np.where(LOST, value, y), 0.01, [ranges])
    assert d.verdict.split("+") == ["dropouts", *filter(None, [missing])]
    values = d.found[0].values
    assert values["value"] == (value, 0.0)
    assert sum(n for _, n in values["spans"][0]) == LOST.sum()


@pytest.mark.large
def test_dropouts_that_both_have_are_no_gap():
    rng = np.random.default_rng(4)
    theirs, y = rng.standard_normal((2, 3000))
    theirs[rng.random(3000) < 0.02] = y[rng.random(3000) < 0.04] = 0.0
    for own, verdict in (theirs, "none"), (rng.standard_normal(3000), "dropouts"):
        simulator = sensorlab.simulator_from(own[None], 0.01)
        assert sensorlab.diagnose(y, 0.01, simulator).verdict == verdict
