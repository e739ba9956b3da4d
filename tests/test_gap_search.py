"""The search for a set of effects: what is exchanged, and what may stand instead."""

import math
import types

import numpy as np
import pytest
from test_gap_verdict import EFFECTS

from sensorlab import Found, Scene
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


def searched(log_bayes, *leaves):
    """A search that has found the first of its leaves, of that ln B."""
    return search.Search(None, {}, leaves[0]._replace(log_bayes=log_bayes), {
        one.effect: one for one in leaves}, None, 0.0)


def test_of_two_searches_the_better_is_taken_and_the_sets_of_both_share():
    """A step costs as much as any effect, one more as much as that there is any."""
    jumps = searched(50.0, cause("random_telegraph", "random_walk", probability=0.3),
                     cause("random_telegraph", probability=0.3))
    steps = searched(50.0, cause("bias_step", "bias_step", probability=0.9),
                     cause("random_walk", "random_telegraph", probability=0.1))
    odds = 10 / 3.0
    for pair in ((jumps, steps), (steps, jumps)):
        best = search._of_both(*pair, 10)
        assert best.path is steps.path
        assert {name: one.probability for name, one in best.leaves.items()
                } == pytest.approx({
                    "bias_step+bias_step": 0.9 * odds / (1.0 + odds),
                    "random_telegraph": 0.5 / (1.0 + odds),
                    "random_walk+random_telegraph": (0.1 * odds + 0.5) / (1.0 + odds)})


def test_what_happens_at_some_time_is_sought_alone_if_steps_are_in_the_catalogue():
    asked = []

    def for_some(effects):
        asked.append([one.name for one in effects])
        return searched(60.0 - len(effects), cause("bias_step"))
    effects = [EFFECTS[name] for name in (
        "bias_step", "noise_step", "pulse", "gradual_step", "random_walk")]
    none = cause()
    assert search._at_some_time(none, effects, for_some).path.log_bayes == 59.0
    assert asked == [["bias_step"], ["bias_step", "pulse"]]
    assert search._at_some_time(none, effects[1:], for_some) is None


def test_what_happens_at_many_times_has_none_each():
    many = searched(60.0, cause(*6 * ["bias_step"]))
    assert search._at_some_time(cause(), [EFFECTS["bias_step"]], lambda _: many) is None
    assert search._at_some_time(cause("quantization"), [EFFECTS["bias_step"]],
                                lambda _: many) is not None


@pytest.mark.parametrize("least, count", [(-math.inf, 3), (68.0, 3), (69.0, 2),
                                          (320.0, 2), (321.0, 1)])
def test_a_search_ends_where_a_better_path_is_out_of_reach(monkeypatch, least, count):
    # in eight looks: 40 nats in the first, 4 in the second, none in the third
    asked, gains = [], [40.0, 4.0, 0.0]

    def look(*_, **__):
        gain = gains[len(asked)]
        asked.append(gain)
        if not gain:
            return Further((cause(),), None, 0.0)
        return Further((cause("bias_step", log_bayes=gain), cause(probability=0.0)),
                       account(gain), 0.0)
    monkeypatch.setattr(search, "further_causes", look)
    monkeypatch.setattr(search, "_or_a_pair", lambda scene, acc, look, *_: look)
    monkeypatch.setattr(search, "_without_needless", lambda full, acc, path, leaves,
                        prior: (acc, {}, path, leaves))
    monkeypatch.setattr(search, "in_best_forms", lambda full, acc, found: acc)
    monkeypatch.setattr(search, "stays_needed", lambda *_: True)
    monkeypatch.setattr(search, "_exchanged", lambda *_: None)
    monkeypatch.setattr(search, "pushes", lambda acc: False)
    monkeypatch.setattr(search, "as_read", lambda full, readings: full)
    after = types.SimpleNamespace(p_value=0.5)
    search.search(None, account(0.0), cause(), [EFFECTS["bias_step"]], after,
                  lambda *_: after, least=least)
    assert len(asked) == count


def test_a_search_beside_few_steps_may_go_on_from_these():
    few = searched(60.0, cause("bias_step"))._replace(
        after=types.SimpleNamespace(p_value=0.1), account=account(0.0))
    done = searched(50.0, cause("random_walk"))._replace(other=few)
    asked = []

    def again(*asked_for):
        asked.append(asked_for)
        return searched(70.0, cause("bias_step", "pulse"))
    effects = [EFFECTS["bias_step"]]
    found = search.beside_steps(None, done, again, effects)
    assert asked == [(effects, few.account, few.path, 50.0)]
    assert found.path.effects == ("bias_step", "pulse")
    assert search.beside_steps(None, done._replace(other=few._replace(
        after=types.SimpleNamespace(p_value=0.5))), again, effects).path is few.path
    assert len(asked) == 1


def test_what_chance_makes_of_coarse_counts_takes_more_than_few_records(monkeypatch):
    """Its ln B, of this record and of others, is 13 Exp(1), or 0 as often."""
    counts = types.SimpleNamespace(coarse=True, cell=1.0)
    acc = types.SimpleNamespace(readings=(counts,), bases=(), hypotheses=(),
                                signatures=())
    told = []

    def drawn(_, full, number, seed):
        rng = np.random.default_rng([int(full.y), seed])
        told.append(number)
        return types.SimpleNamespace(error=13.0 * rng.exponential(size=number) * (
            rng.random(number) < 0.5))
    for name, stub in dict(
            as_read=lambda full, _: full, as_simulated=lambda *_: None,
            in_place=lambda *_: None, hide=lambda *_: False, effort=lambda _: 1.0,
            simulate_effects=drawn, account=lambda scene, *_: float(scene.y),
            largest_bayes=lambda _, value, effect: value).items():
        monkeypatch.setattr(search, name, stub)

    def left(record):
        (own,) = drawn(None, Scene(record, 1.0, {}), 1, 0).error
        return search._by_rounding(Scene(record, 1.0, {}), acc, None)(
            EFFECTS["bias_step"], own)
    records = range(2000)
    named = np.mean([left(record) > 3.5 for record in records])
    mean = sum(told) / len(records) - 1
    monkeypatch.setattr(search, "MOST_AGAIN", 1)
    of_few = np.mean([left(record) > 3.5 for record in records])
    error = np.sqrt(of_few / len(records))
    assert named < 0.25 * of_few and of_few - named > 4.0 * error
    assert mean < 1.1 * search.HELD_AGAINST
