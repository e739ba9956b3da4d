"""What goes out: other programs, by their own formulas, draw or foretell the noise of
our model from the numbers that they are given.
"""

import json
import pathlib
import re
import xml.etree.ElementTree
from collections import Counter

import numpy as np
import pytest
import programs
import yaml
from scipy.signal import fftconvolve
from test_foreign import SAMPLES, TRIALS, agree

import sensorid
import sensorlab
from sensorlab.commands import main, options
from sensorlab.exports import TARGETS
from sensorlab.exports.axis import axis
from sensorlab.exports.bound import averaging_times, pair_variances, pairs
from sensorlab.exports.text import Choice
from sensorlab.units import QUOTES

DEG, DT = np.pi / 180.0, 0.02
WALK = dict(name="random_walk", parameters=dict(sigma_w=8.0, sigma_v=20.0))
MARKOV = dict(name="markov", parameters=dict(tau_m=0.4, sigma_m=30.0, sigma_v=20.0))
BOTH = dict(name="random_walk_markov", parameters=dict(
    sigma_w=8.0, tau_m=0.1, sigma_m=30.0, sigma_v=20.0))
TWO = dict(name="two_markov", parameters=dict(
    tau_m=0.1, sigma_m=10.0, tau_n=0.5, sigma_n=20.0, sigma_v=5.0))
FLICKER = dict(name="white_noise", parameters=dict(sigma_v=20.0), effects=[
    dict(name="bias_instability", parameters=dict(sigma=10.0))])


def model_of(tmp_path, hypothesis, bias=0.0, unit="deg/s", dt=DT):
    file = tmp_path / f"{len(list(tmp_path.iterdir()))}.json"
    file.write_text(json.dumps(dict(dt=dt, unit=unit, bias_sigma=bias,
                                    hypotheses=[hypothesis])))
    return file


@pytest.fixture
def sensor(tmp_path):
    def build(hypothesis, **options):
        return axis(sensorlab.read_model(model_of(tmp_path, hypothesis, **options)),
                    duration=60.0)
    return build


@pytest.fixture
def rng():
    return np.random.default_rng(23)


def numbers(text):
    """Name and number of every line of YAML."""
    return {k: float(v) for k, v in yaml.safe_load(text).items() if k != "rostopic"}


# ---- simulators: the records have the moments of the model

@pytest.mark.parametrize("target", ["kalibr", "openvins"])
def test_kalibr_draws_a_walk_in_white_noise(sensor, rng, target):
    a = sensor(WALK, bias=30.0)
    text = TARGETS[target]([a]).text.removeprefix("%YAML:1.0\n")
    values = yaml.safe_load(text)
    values = values.get("imu0", values)
    assert values["update_rate"] == 50
    agree(programs.kalibr(rng, TRIALS, SAMPLES, DT, values["gyroscope_noise_density"],
                          values["gyroscope_random_walk"], a.bias), a.filt, a.bias)


@pytest.mark.parametrize("hypothesis, bias", [(WALK, 30.0), (MARKOV, 0.0),
                                              (FLICKER | dict(effects=[]), 10.0)])
def test_gazebo_draws_the_model(sensor, rng, hypothesis, bias):
    a = sensor(hypothesis, bias=bias)
    text = TARGETS["gazebo"]([a]).text
    block = xml.etree.ElementTree.fromstring(f"<sdf>{text}</sdf>").find(
        "sensor/imu/angular_velocity/y/noise")
    values = {child.tag: float(child.text) for child in block}
    agree(programs.gazebo(rng, TRIALS, SAMPLES, DT, **values), a.filt, a.bias)


@pytest.mark.parametrize("hypothesis", [WALK, MARKOV, BOTH])
def test_matlab_draws_the_model(sensor, rng, hypothesis):
    a = sensor(hypothesis)
    text = TARGETS["matlab"]([a]).text
    values = {k: float(v) for k, v in re.findall(r"'(\w+)', ([\d.e+-]+)", text)
              if k not in ("SampleRate", "Numerator")}
    pole = re.search(r"\[1 (-[\d.]+)\]", text)
    records = programs.matlab(
        rng, TRIALS, 1000 + SAMPLES, DT, NoiseType="single-sided",
        **({"Denominator": (1.0, float(pole[1]))} if pole else {}), **values)[:, 1000:]
    m = np.array([1, 4, 16, 64])    # from 0 the process reaches its steady state
    avar = np.array([sensorid.allan_variance(records[:, :2 * k], 1.0, k) for k in m])
    z = (avar.mean(1) - a.allan_variance(m)) / avar.std(1) * np.sqrt(TRIALS)
    assert np.abs(z).max() < 4.5, z


@pytest.mark.parametrize("hypothesis", [WALK, MARKOV, BOTH, FLICKER])
def test_numpy_draws_every_model(sensor, rng, hypothesis):
    a = sensor(hypothesis, bias=30.0)
    space = {}
    exec(TARGETS["numpy"]([a]).text, space)
    agree(space["gyroscope"](SAMPLES, TRIALS, rng), a.filt, a.bias)


def test_numpy_draws_jumps_and_readings(sensor, rng):
    effects = [dict(name="outliers", parameters=dict(rate=0.05, sigma=200.0)),
               dict(name="random_telegraph", parameters=dict(dwell=0.2, size=100.0)),
               dict(name="saturation", parameters=dict(limits=[None, 150.0])),
               dict(name="quantization", parameters=dict(lsb=10.0))]
    a = sensor(WALK | dict(effects=effects))
    space = {}
    exec(TARGETS["numpy"]([a]).text, space)
    y = space["gyroscope"](SAMPLES, TRIALS, rng) / DEG
    assert y.max() == 150.0 and y.min() < -300.0
    np.testing.assert_allclose(y / 10.0, np.round(y / 10.0), atol=1e-9)
    space = {}
    a = a._replace(limits=(-np.inf, np.inf))
    exec(TARGETS["numpy"]([a]).text, space)
    agree(space["gyroscope"](SAMPLES, TRIALS, rng), a.second_order, 0.0)


@pytest.mark.parametrize("name, values, said", [
    ("noise_bursts", dict(quiet=0.3, duration=0.1, sigma=300.0), "bursts of noise of"),
    ("random_steps", dict(dwell=0.5, sigma=30.0), "the steps of")])
def test_numpy_draws_bursts_and_steps(sensor, rng, name, values, said):
    a = sensor(WALK | dict(effects=[dict(name=name, parameters=values)]))
    space = {}
    exec(TARGETS["numpy"]([a]).text, space)
    agree(space["gyroscope"](SAMPLES, TRIALS, rng), a.second_order, 0.0)
    assert f"{said} the gyroscope" in TARGETS["kalibr"]([a]).text


def test_isaac_lab_draws_the_noise_and_a_bias_as_large_as_the_drift(sensor, rng):
    a = sensor(WALK, bias=30.0)
    horizon = SAMPLES * DT
    std, bias = (float(v) for v in re.findall(
        r"std=([\d.e-]+)", TARGETS["isaac"]([a], Choice(horizon=horizon)).text))
    ours = a.bias**2 + a.filt.Gamma[0, 0, 0]**2 * np.arange(1, SAMPLES + 1)
    theirs = programs.isaac(rng, TRIALS, SAMPLES, std, bias)
    white = a.filt.Psi[0]**2
    assert np.mean(theirs**2) == pytest.approx(np.mean(ours) + white, rel=0.1)
    assert np.mean(np.diff(theirs)**2) / 2.0 == pytest.approx(white, rel=0.01)


# ---- filters: what they foretell is the error of the model

HORIZON = 20.0


def integrated(a, horizon=HORIZON):
    """Variance of the integral of a walk in white noise, its bias known at the start,
    in continuous time.
    """
    N2, K2 = a.filt.Psi[0]**2 * a.dt, a.filt.Gamma[0, 0, 0]**2 / a.dt
    return N2 * horizon + K2 * horizon**3 / 3.0


@pytest.mark.parametrize("target", ["gtsam", "vins", "px4"])
def test_filters_foretell_the_error_of_a_walk_in_white_noise(sensor, target):
    a = sensor(WALK | dict(parameters=dict(sigma_w=1e-3, sigma_v=0.3)), dt=0.004)
    text = TARGETS[target]([a], Choice(horizon=HORIZON)).text
    if target == "gtsam":
        covariances = [float(v) for v in re.findall(r"\(([\d.e-]+) \* np.eye", text)]
        found = programs.gtsam(HORIZON, 0.004, *covariances)
    elif target == "vins":
        values = numbers(text)
        found = programs.vins(HORIZON, 0.004, values["gyr_n"], values["gyr_w"])
    else:
        values = dict(re.findall(r"(EKF2\w+)\t([\d.]+)", text))
        found = programs.px4(HORIZON, float(values["EKF2_GYR_NOISE"]),
                             float(values["EKF2_GYR_B_NOISE"]))
    # sums for integrals: off by some 1.5 steps in 2000 and more
    assert found == pytest.approx(integrated(a), rel=2e-3)


def test_a_density_in_vins_is_too_small_by_the_root_of_twice_the_rate(sensor):
    a = sensor(WALK, dt=0.005)
    said = re.search(r"too\s+#?\s*small\s+#?\s*by\s+#?\s*([\d.]+)",
                     TARGETS["vins"]([a]).text)
    assert float(said[1]) == 20.0


@pytest.mark.parametrize("hypothesis", [WALK, MARKOV, FLICKER])
def test_the_variance_for_ros_bounds_the_integrated_error(sensor, hypothesis):
    a = sensor(hypothesis)
    text = TARGETS["ros"]([a], Choice(horizon=2.0)).text
    covariance = yaml.safe_load(text)["angular_velocity_covariance"]
    assert covariance[0] == covariance[4] == covariance[8] and covariance[1] == 0.0
    m = averaging_times(a, 2.0)
    ratio = covariance[0] / m / a.allan_variance(m)
    assert ratio.min() == pytest.approx(1.0, rel=1e-5)


# ---- the honest factor

@pytest.mark.parametrize("hypothesis", [MARKOV, BOTH, TWO, FLICKER])
@pytest.mark.parametrize("horizon", [0.5, 5.0, 20.0])
def test_the_bound_is_nowhere_exceeded_and_the_smallest(sensor, hypothesis, horizon):
    a = sensor(hypothesis)
    bound = pairs(a, horizon)["bound"]
    m = np.arange(1, round(horizon / DT) + 1)    # all, not only those of the programme
    parts, model = np.array(pair_variances(DT, m)), a.allan_variance(m)

    def ratio(density, walk):
        return (parts.T @ np.square([density, walk]) / model).min()
    assert 0.9995 < ratio(*bound) < 1.0001
    assert ratio(0.98 * bound.density, bound.walk) < 0.999
    assert bound.walk == 0.0 or ratio(bound.density, 0.98 * bound.walk) < 0.9999


def true_over_foretold(a, pair, m):
    """Of the error of m integrated samples, less what a Kalman filter of the bias with
    this pair, in steady state, says: standard deviation over the one that it foretells.
    """
    r, q = pair.density**2 / DT, pair.walk**2 * DT
    before = (q + np.sqrt(q * q + 4.0 * q * r)) / 2.0
    gain = before / (before + r)
    past = gain * (1.0 - gain)**np.arange(int(20.0 / gain))
    weight = np.append(-m * DT * past[::-1], np.full(m, DT))    # of every sample
    lag = np.arange(len(weight))
    product = fftconvolve(weight, weight[::-1])[len(weight) - 1:]
    product[1:] *= 2.0
    white, processes = a.parts
    variance = white**2 * product[0]
    for p in processes:
        if p.a == 1.0:
            variance += p.drive**2 * np.sum(np.cumsum(weight[::-1])**2)
        else:
            variance += p.drive**2 / (1.0 - p.a**2) * np.sum(p.a**lag * product)
    foretold = ((m * DT)**2 * before * (1.0 - gain) + m * DT**2 * r
                + q * DT**2 * np.sum(np.arange(1.0, m + 1.0)**2))
    return np.sqrt(variance / foretold)


@pytest.mark.parametrize("hypothesis", [WALK, MARKOV, BOTH, TWO, FLICKER])
@pytest.mark.parametrize("horizon", [2.0, 20.0])
def test_a_filter_with_the_bound_foretells_no_less_than_its_error(sensor, hypothesis,
                                                                  horizon):
    a = sensor(hypothesis)
    bound = pairs(a, horizon)["bound"]
    ratio = [true_over_foretold(a, bound, round(part * horizon / DT))
             for part in (0.01, 0.03, 0.1, 0.3, 1.0)]
    assert 0.9 < max(ratio) < 1.001, ratio


def test_a_walk_in_white_noise_is_its_own_bound(sensor):
    a = sensor(WALK)
    found = pairs(a, 20.0)
    exact = a.filt.Psi[0] * np.sqrt(DT), a.filt.Gamma[0, 0, 0] / np.sqrt(DT)
    np.testing.assert_allclose(found["bound"], exact, rtol=1e-6)
    np.testing.assert_allclose(found["fitted"], exact, rtol=1e-6)
    np.testing.assert_allclose(found["x10"], 10.0 * np.array(exact), rtol=1e-6)


def test_the_bound_is_of_the_error_of_integrated_records(sensor, rng):
    """e(h) of the docstring of `bound`, by drawing."""
    a = sensor(TWO)
    space = {}
    exec(TARGETS["numpy"]([a]).text, space)
    records = space["gyroscope"](100, 20000, rng)
    for m in (1, 10, 50):
        before, after = records[:, :m], records[:, m:2 * m]
        error = DT * (after.sum(1) - m * before.mean(1))
        expected = 2.0 * (m * DT)**2 * a.allan_variance(m)
        assert np.mean(error**2) == pytest.approx(expected, rel=5 * np.sqrt(2 / 20000))


def test_where_no_walk_is_needed_a_negligible_one_is_written(sensor):
    a = sensor(FLICKER | dict(effects=[]))
    assert pairs(a, 60.0)["bound"].walk < 1e-6 * a.filt.Psi[0]
    values = numbers(TARGETS["kalibr"]([a]).text)
    N, K = values["gyroscope_noise_density"], values["gyroscope_random_walk"]
    assert 0.0 < K**2 * 60.0**3 / 3.0 < 2e-6 * N**2 * 60.0


# ---- what the files say

def test_every_file_says_its_convention_and_what_is_lost(sensor):
    effects = [dict(name="rate_ramp", parameters=dict(slope=1.0)),
               dict(name="walk_step", parameters=dict(onset=9.0, ratio=3.0)),
               dict(name="outliers", parameters=dict(rate=0.01, sigma=100.0)),
               dict(name="random_telegraph", parameters=dict(dwell=0.2, size=10.0)),
               dict(name="saturation", parameters=dict(limits=[-300.0, 400.0])),
               dict(name="quantization", parameters=dict(lsb=1.0))]
    a = sensor(BOTH | dict(effects=effects), bias=3.0)
    even = sensor(BOTH | dict(effects=effects[:1] + effects[2:]), bias=3.0)
    np.testing.assert_allclose(a.filt.Gamma[0, :2], 3.0 * even.filt.Gamma[0, :2])
    for name, target in TARGETS.items():
        text, lost = target([a])
        assert "Convention: " in text and "rate_ramp is left out" in text, name
        assert "walk_step: where it is loudest" in text
        assert any("limits" in one for one in lost) != (name == "numpy"), name
        assert text.count("Lost: ") == len(lost), name


def test_counts_of_the_integral_are_no_noise_of_a_sample(sensor):
    counts = [dict(name="integral_quantization", parameters=dict(lsb=50.0))]
    a, plain = sensor(WALK | dict(effects=counts)), sensor(WALK)
    assert a.lsb == 0.0
    np.testing.assert_array_equal(a.second_order.Psi, plain.second_order.Psi)
    for name, target in TARGETS.items():
        assert "integral_quantization is left out" in " ".join(target([a])[1]), name


def test_simulators_of_one_process_get_the_bound_for_several(sensor):
    a = sensor(TWO)
    bound = pairs(a, 60.0)["bound"]
    gazebo, matlab = (TARGETS[name]([a]).text for name in ("gazebo", "matlab"))
    assert "<- written" in gazebo and "<- written" in matlab
    for text, key, value in [(gazebo, "stddev>", bound.density / np.sqrt(DT)),
                             (gazebo, "dynamic_bias_stddev>", bound.walk),
                             (matlab, "'NoiseDensity', ", bound.density),
                             (matlab, "'RandomWalk', ", bound.walk)]:
        written = float(re.search(rf"[<\s]{key}([\d.e-]+)", text)[1])
        assert written == pytest.approx(value, rel=1e-6)
    assert "BiasInstability" not in matlab


def test_gyroscope_and_accelerometer_share_a_file(sensor):
    both = [sensor(WALK), sensor(WALK, unit="mg")]
    for name, target in TARGETS.items():
        text = target(both).text
        assert all(re.search(f"{one}", text, re.I) for one in ("gyr|angular", "acc")), (
            name)
    values = numbers(TARGETS["kalibr"](both).text)
    assert values["accelerometer_noise_density"] == pytest.approx(
        0.02 * 9.80665 * np.sqrt(DT), rel=1e-6)


def test_fast_processes_are_noise_and_no_bias(sensor, rng):
    both = dict(name="two_markov", parameters=dict(
        tau_m=0.04, sigma_m=30.0, tau_n=500.0, sigma_n=10.0, sigma_v=20.0))
    a = sensor(both)
    std, bias = (float(v) for v in re.findall(
        r"std=([\d.e-]+)", TARGETS["isaac"]([a]).text))
    assert [std, bias] == pytest.approx([np.hypot(20.0, 30.0) * DEG, 10.0 * DEG])
    for name in ("kalibr", "matlab", "gtsam"):
        (begin,) = (one for one in TARGETS[name]([a]).lost if "at the start" in one)
        assert f"{10.0 * DEG:.4g} rad/s" in begin


def test_a_wide_bandwidth_is_white_noise(sensor):
    wide = dict(name="bandwidth", parameters=dict(tau=1e-4))
    white, processes = sensor(WALK | dict(effects=[wide])).parts
    assert white == pytest.approx(20.0 * DEG) and len(processes) == 1


@pytest.mark.parametrize("name, values", [
    ("outliers", dict(rate=0.01, sigma=300.0)),
    ("noise_bursts", dict(quiet=1.0, duration=0.5, sigma=50.0))])
def test_what_jumps_before_a_low_pass_is_white_noise_before_it(sensor, name, values):
    low_pass = dict(name="bandwidth", parameters=dict(tau=0.05), variant="digital")
    knocks = dict(name=name, parameters=values, variant="before the low-pass")
    white = dict(name="white_noise", parameters=dict(sigma_v=20.0))
    begin, end = -np.expm1([-DT / 1.0, -DT / 0.5])
    more = 30.0 if name == "outliers" else 50.0 * np.sqrt(begin / (begin + end))
    louder = dict(name="white_noise", parameters=dict(sigma_v=np.hypot(20.0, more)))
    own = sensor(white | dict(effects=[low_pass, knocks]))
    same = sensor(louder | dict(effects=[low_pass]))
    m = np.array([1, 3, 10])
    assert own.allan_variance(m) == pytest.approx(same.allan_variance(m))
    assert any(f"{name} before the low-pass" in one for one in TARGETS["numpy"](
        [own]).lost)


def test_the_command_lists_every_target():
    assert options.TARGETS == tuple(TARGETS)


def test_what_px4_does_not_take_is_told(sensor):
    lost = TARGETS["px4"]([sensor(WALK)]).lost
    assert any("is outside of what PX4 takes" in one for one in lost)


# ---- the command

def test_the_command_writes_or_prints_and_says_what_is_lost(tmp_path, capsys):
    file = model_of(tmp_path, MARKOV, bias=1.0)
    out = tmp_path / "imu.yaml"
    assert main(["export", str(file), "--to", "kalibr", "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert "imu.yaml: for kalibr" in printed.out and "lost in kalibr" in printed.err
    assert main(["export", str(file), "--to", "kalibr"]) == 0
    assert capsys.readouterr().out == out.read_text()
    assert "<- written" in out.read_text()
    found = []
    for pair in ("fitted", "x10"):
        assert main(["export", str(file), "--to", "kalibr", "--pair", pair]) == 0
        found.append(numbers(capsys.readouterr().out)["gyroscope_noise_density"])
    assert found[1] == pytest.approx(10.0 * found[0], rel=1e-5)
    # and what went out comes in again
    model = sensorlab.read_model(out)
    assert model.dt == DT and model.unit == "rad/s"


@pytest.mark.parametrize("more, message", [
    (["--unit", "rad/s"], "the model is in deg/s, not in rad/s"),
    (["--horizon", "0.001"], "shorter than the sampling interval"),
    (["--horizon", "nan"], "shorter than the sampling interval"),
    (["--horizon", "inf"], "holds more than 1000000 samples"),
    (["--duration", "1e-9"], "holds no two samples"),
    (["--out", "no/such/file"], "cannot be written")])
def test_bad_options_get_one_line(tmp_path, capsys, more, message):
    file = model_of(tmp_path, MARKOV)
    assert main(["export", str(file), "--to", "kalibr", *more]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


def test_models_that_do_not_go_together_are_told(tmp_path, capsys):
    gyro, other = (str(model_of(tmp_path, MARKOV, dt=dt)) for dt in (DT, 0.1))
    accel = str(model_of(tmp_path, MARKOV, unit="mg", dt=0.1))
    ramp = str(model_of(tmp_path, dict(name="rate_ramp", parameters=dict(
        slope=1.0, sigma_v=1.0))))
    nothing = str(model_of(tmp_path, MARKOV, unit="u"))
    two = tmp_path / "two.json"
    two.write_text(json.dumps(dict(dt=DT, unit="deg/s", hypotheses=[MARKOV, WALK])))
    for files, message in [([gyro, other], "two models of a gyroscope"),
                           ([gyro, accel], "one file has one rate"),
                           ([ramp], "only --to numpy has it"),
                           ([nothing], "give it with --unit"),
                           ([str(two)], "export takes one")]:
        assert main(["export", *files, "--to", "kalibr"]) == 2
        assert message in capsys.readouterr().err
    assert main(["export", ramp, "--to", "numpy"]) == 0


# ---- diagnosed: a record of the program, our model as the simulator

SLOW = dict(tau_m=10.0, sigma_m=10.0, sigma_v=20.0)


def verdicts(draw, hypothesis):
    """How often which verdict is given on 8 records, rad/s, of a program."""
    return Counter(sensorlab.diagnose(draw(np.random.default_rng(seed))[0] / DEG, DT,
                                      [hypothesis]).verdict for seed in range(8))


@pytest.mark.large
def test_records_of_kalibr_have_no_gap_to_the_model(sensor):
    steps = dict(sigma_w=0.5, sigma_v=20.0)
    values = numbers(TARGETS["kalibr"]([sensor(WALK | dict(parameters=steps))]).text)
    found = verdicts(lambda rng: programs.kalibr(
        rng, 1, 4000, DT, values["gyroscope_noise_density"],
        values["gyroscope_random_walk"]), sensorid.hypothesis("random_walk", **steps))
    assert found["none"] >= 7 and found["none"] + found["undecided"] == 8, found


@pytest.mark.thorough
def test_records_of_gazebo_have_no_gap_to_the_model_and_a_wrong_key_is_found(sensor):
    a = sensor(MARKOV | dict(parameters=SLOW))
    block = xml.etree.ElementTree.fromstring(
        f"<sdf>{TARGETS['gazebo']([a]).text}</sdf>").find(
        "sensor/imu/angular_velocity/x/noise")
    values = {child.tag: float(child.text) for child in block}
    process = sensorid.hypothesis("markov", **SLOW)
    found = verdicts(lambda rng: programs.gazebo(rng, 1, 4000, DT, **values), process)
    assert found["none"] >= 7 and found["none"] + found["undecided"] == 8, found
    values["stddev"] *= np.sqrt(DT)    # a density where a standard deviation belongs
    found = verdicts(lambda rng: programs.gazebo(rng, 1, 4000, DT, **values), process)
    assert found["wrong_parameter"] >= 7, found


@pytest.mark.thorough
def test_the_bound_of_one_run_holds_on_the_next(real):
    """Gyroscope x of the ADIS16405: a filter with the bound of run 1 on run 2."""
    def record(run):
        data = np.load(real / f"adis16405_run{run}.npz")
        return data["gyro_counts"][0] * float(data["gyro_lsb"])
    y = record(1)[:100000]
    e = sensorid.identify(y, 0.01, sensorid.default_hypotheses(
        y, 0.01, ["random_walk_markov"])).best
    h = e.hypothesis._replace(parameters=tuple(
        sensorid.Parameter(p.symbol, m, m) for p, m in zip(e.hypothesis.parameters,
                                                           e.mean)))
    a = axis(sensorlab.Model(0.01, "deg/s", sensorlab.Simulator((h,))))
    z = record(2) * DEG
    for seconds in (1, 10, 60):
        inside = programs.inside(z - z.mean(), 0.01, *pairs(a, 60.0)["bound"], seconds)
        by_chance = 4.0 * np.sqrt(0.95 * 0.05 / len(inside))
        assert 0.95 - by_chance < inside.mean() < 0.97 + by_chance    # 1 for folklore


# ---- the documentation

DOCS = (pathlib.Path(__file__).parent.parent / "docs" / "exports.md").read_text()


def test_the_table_of_the_documentation_is_what_is_written(sensor):
    a = sensor(dict(name="markov", parameters=dict(tau_m=100.0, sigma_m=0.004,
                                                   sigma_v=0.07)), dt=0.005)
    rows = re.findall(r"^\| `(\w+)` \| (.+?) \|", DOCS, re.M)
    rows = {name: told for name, told in rows if name in TARGETS}
    assert rows.keys() == TARGETS.keys()
    for name, told in rows.items():
        text = TARGETS[name]([a]).text
        written = [float(v) for v in re.findall(r"-?\d+\.?\d*(?:e[+-]\d+)?", text)]
        for number in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?(?=[,\s]|$)", told):
            if name != "numpy":
                assert np.isclose(written, float(number), rtol=1e-3).any(), (name, told)


def test_the_documentation_quotes_as_the_code_does():
    for q in QUOTES.values():
        assert all(part in DOCS for part in (*q.names, *q.units)), q
        assert q.formula in DOCS or q.formula == "sigma_n" or q.formula == "tau_n"
