"""What is said of a diagnosis, and how numbers are written."""

import doctest
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DT

import sensorid
import sensorlab
from sensorlab import Found, tables
from sensorlab.gap import sizes, words
from sensorlab.gap.causes import UNKNOWN, Cause
from sensorlab.gap.closure import Closure

CATALOGUE = sensorlab.CATALOGUE


def test_examples_in_the_docstrings_are_true():
    for room in (sizes, tables):
        result = doctest.testmod(room)
        assert result.attempted and result.failed == 0


@pytest.mark.parametrize("mean, sd, text", [
    (122.93, 34.2, "123 +- 34"), (0.68812, 0.0951, "0.688 +- 0.095"),
    (-1.0131, 0.069, "-1.013 +- 0.069"), (123456.0, 3400.0, "123500 +- 3400"),
    (0.001078, 0.00027, "0.00108 +- 0.00027"), (0.1, 30.0, "0.1 +- 30"),
    (2.5e-9, 1e-10, "2.5e-09 +- 1e-10"), (0.8, 0.0, "0.8"), (0.0, 0.0, "0"),
    (866.002, 0.07, "866.002 +- 0.07")])
def test_a_value_has_the_digits_that_its_error_leaves(mean, sd, text):
    assert sizes.measured(mean, sd) == text


def test_shares_and_chances_are_never_rounded_to_certainty():
    assert [sizes.percent(x) for x in (0.0, 0.001, 0.43, 0.999, 1.0)] == [
        "0 %", "< 1 %", "43 %", "> 99 %", "100 %"]
    assert sizes.chance(0.043) == "0.043" and sizes.chance(1e-15) == "< 1e-12"


def test_odds_are_those_of_the_bayes_factor():
    assert [sizes.odds(np.log(x)) for x in (670.0, 1.0, 0.25)] == [
        "670 : 1", "1 : 1", "1 : 4"]
    assert sizes.odds(100.0) == "1e43 : 1" and sizes.odds(1000.0) == "> 1e99 : 1"
    assert sizes.odds(-2000.0).startswith("1 : ")


def test_every_parameter_of_the_catalogue_has_its_unit():
    known = dict(onset="s", frequency="Hz", size="mg", slope="mg/s", ratio="",
                 coefficient="mg per unit of temperature", lsb="mg", play="",
                 sigma_w="mg per sample", rate="of the samples")
    for symbol, unit in known.items():
        assert sizes.unit_of(symbol, "mg", "temperature") == unit


def found(name, column="", **values):
    return Found(CATALOGUE[name], column, "", values)


def test_sizes_of_two_effects_of_one_name_are_both_said():
    one, two = (found("sinusoid", frequency=(f, 0.001)) for f in (0.1, 0.2))
    assert sizes.sizes([one, two], "u", DT) == (
        "sinusoid: frequency 0.1 +- 0.001 Hz; sinusoid: frequency 0.2 +- 0.001 Hz")
    assert sizes.sizes([one], "u", DT) == "frequency 0.1 +- 0.001 Hz"
    clipped = found("saturation", limits=([-np.inf, 2.5], 0.0))
    stuck = found("stuck", spans=([[3.0, 9], [40.0, 7]], 0.0))
    assert sizes.sizes([clipped, stuck], "mg", DT) == (
        "saturation: limits -inf to 2.5 mg; stuck: spans 2 of them")
    full = found("saturation", limits=([-np.inf, 65535.0], 0.0))
    assert sizes.sizes([full], "mg", DT) == "limits -inf to 65535 mg"
    again = found("repeated_samples", frequency=(70.0, 0.0), phase=(None, 0.0))
    assert sizes.sizes([again], "mg", DT) == "frequency 70 Hz, at random"
    lines = found("interpolated_samples", frequency=(83.0, 0.0), phase=(None, 0.0),
                  order=(1, 0.0))
    assert sizes.sizes([lines], "mg", DT) == "frequency 83 Hz, unevenly, order 1"
    codes = found("differential_nonlinearity", codes=([[3.0, 1.5], [4.0, 0.5]], 0.0))
    assert sizes.sizes([codes], "mg", DT) == "codes 2 of width 0.5 to 1.5 mg"


def test_a_cause_has_the_sizes_that_were_estimated_together():
    first, last = (found("sinusoid", frequency=(f, 0.001)) for f in (0.1, 0.11))
    step = found("bias_step", onset=(80.0, 2.0), size=(0.5, 0.1))
    d = SimpleNamespace(found=(last,), scene=SimpleNamespace(dt=DT))

    def said(*some):
        return words.sizes_in(Cause(some, 0.5, 1.0), d, "u")
    assert said(first) == said(first, Found(UNKNOWN)) == "frequency 0.11 +- 0.001 Hz"
    assert said(first, step) == "bias_step: onset 80 +- 2 s, size 0.5 +- 0.1 u"
    assert said(step) == "onset 80 +- 2 s, size 0.5 +- 0.1 u"
    off = found("wrong_parameter", parameter=("sigma_v", 0.0), factor=(2.0, 0.1))
    d.found = off,
    assert "sigma_w" in said(off._replace(values=dict(
        parameter=("sigma_w", 0.0), factor=(3.0, 0.2)))) and not said()


def test_a_wrong_factor_is_recognised():
    off = found("wrong_parameter", parameter=("sigma_v", 0.0), factor=(9.81, 0.02))
    assert "g taken for m/s^2" in sizes.sizes([off], "mg", 0.01)
    assert "root of the rate" in sizes.looks_like(14.0, 0.1, 1.0 / 196.0)
    assert sizes.looks_like(7.0, 0.1, 0.01) == ""
    assert "mg taken for m/s^2" in sizes.looks_like(0.009807, 0.0, 0.01)
    assert "the sampling rate" in sizes.looks_like(0.0101, 0.0002, 0.01)
    assert "rad taken for deg" in sizes.looks_like(57.3, 0.1)
    assert "deg taken for rad" in sizes.looks_like(1.0 / 57.3, 1e-4)
    slower = found("wrong_parameter", parameter=("bandwidth.tau", 0.0),
                   factor=(9.8, 0.1))
    assert "taken for" not in sizes.sizes([slower], "mg", 0.01)
    exact = found("wrong_parameter", parameter=("quantization.lsb", 0.0),
                  factor=(10.0, 0.0))
    assert sizes.sizes([exact], "mg", 0.01) == "parameter quantization.lsb, factor 10"


def test_the_verdict_is_a_sentence(answers):
    said = {kind: words.headline(d) for kind, (d, _) in answers.items()}
    assert said["none"] == "The simulator describes this record: no effect is missing."
    assert said["bias_step"].startswith("The simulator lacks a bias step (")
    assert said["outliers"].startswith("The simulator lacks outliers (")
    assert said["unknown"].endswith("something that no effect of the catalogue "
                                    "explains.")
    assert said["undecided"].startswith("The record does not decide: a bias step (")
    d, _ = answers["bias_step"]
    both = d._replace(verdict="bias_step+temperature or thermal_lag+unknown")
    text = words.headline(both)
    assert "a bias step (" in text and "dependence on temperature or a" in text
    assert text.endswith("and something that no effect of the catalogue explains.")
    assert words.is_named(both) and not words.is_named(d._replace(verdict="unknown"))


def test_what_is_said_needs_no_theory(answers):
    for kind, (d, record) in answers.items():
        text = words.table(d, record, "mg")
        assert f"verdict: {d.verdict}" in text
        for word in ("nats", "log score", "likelihood", "Eq.", "one-step", "ln B"):
            assert word not in text, (kind, word)
        assert "mg" in text or not d.found


def test_what_hides_the_rest_is_said():
    y = np.cumsum(np.random.default_rng(4).normal(0.0, 0.3, 400))
    y += np.random.default_rng(5).normal(0.0, 0.5, 400)
    h = sensorid.hypothesis("random_walk", sigma_w=(0.1, 0.5), sigma_v=(0.2, 1.0))
    for read, hiding in (
            (4.0 * np.round(y / 4.0),
             "counts about three times as coarse as the noise, or more,"),
            (np.clip(y, *np.quantile(y, [0.2, 0.8])), "so many clipped samples")):
        d = sensorlab.diagnose(read, 1.0, [h])
        assert any(one.startswith(f"{hiding} hide the rest") for one in words.left(d))
    for lsb, told in ((0.5, False), (1.4, True)):
        d = sensorlab.diagnose(lsb * np.round(y / lsb), 1.0, [h])
        said = "".join(words.left(d))
        assert d.verdict == "quantization" and "hide" not in said
        assert ("more than twice as coarse" in said) == told


def test_a_parameter_at_the_end_of_what_was_tried_is_told():
    t = np.arange(600.0)
    y = np.random.default_rng(3).standard_normal(600) + np.where(
        t >= 50.0, 3.0 * np.exp(-3.0 * (t - 50.0) / 400.0) * np.cos(0.8 * t), 0.0)
    d = sensorlab.diagnose(y, 1.0, [sensorid.hypothesis("white_noise", sigma_v=1.0)])
    said = " ".join(words.advice(d, "mg"))
    assert d.verdict == "ringing"
    assert ("duration of ringing is at the end of what was tried, 300 s: it may be "
            "more") in said


def test_what_opens_a_gap_closes_nothing():
    part = Closure(2.0, 1.5, 0.5, (0.4, 0.6))
    assert words.closed_share(part) == "50 % [40, 60]"
    assert words.closed_share(part._replace(after=11.0, closed=-9.0)) == "nothing"


def test_a_gain_of_prediction_is_one_of_its_error():
    assert words.sharper(-np.log(0.9)) == "10 % better"
    assert words.sharper(np.log(0.9)) == "11 % worse"
    assert words.sharper(np.nan) == "no better than can be told"


def test_the_experiment_for_every_effect_named_is_told(answers):
    d, _ = answers["bias_step"]
    (said,) = [text for text in words.advice(d, "u") if "bias_step" in text]
    assert CATALOGUE["bias_step"].experiment in said
    said = " ".join(words.advice(
        d._replace(verdict="temperature or thermal_lag"), "u"))
    assert all(CATALOGUE[name].experiment in said
               for name in ("temperature", "thermal_lag"))
    d, _ = answers["undecided"]
    assert "a record of about 5000 s would tell" in " ".join(words.advice(d, "u"))
    assert not list(words.advice(answers["none"][0], "u"))


def test_a_column_of_two_clusters_is_told_from_one():
    assert words.clusters(np.array([1.0, 1.1, 5.0, 5.2])) == ((1.0, 1.1), (5.0, 5.2))
    assert words.clusters(np.linspace(1.0, 3.0, 5)) == ((1.0, 3.0), ())
