"""The page above those of many records: their table, their figure, what they share."""

from urllib.parse import quote

from sensorlab.pages import embedded, made, sentence, template
from sensorlab.several.picture import draw_several
from sensorlab.several.tables import diagnosed_cells, headings, names, shared


def index(several, addresses, command=""):
    """A page of HTML that leads to those of all records.

    Parameters
    ----------
    several : Several
        Of diagnoses.
    addresses : sequence of str
        Files of their pages, in order, beside this one.
    command : str
        As it was typed.

    Returns
    -------
    str
    """
    rows, called = several.rows, names(several.rows)
    answered = [row for row in rows if not row.problem]
    shown = []
    for name, row, address in zip(called, rows, addresses):
        line = dict(name=name, problem=row.problem)
        if not row.problem:
            verdict, gap, closed, left, found = diagnosed_cells(row)
            line |= dict(address=quote(address), verdict=verdict, gap=gap,
                         closed=closed, left=left, found=found)
        shown.append(line)
    return template("several.html").render(
        rows=shown, headline=_headline(rows), heard=list(headings(rows, called)),
        common=[shared(c, rows, called) for c in several.common],
        picture=embedded(draw_several(rows)) if answered else "", **made(command))


def _headline(rows):
    """How many of the records the simulator describes, in a sentence."""
    verdicts = [row.answer["verdict"] for row in rows if not row.problem]
    none, open_ = verdicts.count("none"), verdicts.count("undecided")
    parts = [f"the simulator describes {none} of {len(rows)} records"]
    others = len(verdicts) - none - open_
    if others:
        parts.append(f"{others} differ{'s' * (others == 1)} from it")
    if open_:
        parts.append(f"{open_} cannot decide")
    if len(rows) > len(verdicts):
        parts.append(f"{len(rows) - len(verdicts)} gave no answer")
    return sentence(", ".join(parts))
