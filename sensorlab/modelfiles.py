"""Simulators as files hold them, or as their records show them."""

import inspect
import json
import pathlib
from typing import NamedTuple

import numpy as np

from sensorid import (
    Parameter, as_number, as_parameter, hypothesis, identify)
from sensorlab.foreign import translated
from sensorlab.foreign.parts import markov_from_start
from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.effects import Found, Scene, Simulator


FOREIGN = dict(markov_from_start=markov_from_start)    # models beside MODELS


class Model(NamedTuple):
    """A model file: a simulator, or hypotheses and their priors."""

    dt: float    # s
    unit: str
    simulator: Simulator


def read_model(file, dt=None):
    """Model from a JSON file, a data sheet or another program's file; see
    `sensorlab.foreign` for the latter, and for `dt`.

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
    text = translated(file, dt)
    file = pathlib.Path(file)
    if text is None:
        text = _json(file)
    try:
        if not isinstance(text, dict) or not text.get("hypotheses"):
            raise ValueError("no hypotheses: a model file needs a list of at least one")
        if not isinstance(text["hypotheses"], list):
            raise ValueError("hypotheses must be a list")
        dt = as_number(text.get("dt"), "dt")
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
    return Model(dt, str(text.get("unit", "u")),
                 Simulator(hypotheses, effects if any(effects) else ()))


def _json(file):
    """Content of a JSON model file."""
    if not file.is_file():
        raise ValueError(f"{file}: no such model file")
    try:
        return json.loads(file.read_text(encoding="utf-8-sig"))
    except (ValueError, OSError, RecursionError) as problem:
        raise ValueError(f"{file}: not a JSON model file: {problem}") from None


# shapes of what readings take; None is any number
READINGS = dict(lsb=(), limits=(2,), spans=(None, 2))


def _effect_from(entry, owner):
    """One effect of a hypothesis of a model file, as `Found`."""
    if not isinstance(entry, dict) or entry.get("name") not in CATALOGUE:
        raise ValueError(f"effect {entry!r} of {owner}: a name is needed, "
                         f"one of {', '.join(CATALOGUE)}")
    name, values = entry["name"], entry.get("parameters")
    effect = CATALOGUE[name]
    if effect.factor:
        raise ValueError(f"{name} is no effect to be added: change the parameter")
    if not isinstance(values, dict):
        raise ValueError(f"parameters of {name} must be an object")
    column, variant = entry.get("column") or "", entry.get("variant") or ""
    if effect.column and not column:
        raise ValueError(f"{name} of {owner} names no column")
    needed = _symbols(effect, column)
    optional = {"phase"} if effect.search == "frequency" else set()
    if not needed <= values.keys() <= needed | optional:
        raise ValueError(f"{name} has the parameters {', '.join(sorted(needed))}, "
                         f"not {', '.join(sorted(values)) or 'none'}")
    if effect.reading:
        values = {symbol: _reading(name, symbol, value)
                  for symbol, value in values.items()}
    else:
        values = {symbol: as_parameter(name, symbol, value, "uniform")
                  for symbol, value in values.items()}
    return Found(effect, column, variant, values)


def _symbols(effect, column):
    """Names of the parameters that an effect needs."""
    if effect.reading:
        return set(inspect.signature(effect.reading).parameters) - {"scene", "y"}
    scene = Scene(np.arange(8.0), 1.0, {column: np.arange(8.0)})
    return {p.symbol for p in effect.parameters(scene)} | (
        {effect.size} if effect.columns else set())


def _reading(name, symbol, value):
    """What a reading takes, as numbers."""
    try:
        numbers = np.array([[-np.inf, np.inf][i] if v is None else v
                            for i, v in enumerate(value)]
                           if symbol == "limits" else value, float)
    except (TypeError, ValueError, IndexError):
        numbers = np.full((0,) * 7, np.nan)    # of no shape that fits
    shape = READINGS[symbol]
    if numbers.ndim != len(shape) or any(
            n not in (None, have) for n, have in zip(shape, numbers.shape)):
        raise ValueError(f"{symbol} of {name} is {value!r}: a number for "
                         "lsb, [low, high] for limits, [[onset, samples], ...] "
                         "for spans")
    return numbers.tolist()


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
    return hypothesis(FOREIGN.get(entry["name"], entry["name"]),
                      name=entry.get("label"),
                      bias_sigma=entry.get("bias_sigma", text.get("bias_sigma", 1.0)),
                      prior=entry.get("prior", text.get("prior", "uniform")),
                      **parameters)


def model_text(model):
    """JSON text of a model file."""
    hypotheses = []
    for h, effects in model.simulator.pairs:
        entry = dict(name=h.model.__name__, label=h.name, bias_sigma=h.bias_sigma,
                     prior="log" if any(p.log for p in h.parameters) else "uniform",
                     parameters={p.symbol: _json_value(p) for p in h.parameters})
        if model.simulator.effects:
            entry["effects"] = [
                dict(name=one.name, column=one.column or None,
                     variant=one.variant or None, parameters={
                         symbol: _json_value(v) for symbol, v in one.values.items()})
                for one in effects]
        hypotheses.append(entry)
    return json.dumps(dict(dt=model.dt, unit=model.unit, hypotheses=hypotheses),
                      indent=1)


def _json_value(value):
    """A parameter, or what a reading takes, as JSON has it; null is no limit."""
    if isinstance(value, Parameter):
        return [value.low, value.high] if value.free else value.low
    if isinstance(value, list):
        return [v if not np.isscalar(v) or np.isfinite(v) else None for v in value]
    return value


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
        e = identify(y, dt).best
        for p, mean, sd in zip(e.hypothesis.parameters, e.mean,
                               np.sqrt(np.diag(e.covariance))):
            low, high = max(p.low, mean - 2 * sd), min(p.high, mean + 2 * sd)
            old = spans.setdefault(e.hypothesis.name, {}).get(p.symbol, (low, high))
            spans[e.hypothesis.name][p.symbol] = min(low, old[0]), max(high, old[1])
    means = np.nanmean(records, axis=1)
    bias = float(np.sqrt(np.mean(means**2)) + np.nanstd(records[0]))
    return tuple(hypothesis(name, bias_sigma=bias, **parameters)
                 for name, parameters in spans.items())
