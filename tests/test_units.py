"""Units as the field writes them, and parameters as data sheets quote them."""

import doctest
import sys

import numpy as np
import pytest

import sensorlab.units
from sensorlab.tables import as_text
from sensorlab.units import (
    check_report, factor, flicker_sigma, kind_of, low_pass_time, quantity, quote_table,
    quoted, registry, white_from_density)

DEG, G = np.pi / 180.0, 9.80665


@pytest.mark.parametrize("old, new, times", [
    ("deg/s", "rad/s", DEG), ("deg/h", "rad/s", DEG / 3600.0),
    ("mg", "m/s^2", 1e-3 * G),
    ("g", "m/s²", G), ("deg/s/sqrt(Hz)", "deg/sqrt(h)", 60.0),
    ("°/√h", "rad/sqrt(s)", DEG / 60.0), ("ug/sqrt(Hz)", "m/s/sqrt(h)", 60e-6 * G),
    ("µg/√Hz", "μg/sqrt(Hz)", 1.0), ("mdps", "rad/s", 1e-3 * DEG),
    ("rad/s^2/sqrt(Hz)", "rad/s/sqrt(s)", 1.0), ("min", "s", 60.0),
    ("deg/h/sqrt(h)", "rad/s/sqrt(s)", DEG / 3600.0 / 60.0),
    ("(deg/s)/√(Hz)", "dps*s**0.5", 1.0), ("330 Hz", "1/s", 330.0),
    ("m/s/h", "ug", 1e6 / 3600.0 / G)])
def test_units_convert_as_the_field_writes_them(old, new, times):
    assert factor(old, new) == pytest.approx(times, rel=1e-12)


@pytest.mark.parametrize("unit, kind", [
    ("deg/s", "gyroscope"), ("deg/h", "gyroscope"), ("mg", "accelerometer")])
def test_a_unit_tells_the_sensor(unit, kind):
    assert kind_of(unit) == kind


@pytest.mark.parametrize("text", ["furlong", "deg//s", "", "u", 5, None, "1e999 s",
                                  "9" * 400 + " s", "deg/sqrt(", "()",
                                  "9**9**9**9 s", "s**9**9**9", "deg" + " s" * 99])
def test_what_is_no_quantity_gets_one_sentence(text):
    with pytest.raises(ValueError, match="is no quantity: a number and a unit"):
        quantity(text)


def test_what_cannot_be_converted_is_told():
    with pytest.raises(ValueError, match="they measure different things"):
        factor("deg", "deg/s")
    with pytest.raises(ValueError, match="neither an angular rate nor an acceleration"):
        kind_of("m/s")


def test_without_pint_one_sentence_says_what_to_install(monkeypatch):
    registry.cache_clear()
    monkeypatch.setitem(sys.modules, "pint", None)
    with pytest.raises(ValueError, match="pip install pint"):
        quantity("deg/s")


def test_white_noise_integrates_to_the_quoted_random_walk():
    """An hour of white noise turns by N = 3 deg, root mean square."""
    (q,) = quoted([("sigma_v", 0.5, 0.1)], 0.01, "deg/s")
    assert (q.name, q.unit) == ("angle random walk", "deg/sqrt(h)")
    assert q.mean == pytest.approx(0.5 * 0.01 * np.sqrt(3600.0 / 0.01))
    assert q.sd == pytest.approx(0.2 * q.mean)


def test_a_walk_grows_in_an_hour_to_the_quoted_one():
    (q,) = quoted([("sigma_w", 1e-4, 0.0)], 0.01, "rad/s")
    assert (q.name, q.unit) == ("rate random walk", "deg/h/sqrt(h)")
    assert q.mean == pytest.approx(1e-4 * np.sqrt(3600.0 / 0.01) / DEG * 3600.0)


def test_an_accelerometer_has_names_of_its_own():
    text = as_text(quote_table(quoted([("sigma_v", 1.0, 0.0), ("sigma_w", 1.0, 0.0)],
                                      0.04, "mg")))
    assert "velocity random walk" in text and "m/s/sqrt(h)" in text
    assert f"{1e-3 * G * 0.2 * 60.0:.4g} m/s/sqrt(h)" in text


def test_units_may_be_asked_for():
    found = quoted([("sigma_v", 0.5, 0.0), ("tau_m", 90.0, 0.0), ("u", 1.0, 0.0)],
                   0.01, "deg/s", ["rad/s/sqrt(Hz)", "min"])
    assert [q.unit for q in found] == ["rad/s/sqrt(Hz)", "min"]
    assert [q.mean for q in found] == pytest.approx([0.05 * DEG, 1.5])
    with pytest.raises(ValueError, match="mg fits no parameter of this sensor; they are"
                                         " angle random walk in deg/sqrt"):
        check_report("deg/s", ["h", "mg"])


def test_what_a_data_sheet_says_more():
    assert white_from_density(0.05, 100.0) == pytest.approx(0.05 * np.sqrt(50.0))
    assert low_pass_time(1.0 / (2.0 * np.pi)) == pytest.approx(1.0)
    # B = floor / 0.664, sigma = B sqrt(decades ln 10 / pi), decades 4
    assert flicker_sigma(0.664, 0.1, 1000.0 + 1.0) == pytest.approx(
        np.sqrt(4.0 * np.log(10.0) / np.pi), rel=1e-3)


def test_examples_in_the_docstrings_are_true():
    result = doctest.testmod(sensorlab.units)
    assert result.attempted and not result.failed
