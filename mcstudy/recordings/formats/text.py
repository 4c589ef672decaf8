"""Columns of text files as variables: CSV, exports of spreadsheets and measuring programs, OpenSim's tables.

`mcstudy.recordings.formats.text_layout` finds names, units and numbers; a column is read when it is asked for, so one
of text does not disturb. Time stamps become seconds. Empty cells and NA are missing numbers (nan).
"""

from __future__ import annotations

import re
from datetime import datetime
from functools import partial
from pathlib import Path

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.files.delimited import decoded, number, records
from mcstudy.recordings.formats.source import TEXTS, Source, Variable
from mcstudy.recordings.formats.text_layout import AXIS, BLANKS, Dialect, Layout, layout, split
from mcstudy.recordings.guards import content
from mcstudy.recordings.refusals import refused

LARGEST_FILE = 1 << 30
"""Largest text file, bytes."""

LARGEST_NUMBER = 1e15
"""Largest accepted number. No sensible unit gives more (milliseconds since 1970 are 2e12); more could overflow."""

FIRST = 100
"""Rows that tell numbers from text and time stamps."""

STAMPS = "time stamps"

_STAMP = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d.*|\d\d?:\d\d:\d\d(?:[.,]\d+)?", re.ASCII)
"""A time stamp of ISO 8601, or a time of the day."""

_BOOLEAN = {"true": 1.0, "false": 0.0}


def source(path: Path, dialect: Dialect) -> Source:
    """The columns of a text file as variables; raises `RecordingError` with the line of what cannot be read."""
    with refused(ValueError, where=path):
        table = layout(decoded(content(path, LARGEST_FILE)), dialect)
        head = [split(line, table.delimiter) for _, line in table.rows[:FIRST]]
    names, plain = _distinct(table)
    variables = {}
    for k, name in enumerate(names):
        kind = _kind([row[k] for row in head], table.decimal)
        variables[name] = Variable(
            name,
            (len(table.rows),),
            partial(_stamps if kind == STAMPS else _numbers, table, k, f"{path}: ", name),
            "s" if kind == STAMPS else table.units[k],
            table.rate_hz,
            angle_unit=table.angle_unit,
            content=kind,
        )
    return Source(path, "text", variables, names, plain, table.remarks)


def _kind(first: list[str], decimal: str) -> str:
    """What a column holds, from its first cells; empty for numbers."""
    texts = [c for c in first if c.lower() not in _BOOLEAN and number(c, decimal) is None]
    if texts and _STAMP.fullmatch(texts[0]):
        return STAMPS
    return TEXTS if texts else ""


def _distinct(table: Layout) -> tuple[tuple[str, ...], dict[str, tuple[int, ...]]]:
    """A name for every column that no other has, and the columns of every name as the file states it."""
    stated = table.names or tuple(map(str, range(table.columns)))
    groups = table.groups or ("",) * table.columns
    full = []
    plain: dict[str, tuple[int, ...]] = {}
    for k, (group, name) in enumerate(zip(groups, stated, strict=True)):
        axis = AXIS.fullmatch(name)
        full.append(f"{group}.{axis[1].lower() if axis else name}" if group else name or f"column {k}")
        for each in dict.fromkeys((name, full[-1])):
            plain[each] = (*plain.get(each, ()), k)
    plain.pop("", None)
    return tuple(n if full.count(n) == 1 else f"{n} [{k}]" for k, n in enumerate(full)), plain


def _cells(table: Layout, column: int, where: str) -> list[str]:
    """The cells of a column, one per row."""
    if table.delimiter == BLANKS:
        return [split(line, BLANKS)[column] for _, line in table.rows]
    try:
        rows = list(records((line for _, line in table.rows), table.delimiter))
    except ValueError as error:
        raise RecordingError(f"{where}{error}") from None
    if len(rows) != len(table.rows):
        raise RecordingError(f"{where}a quoted cell is not closed, or holds a line break")
    return [row[column].strip() for row in rows]


def _numbers(table: Layout, column: int, where: str, name: str) -> np.ndarray:
    """The numbers of a column (n,), nan for missing ones, 1 and 0 for true and false."""
    delimiter = None if table.delimiter == BLANKS else table.delimiter
    try:
        if table.decimal != ".":
            raise ValueError
        lines = [line for _, line in table.rows]  # loadtxt refuses what Python takes for a number: 1_000
        values = np.loadtxt(lines, delimiter=delimiter, usecols=column, comments=None, quotechar='"', ndmin=1)
        if values.size != len(lines):
            raise ValueError
    except ValueError:
        values = np.array([_value(c, k, table, where, name) for k, c in enumerate(_cells(table, column, where))])
    large = np.flatnonzero(np.isfinite(values) & (np.abs(values) > LARGEST_NUMBER))
    if large.size:
        k = int(large[0])
        raise RecordingError(
            f"{_place(k, table, where, name)}: expected numbers up to {LARGEST_NUMBER:g}, got {values[k]:g}"
        )
    return values


def _value(cell: str, row: int, table: Layout, where: str, name: str) -> float:
    value = _BOOLEAN.get(cell.lower(), number(cell, table.decimal))
    if value is None:
        hint = '; is the decimal sign a comma (decimal = ",")?' if number(cell, ",") is not None else ""
        raise RecordingError(f"{_place(row, table, where, name)}: expected a number, got {cell[:60]!r}{hint}")
    return value


def _stamps(table: Layout, column: int, where: str, name: str) -> np.ndarray:
    """Seconds since the first of the time stamps in a column (n,)."""
    times: list[float] = []
    first: datetime | None = None
    for k, cell in enumerate(_cells(table, column, where)):
        try:
            if "-" not in cell:
                hours, minutes, seconds = cell.replace(",", ".").split(":")
                times.append(3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds))
                continue
            stamp = datetime.fromisoformat(cell.replace(",", "."))
            first = first or stamp
            times.append((stamp - first).total_seconds())
        except (ValueError, TypeError):  # the second where only some state a time zone
            raise RecordingError(
                f"{_place(k, table, where, name)}: expected a time stamp as in the lines above, got {cell[:60]!r}"
            ) from None
    return np.array(times) - times[0]


def _place(row: int, table: Layout, where: str, name: str) -> str:
    return f"{where}line {table.rows[row][0]}, column {name!r}"
