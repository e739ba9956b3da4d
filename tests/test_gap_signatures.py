"""Signatures against least squares and quadrature."""

import numpy as np
import pytest
from conftest import DT, MODEL, WHITE_OF_A_RANGE, dense, large, member
from numpy.testing import assert_allclose, assert_array_equal
from scipy import integrate as quadrature
from scipy.fft import next_fast_len
from scipy.signal import find_peaks
from scipy.stats import norm

import sensorid
import sensorlab
from figures import hostile
from sensorlab import CATALOGUE, Effect, Scene
from sensorlab.gap import backward, directed, evidence, onsets, scans, signatures
from sensorlab.gap.account import account
from sensorlab.gap.augmented import ANY_PHASE
from sensorlab.gap.effects import Found, fixed
from sensorlab.gap.shapes import lagged


@pytest.mark.parametrize("name", ["", "bias_instability", "noise_step", "walk_step",
                                  "louder_at_times"])
def test_what_lasts_a_short_while_needs_a_part_of_a_long_record(name, monkeypatch):
    N = 80_000
    rng = np.random.default_rng(3)
    y = rng.standard_normal(N)
    y[40_100:40_130] = np.nan
    scene = Scene(y, DT, {})
    h = member(scene, MODEL[1], *[name] * (name in CATALOGUE))
    if name == "louder_at_times":
        share = rng.random(N)
        h = h.with_effect(Effect(name, elementwise=True, model=lambda scene, filt: (
            filt._replace(Psi=np.sqrt(filt.Psi**2 + share)))))
    theta = np.array([[p.quantile(u) for p in h.parameters] for u in (0.4, 0.6)])
    solved = backward.solve(h, scene, (), theta)
    one = solved.node(1).for_scans(np.isnan(y))
    assert (one.filter is None) == (name == "")    # of one state
    t = np.arange(N) - 40_000
    wave = np.where((t >= 0) & (t < 200), np.exp(0.3j * t) * np.sin(t * np.pi / 200), 0)
    columns = np.array([[wave.real, wave.imag]])
    first, last = signatures._about(columns[0], solved.memory)
    assert 0 < first < last < N
    part, of_one = (signatures.information(scene, columns, own)
                    for own in (solved, one))
    monkeypatch.setattr(signatures, "MEMORY", N)
    whole = signatures.information(scene, columns, solved._replace(memory=N))
    scale = np.trace(whole, axis1=2, axis2=3)[..., None, None]
    assert np.abs(part - whole).max() < 1e-6 * scale.min()
    assert np.abs(of_one - whole[1:]).max() < 1e-6 * scale.min()


def test_gain_of_a_sinusoid_is_that_of_least_squares():
    y = sensorid.simulate(MODEL[1:], DT, 400, seed=4).error[0]
    scene, theta = Scene(y, DT, {}), np.array([[300.0, 0.9, 0.4]])
    h = member(scene, MODEL[1])
    solved = backward.solve(h, scene, (), theta)
    lines = signatures.Family(CATALOGUE["sinusoid"], "")
    parts = list(scans.SCANS["frequency"](scene, lines, solved))
    psi = np.concatenate([part.of(np.arange(len(part.gain)))[0] for part in parts])
    gain = np.concatenate([part.gain for part in parts])
    inverse = np.linalg.inv(dense(theta[0], 400))
    slow = round(scans.EXACT_CYCLES * scans.PADDING)
    for i in (10, 50, slow + 10, 300, len(psi) - 3):    # but at the ends, that of a
                                                         # long record: to 2 %
        phase = 2 * np.pi * psi[i] * scene.time
        s = np.column_stack([np.cos(phase), np.sin(phase)])
        b = s.T @ inverse @ y
        assert_allclose(gain[i], b @ np.linalg.solve(s.T @ inverse @ s, b),
                        rtol=1e-6 if i < 60 or i > 900 else 0.04)


def shape_of(variant, since, duration):
    """A pulse, or a slow step, as the catalogue prints it."""
    s, on = np.maximum(since, 0.0) / duration, since >= 0.0
    return {"rectangular": on * (s < 1.0), "half sine": on * (s < 1.0) * np.sin(
        np.pi * s), "decaying": on * np.exp(-3.0 * s), "": 1.0 - np.exp(-3.0 * s)
    }[variant]


@pytest.mark.parametrize("effect, variants", [
    ("pulse", ["rectangular", "half sine", "decaying"]), ("gradual_step", [""])])
def test_no_pulse_gains_more_than_by_least_squares(effect, variants):
    y = sensorid.simulate(MODEL[1:], DT, 400, seed=4).error[0]
    scene, theta = Scene(y, DT, {}), np.array([[300.0, 0.9, 0.4]])
    h = member(scene, MODEL[1])
    solved = backward.solve(h, scene, (), theta)
    family = signatures.Family(CATALOGUE[effect], "")
    inverse = np.linalg.inv(dense(theta[0], 400))
    rng, seen = np.random.default_rng(0), set()
    for found in scans.SCANS["pulse"](scene, family, solved):
        some = rng.integers(0, len(found.gain), 12)
        for i, (onset, duration), variant in zip(some, *found.of(some)):
            s = shape_of(variant, scene.time - onset, duration)
            b, J = s @ inverse @ y, s @ inverse @ s
            score = abs(b) / J**0.5
            # long curves are held against sums, which is of a twentieth of a standard
            # deviation; the information may be that of a neighbour with more
            low = 0.0 if np.any(found.log_share) else score / 3.0**0.5 - 0.05
            assert low <= found.gain[i]**0.5 < 1.05 * score + 0.05
            seen.add(variant)
    assert seen == set(variants)


@pytest.mark.parametrize("effect, envelope", [
    ("ringing", lambda s: np.exp(-3.0 * s)),
    ("vibration_burst", lambda s: np.where(s < 1.0, np.sin(np.pi * s)**2, 0.0))])
def test_gain_of_waves_is_about_that_of_least_squares(effect, envelope):
    y = sensorid.simulate(MODEL[1:], DT, 400, seed=4).error[0]
    scene, theta = Scene(y, DT, {}), np.array([[300.0, 0.9, 0.4]])
    solved = backward.solve(member(scene, MODEL[1]), scene, (), theta)
    inverse, ratio = np.linalg.inv(dense(theta[0], 400)), []
    rng = np.random.default_rng(0)
    for part in scans.SCANS["waves"](scene, signatures.Family(
            CATALOGUE[effect], ""), solved):
        # less than their share is none
        some = rng.choice(np.flatnonzero(part.gain > 0.0), 60)
        part = part._replace(gain=part.gain - 2.0 * part.log_share)
        for i, (onset, duration, frequency) in zip(some, part.of(some)[0]):
            t = np.maximum(scene.time - onset, 0.0)
            phase = 2.0 * np.pi * frequency * t
            s = (scene.time >= onset) * envelope(t / duration) * [
                np.cos(phase), np.sin(phase)]
            b = s @ inverse @ y
            ratio.append(part.gain[i] / (b @ np.linalg.solve(s @ inverse @ s.T, b)))
    # the phase at the onset matters a little, which the spectrum does not know
    assert_allclose(np.median(ratio), 1.0, atol=0.05)
    assert np.quantile(ratio, 0.05) > 0.7 and np.quantile(ratio, 0.95) < 1.4


def total_of(parts):
    """ln of the sum of the priors of all signatures of a scan."""
    return np.logaddexp.reduce([part.log_total for part in parts])


def finest(scene, family, solved, one, table):
    """`family_bayes` on the finest grid."""
    told, likely = scans.family_bayes(scene, family, solved, one, table)
    return scans.family_bayes(scene, family, solved, one, table, likely, finer=True
                              ) if likely.coarse else (told, likely)


@pytest.mark.parametrize("effect", ["bias_step", "pulse", "gradual_step", "sinusoid",
                                    "ringing", "vibration_burst"])
def test_what_matters_is_exact_at_every_node(effect):
    t = np.arange(600.0)
    y = sensorid.simulate(MODEL[1:], DT, 600, seed=4).error[0] + dict(
        bias_step=2.8 * (t > 333.0), pulse=3.0 * ((t > 200.0) & (t < 240.0)),
        gradual_step=-8.0 * np.expm1(-np.maximum(t - 250.0, 0.0) / 30.0),
        sinusoid=0.5 * np.sin(0.7 * t), ringing=(t > 300.0) * np.exp(
            (300.0 - t) / 20.0) * 5.0 * np.sin(0.5 * t),
        vibration_burst=2.0 * np.exp(-((t - 300.0) / 25.0)**2) * np.sin(0.5 * t)
    )[effect]
    scene, h = Scene(y, DT, {}), member(Scene(y, DT, {}), MODEL[1])
    theta = account(scene, [h]).sample.nodes(6)
    solved, table = backward.solve(h, scene, (), theta), signatures.bayes_table()
    family = signatures.Family(CATALOGUE[effect], "")
    one = solved.node(int(solved.base.argmax()))
    parts = list(scans.SCANS[family.effect.search](scene, family, one))
    log_total = total_of(parts)
    if family.effect.search == "waves":    # these are resolved
        best = max(parts, key=lambda part: part.gain.max())
        (psi,), _ = best.of(best.gain.argmax(keepdims=True))
        parts = [scans._waves_in_cells(scene, family, one, psi)[0]]
    top, gain = max(part.gain.max() for part in parts), []
    for part in parts:
        likely = np.flatnonzero(part.gain > top - 25.0)
        share, prior = (np.broadcast_to(each, part.gain.shape)[likely]
                        for each in (part.log_share, part.log_prior))
        for psi, name, less, more in zip(*part.of(likely), share, prior):
            own = 2.0 * less + signatures.scores_at(
                scene, family._replace(variant=name), solved, [psi.tolist()]).gain
            gain.append(more + signatures.mean_bayes(
                np.maximum(own, 0.0), table[part.k]))
    # of all that is within e^-12 of the best, and nothing else
    exact = np.logaddexp.reduce(gain) - log_total
    assert exact.min() > 8.0 and np.ptp(exact) > 0.3
    told, likely = finest(scene, family, solved, one, table)
    assert_allclose(told, exact, atol=0.15)
    again, _ = scans.family_bayes(scene, family, solved, one, table, likely)
    assert_allclose(again, told, rtol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("effect", ["ringing", "vibration_burst"])
def test_evidence_of_waves_is_a_sum_over_a_fine_grid(effect):
    """A sharp onset between those of a scan costs it many nats."""
    rng, N, dense = np.random.default_rng(3), 900, 21
    onset, n, f = 300.4, 100, 0.2893

    def columns(onset, n, f):
        since = np.arange(N) - onset
        shape = np.where(since < 0.0, 0.0, np.exp(-3.0 * since / n) * (
            since < 3.0 * n) if effect == "ringing" else np.sin(
                np.pi * since / n)**2 * (since < n))
        return shape * np.exp(2j * np.pi * f * since)
    size = dict(ringing=4.0, vibration_burst=2.2)[effect]
    y = rng.standard_normal(N) + size * columns(onset, n, f).real
    scene = Scene(y, 1.0, {})
    h = member(scene, sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=0.0))
    solved = backward.solve(h, scene, (), np.array([[1.0]]))
    family = signatures.Family(CATALOGUE[effect], "")
    told, likely = finest(scene, family, solved, solved, signatures.bayes_table())
    # all that is within a cell of the scan, or half, of the truth
    ends = [scans.WAVE_STEP**p for p in (-0.5, 0.5)]
    axes = (onset + np.linspace(-25.0, 25.0, 6 * dense), np.geomspace(*ends, dense) * n,
            f + np.linspace(-0.01, 0.01, dense))
    gain = np.empty([len(axis) for axis in axes])
    for at in np.ndindex(gain.shape):
        wave = columns(*(axis[i] for axis, i in zip(axes, at)))
        X = np.column_stack([wave.real, wave.imag])
        number = X.T @ y
        gain[at] = number @ np.linalg.solve(X.T @ X, number)
    fine = (axes[0][1] - axes[0][0]) * np.log(axes[1][1] / axes[1][0]) * (
        axes[2][1] - axes[2][0])
    own = round(likely.grid.middle[1] - likely.grid.middle[0])
    cell = own // scans.WAVE_PARTS * np.log(scans.WAVE_STEP) / next_fast_len(
        2 * own, real=True)
    total = total_of(scans._wave_scan(scene, family, solved))
    exact = np.logaddexp.reduce(signatures.log_bayes(gain.ravel(), 2), axis=None)
    assert exact + np.log(fine / cell) - total > 20.0
    # nodes are up to a standard deviation apart
    assert_allclose(told, exact + np.log(fine / cell) - total, atol=0.7)


@pytest.mark.parametrize("variant, size", [
    ("half sine", 4.0), large("decaying", 40.0), ("", 12.0)])
def test_evidence_of_a_large_pulse_is_a_sum_over_a_fine_grid(variant, size):
    """It is known better than the steps of a scan, and that to a part of a sample."""
    rng, N, onset, n = np.random.default_rng(3), 900, 300.4, 120.0

    def column(onset, n):
        since = (np.arange(N) - onset) / n
        shape = {"half sine": np.sin(np.pi * since) * (since < 1.0),
                 "decaying": np.exp(-3.0 * since), "": -np.expm1(-3.0 * since)}[variant]
        return np.where(since < 0.0, 0.0, shape)
    y = rng.standard_normal(N) + size * column(onset, n)
    scene, h = Scene(y, 1.0, {}), sensorid.hypothesis("white_noise", sigma_v=1.0,
                                                      bias_sigma=0.0)
    solved = backward.solve(member(scene, h), scene, (), np.array([[1.0]]))
    family = signatures.Family(CATALOGUE["pulse" if variant else "gradual_step"], "")
    told, _ = finest(scene, family, solved, solved, signatures.bayes_table())
    at, lengths = onset + np.linspace(-8.0, 8.0, 121), n * np.exp(np.linspace(
        -0.2, 0.2, 101))
    gain = np.array([[(x @ y)**2 / (x @ x) for x in (column(i, k) for k in lengths)]
                     for i in at])
    # of a prior that is even in the onset and in the logarithm of the duration
    share = (at[1] - at[0]) * np.log(lengths[1] / lengths[0]) / np.log(
        onsets.DURATION_STEP)
    exact = np.logaddexp.reduce(signatures.log_bayes(gain.ravel(), 1), axis=None)
    forms = ("rectangular", "half sine", "decaying") if variant else ("",)
    every = np.concatenate([N - np.exp(np.arange(*np.log(
        [onsets.SHAPES[form].least, N / 2, onsets.DURATION_STEP]))) for form in forms])
    assert gain.max() > 300.0 and gain.argmax() % 101 not in (0, 100)
    assert_allclose(told, exact + np.log(share / every.sum()), atol=0.3)


@pytest.mark.parametrize("missing", [slice(0, 80), slice(400, 799), slice(260, 540),
                                     slice(0, None, 2)])
@pytest.mark.parametrize("effect", ["pulse", "gradual_step", "ringing",
                                    "vibration_burst", "sinusoid"])
def test_where_nothing_is_seen_there_is_nothing(effect, missing):
    y = sensorid.simulate(MODEL[1:], DT, 800, seed=5).error[0]
    y[missing] = np.nan
    scene = Scene(y, DT, {})
    h = member(scene, MODEL[1])
    solved = backward.solve(h, scene, (), account(scene, [h]).theta[None])
    told, _ = finest(scene, signatures.Family(CATALOGUE[effect], ""), solved, solved,
                     signatures.bayes_table())
    assert told[0] < 1.5


def test_a_ringing_in_the_quiet_part_of_a_record_gains_no_more_than_it_should():
    rng, loud = np.random.default_rng(8), np.arange(1000) < 700
    y = np.cumsum(0.05 * rng.standard_normal(1000)) + np.where(
        loud, 3.0, 0.5) * rng.standard_normal(1000)
    scene = Scene(y, DT, {})
    h = member(scene, MODEL[0], "noise_step")
    solved = backward.solve(h, scene, (), np.array([[0.05, 3.0, 700.0, 1.0 / 6.0]]))
    family = signatures.Family(CATALOGUE["ringing"], "")
    gains = np.concatenate([p.gain for p in scans.SCANS["waves"](
        scene, family, solved)])
    assert gains.max() < 2.0 * np.log(len(gains)) + 10.0


@pytest.mark.parametrize("sigma_w, edges, size, reach", [
    (0.05, (407, 527), 3.0, 8), (1e-6, (290, 490), 0.4, 24)])
def test_a_pulse_is_found_between_its_edges(sigma_w, edges, size, reach):
    # edges are known to a few samples: no pulse of a grid has both; on a walk either
    # shows as a step, in white noise a step is not known so well
    rng = np.random.default_rng(3)
    y = hostile.record(rng, sigma_v=0.5, sigma_w=sigma_w)
    y[slice(*edges)] += size
    model = hostile.simulator()
    scene, theta = Scene(y, 1.0, {}), np.array([[sigma_w, 0.5]])
    solved = backward.solve(member(scene, model[0]), scene, (), theta)
    family = signatures.Family(CATALOGUE["pulse"], "")
    *_, found = scans.SCANS["pulse"](scene, family, solved)    # between edges
    best = found.gain.argmax()
    ((onset, n),), _ = found.of(np.array([best]))
    onset, n = int(onset), int(n)
    assert_allclose((onset, onset + n), edges, atol=0.75 * reach)
    # B of the pulse stands for its mean over the cell of the grid that it lies in
    step, apart = n // onsets.PARTS, n * np.log(onsets.DURATION_STEP)
    shifts = range(-reach, reach + 1)
    near = [(onset + i, n + j - i) for i in shifts for j in shifts]
    gain = scans.scores_at(scene, family._replace(variant="rectangular"), solved,
                           near).gain[0]
    mean = np.exp(0.5 * (gain - gain.max())).sum() / (step * apart)
    assert_allclose(0.5 * (found.gain[best] - gain.max()), np.log(mean), atol=0.7)


@pytest.mark.parametrize("name, shape, size, spans", [
    ("pulse", lambda s: np.exp(-3.0 * s) * (s >= 0.0), 3.0, ((6, 1.0), (60, 3.0))),
    ("pulse", lambda s: np.exp(-3.0 * s) * (s >= 0.0), 1.2, ((40, 1.0), (200, 5.0))),
    ("pulse", lambda s: np.sin(np.pi * s) * (abs(s - 0.5) < 0.5), 1.5, (
        (40, 2.0), (60, 3.0)))])
def test_what_is_known_of_a_pulse_is_its_posterior(name, shape, size, spans):
    """In white noise of known variance, over a dense grid: of a decay an onset may be
    known a hundred times as well as a duration.
    """
    onset, duration, t = 612.0, 150.0, np.arange(1500.0)
    y = np.random.default_rng(8).standard_normal(1500) + size * shape(
        (t - onset) / duration)
    h = sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=10.0)
    scene = Scene(y, 1.0, {})
    (family,) = signatures.families(scene, [CATALOGUE[name]])
    base = account(scene, [member(scene, h)])
    samples = directed.directed(scene, base, [family])
    _, found = directed.estimate_signature(scene, base, family, samples, 1)
    (wide, step), (longer, by) = spans
    psi = np.array([(a, b) for a in np.arange(-wide, wide + step, step)
                    for b in np.arange(-longer, 2 * longer, by) if duration + b > 20])
    columns = np.array([shape((t - onset - a) / (duration + b)) for a, b in psi])
    columns -= columns.mean(1, keepdims=True)
    gain = (columns @ y)**2 / (columns**2).sum(1)
    mass = np.exp(0.5 * (gain - gain.max()))
    mean, cov = evidence.moments(mass / mass.sum(), psi)
    sd = np.sqrt(np.diag(cov))
    for symbol, truth, off, wide in zip(("onset", "duration"), (onset, duration), mean,
                                        sd):
        assert abs(found.values[symbol][0] - truth - off) < 0.4 * wide + 0.6, symbol
        assert abs(found.values[symbol][1] - wide) < 0.3 * wide + 0.3, symbol


@pytest.mark.parametrize("off", [0.0, 1e-12, -1e-12])
def test_waves_at_the_end_of_their_range_have_a_grid(off):
    scene = Scene(np.random.default_rng(4).standard_normal(200), 1.0, {})
    h = sensorid.hypothesis("white_noise", sigma_v=1.0)
    solved = backward.solve(member(scene, h), scene, (), np.array([[1.0]]))
    longest = CATALOGUE["ringing"].parameters(scene)[1].high
    family = signatures.Family(CATALOGUE["ringing"], "")
    family, *_ = scans._resolved_waves(scene, family, solved, scans._wave_grid(
        scene, family, 50.0, longest * (1.0 + off), 0.5))
    assert len(family.psi) > 1


def test_bayes_factor_of_a_size_is_the_integral_over_it():
    z, k = 3.0, np.arange(1, len(signatures.SIZES) + 1)
    by_hand = np.average([quadrature.quad(
        lambda a: a * a / v * norm.pdf(a, scale=v**0.5) * np.exp(a * z - 0.5 * a * a),
        -40.0, 40.0, points=[0.0, z])[0] for v in signatures.SIZES],
        weights=1.0 / (k * (k + 1.0)))
    gain = np.array([[z * z]])
    result = signatures.mean_bayes(gain, signatures.bayes_table()[1])
    assert_allclose(result, np.log(by_hand), rtol=1e-3)


def test_a_gain_less_than_nothing_by_rounding_is_nothing():
    table = signatures.bayes_table()[1]
    none = signatures.mean_bayes(np.array([[0.0, 9.0]]), table)
    for gain in (-1e-15, -1e-3, np.nan):
        assert signatures.mean_bayes(np.array([[gain, 9.0]]), table) == none


def test_moments_of_a_size_are_integrals_over_its_posterior():
    h = sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=0.0)
    scene = Scene(np.random.default_rng(5).standard_normal(400), DT, {})
    scene = scene._replace(y=scene.y + 7e-4 * scene.time)
    h = member(scene, h)
    ramps = signatures.families(scene, [CATALOGUE["rate_ramp"]])
    base = account(scene, [h])
    samples = directed.directed(scene, base, ramps)
    _, found = directed.estimate_signature(scene, base, ramps[0], samples, 1)
    information = scene.time @ scene.time
    z = scene.time @ scene.y / np.sqrt(information)
    k = np.arange(1, len(signatures.SIZES) + 1)

    def moment(power):    # of the size in standard errors
        return np.average([quadrature.quad(
            lambda a: a**power * a * a / v * norm.pdf(a, scale=v**0.5)
            * np.exp(a * z - 0.5 * a * a), -40.0, 40.0, points=[0.0, z])[0]
            for v in signatures.SIZES], weights=1.0 / (k * (k + 1.0)))
    mean = moment(1) / moment(0)
    sd = np.sqrt(moment(2) / moment(0) - mean**2)
    assert_allclose(np.array(found.values["slope"]) * np.sqrt(information), [mean, sd],
                    rtol=1e-6)


@pytest.mark.parametrize("samples, smooth", [(5, 1), (900, 1), (4096, 30), (9**5, 300)])
def test_peaks_that_stand_out_are_found_among_the_best_of_every_part(samples, smooth):
    noise = np.random.default_rng(samples).standard_normal(samples)
    gain = 9.0 * np.convolve(noise, np.ones(smooth) / smooth, "same")
    peaks, how = find_peaks(gain, prominence=1.0)
    most = peaks[np.argsort(-how["prominences"])[:onsets.EDGES]]
    assert_array_equal(onsets._most_prominent(gain), np.sort(most))
    # on two slopes, where each peak is held against all that lies below it
    gain = 9.0 * noise - 1e-4 * (np.arange(samples) - 0.3 * samples)**2
    found = onsets._most_prominent(gain)
    assert gain.argmax() in found or samples < 9


def test_a_signature_of_which_nothing_is_seen_gains_nothing():
    found = signatures.least_squares(np.zeros(3), np.zeros((1, 3, 2)),
                                     np.zeros((1, 3, 2, 2)))
    assert_allclose(found.gain, 0.0)
    assert (found.sd > 1e100).all() and np.isfinite(found.size).all()


@pytest.mark.parametrize("nodes", [1, 3])
def test_waves_are_scored_alike_by_the_part_of_a_record_where_they_are(nodes,
                                                                      monkeypatch):
    N, dt = 60_000, 0.01
    rng = np.random.default_rng(6)
    y = rng.standard_normal(N) + 0.003 * np.cumsum(rng.standard_normal(N))
    y[30_100:30_120] = np.nan
    scene = Scene(y, dt, {})
    h = member(scene, sensorid.hypothesis("markov", tau_m=50.0, sigma_m=0.7,
                                          sigma_v=(0.5, 1.5)))
    theta = np.column_stack([np.full(nodes, 50.0), np.full(nodes, 0.7),
                             np.linspace(1.0, 1.1, nodes)])
    solved = backward.solve(h, scene, (), theta)
    family = signatures.Family(CATALOGUE["ringing"], "")
    psi = [(300.03, 0.4, 7.0), (301.0, 0.5, 7.3), (300.9, 0.3, 20.0)]
    parts = []
    monkeypatch.setattr(signatures, "_scores_within", lambda *where, own=(
        signatures._scores_within): parts.append(where[-2:]) or own(*where))
    near = signatures.scores_at(scene, family, solved, psi)
    monkeypatch.setattr(signatures, "MEMORY", N)
    whole = signatures.scores_at(scene, family, solved._replace(memory=N), psi)
    (first, last), of_whole = parts
    assert 0 < first < 30_000 and last - first < N / 2 and of_whole == (0, N)
    assert_allclose(near.psi, whole.psi)
    for part, other in zip(near[1:4], whole[1:4]):
        assert_allclose(part, other, rtol=1e-9)


def test_what_a_filter_remembers_lasts_over_samples_that_are_missing():
    N = 100_000
    h = sensorid.hypothesis("random_walk", sigma_w=0.05, sigma_v=1.0)

    def memory(missing):
        y = np.zeros(N)
        y[missing] = np.nan
        scene = Scene(y, 1.0, {})
        return backward.solve(member(scene, h), scene, (), np.array([[0.05, 1.0]])
                              ).memory
    whole = memory(slice(0))
    # of a walk, by 1 - gain a sample: twice as many as take it to 1e-8, about
    assert 0.8 < whole / (2.0 * np.log(1e-8) / np.log(1.0 - 0.05)) < 1.1
    assert memory(slice(30_000, 31_000)) == pytest.approx(whole + 1000, rel=0.02)
    assert memory(slice(0, None, 2)) == pytest.approx(2 * whole, rel=0.02)
    assert memory(slice(0, 40_000)) == backward.MEMORY


def test_waves_that_are_apart_are_scored_each_by_its_own_part(monkeypatch):
    N = 100_000
    y = np.random.default_rng(8).standard_normal(N)
    scene = Scene(y, 1.0, {})
    h = member(scene, sensorid.hypothesis("random_walk", sigma_w=0.05, sigma_v=1.0))
    solved = backward.solve(h, scene, (), np.array([[0.05, 1.0]]))
    assert solved.memory < signatures.MEMORY
    family = signatures.Family(CATALOGUE["vibration_burst"], "")
    psi = [(90_000.5, 40.0, 0.2), (50.0, 70_000.0, 0.1), (500.0, 60_000.0, 0.01),
           (1000.0, 300.0, 0.1), (1000.0, 300.0, 0.1)]
    parts = []
    monkeypatch.setattr(signatures, "_scores_within", lambda *where, own=(
        signatures._scores_within): parts.append(where[-3:]) or own(*where))
    apart = signatures.scores_at(scene, family, solved, psi)
    assert [(len(some), (first, last) == (0, N)) for some, first, last in parts] == [
        (1, False), (2, True), (1, False), (1, False)]
    monkeypatch.setattr(signatures, "MEMORY", N)
    whole = signatures.scores_at(scene, family, solved._replace(memory=N), psi)
    assert_array_equal(apart.psi, psi)
    for one, other in zip(apart[1:4], whole[1:4]):
        assert_allclose(one, other, rtol=1e-9)


@pytest.mark.parametrize("amplitude", [10.0, large(1.0), large(1000.0)])
def test_a_sinusoid_is_known_as_well_as_its_bound_says(amplitude):
    """By Cramer and Rao: 24 / (A^2 N^3) is the variance of the angular frequency, s = 1
    (D. Rife, R. Boorstyn, IEEE Trans. Inf. Theory 20, 1974).
    """
    N, frequency = 3000, 0.061234567
    y = np.random.default_rng(3).standard_normal(N) + amplitude * np.cos(
        2.0 * np.pi * frequency * np.arange(N) + 0.7)
    h = sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=5.0)
    d = sensorlab.diagnose(y, 1.0, [h])
    assert d.verdict == "sinusoid"
    mean, sd = d.found[0].values["frequency"]
    bound = np.sqrt(24.0 / N**3) / amplitude / (2.0 * np.pi)
    assert_allclose(sd, bound, rtol=0.1)
    assert abs(mean - frequency) < 4.0 * bound


@pytest.mark.parametrize("below", [0.0, 0.6])    # half the rate, cycles in the record
def test_a_line_at_half_the_sampling_rate_is_one(below):
    """There a sine is 0 at every sample, and the line is its own alias."""
    t = np.arange(3000)
    y = np.random.default_rng(5).standard_normal(3000) + 0.25 * np.cos(
        2.0 * np.pi * (0.5 - below / 3000) * t + 0.3)
    d = sensorlab.diagnose(y, 1.0, WHITE_OF_A_RANGE)
    assert d.verdict == "sinusoid" and d.after.p_value > 0.01
    frequency, amplitude = d.found[0].values.values()
    assert abs(frequency[0] - 0.5) < 2.0 / 3000
    assert abs(amplitude[0] - 0.25) < 3.0 * amplitude[1] < 0.15


def test_a_line_at_half_the_sampling_rate_is_drawn_with_a_sign():
    line = Found(CATALOGUE["sinusoid"], values={
        **fixed(frequency=0.5, amplitude=0.25), "phase": ANY_PHASE})
    drawn = sensorlab.simulate_effects(sensorlab.Simulator(
        WHITE_OF_A_RANGE, ((line,),)), Scene(np.zeros(3000), 1.0, {}), 20, seed=1).error
    size = drawn @ (-1.0)**np.arange(3000) / 3000
    assert_allclose(np.abs(size), 0.25, atol=5.0 * 2.0 / np.sqrt(3000))
    assert size.min() < 0.0 < size.max()


@pytest.mark.large
def test_a_lag_that_is_known_well_leaves_no_temperature_beside_it():
    """It has two forms, and is far shorter than the record."""
    N, tau = 2000, 12.0
    t = np.arange(N)
    temperature = 20.0 + 5.0 * np.sin(0.025 * t) + 1.7 * np.sin(0.075 * t + 1.0)
    y = np.random.default_rng(1).standard_normal(N) + 1.5 * lagged(
        temperature, 1.0, tau)
    h = sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=50.0)
    d = sensorlab.diagnose(y, 1.0, [h], dict(temperature=temperature))
    assert d.verdict == "thermal_lag"
    mean, sd = d.found[0].values["tau"]
    assert abs(mean - tau) < 3.0 * sd and sd < 0.3


@pytest.mark.parametrize("vertex", [0.05, 0.5, large(0.9)])
def test_a_parabola_needs_no_ramp_beside_it(vertex):
    N = 1000
    t = np.arange(N) / N
    y = np.random.default_rng(4).standard_normal(N) + 100.0 * (t - vertex)**2
    h = sensorid.hypothesis("white_noise", sigma_v=1.0, bias_sigma=200.0)
    d = sensorlab.diagnose(y, 1.0, [h])
    assert d.verdict == "second_order_drift"
    slopes, cov = np.polyfit(t, y, 2, cov="unscaled")
    at = -0.5 * slopes[1] / slopes[0]
    slope = np.array([0.5 * slopes[1] / slopes[0]**2, -0.5 / slopes[0], 0.0])
    mean, sd = d.found[0].values["vertex"]
    assert_allclose(sd / N, np.sqrt(slope @ cov @ slope), rtol=0.15)
    assert_allclose(mean / N, at, atol=0.3 * sd / N)


def test_one_hypothesis_begins_where_another_has_been_resolved(monkeypatch):
    scores_at, tried = signatures.scores_at, []

    def counted(scene, family, solved):
        tried.append(len(family.psi))
        return scores_at(scene, family, solved)
    monkeypatch.setattr(signatures, "scores_at", counted)
    N, onset, duration = 600, 200.0, 60.0
    rng = np.random.default_rng(8)
    scene = Scene(rng.standard_normal(N), 1.0, {})
    ((_, columns),) = CATALOGUE["ringing"].columns(scene, None, (onset, duration, 0.1))
    scene = scene._replace(y=scene.y + 3.0 * columns[:, 0])
    h = sensorid.hypothesis("white_noise", sigma_v=1.0)
    one = backward.solve(member(scene, h), scene, (), np.array([[1.0]]))
    family = signatures.Family(CATALOGUE["ringing"], "")
    anew, grid = scans.refined(scene, family, one)
    assert len(tried) < signatures.MOST_GRIDS    # to one side of an edge it settles
    tried.clear()
    again, same = scans.refined(scene, family, one, grid)
    assert len(tried) == 1
    assert_allclose(again.psi, anew.psi)
    moved, _ = scans.refined(scene, family, one, grid._replace(
        middle=grid.middle + grid.apart, apart=2.0 * grid.apart))
    at = np.array(moved.psi) @ [[1, 1, 0], [0, 1, 0], [0, 0, 1]]    # onset, end, ...
    for axis in range(3):    # it finds the way, and resolves as much
        own = np.unique(at[:, axis])
        assert own[0] < grid.middle[axis] < own[-1]
