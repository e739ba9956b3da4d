"""Simulators as files hold them."""

import json
import pathlib
import re

import numpy as np
import pytest
from jsonschema import Draft202012Validator

import sensorid as s
from sensorlab import CATALOGUE, Found, Model, Scene, Simulator
from sensorlab.modelfiles import check_onsets, model_text, read_model
from sensorlab.modelschema import schema


MODEL = dict(dt=0.5, unit="deg/h", bias_sigma=2.0, hypotheses=[
    dict(name="random_walk", parameters=dict(sigma_w=[0.1, 0.2], sigma_v=0.5)),
    dict(name="markov", prior="log",
         parameters=dict(tau_m=[1, 9], sigma_m=[0.5, 1.5], sigma_v=[0.1, 1]))])


def test_a_model_file_survives_writing_and_reading(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps(MODEL))
    model = read_model(tmp_path / "a.json")
    walk, process = model.simulator.hypotheses
    assert process.parameters[0] == s.Parameter("tau_m", 1.0, 9.0, True)
    assert walk.bias_sigma == 2.0
    (tmp_path / "b.json").write_text(model_text(model))
    assert read_model(tmp_path / "b.json") == model


def test_every_law_and_unit_survives_writing_and_reading(tmp_path):
    mixed = s.hypothesis("markov", bias_sigma=0.0, tau_m=s.Parameter("", 1, 9, True),
                         sigma_m=(0.0, 2.0), sigma_v=0.5)
    effects = (Found(CATALOGUE["saturation"], values=dict(limits=[-np.inf, 2.0])),
               Found(CATALOGUE["nonlinearity"], "rate", "modulus",
                     dict(coefficient=s.Parameter("coefficient", 1.0, 2.0, True))))
    model = Model(0.1, "\u00b5g/\u221aHz", Simulator((mixed,), (effects,)), "r.npz")
    (tmp_path / "m.json").write_text(model_text(model))
    assert read_model(tmp_path / "m.json") == model


def changed(path, value):
    """The model file with one value changed, by its path."""
    tree = json.loads(json.dumps(MODEL))
    *above, last = path
    part = tree
    for key in above:
        part = part[key]
    part[last] = value
    return tree


WALK, PARAMETERS = ("hypotheses", 0), ("hypotheses", 0, "parameters")


@pytest.mark.parametrize("text, message", [
    ("{", "not a JSON model file"), ("[]", r"the file is \[\]: it must be an object"),
    ("{}", "the file has no dt: it is needed"),
    ("[" * 100000, "not a JSON model file"),
    ('{"dt": NaN}', "NaN is no finite number"),
    ('{"dt": 1e999}', "1e999 is no finite number"),
    ('{"dt": 1' + "0" * 400 + "}", "0 is no finite number"),
    ('{"dt": 1, "dt": 2}', "the key 'dt' stands twice")])
def test_a_file_that_is_no_model_gets_one_sentence(tmp_path, text, message):
    (tmp_path / "m.json").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_model(tmp_path / "m.json")


@pytest.mark.parametrize("path, value, message", [
    (["hypotheses"], [], r"hypotheses is \[\]: at least 1 must be in it"),
    (["hypotheses"], "markov", 'hypotheses is "markov": it must be a list'),
    (["dt"], -1, "dt is -1: it must be > 0"),
    (["dt"], True, "dt is true: it must be a number"),
    (["unti"], "m", r"the file has an unknown key 'unti' \(did you mean unit\?\)"),
    (["unit"], None, "unit is null: it must be a text"),
    (["unit"], "\x1b[2J", "no control characters can be in it"),
    (["unit"], "deg\n", "no control characters can be in it"),
    (WALK, 5, r"hypotheses\[0\] is 5: it must be an object"),
    ([*WALK, "name"], "sinus", r'hypotheses\[0\].name is "sinus": it must be one of '
     '"white_noise"'),
    ([*WALK, "name"], "random_wakl", r"did you mean random_walk\?"),
    (WALK, dict(name="markov"), r"hypotheses\[0\] has no parameters"),
    ([*WALK, "label"], 5, r"hypotheses\[0\].label is 5: it must be a text"),
    ([*WALK, "prior"], "flat", 'prior is "flat": it must be one of "uniform", "log"'),
    (PARAMETERS, dict(sigma_v=1), r"hypotheses\[0\].parameters has no sigma_w"),
    ([*PARAMETERS, "model"], 1, "unknown key 'model'; known are sigma_w, sigma_v"),
    ([*PARAMETERS, "sigma_v"], -1, r"parameters.sigma_v is -1: it must be >= 0"),
    ([*PARAMETERS, "sigma_v"], [1, [2]],
     r"hypotheses\[0\].parameters.sigma_v\[1\] is \[2\]: it must be a number"),
    ([*PARAMETERS, "sigma_v"], [1, 2, 3], "at most 2 can be in it"),
    ([*PARAMETERS, "sigma_v"], [2, 1], r"hypotheses\[0\]: range .* upside down"),
    ([*PARAMETERS, "sigma_v"], dict(range=[0, 1], prior="log"), "it must be > 0"),
    (["hypotheses", 1, "label"], "random_walk", "hypotheses of the same name"),
])
def test_what_is_wrong_with_a_model_file_is_said_with_its_path(tmp_path, path, value,
                                                               message):
    (tmp_path / "m.json").write_text(json.dumps(changed(path, value)))
    with pytest.raises(ValueError, match=f"m.json: .*{message}"):
        read_model(tmp_path / "m.json")


def effect(name, column=None, variant=None, **parameters):
    return dict(name=name, column=column, variant=variant, parameters=parameters)


@pytest.mark.parametrize("effects, message", [
    ([effect("quantization", lsb=0)], "lsb is 0: it must be > 0"),
    ([effect("random_telegraph", dwell=-1, size=1)], "dwell is -1: it must be > 0"),
    ([effect("outliers", rate=7, sigma=1)], "rate is 7: it must be <= 1"),
    ([effect("saturation", limits=[2, -2])], "the low one must be below the high one"),
    ([effect("saturation", limits=[2])], "at least 2 must be in it"),
    ([effect("differential_nonlinearity", codes=[[0, 1], [1, -1]])],
     r"codes\[1\]\[1\] is -1: it must be >= 0"),
    ([effect("differential_nonlinearity", codes=[[1, 1], [1, 1]])],
     "the value of each must be above that of the one before"),
    ([effect("stuck", spans=[[-1, 5]])], r"spans\[0\]\[0\] is -1: it must be >= 0"),
    ([effect("stuck", spans=[[1, 2.5]])], "it must be a whole number"),
    ([effect("bias_step", onset=[9, 1], size=1)], r"effects\[0\]: range .* upside"),
    ([effect("outliers", rate=0.1, sigma=1)] * 2, "outliers is there twice"),
    ([effect("sinusoid", frequency=1.7, amplitude=1, phase=0)],
     "sinusoid of 1.7 Hz is above half the sampling rate of 2 Hz: .* give 0.3 Hz"),
    ([effect("nonlinearity", "rate", "bogus", coefficient=1)],
     'one of null, "", "square", "modulus"'),
    ([effect("bandwidth", None, "third order", tau=1)],
     'one of null, "", "first order", "second order"'),
    ([effect("repeated_samples", frequency=0, phase=0)],
     "frequency is 0: it must be > 0"),
    ([effect("repeated_samples", frequency=1, phase=-2)],
     "phase is -2: it must be >= 0"),
    ([effect("temperature", coefficient=1)], "column is null: it must be a text"),
    ([effect("temperature", "", coefficient=1)], "it must not be empty"),
    ([effect("temperature", "a=b", coefficient=1)], "no = and no comma"),
    ([effect("rate_ramp", "rate", slope=1)], 'column is "rate": it must be one of'),
    ([effect("wrong_parameter", factor=2)], '"wrong_parameter": it must be one of')])
def test_effects_out_of_their_domain_are_refused(tmp_path, effects, message):
    (tmp_path / "m.json").write_text(json.dumps(
        changed([*WALK, "effects"], effects)))
    with pytest.raises(ValueError, match=message):
        read_model(tmp_path / "m.json")


def test_a_sensor_may_be_polled_at_less_than_twice_its_rate(tmp_path):
    polled = effect("repeated_samples", frequency=1.34, phase=0.3)    # 2 Hz are read
    (tmp_path / "m.json").write_text(json.dumps(changed([*WALK, "effects"], [polled])))
    (one,) = read_model(tmp_path / "m.json").simulator.effects[0]
    assert one.values["frequency"] == 1.34


@pytest.mark.parametrize("late", [effect("bias_step", onset=[50, 60], size=1),
                                  effect("stuck", spans=[[1, 2], [50, 3]])])
def test_an_effect_that_starts_after_the_end_is_refused(tmp_path, late):
    (tmp_path / "m.json").write_text(json.dumps(changed([*WALK, "effects"], [late])))
    simulator = read_model(tmp_path / "m.json").simulator
    check_onsets(simulator, Scene(np.zeros(101), 0.5, {}))
    with pytest.raises(ValueError, match="starts at 50 s, but the record ends at 50 s"):
        check_onsets(simulator, Scene(np.zeros(100), 0.5, {}))


SHEET = dict(datasheet=dict(noise_density="0.05 deg/s/sqrt(Hz)"), unit="deg/s", dt=0.01)


def read_and_validated(tmp_path, tree):
    """Is a file read, and is it one by the schema?"""
    (tmp_path / "d.json").write_text(json.dumps(tree))
    try:
        read = bool(read_model(tmp_path / "d.json"))
    except ValueError:
        read = False
    return read, Draft202012Validator(schema()).is_valid(tree)


def sheet(**said):
    return dict(SHEET, datasheet=said)


def test_the_schema_knows_what_a_data_sheet_may_hold(tmp_path):
    docs = (pathlib.Path(s.__file__).parent / "docs" / "exports.md").read_text()
    (printed,) = re.findall(r'```\n({"datasheet".*?)```', docs, re.S)
    for tree in (
            SHEET, json.loads(printed), {"$schema": "model.schema.json", **SHEET},
            sheet(random_walk="0.3 deg/sqrt(h)", rate="100 Hz"),
            sheet(noise_density="1 deg/h/sqrt(Hz)", random_walk="1 deg/h/sqrt(h)"),
            dict(unit="m/s^2", datasheet=dict(
                noise_density="9 ug/sqrt(Hz)", bias_instability="9 ug", duration="2 h",
                bias="3 mg", sampling_interval="4 ms"))):
        assert read_and_validated(tmp_path, tree) == (True, True), tree


@pytest.mark.parametrize("tree", [
    dict(SHEET, datasheet=3), dict(SHEET, datasheet=None), sheet(),
    {key: value for key, value in SHEET.items() if key != "unit"},
    dict(SHEET, unit=None), dict(SHEET, unit="deg/s\x1b"), dict(SHEET, dt=0),
    dict(SHEET, dt="0.01"), dict(SHEET, bias_sigma=1.0), dict(SHEET, **MODEL),
    sheet(bandwidth="330 Hz"), sheet(noise_density=0.05), sheet(noise_density=""),
    sheet(colour="red", **SHEET["datasheet"])])
def test_the_schema_knows_what_a_data_sheet_may_not_hold(tmp_path, tree):
    assert read_and_validated(tmp_path, tree) == (False, False)


def test_the_schema_that_ships_is_the_one_that_is_used():
    """After a change: python -m sensorlab.modelschema > docs/model.schema.json"""
    shipped = pathlib.Path(s.__file__).parent / "docs" / "model.schema.json"
    assert json.loads(shipped.read_text()) == schema()
    Draft202012Validator.check_schema(schema())


@pytest.mark.parametrize("change, message", [
    (dict(dt=0), "dt is 0"), (dict(dt=float("nan")), "NaN"), (dict(dt="a"), "dt is"),
    (dict(unit=None), "unit is null"), (dict(simulator=Simulator(
        2 * (s.hypothesis("white_noise", sigma_v=1.0),))), "of the same name")])
def test_what_could_not_be_read_again_is_not_written(change, message):
    one = Simulator((s.hypothesis("white_noise", sigma_v=1.0),))
    model = Model(np.float32(0.5), "u", one)
    assert json.loads(model_text(model))["dt"] == 0.5
    with pytest.raises(ValueError, match=f"a model that no file can hold: .*{message}"):
        model_text(model._replace(**change))
