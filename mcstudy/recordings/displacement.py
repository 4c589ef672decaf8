"""The angle that a channel is where a description states it as a displacement."""

from __future__ import annotations

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.sheets.body_sheet import Person
from mcstudy.recordings.sheets.recording_sheet import Channel
from mcstudy.recordings.sway import of_pressure, tilt


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
