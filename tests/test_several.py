"""Many records in one go."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import sensorid
import sensorlab
from sensorlab.commands import main
from sensorlab.several import Several, common, pool, tables
from sensorlab.several.index import index
from sensorlab.several.work import Row

N = 600


@pytest.fixture
def imu(tmp_path, monkeypatch):
    """An IMU with one vibration on all axes, and one file that is none."""
    monkeypatch.chdir(tmp_path)
    rng, t = np.random.default_rng(5), 0.01 * np.arange(N)
    wave = np.sin(2.0 * np.pi * 7.3 * t[:, None] + np.arange(3))
    gyro, accel = rng.standard_normal((2, N, 3)) + wave
    np.savetxt("imu.csv", np.column_stack([t, gyro, accel, t**2]), delimiter=",",
               header="time,gx,gy,gz,ax,ay,az,humidity", comments="")
    pathlib.Path("bad.csv").write_text("time,gx\n0,1\n")
    return tmp_path


def answers(*names):
    return [json.loads(pathlib.Path(name).read_text()) for name in names]


@pytest.mark.thorough
def test_a_whole_imu_is_identified_in_one_command(imu, capsys):
    assert main("identify imu.csv --channel all --json o.json --csv o.csv --plot o.png "
                "--save-model m.json --unit deg/s,mg".split()) == 0
    said = capsys.readouterr().out
    assert said.count("10 ms from time") == 1 and "velocity random walk" in said
    (result,) = answers("o.json")
    assert [r["name"] for r in result["records"]] == "gx gy gz ax ay az".split()
    assert [r["unit"] for r in result["records"]] == ["deg/s"] * 3 + ["mg"] * 3
    assert pathlib.Path("o.csv").read_text().count("\n") == 7
    assert pathlib.Path("o.png").read_bytes()[:4] == b"\x89PNG"
    assert main("identify imu.csv --channel az --unit mg --json a.json".split()) == 0
    (alone,) = answers("a.json")
    assert alone.items() <= result["records"][5].items()
    assert sensorlab.read_model("m.az.json").unit == "mg"


@pytest.mark.thorough
def test_a_whole_imu_is_diagnosed_in_one_command(imu, capsys):
    for number in (1, 2):
        assert main(f"diagnose imu.csv --channel gx,ax --workers {number} --out "
                    f"d{number}".split()) == 0
        said = capsys.readouterr().out
        assert "gx, ax: 600 samples, dt 10 ms from time; beside it: humidity" in said
        assert "other axes are no covariates" in said
        assert "common to gx, ax: sinusoid frequency 7.3" in said
    assert {f.name for f in pathlib.Path("d1").iterdir()} == {
        "report.json", "report.png", "table.csv", "model.gx.json", "model.ax.json",
        "report.html", "report.gx.html", "report.ax.html"}
    index = pathlib.Path("d1/report.html").read_text()
    for name in ("gx", "ax"):    # what leads there leads back
        assert f'<a href="report.{name}.html">{name}</a>' in index
        page = pathlib.Path(f"d1/report.{name}.html").read_text()
        assert '<a href="report.html">all records</a>' in page
        assert "The simulator lacks" in page
    assert "2 differ from it" in index and "sinusoid frequency 7.3" in index
    one, two = answers("d1/report.json", "d2/report.json")
    assert one == two    # the same bits by any number of workers
    assert [r["verdict"] for r in one["records"]] == ["sinusoid", "sinusoid"]
    assert one["common"][0]["records"] == ["gx", "ax"]


@pytest.mark.large
def test_a_bad_record_does_not_cost_the_others(imu, capsys):
    line = "identify imu.csv bad.csv none.csv --channel gx --csv o.csv"
    assert main(line.split()) == 2
    said, error = capsys.readouterr()
    assert error == "sensorid: 2 of 3 records gave no answer: bad, none\n"
    assert "bad     no answer" in said and "no such file" in said
    assert "the record has 1 samples" in pathlib.Path("o.csv").read_text()
    os.unlink("o.csv")
    assert main("identify . --channel gx".split()) == 2
    assert "1 of 2 records gave no answer: bad" in capsys.readouterr().err
    os.mkdir("empty")
    assert main(["identify", "empty"]) == 2
    assert "empty: no record in this folder" in capsys.readouterr().err


def test_what_is_wrong_with_all_is_said_once(imu, capsys):
    assert main("identify imu.csv --channel all --unit m".split()) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "neither an angular rate" in error


@pytest.mark.thorough
def test_finished_records_are_found_again(imu):
    records = sensorlab.read_axes("imu.csv", "gx,gy")
    first = sensorlab.identify_many(records, checkpoint="kept")
    files = sorted(pathlib.Path("kept").iterdir())
    assert len(files) == 2
    files[0].write_text("{")    # damaged: made again
    times = [f.stat().st_mtime_ns for f in files]
    again = sensorlab.identify_many(records, checkpoint="kept")
    assert again == first == sensorlab.identify_many(records)
    assert [f.stat().st_mtime_ns == t for f, t in zip(files, times)] == [False, True]
    other = [r._replace(error=2.0 * r.error) for r in records]
    sensorlab.identify_many(other, checkpoint="kept")
    assert len(list(pathlib.Path("kept").iterdir())) == 4


def test_what_is_undecided_is_told_in_the_table():
    hypotheses = [
        sensorid.hypothesis("random_walk", sigma_w=(0.01, 0.1), sigma_v=(0.3, 1.0)),
        sensorid.hypothesis("markov", tau_m=(100.0, 1000.0), sigma_m=(0.1, 1.0),
                            sigma_v=(0.3, 1.0))]
    several = sensorlab.identify_many(
        [sensorlab.Recording("r", str(k), y, 0.1) for k, y in enumerate(
            sensorid.simulate(hypotheses, 0.1, 300, 3, seed=1).error)], hypotheses)
    decided = [row.answer["decision"] is not None for row in several.rows]
    assert {*decided} == {True, False}
    *_, table = tables.told(several)
    assert ["undecided" not in cells[-1] for cells in table.rows] == decided


@pytest.mark.large
def test_many_records_give_a_table(imu):
    frame = sensorlab.identify_many(["bad.csv", *sensorlab.read_axes("imu.csv")]).frame
    assert [*frame.problem.astype(bool)] == [True] + 6 * [False]
    assert {"file", "column", "hypothesis", "probability", "sigma_v", "sigma_v_sd",
            "described"} <= {*frame.columns}


def test_what_is_our_own_mistake_is_named_in_the_row(imu, monkeypatch):
    monkeypatch.setattr("sensorlab.several.work.identify", lambda *_: {}["nothing"])
    (row,) = sensorlab.identify_many(sensorlab.read_axes("imu.csv", "gx")).rows
    assert row.problem == "KeyError: 'nothing'"


def threads():
    import numba
    return numba.get_num_threads(), os.environ["OPENBLAS_NUM_THREADS"]


def refused():
    raise SystemExit


def test_workers_share_the_cores(monkeypatch):
    monkeypatch.setattr(pool, "cores", lambda: 2)
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with pool.workers(2) as executor:
        assert executor.submit(threads).result() == (1, "1")
        started = pool.multiprocessing.active_children()
    assert len(started) >= 2 and "OPENBLAS_NUM_THREADS" not in os.environ
    with pool.workers(1) as none:
        assert none is None


@pytest.mark.thorough
def test_a_broken_pool_costs_nothing(imu):
    records = sensorlab.read_axes("imu.csv", "gx,gy")
    with ProcessPoolExecutor(1, pool.multiprocessing.get_context("spawn"),
                             refused) as executor:
        broken = sensorlab.identify_many(records, executor=executor)
    assert broken == sensorlab.identify_many(records)


@pytest.mark.large
def test_an_interrupt_leaves_what_is_finished_and_no_process(imu):
    line = [sys.executable, sensorid.__file__, *"diagnose imu.csv --channel all "
            "--checkpoint kept --workers 2".split()]
    started = subprocess.Popen(line, stderr=subprocess.PIPE, text=True)
    kept = pathlib.Path("kept")
    while not (kept.is_dir() and any(kept.iterdir())) and started.poll() is None:
        time.sleep(0.02)
    started.send_signal(signal.SIGINT)
    error = started.communicate()[1]
    assert error.startswith("sensorid: interrupted; what is finished is kept in kept")
    assert error.count("\n") == 1


def row(name, *found):
    return Row("r.csv", name, answer=dict(record=dict(samples=1000, dt=0.01), found=[
        dict(effect=effect, column=column, parameters={
            symbol: dict(mean=mean, sd=sd) for symbol, (mean, sd) in values.items()})
        for effect, column, values in found]))


def test_what_axes_share_is_named_once():
    wave = dict(frequency=(5.0, 0.001), amplitude=(1.0, 0.1))
    near = dict(frequency=(5.02, 0.001), amplitude=(7.0, 0.1))    # within 1 / duration
    far = dict(frequency=(5.5, 0.001), amplitude=(1.0, 0.1))
    heat = "temperature", "temperature", dict(coefficient=(1.0, 0.1))
    ramp = "rate_ramp", None, dict(slope=(1.0, 0.1))    # nothing says it is the same
    lsb = "quantization", None, dict(lsb=(0.05, None))
    found = common([
        row("x", ("sinusoid", None, wave), heat, ramp, lsb),
        row("y", ("sinusoid", None, near), ramp, lsb),
        row("z", ("sinusoid", None, far), heat, ramp)])
    assert {(c.effect, c.records) for c in found} == {
        ("sinusoid", (0, 1)), ("temperature", (0, 2)), ("quantization", (0, 1))}
    (wave,) = [c for c in found if c.effect == "sinusoid"]
    assert wave.parameters == dict(frequency=dict(
        mean=pytest.approx(5.01), sd=pytest.approx(0.001 / np.sqrt(2.0))))


def test_records_are_called_by_what_differs():
    def names(*pairs):
        return tables.names([Row(*pair) for pair in pairs])
    assert names(("a.csv", "gx"), ("a.csv", "gy")) == ["gx", "gy"]
    assert names(("a.bag", "/imu/gyro/x"), ("a.bag", "/imu/acc/x")) == [
        "gyro/x", "acc/x"]
    assert names(("a.csv", "gx"), ("b.csv", "gx")) == ["a", "b"]
    assert names(("a.csv", "gx"), ("b.csv", "gy")) == ["a:gx", "b:gy"]
    assert names(("1/a.csv", "g"), ("2/a.csv", "g")) == ["1/a.csv", "2/a.csv"]


def test_a_simulator_known_by_a_recording_is_in_the_unit_of_the_record(imu, capsys):
    from sensorlab.commands import options, shared
    t = 0.01 * np.arange(2 * N)
    np.savez("sim.npz", gx=np.sin(t), error=np.ones((2, N)) * t[:N], dt=0.01)
    parsed = options.parser().parse_args(
        "diagnose imu.csv --channel gx --simulated sim.npz --scale 0.5 --average 2 "
        "--unit deg/s".split())
    (record,) = shared.read_each(parsed)
    (rows,) = shared.simulated_records(parsed, record)
    np.testing.assert_allclose(rows, 0.5 * np.sin(t).reshape(-1, 2).mean(1))
    parsed.column, parsed.average, parsed.unit = "ax", 1, "mg"
    (record,) = shared.read_each(parsed)    # no such column there: rows of error
    assert shared.simulated_records(parsed, record).shape == (2, N)
    pathlib.Path("sim.csv").write_text("time,gx [rad/s]\n" + "".join(
        f"{0.01 * k},{k % 7}\n" for k in range(99)))
    parsed = options.parser().parse_args(
        "diagnose imu.csv --channel gx --simulated sim.csv --unit deg/s".split())
    (record,) = shared.read_each(parsed)
    (rows,) = shared.simulated_records(parsed, record)
    np.testing.assert_allclose(rows[:7], np.degrees(np.arange(7)))


def test_a_page_leads_to_those_that_gave_an_answer():
    """Whatever the names are, and what is said of those that gave none."""
    answer = dict(verdict="bandwidth+unknown", record=dict(samples=9, dt=1.0),
                  gap=dict(before=2.34567, closed=0.5, closed_interval=[0.4, 0.6],
                           remainder=dict(share=None)),
                  causes=[dict(effect="none", probability=1.0)],
                  found=[dict(effect="saturation", column=None, parameters=dict(
                      limits=dict(mean=[None, 2.0], sd=None)))])
    curves = dict(tau=[1.0, 2.0], record=[1.0, 0.7])
    rows = (Row("<a>", "x", "mg", "", answer, "", curves, "dt 1 s"),
            Row("b", "x", problem="no <such> file"))
    text = index(Several(rows, ()), ["report.a b.html", "report.b.html"], "sensorid x")
    assert 'href="report.a%20b.html"' in text and "report.b.html" not in text
    assert "no &lt;such&gt; file" in text and "&lt;a&gt;</a>" in text
    assert "1 differs from it, 1 gave no answer" in text
    assert "2.35" in text and "limits -inf to 2 mg" in text
