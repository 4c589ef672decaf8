"""Complex responses from gains and phases of a table, which must be what they are called: not in dB, not in rad."""

from __future__ import annotations

import numpy as np

from mcstudy.errors import RecordingError

LARGEST_PHASE = 3600.0
"""Largest phase, deg; ten turns."""

RADIANS = 7.0
"""Phases that stay within this, deg, although the gain falls, are in rad: one turn is 6.28 rad."""

FALLS = 3.0
"""How many times the largest gain is that of the last frequency where the phase must show it."""


def response(gain: np.ndarray, phase: np.ndarray, where: str, names: tuple[str, str] = ("gain", "phase")) -> np.ndarray:
    """Complex responses of any shape, the last axis in the order of frequency, from ``gain`` and ``phase`` (deg).

    A response whose gain falls lags: by Bode's relation of gain and phase a fall of `FALLS` costs tens of degrees. So
    phases in rad are seen where the gain falls. Gains in dB are seen where one of them is negative; those that are all
    positive are not.

    Raises `RecordingError`, which begins with ``where`` and names the column, for a negative gain and for such phases.
    """
    if (low := gain[gain < 0]).size:
        raise RecordingError(
            f"{where}: {names[0]}: expected a magnitude, 0 or more, got {low[0]:g}; if gains are in dB, convert them "
            "by 10^(dB/20); if the sign is that of the response, add 180 to the phase"
        )
    largest = float(np.abs(phase).max())
    if largest > LARGEST_PHASE:
        raise RecordingError(f"{where}: {names[1]}: expected deg, at most {LARGEST_PHASE:g}, got {largest:g}")
    falls = gain.max(axis=-1) > FALLS * gain[..., -1]
    within = np.abs(phase).max(axis=-1)
    if (odd := falls & (within < RADIANS) & (within > 0)).any():
        raise RecordingError(
            f"{where}: {names[1]}: expected deg, got at most {float(within[odd].max()):.3g} although the gain falls "
            f"more than {FALLS:g}-fold; phases seem to be in rad, convert them by 180/pi"
        )
    return np.asarray(gain * np.exp(1j * np.deg2rad(phase)))
