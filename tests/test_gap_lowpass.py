"""What begins at once and passes a digital low-pass, against dense matrices and SciPy's
filter.
"""

import json

import numpy as np
import pytest
from conftest import WHITE, large, member, thorough, through_low_pass
from numpy.testing import assert_allclose
from scipy import signal, stats

import sensorid
import sensorlab
from sensorlab import CATALOGUE, Found, Scene, Simulator, modelfiles, simulate_effects
from sensorlab.gap import (
    backward, effects, filters, linear, lowpass, scans, signatures, words)
from sensorlab.gap.catalogue import MIN_PULSE
from sensorlab.gap.effects import fixed
from sensorlab.gap.lowpass import LowPass

FORMS = (("digital first order", 0.9), ("digital", 1.3), ("digital", 4.0),
         ("exponential", 3.0))
N, SPREAD = 300, 2.0


@pytest.fixture(params=FORMS, ids=lambda form: f"{form[0]}, tau {form[1]}")
def behind(request):
    """A record with a gap, of white noise through a low-pass, and that; `Solved`; the
    low-pass and the inverse covariance as matrices.
    """
    variant, tau = request.param
    long = through_low_pass(variant, tau, N + 1000)
    y = (long @ np.random.default_rng(2).standard_normal(N + 1000))[1000:] + 1.0
    y[100:110] = np.nan
    scene, one = Scene(y, 1.0, {}), LowPass(variant, tau)
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=SPREAD)
               ).with_effect(CATALOGUE["bandwidth"], variant)
    solved = backward.solve(h, scene, (), np.array([[1.0, tau]]), one)
    seen, cov = ~np.isnan(y), (long @ long.T)[1000:, 1000:] + SPREAD**2
    inverse = np.zeros((N, N))
    inverse[np.ix_(seen, seen)] = np.linalg.inv(cov[np.ix_(seen, seen)])
    return scene, one, solved, through_low_pass(variant, tau, N), inverse


def test_a_low_pass_is_that_of_scipy(behind):
    scene, one, _, L, _ = behind
    rng = np.random.default_rng(1)
    columns, rows = rng.standard_normal((N, 2)), rng.standard_normal((3, N))
    columns[0] = 0.0
    assert_allclose(one.passed(columns, 1.0), L @ columns, atol=1e-12)
    assert_allclose(one.passed(columns + 5.0, 1.0), L @ columns + 5.0, atol=1e-12)
    assert_allclose(one.back(rows, 1.0), rows @ L, atol=1e-12)
    w = np.linspace(0.0, np.pi, 9)
    response = through_low_pass(one.variant, one.tau, 4000)[:, 0]
    assert_allclose(one.power(2.0 - 2.0 * np.cos(w), 1.0), np.abs(
        signal.freqz(response, worN=w)[1])**2, atol=1e-9)


def test_the_backward_pass_gives_steps_as_they_are_and_as_they_pass(behind):
    scene, one, solved, L, inverse = behind
    y = np.nan_to_num(scene.y)
    for low_pass, passed in (None, np.eye(N)), (one, L):
        family = signatures.Family(CATALOGUE["bias_step"], "", low_pass=low_pass)
        found = scans.scores(scene, family, solved)
        for onset in (1, 3, 30, 99, 104, 150, 234, 236):
            s = passed @ (np.arange(N) >= onset)
            J, number = s @ inverse @ s, s @ inverse @ y
            assert_allclose(found.sd[0, onset - 1]**-2, J, rtol=2e-3)
            assert_allclose(found.size[0, onset - 1], number / J,
                            atol=0.03 * found.sd[0, onset - 1])
            (exact,) = signatures.scores_at(scene, family, solved, [float(onset)]).gain
            if not MIN_PULSE <= onset <= N - MIN_PULSE:    # it is no step
                exact = [0.0]
            assert_allclose(exact, found.gain[0, onset - 1], rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("name", ["pulse", "gradual_step", "ringing"])
def test_scans_find_what_passes(behind, name):
    """The best of a scan gains about what its column does, and none gains more."""
    scene, one, solved, L, inverse = behind
    values = dict(pulse=(120.0, 12.0), gradual_step=(60.0, 80.0),
                  ringing=(140.0, 40.0, 0.12))[name]
    (_, column), *_ = CATALOGUE[name].columns(scene, None, values)
    y = scene.y + 3.0 * L @ column[:, 0]
    scene, h = scene._replace(y=y), member(scene, WHITE[0])
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=SPREAD)
               ).with_effect(CATALOGUE["bandwidth"], one.variant)
    solved = backward.solve(h, scene, (), np.array([[1.0, one.tau]]), one)
    family = signatures.Family(CATALOGUE[name], "", low_pass=one)
    best = signatures.scores_at(scene, family, solved, [values]).gain.max()
    found = [part for part in scans.SCANS[CATALOGUE[name].search](
        scene, family, solved)]
    top = max(found, key=lambda part: part.gain.max())
    psi, (variant,) = top.of(top.gain.argmax(keepdims=True))
    exact = signatures.scores_at(scene, family._replace(variant=variant), solved,
                                 psi.tolist()).gain[0, 0]
    assert top.gain.max() == pytest.approx(exact, rel=0.15)
    assert top.gain.max() > 0.7 * best


def test_edges_where_a_low_pass_stops_all_gain_nothing_by_rounding():
    """Where what is known has them already, what is left of some 1e10 is nothing."""
    rng, n = np.random.default_rng(5), 1000
    y = signal.lfilter(*signal.butter(2, 0.2), rng.standard_normal(n + 600))[600:]
    scene, effect = Scene(y, 1.0, {}), CATALOGUE["pulse"]
    h = member(scene, sensorid.hypothesis("random_walk", sigma_w=0.01, sigma_v=1.0)
               ).with_effect(CATALOGUE["bandwidth"], "digital")
    known = dict(onset=300.0, duration=5.0, size=0.1)
    found = Found(effect, variant="rectangular", values=known)
    one = linear.Signature(found, effects.columns_of(scene, found, known), 1.0)
    scene = scene._replace(y=y + 0.1 * one.columns[:, 0])
    for taus in [1.6], [1.5, 1.6, 1.7]:
        theta = np.array([[0.01, 1.0, tau] for tau in taus])
        solved = backward.solve(h, scene, (one,), theta)
        if len(taus) == 1:
            solved = solved.for_scans(np.isnan(scene.y))
        told = signatures.scores_at(scene, signatures.Family(effect, ""), solved, [
            (300.0, 5.0), (301.0, 4.0), (300.0, 6.0), (299.0, 7.0)])
        assert told.gain[:, np.array(told.variant) == "rectangular"][:, 0].max() < 1.0
        assert told.gain.max() < 60.0


def test_a_record_of_a_model_has_edges_as_its_low_pass_leaves_them(tmp_path):
    step = Found(CATALOGUE["bias_step"], values=fixed(onset=50.0, size=2.0),
                 low_pass=LowPass("digital", 3.0))
    simulator = Simulator((sensorid.hypothesis(
        "white_noise", sigma_v=1e-12, bias_sigma=0.0),), ((step,),))
    file = tmp_path / "model.json"
    model = modelfiles.Model(1.0, "u", simulator)
    file.write_text(modelfiles.model_text(model))
    (read,), = modelfiles.read_model(file).simulator.effects
    assert read.low_pass == step.low_pass
    scene = Scene(np.zeros(200), 1.0, {})
    for own in simulator, modelfiles.read_model(file).simulator:
        y = simulate_effects(own, scene).error[0]
        assert_allclose(y, 2.0 * through_low_pass("digital", 3.0, 200) @ (
            np.arange(200) >= 50), atol=1e-10)
    tree = json.loads(file.read_text())
    for variant, tau in ("third order", 3.0), ("digital", -1.0):
        tree["hypotheses"][0]["effects"][0]["low_pass"] = dict(variant=variant, tau=tau)
        file.write_text(json.dumps(tree))
        with pytest.raises(ValueError, match=r"low_pass\.(variant|tau) is"):
            modelfiles.read_model(file)
    line = dict(name="sinusoid", low_pass=step.low_pass._asdict(), parameters=dict(
        frequency=0.1, amplitude=1.0))
    tree["hypotheses"][0]["effects"] = [line]
    file.write_text(json.dumps(tree))
    with pytest.raises(ValueError, match="low_pass is .* it must be null"):
        modelfiles.read_model(file)


def test_what_is_there_before_a_low_pass_takes_the_form_that_passes_it():
    scene = Scene(np.zeros(100), 1.0, {})
    found = Found(CATALOGUE["bias_step"], values=dict(onset=50.0, size=2.0))
    one = linear.Signature(found, found.effect.columns, 1.0)
    low_pass = LowPass("digital", 3.0)
    assert lowpass.signature_passing(low_pass, one, scene, False) is one
    passed = lowpass.signature_passing(low_pass, one, scene, True)
    assert passed.found.low_pass == low_pass and passed.columns[50, 0] < 0.2
    assert lowpass.signature_passing(low_pass, passed, scene, True) is passed
    slower = lowpass.signature_passing(LowPass("digital", 9.0), passed, scene, False)
    assert slower.found.low_pass.tau == 9.0 and slower.columns[60, 0] < passed.columns[
        60, 0]
    line = one._replace(found=found._replace(effect=CATALOGUE["sinusoid"]))
    assert lowpass.signature_passing(low_pass, line, scene, True) is line


@pytest.mark.thorough
@pytest.mark.parametrize("before", [True, False])
def test_a_step_is_found_before_a_low_pass_and_behind_it(before):
    """Before it a sharp edge would be impossible where the low-pass stops all."""
    rng = np.random.default_rng(1)    # of 3, it is as likely gradual
    step = 0.6 * (np.arange(2600) >= 1700)
    b, a = signal.butter(2, 0.3)
    y = signal.lfilter(b, a, rng.standard_normal(2600) + before * step)[600:]
    y += (not before) * step[600:]
    d = sensorlab.diagnose(y, 1.0, WHITE)
    assert d.verdict == "bandwidth+bias_step"
    low_pass, found = d.found
    mean, sd = found.values["onset"]
    assert abs(mean - 1100.0) < 3.0 * sd
    assert (found.low_pass is not None) == before
    if before:
        tau = low_pass.values["tau"][0]
        assert found.low_pass.tau == pytest.approx(tau, rel=0.03)
        model = sensorlab.augmented(d)
        (saved,) = [one for one in model.effects[0] if one.name == "bias_step"]
        assert saved.low_pass == found.low_pass
        assert sensorlab.diagnose(y, 1.0, model).verdict == "none"


@pytest.mark.thorough
@pytest.mark.parametrize("lsb", [0.0, 0.1])
def test_a_telegraph_is_found_before_a_low_pass(lsb):
    """Its edges are as smooth as a low-pass leaves them."""
    rng = np.random.default_rng(2)
    b, a = signal.butter(2, 0.4)
    noise = rng.standard_normal((2, 3100))
    level = 1.2 * (np.cumsum(rng.random(3100) < 0.008) % 2)
    theirs, y = (signal.lfilter(b, a, u)[100:] for u in (noise[0], noise[1] + level))
    if lsb:
        theirs, y = lsb * np.round(np.array([theirs, y]) / lsb)
    d = sensorlab.diagnose(y, 1.0, sensorlab.simulator_from(theirs[None], 1.0))
    assert d.verdict == "random_telegraph"
    mean, sd = d.found[0].values["size"]
    assert abs(mean - 1.2) < 3.0 * sd < 0.3
    drawn = sensorlab.simulate_effects(
        sensorlab.augmented(d), Scene(np.zeros(3000), 1.0, {}), seed=1).error[0]
    assert sensorlab.diagnose(drawn, 1.0, sensorlab.augmented(d)).verdict == "none"


@pytest.mark.thorough
@pytest.mark.parametrize("low_pass", [
    signal.butter(2, 0.3), ([0.6], [1.0, -0.4])], ids=["2", "1"])
def test_outliers_are_found_before_a_low_pass(low_pass):
    """Each is as long as a low-pass makes it: neither a burst nor a step."""
    rng = np.random.default_rng(3)
    noise, size = rng.standard_normal((2, 3100)), 15.0 * rng.standard_normal(3100)
    at = rng.random(3100) < 0.005
    theirs, y = (signal.lfilter(*low_pass, u)[100:] for u in (
        noise[0], noise[1] + size * at))
    d = sensorlab.diagnose(y, 1.0, sensorlab.simulator_from(theirs[None], 1.0))
    assert d.verdict == "outliers" and d.found[0].variant == "before the low-pass"
    mean, sd = d.found[0].values["sigma"]
    known = 15.0 / np.sqrt(2.0 * at[100:].sum())    # were they seen without noise
    assert abs(mean - 15.0) < 3.0 * sd < 4.5 * known
    model = sensorlab.augmented(d)
    drawn = sensorlab.simulate_effects(
        model, Scene(np.zeros(3000), 1.0, {}), seed=1).error[0]
    assert sensorlab.diagnose(drawn, 1.0, model).verdict == "none"
    assert np.abs(drawn).max() > 6.0 * np.median(np.abs(drawn))


@pytest.mark.parametrize("effect", [
    large("noise_bursts"), thorough("noise_step")])
def test_noise_that_is_louder_before_a_low_pass_is_found_beside_a_walk(effect):
    """Near half the sampling rate the low-pass of the walk leaves next to nothing: it
    must pass as the noise does.
    """
    rng, at = np.random.default_rng(1), np.arange(3100)
    loud = at > 2000 if effect == "noise_step" else (at - 100) % 600 < 50
    noise, walk = rng.standard_normal((2, 2, 3100)) * [[[1.0]], [[0.01]]]
    noise[1] *= np.where(loud, 2.5, 1.0)
    theirs, y = signal.lfilter(*signal.butter(2, 0.3), noise + np.cumsum(walk, 1))[
        :, 100:]
    d = sensorlab.diagnose(y, 1.0, sensorlab.simulator_from(theirs[None], 1.0))
    assert d.verdict == effect and d.after.p_value > 0.01
    mean, sd = d.found[0].values["ratio" if effect == "noise_step" else "sigma"]
    assert abs(mean - (2.5 if effect == "noise_step" else 5.25**0.5)) < 3.0 * sd < 0.6
    model = sensorlab.augmented(d)
    drawn = sensorlab.simulate_effects(
        model, Scene(np.zeros(3000), 1.0, {}), seed=1).error[0]
    assert sensorlab.diagnose(drawn, 1.0, model).verdict == "none"


def log_density(scene, low_pass, noise):
    """Of a record, by a dense matrix: noise of a covariance (N + 1000, N + 1000) that
    passes, a bias, and what digits leave out.
    """
    seen, long = ~np.isnan(scene.y), through_low_pass(*low_pass, N + 1000)
    cov = (long @ noise @ long.T)[1000:, 1000:] + SPREAD**2 + (
        scene.rounding**2 * np.eye(N))
    return stats.multivariate_normal(cov=cov[np.ix_(seen, seen)]).logpdf(scene.y[seen])


@pytest.mark.large
def test_vibration_passes_a_low_pass(behind):
    scene, low_pass, *_ = behind
    rounded = scene._replace(rounding=0.01)    # it leaves less
    h = member(rounded, sensorid.hypothesis("white_noise", sigma_v=0.5,
                                            bias_sigma=SPREAD), "narrow_band_noise"
               ).with_effect(CATALOGUE["bandwidth"], low_pass.variant)
    lag = np.abs(np.subtract.outer(*2 * [np.arange(N + 1000)]))
    band = 0.8**2 * np.exp(-lag / 20.0) * np.cos(2.0 * np.pi * 0.07 * lag)
    theta = np.array([[0.5, 0.07, 20.0, 0.8, low_pass.tau]])
    assert_allclose(
        filters.log_likelihoods(h, rounded, (), theta),
        log_density(rounded, low_pass, band + 0.5**2 * np.eye(len(lag))), rtol=1e-6)


@pytest.mark.parametrize("before", [large(True), thorough(False)])
def test_an_error_that_follows_a_rate_is_found_before_a_low_pass_and_behind_it(before):
    rng, n = np.random.default_rng(9), 1500
    rate = np.repeat(rng.uniform(-50.0, 50.0, n // 50), 50)
    L = through_low_pass("digital", 1.5, n + 200)
    v, error = rng.standard_normal(n + 200), np.append(np.zeros(200), 0.01 * rate)
    y = (L @ (v + error) if before else L @ v + error)[200:]
    y = np.array([float(f"{x:.3f}") for x in y])
    h = sensorid.hypothesis("white_noise", sigma_v=(0.5, 2.0))
    low_pass = Found(CATALOGUE["bandwidth"], variant="digital", values=fixed(tau=1.5))
    d = sensorlab.diagnose(y, 1.0, Simulator((h,), ((low_pass,),)), dict(rate=rate))
    assert d.verdict == "scale_factor"
    (one,) = d.found
    assert bool(one.low_pass) == before == any(
        "smooths its edges" in line for line in words.advice(d, "u"))
    mean, sd = one.values["coefficient"]
    assert abs(mean - 0.01) < 4.0 * sd


def test_what_digits_round_is_white_noise_behind_a_low_pass(behind):
    scene, low_pass, *_ = behind
    rounded = scene._replace(rounding=0.01)
    h = member(rounded, sensorid.hypothesis("white_noise", sigma_v=1.0,
                                            bias_sigma=SPREAD)
               ).with_effect(CATALOGUE["bandwidth"], low_pass.variant)
    assert_allclose(
        filters.log_likelihoods(h, rounded, (), np.array([[1.0, low_pass.tau]])),
        log_density(rounded, low_pass, np.eye(N + 1000)), rtol=1e-6)


@pytest.mark.parametrize("digits", [large("%.3f"), large("%.4g")])
def test_a_low_pass_is_named_alone_in_a_file_of_few_digits(digits):
    """At half the rate it leaves less than they do, many thousands of nats."""
    rng = np.random.default_rng(6)
    v = through_low_pass("digital", 1.0, 2200) @ rng.standard_normal(2200)
    d = sensorlab.diagnose([float(digits % x) for x in v[200:]], 1.0, WHITE)
    assert d.verdict == "bandwidth" and d.after.p_value > 0.05
    assert abs(d.final.theta[-1] - 1.0) < 0.1
