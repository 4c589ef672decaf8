"""Angles of the segments, or of the centre of mass, from markers.

The lower body is the line from ankle to hip, the upper body the line from hip to shoulder; each of these places is the
mean of its markers. The angle of a segment is that of its projection on the sagittal plane against the vertical,
positive when it leans forward: atan2(forward, up). Which axis of the laboratory points forward and which up is
declared.

For a model of one angle, hip and shoulder are enough, as displacements about their means or from ankle markers; their
heights above the ankle are measured, declared, or those of the body's table (`mcstudy.stance.anthropometry`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from mcstudy.errors import RecordingError
from mcstudy.recordings.formats.source import Picked, Source
from mcstudy.recordings.refusals import size_text
from mcstudy.recordings.sheets.body_sheet import Person
from mcstudy.recordings.sheets.tables import Table
from mcstudy.recordings.sway import tilt
from mcstudy.recordings.units import agreed, factor
from mcstudy.stance.anthropometry import centre_of_mass

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]

_AXES = "xyz"


class Heights(Table):
    """Heights of markers or sway rods above the floor, m, as a tape measures them."""

    hip: float | None = Field(default=None, gt=0)
    shoulder: float | None = Field(default=None, gt=0)


class MarkerSheet(Table):
    """Names of the markers at each place, and the laboratory's axes.

    ``columns``: how the variables of a marker are called, ``"{marker}_{axis}pos"``; without ``{axis}`` there is only
    the displacement forward, of a sway rod. ``unit`` where the file states none. ``angle``: which one a model of one
    angle has, that of the centre of mass, of the legs, or of the trunk in space.
    """

    ankle: tuple[str, ...] = ()
    hip: tuple[str, ...] = Field(min_length=1)
    shoulder: tuple[str, ...] = ()
    forward: Axis = "+x"
    up: Axis | None = None
    columns: str = "{marker}.{axis}"
    unit: str | None = None
    heights: Heights = Heights()
    angle: Literal["com", "legs", "trunk"] = "com"


Fill = Callable[[Picked], Picked]


class _Places:
    """Coordinates of places: each the mean of its markers."""

    def __init__(self, sheet: MarkerSheet, source: Source, fill: Fill, where: str) -> None:
        self.sheet, self.source, self.fill, self.where = sheet, source, fill, where

    def coordinate(self, place: tuple[str, ...], axis: str) -> Picked:
        """The coordinate of a place along an axis, with its sign."""
        picked = [self.fill(_coordinate(self.source, marker, axis[1], self.sheet.columns)) for marker in place]
        if len({p.values.size for p in picked}) > 1:
            raise RecordingError(f"{self.source.path}: {', '.join(place)}: expected markers of the same length")
        sign = -1.0 if axis[0] == "-" else 1.0
        mean = sign * np.mean([p.values for p in picked], axis=0)
        return Picked(" + ".join(place), mean, picked[0].unit, picked[0].rate_hz)

    def metres(self, place: tuple[str, ...], axis: str) -> Picked:
        """The same in m."""
        p = self.coordinate(place, axis)
        unit = agreed(self.sheet.unit, p.unit, "m", f"{self.where}: markers", p.name)
        if unit is None:
            raise RecordingError(f"{self.where}: markers.unit: expected the unit of {p.name} (m, cm, mm), got none")
        return Picked(p.name, p.values * factor(unit, "m", f"{self.where}: markers"), "m", p.rate_hz)


def require_axes(sheet: MarkerSheet, where: str) -> None:
    """Raise `RecordingError` for two axes that are one."""
    if sheet.up is not None and sheet.forward[1] == sheet.up[1]:
        raise RecordingError(
            f"{where}: markers: expected two different axes, got forward {sheet.forward}, up {sheet.up}"
        )


def space_angles(sheet: MarkerSheet, source: Source, fill: Fill, where: str) -> tuple[Picked, Picked]:
    """Angles of lower and upper body in space, (n,) each, rad; ``fill`` fills gaps of a coordinate."""
    require_axes(sheet, where)
    if not (sheet.ankle and sheet.shoulder and sheet.up):
        raise RecordingError(f"{where}: markers: expected ankle, hip, shoulder and up, from which two angles follow")
    places = _Places(sheet, source, fill, where)

    def angle(lower: tuple[str, ...], upper: tuple[str, ...]) -> Picked:
        forward, up = (
            places.coordinate(upper, axis).values - places.coordinate(lower, axis).values
            for axis in (sheet.forward, str(sheet.up))
        )
        if np.median(up) <= 0:
            raise RecordingError(
                f"{source.path}: markers: {', '.join(upper)} lie below {', '.join(lower)} along {sheet.up}; "
                "is up another axis?"
            )
        rate = places.coordinate(lower, str(sheet.up)).rate_hz
        return Picked(f"{' + '.join(lower)} to {' + '.join(upper)}", np.arctan2(forward, up), "rad", rate)

    return angle(sheet.ankle, sheet.hip), angle(sheet.hip, sheet.shoulder)


def one_angle(sheet: MarkerSheet, source: Source, fill: Fill, person: Person, where: str) -> tuple[Picked, str]:
    """The angle of the centre of mass, the legs or the trunk in space, (n,), rad, and in words how it was made."""
    require_axes(sheet, where)
    if sheet.angle != "legs" and not sheet.shoulder:
        raise RecordingError(f'{where}: markers.shoulder: missing, but needed unless angle = "legs"')
    places = _Places(sheet, source, fill, where)
    low = places.metres(sheet.ankle, sheet.forward).values if sheet.ankle else 0.0
    hip = places.metres(sheet.hip, sheet.forward)
    at_hip, measured = _height(places, sheet.hip, sheet.heights.hip, person.segments.get("L1"), person, where)
    x_hip, rate = hip.values - low, hip.rate_hz
    if sheet.angle == "legs":
        return Picked(hip.name, tilt(x_hip, at_hip, where), "rad", rate), f"sway of the legs: asin(x/h), h {measured}"
    shoulder = places.metres(sheet.shoulder, sheet.forward)
    tall = None if person.shoulder is None else person.segments["L1"] + person.shoulder
    at_shoulder, also = _height(places, sheet.shoulder, sheet.heights.shoulder, tall, person, where)
    if at_shoulder <= at_hip:
        raise RecordingError(f"{where}: markers: the shoulder ({also}) lies below the hip ({measured})")
    x_shoulder, name = shoulder.values - low, f"{hip.name}, {shoulder.name}"
    if sheet.angle == "trunk":
        angle = tilt(x_shoulder - x_hip, at_shoulder - at_hip, where)
        return Picked(name, angle, "rad", rate), f"sway of the trunk in space: hip {measured}, shoulder {also}"
    if person.shoulder is None:
        raise RecordingError(f"{where}: body: expected height and weight, from which the centre of mass follows")
    u, v = centre_of_mass(person.segments, person.shoulder)
    h = u * at_hip + v * at_shoulder
    words = (
        f"sway of the centre of mass: asin(x/h) with x = {u:.3f} hip + {v:.3f} shoulder and h = {h:.3f} m above the "
        f"ankle; hip {measured}, shoulder {also}"
    )
    return Picked(name, tilt(u * x_hip + v * x_shoulder, h, where), "rad", rate), words


def _height(
    places: _Places, place: Sequence[str], declared: float | None, by_table: float | None, person: Person, where: str
) -> tuple[float, str]:
    """Height of a place above the ankle, m: by a tape, its own coordinate or the table; and in words."""
    sheet = places.sheet
    name = ", ".join(place)
    if declared is None and sheet.up is None:
        if by_table is None:
            raise RecordingError(f"{where}: markers.heights: expected that of {name}, or body with height and weight")
        return by_table, f"{by_table:.3f} m above the ankle by the table"
    high = float(np.mean(places.metres(tuple(place), str(sheet.up)).values)) if declared is None else declared
    how = "declared" if declared is not None else "measured"
    if declared is None and sheet.ankle:
        floor = float(np.mean(places.metres(sheet.ankle, str(sheet.up)).values))
    elif person.floor is not None:
        floor = person.floor
    else:
        raise RecordingError(
            f"{where}: body: expected height and weight, from which the height of the ankle above the floor follows"
        )
    return high - floor, f"{high - floor:.3f} m above the ankle ({how}, {floor:.3f} m of ankle taken off)"


def _coordinate(source: Source, marker: str, axis: str, columns: str) -> Picked:
    """A coordinate of a marker: its variable, or a column of its (n, 3) array."""
    name = columns.replace("{marker}", marker).replace("{axis}", axis)
    if name in source.variables or marker not in source.variables:
        return source.pick(name)
    picked = source.pick(marker)
    if picked.values.ndim != 2 or picked.values.shape[1] != 3:
        shape = size_text(picked.values.shape)
        raise RecordingError(f"{source.path}: {marker}: expected a marker of samples x 3, got {shape}")
    return Picked(name, picked.values[:, _AXES.index(axis)], picked.unit, picked.rate_hz)
