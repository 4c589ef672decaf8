"""The body of a person as a description of a recording states it, in one of five ways.

body = {height = 1.80, weight = 75, sex = "female"}      # a published table of segments
body = {m1 = 24.0, h1 = 0.518, I1 = 1.53, m2 = 46.0, h2 = 0.314, I2 = 2.54, L1 = 0.826}
body = {file = "segments.txt", order = ["m1", "h1", "I1", "m2", "h2", "I2", "L1"]}
body = {J1 = 51.26, J2 = 7.08, C1 = 11.93, C2 = 19.01, A1 = 50.42, A2 = 14.45}
body = {reference = "goodworth2018"}                     # the body of the paper
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Literal, NamedTuple

from pydantic import Field

from mcstudy.errors import ModelError, RecordingError
from mcstudy.recordings.formats.source import Source
from mcstudy.recordings.refusals import refused
from mcstudy.recordings.sheets.tables import Table
from mcstudy.stance import anthropometry
from mcstudy.stance.anthropometry import SEXES, TABLES, proportions
from mcstudy.stance.body import SEGMENTS, Body

FORMS = {
    "segments": tuple(SEGMENTS),
    "J1 ... A2": ("J1", "J2", "C1", "C2", "A1", "A2"),
    "height and weight": ("height", "weight"),
}
"""Numbers of which all or none are stated."""

USUAL_INDEX = (13.0, 45.0)
"""Body mass index of nearly all people who stand, kg/m^2; a weight in pounds gives twice the right one."""

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


class Person(NamedTuple):
    """The body of a person.

    Attributes
    ----------
    body
        Inertia and gravity.
    remark
        Where its constants come from when they were not measured, or what is odd; else empty.
    segments
        Arguments of `Body.from_segments`, where they are known.
    shoulder
        Height of the shoulder above the hip, m; None where it is not known.
    floor
        Depth of the floor below the ankle, m; None where it is not known.
    stated
        Whether a body was stated; of outputs of a declared model it need not be.
    """

    body: Body = Body()
    remark: str = ""
    segments: Mapping[str, float] = MappingProxyType({})
    shoulder: float | None = None
    floor: float | None = None
    stated: bool = True

    @property
    def constants(self) -> dict[str, float]:
        """Of the whole body with straight hips about the ankle, as far as they are known.

        J (kg m^2), mgh (N m/rad), mass m (kg, without feet) and height h of its centre (m).
        """
        if not self.stated:
            return {}
        whole = {"J": self.body.J1 + self.body.C2, "mgh": self.body.mgh}
        if not self.segments:
            return whole
        mass = self.segments["m1"] + self.segments["m2"]
        return {**whole, "m": mass, "h": (self.body.A1 + self.body.A2) / mass}


def body_of(sheet: BodySheet, source: Callable[[str], Source], where: str) -> Person:
    """The body of a person.

    ``source`` opens a data file by its name. `RecordingError` names ``where`` and the field.
    """
    where = f"{where}: body"
    stated = {form: _stated(sheet, names) for form, names in FORMS.items()}
    if sheet.file is not None:
        stated["segments"] |= _segments_of_file(sheet, source(sheet.file), where)
    if len(given := [form for form, values in stated.items() if values]) > 1:
        raise RecordingError(f"{where}: expected either {' or '.join(given)}, got both")
    for form, values in stated.items():
        if values and (missing := [n for n in FORMS[form] if n not in values]):
            raise RecordingError(f"{where}: {', '.join(missing)} missing")
    segments, constants, person = stated.values()
    for name, known in (("sex", SEXES), ("table", tuple(TABLES))):
        if getattr(sheet, name) is not None and not person:
            raise RecordingError(f"{where}.{name}: {' or '.join(known)} needs height and weight")
    with refused(ModelError, where=where.removesuffix(": body")):
        if segments:
            return Person(Body.from_segments(**segments, g=sheet.g), _exchanged(segments), segments)
        if constants:
            return Person(Body(**constants, g=sheet.g))
        if person:
            return _by_table(sheet, **person)
    if sheet.reference is None:
        raise RecordingError(f"{where}: {EXPECTED}")
    return Person()


def _by_table(sheet: BodySheet, height: float, weight: float) -> Person:
    """The body of a person of whom height (m) and weight (kg) are known."""
    body = Body.from_person(height=height, weight=weight, sex=sheet.sex, table=sheet.table, g=sheet.g)
    table = proportions(sheet.sex, sheet.table)
    remark = f"body of {height:g} m and {weight:g} kg by {table.source}"
    index = weight / height**2
    if not USUAL_INDEX[0] <= index <= USUAL_INDEX[1]:
        remark += f" (odd: {index:.3g} kg/m^2; is the weight in kg, and the height that of the person?)"
    segments = anthropometry.segments(height, weight, sheet.sex, sheet.table)
    return Person(body, remark, segments, table.trunk * height, table.ankle * height)


def _stated(sheet: BodySheet, names: Sequence[str]) -> dict[str, float]:
    return {n: getattr(sheet, n) for n in names if getattr(sheet, n) is not None}


def _segments_of_file(sheet: BodySheet, file: Source, where: str) -> dict[str, float]:
    """The segments in the first row of a file."""
    row = [float(file.pick(k).values[0]) for k in range(len(file.numbered))]
    if len(sheet.order) != len(row) or set(sheet.order) != set(SEGMENTS):
        raise RecordingError(
            f"{where}.order: expected the {len(SEGMENTS)} names {', '.join(SEGMENTS)} in the order of the "
            f"{len(row)} columns of {sheet.file}"
        )
    return dict(zip(sheet.order, row, strict=True))


def _exchanged(segments: dict[str, float]) -> str:
    """A remark on legs that are heavier than the upper body; in both tables they have less than 0.7 of its mass."""
    if segments["m1"] <= segments["m2"]:
        return ""
    return (
        f"odd: body: the lower body (m1 = {segments['m1']:g} kg) is heavier than the upper body "
        f"(m2 = {segments['m2']:g} kg); are the segments exchanged?"
    )
