"""Simulators as files hold them, or as their records show them."""

import json
import pathlib
from typing import NamedTuple

import numpy as np

from sensorid import (
    Parameter, _number, _parameter, default_hypotheses, hypothesis, identify)
from sensorlab.gap.effects import CATALOGUE, Added, Scene


class Model(NamedTuple):
    """A model file: the simulator, or the hypotheses and their priors."""

    dt: float
    unit: str
    hypotheses: tuple
    effects: tuple = ()    # of every hypothesis, tuples of Added; () if none has any


def read_model(file):
    """Model from a JSON file.

    The file holds `dt`, s, optionally `unit`, `bias_sigma` (1) and `prior` ("uniform"
    or "log"), and `hypotheses`: a list of `name`, a name in MODELS, and `parameters`,
    each a number or a range [low, high]; optionally `label`, `prior`, `bias_sigma` and
    `effects`: a list of `name`, a name in CATALOGUE, `parameters` and, where the effect
    needs one, `column`.

    Raises
    ------
    ValueError
        With one sentence on what is wrong with the file.
    """
    file = pathlib.Path(file)
    if not file.is_file():
        raise ValueError(f"{file}: no such model file")
    try:
        text = json.loads(file.read_text(encoding="utf-8-sig"))
    except (ValueError, OSError, RecursionError) as problem:
        raise ValueError(f"{file}: not a JSON model file: {problem}") from None
    try:
        if not isinstance(text, dict) or not text.get("hypotheses"):
            raise ValueError("no hypotheses: a model file needs a list of at least one")
        if not isinstance(text["hypotheses"], list):
            raise ValueError("hypotheses must be a list")
        dt = _number(text.get("dt"), "dt")
        if not (np.isfinite(dt) and dt > 0.0):
            raise ValueError(f"dt is {dt:g} s: it must be > 0")
        if not isinstance(text.get("unit", "u"), str):
            raise ValueError(f"unit {text['unit']!r} must be a text")
        hypotheses = tuple(_hypothesis_from(entry, text)
                           for entry in text["hypotheses"])
        names = [h.name for h in hypotheses]
        if len(set(names)) < len(names):
            raise ValueError(f"hypotheses of the same name among {', '.join(names)}: "
                             "give each a \"label\" of its own")
        effects = tuple(tuple(_effect_from(one, entry["name"])
                              for one in entry.get("effects") or ())
                        for entry in text["hypotheses"])
    except ValueError as problem:
        raise ValueError(f"{file}: {problem}") from None
    return Model(dt, str(text.get("unit", "u")), hypotheses,
                 effects if any(effects) else ())


def _effect_from(entry, owner):
    """One effect of a hypothesis of a model file."""
    if not isinstance(entry, dict) or entry.get("name") not in CATALOGUE:
        raise ValueError(f"effect {entry!r} of {owner}: a name is needed, "
                         f"one of {', '.join(CATALOGUE)}")
    name, parameters = entry["name"], entry.get("parameters")
    effect = CATALOGUE[name]
    if effect.kind == "parameter":
        raise ValueError(f"{name} is no effect to be added: change the parameter")
    if not isinstance(parameters, dict):
        raise ValueError(f"parameters of {name} must be an object")
    column, variant = entry.get("column") or "", entry.get("variant") or ""
    if effect.column and not column:
        raise ValueError(f"{name} of {owner} names no column")
    scene = Scene(np.arange(8.0), 1.0, {column: np.arange(8.0)})
    needed = {p.symbol for p in effect.parameters(scene)} | {
        "quantization": {"lsb"}, "saturation": {"limits"}, "stuck": {"spans"}}.get(
            name, {effect.size} - {""})
    optional = {"phase"} if name == "sinusoid" else set()
    if not needed <= parameters.keys() <= needed | optional:
        raise ValueError(f"{name} has the parameters {', '.join(sorted(needed))}, "
                         f"not {', '.join(sorted(parameters)) or 'none'}")
    if effect.kind != "reading":
        parameters = {symbol: _parameter(name, symbol, value, "uniform")
                      for symbol, value in parameters.items()}
    else:
        shape = dict(quantization=(), saturation=(2,), stuck=(None, 2))[name]
        value = next(iter(parameters.values()))
        try:
            numbers = np.array([[-np.inf, np.inf][i] if v is None else v
                                for i, v in enumerate(value)]
                               if name == "saturation" else value, float)
        except (TypeError, ValueError):
            numbers = np.zeros(7)
        if numbers.ndim != len(shape) or any(
                n not in (None, have) for n, have in zip(shape, numbers.shape)):
            raise ValueError(f"{needed.pop()} of {name} is {value!r}: a number for "
                             "lsb, [low, high] for limits, [[onset, samples], ...] "
                             "for spans")
        parameters = {needed.pop(): numbers.tolist()}
    return Added(effect, column, variant, parameters)


def _hypothesis_from(entry, text):
    """One hypothesis of a model file."""
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise ValueError(f"hypothesis {entry!r}: a name and parameters are needed")
    if not isinstance(entry.get("parameters", {}), dict):
        raise ValueError(f"parameters of {entry['name']} "
                         "must be an object of numbers and ranges")
    if not isinstance(entry.get("effects") or [], list):
        raise ValueError(f"effects of {entry['name']} must be a list")
    if not isinstance(entry.get("label", ""), str):
        raise ValueError(f"label {entry['label']!r} of {entry['name']} must be a text")
    parameters = entry.get("parameters", {})
    strange = {"name", "model", "prior", "bias_sigma"} & parameters.keys()
    if strange:
        raise ValueError(f"{entry['name']} has no parameter {strange.pop()}")
    return hypothesis(entry["name"], name=entry.get("label"),
                      bias_sigma=entry.get("bias_sigma", text.get("bias_sigma", 1.0)),
                      prior=entry.get("prior", text.get("prior", "uniform")),
                      **parameters)


def model_text(model):
    """JSON text of a model file."""
    def value(p):
        if isinstance(p, Parameter):
            return [p.low, p.high] if p.free else p.low
        return [v if not np.isscalar(v) or np.isfinite(v) else None
                for v in p] if isinstance(p, list) else p
    hypotheses = [dict(name=h.model.__name__, label=h.name, bias_sigma=h.bias_sigma,
                       prior="log" if any(p.log for p in h.parameters) else "uniform",
                       parameters={p.symbol: value(p) for p in h.parameters})
                  for h in model.hypotheses]
    for entry, added in zip(hypotheses, model.effects):
        entry["effects"] = [
            dict(name=one.effect.name, column=one.column or None,
                 variant=one.variant or None,
                 parameters={k: value(p) for k, p in one.parameters.items()})
            for one in added]
    return json.dumps(dict(dt=model.dt, unit=model.unit, hypotheses=hypotheses),
                      indent=1)


def simulator_from(records, dt):
    """Hypotheses that describe records of a black box.

    Parameters
    ----------
    records : (L, N) array
    dt : float

    Returns
    -------
    tuple of Hypothesis
        Those found in any of the records; the range of a parameter holds its posterior
        mean -+ 2 standard deviations in all of them.
    """
    spans = {}
    for y in records[:20]:
        posterior = identify(y, dt, default_hypotheses(y, dt))
        e = posterior.estimates[int(posterior.probability.argmax())]
        for p, mean, sd in zip(e.hypothesis.parameters, e.mean,
                               np.sqrt(np.diag(e.covariance))):
            low, high = max(p.low, mean - 2 * sd), min(p.high, mean + 2 * sd)
            old = spans.setdefault(e.hypothesis.name, {}).get(p.symbol, (low, high))
            spans[e.hypothesis.name][p.symbol] = min(low, old[0]), max(high, old[1])
    means = np.nanmean(records, axis=1)
    bias = float(np.sqrt(np.mean(means**2)) + np.nanstd(records[0]))
    return tuple(hypothesis(name, bias_sigma=bias, **parameters)
                 for name, parameters in spans.items())
