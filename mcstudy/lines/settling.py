"""How many cycles to leave out at the start of a recording: until the slowest oscillation of the fitted body decays.

A recording starts from rest or from any other state, and what is left of it after the discarded cycles is a systematic
error of the response, equal in all trials. One cycle is enough for a body whose oscillations decay within it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from mcstudy.lines.checked_recording import CheckedRecording, Discard, checked_recording, discarded
from mcstudy.lines.settings import LineSettings
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint_recording import AnyRecording, JointRecording
from mcstudy.recordings.recording import Recording
from mcstudy.stance.feedback import Model
from mcstudy.stance.stability import rightmost_root


class FittedBody(Protocol):
    """A model with parameters (P,) that were fitted to lines."""

    @property
    def model(self) -> Model:
        """What was fitted."""

    @property
    def theta(self) -> np.ndarray:
        """Its parameters (P,)."""


F = TypeVar("F", bound=FittedBody)

OVER = 0.05
"""Share of its first amplitude below which the start is over."""

REAL = 1e-6
"""Imaginary part (rad/s) below which a root does not oscillate. What creeps is smooth over the lines and is removed
with the leakage (`mcstudy.spectra.transient`)."""


def settled(
    recordings: AnyRecording | Sequence[Recording | FrfRecording],
    settings: LineSettings,
    fit: Callable[[CheckedRecording], F],
) -> tuple[CheckedRecording, F]:
    """Checked recordings of one person without the cycles in which they settle, and the ``fit`` to their lines.

    Where the settings leave the number of cycles open, it follows from a fit without the first one. Lines of a body
    whose oscillation outlasts the discarded cycles have a note. Raises what `checked_recording` raises.
    """
    checked = checked_recording(recordings, settings)
    fitted = fit(checked)
    if settings.discard is None:
        needed = cycles_to_discard(checked.recording, fitted.model, fitted.theta)
        if longer(needed, checked.discard):
            checked = checked_recording(recordings, settings, needed)
            fitted = fit(checked)
    start = unsettled(checked.recording, fitted.model, fitted.theta, checked.discard)
    lines = replace(checked.lines, notes=(*checked.lines.notes, *start))
    return replace(checked, lines=lines), fitted


def cycles_to_discard(recording: AnyRecording, model: Model, theta: np.ndarray) -> Discard:
    """Cycles after which the slowest oscillation of ``model`` at ``theta`` (P,) is over, at most half of a trial.

    Of a joint recording those of each part.
    """
    if isinstance(recording, JointRecording):
        return tuple(_cycles(p, model, theta) for p in recording.parts)
    return _cycles(recording, model, theta)


def longer(needed: Discard, left_out: Discard) -> bool:
    """Whether more cycles are ``needed`` than ``left_out``, of any part."""
    if isinstance(needed, int):
        return needed > discarded(left_out, 0)
    return any(n > discarded(left_out, k) for k, n in enumerate(needed))


def _cycles(recording: Recording | FrfRecording, model: Model, theta: np.ndarray) -> int:
    period_s, root = _oscillation(recording, model, theta)
    if root is None:
        return 1
    sound = [len(c) for c in recording.analysed(0)] if isinstance(recording, Recording) else []
    most = max(1, min(sound, default=0) // 2)
    if root.real >= 0:
        return most
    return int(np.clip(math.ceil(math.log(OVER) / (root.real * period_s)), 1, most))


def unsettled(recording: AnyRecording, model: Model, theta: np.ndarray, discard: Discard) -> tuple[str, ...]:
    """A note when that oscillation outlasts the ``discard`` cycles left out, else nothing."""
    if isinstance(recording, JointRecording):
        return tuple(
            f"{label}: {note}"
            for k, (label, part) in enumerate(zip(recording.labels, recording.parts, strict=True))
            for note in unsettled(part, model, theta, discarded(discard, k))
        )
    discard = discarded(discard, 0)
    period_s, root = _oscillation(recording, model, theta)
    if root is None or (root.real < 0 and math.exp(root.real * period_s * discard) <= OVER):
        return ()
    where = f"the slowest oscillation of the fitted model ({root.imag / (2 * math.pi):.2f} Hz)"
    if root.real >= 0:
        return (f"{where} does not decay, so the start of the recording is part of what is fitted",)
    left = 100 * math.exp(root.real * period_s * discard)
    return (
        f"{where} keeps {left:.2g} % of its first amplitude after the {discard} discarded "
        f"cycle{'s' if discard > 1 else ''}, so the start of the recording is part of what is fitted",
    )


def _oscillation(recording: Recording | FrfRecording, model: Model, theta: np.ndarray) -> tuple[float, complex | None]:
    """Period, s, and rightmost root if it oscillates; None for a recording without cycles."""
    if not isinstance(recording, Recording) or recording.period_s is None:
        return math.nan, None
    root = complex(rightmost_root(model, theta).root)
    return recording.period_s, root if abs(root.imag) > REAL else None
