"""Data sheets and other programs' files: a record that the program itself would draw
has the moments of the model that is read.
"""

import json
import sys

import numpy as np
import pytest
import programs

import sensorid
import sensorlab
from sensorlab.exports.axis import axis
from sensorlab.foreign import translated
from sensorlab.gap.draws import simulate_effects
from sensorlab.gap.effects import Scene

DEG, G = np.pi / 180.0, 9.80665
TRIALS, SAMPLES = 4000, 128
AT = 0, 1, 7, SAMPLES - 1    # samples whose products are compared


def covariance(filt, bias_sigma):
    """cov(y_i, y_j) of a shaping filter at AT, from the definition."""
    Phi, Q, H = filt.Phi[0], filt.Gamma[0] @ filt.Gamma[0].T, filt.H[0]
    P = [filt.P0]
    for _ in range(SAMPLES):
        P.append(Phi @ P[-1] @ Phi.T + Q)
    C = np.empty((len(AT), len(AT)))
    for i, a in enumerate(AT):
        for j, b in enumerate(AT):
            first, lag = min(a, b) + 1, abs(a - b)
            C[i, j] = H @ np.linalg.matrix_power(Phi, lag) @ P[first] @ H
    return C + bias_sigma**2 + filt.Psi[0]**2 * np.eye(len(AT))


def agree(records, filt, bias_sigma=0.0):
    """Products of samples, and Allan variances of the start, lie about a filter's."""
    y = records[:, AT]
    products = y[:, :, None] * y[:, None, :]
    error = products.mean(0) - covariance(filt, bias_sigma)
    z = [error / products.std(0) * np.sqrt(len(y))]
    m = np.array([1, 4, 16, 42])
    avar = np.array([sensorid.allan_variance(records[:, :2 * k], 1.0, k) for k in m])
    z.append((avar.mean(1) - sensorid.model_allan_variance(filt, m))
             / avar.std(1) * np.sqrt(len(y)))
    assert max(np.abs(part).max() for part in z) < 4.5, z


def read(tmp_path, name, text, part="", dt=None):
    (tmp_path / name).write_text(text if isinstance(text, str) else json.dumps(text))
    return sensorlab.read_model(f"{tmp_path / name}{'#' * bool(part)}{part}", dt)


def agrees_with(model, records):
    (h,) = model.simulator.hypotheses
    agree(records, h.filter(model.dt, [p.low for p in h.parameters]), h.bias_sigma)


@pytest.fixture
def rng():
    return np.random.default_rng(17)


KALIBR = """%YAML:1.0
imu0:
  gyroscope_noise_density: 0.02
  gyroscope_random_walk: 5e-2
  accelerometer_noise_density: 0.3
  accelerometer_random_walk: 0.2
  update_rate: 50.0
"""


def test_a_file_of_kalibr_draws_as_its_wiki_says(tmp_path, rng):
    model = read(tmp_path, "imu.yaml", KALIBR, "gyro")
    assert model.dt == 0.02 and model.unit == "rad/s"
    agrees_with(model, programs.kalibr(rng, TRIALS, SAMPLES, 0.02, 0.02, 0.05))
    model = read(tmp_path, "imu.yaml", KALIBR, "accel", dt=0.1)
    assert model.dt == 0.1 and model.unit == "m/s^2"
    agrees_with(model, programs.kalibr(rng, TRIALS, SAMPLES, 0.1, 0.3, 0.2))


NOISE = dict(mean=0.0, stddev=0.4, bias_mean=0.2, bias_stddev=0.3,
             dynamic_bias_stddev=1.1, dynamic_bias_correlation_time=0.9)


def sdf(values, kind="gaussian", rate="<update_rate>50</update_rate>"):
    block = "".join(f"<{k}>{v}</{k}>" for k, v in values.items())
    axes = "".join(f'<{i}><noise type="{kind}">{block}</noise></{i}>' for i in "xyz")
    return (f'<sdf version="1.6"><sensor name="imu" type="imu">{rate}<imu>'
            f"<angular_velocity>{axes}</angular_velocity></imu></sensor></sdf>")


@pytest.mark.parametrize("change", [
    {}, dict(dynamic_bias_stddev=0.0), dict(dynamic_bias_correlation_time=1e9),
    dict(bias_mean=0.0, bias_stddev=0.0)])
def test_a_file_of_gazebo_draws_as_its_source_does(tmp_path, rng, change):
    model = read(tmp_path, "m.sdf", sdf(NOISE | change))
    assert model.dt == 0.02
    agrees_with(model, programs.gazebo(rng, TRIALS, SAMPLES, 0.02, **(NOISE | change)))


def test_gazebo_rounds_to_its_precision(tmp_path):
    model = read(tmp_path, "m.sdf", sdf(NOISE | dict(precision=0.1),
                                        "gaussian_quantized"))
    scene = Scene(np.zeros(200), model.dt, {})
    y = simulate_effects(model.simulator, scene, seed=1).error[0]
    np.testing.assert_allclose(y / 0.1, np.round(y / 0.1), atol=1e-9)


MATLAB = dict(NoiseDensity=0.1, RandomWalk=0.3, BiasInstability=0.5)


@pytest.mark.parametrize("more", [{}, dict(NoiseType="single-sided"),
                                  dict(RandomWalk=0.0), dict(BiasInstability=0.0)])
def test_a_file_of_matlab_draws_as_its_class_does(tmp_path, rng, more):
    values = MATLAB | more
    model = read(tmp_path, "p.json", {"Part": {"Gyroscope": {
        k: [v] * 3 if isinstance(v, float) else v for k, v in values.items()}}},
        dt=0.02)
    records = programs.matlab(rng, TRIALS, 100 + SAMPLES, 0.02, **values)
    # its bias instability starts from 0, ours in steady state, which it reaches at once
    (h,) = model.simulator.hypotheses
    filt = h.filter(0.02, [p.low for p in h.parameters])
    m = np.array([1, 4, 16])
    avar = np.array([sensorid.allan_variance(records[:, 100:], 1.0, k) for k in m])
    z = (avar.mean(1) - sensorid.model_allan_variance(filt, m)) / avar.std(1)
    assert np.abs(z * np.sqrt(TRIALS)).max() < 4.5


def test_matlabs_default_is_root_two_less_than_a_density_of_ieee_952(tmp_path):
    model = read(tmp_path, "p.json", {"P": {"Gyroscope": dict(NoiseDensity=0.2)}},
                 dt=0.01)
    (h,) = model.simulator.hypotheses
    assert h.parameters[0].low == pytest.approx(0.2 / np.sqrt(2.0) / np.sqrt(0.01))


IMU = dict(SensorType=2, AngularRandomWalk=40.0, GyroBiasStability=9e4,
           GyroBiasStabilityTau=2.0)


@pytest.mark.parametrize("dt", [0.02, 0.0004])
def test_a_file_of_airsim_draws_as_its_source_does(tmp_path, rng, dt):
    model = read(tmp_path, "settings.json", {"Vehicles": {"D": {"Sensors": {
        "Imu": IMU}}}}, "gyroscope", dt)
    records = programs.airsim(rng, TRIALS, 1 + SAMPLES, dt, 40.0 * DEG / 60.0,
                              9e4 * DEG / 3600.0, 2.0)
    agrees_with(model, records[:, 1:])    # ours has its first step one sample earlier


def test_airsim_has_defaults(tmp_path):
    model = read(tmp_path, "s.json", {"Sensors": {"Imu": {"SensorType": 2}}}, "accel",
                 0.01)
    (h,) = model.simulator.hypotheses
    walk, white = (p.low for p in h.parameters)
    assert white == pytest.approx(0.24e-3 * G / 0.1)
    assert walk == pytest.approx(36e-6 * G / np.sqrt(800.0) * 0.1)


GNSS = dict(gyro_b=[0.0, 0.0, 0.0], gyro_arw=[40.0] * 3, gyro_b_stability=[2e4] * 3,
            gyro_b_corr=[0.5] * 3)


@pytest.mark.parametrize("corr", [0.5, None])
def test_a_dictionary_of_gnss_ins_sim_draws_as_its_source_does(tmp_path, rng, corr):
    values = {k: v for k, v in GNSS.items() if k != "gyro_b_corr"}
    if corr:
        values["gyro_b_corr"] = [corr] * 3
    model = read(tmp_path, "imu.json", values, dt=0.02)
    records = programs.gnss_ins_sim(rng, TRIALS, 1 + SAMPLES, 0.02, 0.0,
                                    2e4 * DEG / 3600.0, corr or np.inf,
                                    40.0 * DEG / 60.0)
    agrees_with(model, records[:, 1:])    # the first of its samples has no drift


ISAAC = """
sim: {dt: 0.005}
decimation: 4
observations:
  policy:
    base_ang_vel:
      noise:
        noise_cfg: {func: x, operation: add, mean: 0.0, std: 0.2}
        bias_noise_cfg: !!python/object:isaaclab.Cfg {operation: abs, std: 0.1}
    base_lin_acc: {noise: {n_min: -0.3, n_max: 0.3}}
"""


def test_a_file_of_isaac_lab_draws_as_its_source_does(tmp_path, rng):
    model = read(tmp_path, "env.yaml", ISAAC, "ang_vel")
    assert model.dt == 0.02 and model.unit == "rad/s"
    agrees_with(model, programs.isaac(rng, TRIALS, SAMPLES, 0.2, 0.1))
    model = read(tmp_path, "env.yaml", ISAAC, "lin_acc")
    assert model.unit == "m/s^2"
    assert model.simulator.hypotheses[0].parameters[0].low == pytest.approx(
        0.6 / np.sqrt(12.0))


# ---- data sheets

SHEET = {"datasheet": {"noise_density": "0.05 deg/s/sqrt(Hz)"}, "unit": "deg/s",
         "dt": 0.01}


def sheet(**more):
    return SHEET | dict(datasheet=SHEET["datasheet"] | more)


def test_a_data_sheet_is_a_simulator(tmp_path):
    model = read(tmp_path, "d.json", sheet(
        rate="100 Hz", bandwidth="330 Hz", resolution="0.05 deg/s", range="300 deg/s",
        bias_instability="25 deg/h", rate_random_walk="10 deg/h/sqrt(h)"))
    (h,), (effects,) = model.simulator.hypotheses, model.simulator.effects
    walk, white = (p.low for p in h.parameters)
    assert white == pytest.approx(0.05 * np.sqrt(50.0))
    assert walk == pytest.approx(10.0 / 3600.0 / 60.0 * 0.1)
    values = {one.name: one.values for one in effects}
    assert values["bandwidth"]["tau"].low == pytest.approx(1.0 / (2 * np.pi * 330.0))
    assert values["quantization"] == dict(lsb=0.05)
    assert values["saturation"] == dict(limits=[-300.0, 300.0])
    y = simulate_effects(model.simulator, Scene(np.zeros(20000), 0.01, {})).error[0]
    assert np.std(y) == pytest.approx(white, rel=0.03)
    np.testing.assert_allclose(y / 0.05, np.round(y / 0.05), atol=1e-6)


def test_the_angle_random_walk_of_a_data_sheet_is_two_sided(tmp_path):
    text = {"datasheet": {"random_walk": "0.3 deg/sqrt(h)", "bias": "0.1 deg/s",
                          "sampling_interval": "4 ms"}, "unit": "deg/h"}
    model = read(tmp_path, "d.json", text)
    (h,) = model.simulator.hypotheses
    assert model.dt == 0.004 and h.bias_sigma == pytest.approx(360.0)
    assert h.parameters[0].low == pytest.approx(0.3 * 60.0 / np.sqrt(0.004))


def test_the_bias_instability_of_a_data_sheet_is_the_floor_of_the_allan_deviation(
        tmp_path):
    model = read(tmp_path, "d.json", {"datasheet": {
        "noise_density": "1e-6 deg/s/sqrt(Hz)", "bias_instability": "0.01 deg/s",
        "rate": "10 Hz"}, "unit": "deg/s"})
    adev = np.sqrt(axis(model).allan_variance(np.array([10, 30, 100, 300, 1000]))) / DEG
    # as flat as a record of that length can show
    np.testing.assert_allclose(adev, 0.01, rtol=0.15)


def test_a_model_that_was_read_survives_writing_and_reading(tmp_path):
    model = read(tmp_path, "m.sdf", sdf(NOISE))
    (tmp_path / "m.json").write_text(sensorlab.model_text(model))
    assert sensorlab.read_model(tmp_path / "m.json") == model


@pytest.mark.parametrize("name, text, message", [
    ("d.json", sheet(colour="red"), "has no key colour"),
    ("d.json", SHEET | {"datasheet": 3}, "datasheet must be an object"),
    ("d.json", SHEET | {"unit": None}, "needs the \"unit\""),
    ("d.json", SHEET | {"unit": "deg"}, "neither an angular rate nor an acceleration"),
    ("d.json", sheet(noise_density="0.05 deg/s"), "they measure different things"),
    ("d.json", sheet(noise_density="a lot"), "is no quantity"),
    ("d.json", sheet(noise_density="-1 deg/s/sqrt(Hz)"), "it must be > 0"),
    ("d.json", sheet(rate="50 Hz"), "disagree"),
    ("d.json", sheet(random_walk="1 deg/sqrt(h)"), "it is given 2 times"),
    ("d.json", {k: v for k, v in SHEET.items() if k != "dt"}, "no sampling rate"),
    ("d.json", SHEET | {"dt": -1}, "interval is -1 s: it must be > 0"),
    ("imu.yaml", "{gyroscope_noise_density: 1, update_rate: .inf}", "it must be > 0"),
    ("imu.yaml", KALIBR, "several axes: name one as FILE#PART"),
    ("imu.yaml", KALIBR.replace("0.02", "-1"), "it must be >= 0"),
    ("imu.yaml", "gyroscope_noise_density: 1", "the file says no sampling rate"),
    ("imu.yaml", "a: b: c", "not a YAML file"),
    ("imu.yaml", KALIBR.replace("0.02", "much"), "is 'much': a number is needed"),
    ("imu.yaml", "a: b", "no noise of an IMU"),
    ("m.sdf", '<?xml version="1.0" encoding="utf-7"?><a/>', "not an XML file"),
    ("imu.yaml", "a: &a [*a]", "no noise of an IMU"),
    ("m.sdf", "<sdf>", "not an XML file"),
    ("m.sdf", "<sdf/>", "no noise of an IMU"),
    ("m.sdf", sdf(dict(stddev="x")), "<stddev> holds 'x'"),
    ("m.sdf", sdf(dict(stddev=1), rate=""), "give --dt"),
    ("p.json", {"P": {"Gyroscope": dict(NoiseDensity=1, NoiseType="x")}},
     "double-sided or single-sided"),
    ("p.json", {"P": {"Gyroscope": dict(NoiseDensity=1, BiasInstabilityCoefficients={
        "Numerator": 1, "Denominator": [1, 2, 3]})}}, "must be of first order here"),
    ("i.json", {k: v for k, v in GNSS.items() if k != "gyro_arw"},
     "gyro_arw is missing"),
    ("env.yaml", "p: {noise: {operation: scale, std: 1}}", "it is no error at rest"),
    ("env.yaml", "p: {noise: {noise_cfg: 5}}", "its keys are needed"),
    ("m.sdf", sdf(dict(stddev=1), rate="<update_rate>x</update_rate>"), "holds 'x'"),
])
def test_a_bad_file_gets_one_sentence(tmp_path, name, text, message):
    with pytest.raises(ValueError, match=message) as problem:
        read(tmp_path, name, text)
    assert "\n" not in str(problem.value)


def test_without_pyyaml_one_sentence_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "yaml", None)
    with pytest.raises(ValueError, match="pip install pyyaml"):
        read(tmp_path, "imu.yaml", KALIBR)


def test_a_part_that_is_not_there_is_told(tmp_path):
    with pytest.raises(ValueError, match="no part 'magnet'; there are imu0/gyro"):
        read(tmp_path, "imu.yaml", KALIBR, "magnet")


def test_a_correlation_time_below_the_sampling_interval_is_told(tmp_path):
    with pytest.raises(ValueError, match="must be longer than the sampling"):
        read(tmp_path, "i.json", GNSS, "gyroscope.x", dt=1.0)


def test_a_plain_model_file_is_left_to_its_reader(tmp_path):
    (tmp_path / "m.json").write_text('{"hypotheses": []}')
    assert translated(tmp_path / "m.json") is None
    (tmp_path / "a#b.json").write_text('{"hypotheses": []}')
    assert translated(tmp_path / "a#b.json") is None
    assert translated(tmp_path / "none.json") is None
