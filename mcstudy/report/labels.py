"""How conditions are called, in figures and tables alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mcstudy.analysis.view import GroupView

CONTROLLERS = {
    ("ankle", "theta1"): "T11",
    ("ankle", "theta2"): "T21",
    ("hip", "theta1"): "T12",
    ("hip", "theta2"): "T22",
}
"""The paper's names of the neural controllers by joint and sensed angle: T12 is hip torque from theta1."""


def amplitude_label(view: GroupView, amplitude: float) -> str:
    """E.g. ``5 N m``; ``no noise`` for a group whose data do not depend on the amplitude."""
    return f"{amplitude:g} {unit(view)}" if view.noisy else "no noise"


def unit(view: GroupView) -> str:
    """Unit of the stimulus, for people."""
    return with_units(view.model.stimulus_unit)


def with_units(text: str) -> str:
    """Text with its units as the page writes them, N·m for the N m of files."""
    return text.replace("N m", "N·m")


def fmax_label(fmax: float) -> str:
    """E.g. ``1.2 Hz``."""
    return f"{fmax:g} Hz"


def cell_label(view: GroupView, amplitude: float, fmax: float) -> str:
    """E.g. ``5 N·m, 1.2 Hz``."""
    return f"{amplitude_label(view, amplitude)}, {fmax_label(fmax)}"
