"""The search for a set of effects: what is exchanged, and what may stand instead."""

import types

import pytest
from test_gap_verdict import EFFECTS

from sensorlab import Found
from sensorlab.gap import search
from sensorlab.gap.causes import Cause, Further


def cause(*names, probability=1.0, log_bayes=0.0):
    return Cause(tuple(Found(EFFECTS[name]) for name in names), probability, log_bayes)


def account(log_evidence):
    return types.SimpleNamespace(readings=(), log_evidence=log_evidence)


def exchanged(monkeypatch, settled=1, **beside_the_step):
    """Of temperature+bias_step, found with 0.8 (0.1 with one more), if these are the
    probabilities of what stands beside the step, or in its place if it is not settled.
    """
    best = account(105.0)
    look = Further(tuple(sorted((
        cause(*(() if name == "none" else (name,)), probability=p, log_bayes=10.0)
        for name, p in beside_the_step.items()), key=lambda c: -c.probability)), best,
        0.0)
    monkeypatch.setattr(search, "further_causes", lambda *_, **__: look)
    path = cause("temperature", "bias_step", probability=0.9, log_bayes=30.0)
    leaves = {one.effect: one for one in (
        path._replace(probability=0.8),
        cause("temperature", "bias_step", "pulse", probability=0.1),
        cause("bias_step", probability=0.1))}
    scene = types.SimpleNamespace()
    monkeypatch.setattr(search, "_without_needless", lambda full, acc, path, leaves,
                        prior: (acc, {}, path, leaves))
    old = account(100.0)
    return search._exchanged(scene, old, path, leaves, {0: account(90.0), 1: account(
        95.0)}, (), None, settled), old, best


def test_what_explains_more_beside_the_others_takes_its_place(monkeypatch):
    (better, _, path, leaves), _, best = exchanged(
        monkeypatch, thermal_lag=0.6, temperature=0.2, none=0.2)
    assert better is best and path.effects == ("bias_step", "thermal_lag")
    assert path.probability == pytest.approx(0.9 * 0.75)
    assert path.log_bayes == pytest.approx(30.0 - 10.0 + 10.0)
    chance = {name: one.probability for name, one in leaves.items()}
    assert chance == pytest.approx({    # what went on from the old set has the rest
        "temperature+bias_step": 0.2, "temperature+bias_step+pulse": 0.025,
        "bias_step": 0.1})


def test_the_last_of_a_pair_may_be_exchanged_too(monkeypatch):
    (better, _, path, _), _, best = exchanged(
        monkeypatch, 0, rate_ramp=0.6, bias_step=0.2, none=0.2)
    assert better is best and path.effects == ("temperature", "rate_ramp")


def test_what_may_as_well_stand_there_counts_with_its_odds(monkeypatch):
    (better, _, path, leaves), old, _ = exchanged(
        monkeypatch, temperature=0.6, thermal_lag=0.3, none=0.1)
    assert better is old and path.effects == ("temperature", "bias_step")
    chance = {name: one.probability for name, one in leaves.items()}
    assert chance == pytest.approx({
        "temperature+bias_step": 0.8, "temperature+bias_step+pulse": 0.1,
        "bias_step+thermal_lag": 0.4, "bias_step": 0.8 / 6.0})
