"""Directed evidence against importance sampling of the whole, and the screens against
the filters they spare.
"""

from types import SimpleNamespace

import generator
import numpy as np
import pytest
from conftest import DT, MODEL, WHITE_OF_A_RANGE, member, scene_of
from numpy.testing import assert_allclose
from scipy.signal import lfilter

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Found, Scene
from sensorlab.gap import (
    backward, directed, effects, evidence, filters, inside, linear, rival,
    scans, screens, signatures, weighing)
from sensorlab.gap.account import account
from sensorlab.gap.effects import fixed
from sensorlab.gap.members import Member
from sensorlab.gap.readings import Reading
from sensorlab.gap.rival import Rival
from sensorlab.gap.sought import StandIn, sought


@pytest.mark.parametrize("level", [0, 4])    # nothing, and an effect of 100 nats that
def test_nodes_of_two_posteriors_give_the_evidence(level):    # moves the posterior
    scene = scene_of(generator.record(7, 1, ["temperature"] if level else [],
                                      level=level or 1))
    h = member(scene, MODEL[1])
    listed = signatures.families(scene, [CATALOGUE[name] for name in (
        "rate_ramp", "bias_step", "temperature", "turn_on_transient")])
    table = signatures.bayes_table()

    def log_likelihood(theta):
        solved = backward.solve(h, scene, (), theta)
        found = [scans.scores(scene, family, solved) for family in listed]
        return np.column_stack([solved.base, *(
            solved.base + signatures.mean_bayes(one.gain, table[one.k])
            for one in found)])
    whole = evidence.integrate(log_likelihood, h.parameters, effort=6.0)
    reference = account(scene, [h])
    (sample,) = directed.directed(scene, reference, listed)
    gain = whole.log_evidence - whole.log_evidence[0]
    assert (gain.max() > 50.0) == (level == 4)
    near = gain > gain.max() - 10.0    # of the others, nodes of theirs would tell
    assert_allclose(sample.log_evidence[near], whole.log_evidence[near], atol=0.4)
    if level:    # those that cannot be the best are asked at the first nodes alone
        (first,) = directed._scored(scene, reference, reference, listed, range(1, 5),
                                    table, {})
        assert len(sample.theta) > len(first.theta)
        alone = directed._pooled(scene, [first], reference.samples[0]).log_evidence
        far = alone < alone.max() - directed.RESCUED
        assert far.any() and not far[gain.argmax()]
        assert_allclose(sample.log_evidence[far], alone[far], rtol=1e-12)


@pytest.mark.parametrize("size", [0.0, 8.0])    # of a step beside waves
def test_waves_are_resolved_where_that_may_matter(size):
    t = np.arange(600.0)
    y = sensorid.simulate(WHITE_OF_A_RANGE, DT, 600, seed=4).error[0] + size * (
        t > 200.0) + 8.0 * (t > 300.0) * np.exp((300.0 - t) / 20.0) * np.sin(0.5 * t)
    scene, grids = Scene(y, DT, {}), {}
    listed = signatures.families(scene, [CATALOGUE["bias_step"], CATALOGUE["ringing"]])
    reference = account(scene, [member(scene, WHITE_OF_A_RANGE[0])])
    (sample,) = directed.directed(scene, reference, listed, grids=grids)
    none, step, waves = sample.log_evidence
    assert waves > none + 3.0 and (step > waves + directed.RESCUED) == (size > 0.0)
    assert (2 in grids) == (size == 0.0)


@pytest.mark.parametrize("beside, resolved", [("correlated_noise", False),
                                              ("outliers", True)])
def test_waves_are_not_resolved_where_a_process_promises_far_more(beside, resolved):
    slow = lfilter([1.0], [1.0, -0.95], np.random.default_rng(2).standard_normal(2000))
    y = slow + sensorid.simulate(WHITE_OF_A_RANGE, DT, 2000, seed=4).error[0]
    scene = Scene(y, DT, {})
    base = account(scene, [member(scene, WHITE_OF_A_RANGE[0])])
    waves, other = sought(scene, base, [CATALOGUE["ringing"], CATALOGUE[beside]]).rivals
    assert waves.log_bayes > 3.0 and other.effect.name == beside
    assert (waves.family in waves.stand_in.grids) == resolved
    assert (other.log_bayes > waves.log_bayes + 100.0) != resolved


def test_few_nodes_at_a_time_give_the_same_evidence(monkeypatch):
    scene = scene_of(generator.record(7, 1, ["sinusoid"], level=2))
    h = member(scene, MODEL[1])
    listed = signatures.families(scene, [CATALOGUE[name] for name in (
        "rate_ramp", "bias_step", "pulse", "sinusoid", "ringing")])
    reference = account(scene, [h])
    (whole,) = directed.directed(scene, reference, listed)
    monkeypatch.setattr(directed, "NODE_BLOCK", 3 * len(scene.y))
    monkeypatch.setattr(directed, "LEAST_NODES", 1)
    (parts,) = directed.directed(scene, reference, listed)
    assert_allclose(parts.log_evidence, whole.log_evidence, atol=0.2)


def ln_bayes(scene, h, name):
    """By the filters, and by the screen."""
    base = account(scene, [h])
    full = account(scene, [h], [h.with_effect(CATALOGUE[name])], past=base)
    seen = filters.predict(h, scene, (), base.theta[None])
    if CATALOGUE[name].drive and name not in screens.SCREENS:
        return full.log_evidence - base.log_evidence, screens.change_of_drive(
            CATALOGUE[name], scene, base.member, (), base.theta).about
    if name not in screens.SCREENS:
        return full.log_evidence - base.log_evidence, screens.change_of_level(
            CATALOGUE[name], scene, base.member, (), base.theta)
    z = seen.z[0, 0]
    return full.log_evidence - base.log_evidence, screens.screened(
        CATALOGUE[name], scene, z, screens.usual_variance(z, seen.log_score[0, 0]))


@pytest.mark.parametrize("name", [*screens.SCREENS, "walk_step", "random_telegraph",
                                  "random_steps"])
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_screen_tells_about_what_the_filters_tell(name, share, monkeypatch):
    # what the filters tell is known to 0.07 nats
    monkeypatch.setattr(evidence, "ENOUGH_POINTS", 4.0 * evidence.ENOUGH_POINTS)
    rng = np.random.default_rng(8)
    y = np.cumsum(0.05 * rng.standard_normal(1500)) + 0.5 * rng.standard_normal(1500)
    late = np.arange(1500) > 900
    rare = rng.random(1500) < 0.01
    other = dict(noise_step=0.4 * late, walk_step=0.2 * late, outliers=2.0 * rare,
                 noise_bursts=0.7 * (np.cumsum(rare) % 2),
                 random_telegraph=1.2 * (np.cumsum(rare) % 2), random_steps=rare)[name]
    if name != "random_telegraph":
        other = other * rng.standard_normal(1500)
    if name in ("walk_step", "random_steps"):
        other = np.cumsum(other)
    scene = Scene(y + share * other, DT, {})
    exact, about = ln_bayes(scene, member(scene, MODEL[0]), name)
    assert (exact > 3.0) == bool(share)
    assert_allclose(about, exact, atol=1.0 + 0.2 * abs(exact))


@pytest.mark.parametrize("onset, ratio", [(0.3, 2.0), (0.6, 0.2), (0.0, 2.0)])
def test_a_screen_knows_that_the_drive_of_a_simulator_is_fixed(onset, ratio):
    rng, N = np.random.default_rng(2), 3000
    walk = 0.1 * np.where(np.arange(N) < onset * N, 1.0, ratio) * rng.standard_normal(N)
    scene = Scene(np.cumsum(walk) + 0.5 * rng.standard_normal(N), DT, {})
    known = member(scene, sensorid.hypothesis(
        "random_walk", sigma_w=0.1, sigma_v=0.5))
    exact, about = ln_bayes(scene, known, "walk_step")
    assert exact > 15.0
    assert_allclose(about, exact, atol=1.0 + 0.1 * abs(exact))


@pytest.mark.parametrize("name", ["correlated_noise", "bias_instability"])
@pytest.mark.parametrize("size", [0.0, 0.25, 0.5])
def test_spectra_tell_about_what_the_filters_of_a_process_tell(name, size):
    rng, a = np.random.default_rng(3), np.exp(-0.1)
    walk, white, process = rng.standard_normal((3, 4000))
    process = lfilter([np.sqrt(1.0 - a**2)], [1.0, -a], process)
    scene = Scene(0.02 * np.cumsum(walk) + 0.5 * white + size * process, DT, {})
    base = account(scene, [member(scene, h) for h in MODEL])
    full = account(scene, base.bases, [h.with_effect(CATALOGUE[name])
                                       for h in base.hypotheses], past=base)
    exact = full.log_evidence - base.log_evidence
    (about,) = inside._told_by_screens(
        inside.Inside(scene, scene, base, base), [CATALOGUE[name]])
    assert (exact > 3.0) == (size > 0.0)
    assert_allclose(about, exact, atol=1.0 + 0.1 * abs(exact))


def test_what_is_known_of_one_spares_the_filters_of_all_others():
    rng = np.random.default_rng(6)
    scene = Scene(rng.standard_normal(500), DT, {})
    base = account(scene, [member(scene, WHITE_OF_A_RANGE[0])])
    some = [CATALOGUE[name] for name in ("correlated_noise", "bias_instability")]
    where = inside.Inside(scene, scene, base, base)
    one, other = inside.with_filters(where, inside.told_inside(where, some), 100.0,
                                     "bias_instability")
    assert one.effect is some[1] and one.account and one.log_bayes < 3.0
    assert other.effect is some[0] and not other.account


@pytest.mark.parametrize("name", ["noise_step", "walk_step", "random_telegraph"])
def test_what_is_weak_in_a_long_record_passes_its_screen(name):
    rng, N = np.random.default_rng(4), 10**5
    late = np.arange(N) > 0.4 * N
    louder = {"walk_step": 1.2, "noise_step": 1.03}
    walk, white = (sd * rng.standard_normal(N) * np.where(
        late & (name == own), louder[own], 1.0) for sd, own in (
            (0.05, "walk_step"), (0.5, "noise_step")))
    level = 0.5 * (np.cumsum(rng.random(N) < 0.01) % 2) * (name == "random_telegraph")
    scene = Scene(np.cumsum(walk) + white + level, DT, {})
    h = member(scene, MODEL[0])
    base = account(scene, [h])
    full = account(scene, [h], [h.with_effect(CATALOGUE[name])], past=base)
    exact = full.log_evidence - base.log_evidence
    (about,) = inside._told_by_screens(
        inside.Inside(scene, scene, base, base), [CATALOGUE[name]])
    assert exact > 8.0
    assert about > rival.AT_LEAST * exact


def test_a_few_outliers_in_a_long_record_pass_their_screen():
    rng = np.random.default_rng(1)
    z, hit = rng.standard_normal(10**6), rng.random(10**6) < 2e-5
    scene = Scene(z, DT, {})
    z[hit] *= 5.0
    told = screens.screened(CATALOGUE["outliers"], scene, z, 1.0)
    # what a sum over all samples with the true numbers says, less what searching costs
    gain = np.logaddexp(np.log(1.0 - 2e-5) - 0.5 * z**2, np.log(2e-5 / 5.0)
                        - 0.5 * (z / 5.0)**2) + 0.5 * z**2
    assert gain.sum() - 10.0 < told < gain.sum() + 2.0


def test_a_screen_knows_no_other_effect():
    scene = Scene(np.zeros(100), DT, {})
    assert np.isnan(screens.screened(CATALOGUE["bandwidth"], scene, scene.y, 1.0))


@pytest.mark.parametrize("dwell, size, expected", [
    (450, 0.8, (6, 14)),    # small ones are seen after a while
    (1000, 0.8, (1, 3)), (3900, 0.0, (0, 0)),
    (40, 4.0, (50, 150))])    # others before the last one is long ago
def test_steps_are_counted_soon_or_not_so_soon_after_each(dwell, size, expected):
    rng = np.random.default_rng(3)
    at = np.arange(4000) // dwell
    sign = rng.choice([-1.0, 1.0], at.max() + 1)
    y = rng.standard_normal(4000) + size * np.cumsum(sign)[at]
    scene = Scene(y, DT, {})
    new = account(scene, [member(scene, WHITE_OF_A_RANGE[0], "random_steps")])
    assert expected[0] <= inside._steps(new, scene) <= expected[1]


def test_what_was_only_told_is_fitted_before_it_is_named(monkeypatch):
    def told(*where, own=inside._told_by_screens):
        much = dict(outliers=30.0, noise_bursts=28.0)
        for effect, about in zip(where[-1], own(*where)):
            yield much.get(effect.name, about)
    monkeypatch.setattr(inside, "_told_by_screens", told)
    monkeypatch.setattr(inside, "FEW", 29.0)    # so that bursts are told of alone
    y = np.random.default_rng(1).standard_normal(600)
    d = sensorlab.diagnose(y, DT, WHITE_OF_A_RANGE)
    assert d.verdict == "none"
    assert max(c.log_bayes for c in d.causes if "noise_bursts" in c.effects) < 2.0


@pytest.mark.parametrize("noise, rests", [(0.2, True), (0.45, True), (0.6, False)])
def test_bursts_over_next_to_no_noise_would_stand_in_for_the_law_of_rounding(noise,
                                                                             rests):
    lsb = 2.0
    scene = Scene(lsb * np.round(np.random.default_rng(4).standard_normal(500)), DT, {})
    rounded = Found(CATALOGUE["quantization"], values=fixed(lsb=lsb))
    white = sensorid.hypothesis("white_noise", sigma_v=(0.01, 9.0))
    h = Member(white, scene).joined(rounded).with_effect(CATALOGUE["noise_bursts"])

    def rest(lsb, h):
        theta = np.array([noise * lsb if symbol == "sigma_v" else lsb
                          if symbol == "lsb" else p.mean
                          for (_, symbol), p in zip(h.keys, h.parameters)])
        read = Reading(rounded._replace(values=dict(lsb=lsb)), 1.0,
                       np.zeros(500, bool), False)
        return inside.rests_on_rounding(SimpleNamespace(
            member=h, theta=theta, signatures=(), readings=[read]), scene)
    assert rest(lsb, h) == rests
    assert not rest(0.0, h)                            # what is not rounded
    assert not rest(lsb, Member(white, scene).joined(rounded))    # nor jumps


def test_an_onset_that_was_sought_without_the_outliers_is_moved_to_where_they_see_it():
    rng, at, late = np.random.default_rng(2), 600, 3
    y = rng.standard_normal(1000) + 4.0 * (np.arange(1000) >= at)
    y += (rng.random(1000) < 0.03) * 10.0 * rng.standard_normal(1000)
    scene, effect = Scene(y, 1.0, {}), CATALOGUE["bias_step"]
    h = sensorid.hypothesis("white_noise", sigma_v=(0.5, 2.0), bias_sigma=3.0)
    acc = account(scene, [member(scene, h, "outliers")])
    odd = filters.predict(acc.member, scene, (), acc.theta[None]).odd[0, 0] > 0.5
    plain = Scene(np.where(odd, np.nan, y), 1.0, {})
    reference = account(plain, [member(plain, h)])
    values = dict(onset=float(at + late), size=4.0)
    found = Found(effect, values=values)
    one = linear.Signature(found, effects.columns_of(scene, found, values), 9.0)
    near = directed.onsets_nearby(scene, one, 4)
    assert [s.found.values["onset"] for s in near] == [at + late + k
                                                       for k in range(-4, 5)]
    assert near[4] is one
    assert_allclose(np.argmax(near[0].columns), np.argmax(one.columns) - 4)
    told = Found(effect, values=dict(onset=(at + late, 0.5), size=(4.0, 0.1)))
    stand_in = StandIn(plain, reference, [], [], {}, {(1, None): (one, told)})
    searched = weighing._seen_elsewhere(scene, acc, Rival(
        effect, "", 100.0, 1, stand_in))
    moved, told = stand_in.signature(1)
    # a step from 599 to 600 is one at any time between
    assert abs(moved.found.values["onset"] - at) <= 1.0
    assert told.values["onset"] == (moved.found.values["onset"], 0.5)
    assert searched >= 0.0


def test_a_size_is_known_as_well_as_what_else_its_signature_depends_on():
    """Of a lagged temperature in white noise, against the sum over a grid of lags."""
    rng, n = np.random.default_rng(2), 800
    temperature = lfilter([1.0], [1.0, -0.9], rng.standard_normal(n))
    effect = CATALOGUE["thermal_lag"]

    def column(tau):
        scene = Scene(np.zeros(n), 1.0, dict(temperature=temperature))
        return dict(effect.columns(scene, temperature, tau))["lagged value"][:, 0]
    y = rng.standard_normal(n) + 0.3 / column(30.0).std() * column(30.0)
    scene = Scene(y, 1.0, dict(temperature=temperature))
    (prior,) = effect.parameters(scene)
    taus = prior.quantile(np.linspace(0.0, 1.0, 400))
    fits = [np.linalg.lstsq(np.column_stack([column(tau), np.ones(n)]), y, rcond=None)
            for tau in taus]
    spread = np.array([1.0 / (column(tau) - column(tau).mean()).std() / np.sqrt(n)
                       for tau in taus])
    mass = np.exp(-0.5 * np.array([fit[1][0] for fit in fits]) + 0.5 * n) * spread
    mass /= mass.sum()
    size = np.array([fit[0][0] for fit in fits])
    mean = mass @ size
    sd = np.sqrt(mass @ ((size - mean)**2 + spread**2))
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=50.0))
    found = Found(effect, "temperature", "lagged value", dict(
        tau=30.0, coefficient=0.6))
    one = linear.Signature(found, effects.columns_of(scene, found, found.values), 9.0)
    told = directed.estimated_beside(scene, h, [], one, np.array([[1.0]]))
    assert told["coefficient"] == (pytest.approx(mean, abs=0.3 * sd),
                                   pytest.approx(sd, rel=0.25))
    assert sd > 1.5 * spread[np.searchsorted(taus, 30.0)]    # that at one lag
    assert told["tau"][0] == pytest.approx(mass @ taus, rel=0.3)
