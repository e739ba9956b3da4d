"""Hostile statistics: records of many lengths, rates, units and priors without an
effect, and gaps that other tests have not; how often a verdict is right, with 95 %
intervals.

Records are made here by plain NumPy, number k of a condition from the seed (SEED, k).
`python -m figures hostile` goes on where it was interrupted.
"""

import matplotlib.pyplot as plt
import numpy as np

import figures
import sensorid
import sensorlab
from figures import save, withheld

SEED = 1997
REPEATS = 20    # records of a condition
HEALTHY = "none", "undecided"    # right verdicts

WALK = dict(sigma_w=(0.04, 0.15), sigma_v=(0.25, 1.0))
MARKOV = dict(tau_m=(60.0, 1500.0), sigma_m=(0.5, 1.5), sigma_v=(0.25, 1.0))


def simulator(unit=1.0, dt=1.0, prior="uniform", wide=1.0):
    """Walk or Markov process in white noise, in any unit and at any interval."""
    def scaled(symbol, ends):
        factor = dt if symbol.startswith("tau") else unit
        return ends[0] * factor / wide, ends[1] * factor * wide
    return [sensorid.hypothesis(name, bias_sigma=unit, prior=prior, **{
        s: scaled(s, ends) for s, ends in ranges.items()})
        for name, ranges in (("random_walk", WALK), ("markov", MARKOV))]


def record(rng, n=1000, sigma_v=None, sigma_w=None, draw=None):
    """Bias, and a walk or a Markov process, in white noise, which `draw` may draw."""
    sigma_v = rng.uniform(0.25, 1.0) if sigma_v is None else sigma_v
    y = rng.standard_normal() + sigma_v * (draw or rng.standard_normal)(n)
    if sigma_w is not None or rng.random() < 0.5:
        sigma_w = rng.uniform(0.04, 0.15) if sigma_w is None else sigma_w
        return y + np.cumsum(sigma_w * rng.standard_normal(n))
    a, x = np.exp(-1.0 / rng.uniform(60.0, 1500.0)), rng.standard_normal()
    sigma_m = rng.uniform(0.5, 1.5)
    for i in range(n):
        x = a * x + np.sqrt(1.0 - a * a) * rng.standard_normal()
        y[i] += sigma_m * x
    return y


def healthy(n=1000, dt=1.0, unit=1.0, offset=0.0, missing=0.0, gap=0, columns=0,
            **priors):
    """Condition without an effect; `gap` samples are missing in a row."""
    def make(rng):
        y = record(rng, n)
        y[rng.random(n) < missing] = np.nan
        at = rng.integers(n - gap)
        y[at:at + gap] = np.nan
        beside = {f"x{k}": np.cumsum(rng.standard_normal(n)) for k in range(columns)}
        return unit * (y + offset), dt, simulator(unit, dt, **priors), beside
    return make, HEALTHY


def known(rng):
    y = record(rng, sigma_v=0.5, sigma_w=0.1)
    return y, 1.0, [sensorid.hypothesis("random_walk", sigma_w=0.1, sigma_v=0.5)], {}


def white(rng):
    y = record(rng, sigma_w=0.0)
    return y, 1.0, [sensorid.hypothesis("white_noise", sigma_v=(0.25, 1.0))], {}


def unbiased(rng):
    y = np.cumsum(0.1 * rng.standard_normal(1000)) + 0.5 * rng.standard_normal(1000)
    return y, 1.0, [h._replace(bias_sigma=0.0, bias_given=True)
                    for h in simulator()], {}


def fast_walk(rng):
    y = record(rng, sigma_v=0.02, sigma_w=rng.uniform(0.5, 1.0))
    return y, 1.0, [
        sensorid.hypothesis("random_walk", sigma_w=(0.5, 1.0), sigma_v=0.02),
        sensorid.hypothesis("markov", tau_m=(20.0, 200.0), sigma_m=(3.0, 6.0),
                            sigma_v=0.02)], {}


def louder(factor):
    """White noise this many times the end of its range."""
    def make(rng):
        sigma_v = factor if factor > 1.0 else 0.25 * factor
        return record(rng, sigma_v=sigma_v, sigma_w=0.1), 1.0, simulator(), {}
    return make, ("wrong_parameter",)


def walks(rng):
    y = record(rng, 1500, sigma_v=1.0, sigma_w=rng.choice([0.03, 0.06, 0.1]))
    return y, 1.0, [sensorid.hypothesis("white_noise", sigma_v=(0.5, 2.0))], {}


def pulse(rng):
    y, at = record(rng, sigma_v=0.5, sigma_w=0.05), rng.integers(150, 700)
    y[at:at + 120] += 3.0
    return y, 1.0, simulator(), {}


def curved(rng):
    rate = rng.uniform(-5.0, 5.0, 1000)
    y = record(rng, sigma_v=0.5, sigma_w=0.05)
    return y + 0.02 * rate**2, 1.0, simulator(), dict(rate=rate)


def parabola(rng):
    t = np.linspace(-1.0, 1.0, 1000)
    y = record(rng, sigma_v=0.5, sigma_w=0.04)
    return y + 8.0 * (t - rng.uniform(-0.3, 0.3))**2, 1.0, simulator(), {}


def late(rng):
    rate = np.convolve(rng.standard_normal(1019), np.ones(20), "valid")
    y = record(rng, sigma_v=0.5, sigma_w=0.05) + 0.3 * np.gradient(rate)
    return y, 1.0, simulator(), dict(rate=rate)


def counts(lsb, amplitude=0.0):
    """Function that makes a record in counts, with a line beneath them."""
    def make(rng):
        y = record(rng, sigma_v=0.5, sigma_w=0.05)
        if amplitude:
            y += amplitude * np.sin(2.0 * np.pi * rng.uniform(0.02, 0.4) * np.arange(
                len(y)))
        return lsb * np.round(y / lsb), 1.0, [
            sensorid.hypothesis(h.name, bias_sigma=1.0, **{
                p.symbol: 0.5 if p.symbol == "sigma_v" else (p.low, p.high)
                for p in h.parameters}) for h in simulator()], {}
    return make


def heavy(rng):
    y = record(rng, draw=lambda n: rng.standard_t(10, n) * np.sqrt(0.8))
    return y, 1.0, simulator(), {}


def restless(rng):
    y = record(rng, sigma_v=0.5, sigma_w=0.05)
    y[500:] += np.cumsum(0.5 * rng.standard_normal(500))
    return y, 1.0, simulator(), {}


def square_wave(rng):
    t = np.arange(1000.0) + rng.uniform(0.0, 100.0)
    y = record(rng, sigma_v=0.5, sigma_w=0.05)
    return y + 0.5 * np.sign(np.sin(2.0 * np.pi * t / rng.uniform(30.0, 100.0))), (
        1.0), simulator(), {}


CONDITIONS = {
    "64 samples": healthy(64), "300 samples": healthy(300),
    "4000 samples": healthy(4000), "20000 samples": healthy(20000),
    "dt 0.01 s": healthy(dt=0.01), "dt 100 s": healthy(dt=100.0),
    "log priors": healthy(prior="log"), "priors 10 x wider": healthy(
        prior="log", wide=10.0),
    "30 % missing": healthy(missing=0.3), "a gap of a third": healthy(gap=333),
    "six irrelevant columns": healthy(columns=6),
    "unit 1e-12": healthy(unit=1e-12), "unit 1e+12": healthy(unit=1e12),
    "offset 1e7": healthy(offset=1e7), "offset 1e9": healthy(offset=1e9),
    "fast walk": (fast_walk, HEALTHY), "no bias": (unbiased, HEALTHY),
    "parameters known": (known, HEALTHY), "white noise alone": (white, HEALTHY),
    "t-noise, 10 degrees": (heavy, (*HEALTHY, "unknown", "outliers")),
    "noise 1.15 x its range": louder(1.15),
    "noise 1.5 x its range": louder(1.5), "noise 5 x its range": louder(5.0),
    "noise half of its range": louder(0.5),
    "walk, simulator without": (walks, ("random_walk",)),
    "rectangular pulse": (pulse, ("pulse", "bias_step+bias_step")),
    "parabola": (parabola, ("second_order_drift",)),
    "square of a rate": (curved, ("nonlinearity",)),
    "derivative of a rate": (late, ("latency",)),
    "counts": (counts(0.8), ("quantization",)),
    "counts 3 x the noise": (counts(1.5), ("quantization", "undecided")),
    "the same, and a line": (counts(1.5, 0.6), ("quantization+sinusoid",
                                                "quantization+narrow_band_noise")),
    "walk that grows": (restless, ("walk_step",)),
    "square wave": (square_wave, ("sinusoid",)),    # and its harmonics
}


def _verdict(condition, number):
    make, _ = CONDITIONS[condition]
    y, dt, hypotheses, columns = make(np.random.default_rng([SEED, number]))
    return sensorlab.diagnose(y, dt, hypotheses, columns).verdict


def compute():
    """{condition: [verdict, ...]}; verdicts given before are kept."""
    return figures.repeated("hostile", CONDITIONS, REPEATS, _verdict)


def right(condition, verdict):
    """Is a verdict one of those expected? Where one name is, it may have company."""
    expected = CONDITIONS[condition][1]
    if len(expected) == 1:
        return expected[0] in verdict.split("+")
    return verdict in expected


def table(result):
    """The result as text, a line for each condition."""
    lines = []
    for name, verdicts in result.items():
        k, n = sum(right(name, v) for v in verdicts), len(verdicts)
        low, high = withheld.interval(k, n)
        others = sorted({v for v in verdicts if not right(name, v)})
        text = f"{name:<26}{k:>4} of {n:<4}[{100 * low:3.0f}, {100 * high:3.0f}] %"
        lines.append(text + ("  also: " + ", ".join(others) if others else ""))
    return "\n".join(lines)


def draw(result):
    fig, ax = plt.subplots(figsize=(7.0, 6.0))
    for at, (name, verdicts) in enumerate(reversed(result.items())):
        hits = [right(name, v) for v in verdicts]
        low, high = withheld.interval(sum(hits), len(hits))
        ax.plot([100 * low, 100 * high], [at, at], "k-", linewidth=1)
        ax.plot(100 * np.mean(hits), at, "o", color="tab:blue")
    ax.set_yticks(range(len(result)), list(reversed(result)))
    ax.set(xlabel="verdicts as expected, % (95 % interval)", xlim=(0.0, 101.0),
           title=f"{len(next(iter(result.values())))} records of each condition, "
                 f"seed {SEED}")
    return fig


def main():
    result = compute()
    print(table(result))
    save(draw(result), "hostile")
