"""The smallest bad files of every kind end in one line; `data/bad/README.md` says what
is wrong with each.
"""

import os
import pathlib
import shutil

import numpy as np
import pytest

from sensorlab.commands import main

BAD = pathlib.Path(__file__).parent / "data" / "bad"

RECORDS = {
    "decimal_comma.csv": "the header has 2 names but the first row 3 cells",
    "long_cell.csv": "error holds 1 NaN or empty values, the first at sample 3",
    "underscore.csv": "line 5: '1_234.5' in column error is not a number",
    "crc.npz": "error cannot be read: Bad CRC-32",
    "object.npz": "error cannot be read: Object arrays cannot be loaded",
    "text_member.npz": "error cannot be read: it is no array",
    "npy_called.npz": "cannot be read as .npz: File is not a zip file",
    "npz_called.npy": "cannot be read as .npy: the magic string is not correct",
    "x.npy": "neither a column time nor dt",
    "segfault.mat": "the file is damaged: the library that reads it crashes"}
SIMULATED = {"sim_dtnan.npz": "the sampling interval is nan s",
             "sim_dt2.npz": "dt holds 2 numbers, not one"}
WHERE = "hypotheses[0].effects[0]."
MODELS = {
    "misspelt.json": "unknown key 'bias_sgima' (did you mean bias_sigma?)",
    "duplicate.json": "the key 'sigma_v' stands twice",
    "range_nested.json": "range_nested.json: hypotheses[0].parameters.sigma_v[1] is",
    "eff_column_eq.json": WHERE + 'column is "a=temperature"',
    "eff_column_int.json": WHERE + "column is 5: it must be a text",
    "eff_column_list.json": WHERE + 'column is ["rate"]: it must be a text',
    "eff_dwell_negative.json": WHERE + "parameters.dwell is -1: it must be > 0",
    "eff_limits_reversed.json": "the low one must be below the high one",
    "eff_lsb0.json": WHERE + "parameters.lsb is 0: it must be > 0",
    "eff_lsb_nan.json": "NaN is no finite number",
    "eff_name_list.json": WHERE + 'name is ["a"]: it must be a text',
    "eff_rate7.json": WHERE + "parameters.rate is 7: it must be <= 1",
    "eff_span_nan.json": "NaN is no finite number",
    "eff_twice.json": "outliers is there twice",
    "eff_variant.json": WHERE + 'variant is "bogus": it must be one of'}
SOUND = {"shifted_header.csv", "nanoseconds.csv", "y.npz", "unit_micro.json",
         "unit_mathtext.json", "closure_checkpoint.py", "README.md"}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez("r.npz", error=np.random.default_rng(0).normal(size=300), dt=0.1)
    return tmp_path


def test_every_bad_file_is_tested():
    listed = {*RECORDS, *SIMULATED, *MODELS, *SOUND}
    assert {file.name for file in BAD.iterdir()} == listed


@pytest.mark.parametrize("name", [*RECORDS, *SIMULATED, *MODELS])
def test_a_bad_file_ends_in_one_line(here, capsys, name):
    file = str(BAD / name)
    line, message = (
        (["identify", file, "--json", "o.json"], RECORDS[name]) if name in RECORDS else
        (["diagnose", "r.npz", "--simulated", file, "--out", "o"], SIMULATED[name])
        if name in SIMULATED else
        (["simulate", file, "--samples", "99", "--out", "s.npz"], MODELS[name]))
    assert main(line) == 2
    said = capsys.readouterr()
    assert message in said.err and said.err.count("\n") == 1 and not said.out
    assert os.listdir() == ["r.npz"]


def test_nanoseconds_are_seen_and_said(here, capsys):
    assert main(["identify", str(BAD / "nanoseconds.csv")]) == 0
    assert "40 samples, dt 10 ms from time, taken as ns" in capsys.readouterr().out


def test_a_comma_in_the_header_shifts_no_column(here, capsys):
    assert main(["identify", str(BAD / "shifted_header.csv"), "--json", "a.json"]) == 0
    text = (BAD / "shifted_header.csv").read_text()
    (here / "plain.csv").write_text(text.replace('"temp, degC"', "temp"))
    assert main(["identify", "plain.csv", "--json", "b.json"]) == 0
    a, b = (pathlib.Path(f).read_text().partition('"samples"')[2]
            for f in ("a.json", "b.json"))
    assert a == b


@pytest.mark.parametrize("name", ["unit_micro.json", "unit_mathtext.json"])
def test_any_unit_can_be_drawn(here, name):
    shutil.copy(BAD / name, "m.json")
    assert main("identify r.npz --model m.json --plot p.png".split()) == 0
    assert (here / "p.png").stat().st_size > 10000
