"""What a model file or a data sheet may hold, as a JSON Schema, and what is wrong with
a model file that does not, in a sentence.
"""

import difflib
import functools
import inspect
import json
import textwrap

import numpy as np

from sensorid import MODELS
from sensorlab.foreign import datasheet
from sensorlab.foreign.parts import FOREIGN
from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.effects import Scene, psi_of

POSITIVE, NOT_NEGATIVE = dict(exclusiveMinimum=0), dict(minimum=0)

# what a parameter may be, by its symbol; any number where it is not listed
DOMAINS = dict(
    onset=NOT_NEGATIVE, frequency=POSITIVE, ratio=POSITIVE, per=POSITIVE,
    dwell=POSITIVE, duration=POSITIVE, quiet=POSITIVE,
    play=dict(exclusiveMinimum=0, maximum=1),
    rate=dict(minimum=0, maximum=1))
CONTROL, END_OF_TEXT = r"\x00-\x1f\x7f-\x9f", r"(?![\s\S])"    # $ lets a newline pass
PRINTABLE = dict(type="string", pattern=f"^[^{CONTROL}]*{END_OF_TEXT}")
COLUMN = dict(type=["string", "null"], pattern=f"^[^=,{CONTROL}]*{END_OF_TEXT}")
PRIOR = dict(enum=["uniform", "log"])
INTERVAL = dict(type="number", **POSITIVE)
END = dict(type=["number", "null"])

# what readings take
READINGS = dict(
    lsb=dict(type="number", **POSITIVE),
    frequency=dict(type="number", **POSITIVE),
    window=dict(type="number", **POSITIVE),
    cutoff=dict(type="number", **POSITIVE),
    poles=dict(type="integer", minimum=1, maximum=20),
    phase=dict(type=["number", "null"], **NOT_NEGATIVE),
    order=dict(enum=[1, 3]), times=dict(enum=[1, 2]),
    value=dict(type="number"),
    limits=dict(type="array", items=END, minItems=2, maxItems=2),
    codes=dict(type="array", minItems=2, items=dict(
        type="array", minItems=2, maxItems=2,
        prefixItems=[dict(type="number"), dict(type="number", **NOT_NEGATIVE)])),
    spans=dict(type="array", items=dict(
        type="array", minItems=2, maxItems=2,
        prefixItems=[dict(type="number", **NOT_NEGATIVE),
                     dict(type="integer", minimum=1)])))


def schema():
    """The JSON Schema (draft 2020-12) of a model file and of a data sheet."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": "Model file or data sheet of sensorid",
            "if": {"required": ["datasheet"], "not": {"required": ["hypotheses"]}},
            "then": data_sheet(), "else": model_file()}


def model_file():
    """The schema of a model file."""
    models = {name: _of_model(model) for name, model in {**MODELS, **FOREIGN}.items()}
    effects = {name: _of_effect(effect) for name, effect in CATALOGUE.items()
               if not effect.factor}
    hypothesis = _named(
        models, label=PRINTABLE, prior=PRIOR,
        bias_sigma=dict(type="number", **NOT_NEGATIVE),
        effects=dict(type=["array", "null"], items=_named(
            effects, column=COLUMN, variant=dict(type=["string", "null"]),
            low_pass=_low_pass())))
    hypothesis["required"] = ["name"]
    return _object(
        ["dt", "hypotheses"], {"$schema": dict(type="string")}, dt=INTERVAL,
        unit=PRINTABLE, prior=PRIOR, bias_sigma=dict(type="number", **NOT_NEGATIVE),
        posterior_of=PRINTABLE,
        hypotheses=dict(type="array", items=hypothesis, minItems=1))


def _low_pass():
    """A digital low-pass that an effect passes before it is recorded, or null."""
    forms = [form for form, _ in CATALOGUE["bandwidth"].of_all]
    return _object(["variant", "tau"], variant=dict(enum=forms), tau=dict(
        type="number", **POSITIVE)) | dict(type=["object", "null"])


def data_sheet():
    """The schema of a data sheet: its keys, each a number with a unit, as a text."""
    said = {key: dict(type="string", minLength=1) for key in datasheet.KEYS}
    white = [dict(required=[key]) for key in datasheet.WHITE]
    return _object(
        ["datasheet", "unit"], {"$schema": dict(type="string")}, dt=INTERVAL,
        unit=PRINTABLE, datasheet=dict(_object([], said), anyOf=white))


def _object(required, named=(), **properties):
    return dict(type="object", properties=dict(named, **properties),
                required=required, additionalProperties=False)


def _named(kinds, **properties):
    """An object whose name decides what else is in it."""
    return _object(
        ["name", "parameters"], name=dict(type="string", enum=list(kinds)),
        parameters=dict(type="object"), **properties) | dict(allOf=[
            {"if": dict(properties=dict(name=dict(const=name)), required=["name"]),
             "then": rest} for name, rest in kinds.items()])


def _prior(symbol):
    """A number, a range, or a range with a law of its own."""
    domain = DOMAINS.get(symbol) or (
        NOT_NEGATIVE if symbol.startswith("sigma") else
        POSITIVE if symbol.startswith("tau") else {})
    ends = dict(items=dict(type="number", **domain), minItems=2, maxItems=2)
    return dict(type=["number", "array", "object"], **domain, **ends, properties=dict(
        range=dict(type="array", **ends), prior=PRIOR),
        required=["range", "prior"], additionalProperties=False)


def _of_model(model):
    symbols = list(inspect.signature(model).parameters.values())[1:]
    needed = [p.name for p in symbols if p.default is p.empty]
    parameters = _object(needed, **{p.name: _prior(p.name) for p in symbols})
    return dict(properties=dict(parameters=parameters),
                required=["parameters"] if needed else [])


def _of_effect(effect):
    """Parameters, column and variant of an effect."""
    scene = Scene(np.arange(8.0), 1.0, {})
    if effect.reading:
        taken = inspect.signature(effect.reading).parameters
        parameters = {symbol: rule for symbol, rule in READINGS.items()
                      if symbol in taken}
        needed = [symbol for symbol in parameters
                  if taken[symbol].default is inspect.Parameter.empty]
    else:
        needed = [p.symbol for p in effect.parameters(scene)]
        needed += [effect.size] if effect.columns else []
        needed += effect.relative_to(np.arange(8.0), "") if effect.relative_to else []
        optional = ["phase"] if effect.size == "amplitude" else []
        parameters = {symbol: _prior(symbol) for symbol in needed + optional}
    psi = psi_of(scene, effect, {p.symbol: p.mean for p in effect.parameters(scene)})
    variants = [name for name, _ in effect.columns(
        scene, np.arange(8.0), psi)] if effect.columns else effect.variants
    return dict(
        properties=dict(
            parameters=_object(needed, **parameters),
            column=dict(type="string", minLength=1) if effect.column else
            dict(enum=[None, ""]),
            variant=dict(enum=[None, *dict.fromkeys(["", *variants])]),
            **({} if effect.has_edges else dict(low_pass=dict(type="null")))),
        required=["column"] if effect.column else [])


# ---- reading against it

def parsed(text):
    """JSON text as Python has it; no key twice in an object, no number but a finite."""
    def unique(pairs):
        keys = [key for key, _ in pairs]
        twice = next((key for key in keys if keys.count(key) > 1), None)
        if twice is not None:
            raise ValueError(f"the key {twice!r} stands twice in one object")
        return dict(pairs)

    def finite(number, kind=float):
        if not np.isfinite(float(number)):
            raise ValueError(f"{number[:20]} is no finite number")
        return kind(number)
    return json.loads(text, object_pairs_hook=unique, parse_constant=finite,
                      parse_float=finite, parse_int=lambda text: finite(text, int))


SENTENCES = {    # what is needed, by the keyword of the schema that is not met
    "type": lambda e: "it must be " + " or ".join(
        TYPES[kind] for kind in np.atleast_1d(e.validator_value).tolist()),
    "minimum": lambda e: f"it must be >= {e.validator_value}",
    "maximum": lambda e: f"it must be <= {e.validator_value}",
    "exclusiveMinimum": lambda e: f"it must be > {e.validator_value}",
    "minItems": lambda e: f"at least {e.validator_value} must be in it",
    "maxItems": lambda e: f"at most {e.validator_value} can be in it",
    "minLength": lambda e: "it must not be empty",
    "enum": lambda e: "it must be one of " + ", ".join(
        map(json.dumps, e.validator_value)) + _meant(e.instance, e.validator_value),
    "pattern": lambda e: "no control characters can be in it" + (
        ", no = and no comma" if e.validator_value == COLUMN["pattern"] else "")}
TYPES = dict(number="a number", array="a list", object="an object", string="a text",
             null="null", integer="a whole number")


@functools.cache
def _validator():
    from jsonschema import Draft202012Validator
    return Draft202012Validator(schema())


def problem(tree):
    """The first thing wrong with the content of a model file as a sentence, or None."""
    from jsonschema.exceptions import best_match
    if isinstance(tree, dict) and "record" in tree:
        return ("the file is what a command says of a record, not a model: diagnose "
                "--out DIR writes that, as DIR/model.json, and identify --save-model")
    e = best_match(_validator().iter_errors(tree))
    if e is None:
        return None
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}"
                    for part in e.absolute_path).removeprefix(".")
    if e.validator == "required":
        missing = [key for key in e.validator_value if key not in e.instance]
        return f"{where or 'the file'} has no {missing[0]}: it is needed"
    if e.validator == "additionalProperties":
        known = list(e.schema["properties"])
        strange = next(key for key in e.instance if key not in known)
        return (f"{where or 'the file'} has an unknown key {strange!r}"
                f"{_meant(strange, known)}; known are {', '.join(known)}")
    shown = textwrap.shorten(json.dumps(e.instance), 60, placeholder=" ...")
    return f"{where or 'the file'} is {shown}: {SENTENCES[e.validator](e)}"


def _meant(given, known):
    near = difflib.get_close_matches(str(given), [str(k) for k in known], 1)
    return f" (did you mean {near[0]}?)" if near else ""


if __name__ == "__main__":
    print(json.dumps(schema(), indent=1))
