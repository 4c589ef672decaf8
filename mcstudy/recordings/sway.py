"""The angle of one segment from what laboratories record: displacements, the centre of pressure, wrapped rotations.

A displacement x (m, about its mean) at a height h above the ankle is the angle asin(x/h). The centre of pressure of a
body that sways as one segment is x_cop = x - J/(m g h) x'', with x the displacement of its centre of mass (small
angles, no force but gravity; the ankle at the height of the plate).
"""

from __future__ import annotations

import numpy as np

from mcstudy.errors import RecordingError

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
    both = np.concatenate([cop, cop[::-1]])  # even about both ends
    omega = 2 * np.pi * np.fft.rfftfreq(both.size, 1 / rate_hz)
    return np.fft.irfft(np.fft.rfft(both) / (1 + ratio * omega**2), both.size)[: cop.size]
