"""FRFs of a group of people in several conditions, from a table: read, checked and labelled; nothing is estimated."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import xarray as xr

from mcstudy.errors import RecordingError
from mcstudy.files.delimited import NUMBER, decimal_sign, labelled, number
from mcstudy.files.local_path import local_path
from mcstudy.recordings.columns import Columns
from mcstudy.recordings.copies import equal_rows
from mcstudy.recordings.data_files import Files
from mcstudy.recordings.formats.text import LARGEST_FILE
from mcstudy.recordings.formats.text_layout import Dialect
from mcstudy.recordings.frf import GAIN
from mcstudy.recordings.gain_and_phase import response
from mcstudy.recordings.guards import content, inside
from mcstudy.recordings.recording import sentences
from mcstudy.recordings.refusals import refused, require_within
from mcstudy.recordings.sheets.body_sheet import body_of
from mcstudy.recordings.sheets.frf_group_sheet import PATTERNS, TableSheet, read_group_sheet
from mcstudy.recordings.sheets.recording_sheet import frf_factor
from mcstudy.stance.body import STIMULI, Body

SEGMENTS = ("lower", "upper")
"""Responses: angles of the lower and of the upper body, both in space."""

ALL = "all"
"""The condition where a table has only one."""

LABEL_TOLERANCE = 0.02
"""Largest relative distance of a frequency in a column's name from the mean frequency of its point."""


def read_frf_group(path: str | Path, data: str | Path | None = None) -> xr.Dataset:
    """FRFs of many people, each in one or several conditions, at points that average harmonics of the stimulus.

    Parameters
    ----------
    path
        Description, ``.toml`` (see `mcstudy.recordings.sheets.frf_group_sheet`).
    data
        Folder of the table that it names; its own folder when None.

    Returns
    -------
    xarray.Dataset
        ``frf`` (person, condition, segment, point), complex, rad per unit of the stimulus, of the lower and the upper
        body in space; nan where a person was not recorded in a condition. ``average`` (point, line): the mean over
        harmonics that a point is. Coordinates: ``f`` (point) and ``f_line`` (line) in Hz; the columns that make the
        condition. Attributes: name, stimulus, provenance, body (constants of `Body` in their order).

    Raises
    ------
    RecordingError
        One line that names file, line and column.
    """
    path = local_path(path)
    sheet = read_group_sheet(path)
    files = Files(path.parent if data is None else Path(data), Dialect(), str(path))
    person = body_of(sheet.body, files.source, str(path))
    table = inside(path.parent if data is None else Path(data), sheet.frf_group.file, str(path))
    columns = Columns.of(None, sheet.stimulus)
    sheet.units.require_both(columns, str(path))
    scale = float(frf_factor(sheet.units.angle, sheet.units.stimulus, columns, str(path))[0])
    people, conditions, frf = _rows(sheet.frf_group, table)
    frf = scale * frf
    if sheet.upper_body == "hip":
        frf[:, :, 1] += frf[:, :, 0]
    largest = float(np.nanmax(np.abs(frf)))
    require_within(GAIN, largest, f"{table}: gain")
    f_line, average = sheet.frf_group.lines()
    group = group_dataset(
        frf,
        people,
        conditions,
        sheet.frf_group.conditions,
        f_line,
        average,
        sheet.stimulus,
        person.body,
    )
    name = path.stem if sheet.name == "group" else sheet.name
    return group.assign_attrs(name=name, provenance=sentences(sheet.provenance, person.remark))


def group_dataset(
    frf: np.ndarray,
    people: Sequence[str],
    conditions: Sequence[tuple[str, ...]],
    factors: Sequence[str],
    f_line: np.ndarray,
    average: np.ndarray,
    stimulus: str,
    body: Body,
) -> xr.Dataset:
    """What `read_frf_group` returns, from arrays.

    Parameters
    ----------
    frf: (person, condition, 2, N), complex, of the lower and the upper body in space, rad per unit of the stimulus.
    people: their names. conditions: per condition its value of every one of the ``factors``.
    f_line: (L,) Hz. average: (N, L), rows sum to one. stimulus: its kind.
    """
    return xr.Dataset(
        {
            "frf": (
                ("person", "condition", "segment", "point"),
                frf,
                {"units": f"rad/({STIMULI[stimulus]})", "long_name": "angle in space per stimulus"},
            ),
            "average": (("point", "line"), average, {"long_name": "weight of a harmonic in the mean of a point"}),
        },
        coords={
            "person": list(people),
            "condition": [", ".join(values) or ALL for values in conditions],
            "segment": list(SEGMENTS),
            "f": ("point", (average > 0) @ f_line / (average > 0).sum(axis=1), {"units": "Hz"}),
            "f_line": ("line", f_line, {"units": "Hz"}),
            **{factor: ("condition", [values[k] for values in conditions]) for k, factor in enumerate(factors)},
        },
        attrs={
            "name": "group",
            "stimulus": stimulus,
            "body": [float(getattr(body, constant.name)) for constant in fields(Body)],
            "provenance": "",
        },
    )


def body_of_group(group: xr.Dataset) -> Body:
    """The body that all people of a group are given."""
    return Body(*group.attrs["body"])


def _rows(sheet: TableSheet, path: Path) -> tuple[list[str], list[tuple[str, ...]], np.ndarray]:
    """People and conditions in the order of the file, and the FRFs (person, condition, 2, N) as it states them."""
    with refused(ValueError, where=path):
        table = labelled(content(path, LARGEST_FILE))
        header, rows = table
        words = (sheet.person, *sheet.conditions, sheet.segment)
        for name in words:
            table.column(name)
        columns = {name: _columns(sheet, name, header, path) for name in PATTERNS if getattr(sheet, name) is not None}
        used = [header.index(name) for names in columns.values() for name in names]
        decimal = decimal_sign([cells[k] for _, cells in rows for k in used])
    responses: dict[tuple[str, tuple[str, ...]], dict[str, np.ndarray]] = {}
    for line, cells in rows:
        row = dict(zip(header, cells, strict=True))
        for name in words:
            if not row[name]:
                raise RecordingError(f"{path}: line {line}: {name}: expected a value")
        segment = row[sheet.segment]
        if segment not in SEGMENTS:
            raise RecordingError(f"{path}: line {line}: {sheet.segment}: expected lower or upper, got {segment!r}")
        key = row[sheet.person], tuple(row[c] for c in sheet.conditions)
        segments = responses.setdefault(key, {})
        if segment in segments:
            raise RecordingError(f"{path}: line {line}: a second row of {', '.join((key[0], *key[1], segment))}")
        values = {name: _numbers(row, names, path, line, decimal) for name, names in columns.items()}
        segments[segment] = _complex(values, f"{path}: line {line}")
    people = list(dict.fromkeys(person for person, _ in responses))
    conditions = list(dict.fromkeys(condition for _, condition in responses))
    if not people:
        raise RecordingError(f"{path}: expected at least one row")
    frf = np.full((len(people), len(conditions), 2, len(sheet.points)), np.nan, dtype=complex)
    for (person, condition), segments in responses.items():
        if missing := [s for s in SEGMENTS if s not in segments]:
            raise RecordingError(f"{path}: {', '.join((person, *condition))}: the row of {missing[0]} is missing")
        frf[people.index(person), conditions.index(condition)] = [segments[s] for s in SEGMENTS]
    _refuse_copies(people, conditions, frf, path)
    return people, conditions, frf


def _refuse_copies(people: Sequence[str], conditions: Sequence[tuple[str, ...]], frf: np.ndarray, path: Path) -> None:
    names = [", ".join((p, *c)) for p in people for c in conditions]
    pair = equal_rows(frf.reshape(len(names), -1))
    if pair is not None:
        raise RecordingError(
            f"{path}: {names[pair[1]]}: has the same responses as {names[pair[0]]}; expected every person once"
        )


def _columns(sheet: TableSheet, field: str, header: Sequence[str], path: Path) -> list[str]:
    """The columns that a pattern names, one per point in the order of the file; a frequency in a name is checked."""
    before, _, after = getattr(sheet, field).partition("*")
    pattern = re.compile(re.escape(before) + "(.*)" + re.escape(after))
    matching = [(name, m[1]) for name in header if (m := pattern.fullmatch(name))]
    if len(matching) != len(sheet.points) or len({name for name, _ in matching}) != len(matching):
        raise RecordingError(
            f"{path}: {field}: expected {len(sheet.points)} columns {getattr(sheet, field)!r}, one per point, "
            f"found {len(matching)}"
        )
    f_line, average = sheet.lines()
    for (name, label), used in zip(matching, average > 0, strict=True):
        f = float(f_line[used].mean())
        if NUMBER.fullmatch(label) and not abs(float(label) / f - 1) <= LABEL_TOLERANCE:
            raise RecordingError(f"{path}: column {name!r}: expected {f:g} Hz, the mean of the harmonics of its point")
    return [name for name, _ in matching]


def _numbers(row: dict[str, str], names: Sequence[str], path: Path, line: int, decimal: str) -> np.ndarray:
    values = []
    for name in names:
        value = number(row[name], decimal)
        if value is None or not np.isfinite(value):
            raise RecordingError(f"{path}: line {line}, column {name!r}: expected a number, got {row[name]!r}")
        values.append(value)
    return np.array(values)


def _complex(values: dict[str, np.ndarray], where: str) -> np.ndarray:
    """FRF from gain and phase in deg, or from both parts."""
    if "gain" in values:
        return response(values["gain"], values["phase"], where)
    return np.asarray(values["real"] + 1j * values["imaginary"])
