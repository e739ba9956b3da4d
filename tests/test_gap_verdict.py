"""What is said, from the probabilities of all sets of effects."""

import itertools
import types

import numpy as np
import pytest
from conftest import DT, MODEL
from numpy.testing import assert_allclose

import sensorid
import sensorlab
from sensorlab import Found
from sensorlab.gap import causes, diagnosis, search, weighing
from sensorlab.gap import verdict as verdict_module
from sensorlab.gap.augmented import augmented
from sensorlab.gap.diagnosis import diagnose
from sensorlab.gap.distance import TRIALS
from sensorlab.gap.verdict import (
    common, split_families, unknown_probability, verdict_of)

EFFECTS = {**sensorlab.CATALOGUE, "unknown": causes.UNKNOWN}


def sets(**probability):
    return [causes.Cause(tuple(Found(EFFECTS[name]) for name in effect.split("_and_")
                               if name != "none"), p, 0.0)
            for effect, p in probability.items()]


def verdict(**probability):
    return verdict_of(sets(**probability))


def test_what_is_in_most_of_the_probable_sets_is_named():
    assert verdict(outliers=0.6, none=0.4) == "outliers"
    assert verdict(outliers=0.45, outliers_and_sinusoid=0.4, none=0.15) == "outliers"
    assert verdict(sinusoid_and_sinusoid=0.5, unknown=0.3, sinusoid=0.2
                   ) == "sinusoid+sinusoid"
    assert verdict(sinusoid_and_sinusoid=0.45, sinusoid=0.35, none=0.2) == "sinusoid"
    assert verdict(bandwidth=0.4, outliers=0.35, none=0.25) == "undecided"
    assert verdict(unknown=0.45, outliers=0.35, none=0.2) == "undecided"


def test_two_that_take_each_others_place_are_both_named():
    rivals = dict(temperature_and_blue_noise=0.34, temperature_and_wrong_parameter=0.33)
    assert verdict(**rivals, temperature_and_noise_bursts=0.25, temperature=0.08
                   ) == "temperature+blue_noise or wrong_parameter"
    # unless it is as well without them
    assert verdict(**rivals, temperature=0.33) == "temperature"


def test_what_is_surely_there_is_named_even_if_not_which_it_is():
    rivals = dict(wrong_parameter=0.39, correlated_noise=0.19, walk_step=0.16,
                  random_telegraph_and_wrong_parameter=0.05)
    assert verdict(**rivals, bias_instability=0.17, none=0.04
                   ) == "wrong_parameter or correlated_noise"
    ((members, total),) = split_families(sets(**rivals))
    assert members == ("wrong_parameter", "correlated_noise")
    assert total == pytest.approx(0.63)
    assert verdict(**rivals, none=0.12, unknown=0.09) == "undecided"


def test_of_several_of_one_name_as_many_are_named_as_are_probable():
    """A third step may be a gradual one."""
    assert verdict(bias_step_and_bias_step_and_gradual_step=0.45,
                   bias_step_and_bias_step_and_bias_step=0.35,
                   bias_step_and_bias_step_and_pulse=0.2
                   ) == "bias_step+bias_step+gradual_step or bias_step"
    assert verdict(pulse_and_bias_step_and_bias_step_and_bias_step=0.48,
                   pulse_and_outliers=0.47, none=0.05) == "pulse+bias_step or outliers"
    assert verdict(sinusoid_and_sinusoid=0.4, sinusoid_and_sinusoid_and_sinusoid=0.3,
                   none=0.3) == "sinusoid+sinusoid"


def test_what_is_left_stands_beside_what_is_found():
    assert verdict(sinusoid_and_unknown=0.9, sinusoid=0.1) == "sinusoid+unknown"
    assert verdict(unknown=0.3, sinusoid_and_unknown=0.4, sinusoid=0.3
                   ) == "sinusoid+unknown"


def test_what_stays_beside_the_unknown_does_so_in_every_set():
    band, line = (Found(EFFECTS[name], values=dict(frequency=(10.0, 0.1)))
                  for name in ("narrow_band_noise", "sinusoid"))
    # beside another line the values are others
    moved = band._replace(values=dict(frequency=(10.2, 0.1)))
    assert common((line, moved), [band]) == (moved,)
    assert common((line, moved, line), [line, band]) == (line, moved)


def test_a_family_is_named_where_its_members_split_it():
    one = dict(thermal_lag=0.45, temperature=0.3, none=0.25)
    assert verdict(**one) == "thermal_lag or temperature"
    ((members, total),) = split_families(sets(**one))
    assert members == ("thermal_lag", "temperature") and total == pytest.approx(0.75)
    assert verdict(outliers_and_temperature=0.4, outliers_and_thermal_lag=0.3,
                   outliers=0.3) == "outliers+temperature or thermal_lag"
    assert verdict(temperature=0.4, thermal_lag=0.05, none=0.55) == "none"


def test_a_family_that_stands_for_what_is_named_is_not_beside_it():
    # either slow noise and a step, or a sinusoid and what drifts
    one = dict(correlated_noise_and_bias_step=0.24, bias_instability_and_bias_step=0.2,
               sinusoid_and_rate_ramp=0.2, sinusoid_and_second_order_drift=0.2,
               sinusoid_and_bias_instability=0.16)
    assert verdict(**one) == (
        "sinusoid+rate_ramp or second_order_drift or bias_instability")
    # each of which is rare by itself, and something unknown, too
    assert verdict(correlated_noise_and_bias_step=0.2,
                   bias_instability_and_bias_step=0.2, sinusoid_and_bias_step=0.15,
                   sinusoid_and_rate_ramp=0.1, sinusoid_and_random_walk=0.1,
                   sinusoid_and_second_order_drift=0.09, sinusoid_and_unknown=0.14,
                   sinusoid=0.02) == "sinusoid+bias_step or random_walk or rate_ramp"


def test_of_two_effects_that_stand_for_each_other_one_is_named():
    assert verdict(correlated_noise=0.45, wrong_parameter=0.42,
                   correlated_noise_and_wrong_parameter=0.1, none=0.03
                   ) == "correlated_noise"
    assert verdict(sinusoid=0.3, outliers=0.2, sinusoid_and_outliers=0.45, none=0.05
                   ) == "sinusoid+outliers"
    # a step is more probable than not, but beside the outliers it may be a slow one
    assert verdict(outliers_and_gradual_step=0.35, outliers_and_bias_step=0.3,
                   bias_step=0.22, none=0.13) == "outliers+bias_step or gradual_step"


def test_sets_of_the_same_effects_are_one_in_whatever_order_they_were_found(
        monkeypatch):
    both = sets(bias_step_and_temperature=0.3, temperature_and_bias_step=0.5,
                thermal_lag=0.2)
    gap = types.SimpleNamespace(p_value=0.5)
    monkeypatch.setattr(verdict_module, "unknown_error", lambda gap: 0.0)
    found = search.Search(None, {}, both[1], {c.effect: c for c in both}, gap, 0.0)
    told = verdict_module.all_causes(
        found, types.SimpleNamespace(readings=()), gap,
        types.SimpleNamespace(share=0.0), both[1].found)
    assert told[0].effect == "temperature+bias_step"
    assert told[0].probability == pytest.approx(0.8 * 0.99)
    assert [c.effect for c in told[:2]] == ["temperature+bias_step", "thermal_lag"]


def test_a_small_p_value_makes_something_unknown_probable():
    chance = [unknown_probability(p) for p in (1.0, 0.05, 1e-3, 1e-9)]
    assert chance == sorted(chance) and chance[0] < 0.02 and chance[-1] > 0.999


def test_errors_of_probabilities_are_their_spread():
    rng = np.random.default_rng(0)
    log_odds, off = np.array([0.3, -0.5, -2.0]), np.array([0.1, 0.05, 0.2])

    def shares(log_odds):
        odds = np.exp(np.append(0.0, log_odds))
        return odds / odds.sum()
    drawn = np.array([shares(log_odds + off * rng.standard_normal(3))
                      for _ in range(4000)])
    grouped = np.column_stack([drawn[:, 0], drawn[:, 1] + drawn[:, 3], drawn[:, 2]])
    alone, *share = shares(log_odds)
    told = causes._errors(alone, np.array(share), [[0, 2], [1]], off)
    assert_allclose(told, grouped.std(0), rtol=0.1)


def test_more_records_are_drawn_where_unknown_hangs_on_them(monkeypatch):
    drawn = []

    def gap_of(scene, acc, trials, seed, before, near):
        drawn.append(trials)
        return trials
    monkeypatch.setattr(diagnosis, "distance", gap_of)
    scene = sensorlab.Scene(np.zeros(100), 1.0, {})
    for off, trials, expected in (
            (0.02, None, [None]), (0.045, None, [None, round(2.25 * TRIALS)]),
            (0.3, None, [None, diagnosis.MOST_TIMES * TRIALS]), (0.3, 60, [60])):
        drawn.clear()
        monkeypatch.setattr(diagnosis, "unknown_error", lambda gap, off=off: off)
        assert diagnosis._surely(scene, None, trials, 0) == expected[-1]
        assert drawn == expected


def test_every_probability_of_a_report_has_its_error(answers):
    for d, recording in answers.values():
        for cause in sensorlab.report(d, recording)["causes"]:
            assert 0.0 <= cause["probability_error"] <= 0.05
    assert answers["unknown"][0].causes[0].error > 0.0 or (
        answers["unknown"][0].causes[0].probability > 0.99)


def test_where_the_search_stops_counts_with_the_probability_of_stopping():
    (y,) = sensorid.simulate(MODEL, DT, 400, seed=5).error
    effects = [sensorlab.CATALOGUE[name] for name in ("rate_ramp", "bias_step")]
    d = diagnose(y, DT, MODEL, effects=effects, trials=29)
    assert not d.found
    look = causes.further_causes(d.scene, d.base, effects).causes
    said = {c.effect: c.probability for c in d.causes}
    assert_allclose([said[c.effect] / said["none"] for c in look], [
        c.probability / next(one.probability for one in look if not one.found)
        for c in look], rtol=1e-6)


def test_the_model_has_what_the_verdict_names():
    """A rival of a family is the single most probable cause, but not more probable than
    the family.
    """
    rng, t = np.random.default_rng(18), np.arange(800)
    T = np.exp(-t / 150) + 0.0025 * rng.standard_normal(800).cumsum()
    y = rng.standard_normal(800) + 0.9 * T
    temperature, lag, drift, other = [sensorlab.CATALOGUE[name] for name in (
        "temperature", "thermal_lag", "second_order_drift", "turn_on_transient")]
    known = drift._replace(parameters=lambda scene: (
        sensorid.Parameter("vertex", 0.2 * scene.duration, 0.8 * scene.duration),))
    in_one_form = lag._replace(columns=lambda *at: itertools.islice(
        lag.columns(*at), 1))
    d = diagnose(y, 1.0, [sensorid.hypothesis("white_noise", sigma_v=(0.3, 2))],
                 dict(temperature=T), [temperature, in_one_form, known, other],
                 trials=59)
    assert d.verdict == "temperature or thermal_lag"
    assert d.causes[0].effect == "second_order_drift"
    assert [one.name for one in d.found] == ["temperature"]
    assert [one.name for one in augmented(d).effects[0]] == ["temperature"]


def test_of_two_that_explain_as_much_the_simpler_is_twice_as_probable():
    """Both together are as probable as any other two."""
    acc = types.SimpleNamespace(signatures=(), readings=(), best=0, bases=[
        types.SimpleNamespace(effects=())], member=types.SimpleNamespace(effects=()))
    for names, expected in (
            (["temperature", "thermal_lag", "sinusoid"], [2.0, 1.0, 1.5]),
            # beside the same column
            (["lag pressure", "covariate pressure", "covariate voltage"],
             [1.0, 2.0, 1.5])):
        rivals = [types.SimpleNamespace(effect=EFFECTS[effect], at=at, variant="",
                                         log_bayes=4.0)
                  for effect, _, at in (name.partition(" ") for name in names)]
        _, alone, share = weighing._probabilities(acc, rivals)
        assert_allclose(share / share.min(), expected)
        assert_allclose(share.sum() / alone, np.exp(4.0))    # as if all were the same
