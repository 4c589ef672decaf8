"""The angle of one segment from what laboratories record: displacements, the centre of pressure, wrapped rotations.

A displacement x (m, about its mean) at a height h above the ankle is the angle asin(x/h). The centre of pressure of a
body that sways as one segment is x_cop = x - J/(m g h) x'', with x the displacement of its centre of mass (small
angles, no force but gravity; the ankle at the height of the plate).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.sheets.body_sheet import Person

if TYPE_CHECKING:
    from mcstudy.recordings.sheets.recording_sheet import Channel

TURN = 2 * np.pi

WRAPPED = 5 / 6
"""Smallest step between samples, in turns, that tells of a rotation counted from 0 to 360 degrees."""

LOWEST, HIGHEST = 0.02, 2.5
"""Heights of what moves above the axis that it turns about, m."""

FARTHEST = 0.5
"""Largest displacement relative to the height (30 deg)."""


def unwrapped(angle: np.ndarray) -> tuple[np.ndarray, int]:
    """An angle (n,), rad, without steps of a whole turn, and how many it had; missing values (nan) stay."""
    known = np.isfinite(angle)
    steps = np.diff(angle[known])
    turns = np.where(np.abs(steps) > WRAPPED * TURN, np.rint(steps / TURN), 0.0)
    if not turns.any():
        return angle, 0
    out = angle.copy()
    out[known] -= TURN * np.concatenate([[0.0], np.cumsum(turns)])
    return out, int(np.count_nonzero(turns))


def tilt(x: np.ndarray, height: float, where: str) -> np.ndarray:
    """Angle (n,), rad, of a displacement (n,), m, about its mean, at a height in m above the axis.

    Raises `RecordingError` for a height that is none, or a displacement that does not fit it.
    """
    if not LOWEST <= height <= HIGHEST:
        raise RecordingError(
            f"{where}.height: expected {LOWEST:g} to {HIGHEST:g} m above the axis, got {height:g}; is it in m?"
        )
    x = x - np.nanmean(x)
    largest = float(np.nanmax(np.abs(x)))
    if largest > FARTHEST * height:
        raise RecordingError(
            f"{where}: moves by {largest:.3g} m about its mean, at a height of {height:.3g} m, which is no sway; is "
            "the unit right (mm or cm taken as m)?"
        )
    return np.asarray(np.arcsin(x / height))


def of_pressure(cop: np.ndarray, rate_hz: float, ratio: float) -> np.ndarray:
    """Displacement (n,) of the centre of mass of one segment from that of its centre of pressure (n,).

    Solves x - ``ratio`` x'' = cop, with ``ratio`` J/(m g h) in s^2, exactly at all frequencies of the cosines that
    make up the record (velocity zero at both ends); what the ends disturb fades with sqrt(ratio), a third of a second.
    """
    from scipy.fft import dct, idct

    omega = np.pi * rate_hz * np.arange(cop.size) / cop.size
    return np.asarray(idct(dct(cop, type=2) / (1 + ratio * omega**2), type=2))


def angle_of(
    x: np.ndarray, name: str, rate_hz: float, channel: Channel, person: Person, where: str
) -> tuple[np.ndarray, str]:
    """The angle (n,), rad, that a displacement x (n,), m, under a ``name`` is, and in words how it was made.

    Raises `RecordingError` where a height, or the body that has one, is missing.
    """
    constants = person.constants
    height = channel.height or constants.get("h")
    if height is None:
        raise RecordingError(f"{where}.height: expected that of the centre of mass (m), or body with height and weight")
    words = f"asin(x/h) of {name} about its mean, h = {height:.3f} m above the axis"
    if channel.of == "cop":
        if not constants:
            raise RecordingError(f"{where}.of: cop: expected body with height and weight, whose inertia it depends on")
        ratio = constants["J"] / constants["mgh"]
        x = of_pressure(x - x.mean(), rate_hz, ratio)
        words += (
            f"; x from the centre of pressure, x - J/(mgh) x'' = x_cop with J/(mgh) = {ratio:.3f} s^2: right for a "
            "body that sways as one segment with its ankles at the height of the plate"
        )
    return tilt(x, height, where), words
