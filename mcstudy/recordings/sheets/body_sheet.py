"""The body of a person as a description of a recording states it, in one of five ways.

body = {height = 1.80, weight = 75, sex = "female"}      # a published table of segments
body = {m1 = 24.0, h1 = 0.518, I1 = 1.53, m2 = 46.0, h2 = 0.314, I2 = 2.54, L1 = 0.826}
body = {file = "segments.txt", order = ["m1", "h1", "I1", "m2", "h2", "I2", "L1"]}
body = {J1 = 51.26, J2 = 7.08, C1 = 11.93, C2 = 19.01, A1 = 50.42, A2 = 14.45}
body = {reference = "goodworth2018"}                     # the body of the paper
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from pydantic import Field

from mcstudy.errors import ModelError, RecordingError
from mcstudy.recordings.formats.source import Source
from mcstudy.recordings.sheets.tables import Table
from mcstudy.stance.anthropometry import SEXES, TABLES, proportions
from mcstudy.stance.body import SEGMENTS, Body

CONSTANTS = ("J1", "J2", "C1", "C2", "A1", "A2")

EXPECTED = 'expected J1 ... A2, segments, height and weight, or reference = "goodworth2018"'


class BodySheet(Table):
    """The table's constants, segments, a file whose first row holds segments in the order of ``order``, or a person."""

    J1: float | None = Field(default=None, gt=0)
    J2: float | None = Field(default=None, gt=0)
    C1: float | None = Field(default=None, gt=0)
    C2: float | None = Field(default=None, gt=0)
    A1: float | None = Field(default=None, gt=0)
    A2: float | None = Field(default=None, gt=0)
    g: float = Field(default=9.81, gt=0)
    m1: float | None = Field(default=None, gt=0)
    h1: float | None = Field(default=None, gt=0)
    I1: float | None = Field(default=None, gt=0)
    m2: float | None = Field(default=None, gt=0)
    h2: float | None = Field(default=None, gt=0)
    I2: float | None = Field(default=None, gt=0)
    L1: float | None = Field(default=None, gt=0)
    file: str | None = None
    order: tuple[str, ...] = ()
    height: float | None = Field(default=None, gt=0)
    weight: float | None = Field(default=None, gt=0)
    sex: str | None = None
    table: str | None = None
    reference: Literal["goodworth2018"] | None = None


def body_of(sheet: BodySheet, source: Callable[[str], Source], where: str) -> tuple[Body, str]:
    """The body, and a sentence on where its constants come from when they were not measured, or on what is odd.

    ``source`` opens a data file by its name. `RecordingError` names ``where`` and the field.
    """
    segments = {n: getattr(sheet, n) for n in SEGMENTS if getattr(sheet, n) is not None}
    if sheet.file is not None:
        file = source(sheet.file)
        row = [file.pick(k).values[0] for k in range(len(file.numbered))]
        if len(sheet.order) != len(row) or set(sheet.order) != set(SEGMENTS):
            raise RecordingError(
                f"{where}: body.order: expected the {len(SEGMENTS)} names {', '.join(SEGMENTS)} in the order of the "
                f"{len(row)} columns of {sheet.file}"
            )
        segments |= {n: float(v) for n, v in zip(sheet.order, row, strict=True)}
    constants = {n: getattr(sheet, n) for n in CONSTANTS if getattr(sheet, n) is not None}
    person = {n: getattr(sheet, n) for n in ("height", "weight") if getattr(sheet, n) is not None}
    words = {"segments": segments, "J1 ... A2": constants, "height and weight": person}
    if len(given := [name for name, values in words.items() if values]) > 1:
        raise RecordingError(f"{where}: body: expected either {' or '.join(given)}, got both")
    for values, names in ((segments, tuple(SEGMENTS)), (constants, CONSTANTS), (person, ("height", "weight"))):
        missing = [n for n in names if n not in values]
        if values and missing:
            raise RecordingError(f"{where}: body: {', '.join(missing)} missing")
    for name in ("sex", "table"):
        if getattr(sheet, name) is not None and not person:
            known = SEXES if name == "sex" else tuple(TABLES)
            raise RecordingError(f"{where}: body.{name}: {' or '.join(known)} needs height and weight")
    try:
        if segments:
            return Body.from_segments(**segments, g=sheet.g), _exchanged(segments)
        if constants:
            return Body(**constants, g=sheet.g), ""
        if person:
            body = Body.from_person(**person, sex=sheet.sex, table=sheet.table, g=sheet.g)
            table = proportions(sheet.sex, sheet.table).source
            return body, f"body of {person['height']:g} m and {person['weight']:g} kg by {table}"
    except ModelError as error:
        raise RecordingError(f"{where}: {error}") from error
    if sheet.reference is None:
        raise RecordingError(f"{where}: body: {EXPECTED}")
    return Body(), ""


def _exchanged(segments: dict[str, float]) -> str:
    """A remark on legs that are heavier than the upper body; in both tables they have less than 0.7 of its mass."""
    if segments["m1"] <= segments["m2"]:
        return ""
    return (
        f"odd: body: the lower body (m1 = {segments['m1']:g} kg) is heavier than the upper body "
        f"(m2 = {segments['m2']:g} kg); are the segments exchanged?"
    )
