"""Sentences and tables as text, at any width."""

import pytest

from sensorlab import tables
from sensorlab.tables import Table, as_text

SENTENCE = "a sentence of many words, " * 6
TABLE = Table(("cause", "probability", "size [x]"), (
    ("bias_step", "0.98", "onset 122 +- 3 s, size 3 +- 0.1 deg/h, " * 4),
    ("a_name_without_any_space_at_all", "0.02", "")), (1,))


def test_in_a_pipe_every_row_is_one_line():
    lines = as_text(SENTENCE, TABLE).splitlines()
    assert len(lines) == 4 and lines[0] == SENTENCE.rstrip()
    assert lines[1].split() == ["cause", "probability", "size", "[x]"]
    assert lines[2].endswith("0.98  " + TABLE.rows[0][2].rstrip())
    assert lines[1].index("probability") + len("probability") == lines[2].index(
        "0.98") + 4


@pytest.mark.parametrize("width", [200, 80, 40])
def test_nothing_is_cut_at_any_width(width):
    text = as_text(SENTENCE, TABLE, width=width)
    assert max(map(len, text.splitlines())) <= width
    assert sorted("".join(text.split())) == sorted(
        "".join(as_text(SENTENCE, TABLE).split()))


def test_a_table_of_many_columns_is_set_in_parts():
    table = Table(("time, s", *(f"column_{k}" for k in range(5))), tuple(
        (f"{time}", *(f"0.{k}{time} +- 0.01" for k in range(5)))
        for time in (10, 200)), (0,), keys=1)
    lines = as_text(table, width=40).splitlines()
    assert max(map(len, lines)) <= 40
    part = ["time,", "10", "200"]
    assert [line.split()[:1] for line in lines] == [
        [word] if word else [] for word in (*part, "", *part, "", *part)]
    assert lines[9] == "     10  0.410 +- 0.01"
    assert len(as_text(table).splitlines()) == 3


@pytest.mark.parametrize("columns", [60, 150])
def test_a_terminal_gives_the_width(monkeypatch, capsys, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    tables.show(SENTENCE)
    assert capsys.readouterr().out == SENTENCE.rstrip() + "\n"
    monkeypatch.setattr(tables.sys.stdout, "isatty", lambda: True)
    tables.show(SENTENCE)
    assert columns - 12 < max(map(len, capsys.readouterr().out.splitlines())) <= columns
