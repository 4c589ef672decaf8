"""Ways to mislabel a recording: what each does to the responses, and what the user should check.

A *reading* states that the recorded angles are not what their labels say. At frequency f the recorded responses are
T(f) times the true ones, with a known 2 x 2 matrix T. A factor on the stimulus is one on both angles, so it has the
same reading. `mcstudy.lines.labels` compares readings with the nominal model and refuses a recording;
`mcstudy.gap.questions.mislabelling` fits the model under every reading and lets it compete with the effects.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Matrix = tuple[tuple[float, float], tuple[float, float]]

Check = Literal["doubtful", "certain", "fit"]
"""Where a reading is judged: by the nominal model, told when doubtful or only when certain, or only by a fit."""

_DEG = 180 / np.pi

_KGF = 9.80665
"""Newtons in a kilogram-force (CGPM 1901)."""

ANGLES = ("theta1", "theta2")


@dataclass(frozen=True)
class Reading:
    """One way to mislabel the angles or the stimulus.

    Attributes
    ----------
    matrix, orders
        T at frequency f is ``matrix`` with row k times (2 pi i f)^``orders[k]``.
    channel, words
        What is mislabelled, and how; they complete "... seems to be ...".
    remedy
        What to check or declare, a sentence.
    check
        Where it is judged.
    torque
        Whether only a stimulus in N m can have it.
    """

    matrix: Matrix
    channel: str
    words: str
    remedy: str
    orders: tuple[int, int] = (0, 0)
    check: Check = "doubtful"
    torque: bool = False

    def at(self, f: np.ndarray) -> np.ndarray:
        """T at frequencies (N,) in Hz, (N, 2, 2) complex."""
        s = 2j * np.pi * f
        return np.array(self.matrix) * np.array([s**n for n in self.orders]).T[:, :, None]


def _diagonal(first: float, second: float) -> Matrix:
    return (first, 0.0), (0.0, second)


def _on(scaled: str, factor: float) -> Matrix:
    """A factor on both angles ("") or on one."""
    return _diagonal(*(factor if scaled in ("", angle) else 1.0 for angle in ANGLES))


def _angles(angle: str) -> str:
    return angle or ", ".join(ANGLES)


_SAME: Matrix = _diagonal(1.0, 1.0)
_AMPLITUDE = "Check the gain of the stimulus, and whether it is given as a peak or as a peak-to-peak value."


def _table() -> dict[str, Reading]:
    both = "theta1, theta2"
    out: dict[str, Reading] = {}
    for angle in ("", *ANGLES):
        name, end = _angles(angle), f"_{angle}" if angle else ""
        unit = f"Declare the unit of {name}" + ("" if angle else ", or check the unit of the stimulus") + "."
        out[f"degrees{end}"] = Reading(_on(angle, _DEG), name, "in deg but declared rad", unit)
        out[f"radians{end}"] = Reading(_on(angle, 1 / _DEG), name, "in rad but declared deg", unit)
        million = {"": " (in mrad but declared rad, or a stimulus in kN m)"}.get(angle, " (in mrad but declared rad)")
        out[f"thousand{end}"] = Reading(_on(angle, 1e3), name, f"1000 times too large{million}", unit, check="certain")
        out[f"thousandth{end}"] = Reading(
            _on(angle, 1e-3), name, "1000 times too small (is a unit milli or kilo?)", unit, check="certain"
        )
        out[f"double{end}"] = Reading(
            _on(angle, 2.0), name, "2 times too large", unit if angle else _AMPLITUDE, check="fit"
        )
        out[f"half{end}"] = Reading(
            _on(angle, 0.5), name, "2 times too small", unit if angle else _AMPLITUDE, check="fit"
        )
        if angle:
            gain = f"Check the calibration of {angle}."
            out[f"over_g{end}"] = Reading(_on(angle, 1 / _KGF), name, "9.81 times too small", gain, check="certain")
            out[f"times_g{end}"] = Reading(_on(angle, _KGF), name, "9.81 times too large", gain, check="certain")
        order = (int(angle in ("", "theta1")), int(angle in ("", "theta2")))
        plural = angle == ""
        out[f"velocity{end}"] = Reading(
            _SAME,
            name,
            "angular velocities; expected angles" if plural else "an angular velocity; expected an angle",
            f"Give the angle, not the velocity, as {name}.",
            order,
        )
        out[f"integral{end}"] = Reading(
            _SAME,
            name,
            "integrals over time; expected angles" if plural else "an integral over time; expected an angle",
            f"Give the angle, not its integral, as {name}.",
            (-order[0], -order[1]),
            check="certain",
        )
    units = "Declare the unit of the stimulus (kgf m or N m)."
    torque = {"check": "certain", "torque": True}
    out |= {
        "kilogram_force": Reading(_on("", _KGF), "stimulus", "in kgf m but declared N m", units, **torque),  # type: ignore[arg-type]
        "newton": Reading(_on("", 1 / _KGF), "stimulus", "in N m but declared kgf m", units, **torque),  # type: ignore[arg-type]
        "swapped": Reading(
            ((0, 1), (1, 0)),
            both,
            "exchanged (theta1 must be the lower body angle, theta2 the hip angle)",
            "Exchange the columns.",
        ),
        "sign": Reading(
            _on("", -1), "stimulus or theta1, theta2", "of opposite sign to each other", "Reverse the sign of one."
        ),
        "sign_theta1": Reading(_on("theta1", -1), "theta1", "of the wrong sign", "Reverse its sign."),
        "sign_theta2": Reading(_on("theta2", -1), "theta2", "of the wrong sign", "Reverse its sign."),
        "space_angle": Reading(
            ((1, 0), (1, 1)),
            "theta2",
            "the angle of the upper body in space; expected the hip angle",
            "Give the upper body's angle minus theta1.",
        ),
        "trunk_frame": Reading(
            ((1, 1), (0, 1)),
            "theta1",
            "the angle of the upper body in space; expected that of the lower body",
            "Give the angle of the lower body as theta1.",
            check="certain",
        ),
    }
    return out


def butterworth(s: np.ndarray, order: int) -> np.ndarray:
    """Response at s = i f / corner of a filter of even order."""
    damping = np.sin(np.pi * (np.arange(order // 2) + 0.5) / order)
    return np.asarray(np.prod([1 / (s**2 + 2 * d * s + 1) for d in damping], axis=0))


READINGS: dict[str, Reading] = _table()
"""Readings by the code with which ``accept`` keeps the labels."""
