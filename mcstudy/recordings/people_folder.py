"""Recordings of many people in one folder, as balancepy keeps them.

    data/metadata.xlsx       Subject ID, body_height_m, body_weight_kg, and a column per condition (c1: eyes open, ...)
                             with the number of the trial, or -1 where there is none
    data/raw/..SUBJECT_t3.csv    trial 3 of a subject, in any folder below
    data/quality_flags.csv   subject_id, condition_name, flag_code, note

``metadata.csv`` does as well as a workbook. A flag is 0 (good), 1 (doubtful), 2 (do not use) or 3 (missing).
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mcstudy.errors import InputError, RecordingError
from mcstudy.files.delimited import Labelled, number, read_labelled
from mcstudy.files.json_files import own_folder, write_text
from mcstudy.files.packaged import packaged
from mcstudy.recordings.formats.workbook import sheet_rows
from mcstudy.recordings.io import write_recording
from mcstudy.recordings.laboratory_import import Imported, import_files
from mcstudy.recordings.recording import Recording
from mcstudy.recordings.refusals import refused
from mcstudy.text_tables import similar, table

FLAGS = {0: "good", 1: "doubtful", 2: "do not use", 3: "missing"}
"""Quality flags in words."""

EXCLUDED = (2, 3)
"""Flags of what is never imported."""

NOT_RATED = "not rated"

PEOPLE = "people.csv"
"""Table of what was imported."""

LARGEST_TABLE = 5_000_000
"""Bytes of a table of people or flags."""

_CONDITION = re.compile(r"c\d+\b.*", re.DOTALL)

SUBJECT, HEIGHT, WEIGHT = "Subject ID", "body_height_m", "body_weight_kg"


@dataclass(frozen=True)
class Found:
    """One person in one condition.

    ``quality``: its flag in words; ``note``: what was written with it; ``file``: its trial, None where there is none;
    ``imported``: its recording, None where it was left out; ``why``: the reason for that.
    """

    person: str
    condition: str
    quality: str
    note: str
    file: Path | None
    imported: Imported | None = None
    why: str = ""

    @property
    def recording(self) -> Recording:
        """The recording of one that was imported."""
        assert self.imported is not None
        return self.imported.recording


def metadata_of(folder: Path) -> Path | None:
    """The table of people in a folder, or in ``data`` below it; None where there is none."""
    places = (folder, folder / "data")
    known = (place / f"metadata.{ending}" for place in places for ending in ("xlsx", "csv"))
    return next((path for path in known if path.is_file()), None)


def import_people(
    folder: Path,
    described: str | Path | None = None,
    options: Mapping[str, Any] | None = None,
    conditions: Sequence[str] = (),
    doubtful: bool = True,
) -> list[Found]:
    """Recordings of all people of a folder, with the body of each; what cannot be used is there with its reason.

    Parameters
    ----------
    folder
        As described above.
    described
        Map of the columns (.toml); that of a headset, ``pipelines/recordings/headset.toml``, when None.
    options
        Fields of a description, which replace those of the map.
    conditions
        Names of conditions, or their beginnings (``"c3"``); all when empty.
    doubtful
        Whether recordings with flag 1 are used.

    Raises
    ------
    RecordingError
        The tables of people or flags are wrong, or no recording can be used.
    """
    path = metadata_of(folder)
    if path is None:
        raise RecordingError(f"{folder}: expected metadata.xlsx or metadata.csv in it or in {folder / 'data'}")
    people = _people(path)
    chosen = _chosen(people, conditions, path)
    flags = _flags(path.with_name("quality_flags.csv"), people)
    described = packaged("pipelines") / "recordings" / "headset.toml" if described is None else described
    raw = path.parent / "raw" if (path.parent / "raw").is_dir() else path.parent
    files = sorted(p for p in raw.rglob("*.csv") if p.is_file())
    found = []
    for person in people:
        for condition in chosen:
            flag, note = flags.get((person.name, condition), (None, ""))
            known = Found(person.name, condition, NOT_RATED if flag is None else FLAGS[flag], note, None)
            found.append(_found(known, person, files, described, options or {}, doubtful))
    if not any(f.imported for f in found):
        reasons = "; ".join(dict.fromkeys(f.why for f in found))
        raise RecordingError(f"{folder}: no recording of {len(found)} can be used: {reasons}"[:2000])
    return found


@dataclass(frozen=True)
class _Person:
    """A row of the table of people: the name, the body, and the number of the trial by condition."""

    name: str
    body: Mapping[str, float]
    trials: Mapping[str, str]


def _people(path: Path) -> list[_Person]:
    rows = _table(path)
    where = str(path)
    for name in (SUBJECT, HEIGHT, WEIGHT):
        if rows.header.count(name) != 1:
            raise RecordingError(
                f"{where}: expected one column {name!r}, found {', '.join(rows.header)}{similar(name, rows.header)}"
            )
    conditions = [name for name in rows.header if _CONDITION.fullmatch(name)]
    if not conditions:
        raise RecordingError(f"{where}: expected columns of conditions (c1: eyes open, ...), found {rows.header}")
    people: list[_Person] = []
    for line, cells in rows.rows:
        row = dict(zip(rows.header, cells, strict=True))
        name = row[SUBJECT]
        if not name or name in {p.name for p in people}:
            what = "a second row of" if name else "no"
            raise RecordingError(f"{where}: line {line}: {SUBJECT}: expected one row per person, got {what} {name}")
        body = {key: _positive(row[c], f"{where}: {name}: {c}") for key, c in (("height", HEIGHT), ("weight", WEIGHT))}
        people.append(_Person(name, body, {c: row[c] for c in conditions}))
    return people


def _positive(cell: str, where: str) -> float:
    value = number(cell, "," if "," in cell else ".")
    if value is None or not value > 0:
        raise RecordingError(f"{where}: expected a number, got {cell!r}")
    return value


def _table(path: Path) -> Labelled:
    if path.suffix == ".xlsx":
        rows = sheet_rows(path)
        width = max(k + 1 for k, name in enumerate(rows[0]) if name)
        return Labelled(rows[0][:width], [(k, row[:width]) for k, row in enumerate(rows[1:], start=2)])
    try:
        return read_labelled(path, LARGEST_TABLE, name_rows=False)
    except InputError as error:
        raise RecordingError(f"{path}: {error}") from None


def _chosen(people: Sequence[_Person], wanted: Sequence[str], path: Path) -> list[str]:
    """The conditions that are asked for, by their names or how these begin."""
    known = list(people[0].trials) if people else []
    if not people:
        raise RecordingError(f"{path}: expected a row per person, found none")
    out = []
    for text in wanted or known:
        hits = [c for c in known if c == text or re.split(r"\W", c)[0] == text]
        if len(hits) != 1:
            raise RecordingError(
                f"{path}: condition {text!r}: expected one of {', '.join(known)}{similar(text, known)}"
            )
        out += hits
    return out


def _flags(path: Path, people: Sequence[_Person]) -> dict[tuple[str, str], tuple[int | None, str]]:
    """Flag, None for not rated, and note by person and condition; none where there is no file."""
    if not path.exists():
        return {}
    rows = _table(path)
    known = {p.name: p for p in people}
    flags: dict[tuple[str, str], tuple[int | None, str]] = {}
    try:
        at = [rows.column(name) for name in ("subject_id", "condition_name", "flag_code")]
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    note = rows.header.index("note") if "note" in rows.header else None
    for line, cells in rows.rows:
        name, condition, code = (cells[k] for k in at)
        where = f"{path}: line {line}"
        if name not in known:
            raise RecordingError(f"{where}: subject_id {name!r} is not among the people{similar(name, known)}")
        if condition not in known[name].trials:
            near = similar(condition, known[name].trials)
            raise RecordingError(f"{where}: condition_name {condition!r} is no column of the people{near}")
        if (name, condition) in flags:
            raise RecordingError(f"{where}: a second flag for {name}, {condition}")
        flags[name, condition] = _code(code, where), "" if note is None else cells[note]
    return flags


def _code(cell: str, where: str) -> int | None:
    if not cell:
        return None
    value = number(cell)
    if value not in FLAGS:
        known = ", ".join(f"{k} ({words})" for k, words in FLAGS.items())
        raise RecordingError(f"{where}: flag_code: expected {known} or nothing, got {cell!r}")
    return int(value)


def _found(
    known: Found,
    person: _Person,
    files: Iterable[Path],
    described: str | Path,
    options: Mapping[str, Any],
    doubtful: bool,
) -> Found:
    """One person in one condition, imported unless its flag, or its file, speaks against it."""
    trial = number(person.trials[known.condition])
    if known.quality in [FLAGS[k] for k in EXCLUDED] or (known.quality == FLAGS[1] and not doubtful):
        return replace(known, why=f"flag: {known.quality}{f' ({known.note})' if known.note else ''}")
    if trial is None or not trial >= 0:
        return replace(known, quality=FLAGS[3], why="no trial (table of people)")
    ending = f"{person.name}_t{int(trial)}"
    called = re.compile(rf"(.*[^A-Za-z0-9])?s?{re.escape(ending)}(\D.*)?\.csv")
    matches = [p for p in files if called.fullmatch(p.name)]
    if len(matches) != 1:
        why = "no file" if not matches else f"{len(matches)} files"
        return replace(known, quality=FLAGS[3] if not matches else known.quality, why=f"{why} ..{ending}.csv")
    about = {
        "name": f"{known.person}, {known.condition}",
        "person": known.person,
        "condition": known.condition,
        "provenance": "" if known.quality == FLAGS[0] else f"quality: {known.quality}",
    }
    try:
        imported = import_files(matches, described, {**options, **about, "body": person.body})
    except (RecordingError, InputError) as error:
        return replace(known, file=matches[0], why=str(error).removeprefix(f"{about['name']}: "))
    return replace(known, file=matches[0], imported=imported)


def told(found: Sequence[Found]) -> str:
    """What was imported and what was left out, with every reason, in words."""
    used = [f for f in found if f.imported]
    people = len({f.person for f in used})
    doubtful = [f for f in used if f.quality == FLAGS[1]]
    lines = [f"{len(used)} of {len(found)} recordings imported, of {people} {'person' if people == 1 else 'people'}"]
    if doubtful:
        lines.append(f"{len(doubtful)} of them are doubtful by their flag; to leave these out: --quality good")
    rows = [[f.person, f.condition, f.quality, _outcome(f)] for f in found]
    return "\n".join([*lines, "", table(["person", "condition", "quality", "recording"], rows, of_text=True)])


def _outcome(found: Found) -> str:
    if found.imported is None:
        return f"left out: {found.why}"
    recording = found.recording
    cycles = ", ".join(map(str, recording.cycles))
    noted = [n.message for n in recording.suspicions] + ([f"note: {found.note}"] if found.note else [])
    period = "not periodic" if recording.period_s is None else f"{cycles} cycles of {recording.period_s:g} s"
    return "; ".join([period, *noted])


def write_people(found: Sequence[Found], folder: Path) -> Path:
    """Write every recording, and ``people.csv`` with file, person, condition, quality, height and weight.

    Returns the path of that table, which `mcstudy fit --people` reads. Raises `RecordingError` or `StoreError` where
    the folder holds something else, or cannot be written.
    """
    own_folder(folder, PEOPLE, "recordings of people")
    with refused(OSError, where=folder):
        folder.mkdir(parents=True, exist_ok=True)
    used = [f for f in found if f.imported]
    names = [re.sub(r"\W+", "_", f"{f.person}_{f.condition}").strip("_") for f in used]
    if len(set(names)) < len(names):
        names = [f"{name}_{k}" for k, name in enumerate(names, start=1)]
    rows = [("file", "person", "condition", "quality")]
    for f, name in zip(used, names, strict=True):
        write_recording(f.recording, folder / f"{name}.nc")
        rows.append((f"{name}.nc", f.person, f.condition, f.quality))
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_text(folder / PEOPLE, text.getvalue())
    return folder / PEOPLE
