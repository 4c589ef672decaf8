"""Columns of text files: CSV and exports of spreadsheets with a header, or bare numbers separated by blanks.

The header is one line of names, which may state units, ``theta1 (deg)``, or is followed by a line of units. Lines above
it, another delimiter and a decimal comma are declared (`Dialect`). Empty cells and NA are missing numbers (nan).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from mcstudy.errors import RecordingError, StoreError
from mcstudy.files.local_path import local_path
from mcstudy.files.untrusted import real_bytes
from mcstudy.recordings.variables import Source, Variable

LARGEST_FILE = 1 << 30
"""Largest text file, bytes."""

LARGEST_NUMBER = 1e15
"""Largest accepted number. No sensible unit gives more (milliseconds since 1970 are 2e12); more could overflow."""

NUMBER = re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?|nan)", re.ASCII | re.IGNORECASE)
"""Pattern of a number in a text file. Python's ``float`` would also accept 1_000 and digits of other scripts."""


def content(path: Path, most: int) -> bytes:
    """Bytes of a file of at most ``most``; raises `RecordingError` for anything else."""
    try:
        return real_bytes(path, most, follow=True)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    except StoreError as error:
        raise RecordingError(str(error)) from error


DELIMITERS = (",", ";", "\t")
"""Delimiters that are looked for; without any, columns are separated by blanks."""

MISSING = ("", "na", "n/a", "nan")
"""Cells without a number, in small letters."""

_WITH_UNIT = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]")


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text file is written.

    Attributes
    ----------
    delimiter
        Between columns; None for the first of comma, semicolon and tab in the header, else blanks.
    decimal
        Decimal sign, ``"."`` or ``","``.
    skip
        Lines above the header, or above the numbers where there is no header.
    """

    delimiter: str | None = None
    decimal: str = "."
    skip: int = 0


class TextTable:
    """One text file of numbers, read whole.

    Attributes: path; names, the header's column names (empty without a header); units, one per name, as the file states
    them or None; values (rows, columns) float64. Raises `RecordingError` with the line of a value that is not a number.
    """

    def __init__(self, path: str | Path, dialect: Dialect | None = None) -> None:
        self.path = path = local_path(path)
        dialect = dialect or Dialect()
        lines = _text(path).splitlines()
        numbered = [
            (k, line)
            for k, line in enumerate(lines, start=1)
            if k > dialect.skip and line.strip() and line.lstrip()[0] != "#"
        ]
        if not numbered:
            raise RecordingError(f"{path}: expected rows of numbers, found none")
        if dialect.decimal != ".":
            numbered = [(k, line.replace(dialect.decimal, ".")) for k, line in numbered]
        delimiter = dialect.delimiter
        if delimiter is None:
            delimiter = next((d for d in DELIMITERS if d in numbered[0][1]), None)
        elif delimiter == " ":
            delimiter = None
        first = [c.strip() for c in numbered[0][1].split(delimiter)]
        self.names: tuple[str, ...] = ()
        self.units: tuple[str | None, ...] = ()
        if not _is_number(first[0]):
            del numbered[0]
            self.names, self.units = _header(first, numbered, delimiter)
        self.values = self._parse(numbered, delimiter)

    def _parse(self, numbered: list[tuple[int, str]], delimiter: str | None) -> np.ndarray:
        if not numbered:
            raise RecordingError(f"{self.path}: expected rows of numbers under the header, found none")
        try:
            values = np.loadtxt([line for _, line in numbered], delimiter=delimiter, ndmin=2)
        except ValueError:
            values = self._parse_cells(numbered, delimiter)
        large = np.argwhere(np.isfinite(values) & (np.abs(values) > LARGEST_NUMBER))
        if large.size:
            row, column = large[0]
            raise RecordingError(
                f"{self.path}: line {numbered[row][0]}, column {self._label(column)!r}: expected numbers up to "
                f"{LARGEST_NUMBER:g}, got {values[row, column]:g}"
            )
        return values

    def _parse_cells(self, numbered: list[tuple[int, str]], delimiter: str | None) -> np.ndarray:
        """Cell by cell: some are missing, or one is wrong and has to be named."""
        width = len(self.names) or len(numbered[0][1].split(delimiter))
        values = np.full((len(numbered), width), np.nan)
        for row, (k, line) in enumerate(numbered):
            cells = [c.strip() for c in line.split(delimiter)]
            if len(cells) != width:
                raise RecordingError(f"{self.path}: line {k}: expected {width} columns, got {len(cells)}")
            for c, cell in enumerate(cells):
                if _is_number(cell):
                    values[row, c] = float(cell)
                elif cell.lower() not in MISSING:
                    raise RecordingError(
                        f"{self.path}: line {k}, column {self._label(c)!r}: expected a number, got {cell!r}"
                        + (_COMMA_HINT if _is_number(cell.replace(",", ".", 1)) else "")
                    )
        return values

    def _label(self, column: int) -> str:
        return self.names[column] if column < len(self.names) else str(column)

    def column(self, key: str | int) -> np.ndarray:
        """One column by its header name or its number from 0, (rows,)."""
        if isinstance(key, str):
            if key not in self.names:
                have = ", ".join(self.names) if self.names else "no header"
                raise RecordingError(f"{self.path}: column {key!r} is missing; found {have}")
            key = self.names.index(key)
        if not 0 <= key < self.values.shape[1]:
            raise RecordingError(f"{self.path}: column {key}: the file has columns 0 to {self.values.shape[1] - 1}")
        return self.values[:, key]


_COMMA_HINT = '; is the decimal sign a comma (decimal = ",")?'


def text_source(path: Path, dialect: Dialect) -> Source:
    """The columns of a text file as variables."""
    table = TextTable(path, dialect)
    names = table.names or tuple(map(str, range(table.values.shape[1])))
    if len(names) != table.values.shape[1]:
        raise RecordingError(f"{path}: the header names {len(names)} columns, the rows have {table.values.shape[1]}")
    units = table.units or (None,) * len(names)
    variables: dict[str, Variable] = {}
    for k, (name, unit) in enumerate(zip(names, units, strict=True)):
        if name not in variables:
            variables[name] = Variable(name, (table.values.shape[0],), partial(_column, table.values, k), unit)
    return Source(path, "text", variables, names)


def _column(values: np.ndarray, k: int) -> np.ndarray:
    return values[:, k]


def _header(
    names: list[str], numbered: list[tuple[int, str]], delimiter: str | None
) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
    """Names and units of columns; units stand in the names or in the line below, which is then taken away."""
    below = [c.strip() for c in numbered[0][1].split(delimiter)] if numbered else []
    if len(below) == len(names) and not any(map(_is_number, below)) and any(c.lower() not in MISSING for c in below):
        del numbered[0]
        return tuple(names), tuple(c.strip("[]() ") or None for c in below)
    matches = [_WITH_UNIT.fullmatch(name) for name in names]
    return (
        tuple(m["name"] if m and m["name"] else n for m, n in zip(matches, names, strict=True)),
        tuple(m["unit"].strip() or None if m and m["name"] else None for m in matches),
    )


def _text(path: Path) -> str:
    """The text of a file in UTF-8, UTF-16 (as spreadsheets export it) or Windows' code page 1252."""
    raw = content(path, LARGEST_FILE)
    try:
        if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
            return raw.decode("utf-16")
        try:
            return raw.decode("utf-8-sig")
        except UnicodeDecodeError:
            if b"\0" in raw[:10_000]:
                raise
            return raw.decode("cp1252")
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: expected a text file: {error}") from error


def _is_number(text: str) -> bool:
    return NUMBER.fullmatch(text.strip()) is not None
