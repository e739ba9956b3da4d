"""A diagnosis as one page of HTML that needs nothing beside it: no network, no files.

    page.html       what every page begins and ends with (Jinja)
    report.html     what that of a diagnosis says, in order
    several.html    the page above those of several records
    style.css       how they look, on a screen, a telephone and paper
"""

import base64
import datetime
import functools
import hashlib
import io
import pathlib
import platform
import re
from importlib.metadata import version
from typing import NamedTuple

import numpy as np
from markupsafe import Markup, escape

import sensorid
from sensorlab.drawings import panels
from sensorlab.drawings.style import legend_above, new_figure, styled, with_plain_logs
from sensorlab.gap import words
from sensorlab.gap.catalogue import CATALOGUE
from sensorlab.gap.curves import view as view_of
from sensorlab.gap.report import check_recording
from sensorlab.gap.sizes import chance, percent, sizes
from sensorlab.gap.verdict import present

LIBRARIES = "numpy", "scipy", "numba"


class Provenance(NamedTuple):
    """Where a diagnosis comes from."""

    files: tuple = ()    # of (what it is, name, SHA-256 or "")
    command: str = ""    # as it was typed
    above: str = ""      # address of the page of all records, if there is one


def provenance(files, command="", above=""):
    """`Provenance` of files, pairs of what each is and its name; None is no file."""
    return Provenance(tuple((what, str(name), _digest(name)) for what, name in files
                            if name is not None), command, above)


def _digest(name):
    file = pathlib.Path(name)
    if not file.is_file():    # one sensor of a file is FILE#SENSOR
        file = pathlib.Path(str(name).partition("#")[0])
    if not file.is_file():
        return ""
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def page(d, record, unit=None, origin=Provenance(), view=None):
    """A diagnosis as a page of HTML.

    Parameters
    ----------
    d : Diagnosis
    record : Recording
    unit : str, optional
        Of the record; by default the one that it brings, else "u".
    origin : Provenance, optional
    view : View, optional
        What is drawn of the diagnosis, where that is known already.

    Returns
    -------
    str
    """
    check_recording(record)
    seen, unit = view_of(d) if view is None else view, unit or record.unit or "u"
    return template("report.html").render(
        d=d, record=record, unit=unit, origin=origin, words=words,
        file=pathlib.Path(record.file).name, headline=words.headline(d),
        facts=_facts(d), found=_found(d, unit), named=words.is_named(d),
        figures=_figures(d, seen, unit), caption=_caption(d, seen, unit),
        causes=_causes(d, unit),
        sentences=[*words.shown_by_both(d), *words.closing(d), *words.left(d)],
        steps=_steps(d, unit),
        duration=d.scene.duration, missing=int(np.isnan(d.scene.y).sum()),
        **made(origin.command))


def made(command=""):
    """By which command, with what and when a page is made."""
    return dict(command=command,
                versions=[("sensorid", sensorid.__version__),
                          ("Python", platform.python_version()),
                          *((name, version(name)) for name in LIBRARIES)],
                date=datetime.datetime.now(datetime.timezone.utc))


@functools.cache
def template(name):
    """The template of a page."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    environment = Environment(
        loader=PackageLoader("sensorlab", "pages"), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, undefined=StrictUndefined)
    environment.filters.update(
        typeset=typeset, percent=percent, sentence=sentence)
    return environment.get_template(name)


EFFECTS = re.compile(r"\b(" + "|".join(CATALOGUE) + r")\b", re.I)
SYMBOLS = re.compile(r"\b(sigma|tau)_([a-z])\b")


def typeset(text):
    """A text as it is printed: minus signs, powers of ten, symbols, plain names.

    Examples
    --------
    >>> print(typeset("bias_step: -2 +- 1e-05, sigma_v"))
    bias step: −2 ± 10<sup>−5</sup>, <i>σ</i><sub>v</sub>
    """
    text = str(escape(text)).replace("+-", "±")
    text = EFFECTS.sub(lambda found: found[0].replace("_", " "), text)
    text = SYMBOLS.sub(lambda found: f"<i>{dict(sigma='σ', tau='τ')[found[1]]}</i>"
                       f"<sub>{found[2]}</sub>", text)
    text = re.sub(r" (?=%)|(?<=&[lg]t;) ", "\u00a0", text)
    text = re.sub(r"(?<![\w.])-(?=\d)", "−", text)
    text = re.sub(r"(\d[\d.]*)e([+-]?)0*(\d+)", _power, text)
    return Markup(re.sub(r"\^(\d)", r"<sup>\1</sup>", text))


def sentence(text):
    """A text with a capital letter and an end."""
    return text[:1].upper() + text[1:] + "." * (text[-1] not in ".?!")


def _power(found):
    digits, sign, exponent = found.groups()
    factor = "" if digits == "1" else f"{digits}·"
    return f"{factor}10<sup>{'−' * (sign == '-')}{exponent}</sup>"


def _facts(d):
    """The few numbers that matter most: (what, value)."""
    yield "chance of such a gap without a cause", chance(d.before.p_value)
    if d.found and np.isfinite(d.closure.closed):
        yield "of the gap is closed", words.closed_share(d.closure)
    if d.found or d.verdict == "unknown":
        yield "of the gap is left", percent(d.remainder.share)
    if d.verdict == "undecided":
        yield "record that would decide", f"{d.needed_duration:.2g} s"


def _found(d, unit):
    """Rows of what was found: name, size, probability, share of the gap."""
    known = present(d.causes)
    return [(one.name + (f" ({one.column})" if one.column not in ("", one.name)
                         else ""), sizes([one], unit, d.scene.dt),
             percent(min(known.get(one.name, 0.0), 1.0)), percent(part.share))
            for one, part in zip(d.found, d.parts)]


def _causes(d, unit):
    """What is said of every cause beside its bar."""
    return [dict(name=words.cause_name(c), probability=c.probability,
                 odds=words.odds_to_none(c), size=words.sizes_in(c, d, unit))
            for c in words.shown_causes(d)]


def _steps(d, unit):
    """What to do next, in sentences."""
    steps = list(words.advice(d, unit))
    if d.verdict == "none":
        steps.append("use the simulator as it is; a longer record shows smaller "
                     "effects")
    if "unknown" in d.verdict:
        steps.append("record beside the sensor whatever may move its error: "
                     "temperature, rate, acceleration, supply voltage; then diagnose "
                     "again")
    if d.found and d.verdict not in ("undecided", "unknown"):
        steps.append("simulate with model.json, which has the effect, and diagnose the "
                     "next record of the sensor with it")
    return steps


def _caption(d, seen, unit):
    """What the picture of the record shows."""
    marks = []
    if seen.through is not None:
        names = words.listed(words.phrase(name, d.found) for name in seen.through.names)
        marks.append(f"Blue: {names}, as the model sees it in the record.")
    if seen.odd.any():
        marks.append(f"Circles: {seen.odd.sum()} samples that are outliers, more "
                     "likely than not.")
    values = {(symbol, bool(one.effect.model)) for one in d.found
              for symbol in one.values}
    if ("onset", True) in values:
        marks.append("Dashed: where the noise changes.")
    if ("limits", False) in values:
        marks.append("Blue: where the values end.")
    if ("spans", False) in values:
        marks.append("Triangles: where the value sticks.")
    if d.found and not marks:
        marks.append("What was found does not show at this scale: the next pictures "
                     "show it.")
    return " ".join([f"The error of the sensor, {unit}, against time.", *marks])


# ---- pictures

WIDTH = 5.2         # inches, at which letters can be read on a telephone, too
MOST_ADDED = 3      # signatures of which an added-variable plot is shown


def _figures(d, seen, unit):
    """Pictures by name, as (address, what it shows) of each."""
    result = dict(
        record=_drawn(3.0, panels.of_record, d, seen, unit),
        allan=_drawn(3.3, panels.of_allan, d, seen, unit),
        spectrum=_drawn(3.3, panels.of_spectrum, d, seen, unit),
        places=_drawn(2.9, panels.of_places, d, seen))
    readings = panels.readings_found(d)
    others = not (seen.added or readings or d.verdict == "none")
    result["added"] = [_drawn(3.4, panels.of_added, added)
                       for added in seen.added[:MOST_ADDED]]
    result["samples"] = [_drawn(3.0, panels.of_values, d, one, unit)
                         for one in readings if "codes" not in one.found.values]
    result["codes"] = [_drawn(3.0, panels.of_codes, one, unit)
                       for one in readings if "codes" in one.found.values]
    result["residuals"] = [_drawn(3.2, panels.of_residuals, d, seen)] * others
    return result


@styled
def _drawn(height, draw, *what):
    """A panel as the address of an SVG picture."""
    fig, (ax,) = new_figure(WIDTH, height)
    draw(ax, *what)
    legend_above(ax)
    return embedded(fig)


@styled
def embedded(fig):
    """A figure as an address that holds all of it."""
    stream = io.BytesIO()
    with_plain_logs(fig).savefig(stream, format="svg", dpi=200,
                                 metadata=dict(Date=None))
    return "data:image/svg+xml;base64," + base64.b64encode(stream.getvalue()).decode()
