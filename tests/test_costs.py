"""What a diagnosis costs is said beforehand, and how far it has come meanwhile."""

import json
import pathlib

import numpy as np
import pytest
from conftest import WHITE
from numba import njit

import sensorlab
from sensorlab.commands import main, progress
from sensorlab.gap import costs


@pytest.fixture
def terminal(monkeypatch, capsys):
    """A function that gives what a terminal has been shown."""
    monkeypatch.setattr(progress, "looked_at", lambda: True)
    return lambda: capsys.readouterr().err


def test_memory_is_refused_before_it_is_taken(monkeypatch):
    y = np.random.default_rng(0).standard_normal(30000)
    monkeypatch.setattr(costs, "available", lambda: 4e8)
    with pytest.raises(MemoryError, match=r"30000 samples takes about 0.518 GB, 0.4 GB "
                                          r"are available: --average 10 .* --from"):
        sensorlab.diagnose(y, 1.0, WHITE)


def test_a_record_without_memory_for_it_ends_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(costs, "available", lambda: 4e8)
    np.savez("r.npz", error=np.random.default_rng(0).normal(size=30000), dt=1.0)
    assert main(["diagnose", "r.npz"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "0.518 GB" in said and "--average" in said


def test_available_memory_is_what_the_system_and_the_container_say(tmp_path):
    file = tmp_path / "meminfo"
    file.write_text("MemTotal: 8000 kB\nMemAvailable:    3000 kB\n")
    assert costs._linux(file) == 3000 * 1024
    assert costs._linux(tmp_path / "nothing") is None
    (tmp_path / "memory.current").write_text("100\n")
    for most, left in (("900\n", 800), ("50\n", 1), ("max\n", None)):
        (tmp_path / "memory.max").write_text(most)
        assert costs._of_container(tmp_path) == left
    assert 0.0 < costs.available() < 1e15


def test_without_any_word_of_the_system_all_memory_counts(monkeypatch):
    monkeypatch.setattr(costs, "_linux", lambda: None)
    monkeypatch.setattr(costs, "_of_container", lambda: None)
    monkeypatch.setattr(costs.os, "sysconf", lambda name: dict(
        SC_PHYS_PAGES=1000, SC_PAGE_SIZE=4096)[name], raising=False)
    monkeypatch.setattr(costs.os, "sysconf_names", dict(SC_PHYS_PAGES=1), raising=False)
    assert costs.available() == 4096000
    monkeypatch.delattr(costs.os, "sysconf_names")
    assert costs.available() == np.inf


def test_very_long_records_are_forewarned():
    assert costs.forewarning(10**7 - 1) == ""
    said = costs.forewarning(3 * 10**7, 1)
    assert "50 min" in said and "26 GB" in said and "--average 10" in said


@pytest.mark.large
def test_a_listener_hears_every_part_of_the_work():
    heard = []
    y = np.convolve(np.random.default_rng(1).standard_normal(304), np.ones(5), "valid")
    sensorlab.diagnose(y, 1.0, WHITE, effects=[sensorlab.CATALOGUE[name] for name in (
        "bias_step", "correlated_noise")], progress=lambda *part: heard.append(part))
    done, total, what = zip(*heard)
    assert done[0] == 0.0 and done[-1] == total[-1] and what[-1] == ""
    assert (np.diff(done) >= 0.0).all() and (np.array(done) <= total).all()
    assert {"measuring where it differs", "looking for signatures",
            "fitting correlated noise"} <= set(what)
    sensorlab.gap.costs.say("nobody listens now")
    assert len(heard) == len(done)


def test_the_line_on_a_terminal_tells_what_is_done_and_what_remains(terminal):
    now = [0.0]
    with progress.progress_line(lambda: now[0]) as show:
        show(0.0, 10.0, "measuring")
        now[0] = 40.0
        show(2.5, 10.0, "looking")
    assert terminal().split("\r")[2::2] == [
        "[....................] measuring", "[#####...............] looking, about "
        "2 min left, or more", ""]


def test_nothing_is_shown_where_nobody_looks(capsys):
    with progress.progress_line() as show:
        show(1, 2, "looking")
    progress.say_beforehand("long")
    assert capsys.readouterr().err == ""


def test_durations_in_words():
    assert [progress.in_words(s) for s in (1.0, 33.0, 150.0, 5400.0)] == [
        "5 s", "35 s", "2 min", "1.5 h"]


def test_compiling_is_said_once(terminal, monkeypatch):
    monkeypatch.setattr(progress, "said", [])
    progress.announce_compilation()
    for number in range(2):
        njit(lambda x: x + number)(1)
    assert terminal().count("compiling") == 1


@pytest.mark.large
def test_a_diagnosis_on_a_terminal_leaves_its_line_empty(tmp_path, monkeypatch,
                                                         terminal):
    monkeypatch.chdir(tmp_path)
    np.savez("r.npz", error=np.random.default_rng(0).normal(size=300), dt=1.0)
    pathlib.Path("m.json").write_text(json.dumps(dict(dt=1.0, hypotheses=[
        dict(name="white_noise", parameters=dict(sigma_v=1.0))])))
    assert main(["diagnose", "r.npz", "--model", "m.json"]) == 0
    said = terminal()
    assert "looking for signatures" in said and said.endswith(" \r")


def test_an_interrupt_has_its_line_to_itself(tmp_path, monkeypatch, terminal):
    def interrupted(*_, progress, **__):
        progress(1, 10, "fitting")
        raise KeyboardInterrupt
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sensorlab.commands.diagnose.diagnose", interrupted)
    np.savez("r.npz", error=np.random.default_rng(0).normal(size=300), dt=1.0)
    assert main(["diagnose", "r.npz"]) == 130
    assert terminal().endswith(" \rsensorid: interrupted\n")
