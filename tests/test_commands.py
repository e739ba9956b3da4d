"""The command line, as it is typed."""

import hashlib
import json
import os
import pathlib
import subprocess
import sys

import generator
import numpy as np
import pytest
from conftest import DT, MODEL as CASE_3

import sensorid as s
import sensorlab
from sensorlab.commands import main

MODEL = {"dt": 1.0, "bias_sigma": 1.0, "hypotheses": [
    {"name": "random_walk", "parameters": {"sigma_w": [0.04, 0.15],
                                           "sigma_v": [0.25, 1.0]}},
    {"name": "markov", "parameters": {"tau_m": [60, 1500], "sigma_m": [0.5, 1.5],
                                      "sigma_v": 0.5}}]}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.json").write_text(json.dumps(MODEL))
    h = s.hypothesis("random_walk", sigma_w=0.1, sigma_v=0.5)
    np.savez("r.npz", error=s.simulate([h], 1.0, 20000, 1, seed=1).error[0], dt=1.0)
    return tmp_path


@pytest.mark.large
@pytest.mark.parametrize("command", [
    "identify r.npz --model m.json", "identify r.npz r.npz --model m.json",
    "criteria m.json --duration 20 --trials 64",
    "plan r.npz --model m.json --trials 20 --to 2000"])
def test_a_result_goes_where_a_program_can_read_it(folder, capfd, command):
    assert main([*command.split(), "--json", "-"]) == 0
    printed = capfd.readouterr()
    assert json.loads(printed.out) and "s" in printed.err
    assert not pathlib.Path("-").exists()


def test_identify_names_the_model_and_writes_what_it_says(folder, capsys):
    assert main("identify r.npz --model m.json --json o.json --save-model b.json "
                  "--plot p.png".split()) == 0
    result = json.loads(pathlib.Path("o.json").read_text())
    assert result["decision"] == "random_walk"
    best = result["hypotheses"][0]
    assert abs(best["parameters"]["sigma_w"]["mean"] - 0.1) < 4 * best["parameters"][
        "sigma_w"]["sd"]
    assert (best["matrices"]["Phi"] == [[1, 0], [0, 1]]
            and best["matrices"]["H"] == [1, 1])
    assert best["matrices"]["Gamma"][0][0] == best["parameters"]["sigma_w"]["mean"]
    assert abs(sum(h["probability"] for h in result["hypotheses"]) - 1) < 1e-9
    assert pathlib.Path("p.png").read_bytes()[:4] == b"\x89PNG"
    assert "random_walk" in capsys.readouterr().out
    assert main("simulate b.json --like r.npz --records 2 --out s.npz".split()) == 0
    assert np.load("s.npz")["error"].shape == (2, 20000)


@pytest.mark.large
@pytest.mark.parametrize("compose", [[], ["--compose"]])
@pytest.mark.parametrize("offset", [0.0, 0.5])
def test_a_saved_model_has_the_bias_that_its_record_has(folder, compose, offset):
    y = offset + 0.07 * np.random.default_rng(8).standard_normal(2000)
    np.savez("bias.npz", error=y, dt=0.005)
    main(["identify", "bias.npz", "--save-model", "bias.json", *compose])
    (h,) = sensorlab.read_model("bias.json").simulator.hypotheses
    assert h.bias_sigma == pytest.approx(np.hypot(y.mean(), 0.07 / np.sqrt(2000)),
                                         rel=0.1)


def test_a_record_that_no_hypothesis_describes_is_told(folder, capsys):
    t = np.arange(4000)
    y = np.random.default_rng(1).normal(size=4000) + 0.8 * np.sin(t / 4)
    np.savez("sine.npz", error=y, dt=1.0)
    assert main("identify sine.npz".split()) == 0
    assert "no hypothesis describes this record" in capsys.readouterr().out
    assert main("identify r.npz".split()) == 0
    assert "no hypothesis describes this record" not in capsys.readouterr().out


@pytest.mark.large
def test_a_record_is_composed_of_what_it_needs(folder, capsys):
    rng = np.random.default_rng(1)
    y = 0.8 * np.round((rng.standard_normal(3000) + 0.4 * np.sin(
        2.0 * np.pi * 0.21 * np.arange(3000))) / 0.8)
    np.savez("q.npz", error=y, dt=1.0)
    assert main("identify q.npz --compose --json q.json --save-model q.model.json"
                .split()) == 0
    text = capsys.readouterr().out
    assert "quantization" in text and "lsb 0.8" in text
    assert "frequency 0.21" in text and "their sum describes the record" in text
    result = json.loads(pathlib.Path("q.json").read_text())
    assert {one["effect"] for one in result["found"]} == {"quantization", "sinusoid"}
    assert "sigma_v" in result["hypothesis"]["parameters"]
    assert main("diagnose q.npz --model q.model.json".split()) == 0
    assert "verdict: none" in capsys.readouterr().out
    assert main("identify q.npz --compose --hypotheses markov".split()) == 2
    assert "does nothing beside --compose" in capsys.readouterr().err


def test_a_long_record_is_cut_and_averaged(folder, capsys):
    y = np.random.default_rng(2).standard_normal(1000)
    y[:4] = np.nan
    np.savez("long.npz", error=y, dt=0.5)
    assert main("identify long.npz --allow-missing --from 100 --to 401 --average 4 "
                "--hypotheses white_noise --json l.json".split()) == 0
    assert ("150 samples, dt 500 ms; means of 4, dt 2 s; times are since 100 s"
            in capsys.readouterr().out)
    (found,) = json.loads(pathlib.Path("l.json").read_text())["hypotheses"]
    sigma = y[200:800].reshape(-1, 4).mean(1).std()
    assert found["parameters"]["sigma_v"]["mean"] == pytest.approx(sigma, rel=0.02)
    assert main("identify long.npz --allow-missing --from 600".split()) == 2
    assert "leave nothing" in capsys.readouterr().err
    for wrong, message in (("--to=-3", "not a number of seconds"),
                           ("--average=0", "not a whole number")):
        with pytest.raises(SystemExit, match="2"):
            main(["identify", "long.npz", wrong])
        assert message in capsys.readouterr().err


@pytest.mark.large
def test_a_constant_that_stands_for_lost_samples_is_told_of_and_left_out(folder,
                                                                         capsys):
    rng = np.random.default_rng(3)
    y, lost = rng.standard_normal(2000), rng.random(2000) < 0.03
    np.savez("lost.npz", error=np.where(lost, -9999.0, y), dt=0.5)
    said = (f"{lost.sum()} samples of error are -9999, unlike all others: if these "
            "were lost, --missing -9999 takes them as missing")
    assert main("identify lost.npz --hypotheses white_noise".split()) == 0
    assert said in capsys.readouterr().err
    assert main("identify lost.npz --hypotheses white_noise --missing -9999 "
                "--missing 7 --json l.json".split()) == 0
    out, err = capsys.readouterr()
    assert f"{lost.sum()} missing" in out and "unlike all others" not in err
    (found,) = json.loads(pathlib.Path("l.json").read_text())["hypotheses"]
    assert found["parameters"]["sigma_v"]["mean"] == pytest.approx(
        y[~lost].std(), rel=0.02)
    assert main("identify lost.npz --average 4".split()) == 0    # its means are of both
    assert said in capsys.readouterr().err
    value = float(y[~lost].mean())    # of many digits, in a file of another unit
    np.savez("mean.npz", error=np.where(lost, value, y), dt=0.5)
    assert main("identify mean.npz --hypotheses white_noise --scale 2".split()) == 0
    assert f"--missing {value!r} takes" in capsys.readouterr().err
    assert main("diagnose lost.npz".split()) == 0
    assert "verdict: dropouts\n" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="2"):
        main("identify lost.npz --missing nan".split())
    assert "nan is not a number" in capsys.readouterr().err


@pytest.mark.large
def test_what_stands_for_lost_samples_of_a_column_is_interpolated(folder, capsys):
    rng = np.random.default_rng(3)
    T = 20.0 + 5.0 * np.sin(np.arange(2000) / 300.0)
    y = rng.standard_normal(2000) + 0.2 * T
    np.savez("t.npz", error=y, dt=0.5, temperature=np.where(
        rng.random(2000) < 0.01, -127.0, T), rate=np.where(
            np.arange(2000) % 500 < 400, 0.0, rng.standard_normal(2000)))
    assert main("diagnose t.npz".split()) == 0
    err = capsys.readouterr().err
    assert err.count("samples of temperature are -127, unlike all others") == 1
    assert "rate" not in err
    assert main("diagnose t.npz --missing -127 --missing 0".split()) == 0
    told = capsys.readouterr()
    assert "verdict: temperature" in told.out and "unlike" not in told.err


def test_criteria_writes_curves(folder):
    assert main("criteria m.json --duration 200 --trials 40 --json c.json "
                  "--plot c.png".split()) == 0
    result = json.loads(pathlib.Path("c.json").read_text())
    assert set(result["rsd"]) == {"random_walk.sigma_w", "random_walk.sigma_v",
                                  "markov.tau_m", "markov.sigma_m"}
    assert len(result["time"]) == len(result["error_probability"]["calculated"])


@pytest.mark.large
def test_a_reader_that_has_had_enough_ends_the_command_quietly(folder):
    done = subprocess.run(
        f"{sys.executable} {s.__file__} criteria m.json --duration 20 --trials 16 | "
        "true", shell=True, text=True, capture_output=True)
    assert "ipe" not in done.stderr and "Traceback" not in done.stderr


@pytest.mark.large
def test_criteria_compare_algorithms_and_answer_targets(folder, capsys):
    assert main("criteria m.json --duration 200 --trials 32 --algorithms slopes,aic "
                  "--json c.json --plot c.png".split()) == 0
    result = json.loads(pathlib.Path("c.json").read_text())
    assert set(result["algorithms"]) == {"slopes", "aic"}
    assert set(result["algorithms"]["aic"]["efficiency"]) == set(result["rsd"])
    assert "on the same trials" in capsys.readouterr().out
    assert main("criteria m.json --duration 200 --trials 32 --target 0.3 "
                  "--target-rsd tau_m=0.01 --design sigma_v=0.1,0.5 --design dt=0.5,1 "
                  "--json t.json --csv t.csv --plot t.png".split()) == 0
    said = capsys.readouterr().out
    assert said.count("error_probability 0.3") == 4 and "not within 200" in said
    rows = pathlib.Path("t.csv").read_text().splitlines()
    assert rows[0].startswith("dt,sigma_v,label,target,duration") and len(rows) == 9
    needed = json.loads(pathlib.Path("t.json").read_text())["needed"]
    assert [n["duration"] is None for n in needed] == [False, True] * 4


@pytest.mark.parametrize("line, message", [
    ("criteria m.json --duration 50 --target 2", "0 < target < 1"),
    ("criteria m.json --duration 50 --target-rsd tau_m", "NAME"),
    ("criteria m.json --duration 50 --target 0.1 --design x=1", "dt and sigma_v"),
    ("criteria m.json --duration 50 --target 0.1 --design dt=1 --design dt=2", "once"),
    ("criteria m.json --duration 8 --target 0.1 --design dt=1,20", "0 < dt <= dur"),
    ("criteria m.json --duration 50 --csv t.csv", "--csv goes with --target"),
    ("criteria m.json --duration 50 --algorithms magic", "choose from slopes"),
    ("criteria m.json --duration 50 --target 0.1 --plot t.png", "goes with --design"),
    ("identify none.csv", "none.csv: no such file"),
    ("identify r.npz --column nope", "no column 'nope' among error"),
    ("identify r.npz --model none.json", "no such model file"),
    ("identify r.npz --hypotheses sine", "unknown hypothesis 'sine'"),
    ("identify r.npz --model m.json --dt 0.5", "but the model is for dt = 1 s"),
    ("identify r.npz --json no/such/o.json", "cannot be written"),
    (f"identify r.npz --json {300 * 'o'}.json", "cannot be written: File name too"),
    ("identify r.npz --plot p.xyz --json o.json", "a picture is one of .png"),
    ("identify r.npz --json r.npz", "is named twice"),
    ("identify r.npz --json a.json --save-model ./a.json", "is named twice"),
    ("identify r.npz --json - --csv -", "only --json can print"),
    ("export m.json --to numpy --out -", "only --json can print"),
    ("identify r.npz --hypotheses markov,markov", "named twice"),
    ("simulate m.json --like . --out s.npz", "no such file, but a folder"),
    ("criteria m.json --duration 1e300", "record less"),
    ("criteria m.json --duration 50 --checkpoint m.json", "a folder is needed"),
    ("simulate m.json --samples 99999999 --records 999 --out s.npz",
     "too large for the memory"),
    ("identify r.npz --dt 1 --resample", "--resample does nothing beside --dt"),
    ("diagnose --effects --out d", "--out does nothing beside --effects"),
    ("diagnose --effects --dt 1", "--dt goes with a record"),
    ("diagnose --effects --average 2", "--average goes with a record"),
    ("diagnose --effects --seed 1", "--seed does nothing beside --effects"),
    ("identify r.npz --compose --workers 2", "--workers does nothing beside --comp"),
    ("identify r.npz --workers 2", "--workers does nothing beside one record"),
    ("identify r.npz --csv o.csv --workers 2", "does nothing beside one record"),
    ("diagnose r.npz --workers 1 --out d", "--workers does nothing beside one record"),
    ("diagnose r.npz --workers 2 --checkpoint d", "does nothing beside one record"),
    ("simulate m.json --samples 9 --out s.csv", "s.csv: simulated records are arrays"),
    ("simulate m.json --samples 9 --dt 2 --out s.npz", "m.json is for dt = 1 s, not"),
    ("simulate m.json --samples 9 --from 2 --out s.npz", "--from goes with --like"),
    ("simulate m.json --samples 9 --average 2 --out s.npz", "--average goes with"),
    ("plan r.npz --duration 1e12", "too large for the memory"),
    ("criteria m.json --duration 50 --trials 1", "at least 16"),
])
def test_bad_input_gets_one_line_and_leaves_nothing(folder, capsys, line, message):
    before = sorted(os.listdir())
    assert main(line.split()) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert sorted(os.listdir()) == before


@pytest.mark.parametrize("line, message", [
    ("", "required"), ("identify", "required"), ("guess r.npz", "invalid choice"),
    ("simulate m.json --out s.npz", "one of the arguments --samples --like"),
    ("criteria m.json --duration long", "long is not a number of seconds > 0"),
    ("criteria m.json --duration -5", "-5 is not a number of seconds > 0"),
    ("plan r.npz --duration nan", "nan is not a number of seconds > 0"),
    ("identify r.npz --dt -1", "-1 is not a number of seconds > 0"),
    ("simulate m.json --samples 0 --out s.npz", "0 is not a whole number from 1"),
    ("criteria m.json --duration 9 --trials 1e30", "1e30 is not a whole number"),
    ("criteria m.json --duration 9 --trials " + 31 * "1", "is not a whole number"),
    ("criteria m.json --duration 9 --seed -1", "--seed"),
    ("identify r.npz --json=", "the name is empty: is a variable of the shell not set"),
    ("identify r.npz --model=", "the name is empty"),
    ("identify r.npz --unit=", "it is empty: is a variable of the shell not set"),
    ("identify r.npz --hypotheses=", "it is empty"),
    ("guess\x1b[2J", "guess\\x1b[2J")])
def test_a_bad_command_gets_one_line(folder, capsys, line, message):
    with pytest.raises(SystemExit) as stop:
        main(line.split())
    error = capsys.readouterr().err
    assert stop.value.code == 2 and error.count("\n") == 1 and message in error


def test_the_version_is_told(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--version"])
    assert stop.value.code == 0
    assert capsys.readouterr().out == f"sensorid {s.__version__}\n"


def test_a_prior_that_excludes_the_truth_is_told(folder, capsys):
    wide = {"dt": 1.0, "hypotheses": [{"name": "random_walk", "parameters": {
        "sigma_w": [1, 3], "sigma_v": [0.1, 1]}}]}
    pathlib.Path("w.json").write_text(json.dumps(wide))
    assert main("identify r.npz --model w.json --json o.json".split()) == 0
    assert "low end of its range: widen the prior" in capsys.readouterr().out
    (best,) = json.loads(pathlib.Path("o.json").read_text())["hypotheses"]
    assert abs(best["parameters"]["sigma_w"]["mean"] - 1.0) < 1e-3


def test_a_saved_model_keeps_law_and_unit_and_is_known_as_a_posterior(folder, capsys):
    tree = {"dt": 1.0, "unit": "deg/h", "bias_sigma": 2.0, "hypotheses": [
        {"name": "random_walk", "prior": "log",
         "parameters": {"sigma_w": [0.01, 1], "sigma_v": [0.1, 1]}}]}
    pathlib.Path("l.json").write_text(json.dumps(tree))
    assert main("identify r.npz --model l.json --save-model b.json".split()) == 0
    saved = sensorlab.read_model("b.json")
    (h,) = saved.simulator.hypotheses
    assert all(p.log and p.free for p in h.parameters) and h.bias_sigma == 2.0
    assert (saved.unit, saved.posterior_of) == ("deg/h", "r.npz")
    for target in ("", " --target-rsd sigma_w=0.9"):
        assert main(f"criteria b.json --duration 50 --trials 16{target}".split()) == 0
        assert "b.json is the posterior of r.npz" in capsys.readouterr().out


def test_an_effect_after_the_end_of_the_record_is_refused(folder, capsys):
    late = dict(name="bias_step", parameters=dict(onset=500.0, size=1.0))
    tree = json.loads(json.dumps(MODEL))
    tree["hypotheses"] = [dict(tree["hypotheses"][0], effects=[late])]
    pathlib.Path("e.json").write_text(json.dumps(tree))
    np.savez("short.npz", error=np.load("r.npz")["error"][:400], dt=1.0)
    for line in ("simulate e.json --samples 400 --out s.npz",
                 "diagnose short.npz --model e.json"):
        assert main(line.split()) == 2
        assert "starts at 500 s, but the record ends at 400" in capsys.readouterr().err


def test_a_record_says_its_own_unit_and_clock(folder, capsys):
    y = np.load("r.npz")["error"][:300]
    pathlib.Path("r.csv").write_text("timestamp [ms],gyro [deg/s]\n" + "".join(
        f"{10 * k},{v}\n" for k, v in enumerate(y)))
    assert main("identify r.csv --channel gyro".split()) == 0
    said = capsys.readouterr().out
    assert said.startswith("r.csv, column gyro [deg/s]: 300 samples, dt 10 ms from "
                           "timestamp [ms], 3 s; 0 missing\n")
    assert " deg/s" in said.splitlines()[2]


def test_missing_samples_raise_no_false_alarm(folder, capsys):
    rng = np.random.default_rng(3)
    y = rng.normal(size=4000)
    y[rng.random(4000) < 0.3] = np.nan
    np.savez("g.npz", error=y, dt=0.1)
    assert main("identify g.npz --allow-missing --plot p.png".split()) == 0
    assert "no hypothesis describes" not in capsys.readouterr().out
    y = np.full(4000, np.nan)
    y[1000::3] = rng.normal(size=1000)
    np.savez("h.npz", error=y, dt=0.1)
    assert main("identify h.npz --allow-missing --plot p.png".split()) == 0


def test_a_large_offset_changes_nothing(folder, capsys):
    y = np.load("r.npz")["error"]
    for offset in (0.0, 1e9):
        np.savez("o.npz", error=y + offset, dt=1.0)
        assert main("identify o.npz --json o.json".split()) == 0
        found = json.loads(pathlib.Path("o.json").read_text())["hypotheses"][1]
        assert abs(found["parameters"]["sigma_v"]["mean"] - 0.5) < 0.02


def test_outputs_follow_no_links_and_leave_pipes_alone(folder, capsys):
    pathlib.Path("target.json").write_text("precious")
    for target in ("target.json", "none.json"):
        os.symlink(target, "link.json")
        assert main("identify r.npz --json link.json".split()) == 2
        assert "link.json is a link to" in capsys.readouterr().err
        os.unlink("link.json")
    assert pathlib.Path("target.json").read_text() == "precious"
    os.mkfifo("pipe.json")
    reader = subprocess.Popen(["cat", "pipe.json"], stdout=subprocess.PIPE)
    assert main("identify r.npz --json pipe.json".split()) == 0
    assert json.loads(reader.communicate()[0])["decision"] == "random_walk"
    assert not pathlib.Path("pipe.json").is_file()
    assert not pathlib.Path("none.json").exists()


@pytest.mark.thorough
def test_a_real_gyro_is_identified(real, tmp_path, monkeypatch, capsys):
    run = np.load(real / "adis16405_run1.npz")
    monkeypatch.chdir(tmp_path)
    np.savez("gy.npz", error=run["gyro_counts"][1] * float(run["gyro_lsb"]), dt=0.01)
    assert main("identify gy.npz --json o.json".split()) == 0
    result = json.loads(pathlib.Path("o.json").read_text())
    assert result["decision"] == "markov"
    # low-passed
    assert "no hypothesis describes this record" in capsys.readouterr().out


@pytest.mark.large
def test_diagnose_writes_what_simulate_draws(tmp_path, capsys):
    record = generator.record(600, 2, ["temperature"], level=4)
    np.savez(tmp_path / "r.npz", dt=DT, **{k: record[k] for k in (
        "error", "temperature", "rate")})
    (tmp_path / "m.json").write_text(sensorlab.model_text(
        sensorlab.Model(DT, "deg/h", sensorlab.Simulator(CASE_3))))
    folder = tmp_path / "out"
    assert main(["diagnose", str(tmp_path / "r.npz"), "--model",
                          str(tmp_path / "m.json"), "--out", str(folder)]) == 0
    table = capsys.readouterr().out
    assert "verdict: temperature" in table and "easily taken for" in table
    report = json.loads((folder / "report.json").read_text())
    assert report["verdict"] == report["causes"][0]["effect"] == "temperature"
    assert sum(c["probability"] for c in report["causes"]) == pytest.approx(1.0)
    assert (folder / "report.png").stat().st_size > 10000
    html = (folder / "report.html").read_text()
    for name in ("r.npz", "m.json"):
        assert hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() in html
    assert f"sensorid diagnose {tmp_path / 'r.npz'} --model" in html
    assert main(["simulate", str(folder / "model.json"), "--like",
                          str(tmp_path / "r.npz"), "--records", "50", "--out",
                          str(tmp_path / "s.npz")]) == 0
    drawn = np.load(tmp_path / "s.npz")["error"].mean(0)
    T = record["temperature"] - record["temperature"].mean()
    truth = record["truth"]["temperature"]["coefficient"]
    assert T @ drawn / (T @ T) == pytest.approx(truth, rel=0.3)
    np.savez(tmp_path / "other.npz", error=record["error"], dt=1.0,
             temp_degC=record["temperature"])
    simulate = ["simulate", str(folder / "model.json"), "--like",
                str(tmp_path / "other.npz"), "--out", str(tmp_path / "s.npz")]
    assert main(simulate) == 2
    assert "--covariates NAME=COLUMN" in capsys.readouterr().err
    assert main([*simulate, "--covariates", "heat=temp_degC"]) == 2
    assert "the effects of the model need temperature" in capsys.readouterr().err
    assert main([*simulate, "--covariates", "temperature=temp_degC"]) == 0
    assert main(["simulate", str(folder / "model.json"), "--samples", "100",
                          "--out", str(tmp_path / "s.npz")]) == 2
    assert "need the column temperature" in capsys.readouterr().err


def test_simulate_asks_for_every_column_that_an_effect_needs(tmp_path, capsys):
    (tmp_path / "m.json").write_text(json.dumps(dict(dt=1.0, hypotheses=[dict(
        name="white_noise", parameters=dict(sigma_v=1.0), effects=[dict(
            name="thermal_scale_factor", column="rate",
            parameters=dict(coefficient=0.01))])])))
    np.savez(tmp_path / "r.npz", error=np.random.default_rng(0).standard_normal(50),
             rate=np.arange(50.0), dt=1.0)
    simulate = ["simulate", str(tmp_path / "m.json"), "--out", str(tmp_path / "s.npz")]
    assert main([*simulate, "--samples", "50"]) == 2
    assert "need the columns rate, temperature" in capsys.readouterr().err
    assert main([*simulate, "--like", str(tmp_path / "r.npz")]) == 2
    assert "no column 'temperature'" in capsys.readouterr().err


def test_diagnose_says_what_is_wrong_with_its_input(tmp_path, capsys):
    y = np.random.default_rng(0).standard_normal(300)
    np.savetxt(tmp_path / "r.csv", np.column_stack([np.arange(300.0), y]),
               delimiter=",", header="time,error", comments="")
    record = str(tmp_path / "r.csv")
    for arguments, message in (
            ([record, "--covariates", "humidity"], "no column 'humidity'"),
            ([record, "--out", record], "is a file"),
            ([record, "--simulated", str(tmp_path / "no.npz")], "no such file"),
            ([], "diagnose needs a record"),
            ([str(tmp_path / "no.csv")], "no such file")):
        assert main(["diagnose", *arguments]) == 2
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1


@pytest.mark.large
def test_a_model_with_effects_is_diagnosed_beyond_them(tmp_path, capsys):
    noise = dict(name="correlated_noise", parameters=dict(tau=9.0, sigma=0.8))
    step = dict(name="bias_step", parameters=dict(onset=700.0, size=6.0))
    walk = dict(name="random_walk", parameters=dict(sigma_w=[0.04, 0.15], sigma_v=0.5))

    def written(name, *effects):
        file = tmp_path / name
        file.write_text(json.dumps(dict(dt=1.0, hypotheses=[
            dict(walk, effects=list(own), label=f"walk {number}")
            for number, own in enumerate(effects)])))
        return str(file)
    model = written("m.json", (noise, step))
    record, out = str(tmp_path / "r.npz"), tmp_path / "out"
    assert main(["simulate", model, "--samples", "2000", "--seed", "4",
                          "--out", record]) == 0
    with np.load(record) as z:
        y = z["error"][0]
    wave = 1.0 * np.sin(0.7 * np.arange(2000))
    np.savez(record, error=y, dt=1.0)
    assert main(["diagnose", record, "--model", model]) == 0
    assert "verdict: none" in capsys.readouterr().out
    np.savez(record, error=y + wave, dt=1.0)
    assert main(["diagnose", record, "--model", model, "--out", str(out)]) == 0
    assert "verdict: sinusoid" in capsys.readouterr().out
    added = json.loads((out / "model.json").read_text())["hypotheses"][0]
    assert [e["name"] for e in added["effects"]] == [
        "bias_step", "correlated_noise", "sinusoid"]
    assert added["name"] == "random_walk" and set(added["parameters"]) == {
        "sigma_w", "sigma_v"}

    ranged = dict(step, parameters=dict(onset=[600.0, 700.0], size=3.0))
    heat = dict(name="temperature", column="temperature",
                parameters=dict(coefficient=1.0))
    for effects, message in ((((noise,), (step,)), "different effects"),
                             (((ranged,),), "has a range"),
                             (((heat,),), "needs a column temperature")):
        bad = written("bad.json", *effects)
        assert main(["diagnose", record, "--model", bad]) == 2
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1


def test_effects_are_defined_on_request(tmp_path, capsys):
    assert main(["diagnose", "--effects"]) == 0
    plain = capsys.readouterr().out
    np.savez(tmp_path / "r.npz", error=np.random.default_rng(0).standard_normal(500),
             dt=2.0)
    assert main(["diagnose", str(tmp_path / "r.npz"), "--effects"]) == 0
    there = capsys.readouterr().out
    for e in sensorlab.CATALOGUE.values():
        assert all((e.equation, e.resembles, e.experiment)), e.name
        assert f"{e.name}: {e.equation}" in plain and f"{e.name}: {e.equation}" in there
    assert "onset: uniform from 2 to 998 s" in there
    assert "onset: uniform" not in plain


@pytest.mark.large
def test_a_black_box_simulator_is_taken_by_its_records(tmp_path, capsys):
    simulated = s.simulate(CASE_3[:1], DT, 2000, 4, seed=2).error
    np.savez(tmp_path / "s.npz", error=simulated, dt=DT)
    y = s.simulate(CASE_3[:1], DT, 2000, 1, seed=9).error[0]
    np.savez(tmp_path / "r.npz", error=y + 5.0 * (np.arange(2000) > 900), dt=DT)
    assert main(["diagnose", str(tmp_path / "r.npz"), "--simulated",
                          str(tmp_path / "s.npz")]) == 0
    assert "verdict: bias_step" in capsys.readouterr().out


def test_parameters_are_quoted_as_data_sheets_do(folder, capsys):
    np.savez("counts.npz", error=np.load("r.npz")["error"] / 0.05, dt=1.0)
    assert main("identify counts.npz --scale 0.05 --unit deg/s --report deg/s/sqrt(Hz) "
                "--hypotheses random_walk --json o.json".split()) == 0
    said = capsys.readouterr().out
    assert "sigma_v = 0.5" in said
    assert "deg/s/sqrt(Hz)  N = sigma_v sqrt(dt)" in said
    white, walk = sorted(json.loads(pathlib.Path("o.json").read_text())["quoted"],
                         key=lambda q: q["symbol"])
    assert white["name"] == "angle random walk" and abs(white["mean"] - 0.5) < 0.02
    assert walk["unit"] == "deg/h/sqrt(h)"
    assert abs(walk["mean"] / 3600 / 60 - 0.1) < 0.02


@pytest.mark.large
def test_a_record_is_converted_to_the_unit_of_the_model(folder, capsys):
    pathlib.Path("h.json").write_text(json.dumps(MODEL | {"unit": "deg/s"}))
    np.savez("hours.npz", error=np.load("r.npz")["error"] * 3600, dt=1.0)
    assert main("identify hours.npz --model h.json --unit deg/h".split()) == 0
    said = capsys.readouterr().out
    assert "random_walk" in said and "deg/s" in said and "deg/sqrt(h)" in said
    assert main("diagnose hours.npz --model h.json --unit deg/h".split()) == 0
    said = capsys.readouterr().out
    assert "verdict: none" in said and "as data sheets quote it" in said


def test_the_unit_of_a_header_is_converted_and_not_contradicted(folder, capsys):
    pathlib.Path("h.json").write_text(json.dumps(MODEL | {"unit": "deg/s", "dt": 0.01}))
    y = np.load("r.npz")["error"][:600]
    np.savez("d.npz", error=y, dt=0.01)
    assert main("identify d.npz --model h.json".split()) == 0
    _, *same = capsys.readouterr().out.splitlines()
    for encoding in ("utf-8", "cp1252"):
        pathlib.Path("r.csv").write_text("time [\u00b5s],error [rad/s],ax\n" + "".join(
            f"{10000 * k},{v},{v}\n" for k, v in enumerate(np.radians(y).tolist())),
            encoding=encoding)
        for options in ("", " --unit rad/s"):
            assert main(f"identify r.csv --model h.json{options}".split()) == 0
            first, *rest = capsys.readouterr().out.splitlines()
            assert "dt 10 ms from time" in first and rest[:len(same)] == same
    for line, message in (
            ("--unit deg/s", "is in rad/s, not in deg/s: leave --unit out"),
            ("--unit mg", "is in rad/s, not in mg: leave --unit out"),
            ("--column ax --unit deg/s", "ax is an accelerometer by its name")):
        assert main(f"identify r.csv {line}".split()) == 2
        assert message in capsys.readouterr().err
    assert main("identify r.csv --unit deg/s --scale 57.2958".split()) == 0
    capsys.readouterr()


def test_a_part_ends_where_it_says_in_decimal_digits(folder):
    from sensorlab.commands import options, shared
    for last in range(1, 60):
        parsed = options.parser().parse_args(
            f"identify r.npz --dt 0.1 --to {last / 10} --from 0".split())
        (record,) = shared.read_each(parsed)
        assert len(record.error) == last


def test_a_counter_is_no_covariate(folder):
    from sensorlab import read_record
    y = np.load("r.npz")["error"][:300]
    np.savez("n.npz", error=y, packet=7 + 2 * np.arange(300), flag=np.ones(300),
             voltage=5.0 + 1e-3 * np.arange(300), dt=0.1)
    assert set(read_record("n.npz", beside=None).columns) == {"flag", "voltage"}
    assert set(read_record("n.npz", beside=("packet",)).columns) == {"packet"}


@pytest.mark.parametrize("line, message", [
    ("identify r.npz --report deg/h", "give it with --unit"),
    ("identify r.npz --unit m", "neither an angular rate nor an acceleration"),
    ("identify r.npz --scale 0", "--scale is 0"),
    ("identify r.npz --unit deg/s --report mg", "mg fits no parameter of this sensor"),
    ("diagnose r.npz --scale nan", "--scale is nan")])
def test_units_that_do_not_fit_get_one_line(folder, capsys, line, message):
    assert main(line.split()) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
