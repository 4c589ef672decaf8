"""Angles of the segments from markers.

The lower body is the line from ankle to hip, the upper body the line from hip to shoulder; each of these places is the
mean of its markers. The angle of a segment is that of its projection on the sagittal plane against the vertical,
positive when it leans forward: atan2(forward, up). Which axis of the laboratory points forward and which up is
declared.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from pydantic import Field

from mcstudy.errors import RecordingError
from mcstudy.recordings.formats.source import Picked, Source
from mcstudy.recordings.refusals import size_text
from mcstudy.recordings.sheets.tables import Table

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]

_AXES = "xyz"


class MarkerSheet(Table):
    """Names of the markers at each place, and the laboratory's axes."""

    ankle: tuple[str, ...] = Field(min_length=1)
    hip: tuple[str, ...] = Field(min_length=1)
    shoulder: tuple[str, ...] = Field(min_length=1)
    forward: Axis
    up: Axis


def space_angles(
    sheet: MarkerSheet, source: Source, fill: Callable[[Picked], Picked], where: str
) -> tuple[Picked, Picked]:
    """Angles of lower and upper body in space, (n,) each, rad; ``fill`` fills gaps of a coordinate."""
    if sheet.forward[1] == sheet.up[1]:
        raise RecordingError(
            f"{where}: markers: expected two different axes, got forward {sheet.forward}, up {sheet.up}"
        )

    def coordinate(place: tuple[str, ...], axis: str) -> Picked:
        picked = [fill(_coordinate(source, marker, axis[1])) for marker in place]
        sizes = {p.values.size for p in picked}
        if len(sizes) > 1:
            raise RecordingError(f"{source.path}: {', '.join(place)}: expected markers of the same length")
        sign = -1.0 if axis[0] == "-" else 1.0
        mean = sign * np.mean([p.values for p in picked], axis=0)
        return Picked(" + ".join(place), mean, picked[0].unit, picked[0].rate_hz)

    def angle(lower: tuple[str, ...], upper: tuple[str, ...]) -> Picked:
        forward, up = (
            coordinate(upper, axis).values - coordinate(lower, axis).values for axis in (sheet.forward, sheet.up)
        )
        if np.median(up) <= 0:
            raise RecordingError(
                f"{source.path}: markers: {', '.join(upper)} lie below {', '.join(lower)} along {sheet.up}; "
                "is up another axis?"
            )
        rate = coordinate(lower, sheet.up).rate_hz
        return Picked(f"{' + '.join(lower)} to {' + '.join(upper)}", np.arctan2(forward, up), "rad", rate)

    return angle(sheet.ankle, sheet.hip), angle(sheet.hip, sheet.shoulder)


def _coordinate(source: Source, marker: str, axis: str) -> Picked:
    """A coordinate of a marker: its variable ``NAME.x``, or a column of its (n, 3) array."""
    name = f"{marker}.{axis}"
    if name in source.variables or marker not in source.variables:
        return source.pick(name)
    picked = source.pick(marker)
    if picked.values.ndim != 2 or picked.values.shape[1] != 3:
        shape = size_text(picked.values.shape)
        raise RecordingError(f"{source.path}: {marker}: expected a marker of samples x 3, got {shape}")
    return Picked(name, picked.values[:, _AXES.index(axis)], picked.unit, picked.rate_hz)
