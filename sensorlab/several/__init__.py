"""Many records in one go: the axes of a sensor, several runs, a folder.

    work      one record: its answer, its model and its Allan deviation as a `Row`
    pool      processes that share the cores
    common    what the records have in common
    tables    rows as a DataFrame and as a table for people
    picture   one figure of all
    index     a page that leads to those of all

`diagnose_many` and `identify_many` take records of `sensorlab.read_axes`, or whatever
`sensorlab.read` takes.
"""

import json
import os
import pathlib
from concurrent.futures import BrokenExecutor
from typing import NamedTuple

from sensorid import __version__, check_executor, fingerprint, write_whole
from sensorlab.gap.report import finite
from sensorlab.readers import Recording, Unread, read, unread
from sensorlab.readers.objects import name_of
from sensorlab.several.common import common
from sensorlab.several.tables import frame
from sensorlab.several.work import Row, diagnosed, failed, identified


class Several(NamedTuple):
    """What many records gave."""

    rows: tuple      # of Row, in the order of the records
    common: tuple    # of Common: effects that several of them share

    @property
    def frame(self):
        """The rows as a DataFrame."""
        return frame(self.rows)


def diagnose_many(records, simulator=None, seed=0, executor=None, checkpoint=None,
                  progress=None):
    """Why each of many records differs from a simulator.

    Parameters
    ----------
    records : sequence of Recording, or of sources for `read`
        With the columns beside each.
    simulator : Simulator, or sequence of Hypothesis, optional
        By default for each record `default_hypotheses`.
    seed : int
        As for `diagnose`.
    executor : concurrent.futures.Executor, optional
        Takes a record at a time; the result is the same to the last bit. What a broken
        pool did not finish is done here.
    checkpoint : path, optional
        Folder in which finished rows are kept; the same call takes them up again.
    progress : function of (done, all), optional

    Returns
    -------
    Several
        A record that cannot be read or diagnosed has its `problem` in its row.
    """
    return many([(diagnosed, r, simulator, None, seed) for r in opened(records, None)],
                executor, checkpoint, progress)


def identify_many(records, hypotheses=None, report_units=None, executor=None,
                  checkpoint=None, progress=None):
    """The error model of each of many records; see `identify` and `diagnose_many`.

    Parameters are quoted in units of the field, those in `report_units` first, unless
    these are None.
    """
    return many([(identified, r, hypotheses, report_units)
                 for r in opened(records, ())], executor, checkpoint, progress)


def opened(records, beside):
    """Recordings, or what is wrong with a source that is none yet; of one or several.
    """
    alone = isinstance(records, (str, os.PathLike, Recording, Unread))
    for one in [records] if alone else records:
        if isinstance(one, (Recording, Unread)):
            yield one
            continue
        try:
            yield read(one, beside=beside)
        except (ValueError, OSError) as problem:
            yield unread(name_of(one), "error", problem)


def many(calls, executor=None, checkpoint=None, progress=None):
    """`Several` of calls (work, record, ...), each of which gives a `Row`."""
    check_executor(executor)
    if not calls:
        raise ValueError("no record is given: at least one is needed")
    waiting = [_submitted(executor, checkpoint, *call) for call in calls]
    rows = []
    for call, future in zip(calls, waiting):
        try:
            row = future.result() if future else _kept_row(checkpoint, *call)
        except BrokenExecutor:    # a worker died and took its pool along: go on here
            row = _kept_row(checkpoint, *call)
        rows.append(row)
        if progress:
            progress(len(rows), len(calls))
    return Several(tuple(rows), common(rows))


def _submitted(executor, *call):
    """A row to come; None where it must be made here."""
    try:
        return executor and executor.submit(_kept_row, *call)
    except (OSError, BrokenExecutor):    # no process can be started
        return None


def _kept_row(folder, work, record, *arguments):
    """What work gives for a record, or gave in an earlier run that was interrupted."""
    if isinstance(record, Unread):
        return failed(record, record.problem)
    file = folder and pathlib.Path(folder) / (
        fingerprint(__version__, work.__name__, record, arguments)[:32] + ".json")
    if file and file.exists():
        try:
            return Row(**json.loads(file.read_text()))
        except (ValueError, TypeError, OSError):    # damaged: worth no more than none
            pass
    try:
        row = work(record, *arguments)
    except Exception as problem:    # of one record, which must not cost the others
        known = isinstance(problem, (ValueError, OSError, MemoryError, OverflowError))
        return failed(record, str(problem) if known else
                      f"{type(problem).__name__}: {problem}")
    # as it is read again, so that a row is the same whether it was kept or not
    text = json.dumps(finite(row._asdict()), allow_nan=False)
    if file:
        write_whole(file, lambda stream: stream.write(text.encode()))
    return Row(**json.loads(text))
