"""Delimited text as other programs write it: its encoding, its delimiter, its numbers, and tables with a header.

Spreadsheets write a byte order mark, UTF-16, ``sep=;`` in the first line, a decimal comma, and empty cells behind a
row; R writes a column of row names without a name. None of this changes what a table says, so none of it is refused.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from mcstudy.errors import InputError, StoreError
from mcstudy.files.untrusted import real_bytes

NUMBER = re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?|nan)", re.ASCII | re.IGNORECASE)
"""Pattern of a number in a text file. Python's ``float`` would also accept 1_000 and digits of other scripts."""

MISSING = frozenset(
    ("", "na", "n/a", "#n/a", "nan", "-nan", "nan(ind)", "-nan(ind)", "1.#qnan", "-1.#qnan", "-1.#ind", "null", "<na>")
)
"""Cells without a number, in small letters."""

WORKBOOKS = {b"PK\3\4": "workbook (.xlsx, .ods) or another archive", b"\xd0\xcf\x11\xe0": "workbook (.xls)"}
"""First bytes of files that spreadsheets save for themselves."""

DELIMITERS = ("\t", ";", ",")
"""Delimiters that are looked for, in this order: a comma may also stand in a name or be a decimal sign."""

_SEPARATOR = re.compile(r'"?sep=(.)"?', re.IGNORECASE)

_QUOTED = re.compile(r'"[^"]*"')

_COMMA = re.compile(r"[+-]?\d*,\d+(?:e[+-]?\d+)?", re.ASCII | re.IGNORECASE)

_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+", re.ASCII)


def decoded(raw: bytes) -> str:
    """The text of a file in UTF-8, UTF-16 or Windows' code page 1252; `ValueError`, one line, for anything else."""
    if kind := WORKBOOKS.get(raw[:4]):
        raise ValueError(f"expected text, found a {kind}; save the sheet as CSV")
    encoding = "utf-8-sig"
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    elif b"\0" in raw[:10_000]:  # UTF-16 without a mark: every other byte of plain text is zero
        encoding = "utf-16-be" if raw[0:1] == b"\0" else "utf-16-le"
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError:
        if encoding != "utf-8-sig":
            raise ValueError("expected a text file, found other bytes; export it as CSV") from None
    try:
        return raw.decode("cp1252")
    except UnicodeDecodeError as error:
        raise ValueError(f"expected a text file: {error}") from None


def lines_of(text: str) -> list[str]:
    """The lines of a text from Windows, Unix or an old Macintosh."""
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def stated_delimiter(line: str) -> str | None:
    """The delimiter that a first line ``sep=;`` states."""
    match = _SEPARATOR.fullmatch(line.strip(" "))
    return match[1] if match else None


def cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line without blanks and quotes around them."""
    if '"' not in line:
        return [c.strip() for c in line.split(delimiter)]
    return [c.strip() for c in next(records([line], delimiter), [""])]


def records(lines: Iterable[str], delimiter: str) -> Iterator[list[str]]:
    """Rows of cells as `csv.reader` finds them; `ValueError` for a cell that is too long."""
    try:
        yield from csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    except csv.Error as error:
        raise ValueError(f"expected cells of text or numbers ({error})") from None


def decimal_sign(cells: Sequence[str]) -> str:
    """Decimal sign of the numbers in cells; `ValueError` where it cannot be told."""
    with_comma = [c for c in cells if _COMMA.fullmatch(c)]
    if not with_comma or any("." in c and NUMBER.fullmatch(c) for c in cells):
        return "."
    if all(map(_THOUSANDS.fullmatch, with_comma)):
        raise ValueError(
            f"is the comma of {with_comma[0]!r} a decimal sign or between thousands? state decimal, or write points"
        )
    return ","


def number(cell: str, decimal: str = ".") -> float | None:
    """The number in a cell, nan for a missing one, None for text."""
    text = cell.replace(decimal, ".", 1) if decimal != "." and "." not in cell else cell
    if NUMBER.fullmatch(text):
        return float(text)
    return float("nan") if cell.lower() in MISSING else None


def row_names(first: Sequence[str]) -> bool:
    """Whether the first cells of all rows are names of rows, as R writes them: 1, 2, 3 and so on, or unlike words."""
    return list(first) == [str(k) for k in range(1, len(first) + 1)] or (
        1 < len(set(first)) == len(first) and not any(c == "" or NUMBER.fullmatch(c) for c in first)
    )


class Labelled(NamedTuple):
    """A table with one line of names: ``rows`` are pairs of line number and one cell per name."""

    header: list[str]
    rows: list[tuple[int, list[str]]]

    def column(self, name: str) -> int:
        """Position of the column of a name; `ValueError`, one line, unless there is exactly one."""
        if self.header.count(name) != 1:
            near = next((h for h in self.header if h.casefold() == name.casefold() != h), "")
            hint = f" (similar: {near})" if near and name not in self.header else ""
            raise ValueError(
                f"expected one column {name!r} in the first line, found {', '.join(self.header) or 'nothing'}{hint}"
            )
        return self.header.index(name)


def read_labelled(path: Path, largest: int, *, name_rows: bool = True) -> Labelled:
    """The table in a CSV file of at most ``largest`` bytes, see `labelled`; `InputError` without the file's name."""
    try:
        return labelled(real_bytes(path, largest, follow=True), name_rows=name_rows)
    except (OSError, StoreError) as error:
        why = getattr(error, "strerror", None) or str(error).removeprefix(f"{path}: ")
        raise InputError(f"cannot be read: {why}") from None
    except ValueError as error:
        raise InputError(str(error)) from None


def labelled(raw: bytes, *, name_rows: bool = True) -> Labelled:
    """The table in a CSV file; `ValueError`, one line that names a line, for rows of another length than the header.

    ``name_rows``: whether one more cell in front of every row may be the name of the row.
    """
    lines = lines_of(decoded(raw))
    delimiter = stated_delimiter(lines[0])
    skipped = 1 if delimiter else 0
    first = next((line for line in lines[skipped:] if line.strip()), "")
    bare = _QUOTED.sub("", first)
    delimiter = delimiter or max((",", *DELIMITERS), key=bare.count)  # a comma where there is none of them
    whole = (f"{line}\n" for line in lines[skipped:])
    reader = csv.reader(whole, delimiter=delimiter, skipinitialspace=True, strict=True)
    found: list[tuple[int, list[str]]] = []
    at = skipped + 1
    try:
        for row in reader:
            if any(c.strip() for c in row):
                found.append((at, [c.strip() for c in row]))
            at = reader.line_num + skipped + 1
    except csv.Error as error:
        raise ValueError(f"line {at}: expected cells of text or numbers, with quotes in pairs ({error})") from None
    if not found:
        return Labelled([], [])
    header, rows = found[0][1], found[1:]
    while header and not header[-1]:
        header.pop()
    named = name_rows and all(len(c) == len(header) + 1 for _, c in rows) and any(c[-1] for _, c in rows)
    if named and row_names([c[0] for _, c in rows]):
        header.insert(0, "")
    for k, row in rows:
        if len(row) < len(header) or any(row[len(header) :]):
            raise ValueError(f"line {k}: {_miscounted(row, len(header), delimiter)}")
        del row[len(header) :]
    return Labelled(header, rows)


def _miscounted(row: list[str], expected: int, delimiter: str) -> str:
    words = f"expected {expected} columns, got {len(row)}"
    if len(row) == expected + 1:
        return f"{words}; row names need a column name too (in R: row.names = FALSE)"
    if delimiter == "," and len(row) > expected:
        return f"{words}; where numbers have decimal commas, separate columns by semicolons"
    if len(row) == 1:
        return f"{words}; remove lines that are no rows of the table"
    return words
