"""Real recordings, which are not part of the project."""

import numpy as np
import pytest

import sensorid
import sensorlab
from sensorlab.gap import sizes, words


@pytest.mark.thorough
def test_a_turn_on_transient_and_its_temperature(real):
    with np.load(real / "mpu6050_static10min_temp.npz") as z:
        n = z["temp_degC"].size // 50 * 50    # 0.5 s means: the stamps jitter
        y = z["accel_counts"][1, :n].reshape(-1, 50).mean(1) / 4.096    # mg
        T = z["temp_degC"][:n].reshape(-1, 50).mean(1)
    hypotheses = sensorid.default_hypotheses(y, 0.5)
    hidden = sensorlab.diagnose(y, 0.5, hypotheses)
    assert hidden.verdict == "turn_on_transient"
    assert 60.0 < hidden.found[0].values["tau"][0] < 250.0
    shown = sensorlab.diagnose(y, 0.5, hypotheses, dict(temperature=T))
    best = {c.effect for c in shown.causes if c.probability > 0.05}
    # the record cooled once: time and temperature cannot be told apart
    assert best & {"temperature", "thermal_lag"} and "turn_on_transient" in best
    mean, sd = next(c.parameters["coefficient"] for c in shown.causes
                    if c.effect == "temperature")
    assert abs(mean - 3.6) < 2.0 * sd    # mg/degC by regression of 10 s means


@pytest.mark.thorough
def test_the_vibration_of_an_accelerometer_is_a_line_near_half_a_hertz(real):
    """Of fewer samples it has even odds."""
    with np.load(real / "adis16405_run1.npz") as z:
        y = z["accel_counts"][0][:4000] * float(z["accel_lsb"]) * 1e3    # mg
    d = sensorlab.diagnose(y, 0.01, sensorid.default_hypotheses(y, 0.01), effects=[
        sensorlab.CATALOGUE[name] for name in (
            "quantization", "narrow_band_noise", "sinusoid", "bandwidth", "ringing",
            "vibration_burst")])
    lines = [one.values["frequency"][0] for one in d.found
             if one.name in ("sinusoid", "narrow_band_noise")]
    assert any(0.45 < f < 0.6 for f in lines), [one.name for one in d.found]


@pytest.mark.thorough
def test_runs_of_one_sensor_differ_by_a_drift_or_not_at_all(real):
    runs = {}
    for k in (1, 2, 3):    # gyro x, 2 s means
        with np.load(real / f"adis16405_run{k}.npz") as z:
            runs[k] = z["gyro_counts"][0].reshape(-1, 200).mean(1) * float(
                z["gyro_lsb"])
    simulator = sensorlab.simulator_from(runs[1][None], 2.0)
    warm = sensorlab.diagnose(runs[2], 2.0, simulator)
    drifts = {"rate_ramp", "second_order_drift", "turn_on_transient"}
    assert sum(c.probability for c in warm.causes if drifts & {*c.effects}) > 0.8
    assert sensorlab.diagnose(runs[3], 2.0, simulator).verdict == "none"
    # ten minutes do not show what the whole run does
    assert sensorlab.diagnose(runs[1][:300], 2.0, sensorid.default_hypotheses(
        runs[1][:300], 2.0)).verdict == "none"


@pytest.mark.thorough
def test_two_clusters_of_temperature_are_no_proof_of_it(real):
    with np.load(real / "bmi270_hot_cold.npz") as z:
        parts = [slice(0, 500), slice(0, 500)]
        y = np.concatenate([z[f"{k}_gyro"][1, part].astype(float) for k, part in zip(
            ("hot", "cold"), parts)])
        T = np.concatenate([z[f"{k}_temp"][part].astype(float) for k, part in zip(
            ("hot", "cold"), parts)])
    low, high = words.clusters(T)
    assert low[1] < 14.0 and high[0] > 47.0
    some = [sensorlab.CATALOGUE[name] for name in (
        "quantization", "narrow_band_noise", "bias_step", "temperature",
        "thermal_lag")]
    d = sensorlab.diagnose(y, 0.02, sensorid.default_hypotheses(y, 0.02),
                           dict(temperature=T), effects=some)
    assert any("temperature" in c.effect or "thermal_lag" in c.effect or
               "bias_step" in c.effect for c in d.causes[:4])
    text = words.table(d, sensorlab.Record("r", "gyro", y, 0.02, dict(
        temperature=T)), "deg/s")
    if any(s.found.column for s in d.final.signatures):
        assert "never between" in text


def test_published_noise_14_times_too_large_is_a_wrong_parameter(real):
    with np.load(real / "imu_utils_allan_curves.npz") as z:
        density = np.interp(1.0, z["BMI160_gyr_t"], z["BMI160_gyr_x"])
        density *= np.pi / 180 / 3600    # rad/s per root Hz, read at 1 s
        text = str(z["BMI160_yaml"]).split("x-axis")[1]
    published = float(text.split("gyr_n:")[1].split()[0])
    rate = 196.0
    y = np.random.default_rng(0).standard_normal(4000) * density * rate**0.5
    simulator = [sensorid.hypothesis("white_noise", sigma_v=published * rate**0.5)]
    d = sensorlab.diagnose(y, 1.0 / rate, simulator)
    assert d.verdict == "wrong_parameter"
    factor, sd = d.found[0].values["factor"]
    assert factor == pytest.approx(density / published, rel=0.1)
    assert "root of the rate" in sizes.looks_like(factor, 0.1 * factor, 1.0 / rate)


@pytest.mark.thorough
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_codes_of_an_accelerometer_are_of_uneven_width(real, axis):
    with np.load(real / "xsens_mti_multipos.npz") as z:
        first, second = z["accel_counts"][axis, :4800].astype(float).reshape(2, -1)
    d = sensorlab.diagnose(first, 0.01, sensorid.default_hypotheses(first, 0.01))
    assert {"quantization", "differential_nonlinearity"} <= {*d.verdict.split("+")}
    assert "unknown" not in d.verdict and d.closure.closed > 0.7
    simulator = sensorlab.simulator_from(first[None], 0.01)
    again = sensorlab.diagnose(second, 0.01, simulator)
    assert again.verdict in ("none", "undecided")
