"""Where names, units and numbers stand in a text file: nothing is declared that the file itself shows.

The numbers are found first, by what a typical line in the middle of the file looks like; names and units are the lines
above them. So lines above the header need not be counted, and those of known programs are understood:

- one line of names, or names in a comment (``numpy.savetxt``, Octave), with units in the names or in the line below;
- two lines, a marker or a segment above its X, Y and Z (Vicon, ``.trc``): ``LASI.x``;
- everything up to ``endheader`` (OpenSim's ``.mot`` and ``.sto``), which may state ``inDegrees``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from mcstudy.files.delimited import DELIMITERS, cells, decimal_sign, lines_of, number, row_names, stated_delimiter
from mcstudy.recordings.units import at_end, kind_of

SAMPLE = 60
"""Lines from the middle and the end of a file that tell what its rows of numbers look like."""

MOST_BELOW = 50
"""Most lines of text below the numbers."""

MOST_ABOVE = 10_000
"""Most lines above the numbers."""

COMMENTS = ("#", "%")
"""What comment lines begin with."""

BLANKS = " "
"""The delimiter of columns that any number of blanks separates."""

_WITH_UNIT = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]")

_WORD = re.compile(r'"[^"]*"|(?:[^\s"\[(]|\([^)]*\)?|\[[^\]]*\]?)+')
"""A name between blanks; blanks in quotes and in brackets belong to it."""

VICON = ("Trajectories", "Model Outputs", "Joints", "Segments", "Devices")
"""First lines of tables that Nexus exports; the second one is the rate in Hz."""

AXIS = re.compile(r"([xyz])\d*", re.IGNORECASE)

_OCTAVE = re.compile(r"^#\s*name:", re.MULTILINE)

_LENGTH = re.compile(r".*_t[xyz]", re.DOTALL)
"""Coordinates of OpenSim that are lengths: ``pelvis_tx``. All others of a file of coordinates are angles."""


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text file is written, as far as the user states it.

    Attributes
    ----------
    delimiter
        Between columns, a blank for any number of them; None to find it.
    decimal
        Decimal sign, ``"."`` or ``","``; None to find it.
    skip
        Lines above the header, or above the numbers where there is no header; None to find it.
    """

    delimiter: str | None = None
    decimal: str | None = None
    skip: int | None = None


@dataclass(frozen=True)
class Layout:
    """What `layout` finds.

    Attributes: delimiter and decimal sign; columns, their number; names, one per column, ``""`` for none; groups, the
    word above each name or ``""``; units, as stated for each column or None; rows, the lines of numbers with their
    number in the file; angle_unit, of every column that is an angle, or None; rate_hz or None; remarks, in words.
    """

    delimiter: str
    decimal: str
    columns: int
    names: tuple[str, ...]
    groups: tuple[str, ...]
    units: tuple[str | None, ...]
    rows: tuple[tuple[int, str], ...]
    angle_unit: str | None = None
    rate_hz: float | None = None
    remarks: tuple[str, ...] = ()


@dataclass
class _Rows:
    """How rows of numbers are written: of ``width`` cells, ``typical`` of them numbers, as a rule."""

    delimiter: str = BLANKS
    decimal: str = "."
    typical: int = 1
    first_is_number: bool = True
    width: int = 1
    widths: frozenset[int] = frozenset()

    def split(self, line: str) -> list[str]:
        return split(line, self.delimiter)

    def numbers(self, row: Sequence[str]) -> int:
        return sum(1 for c in row if c and number(c, self.decimal) is not None)

    def is_data(self, row: Sequence[str]) -> bool:
        """Whether cells are a row of numbers, one of which may be wrong."""
        begins_with_text = self.first_is_number and number(row[0], self.decimal) is None
        return 2 * self.numbers(row) >= self.typical and not begins_with_text


def split(line: str, delimiter: str) -> list[str]:
    """The cells of a line."""
    if delimiter != BLANKS:
        return cells(line, delimiter)
    if not any(c in line for c in '"[('):
        return line.split()
    return [w.strip('"') for w in _WORD.findall(re.sub(r"\s+(?=[\[(])", "", line))] or line.split()


def layout(text: str, dialect: Dialect) -> Layout:
    """Where names, units and numbers are in a text; `ValueError`, one line, where there are no rows of numbers."""
    every = [(k, line) for k, line in enumerate(lines_of(text), start=1) if line.strip()]
    if text.startswith("#") and len(_OCTAVE.findall(text)) > 1:
        raise ValueError("expected one matrix, found a file of Octave with several variables; save it with -v7 as .mat")
    of_program, rate_hz, angle_unit, length = _program(every)
    lines = [(k, line) for k, line in every if k > max(of_program, dialect.skip or 0)]
    stated = stated_delimiter(lines[0][1]) if lines else None
    if stated:
        del lines[0]
    body = _without_comments(lines)
    if not body:
        raise ValueError("expected rows of numbers, found none")
    seen = _typical(body, dialect, dialect.delimiter or stated)
    start = _first_row(body, seen, dialect.skip is not None)
    stop, remarks = _last_row(body, start, seen)
    rows = body[start:stop]
    above = [(k, line) for k, line in lines if k < rows[0][0]]
    declared = len(_without_comments(above)) if dialect.skip else 0
    if dialect.skip:
        above = [*[(k, line) for k, line in every if of_program < k <= dialect.skip][-1:], *above]
    columns, heads = _heads(rows, seen, above)
    _check_widths(rows, seen, columns)
    names, groups, units = _named(heads, columns, length, declared == 2)
    if angle_unit is not None:
        units = tuple(
            u or ("m" if _LENGTH.fullmatch(n) else "s" if n == "time" else None)
            for n, u in zip(names, units, strict=True)
        )
    return Layout(
        seen.delimiter, seen.decimal, columns, names, groups, units, tuple(rows), angle_unit, rate_hz, remarks
    )


def _without_comments(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    return [(k, line) for k, line in lines if not line.lstrip().startswith(COMMENTS)]


def _program(lines: list[tuple[int, str]]) -> tuple[int, float | None, str | None, str | None]:
    """Last line of a known program's own header, and the rate, the unit of angles and of lengths that it states."""
    if lines and lines[0][1].startswith("PathFileType") and len(lines) > 3:
        keys, values = (line.split("\t") for _, line in lines[1:3])
        stated = dict(zip((k.strip() for k in keys), (v.strip() for v in values), strict=False))
        rate = number(stated.get("DataRate", ""))
        return lines[2][0], rate if rate and rate > 0 else None, None, stated.get("Units") or None
    if lines and lines[0][1].strip(" ,;") in VICON and len(lines) > 3:
        rate = number(lines[1][1].strip(" ,;"))
        return lines[1][0], rate if rate and rate > 0 else None, None, None
    for k, line in lines[:MOST_ABOVE]:
        if line.strip().lower() == "endheader":
            head = [text.replace(" ", "").lower().strip() for n, text in lines if n < k]
            said = next((text for text in head if text.startswith("indegrees=")), None)
            unit = None if said is None else "deg" if said.endswith("yes") else "rad"
            return k, None, unit, None
    return 0, None, None, None


def _typical(body: list[tuple[int, str]], dialect: Dialect, delimiter: str | None) -> _Rows:
    """How the rows of numbers are written, from lines in the later part of the file."""
    late = [line for _, line in body[len(body) // 4 :]]
    sample = late[:: max(1, len(late) // SAMPLE)]
    seen = _Rows(decimal=dialect.decimal or ".")
    seen.delimiter = delimiter or _delimiter(sample, dialect.decimal)
    found = [seen.split(line) for line in sample]
    if dialect.decimal is None:
        seen.decimal = decimal_sign([c for row in found for c in row])
    counts = [seen.numbers(row) for row in found]
    if max(counts) == 0:
        raise ValueError(
            "expected rows of numbers under the header, found none; if another sign separates the columns, state it "
            "(text.delimiter, --delimiter)"
        )
    seen.typical = max(counts)
    rows = [row for row, n in zip(found, counts, strict=True) if 2 * n >= seen.typical]
    seen.first_is_number = 2 * sum(number(row[0], seen.decimal) is not None for row in rows) > len(rows)
    widths = [len(row) for row in rows]
    seen.width, seen.widths = max(set(widths), key=widths.count), frozenset(widths)
    return seen


def _delimiter(sample: Sequence[str], decimal: str | None) -> str:
    """Tab, semicolon or comma in most lines, else blanks; a comma inside every number is a decimal sign."""
    delimiter = next((d for d in DELIMITERS if 2 * sum(d in line.strip() for line in sample) > len(sample)), BLANKS)
    if delimiter != ",":
        return delimiter
    if decimal == ",":
        return BLANKS
    by_blanks = [line.split() for line in sample]
    decimals = all(len(row) > 1 and all(number(c, ",") is not None for c in row) for row in by_blanks)
    return BLANKS if decimals and decimal is None else ","


def _first_row(body: list[tuple[int, str]], seen: _Rows, header_first: bool) -> int:
    """Index of the first row of numbers. Names may be numbers only in the first line: 0, 1, 2, ... of a data frame."""
    for k, (_, line) in enumerate(body):
        row = seen.split(line)
        if k == 0 and len(body) > 1 and (_counted(row) or (header_first and number(row[0], seen.decimal) is None)):
            continue
        after = body[k + 1][1] if k + 1 < len(body) else None
        if not seen.is_data(row) or not (after is None or seen.is_data(seen.split(after))):
            continue  # numbers above the names, as OptiTrack writes those of segments
        while k > 0 and _only_numbers(above := seen.split(body[k - 1][1]), seen) and len(above) == seen.width:
            k -= 1
            if k == 0 and _counted(above):
                return 1
        return k
    raise ValueError("expected rows of numbers under the header, found none")


def _counted(row: Sequence[str]) -> bool:
    """Whether a line counts its columns from 0 or 1, or names the first nothing and counts the others."""
    rest = list(row if row[0] else row[1:])
    return len(rest) > 1 and any(rest == [str(j + k) for k in range(len(rest))] for j in (0, 1))


def _only_numbers(row: Sequence[str], seen: _Rows) -> bool:
    return seen.numbers(row) > 0 and all(number(c, seen.decimal) is not None for c in row)


def _last_row(body: list[tuple[int, str]], start: int, seen: _Rows) -> tuple[int, tuple[str, ...]]:
    """Index after the last row of numbers; lines of text and empty cells below it are left out, which is told."""
    stop = len(body)
    while stop > start + 1 and len(body) - stop < MOST_BELOW:
        row = seen.split(body[stop - 1][1])
        empty = not any(row)
        text = number(row[0], seen.decimal) is None and (seen.first_is_number or not seen.numbers(row))
        if not (empty or text):
            break
        stop -= 1
    below = [(k, line) for k, line in body[stop:] if any(seen.split(line))]
    if not below:
        return stop, ()
    place = f"line {below[0][0]}" if len(below) == 1 else f"lines {below[0][0]} to {below[-1][0]}"
    return stop, (f"{place} below the numbers left out ({below[0][1].strip()[:60]})",)


def _heads(rows: list[tuple[int, str]], seen: _Rows, above: list[tuple[int, str]]) -> tuple[int, list[list[str]]]:
    """Number of columns, and the lines of names and units above the numbers, the nearest first, a cell per column."""
    columns, heads = seen.width, list[list[str]]()
    nearest = next((len(_trimmed(seen.split(line))) for _, line in reversed(_without_comments(above))), 0)
    columns = nearest if nearest in seen.widths else columns
    empty = 0 if seen.delimiter == BLANKS else min(_empty_at_end(line, seen.delimiter) for _, line in rows)
    for k, line in reversed(above):
        comment = line.lstrip().startswith(COMMENTS)
        given = _trimmed(seen.split(line.lstrip().lstrip("".join(COMMENTS)).strip(" ") if comment else line))
        if not heads and columns - empty <= len(given) < columns:
            columns = len(given)
        head = _fitting(given, columns, seen, rows) or (_other_delimiter(line, columns) if comment else None)
        if head is None and heads and not comment and columns - 2 <= len(seen.split(line)) and len(given) <= columns:
            head = given + [""] * (columns - len(given))  # words above groups of columns
        if head is None or _only_numbers(head, seen):
            if comment and not heads:
                continue
            if not heads and len(given) > 1 and not _only_numbers(given, seen):
                raise ValueError(
                    f"line {k}: the header names {len(given)} columns, the rows have {seen.width}; if this is "
                    "no header, state the lines above the numbers (text.skip, --skip)"
                )
            break
        heads.append(head)
        if len(heads) == 3:
            break
    return columns if heads else columns - empty, heads


def _empty_at_end(line: str, delimiter: str) -> int:
    """How many delimiters end a line."""
    bare = line.replace(" ", "")
    return len(bare) - len(bare.rstrip(delimiter))


def _trimmed(row: list[str]) -> list[str]:
    """Cells up to the last that is not empty."""
    return row[: max((k + 1 for k, c in enumerate(row) if c), default=0)]


def _fitting(given: list[str], columns: int, seen: _Rows, rows: list[tuple[int, str]]) -> list[str] | None:
    """Cells as one per column, None for a line that does not fit; R names the columns but not its names of rows."""
    if len(given) == columns:
        return given
    if len(given) == columns + 1 and given[-1].lower() == "comment":  # LabVIEW names them, and writes none
        return given[:-1]
    if len(given) == columns - 1 and row_names([seen.split(row)[0] for _, row in rows]):
        return ["", *given]
    return None


def _other_delimiter(line: str, columns: int) -> list[str] | None:
    """Names in a comment, between which another sign may stand than between the numbers."""
    tried = (split(line.lstrip("".join(COMMENTS) + " \t"), d) for d in (*DELIMITERS, BLANKS))
    return next((head for head in tried if len(head) == columns), None)


def _check_widths(rows: list[tuple[int, str]], seen: _Rows, columns: int) -> None:
    """Raise `ValueError` for a row of another number of columns; empty cells behind them do not count."""
    for k, line in rows:
        quick = '"' not in line
        n = (len(line.split()) if seen.delimiter == BLANKS else line.count(seen.delimiter) + 1) if quick else None
        if n != columns:
            row = seen.split(line)
            beyond = [c for c in row[columns:] if c and not c.startswith(COMMENTS)]  # LabChart's comments
            if len(row) < columns or beyond:
                begins = k > rows[0][0] and number(row[0], seen.decimal) is None
                below = "; does another table begin here? cut the file" if begins else ""
                raise ValueError(f"line {k}: expected {columns} columns, got {len(row)}{below}")


def _named(
    heads: list[list[str]], columns: int, length: str | None, with_units: bool
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str | None, ...]]:
    """Names, the words above them, and units of the columns from the lines above the numbers, the nearest first."""
    nothing = [""] * columns
    if not heads:
        return (), (), (None,) * columns
    below, distinct = nothing, [_tells_apart(head) for head in heads]
    if len(heads) > 1 and (with_units or _are_units(heads[0]) or distinct[:2] == [False, True]):
        below, *heads = heads
    names = heads[0]
    over = heads[1] if len(heads) > 1 and not _tells_apart(names) else nothing
    columns_named, groups, units, group = [], [], [], ""
    for name, word, unit in zip(names, over, below, strict=True):
        group = word or (group if name else "")
        axis = AXIS.fullmatch(name) if group else None
        match = _WITH_UNIT.fullmatch(name)
        plain, inside = (match["name"], match["unit"].strip()) if match and match["name"] else (name, "")
        columns_named.append(plain or group)
        groups.append(group if name else "")
        units.append(unit.strip("[](){} ") or inside or at_end(name) or (length if axis else None))
    return tuple(columns_named), tuple(groups), tuple(units)


def _tells_apart(names: list[str]) -> bool:
    """Whether every column has a name of its own."""
    return all(names) and len(set(names)) == len(names)


def _are_units(head: Sequence[str]) -> bool:
    """Whether most cells are units, or in brackets."""
    given = [c for c in head if c]
    known = sum(kind_of(c) is not None or (c[0] in "[(" and c[-1] in "])") for c in given)
    return 2 * known >= len(given)
