"""Delimited text: CSV and its dialects, packed or not, by pandas.

Separators are told by the header and the first rows; lines that start with # are
comments, but the last above the numbers may be the header, as in EuRoC's
#timestamp [ns],w_RS_S_x [rad s^-1]. With other separators a comma is the decimal one.
"""

import bz2
import codecs
import csv
import gzip
import io
import itertools
import lzma
import re
import warnings
from typing import NamedTuple

import numpy as np

from sensorlab.readers.channels import UNIT, Group

MAX_BYTES = 4 * 2**30    # what a packed file may unpack to
PACKED = {".gz": gzip.open, ".bz2": bz2.open, ".xz": lzma.open}
SEPARATORS = ",", ";", "\t", "|", r"\s+"
SNIFFED, LONG = 200, 65536    # lines, and characters of them, that tell the dialect
NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.I)
MISSING = "", "NA", "N/A", "NULL", "NAN", "NONE"
COMMENTS = "#", "%", "//"
SAID = re.compile("sep=.")    # the first line of some spreadsheets
MORE_CELLS = re.compile(r"in line (\d+), saw (\d+)")    # as pandas says it
PREAMBLE = 50    # lines that may lie above the first row of numbers
PART = (r"[numkh\u00b5\u03bc]?(?:deg|rad|dps|g|m|s|sec|Hz|V|T|Pa)|min|hr?|K|%|counts?|"
        r"LSB|mbar|gauss|(?:deg|\u00b0) ?[CFs]?|C")
UNITS = re.compile(rf"-?|\[.*\]|\(.*\)|(?:{PART})(?:[/*](?:{PART})|\^?2|\u00b2)*", re.I)


class Dialect(NamedTuple):
    """How a text is laid out."""

    separator: str
    decimal: str
    skip: int       # lines above the first row
    names: list     # of its columns; "" where the header names none


def read(file):
    _check_size(file)
    with _opened(file) as stream:
        lines = [stream.readline(LONG) for _ in range(SNIFFED)]
    dialect = _dialect(lines)
    table = _table(file, dialect)
    arrays, refused = {}, {}
    for k, name in enumerate(dialect.names):
        if name in arrays:
            refused[name] = f"the header names {name} more than once"
        elif name:
            arrays[name], wrong = _column(file, dialect, name, table.iloc[:, k])
            if wrong:
                refused[name] = wrong
    return [Group(arrays, refused=refused)]


def _check_size(file):
    """Refuse a packed file that holds more than it may, before any of it is kept."""
    kind = file.suffix.lower()
    if kind in PACKED:
        left = MAX_BYTES
        with PACKED[kind](file) as stream:
            while part := stream.read(2**20):
                left -= len(part)
                if left < 0:
                    raise ValueError(f"unpacks to more than {MAX_BYTES / 2**30:.3g} "
                                     "GiB")


def _opened(file):
    """The text of a file, unpacked."""
    kind = file.suffix.lower()
    stream = PACKED[kind](file) if kind in PACKED else open(file, "rb")
    start = stream.read(LONG)
    stream.seek(0)
    return io.TextIOWrapper(stream, _encoding(start), errors="replace", newline="")


def _encoding(start):
    """The encoding of a text by its first bytes: some loggers write that of Windows,
    where the sign of micro or of a degree is one byte.
    """
    if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    for first, wide in (1, "utf-16-le"), (0, "utf-16-be"):    # without a mark of order
        if start[:64] and start[first::2].count(0) > 0.4 * len(start):
            return wide
    try:
        codecs.getincrementaldecoder("utf-8")().decode(start)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def _cells(line, separator):
    line = line.strip("\r\n")
    if separator == r"\s+":
        return line.split()
    return [cell.strip() for cell in next(csv.reader(
        [line], delimiter=separator, skipinitialspace=True), [])]


def _numeric(cells):
    return bool(cells) and all(NUMBER.fullmatch(c) or c.upper() in MISSING
                               for c in cells) and any(map(NUMBER.fullmatch, cells))


def _dialect(lines):
    """`Dialect` of a text from its first lines."""
    if any("\x00" in line for line in lines):
        raise ValueError("holds NUL bytes: it is no text")
    full = [(k, line) for k, line in enumerate(lines) if line.strip()
            and not (k == 0 and SAID.fullmatch(line.strip()))]
    plain = [(k, line) for k, line in full
             if not line.lstrip().startswith(COMMENTS)]
    above = [(k, line) for k, line in full if (k, line) not in plain
             and (not plain or k < plain[0][0])]
    if not plain:
        raise ValueError("no header and no row of numbers: a record has a line of "
                         "names, such as time,error, and a line for every sample")
    begin, units = _preamble([line for _, line in plain])
    first, rows = plain[begin], [line for _, line in plain[begin:begin + 20]]
    separator, numeric = _separator(rows[:1] + rows[1 + bool(units):])
    cells = _cells(first[1], separator)
    commented = _cells(_bare(above[-1][1]), separator) if above else []
    named = len(commented) == len(cells) and not any(map(NUMBER.fullmatch, commented))
    if named and (numeric or any(map(NUMBER.fullmatch, cells))):
        header, skip = _bare(above[-1][1]), first[0]
    elif not numeric:
        header, skip = first[1], plain[begin + bool(units)][0] + 1
        rows = rows[1 + bool(units):]
    else:
        header, skip = None, first[0]
    width = len(_cells(rows[0], separator)) if rows else 0
    names = [f"{k}" for k in range(1, width + 1)] if header is None else _cells(
        header, separator)
    if header is None and width == 1:
        names = ["error"]
    if any(_cells(rows[0], separator)[len(names):] if rows else ()):
        raise ValueError(f"the header has {len(names)} names but the first row "
                         f"{width} cells: a decimal comma needs another separator, "
                         "such as ;")
    names = [f"{name} [{unit}]" if unit and not UNIT.search(name) else name
             for name, unit in itertools.zip_longest(names, units, fillvalue="")]
    comma = any(
        re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", cell)
        for line in rows for cell in _cells(line, separator))
    return Dialect(separator, "," if comma else ".", skip,
                   names + [""] * (width - len(names)))


def _bare(comment):
    return comment.lstrip().lstrip("".join(COMMENTS)).strip()


def _preamble(lines):
    """How many lines lie above that of the names, and the units (C,) in a line below
    it: the last line of words above the first row of numbers that has as many of them.
    """
    for k in range(min(len(lines), PREAMBLE)):
        separator, numeric = _separator(lines[k:k + 20])
        if not numeric:
            continue
        width = len(_cells(lines[k], separator))
        above = [_cells(line, separator) for line in lines[:k]]
        units = above.pop() if len(above) > 1 and _are_units(above[-1]) else []
        names = above[-1] if above else []
        if len(names) == width and len({*names}) == width and all(
                re.search("[A-Za-z]", name) for name in names):
            return len(above) - 1, [unit.strip("[]()") for unit in units]
        break
    return 0, []


def _are_units(cells):
    """Are these the units of columns?"""
    return any(cells) and all(map(UNITS.fullmatch, cells))


def _separator(rows):
    """The separator of rows, of which the first may be a header, and whether that is
    numbers too.
    """
    def fits(separator):
        cells = [_cells(row, separator) for row in rows[:20]]
        below = [len(c) for c in cells[1:]] or [len(cells[0])]
        usual = max(set(below), key=below.count)
        return (usual > 1 and len(cells[0]) in (usual, usual - 1),
                len(cells[0]) > 1, any(map(_numeric, cells[1:])))
    separator = max(SEPARATORS, key=fits)
    if not fits(separator)[1]:
        separator = ","    # a single column
    return separator, _numeric(_cells(rows[0], separator))


def _table(file, dialect):
    import pandas
    with _opened(file) as stream, warnings.catch_warnings():
        warnings.simplefilter("error", pandas.errors.ParserWarning)
        for _ in range(dialect.skip):    # pandas would mind the quotes in comments
            stream.readline(LONG)
        try:
            return pandas.read_csv(
                stream, sep=dialect.separator, decimal=dialect.decimal, header=None,
                names=range(len(dialect.names)), comment="#", skipinitialspace=True,
                index_col=False, low_memory=False)
        except pandas.errors.EmptyDataError:
            return pandas.DataFrame({k: [] for k in range(len(dialect.names))})
        except pandas.errors.ParserError as problem:
            found = MORE_CELLS.search(str(problem))
            if not found:
                raise
            line, cells = map(int, found.groups())
            raise ValueError(
                f"line {line + dialect.skip} has {cells} cells, not "
                f"{len(dialect.names)}: a decimal comma needs another separator, such "
                "as ;") from None


def _column(file, dialect, name, x):
    """A column as numbers, as texts where few of them are, and what is wrong with it.
    """
    import pandas
    if x.dtype.kind in "iufb":
        return x.to_numpy(), None
    text = x.astype("string").str.strip()
    if dialect.decimal == ",":
        text = text.str.translate({ord(","): ".", ord("."): "?"})
    number = pandas.to_numeric(text, errors="coerce")
    values = number.to_numpy(float, na_value=np.nan)
    bad = (number.isna() & x.notna() & ~text.str.upper().isin(MISSING)).to_numpy(bool)
    if not bad.any():
        return values, None
    k = int(bad.argmax())
    with _opened(file) as stream:
        rows = (number for number, line in enumerate(stream, 1) if number > dialect.skip
                and line.strip() and not line.startswith("#"))
        line = next(itertools.islice(rows, k, None))
    return x.to_numpy(object) if bad.mean() > 0.5 else values, (
        f"line {line}: {str(x.iloc[k])[:40]!r} in column {name} is not a number")
