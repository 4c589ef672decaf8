"""Who was recorded, and in which condition: from a table that a person writes, or from lists.

A table is a CSV file with a header and one row per recording. The columns `file` (relative to the table) and `person`
are required; a further column, by default `condition`, says what is compared. Other columns are ignored.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from mcstudy.errors import InputError
from mcstudy.files.delimited import read_labelled
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.recording import Recording

Item = TypeVar("Item")

LARGEST_TABLE = 1_000_000
"""Bytes of a table of people."""

ALL = "all"
"""The condition of recordings that have none."""

CONDITION = "condition"
"""Column that is compared unless another is named."""


@dataclass(frozen=True)
class Member(Generic[Item]):
    """One person in one condition.

    Attributes
    ----------
    person, condition
        Their names.
    items
        What is known of this person in this condition: recordings, which are pooled.
    conditions
        The condition of each of the ``items`` where all conditions are fitted at once; empty otherwise.
    """

    person: str
    condition: str
    items: tuple[Item, ...]
    conditions: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Of person and condition."""
        return self.person if self.condition == ALL else f"{self.person}, {self.condition}"


def members(items: Sequence[Item], person: Sequence[str], condition: Sequence[str] | None) -> list[Member[Item]]:
    """Items by person and condition, both in the order in which they first appear.

    Raises `InputError` for lists of another length, and for names that are not text or are empty.
    """
    conditions = [ALL] * len(items) if condition is None else condition
    for what, names in (("person", person), (CONDITION, conditions)):
        if isinstance(names, str) or len(names) != len(items):
            got = repr(names) if isinstance(names, str) else f"{len(names)} names"
            raise InputError(f"{what}: expected one name per recording, {len(items)} in all, got {got}")
        for k, name in enumerate(names, start=1):
            if not isinstance(name, str) or not name.strip():
                raise InputError(f"{what}: recording {k}: expected a name, got {name!r}")
    groups: dict[tuple[str, str], list[Item]] = {}
    for c in dict.fromkeys(conditions):
        for item, p, stated in zip(items, person, conditions, strict=True):
            if stated == c:
                groups.setdefault((p.strip(), c.strip()), []).append(item)
    return [Member(p, c, tuple(group)) for (p, c), group in groups.items()]


def at_once(known: Sequence[Member[Item]]) -> list[Member[Item]]:
    """One member for each person, who has all conditions."""
    people: dict[str, list[Member[Item]]] = {}
    for m in known:
        people.setdefault(m.person, []).append(m)
    return [
        Member(
            person,
            ALL,
            tuple(item for m in own for item in m.items),
            tuple(m.condition for m in own for _ in m.items),
        )
        for person, own in people.items()
    ]


def named(
    recordings: Sequence[Recording | FrfRecording], files: Sequence[Path], column: str | None
) -> list[Member[Recording | FrfRecording]]:
    """Recordings by the person and condition that they state themselves.

    Raises `InputError` for a recording that does not state its person, and when only some state a condition.
    """
    if column not in (None, "person", CONDITION):
        raise InputError(f"--group {column}: expected person or condition, unless --people names a table")
    said = [(getattr(r, "person", ""), getattr(r, CONDITION, "")) for r in recordings]
    compares = column != "person" and (column == CONDITION or any(condition for _, condition in said))
    for file, (person, condition) in zip(files, said, strict=True):
        for what, name in (("person", person), *([(CONDITION, condition)] if compares else [])):
            if not name:
                raise InputError(f"{file}: {what}: not stated in the recording; expected there, or --people TABLE")
    return members(recordings, [p for p, _ in said], [c for _, c in said] if compares else None)


@dataclass(frozen=True)
class Row:
    """One row of a table of people."""

    file: Path
    person: str
    condition: str


def read_people(path: Path, column: str | None = None) -> list[Row]:
    """The rows of a table of people.

    Parameters
    ----------
    column: what is compared; when None the column `CONDITION`, or nothing if there is none.

    Raises `InputError` with file, line and column.
    """
    try:
        table = read_labelled(path, LARGEST_TABLE)
        compared = column or (CONDITION if CONDITION in table.header else None)
        columns = {name: table.column(name) for name in ("file", "person", *([compared] if compared else []))}
    except (InputError, ValueError) as error:
        raise InputError(f"{path}: {error}") from None
    rows = []
    for line, cells in table.rows:
        row = {name: cells[k] for name, k in columns.items()}
        for name, cell in row.items():
            if not cell:
                raise InputError(f"{path}: line {line}: {name}: expected a value")
        rows.append(Row(path.parent / row["file"], row["person"], row[compared] if compared else ALL))
    if not rows:
        raise InputError(f"{path}: expected at least one row")
    return rows


def rows_of(rows: Sequence[Row], files: Sequence[Path], table: Path) -> list[Row]:
    """The rows of some files, in the order of the files; all rows if no files are named.

    Raises `InputError` for a file without a row, or with two.
    """
    if not files:
        return list(rows)
    out = []
    for file in files:
        matching = [r for r in rows if r.file.resolve() == file.resolve()]
        if len(matching) != 1:
            raise InputError(f"{table}: expected one row for {file}, found {len(matching)}")
        out.append(matching[0])
    return out
