"""How other programs draw or foretell noise, transcribed from their sources into plain
NumPy; nothing is imported from the project. Where they are is said in
`sensorlab.foreign` and `sensorlab.exports`.

Records are (trials, samples); parameters are called what the program calls them.
"""

import numpy as np
from scipy.signal import lfilter


def kalibr(rng, trials, samples, dt, noise_density, random_walk, bias=0.0):
    """The wiki's IMU noise model; OpenVINS's Simulator::get_next_imu is the same."""
    y = np.empty((trials, samples))
    b = bias * rng.standard_normal(trials)
    for k in range(samples):
        b = b + random_walk * np.sqrt(dt) * rng.standard_normal(trials)
        y[:, k] = b + noise_density / np.sqrt(dt) * rng.standard_normal(trials)
    return y


def gazebo(rng, trials, samples, dt, mean=0.0, stddev=0.0, bias_mean=0.0,
           bias_stddev=0.0, dynamic_bias_stddev=0.0, dynamic_bias_correlation_time=0.0,
           precision=0.0):
    """GaussianNoiseModel::Load and ::ApplyImpl."""
    y = np.empty((trials, samples))
    bias = bias_mean + bias_stddev * rng.standard_normal(trials)
    bias *= np.where(rng.random(trials) < 0.5, -1.0, 1.0)
    sigma_b, tau = dynamic_bias_stddev, dynamic_bias_correlation_time
    for k in range(samples):
        white = mean + stddev * rng.standard_normal(trials)
        if sigma_b > 0 and tau > 0:
            sigma_b_d = np.sqrt(-sigma_b * sigma_b * tau / 2 * np.expm1(-2 * dt / tau))
            bias = np.exp(-dt / tau) * bias + sigma_b_d * rng.standard_normal(trials)
        y[:, k] = bias + white
    return np.round(y / precision) * precision if precision else y


def matlab(rng, trials, samples, dt, NoiseDensity=0.0, RandomWalk=0.0,
           BiasInstability=0.0, NoiseType="double-sided", Denominator=(1.0, -0.5),
           Resolution=0.0, MeasurementRange=np.inf, ConstantBias=0.0):
    """IMUSensorSimulator: setupBandwidth, setStdDev*, stepRandomDriftModel."""
    rate = 1.0 / dt
    bandwidth = rate / 2 if NoiseType == "double-sided" else rate
    correlation_time = 2 * dt
    sd_bias = np.sqrt(2 / (rate * correlation_time)) * BiasInstability
    y = np.empty((trials, samples))
    walk, flicker = np.zeros(trials), np.zeros(trials)
    for k in range(samples):
        flicker = (sd_bias * rng.standard_normal(trials)
                   - Denominator[1] * flicker) / Denominator[0]
        walk = walk + RandomWalk / np.sqrt(bandwidth) * rng.standard_normal(trials)
        y[:, k] = (np.sqrt(bandwidth) * NoiseDensity * rng.standard_normal(trials)
                   + flicker + walk)
    y = np.clip(y + ConstantBias, -MeasurementRange, MeasurementRange)
    return Resolution * np.round(y / Resolution) if Resolution else y


def airsim(rng, trials, samples, dt, white, stability, tau):
    """ImuSimple::addNoise, in SI units."""
    y = np.empty((trials, samples))
    sqrt_dt = np.sqrt(max(dt, 1e-3))
    norm, bias = stability / np.sqrt(tau), np.zeros(trials)
    for k in range(samples):
        y[:, k] = rng.standard_normal(trials) * white / sqrt_dt + bias
        bias = bias + rng.standard_normal(trials) * norm * sqrt_dt
    return y


def gnss_ins_sim(rng, trials, samples, dt, b, b_drift, b_corr, arw):
    """pathgen.gyro_gen and bias_drift, in SI units."""
    fs = 1.0 / dt
    drift = np.zeros((trials, samples))
    if np.isinf(b_corr):
        drift = b_drift * rng.standard_normal((trials, samples))
    else:
        a = 1 - 1 / fs / b_corr
        step = b_drift * np.sqrt(1.0 - np.exp(-2 / (fs * b_corr)))
        for j in range(1, samples):
            drift[:, j] = a * drift[:, j - 1] + step * rng.standard_normal(trials)
    return b + drift + arw / np.sqrt(dt) * rng.standard_normal((trials, samples))


def isaac(rng, trials, samples, std, bias_std):
    """NoiseModelWithAdditiveBias after one reset, the bias with operation "abs"."""
    bias = bias_std * rng.standard_normal((trials, 1))
    return std * rng.standard_normal((trials, samples)) + bias


# ---- filters: variance of the integral of the error, its bias known at the start

def gtsam(duration, dt, covariance, bias_covariance):
    """CombinedImuFactor's integrateMeasurement, one axis, no rotation."""
    F, P = np.array([[1.0, -dt], [0.0, 1.0]]), np.zeros((2, 2))
    for _ in range(round(duration / dt)):
        P = F @ P @ F.T + np.diag([dt * (covariance / dt) * dt, dt * bias_covariance])
    return P[0, 0]


def vins(duration, dt, n, w):
    """IntegrationBase::midPointIntegration, one axis, no rotation."""
    F, P = np.array([[1.0, -dt], [0.0, 1.0]]), np.zeros((2, 2))
    V = np.array([[0.5 * dt, 0.5 * dt, 0.0], [0.0, 0.0, dt]])
    for _ in range(round(duration / dt)):
        P = F @ P @ F.T + V @ np.diag([n * n, n * n, w * w]) @ V.T
    return P[0, 0]


def px4(duration, noise, bias_noise, dt=0.01):
    """Ekf::predictCovariance, one axis, no rotation."""
    F, P = np.array([[1.0, -dt], [0.0, 1.0]]), np.zeros((2, 2))
    for _ in range(round(duration / dt)):
        P = F @ P @ F.T + np.diag([(dt * noise)**2, (dt * bias_noise)**2])
    return P[0, 0]


def inside(y, dt, density, walk, seconds):
    """Of a record at rest: is the error of its integral within what a Kalman filter of
    the bias foretells with 95 %? The filter knows two numbers and is in steady state.
    """
    r, q = density**2 / dt, walk**2 * dt
    before = (q + np.sqrt(q * q + 4 * q * r)) / 2
    gain = before / (before + r)
    bias = lfilter([gain], [1, gain - 1], y)
    m = round(seconds / dt)
    angle = np.append(0, np.cumsum(y)) * dt
    at = np.arange(60000, len(y) - m, m)
    error = angle[at + m] - angle[at] - m * dt * bias[at - 1]
    variance = ((m * dt)**2 * before * (1 - gain) + m * dt**2 * r
                + q * dt**2 * np.sum(np.arange(1, m + 1)**2))
    return np.abs(error) < 1.96 * np.sqrt(variance)
