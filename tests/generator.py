"""Sensor records with a known defect, made without a line of sensorid.

A record is a random walk or a Markov process, a bias and white noise, written as plain
NumPy loops, plus one effect (or two, or none). Every record carries a temperature and a
rate, whether they act or not. The size of an additive effect is set by its severity:
half of s' C^-1 s nats at the true base.
"""

import numpy as np
from scipy.signal import lfilter

DT, N = 1.0, 4000
LEVELS = {1: 8.0, 2: 15.0, 3: 30.0, 4: 100.0}    # nats
ADDITIVE = ("rate_ramp", "bias_step", "turn_on_transient", "sinusoid", "temperature",
            "scale_factor", "nonlinearity", "latency", "thermal_lag")
OTHERS = ("correlated_noise", "bias_instability", "bandwidth", "noise_step", "outliers",
          "random_telegraph", "quantization", "saturation", "stuck")
OUTSIDE = ("chirp", "garch", "skewed_noise", "laplace_noise", "burst",
           "cubic_temperature")


def base(rng, n=N):
    """Name, parameters and bias-free coloured part, white noise apart."""
    sigma_v = rng.uniform(0.25, 1.0)
    v = sigma_v * rng.standard_normal(n)
    if rng.random() < 0.5:
        sigma_w = rng.uniform(0.04, 0.15)
        x = np.cumsum(sigma_w * rng.standard_normal(n))
        return "random_walk", dict(sigma_w=sigma_w, sigma_v=sigma_v), x, v
    tau, sigma = rng.uniform(60.0, 1500.0), rng.uniform(0.5, 1.5)
    return ("markov", dict(tau_m=tau, sigma_m=sigma, sigma_v=sigma_v),
            markov(rng, n, tau, sigma), v)


def markov(rng, n, tau, sigma):
    a = np.exp(-DT / tau)
    w = sigma * np.sqrt(1.0 - a * a) * rng.standard_normal(n)
    w[0] = sigma * rng.standard_normal()
    return lfilter([1.0], [1.0, -a], w)


def covariates(rng, n=N):
    t = np.arange(n)
    temperature = (25.0 + rng.uniform(2, 8) * np.sin(2 * np.pi * t / rng.uniform(900, n)
                                                     + rng.uniform(0, 6))
                   + np.cumsum(0.02 * rng.standard_normal(n)))
    hold = rng.integers(20, 120)
    rate = np.repeat(rng.uniform(-50, 50, n // hold + 1), hold)[:n]
    return temperature, rate + 0.1 * rng.standard_normal(n)


def information(s, name, p):
    """s' C^-1 s of a shape at the true base: a Kalman filter as the textbook has it.

    C is that of walk or Markov process, white noise and a bias of variance 1.
    """
    if name == "random_walk":
        a, q, P = 1.0, p["sigma_w"]**2, 0.0
    else:
        a = np.exp(-DT / p["tau_m"])
        q, P = p["sigma_m"]**2 * (1.0 - a * a), p["sigma_m"]**2
    ss = s1 = one = x = e = 0.0
    for value in s:
        P = a * a * P + q
        f = P + p["sigma_v"]**2
        x, e = a * x, a * e
        nu, mu = value - x, 1.0 - e
        x, e, P = x + P / f * nu, e + P / f * mu, P - P * P / f
        ss, s1, one = ss + nu * nu / f, s1 + nu * mu / f, one + mu * mu / f
    return ss - s1 * s1 / (1.0 + one)


def shape(rng, effect, temperature, rate, n=N):
    """Shape of an additive effect of unit size, and its other parameters."""
    t = np.arange(n) * DT
    T = n * DT
    if effect == "rate_ramp":
        return t, {}
    if effect == "bias_step":
        onset = int(rng.integers(n // 10, 9 * n // 10))
        return (t >= onset * DT).astype(float), dict(onset=onset * DT)
    if effect == "turn_on_transient":
        tau = float(np.exp(rng.uniform(np.log(T / 40), np.log(T / 8))))
        return np.exp(-t / tau), dict(tau=tau)
    if effect == "sinusoid":
        f = float(np.exp(rng.uniform(np.log(10 / T), np.log(0.4 / DT))))
        return np.sin(2 * np.pi * f * t + rng.uniform(0, 6.283)), dict(frequency=f)
    if effect == "temperature":
        return temperature - temperature.mean(), {}
    if effect == "scale_factor":
        return rate, {}
    if effect == "nonlinearity":
        return rate**2, {}
    if effect == "latency":
        return np.append(0.0, np.diff(rate)) / DT, {}
    if effect == "thermal_lag":
        tau = float(np.exp(rng.uniform(np.log(T / 60), np.log(T / 10))))
        a = np.exp(-DT / tau)
        lag = lfilter([1 - a], [1, -a], temperature - temperature[0])
        return lag, dict(tau=tau)
    raise ValueError(effect)


SIZE = dict(rate_ramp="slope", bias_step="size", turn_on_transient="size",
            sinusoid="amplitude")


def add(rng, effect, level, y, v, name, p, temperature, rate):
    """The record with an effect, and the effect's parameters."""
    n, white = len(y), p["sigma_v"]
    grade = dict(zip((1, 2, 3, 4), range(4)))[level]
    if effect in ADDITIVE:
        s, truth = shape(rng, effect, temperature, rate, n)
        size = np.sqrt(2.0 * LEVELS[level] / information(s, name, p))
        size *= rng.choice([-1, 1])
        known = abs(size) if effect == "sinusoid" else size
        return y + size * s, {**truth, SIZE.get(effect, "coefficient"): float(known)}
    if effect == "correlated_noise":
        tau = float(np.exp(rng.uniform(np.log(4), np.log(20))))
        sigma = white * (0.35, 0.6, 1.0, 2.0)[grade]
        return y + markov(rng, n, tau, sigma), dict(tau=tau, sigma=sigma)
    if effect == "bias_instability":
        f = np.fft.rfftfreq(16 * n, DT)
        f[0] = np.inf
        B = white * (0.3, 0.5, 0.8, 1.5)[grade]    # S = B^2 / (2 pi f), two-sided
        g = (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))) / 2**0.5
        x = np.fft.irfft(g * B / np.sqrt(2 * np.pi * f) * np.sqrt(16 * n / DT))[:n]
        # sigma: of the three decades from a tenth of the record downwards
        return y + x - x[0], dict(sigma=B * np.sqrt(3 * np.log(10) / np.pi))
    if effect == "bandwidth":
        tau = (0.4, 0.6, 1.2, 4.0)[grade]
        a = np.exp(-DT / tau)
        return y - v + lfilter([1 - a], [1, -a], v), dict(tau=tau)
    if effect == "noise_step":
        onset, ratio = int(rng.integers(n // 5, 4 * n // 5)), (
            (1.15, 1.25, 1.5, 2.5)[grade] ** rng.choice([-1, 1]))
        y = y.copy()
        y[onset:] += (ratio - 1.0) * v[onset:]
        return y, dict(onset=onset * DT, ratio=ratio)
    if effect == "outliers":
        sigma = white * (4, 6, 12, 25)[grade]
        hit = rng.random(n) < 0.008
        return y + hit * sigma * rng.standard_normal(n), dict(rate=0.008, sigma=sigma)
    if effect == "random_telegraph":
        dwell = float(rng.uniform(60, 200))
        size = white * (0.9, 1.3, 2.0, 4.0)[grade]
        flip = rng.random(n) < DT / dwell
        return y + size * ((np.cumsum(flip) + rng.integers(2)) % 2), dict(
            dwell=dwell, size=size)
    if effect == "quantization":
        lsb = white * (0.5, 1.0, 2.0, 4.0)[grade]
        return lsb * np.round(y / lsb), dict(lsb=lsb)
    if effect == "saturation":
        low, high = np.quantile(y, [(0.002, 0.01, 0.05, 0.15)[grade],
                                    1 - (0.002, 0.01, 0.05, 0.15)[grade]])
        return np.clip(y, low, high), dict(limits=[low, high])
    if effect == "stuck":
        y, spans = y.copy(), []
        for start in rng.choice(n - 100, (1, 2, 5, 12)[grade], replace=False):
            length = int(rng.integers(12, 50))
            y[start:start + length] = y[start]
            spans.append([float(start), length])
        return y, dict(spans=spans)
    if effect == "chirp":
        t = np.arange(n)
        f0, f1 = rng.uniform(0.01, 0.1), rng.uniform(0.15, 0.4)
        phase = 2 * np.pi * (f0 * t + 0.5 * (f1 - f0) * t * t / n)
        return y + white * (0.3, 0.4, 0.6, 1.0)[grade] * np.sin(phase), {}
    if effect == "garch":
        h, z = np.empty(n), rng.standard_normal(n)
        h[0] = 1.0
        for i in range(1, n):
            h[i] = 0.02 + 0.13 * h[i - 1] * z[i - 1]**2 + 0.85 * h[i - 1]
        return y - v + white * z * np.sqrt(h), {}
    if effect == "skewed_noise":
        return y - v + white * (rng.gamma(2.0, size=n) - 2.0) / np.sqrt(2.0), {}
    if effect == "laplace_noise":
        return y - v + white * rng.laplace(size=n) / np.sqrt(2.0), {}
    if effect == "burst":
        t, middle = np.arange(n), rng.uniform(0.2, 0.8) * n
        window = np.exp(-0.5 * ((t - middle) / 60.0)**2)
        wave = np.sin(2 * np.pi * rng.uniform(0.02, 0.2) * t)
        return y + white * (1, 1.5, 2.5, 4.0)[grade] * window * wave, {}
    if effect == "cubic_temperature":
        x = temperature - temperature.mean()
        x = x / x.std()
        # the level is that of what no line in temperature explains
        odd, both, line = (information(s, name, p) for s in (x**3, x**3 + x, x))
        rest = x**3 - (both - odd - line) / (2.0 * line) * x
        return y + x**3 * np.sqrt(2.0 * LEVELS[level] / information(rest, name, p)), {}
    raise ValueError(effect)


def record(seed, number, effects=(), level=3, edge=False):
    """One record: a dict with its error, the same without effects, its covariates, the
    base and the truth.

    With `edge`, the parameters of the base lie at the ends of their ranges.
    """
    rng = np.random.default_rng([seed, number])
    temperature, rate = covariates(rng)
    name, p, x, v = base(rng)
    if edge:
        ends = dict(sigma_w=(0.04, 0.15), sigma_v=(0.25, 1.0), tau_m=(60.0, 1500.0),
                    sigma_m=(0.5, 1.5))
        new = {k: float(rng.choice(ends[k])) for k in p}
        v *= new["sigma_v"] / p["sigma_v"]
        x = (x * new["sigma_w"] / p["sigma_w"] if name == "random_walk" else
             markov(rng, N, new["tau_m"], new["sigma_m"]))
        p = new
    y = clean = rng.standard_normal() + x + v
    truth = {}
    for effect in effects:
        y, truth[effect] = add(rng, effect, level, y, v, name, p, temperature, rate)
    return dict(error=y, clean=clean, temperature=temperature, rate=rate, base=name,
                parameters=p, truth=truth)
