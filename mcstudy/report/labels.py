"""How conditions are called, in figures and tables alike."""

from __future__ import annotations

from mcstudy.analysis.view import GroupView


def amplitude_label(view: GroupView, amplitude: float) -> str:
    """E.g. ``5 N m``; ``no noise`` for a group whose data do not depend on the amplitude."""
    return f"{amplitude:g} {unit(view)}" if view.noisy else "no noise"


def unit(view: GroupView) -> str:
    """Unit of the stimulus, for people."""
    return str(view.model.stimulus_unit).replace("N m", "N·m")


def fmax_label(fmax: float) -> str:
    """E.g. ``1.2 Hz``."""
    return f"{fmax:g} Hz"


def cell_label(view: GroupView, amplitude: float, fmax: float) -> str:
    """E.g. ``5 N·m, 1.2 Hz``."""
    return f"{amplitude_label(view, amplitude)}, {fmax_label(fmax)}"
