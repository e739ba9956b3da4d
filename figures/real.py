"""Real recordings: what a diagnosis says of a recording beside itself, beside another
run of the same sensor, and of effects that are put into it; and whether the sum of
components that `identify --compose` finds describes it, and the next run.

The recordings are not part of the project. They are looked for in shared/data/real
beside it (see the README there); without them there is no figure. Stretches are of
4000 samples of an ADIS16405, six axes at 100 Hz; the simulator is known by a stretch of
run 1 alone. An effect put in is of so many nats: of a shape, those of its matched
filter; of noise, whose shape nobody can know, those by which its law differs from the
nearest of white noise. `python -m figures real` goes on where it was interrupted.
"""

import pathlib

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.signal import lfilter
from scipy.stats import norm

import figures
import sensorid
import sensorlab
from figures import save, withheld
from sensorlab.drawings.style import AFTER, BEFORE, legend_above

REAL = pathlib.Path(__file__).parents[2] / "shared" / "data" / "real"
SEED, N, DT = 16405, 4000, 0.01
AXES = [(kind, axis) for kind in ("gyro", "accel") for axis in range(3)]
NATS = 15.0, 30.0, 100.0
DESCRIBED = 0.01              # p-value from which on a sum leaves no remainder
MOVED = "none", "undecided", "wrong_parameter"    # a sum that describes the next run,
                              # at least if its parameters move
SIMULATORS, RECORDS = 200000, (240000, 600000)    # first samples of the stretches


def stretch(run, kind, axis, first):
    with np.load(REAL / f"adis16405_run{run}.npz") as z:
        counts = z[f"{kind}_counts"][axis, first:first + N]
        return counts * float(z[f"{kind}_lsb"])


# ---- effects, as shapes of unit size

def line(rng, t):
    return np.sin(2.0 * np.pi * rng.uniform(2.0, 40.0) * t + rng.uniform(0.0, 6.0)), {}


def step(rng, t):
    return (t > rng.uniform(0.2, 0.8) * t[-1]).astype(float), {}


def ramp(rng, t):
    return t, {}


def transient(rng, t):
    return np.exp(-t / rng.uniform(1.0, 8.0)), {}


def heat(rng, t):
    period, phase = rng.uniform(10.0, 30.0), rng.uniform(0.0, 6.0)
    T = 25.0 + np.sin(2.0 * np.pi * t / period + phase)
    return T - T.mean(), dict(temperature=T)


SHAPES = dict(sinusoid=line, bias_step=step, rate_ramp=ramp,
              turn_on_transient=transient, temperature=heat)


# ---- noises of unit size: functions that draw one

def spikes(rng):
    return lambda: (rng.random(N) < RATE) * rng.standard_normal(N)


def levels(rng):
    change = DT / rng.uniform(0.5, 4.0)
    return lambda: np.cumsum(rng.random(N) < change) % 2.0


def slow_noise(rng):
    a = np.exp(-DT / rng.uniform(0.2, 1.0))
    return lambda: lfilter([1.0], [1.0, -a], rng.standard_normal(N))


RATE = 0.003    # of outliers, a sample
NOISES = dict(outliers=spikes, random_telegraph=levels, correlated_noise=slow_noise)
DRAWS = 64      # of a noise, whose mean is its spectrum


# ---- how large, so that it is of so many nats

def whitener(clean, lags=32):
    """Function that makes white, of variance 1, what a regression of the clean record
    on its past tells.
    """
    y = clean - clean.mean()
    back = np.column_stack([np.roll(y, k)[lags:] for k in range(1, lags + 1)])
    c, *_ = np.linalg.lstsq(back, y[lags:])
    sigma = np.std(y[lags:] - back @ c)
    return lambda s: lfilter(np.append(1.0, -c), [sigma], s - s.mean())[lags:]


def nats_of_process(power):
    """Divergence of noise of such a spectrum from the nearest white one, by Whittle."""
    return 0.5 * len(power) * (np.log(np.mean(power)) - np.mean(np.log(power)))


def nats_of_outliers(sigma):
    """The same of N samples of N(0, 1) with outliers."""
    def law(x):
        return (1.0 - RATE) * norm.pdf(x) + RATE * norm.pdf(
            x, 0.0, np.hypot(1.0, sigma))
    nearest = norm(0.0, np.sqrt(1.0 + RATE * sigma**2))
    return 2.0 * N * quad(lambda x: law(x) * (np.log(law(x)) - nearest.logpdf(x)), 0.0,
                          8.0 * np.hypot(1.0, sigma), limit=500)[0]


def size_of_noise(name, draw, white, size):
    """Factor of a noise that makes it of so many nats."""
    if name == "outliers":
        return brentq(lambda s: nats_of_outliers(s) - size, 1.0, 1e3) / np.abs(
            white(np.eye(1, N, N // 2)[0])).max()
    power = np.mean([np.abs(np.fft.fft(white(draw())))**2 / N for _ in range(DRAWS)], 0)
    return brentq(lambda a: nats_of_process(1.0 + a * a * power) - size, 1e-9, 1e3)


def cases():
    """(what, name, axis number, run, first sample, nats) of every diagnosis."""
    for number in range(len(AXES)):
        yield "itself", "", number, 1, SIMULATORS, 0.0
        for run in (1, 2, 3):
            for first in RECORDS:
                yield "untouched", "", number, run, first, 0.0
        yield "decoy", "", number, 2, RECORDS[0], 0.0
    for k, name in enumerate([*SHAPES, *NOISES]):
        for j, size in enumerate(NATS):
            yield "injected", name, (k + j) % len(AXES), 2, RECORDS[j % 2], size
    for number in range(len(AXES)):
        for run in (1, 2, 3):
            yield "composed", "", number, run, RECORDS[0], 0.0


def record(what, name, number, run, first, size, rng):
    """Record and columns of a case."""
    y, t = stretch(run, *AXES[number], first), DT * np.arange(N)
    if what == "decoy":
        return y, heat(rng, t)[1]
    if what != "injected":
        return y, {}
    white = whitener(y)
    if name in NOISES:
        draw = NOISES[name](rng)
        return y + size_of_noise(name, draw, white, size) * draw(), {}
    shape, columns = SHAPES[name](rng, t)
    return y + np.sqrt(2.0 * size / np.sum(white(shape)**2)) * shape, columns


def compute():
    """{case: report}; reports made before are kept."""
    kept, keep = figures.kept("real")
    simulators, result, listed = {}, {}, list(cases())
    if figures.size["trials"] < 500:
        listed = listed[:1]
    for done, case in enumerate(listed, 1):
        key = " ".join(map(str, case))
        if key not in kept:
            y, columns = record(*case, np.random.default_rng([SEED, done]))
            if case[0] == "composed":
                d = sensorlab.diagnose(y, DT, sensorid.default_hypotheses(y, DT))
                _, _, number, run, first, _ = case
                e = sensorlab.diagnose(stretch(run % 3 + 1, *AXES[number], first), DT,
                                       sensorlab.augmented(d))
                then = dict(verdict=e.verdict, before=e.before.p_value,
                            p_value=e.after.p_value)
            else:
                own = stretch(1, *AXES[case[2]], SIMULATORS)
                if case[2] not in simulators:
                    simulators[case[2]] = sensorlab.simulator_from(own[None], DT)
                d = sensorlab.diagnose(y, DT, simulators[case[2]], columns)
                then = None
            keep(key, dict(verdict=d.verdict, closed=d.closure.closed, then=then,
                           rest=d.remainder.share, p_value=d.after.p_value))
        result[case] = kept[key]
        if figures.size["progress"]:
            figures.size["progress"](done, len(listed))
    return result


def right(case, one):
    """Is a verdict what it should be? Of an untouched stretch nobody knows."""
    what, name = case[:2]
    said = one["verdict"].split("+")
    if what == "itself":
        return said == ["none"]
    if what == "decoy":
        return not {"temperature", "thermal_lag"} & set(" ".join(said).split())
    if what == "composed":
        return "unknown" not in said and one["p_value"] >= DESCRIBED
    return name in said


def describes_next(one, moved):
    """Does a sum describe the next run: as it is, or if its parameters may move?"""
    then = one["then"]
    return then["before"] >= DESCRIBED or moved and then["p_value"] >= DESCRIBED and (
        set(then["verdict"].split("+")) <= set(MOVED))


def table(result):
    lines = []
    for what, size in (("itself", 0.0), ("decoy", 0.0), ("composed", 0.0), *(
            ("injected", size) for size in NATS)):
        own = [(c, one) for c, one in result.items() if c[0] == what and c[-1] == size]
        if own:
            k = sum(right(c, one) for c, one in own)
            low, high = withheld.interval(k, len(own))
            text = f"{what}, ratio {withheld.ratio(size):.3g}" if size else what
            lines.append(f"{text:<20}{k:>3} of {len(own):<4}"
                         f"[{100 * low:.0f}, {100 * high:.0f}] %")
    sums = [one for c, one in result.items() if c[0] == "composed"]
    for text, count in (
            ("the next run, too", lambda one: describes_next(one, False)),
            ("  or parameters move", lambda one: describes_next(one, True)),
            ("  or more is named", lambda one: one["then"]["p_value"] >= DESCRIBED)):
        k = sum(map(count, sums))
        lines += [f"{text:<20}{k:>3} of {len(sums)}"] if sums else []
    for c, one in result.items():
        then = f", then {one['then']['verdict']}" if one["then"] else ""
        lines.append(f"{' '.join(map(str, c)):<44} {one['verdict']}{then}")
    return "\n".join(lines)


def draw(result):
    own = [c for c in result if c[0] == "injected"]
    fig, ax = plt.subplots()
    names = [*SHAPES, *NOISES]
    for at, name in enumerate(names):
        for c in own:
            if c[1] == name:
                ax.plot(NATS.index(c[-1]), at, "o" if right(c, result[c]) else "x",
                        color=AFTER if right(c, result[c]) else BEFORE, markersize=9)
    ax.set_yticks(range(len(names)), names)
    ax.plot([], [], "o", color=AFTER, markersize=9, label="in the verdict")
    ax.plot([], [], "x", color=BEFORE, markersize=9, label="not")
    ax.set_xticks(range(len(NATS)), [f"{withheld.ratio(size):.2g}" for size in NATS])
    ax.set(xlim=(-0.3, len(NATS) - 0.7), xlabel="signal-to-noise ratio of the effect "
           "at a matched filter, in a real stretch")
    legend_above(ax)
    return fig


def main():
    if not REAL.is_dir():
        print("real: the recordings are not beside this checkout: no figure")
        return
    result = compute()
    print(table(result))
    save(draw(result), "real")
