"""Sentences and tables as text, at the width of a terminal or, in a pipe, at their own.
"""

import io
import shutil
import sys
from typing import NamedTuple


class Table(NamedTuple):
    """A table of texts."""

    header: tuple          # a name for each column
    rows: tuple            # of tuples, a cell for each column
    right: tuple = ()      # numbers of the columns that are set flush right: numbers
    keys: int = 0          # first columns, which every part repeats where a table that
                           # is too wide is set in parts; 0: long cells are broken


def as_text(*parts, width=None):
    """Sentences and tables as text.

    Parameters
    ----------
    *parts : str or Table
    width : int, optional
        Columns of a terminal: what is longer goes on in the next line, nothing is cut.
        Without it every sentence and every row of a table is one line.

    Returns
    -------
    str

    Examples
    --------
    >>> print(as_text("found:", Table(("effect", "share"), (("ramp", "9 %"),), (1,))))
    found:
    effect  share
    ramp      9 %
    """
    from rich.console import Console
    stream = io.StringIO()
    console = Console(file=stream, width=width or UNBROKEN, markup=False, emoji=False,
                      highlight=False, color_system=None)
    for part in parts:
        if isinstance(part, Table):
            for number, table in enumerate(
                    _in_parts(part, width) if width and part.keys else [part]):
                console.print(*[""] * (number > 0), _rich(table), sep="\n", crop=False)
        else:
            console.print(part, overflow="fold", crop=False)
    lines = stream.getvalue().splitlines()
    return "\n".join(line.rstrip() for line in lines)


UNBROKEN = 10**5    # columns: wider than any line


def show(*parts):
    """Print sentences and tables as wide as the terminal is; each line whole where
    there is none.
    """
    tty = sys.stdout is not None and sys.stdout.isatty()
    print(as_text(*parts, width=shutil.get_terminal_size().columns if tty else None))


def _in_parts(table, width):
    """A table in parts that fit, the first columns in each of them."""
    widths = [2 + max(map(len, column)) for column in zip(table.header, *table.rows)]
    keys, groups = list(range(table.keys)), []
    for number in range(table.keys, len(widths)):
        if groups and sum(widths[k] for k in (*keys, *groups[-1], number)) <= width + 2:
            groups[-1].append(number)
        else:
            groups.append([number])
    for group in groups:
        shown = keys + group
        yield Table(tuple(table.header[k] for k in shown), tuple(
            tuple(row[k] for k in shown) for row in table.rows), tuple(
            n for n, k in enumerate(shown) if k in table.right))


def _rich(part):
    from rich.table import Table as RichTable
    result = RichTable(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="")
    for number, name in enumerate(part.header):
        number_column = number in part.right
        result.add_column(name, overflow="fold",
                          justify="right" if number_column else "left",
                          min_width=max(len(name), *(len(row[number]) for row in
                                                     part.rows), 0)
                          if number_column else None)
    for row in part.rows:
        result.add_row(*row)
    return result
