"""What comes from outside while a command runs: interrupts, closed pipes, full disks,
terminals without letters.
"""

import errno
import json
import os
import pathlib
import signal
import stat
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from numba import njit
from numba.core.caching import Cache

import sensorid
from sensorid import write_whole
from sensorlab.commands import cache, main
from sensorlab.commands import identify as command

MODEL = dict(dt=1.0, unit="\u00b5g/\u221aHz", hypotheses=[
    dict(name="white_noise", parameters=dict(sigma_v=[0.5, 2.0]))])
IDENTIFY = "identify r.npz --model m.json --json o.json".split()


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez("r.npz", error=np.random.default_rng(0).normal(size=300), dt=1.0)
    pathlib.Path("m.json").write_text(json.dumps(MODEL))
    return tmp_path


def run(shell, **options):
    line = " ".join([sys.executable, sensorid.__file__, *IDENTIFY])
    return subprocess.run(["bash", "-c", shell.replace("COMMAND", line)],
                          capture_output=True, text=True, **options)


@pytest.mark.large
@pytest.mark.parametrize("shell, status", [
    ("PYTHONIOENCODING=ascii COMMAND", 0), ("COMMAND >&-", 0),
    ("COMMAND | true; exit ${PIPESTATUS[0]}", 141), ("COMMAND > /dev/full", 2)])
def test_an_output_that_cannot_be_printed_loses_nothing(here, shell, status):
    done = run(shell)
    assert done.returncode == status and done.stderr.count("\n") == (status == 2)
    assert json.loads((here / "o.json").read_text())["hypotheses"]
    if "ascii" in shell:
        assert "\\xb5g/\\u221aHz" in done.stdout


@pytest.mark.large
def test_an_answer_goes_through_a_pipe(here):
    done = run("COMMAND --json /dev/stdout | cat")
    assert done.returncode == 0 and not done.stderr
    assert '"hypotheses"' in done.stdout


def test_an_answer_is_no_model_and_says_what_is(here, capsys):
    assert main("identify r.npz --json o.json".split()) == 0
    assert main("diagnose r.npz --model o.json".split()) == 2
    assert "o.json: the file is what a command says" in capsys.readouterr().err


@pytest.mark.parametrize("line, told", [
    ("identify r.npz --json o.json", "white_noise"),
    ("identify r.npz r.npz --json o.json", "white_noise"),
    ("identify r.npz --compose --json o.json", "component"),
    ("diagnose r.npz --out d", "verdict: none"),
    ("diagnose r.npz r.npz --out d", "none")])
def test_an_output_that_cannot_be_written_loses_no_answer(here, capsys, monkeypatch,
                                                          line, told):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")
    monkeypatch.setattr("sensorlab.commands.shared.write_whole", full)
    assert main(line.split()) == 2
    out, err = capsys.readouterr()
    assert told in out and "No space left" in err


def test_a_pipe_is_no_record_and_says_so(here):
    done = run("cat r.npz | COMMAND".replace("COMMAND", " ".join(
        [sys.executable, sensorid.__file__, "identify", "/dev/stdin"])))
    assert done.returncode == 2 and "a pipe or a device" in done.stderr


@pytest.mark.large
def test_a_name_that_is_no_unicode_is_no_obstacle(here):
    name = b"caf\xe9.npz".decode(errors="surrogateescape")
    os.rename("r.npz", name)
    done = subprocess.run([sys.executable, sensorid.__file__, "diagnose", name, "--out",
                           "d"], capture_output=True, text=True, errors="replace")
    assert done.returncode == 0, done.stderr
    assert "none" in done.stdout and (here / "d/report.html").exists()


def test_an_interrupt_ends_in_one_line(here):
    np.savez("r.npz", error=np.random.default_rng(0).normal(size=10**7).cumsum(), dt=1.)
    # by default three hypotheses, which take longer than this
    started = subprocess.Popen([sys.executable, sensorid.__file__, "identify", "r.npz"],
                               stderr=subprocess.PIPE, text=True)
    time.sleep(2.0)
    started.send_signal(signal.SIGINT)
    assert started.communicate()[1] == "sensorid: interrupted\n"
    # some libraries make Python end by the signal itself, which shells call 130 too
    assert started.returncode in (130, -signal.SIGINT)
    assert not (here / "o.json").exists()


def interrupted(options):
    signal.raise_signal(signal.SIGINT)


def compiled(options):
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt as cause:
        raise SystemError("returned a result with an exception set") from cause


def loading(options):
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise ImportError("DLL load failed") from None


class Collected:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)


def collecting(options):
    Collected()    # nothing can be raised there
    time.sleep(5.0)
    pytest.fail("the interrupt is lost")


@pytest.mark.parametrize("run", [interrupted, compiled, loading, collecting])
def test_an_interrupt_is_known_whatever_becomes_of_it(here, monkeypatch, capsys, run):
    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(command, "run", run)
    assert main(IDENTIFY) == 130
    assert capsys.readouterr().err == "sensorid: interrupted\n"
    assert signal.getsignal(signal.SIGINT) is before


def test_a_request_to_end_leaves_no_part_of_a_file(here, monkeypatch, capsys):
    def ended(stream):
        stream.write(b"a part")
        signal.raise_signal(signal.SIGTERM)
    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(command, "run", lambda options: write_whole("o.json", ended))
    files = os.listdir()
    assert main(IDENTIFY) == 143
    assert capsys.readouterr().err == "sensorid: told to end\n"
    assert os.listdir() == files and signal.getsignal(signal.SIGTERM) is before


def test_what_is_our_own_mistake_is_raised(here, monkeypatch):
    monkeypatch.setattr(command, "run", lambda options: {}["nothing"])
    with pytest.raises(KeyError):
        main(IDENTIFY)


def test_commands_run_in_other_threads(here, capsys):
    status = []
    thread = threading.Thread(target=lambda: status.append(main(IDENTIFY)))
    thread.start()
    thread.join()
    assert status == [0]


def test_a_file_keeps_its_mode_and_no_other_is_touched(here):
    pathlib.Path("secret.json").write_text("old")
    os.chmod("secret.json", 0o600)
    write_whole("secret.json", lambda stream: stream.write(b"new"))
    write_whole("fresh.json", lambda stream: stream.write(b"new"))
    assert stat.S_IMODE(os.stat("secret.json").st_mode) == 0o600
    pathlib.Path("plain.json").write_text("new")
    assert os.stat("fresh.json").st_mode == os.stat("plain.json").st_mode


def test_a_temporary_file_is_a_new_one(here, monkeypatch):
    pathlib.Path("target").write_text("precious")
    os.symlink("target", ".o.json.0000")
    monkeypatch.setattr(sensorid.secrets, "token_hex", lambda bytes: "0000")
    with pytest.raises(FileExistsError):
        write_whole("o.json", lambda stream: stream.write(b"new"))
    assert pathlib.Path("target").read_text() == "precious"
    assert os.path.islink(".o.json.0000") and not os.path.exists("o.json")


def test_a_full_disk_costs_the_compiled_code_not_the_result(monkeypatch, capsys):
    def full(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")
    monkeypatch.setattr(Cache, "_save_overload", full)
    monkeypatch.setattr(Cache, "_load_overload", full)
    monkeypatch.setattr(cache, "said", [])

    @njit(cache=True)
    def twice(x):
        return 2.0 * x
    assert twice(3.0) == 6.0
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "No space left on device): going on" in error


def test_a_cache_that_cannot_be_written_is_told(monkeypatch, capsys):
    monkeypatch.setattr(cache, "said", [])
    monkeypatch.setattr(cache, "CACHE", False)
    cache.forgive()
    assert "no folder for it can be written" in capsys.readouterr().err
