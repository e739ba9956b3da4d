"""What identify and diagnose do for several records."""

import functools
import re

from sensorlab.commands.cache import forgive
from sensorlab.commands.progress import progress_bar
from sensorlab.commands.shared import (
    check_folder, refuse_unused, write_json, write_text)
from sensorlab.drawings import save
from sensorlab.several import many
from sensorlab.several.index import index
from sensorlab.several.picture import draw_several
from sensorlab.several.pool import cores, workers
from sensorlab.several.tables import names, told
from sensorlab.several.work import INDEX
from sensorlab.tables import show


def answers(options, calls, usual=None):
    """`Several` of calls (work, record, ...), by --workers processes, usually one for
    every core.
    """
    if options.checkpoint is not None:
        check_folder(options.checkpoint)
    number = min(options.workers or usual or cores(), len(calls))
    with workers(number, functools.partial(forgive, silent=True)) as executor:
        return many(calls, executor, options.checkpoint, progress_bar)


def refuse_workers(options, records):
    """Refuse --workers where there is nothing to share."""
    if len(records) == 1:
        refuse_unused(options, "workers",
                      why="does nothing beside one record: it shares several")


def write_table(file, several):
    """The rows as CSV."""
    write_text(file, several.frame.to_csv(index=False))


def write_answers(file, several):
    """All answers, and what they have in common, as JSON."""
    called = names(several.rows)
    write_json(file, dict(
        records=[dict(row.answer or dict(record=dict(file=row.file, column=row.column)),
                      name=name, unit=row.unit, problem=row.problem or None)
                 for name, row in zip(called, several.rows)],
        common=[dict(c._asdict(), records=[called[n] for n in c.records])
                for c in several.common]))


def _plain_names(several):
    """Names of the records as a part of file names, all different."""
    plain = [re.sub(r"[^\w.\-\[\]]", "_", name) for name in names(several.rows)]
    return [name + f"_{number}" * (plain.count(name) > 1)
            for number, name in enumerate(plain)]


def write_models(stem, several):
    """The model of every record, in a file of its own: STEM.NAME.json."""
    for name, row in zip(_plain_names(several), several.rows):
        if not row.problem:
            write_text(f"{stem}.{name}.json", row.model)


def write_pages(folder, several, command):
    """The page of every record, report.NAME.html, and the one above them."""
    addresses = [f"report.{name}.html" for name in _plain_names(several)]
    for address, row in zip(addresses, several.rows):
        if not row.problem:
            write_text(folder / address, row.page)
    write_text(folder / INDEX, index(several, addresses, command))


def write_picture(file, several):
    """One figure of all that gave an answer; none where no record did."""
    if any(not row.problem for row in several.rows):
        save(draw_several(several.rows), file)


def conclude(several):
    """Print the table; refuse in the end if a record gave no answer."""
    show(*told(several))
    bad = [name for name, row in zip(names(several.rows), several.rows) if row.problem]
    if bad:
        raise ValueError(f"{len(bad)} of {len(several.rows)} records gave no answer: "
                         + ", ".join(bad[:6]) + ", ..." * (len(bad) > 6))
