"""Simulators as files hold them, or as their records show them."""

import json
import pathlib
from typing import NamedTuple

import numpy as np

from sensorid import MODELS, Parameter, as_parameter, hypothesis
from sensorlab.foreign import translated
from sensorlab.foreign.parts import FOREIGN
from sensorlab.gap.catalogue import CATALOGUE, is_known
from sensorlab.gap.effects import Found
from sensorlab.gap.lowpass import LowPass
from sensorlab.gap.members import Simulator
from sensorlab.modelschema import parsed, problem


class Model(NamedTuple):
    """A model file: a simulator, or hypotheses and their priors."""

    dt: float    # s
    unit: str
    simulator: Simulator
    posterior_of: str = ""    # the record that its ranges come from, if one


def read_model(file, dt=None):
    """Model from a JSON file, a data sheet or another program's file; see
    `sensorlab.foreign` for the latter, and for `dt`.

    The file holds `dt`, s, optionally `unit`, `bias_sigma` (as for
    `sensorid.hypothesis`) and `prior` ("uniform" or "log"), and `hypotheses`: a list of
    `name`, a name in MODELS, and `parameters`, each a number, a range [low, high] or an
    object of `range` and `prior`; optionally
    `label`, `prior`, `bias_sigma` and `effects`: a list of `name`, a name in CATALOGUE,
    `parameters` and, where the effect needs one, `column`. `modelschema.schema` says it
    all.

    Raises
    ------
    ValueError
        With one sentence on what is wrong with the file, and where.
    """
    tree = translated(file, dt)
    file = pathlib.Path(file)
    if tree is None:
        tree = _json(file)
    try:
        return _model_from(tree)
    except ValueError as wrong:
        raise ValueError(f"{file}: {wrong}") from None


def _model_from(tree):
    """Model from the content of a model file."""
    wrong = problem(tree)
    if wrong:
        raise ValueError(wrong)
    pairs = [_hypothesis_from(f"hypotheses[{k}]", entry, tree)
             for k, entry in enumerate(tree["hypotheses"])]
    names = [h.name for h, _ in pairs]
    if len(set(names)) < len(names):
        raise ValueError(f"hypotheses of the same name among {', '.join(names)}: "
                         "give each a \"label\" of its own")
    _check_frequencies(pairs, float(tree["dt"]))
    hypotheses, effects = zip(*pairs)
    return Model(float(tree["dt"]), tree.get("unit", "u"),
                 Simulator(hypotheses, effects if any(effects) else ()),
                 tree.get("posterior_of", ""))


def _json(file):
    """Content of a JSON model file."""
    if not file.is_file():
        raise ValueError(f"{file}: no such model file")
    try:
        return parsed(file.read_text(encoding="utf-8-sig"))
    except (ValueError, OSError, RecursionError) as wrong:
        raise ValueError(f"{file}: not a JSON model file: {wrong}") from None


def _hypothesis_from(where, entry, tree):
    """One hypothesis of a model file and its effects."""
    try:
        h = hypothesis(FOREIGN.get(entry["name"], entry["name"]),
                       name=entry.get("label"),
                       bias_sigma=entry.get("bias_sigma", tree.get("bias_sigma")),
                       prior=entry.get("prior", tree.get("prior", "uniform")),
                       **{symbol: _prior(value) for symbol, value
                          in entry.get("parameters", {}).items()})
    except ValueError as wrong:
        raise ValueError(f"{where}: {wrong}") from None
    effects = []
    for k, part in enumerate(entry.get("effects") or ()):
        try:
            effects.append(_effect_from(part))
        except ValueError as wrong:
            raise ValueError(f"{where}.effects[{k}]: {wrong}") from None
        if any(one.effect == effects[-1].effect for one in effects[:-1]
               if not one.effect.may_repeat):
            raise ValueError(f"{where}.effects[{k}]: {part['name']} is there twice: "
                             "once is all that it can be")
    return h, tuple(effects)


def _check_frequencies(pairs, dt):
    """Refuse what a record of this sampling interval can only show as an alias: that of
    a reading is a rate at which samples are taken.
    """
    for _, effects in pairs:
        for one in effects:
            f = 0.0 if one.effect.reading else one.values.get("frequency", 0.0)
            f = f.low if isinstance(f, Parameter) else f
            if f > 0.5 / dt:
                raise ValueError(
                    f"{one.name} of {f:g} Hz is above half the sampling rate of "
                    f"{1.0 / dt:g} Hz: a record shows its alias, give "
                    f"{abs(f - round(f * dt) / dt):g} Hz")


def _prior(value):
    """A parameter of a model file as `hypothesis` takes it."""
    if isinstance(value, dict):
        return Parameter("", *value["range"], value["prior"] == "log")
    return value


def _effect_from(entry):
    """One effect of a hypothesis of a model file, as `Found`."""
    effect, values = CATALOGUE[entry["name"]], entry["parameters"]
    if not effect.reading:
        values = {symbol: as_parameter(effect.name, symbol, _prior(value), "uniform")
                  for symbol, value in values.items()}
    elif "limits" in values:
        low, high = values["limits"]
        values = dict(limits=[-np.inf if low is None else float(low),
                              np.inf if high is None else float(high)])
        if not np.subtract(*values["limits"]) < 0.0:
            raise ValueError(f"limits {[low, high]} of {effect.name}: the low one must "
                             "be below the high one")
    elif "codes" in values and np.any(np.diff(values["codes"], axis=0)[:, 0] <= 0.0):
        raise ValueError(f"codes of {effect.name}: the value of each must be above "
                         "that of the one before")
    low_pass = entry.get("low_pass")
    return Found(effect, entry.get("column") or "", entry.get("variant") or "", values,
                 low_pass=LowPass(**low_pass) if low_pass else None)


def check_onsets(simulator, scene):
    """Refuse an effect that starts when a record is over."""
    for _, effects in simulator.pairs:
        for one in effects:
            value = one.values.get("onset", 0.0)
            starts = [s for s, _ in one.values.get("spans", ())] + [
                value.low if isinstance(value, Parameter) else value]
            if max(starts) >= scene.duration:
                raise ValueError(f"{one.name} starts at {max(starts):g} s, but the "
                                 f"record ends at {scene.duration:g} s: it would do "
                                 "nothing")


def model_text(model):
    """JSON text of a model file; ValueError if it could not be read again."""
    hypotheses = []
    for h, effects in model.simulator.pairs:
        _check_known(h, effects)
        log = all(p.log for p in h.parameters if p.free)
        bias = dict(bias_sigma=h.bias_sigma) if h.bias_given else {}
        entry = dict(name=h.model.__name__, label=h.name, **bias,
                     prior="log" if log else "uniform",
                     parameters={p.symbol: _json_value(p, log) for p in h.parameters})
        if model.simulator.effects:
            entry["effects"] = [
                dict(name=one.name, column=one.column or None,
                     variant=one.variant or None, **_low_pass(one), parameters={
                         symbol: _json_value(v) for symbol, v in one.values.items()})
                for one in effects]
        hypotheses.append(entry)
    posterior = dict(posterior_of=model.posterior_of) if model.posterior_of else {}
    text = json.dumps(dict(dt=model.dt, unit=model.unit, **posterior,
                           hypotheses=hypotheses), indent=1, default=float)
    try:
        _model_from(parsed(text))
    except ValueError as wrong:
        raise ValueError(f"a model that no file can hold: {wrong}") from None
    return text


def _check_known(h, effects):
    """Refuse what no name in a model file stands for."""
    if h.model not in (*MODELS.values(), *FOREIGN.values()):
        raise ValueError(f"the model of {h.name} is one of your own: a model file can "
                         f"have {', '.join(MODELS)} alone")
    for one in effects:
        if not is_known(one.effect):
            raise ValueError(f"the effect {one.name} is one of your own: a model file "
                             "can have those of the catalogue alone")


def _low_pass(one):
    """What an effect of a model file passes before it is recorded, if anything."""
    return dict(low_pass=one.low_pass._asdict()) if one.low_pass else {}


def _json_value(value, log=False):
    """A parameter, or what a reading takes, as JSON has it; null is no limit. A law
    other than that of the hypothesis is said.
    """
    if isinstance(value, Parameter):
        ends = [value.low, value.high]
        return (value.low if not value.free else ends if value.log == log else
                dict(range=ends, prior="log" if value.log else "uniform"))
    if isinstance(value, list):
        return [v if not np.isscalar(v) or np.isfinite(v) else None for v in value]
    return value
