"""Whatever a file holds, it is a record or a sentence: no traceback, no hang.

SENSORID_EXAMPLES=10000 tries as many in every test.
"""

import io
import json
import math
import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from sensorid import MIN_SAMPLES
from sensorlab import CATALOGUE, Scene, Recording, read
from sensorlab.modelfiles import Model, model_text, read_model
from sensorlab.modelschema import model_file, problem

pytestmark = pytest.mark.filterwarnings("error")
fuzzed = settings(
    max_examples=int(os.environ.get("SENSORID_EXAMPLES", 60)), deadline=None,
    database=None, derandomize="SENSORID_EXAMPLES" not in os.environ,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow,
                           HealthCheck.data_too_large, HealthCheck.filter_too_much])


def is_sound(record):
    """A record that the rest can work with."""
    assert isinstance(record, Recording) and record.dt > 0.0
    assert record.error.ndim == 1 and not np.isinf(record.error).any()
    assert (~np.isnan(record.error)).sum() >= MIN_SAMPLES
    assert all(x.shape == record.error.shape for x in record.columns.values())
    assert record.heading.isprintable()


def read_or_sentence(source, *arguments, **options):
    """Nothing but a sound record or one sentence comes out."""
    try:
        record = read(source, *arguments, **options)
    except ValueError as refused:
        assert str(refused) and "Traceback" not in str(refused)
        return None
    is_sound(record)
    return record


CELLS = st.one_of(
    st.floats().map(str), st.integers().map(str), st.floats(-9, 9).map("{:.3f}".format),
    st.sampled_from(["", "NA", "nan", "inf", "-", "1_0", "0x1", "1,5", "1.5.2", '"',
                     "#", "2026-01-31T00:00:00", "1e999", "\u2212 1", "1d3", " 1 "]),
    st.text(max_size=5))
NAMES = st.one_of(st.sampled_from(["time", "error", "t [us]", "TimeUS", "temperature",
                                   "error [deg/h]", '"error"', "#time", ""]),
                  st.text(max_size=6))


@st.composite
def texts(draw):
    """Tables with a few wrong cells, rows and lines."""
    separator = draw(st.sampled_from([",", ";", "\t", " ", "|", ", "]))
    width = draw(st.integers(1, 4))
    names = draw(st.lists(NAMES, min_size=width, max_size=width))
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    rows = [[f"{k * 10}", *(f"{v:.3f}" for v in rng.normal(size=width - 1))]
            for k in range(draw(st.integers(0, 40)))]
    for _ in range(draw(st.integers(0, 3)) if rows else 0):
        row = draw(st.sampled_from(rows))
        row[draw(st.integers(0, max(len(row) - 1, 0)))] = draw(CELLS) if row else ""
        if draw(st.booleans()):
            row.append(draw(CELLS))
    lines = [separator.join(names), *(separator.join(row) for row in rows)]
    for _ in range(draw(st.integers(0, 2))):
        lines.insert(draw(st.integers(0, len(lines))), draw(st.text(max_size=20)))
    return draw(st.sampled_from(["\n", "\r\n"])).join(lines)


@fuzzed
@given(content=texts(), missing=st.booleans(), resample=st.booleans())
def test_any_table_is_a_record_or_a_sentence(tmp_path, content, missing, resample):
    (tmp_path / "r.csv").write_bytes(content.encode(errors="surrogatepass"))
    read_or_sentence(tmp_path / "r.csv", allow_missing=missing, resample=resample,
                     beside=None)


@fuzzed
@given(content=st.binary(max_size=300),
       kind=st.sampled_from([".csv", ".npy", ".npz", ".gz", ".txt", ".xz"]))
def test_any_bytes_are_a_record_or_a_sentence(tmp_path, content, kind):
    (tmp_path / f"r{kind}").write_bytes(content)
    read_or_sentence(tmp_path / f"r{kind}")


@fuzzed
@given(values=st.lists(st.floats(width=32) | st.integers(-9, 9), min_size=MIN_SAMPLES,
                       max_size=40),
       separator=st.sampled_from([",", ";", "\t", " ", "|"]), comma=st.booleans(),
       step=st.sampled_from([0.001, 0.02, 1.0, 60.0]))
def test_what_is_written_is_what_is_read(tmp_path, values, separator, comma, step):
    comma = comma and separator != ","
    text = "".join(f"{k * step}{separator}{v}\n".replace(".", "," if comma else ".")
                   for k, v in enumerate(values))
    (tmp_path / "r.csv").write_text(f"time{separator}error\n{text}")
    record = read_or_sentence(tmp_path / "r.csv", allow_missing=True)
    seen = np.array(values, float)
    if record is None:
        assert (np.isinf(seen).any() or len(set(seen[~np.isnan(seen)])) < 2
                or (~np.isnan(seen)).sum() < MIN_SAMPLES)
    else:
        # pandas before 3 may miss the last digit
        np.testing.assert_allclose(record.error, seen, rtol=1e-15, atol=0.0)
        assert record.dt == pytest.approx(step)


@st.composite
def damaged(draw):
    """A sound .npz or .npy with a few bytes changed or its end cut off."""
    y = np.random.default_rng(0).normal(size=40)
    stream = io.BytesIO()
    kind = draw(st.sampled_from([".npz", ".npy"]))
    if kind == ".npz":
        np.savez(stream, error=y, time=np.arange(40.0), gyro=np.stack([y, y, y]))
    else:
        np.save(stream, y)
    content = bytearray(stream.getvalue())
    for _ in range(draw(st.integers(0, 4))):
        content[draw(st.integers(0, len(content) - 1))] = draw(st.integers(0, 255))
    return kind, bytes(content[:draw(st.integers(0, len(content)))
                               if draw(st.booleans()) else None])


@fuzzed
@given(file=damaged(), dt=st.none() | st.floats())
def test_a_damaged_array_is_a_record_or_a_sentence(tmp_path, file, dt):
    kind, content = file
    (tmp_path / f"r{kind}").write_bytes(content)
    read_or_sentence(tmp_path / f"r{kind}", dt=dt, allow_missing=True, beside=None)


ARRAYS = st.dictionaries(
    st.sampled_from(["error", "time", "dt", "t [ns]", "gyro", "temperature"]),
    st.builds(lambda seed, shape, kind: (
        np.random.default_rng(seed).normal(size=shape) * 1e3).astype(kind),
        st.integers(0, 9), st.lists(st.integers(0, 20), max_size=3),
        st.sampled_from(["f8", "f4", "i4", "u8", "c8", "?", "M8[ns]", "m8[s]", "S3",
                         "O"])), max_size=5)


@fuzzed
@given(arrays=ARRAYS, wanted=st.sampled_from(["error", "gyro", "gyro[1]", "a/b", "[0]",
                                              "error[99999999999999999999]", ""]))
def test_any_arrays_are_a_record_or_a_sentence(arrays, wanted):
    read_or_sentence(arrays, wanted, beside=None)


@fuzzed
@given(stamps=st.lists(st.floats() | st.integers(-2**63, 2**64 - 1), max_size=40),
       resample=st.booleans())
def test_any_stamps_are_a_clock_or_a_sentence(stamps, resample):
    y = np.random.default_rng(0).normal(size=len(stamps))
    read_or_sentence(dict(error=y, time=np.array(stamps)), resample=resample)


def nested(part):
    """Lists and objects of parts, by the keys of a model file."""
    keys = st.sampled_from(["dt", "unit", "hypotheses", "name", "parameters", "effects",
                            "sigma_v", "label", "range", "prior", "column"])
    return st.lists(part, max_size=3) | st.dictionaries(keys, part, max_size=5)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=4)
    | st.sampled_from(["markov", "white_noise", "outliers", "log", "stuck"]),
    nested, max_leaves=12)
NUMBER = st.floats(1e-6, 1e6)
ANY = Scene(np.arange(8.0), 1.0, {})
PRIOR = NUMBER | st.lists(NUMBER, min_size=2, max_size=2).map(sorted) | st.builds(
    dict, range=st.lists(NUMBER, min_size=2, max_size=2).map(sorted),
    prior=st.sampled_from(["log", "uniform"]))


@st.composite
def models(draw):
    """Model files that are sound, as far as their schema says."""
    hypotheses, dt = [], draw(NUMBER)
    below = st.floats(0.01, 0.49).map(lambda share: share / dt)
    for rest in model_file()["properties"]["hypotheses"]["items"]["allOf"]:
        if not draw(st.booleans()):
            continue
        name = rest["if"]["properties"]["name"]["const"]
        wanted = rest["then"]["properties"]["parameters"]["properties"]
        effects = [e for e in CATALOGUE.values() if e.columns and not e.column]
        hypotheses.append(dict(
            name=name, parameters={symbol: draw(PRIOR) for symbol in wanted},
            effects=[dict(name=e.name, parameters={
                symbol: draw(below if symbol == "frequency" else NUMBER) for symbol in (
                    *(p.symbol for p in e.parameters(ANY)), e.size)})
                for e in effects if draw(st.booleans())]))
    return dict(dt=dt, unit=draw(st.text("\u00b5g/hs", max_size=5)),
                hypotheses=hypotheses)


def model_or_sentence(file, tree):
    file.write_text(tree if isinstance(tree, str) else json.dumps(tree))
    try:
        model = read_model(file)
    except ValueError as refused:
        assert str(refused).startswith(str(file)) and "\n" not in str(refused)
        return None
    assert isinstance(model, Model) and math.isfinite(model.dt) and model.dt > 0.0
    return model


@fuzzed
@given(tree=JSON | st.text())
def test_any_json_is_a_model_or_a_sentence(tmp_path, tree):
    model_or_sentence(tmp_path / "m.json", tree)


@pytest.mark.large
@fuzzed
@given(tree=models(), data=st.data())
def test_a_model_survives_and_one_wrong_value_is_refused_or_sound(tmp_path, tree, data):
    model = model_or_sentence(tmp_path / "m.json", tree)
    assert (model is None) == (not tree["hypotheses"])
    if model:
        again = model_or_sentence(tmp_path / "n.json", model_text(model))
        assert again == model
    spot, key = tree, data.draw(st.sampled_from(list(tree)))
    while isinstance(spot[key], (dict, list)) and spot[key] and data.draw(
            st.booleans()):
        spot = spot[key]
        key = data.draw(st.sampled_from(list(spot) if isinstance(spot, dict)
                                        else range(len(spot))))
    spot[key] = data.draw(JSON)
    changed = model_or_sentence(tmp_path / "c.json", tree)
    assert problem(tree) is None or changed is None
