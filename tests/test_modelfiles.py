"""Simulators as files hold them."""

import json

import pytest

import sensorid as s
from sensorlab.modelfiles import model_text, read_model


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


@pytest.mark.parametrize("change, message", [
    ("{", "not a JSON model file"), ("[]", "no hypotheses"), ("{}", "no hypotheses"),
    (dict(hypotheses=[]), "no hypotheses"),
    (dict(hypotheses="markov"), "must be a list"),
    (dict(dt=-1), "dt is -1 s"), (dict(dt=None), "dt is None: a number is needed"),
    (dict(hypotheses=[dict(name="sinus", parameters={})]),
     "unknown hypothesis 'sinus'"),
    (dict(hypotheses=[dict(parameters={})]), "a name and parameters are needed"),
    (dict(unit=None), "unit None must be a text"),
    (dict(hypotheses=[dict(name="markov", label=5)]), "label 5 of markov must be"),
    (dict(hypotheses=[dict(name="markov", parameters=dict(model=1))]),
     "markov has no parameter model"),
    ("[" * 100000, "not a JSON model file"),
    (dict(hypotheses=[dict(name="white_noise", parameters=dict(sigma_v=[2, 1]))]),
     "upside down"),
    (dict(hypotheses=[dict(name="white_noise", parameters=dict(sigma_v=1))] * 2),
     "hypotheses of the same name"),
])
def test_a_bad_model_file_gets_one_sentence(tmp_path, change, message):
    text = change if isinstance(change, str) else json.dumps(MODEL | change)
    (tmp_path / "m.json").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_model(tmp_path / "m.json")
