"""Counts of the integral, as pulses of an integrating sensor, are seen, told from
values that were rounded each, and named; records by hand.
"""

import numpy as np
import pytest
from conftest import member, thorough
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Found, Scene
from sensorlab.gap import curves, filters
from sensorlab.gap.integrated import (
    DITHER, Pulses, counts_of_integral, is_no_integral)
from sensorlab.gap.readings import recorded

N, DT, LSB = 4000, 0.01, 0.25
SIMULATOR = [sensorid.hypothesis("white_noise", sigma_v=(0.005, 1.25)),
             sensorid.hypothesis("random_walk", sigma_w=(3e-5, 0.03),
                                 sigma_v=(0.005, 1.25))]


def white(noise, seed, n=N):
    return noise * np.random.default_rng(seed).standard_normal(n)


def increments(rate):
    """Counts of the integral of a rate (N,), in counts, as they are sampled."""
    angle = np.floor(np.cumsum(rate) + 0.4)
    return LSB * np.diff(angle, prepend=angle[0] - np.floor(rate[0]))


@pytest.mark.parametrize("rate", [0.12, 0.37, 1.41, 10.2])
@pytest.mark.parametrize("noise", [0.03, 0.1, 0.2, 0.35, 0.45])
def test_counts_of_the_integral_are_seen(noise, rate):
    y = increments(rate + white(noise, 1))
    for moved in (y, y - y.mean()):
        seen = counts_of_integral(moved)
        assert seen.lsb == pytest.approx(LSB)
        # of less noise rounding makes bands, which are not as white
        assert seen.noise == pytest.approx(noise * LSB, rel=0.1) or noise < DITHER
    assert not is_no_integral(y, LSB)
    y[100:103] = np.nan
    assert counts_of_integral(y).lsb


def test_rare_pulses_are_seen_in_sums():
    assert counts_of_integral(increments(0.03 + white(0.01, 2, 4 * N))).lsb


@pytest.mark.parametrize("noise", [0.1, 0.3, 0.6, 2.0])
@pytest.mark.parametrize("rate", [0.0, 0.1, 0.37])
def test_values_that_were_rounded_each_are_none(noise, rate):
    t, y = np.arange(N), rate + white(noise, 3)
    for more in (0.0, 0.6 * np.sin(2.0 * np.pi * 0.31 * t), np.sin(0.1 * t),
                 np.cumsum(white(0.1, 4))):
        y_rounded = np.round(y + more)
        assert counts_of_integral(y_rounded) == Pulses()
        assert is_no_integral(y_rounded, 1.0) or noise > 1.0
    assert counts_of_integral(y) == Pulses()


@pytest.mark.parametrize("share", [0.5, 1.7])
def test_another_noise_that_is_differenced_is_none(share):
    """By its strength: rounding the integral adds a twelfth of a squared count."""
    for seed in range(5):
        more = np.diff(white(share / np.sqrt(12.0), [seed, 1], N + 1))
        y = np.round(0.37 + white(0.5, [seed, 2]) + more)
        assert counts_of_integral(y) == Pulses(), seed


def test_the_filter_has_the_covariance_of_what_rounding_adds():
    n = 120
    scene = Scene(np.zeros(n), DT, {})
    one = Found(CATALOGUE["integral_quantization"], values=dict(
        lsb=sensorid.Parameter("lsb", LSB, LSB)))
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=0.3))
    h = h._replace(effects=(one,))
    y = white(0.4, 5, n)
    off = np.eye(n, k=1) + np.eye(n, k=-1)
    cov = (0.09 + LSB**2 / 6.0) * np.eye(n) - LSB**2 / 12.0 * off + 1.0
    theta = np.array([[dict(sigma_v=0.3, lsb=LSB)[symbol] for _, symbol in h.keys]])
    ll = filters.log_likelihoods(h, scene._replace(y=y), (), theta)[0]
    assert_allclose(ll, multivariate_normal(cov=cov).logpdf(y), rtol=2e-4)


def test_what_the_simulator_draws_adds_up_to_what_was_rounded():
    effect, y = CATALOGUE["integral_quantization"], 0.1 + white(0.1, 6)
    scene = Scene(increments(0.3 + white(0.3, 7)), DT, {})
    drawn = y.copy()[None]
    effect.reading(scene, drawn, lsb=LSB)
    assert np.abs(np.cumsum(drawn[0] - y)).max() < 0.5 * LSB + 1e-9
    assert_allclose(drawn / LSB, np.round(drawn / LSB), atol=1e-9)
    assert np.std(drawn[0] - y) == pytest.approx(LSB / np.sqrt(6.0), rel=0.05)


EFFECTS = dict(
    none=lambda t: 0.0 * t,
    bias_step=lambda t: 0.2 * (t > 2100),
    sinusoid=lambda t: 0.14 * np.sin(2.0 * np.pi * 0.073 * t))


@pytest.mark.parametrize("noise, effect", [
    (0.4, "none"), thorough(0.4, "bias_step"), thorough(0.4, "sinusoid"),
    thorough(0.1, "none")])
def test_counts_of_the_integral_are_named_and_noise_beside_them_is_known(noise, effect):
    y = increments(0.37 + EFFECTS[effect](np.arange(N)) + white(noise, 8))
    d = sensorlab.diagnose(y, DT, SIMULATOR[:1])
    assert d.verdict.replace("gradual", "bias") == "+".join([
        "integral_quantization", effect][:1 + (effect != "none")])
    assert d.found[0].values["lsb"][0] == pytest.approx(LSB)
    at = [symbol for _, symbol in d.final.member.keys].index("sigma_v")
    sigma, sd = d.final.sample.mean[at], d.final.sample.sd()[at]
    assert abs(sigma - noise * LSB) < 4.0 * sd + 0.02 * noise * LSB or noise < DITHER
    assert d.after.p_value > 0.01 and d.closure.closed > 0.9
    through = curves.view(d).through    # of what is slow: not of the rounding
    assert through is None if effect == "none" else len(through.names) == 1


@pytest.mark.large
def test_the_next_record_of_an_integrating_sensor_is_none():
    found = sensorlab.diagnose(increments(0.37 + white(0.4, 9)), DT, SIMULATOR)
    saved = sensorlab.augmented(found)
    again = increments(0.41 + white(0.4, 10))
    assert sensorlab.diagnose(again, DT, saved).verdict == "none"
    # one whose values were rounded each has not what the simulator has
    other = LSB * np.round(0.4 + white(0.4, 11))
    names = sensorlab.diagnose(other, DT, saved).found
    assert [(one.name, one.values.get("parameter", ("",))[0]) for one in names][:2] == [
        ("quantization", ""), ("wrong_parameter", "integral_quantization.lsb")]


@pytest.mark.large
def test_a_simulator_that_rounds_each_value_lacks_the_integral():
    rounds = sensorlab.Simulator(SIMULATOR, [[Found(
        CATALOGUE["quantization"], values=dict(lsb=LSB))] for _ in SIMULATOR])
    y = increments(0.37 + white(0.4, 12))
    assert sensorlab.diagnose(y, DT, rounds).verdict == "integral_quantization"


def test_a_record_from_a_file_keeps_its_counts():
    rate = 0.37 + white(0.3, 13)
    y = increments(rate)
    assert np.ptp(np.cumsum(y / LSB) - np.cumsum(rate)) < 1.0
    printed = np.array([float(f"{v * 0.0173:.6g}") for v in y / LSB])
    assert counts_of_integral(recorded(printed, DT, {}).y).lsb == pytest.approx(
        0.0173, rel=1e-3)
