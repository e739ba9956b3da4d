"""Past one process: executors, killed workers, killed runs, read-only folders."""

import contextlib
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from conftest import paper_case, same

import sensorid as s
import sensorlab

RUN = dict(dt=1.0, duration=200.0, trials=300, seed=4)


@pytest.fixture(scope="module")
def serial():
    return s.criteria(paper_case(3), **RUN)


@pytest.mark.thorough
def test_a_pool_of_processes_gives_the_same_bits(serial):
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        same(serial, s.criteria(paper_case(3), **RUN, executor=pool))


@pytest.mark.thorough
def test_a_dask_cluster_gives_the_same_bits(serial):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True,
                                  dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            result = s.criteria(paper_case(3), **RUN, executor=client.get_executor())
    same(serial, result)


TWO_STATES_AND_A_BAND = """
import numpy as np, sensorid
from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.effects import Scene
from sensorlab.gap.filters import log_likelihoods
from sensorlab.gap.members import Simulator, members
y = np.random.default_rng(1).standard_normal(1500)
scene = Scene(y, 0.01, {})
h = members(Simulator(sensorid.default_hypotheses(y, 0.01, ["markov"])), scene)[0]
for name, form in ("narrow_band_noise", ""), ("bandwidth", "second order"):
    own = h.with_effect(CATALOGUE[name], form)
    u = np.random.default_rng(2).random((14, len(own.parameters)))
    theta = sensorid.at_quantiles(own.parameters, u)
    print(name, log_likelihoods(own, scene, (), theta).tobytes().hex())
"""


@pytest.mark.thorough
def test_a_process_that_compiles_gives_the_bits_of_one_that_need_not(tmp_path):
    told = [subprocess.run(
        [sys.executable, "-c", TWO_STATES_AND_A_BAND], check=True, text=True,
        capture_output=True, env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
        ).stdout for _ in range(2)]
    assert told[0] == told[1] and "narrow" in told[0]


def deadly_markov(dt, tau_m, sigma_m, sigma_v):
    """A Markov process that kills the first worker that computes it."""
    flag = pathlib.Path(os.environ["SENSORID_TEST_FLAG"])
    if os.getpid() != int(os.environ["SENSORID_TEST_MAIN"]) and not flag.exists():
        flag.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return s.markov(dt, tau_m, sigma_m, sigma_v)


@pytest.mark.large
def test_a_killed_worker_costs_its_chunk_and_nothing_else(tmp_path, monkeypatch):
    monkeypatch.setenv("SENSORID_TEST_FLAG", str(tmp_path / "killed"))
    monkeypatch.setenv("SENSORID_TEST_MAIN", str(os.getpid()))
    H = (paper_case(2)[0], s.hypothesis(
        deadly_markov, tau_m=(60, 1500), sigma_m=(0.5, 1.5), sigma_v=0.5))
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        result = s.criteria(H, **RUN, executor=pool)
    assert (tmp_path / "killed").exists()
    same(result, s.criteria(H, **RUN))


COMMAND = [sys.executable, "-m", "sensorid", "criteria", "m.json", "--duration", "300",
           "--trials", "600", "--json"]


def model_of_case_3():
    return sensorlab.model_text(sensorlab.Model(
        0.1, "u", sensorlab.Simulator(paper_case(3))))


@pytest.mark.thorough
def test_a_run_killed_with_9_resumes_with_the_same_bits(tmp_path):
    (tmp_path / "m.json").write_text(model_of_case_3())
    kept = tmp_path / "kept"
    run = subprocess.Popen([*COMMAND, "a.json", "--checkpoint", "kept"], cwd=tmp_path,
                           stdout=subprocess.DEVNULL)
    while not (kept.is_dir() and any(kept.glob("*.npz"))) and run.poll() is None:
        time.sleep(0.01)
    run.kill()
    run.wait()
    finished = {f: f.stat().st_mtime_ns for f in kept.glob("*.npz")}
    assert 1 <= len(finished) < 5
    for extra in (["a.json", "--checkpoint", "kept"], ["b.json"]):
        subprocess.run([*COMMAND, *extra], cwd=tmp_path, check=True,
                       stdout=subprocess.DEVNULL)
    assert (tmp_path / "a.json").read_text() == (tmp_path / "b.json").read_text()
    assert finished.items() <= {f: f.stat().st_mtime_ns for f in kept.iterdir()}.items()


@pytest.mark.large
def test_an_interrupt_ends_with_one_line_that_says_how_to_go_on(tmp_path):
    (tmp_path / "m.json").write_text(model_of_case_3())
    kept = tmp_path / "kept"
    run = subprocess.Popen(
        [*COMMAND, "a.json", "--checkpoint", "kept"], cwd=tmp_path, text=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        # a shell starts background work with interrupts ignored
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))
    while not (kept.is_dir() and any(kept.glob("*.npz"))) and run.poll() is None:
        time.sleep(0.01)
    while run.poll() is None:    # one that hits a destructor is lost: press again
        run.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            run.wait(1.0)
    _, error = run.communicate()
    assert run.returncode == 130 and error.count("\n") == 1
    assert "what is finished is kept in kept" in error
    assert not (tmp_path / "a.json").exists()


@pytest.mark.thorough
@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="needs /proc")
def test_memory_does_not_grow_with_trials():
    code = ("import sys, sensorid as s, conftest\n"
            "s.criteria(conftest.paper_case(2), 0.1, 1000.0, int(sys.argv[1]), 1)\n"
            "print(open('/proc/self/status').read().split('VmHWM:')[1].split()[0])\n")
    few, many = (int(subprocess.run(
        [sys.executable, "-c", code, trials], capture_output=True, text=True,
        check=True, cwd=os.path.dirname(__file__)).stdout) for trials in ("128", "768"))
    assert many < few + 60_000 and many < 1_000_000    # KiB


@pytest.mark.thorough
def test_the_module_works_where_nothing_can_be_written():
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        shutil.copy(s.__file__, folder)
        np.savez(folder / "r.npz", dt=1.0, error=s.simulate(
            [s.hypothesis("white_noise", sigma_v=1.0)], 1.0, 200).error[0])
        os.chmod(folder, 0o555)
        run = [sys.executable, "-m", "sensorid", "identify", "r.npz"]
        if os.getuid() == 0:    # nothing is read-only for root
            run = ["setpriv", "--reuid=65534", "--clear-groups", *run]
            if not shutil.which("setpriv") or subprocess.run(
                    [*run[:4], "-c", "import numba"], capture_output=True).returncode:
                pytest.skip("root, and an unprivileged user cannot run this Python")
        done = subprocess.run(run, cwd=folder, capture_output=True, text=True,
                              env={**os.environ, "HOME": "/nonexistent"})
        assert done.returncode == 0, done.stderr
        assert not (folder / "__pycache__").exists()
