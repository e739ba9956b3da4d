"""What is left when all that was found is added, and what each effect closes."""

import generator
import numpy as np
import pytest
from conftest import DT, MODEL, WHITE, diagnosed

import sensorlab
from sensorlab.gap import report, words

CATALOGUE = sensorlab.CATALOGUE


def test_what_no_effect_explains_stands_beside_what_one_does():
    rng = np.random.default_rng(2)
    y = rng.standard_normal(2000) + 2.0 * (np.arange(2000) > 800)
    y += np.where(np.arange(2000) % 500 < 250, 0.0, rng.standard_normal(2000))
    d = sensorlab.diagnose(y, DT, WHITE, effects=[CATALOGUE["bias_step"]])
    assert d.verdict == "bias_step+unknown"
    (part,) = d.parts
    assert part.stays and d.remainder.share > 0.1 and d.remainder.p_value < 1e-3
    text = report.report(d, sensorlab.Record("r", "error", y, DT))
    assert text["found"][0]["probability"] > 0.9
    assert text["gap"]["remainder"]["where"]["place"] in ("time", "lag", "amplitude")
    assert "what is left fits no effect" in words.table(
        d, sensorlab.Record("r", "error", y, DT), "u")


@pytest.mark.thorough
def test_each_of_two_effects_closes_its_part():
    d = diagnosed(generator.record(400, 1, ["bias_step", "outliers"], level=4))
    shares = {one.name: part.share for one, part in zip(d.found, d.parts)}
    assert set(shares) == set(d.verdict.split("+")) == {"bias_step", "outliers"}
    assert shares["outliers"] > 0.5 and shares["bias_step"] > 0.0
    assert d.closure.closed > 0.9 and all(part.stays for part in d.parts)
    assert d.remainder.share < 0.1


def test_an_effect_that_no_place_shows_is_measured_along_its_filter():
    y = np.random.default_rng(5).standard_normal(3000)
    y += 0.16 * np.sin(2.0 * np.pi * 0.11 * np.arange(3000))
    d = sensorlab.diagnose(y, DT, WHITE, effects=[CATALOGUE["sinusoid"]])
    if d.directed:    # else a place shows it
        before = np.sqrt(1.0 + 2.0 * d.causes[0].log_bayes)
        assert d.closure.before == pytest.approx(before)
    assert d.verdict == "sinusoid" and np.isfinite(d.closure.closed)
    assert d.closure.interval[0] <= d.closure.closed <= d.closure.interval[1]


def test_a_simulator_may_round_and_the_loop_closes():
    rng = np.random.default_rng(9)

    def rounded(n=3000):
        return 0.4 * np.round((np.cumsum(0.1 * rng.standard_normal(n))
                               + 0.5 * rng.standard_normal(n)) / 0.4)
    d = sensorlab.diagnose(rounded(), DT, MODEL)
    assert d.verdict == "quantization"
    assert d.by_any < 0.9 * d.closure.closed    # no noise repeats values
    again = sensorlab.diagnose(rounded(), DT, sensorlab.augmented(d))
    assert again.verdict in ("none", "undecided", "wrong_parameter")
    assert not again.found or again.found[0].name == "wrong_parameter"
