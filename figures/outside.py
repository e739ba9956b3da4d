"""Effects that are in no catalogue: what is said of them, and how often that misleads.

REPEATS records of each kind, of SAMPLES samples, number k from the seed (SEED, k): a
walk in white noise, a temperature and a rate beside it, and one effect. A filter that
knows a shape would gain NATS by it; of noise there is as much as shows. A kind lists
the names that an engineer can defend: the nearest neighbours in the catalogue.
`python -m figures outside` goes on where it was interrupted.
"""

import collections
import types

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import lfilter

import figures
import sensorid
import sensorlab
from figures import save
from figures.withheld import interval
from sensorlab.drawings.style import AFTER, BEFORE, INK, PALE, legend_above
from sensorlab.gap.verdict import names_in
from tests import generator

SEED = 1998
REPEATS = 8
SAMPLES = 1500
NATS = 70.0
TRUTH = dict(sigma_w=0.05, sigma_v=0.5)
SIMULATOR = [sensorid.hypothesis("random_walk", sigma_w=(0.02, 0.12),
                                 sigma_v=(0.25, 1.0)),
             sensorid.hypothesis("markov", tau_m=(60.0, 1500.0), sigma_m=(0.5, 1.5),
                                 sigma_v=(0.25, 1.0))]


def _parts(rng):
    """What a kind is made of: the time, what is recorded beside, the noises."""
    n, t = SAMPLES, np.arange(float(SAMPLES))
    since = t - rng.uniform(0.25, 0.6) * n
    temperature = 25.0 + 5.0 * np.sin(
        2.0 * np.pi * t / rng.uniform(0.6, 1.2) / n + rng.uniform(0.0, 6.0)
    ) + np.cumsum(0.05 * rng.standard_normal(n))
    hold = rng.integers(20, 60)
    rate = np.repeat(rng.uniform(-50.0, 50.0, n // hold + 1), hold)[:n] + (
        0.1 * rng.standard_normal(n))
    return types.SimpleNamespace(
        rng=rng, t=t, since=since, temperature=temperature, rate=rate,
        warm=(temperature - temperature.mean()) / temperature.std(), turn=rate / 50.0,
        white=TRUTH["sigma_v"] * rng.standard_normal(n),
        walk=np.cumsum(TRUTH["sigma_w"] * rng.standard_normal(n)),
        phase=2.0 * np.pi * (t / rng.uniform(40.0, 120.0) + rng.random()))


def _levels(rng, steps):
    """Levels that change after so many samples on average, to new ones each time."""
    return np.cumsum((rng.random(SAMPLES) < 1.0 / steps) * rng.standard_normal(SAMPLES))


def _chirp(b):
    low, high = b.rng.uniform(0.01, 0.1), b.rng.uniform(0.15, 0.4)
    return np.sin(2.0 * np.pi * (low * b.t + 0.5 * (high - low) * b.t**2 / SAMPLES))


def _late(x):
    """x, 25 samples later."""
    return np.append(np.zeros(25), x[:-25])


def _garch(b):
    h, z = np.ones(SAMPLES), b.white / TRUTH["sigma_v"]
    for i in range(1, SAMPLES):
        h[i] = 0.02 + 0.13 * h[i - 1] * z[i - 1]**2 + 0.85 * h[i - 1]
    return np.sqrt(h)


def _dead(x, width):
    return np.sign(x) * np.maximum(np.abs(x) - width, 0.0)


LINES = "sinusoid", "narrow_band_noise"
DRIFTS = "rate_ramp", "second_order_drift", "turn_on_transient"
STEPS = "bias_step", "pulse", "gradual_step"
BY_RATE = "scale_factor", "nonlinearity", "hysteresis"
BY_TEMPERATURE = "temperature", "thermal_lag", "hysteresis"

# name: (shape of an effect, names that one can defend)
SHAPES = {
    "smooth bump": (lambda b: np.exp(-0.5 * (b.since / 60.0)**2), STEPS),
    "half a sine": (lambda b: np.sin(np.pi * np.clip(b.since / 200.0, 0, 1)), STEPS),
    "triangle": (lambda b: np.maximum(1.0 - np.abs(b.since) / 120.0, 0.0), STEPS),
    "level reached by a ramp": (lambda b: np.clip(b.since / 250.0, 0.0, 1.0),
                                (*STEPS, "rate_ramp")),
    "level reached by a law of exp": (
        lambda b: -np.expm1(-np.maximum(b.since, 0.0) / 80.0), STEPS),
    "shock that decays": (lambda b: (b.since > 0.0) * np.exp(
        -np.maximum(b.since, 0.0) / 50.0), STEPS),
    "shock that rings": (lambda b: (b.since > 0.0) * np.exp(-np.maximum(
        b.since, 0.0) / 40.0) * np.sin(0.6 * b.since), (*LINES, "ringing", "pulse")),
    "level that half returns": (
        lambda b: (b.since > 0.0) - 0.5 * (b.since > 300.0), STEPS),
    "stairs": (lambda b: np.floor(np.clip(b.since, 0.0, 599.0) / 200.0), STEPS),
    "sawtooth": (lambda b: b.phase % (2.0 * np.pi) - np.pi, LINES),
    "triangular wave": (lambda b: np.arcsin(np.sin(b.phase)), LINES),
    "uneven square wave": (lambda b: (b.phase % (2.0 * np.pi) < 1.5) - 0.24,
                           (*LINES, "random_telegraph")),
    "two lines that beat": (
        lambda b: np.sin(b.phase) * np.cos(2.0 * np.pi * b.t / 700.0), LINES),
    "chirp": (_chirp, LINES),
    "burst of vibration": (lambda b: np.exp(-0.5 * (b.since / 60.0)**2) * np.sin(
        0.7 * b.t), (*LINES, "vibration_burst")),
    "cubic drift": (lambda b: (b.t / SAMPLES - 0.5)**3, DRIFTS),
    "square root of time": (lambda b: np.sqrt(b.t), DRIFTS),
    "logarithm of time": (lambda b: np.log1p(b.t / 20.0), DRIFTS),
    "square of a temperature": (lambda b: b.warm**2, BY_TEMPERATURE),
    "cubic in a temperature": (lambda b: b.warm**3 - 3.0 * b.warm, BY_TEMPERATURE),
    "rate times temperature": (lambda b: b.turn * b.warm, ("thermal_scale_factor",)),
    "cubic in a rate": (lambda b: b.turn**3 - 0.6 * b.turn, BY_RATE),
    "dead zone of a rate": (lambda b: _dead(b.turn, 0.6) - 0.1 * b.turn, BY_RATE),
    "sign of a rate": (lambda b: np.sign(b.turn), BY_RATE),
    "echo": (lambda b: _late(b.walk + b.white), ()),
    "walk of rare steps": (lambda b: _levels(b.rng, 250.0), (
        *STEPS, "random_steps", "random_walk", "random_telegraph")),
    "three levels": (lambda b: _levels(b.rng, 60.0).round() % 3, (
        "random_telegraph", "random_steps", "correlated_noise")),
}
# name: (what becomes of the white noise, names that one can defend)
NOISES = {
    "garch": (lambda b: b.white * _garch(b), ("outliers", "noise_bursts")),
    "skewed": (lambda b: TRUTH["sigma_v"] * (b.rng.gamma(2.0, size=SAMPLES) - 2.0)
               / np.sqrt(2.0), ("outliers",)),
    "laplace": (lambda b: TRUTH["sigma_v"] * b.rng.laplace(size=SAMPLES)
                / np.sqrt(2.0), ("outliers",)),
    "even": (lambda b: TRUTH["sigma_v"] * b.rng.uniform(
        -np.sqrt(3.0), np.sqrt(3.0), SAMPLES), ()),
    "of two kinds": (lambda b: TRUTH["sigma_v"] * (
        0.9 * b.rng.choice([-1.0, 1.0], SAMPLES)
        + np.sqrt(0.19) * b.rng.standard_normal(SAMPLES)), ("random_telegraph",)),
    "that swells and fades": (lambda b: b.white * np.exp(0.7 * np.sin(
        6.0 * np.pi * b.t / SAMPLES)), ("noise_step", "noise_bursts")),
    "that grows": (lambda b: b.white * np.linspace(0.6, 1.6, SAMPLES),
                   ("noise_step", "noise_ramp")),
    "loud for a while": (lambda b: b.white * np.where(np.abs(b.since) < 60.0, 3.0, 1.0),
                         ("noise_step", "noise_bursts", "outliers")),
    "as loud as the rate": (lambda b: b.white * (0.4 + 1.2 * np.abs(b.turn)), (
        "noise_sensitivity", "noise_bursts")),
    "of alternating sign": (lambda b: lfilter([1.0, -0.45], [1.0], b.white),
                            ("blue_noise",)),
}


def record(kind, number):
    """Error and columns of one record."""
    b = _parts(np.random.default_rng([SEED, number]))
    if kind in SHAPES:
        shape = SHAPES[kind][0](b)
        size = np.sqrt(2.0 * NATS / generator.information(shape, "random_walk", TRUTH))
        y = b.walk + b.white + b.rng.choice([-1.0, 1.0]) * size * shape
    else:
        y = b.walk + NOISES[kind.removeprefix("noise ")][0](b)
    return b.rng.standard_normal() + y, dict(temperature=b.temperature, rate=b.rate)


KINDS = {**{name: names for name, (_, names) in SHAPES.items()},
         **{f"noise {name}": names for name, (_, names) in NOISES.items()}}


def _verdict(kind, number):
    y, columns = record(kind, number)
    return sensorlab.diagnose(y, 1.0, SIMULATOR, columns).verdict


def compute():
    """{kind: [verdict, ...]}; verdicts given before are kept."""
    return figures.repeated("outside", KINDS, REPEATS, _verdict)


ANSWERS = ("unknown or undecided", "a neighbour and unknown", "a neighbour", "none",
           "wrong")
COLOURS = AFTER, "#7fb0dd", PALE, INK, BEFORE


def answer(kind, verdict):
    """Which of ANSWERS a verdict is: a name that nobody can defend makes it wrong."""
    names = set(names_in(verdict))
    if verdict == "none":
        return "none"
    if names <= {"unknown", "undecided"}:
        return ANSWERS[0]
    if not names <= {"unknown", *KINDS[kind]}:
        return "wrong"
    return ANSWERS[1] if "unknown" in names else ANSWERS[2]


def table(result):
    """The result as text, a line for each kind, and shares with 95 % intervals."""
    said = [answer(kind, v) for kind, verdicts in result.items() for v in verdicts]
    lines = []
    for kind, verdicts in result.items():
        wrong = sum(answer(kind, v) == "wrong" for v in verdicts)
        lines.append(f"{kind:<32}{wrong:>2} wrong of {len(verdicts):<4}" + ", ".join(
            f"{v} {k}" for v, k in collections.Counter(verdicts).most_common()))
    for name in ANSWERS:
        k = said.count(name)
        low, high = interval(k, len(said))
        lines.append(f"{name:<32}{k:>4} of {len(said):<5}{100 * k / len(said):.1f} % "
                     f"[{100 * low:.1f}, {100 * high:.1f}]")
    return "\n".join(lines)


def draw(result):
    fig, ax = plt.subplots(figsize=(7.0, 7.5))
    for at, (kind, verdicts) in enumerate(reversed(result.items())):
        said, left = [answer(kind, v) for v in verdicts], 0.0
        for name, colour in zip(ANSWERS, COLOURS):
            share = 100.0 * said.count(name) / len(said)
            ax.barh(at, share, left=left, color=colour, height=0.75)
            left += share
    for name, colour in zip(ANSWERS, COLOURS):
        ax.barh(0, 0.0, color=colour, label=name)
    ax.set_yticks(range(len(result)), list(reversed(result)))
    ax.set(xlim=(0.0, 100.0), ylim=(-0.6, len(result) - 0.4), xlabel=(
        f"verdicts, % of {len(next(iter(result.values())))} records of each kind"))
    legend_above(ax)
    return fig


def main():
    result = compute()
    print(table(result))
    save(draw(result), "outside")
