import os
import pathlib

# threads of two workers that wait for each other make a test several times slower
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.signal import butter, lfilter

import sensorid
import sensorlab
from sensorlab import Scene
from sensorlab.gap.members import Member
from sensorlab.gap.processes import ZERO
from sensorlab.readers import Recording

REAL = pathlib.Path(__file__).parent.parent.parent / "shared" / "data" / "real"


@pytest.fixture(scope="session")
def real():
    """Folder of the real recordings, which are not part of the project."""
    if not REAL.is_dir():
        pytest.skip("the real recordings are not beside this checkout")
    return REAL


def large(*values):
    """A setting of a test that only `pytest -m large` runs."""
    return pytest.param(*values, marks=pytest.mark.large)


def thorough(*values):
    """A setting of a test that only `pytest -m thorough` runs."""
    return pytest.param(*values, marks=pytest.mark.thorough)


def paper_case(number, **change):
    """The two hypotheses of Sec. 4 in case 1, 2 or 3."""
    white = {1: {}, 2: {"sigma_v": 0.5}, 3: {"sigma_v": (0.25, 1.0)}}[number]
    return (
        sensorid.hypothesis("random_walk", sigma_w=(0.04, 0.15), **white, **change),
        sensorid.hypothesis("markov", tau_m=(60.0, 1500.0), sigma_m=(0.5, 1.5), **white,
                            **change))


def same(a, b):
    """Two `Criteria` are the same to the last bit."""
    for x, y in zip((a.error_probability, *a.rsd), (b.error_probability, *b.rsd)):
        for part in x._fields:
            assert_array_equal(getattr(x, part), getattr(y, part))


DT = 1.0
MODEL = paper_case(3)
WHITE = [sensorid.hypothesis("white_noise", sigma_v=1.0)]
WHITE_OF_A_RANGE = [sensorid.hypothesis("white_noise", sigma_v=(0.5, 2.0))]


def member(scene, h, *names):
    """A hypothesis with effects of the catalogue inside its filter."""
    result = Member(h, scene)
    for name in names:
        result = result.with_effect(sensorlab.CATALOGUE[name])
    return result


def white_with(*effects, samples, seed):
    """A record of white noise, of variance 1, with effects."""
    return sensorlab.simulate_effects(
        sensorlab.Simulator(WHITE, (effects,)), Scene(np.zeros(samples), DT, {}),
        seed=seed).error[0]


def scene_of(record):
    return Scene(record["error"], DT, dict(temperature=record["temperature"],
                                           rate=record["rate"]))


def diagnosed(record, hypotheses=MODEL, **options):
    return sensorlab.diagnose(record["error"], DT, hypotheses,
                             dict(temperature=record["temperature"],
                                  rate=record["rate"]), **options)


def dense(theta, n, bias_sigma=1.0):
    """Covariance of a Markov process in white noise with a bias."""
    tau, sigma_m, sigma_v = theta
    t = np.arange(n)
    return (sigma_m**2 * np.exp(-np.abs(t[:, None] - t) / tau)
            + sigma_v**2 * np.eye(n) + bias_sigma**2)


def through_low_pass(form, tau, samples):
    """What white noise becomes by SciPy's digital Butterworth filter, but for zeros
    which are not quite at half the rate of one a second, or by an exponential average,
    as a form of bandwidth says: the response (N, N) to each of its values.
    """
    if form == "exponential":
        a = np.exp(-1.0 / tau)
        return lfilter([1.0 - a], [1.0, -a], np.eye(samples), axis=0)
    order = 1 if form == "digital first order" else 2
    b, a = butter(order, 1.0 / (np.pi * tau))
    zeros = np.poly(order * [-ZERO])
    return lfilter(b.sum() / zeros.sum() * zeros, a, np.eye(samples), axis=0)


@pytest.fixture
def short():
    """A short record with gaps, a hypothesis and the dense covariance."""
    y = sensorid.simulate(MODEL[1:], DT, 200, seed=3).error[0]
    y[50:60] = np.nan
    theta = np.array([[300.0, 0.9, 0.4]])
    seen = ~np.isnan(y)
    scene = Scene(y, DT, {})
    return scene, member(scene, MODEL[1]), theta, dense(theta[0], 200), seen


def _answer(name, y, effects, **change):
    """A diagnosis against white noise, and its recording."""
    d = sensorlab.diagnose(y, DT, WHITE, effects=[
        sensorlab.CATALOGUE[effect] for effect in effects])
    return d._replace(**change), Recording(f"{name}.csv", "gyro", y, DT, unit="mg")


@pytest.fixture(scope="session")
def answers():
    """A diagnosis with its recording for every kind of verdict."""
    rng = np.random.default_rng(4)
    y = rng.standard_normal(800)
    step, spikes = y + 1.0 * (np.arange(800) > 500), y.copy()
    spikes[::60] += 12.0 * rng.standard_normal(14)
    some = "bias_step", "outliers", "quantization"
    return dict(
        none=_answer("none", y, some), bias_step=_answer("step", step, some),
        outliers=_answer("outliers", spikes, some),
        quantization=_answer("rounded", 1.5 * np.round(y / 1.5), some),
        unknown=_answer("unknown", rng.exponential(size=800) - 1.0, ()),
        undecided=_answer("undecided", step, some, verdict="undecided",
                          needed_duration=5000.0))


RATES = {}    # filled by bench_bank.py


def pytest_terminal_summary(terminalreporter):
    """The table of the benchmark."""
    if not RATES:
        return
    terminalreporter.section("filter updates a second, or seconds")
    best = max((r for name, r in RATES.items() if name.startswith("ours")), default=0)
    for name, rate in RATES.items():
        seconds = name.endswith(", s")
        ratio = "" if seconds or not best else f"{rate / best:10.2g} of ours"
        terminalreporter.write_line(f"{name:<52}{rate:10.3g}{ratio}")
