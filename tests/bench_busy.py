"""pytest tests/bench_busy.py --benchmark-enable -n 0: what a busy neighbour costs.

All cores but one are kept busy by other processes. Quiet and busy rounds take turns;
the fastest of each count. One core of two is at best half of the machine, and the
scheduler is not perfect: 2.2 times the quiet time is allowed. Threads that spin while
they wait need 20 times as long, see OMP_WAIT_POLICY in `sensorid`.
"""

import contextlib
import os
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import DT, MODEL, RATES

import sensorid as s
import sensorlab

Y = s.simulate(MODEL, DT, 2000, seed=4).error[0]
WORK = {
    "identify": lambda y: s.identify(y, DT, MODEL),
    "identify, four axes": lambda y: s.identify(y, DT, s.default_hypotheses(
        y, DT, ["two_markov"])),
    "aic": lambda y: sensorlab.ALGORITHMS["aic"](y, DT, MODEL),
    "diagnose": lambda y: sensorlab.diagnose(y, DT, MODEL)}


@contextlib.contextmanager
def neighbours():
    """Processes that keep all cores but one busy."""
    started = [subprocess.Popen([sys.executable, "-c", "while True: pass"])
               for _ in range(os.cpu_count() - 1)]
    try:
        time.sleep(0.2)
        yield
    finally:
        for one in started:
            one.kill()
            one.wait()


def seconds(work):
    """Of work on a record that was not seen before: some answers are kept."""
    y = Y + 1e-6 * np.random.default_rng().standard_normal()
    started = time.perf_counter()
    work(y)
    return time.perf_counter() - started


@pytest.mark.skipif(os.cpu_count() < 2, reason="one core has no neighbour")
@pytest.mark.parametrize("name", WORK)
def test_a_busy_neighbour(benchmark, name):
    if not benchmark.enabled:
        pytest.skip("a benchmark")
    work, quiet, busy = WORK[name], [], []
    seconds(work)    # compiles
    for _ in range(12):
        quiet.append(seconds(work))
        with neighbours():
            busy.append(seconds(work))
    benchmark.pedantic(seconds, (work,), rounds=1)
    RATES[f"{name}, 2000 samples, quiet, s"] = min(quiet)
    RATES[f"{name}, 2000 samples, busy, s"] = min(busy)
    assert min(busy) < 2.2 * min(quiet)
