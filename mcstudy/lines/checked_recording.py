"""From recordings of one person to frequency lines, with all checks that a diagnosis needs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from mcstudy.errors import InputError, RecordingError
from mcstudy.lines.labels import merged, plausibility, refuse
from mcstudy.recordings.checks import check
from mcstudy.recordings.copies import numbered, refuse_copies
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint import POOLED, AnyRecording, JointRecording, refuse_other_body
from mcstudy.recordings.recording import Recording
from mcstudy.recordings.soundness import with_left_out
from mcstudy.spectra.joint_lines import joined
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.measure import highest, measure, require_noise, up_to, wide_lines
from mcstudy.stance.feedback import Model

Discard = int | tuple[int, ...]
"""Transient cycles left out: of every recording, or of each part of a joint one."""


def pooled(recording: AnyRecording | Sequence[Recording | FrfRecording]) -> AnyRecording:
    """One recording with all trials, or a joint one whose parts differ in stimulus, period or sampling rate.

    Raises `RecordingError` when the bodies differ.
    """
    if isinstance(recording, AnyRecording):
        return recording
    if not recording:
        raise RecordingError("recordings: expected at least one")
    if len(recording) == 1:
        return recording[0]
    several = [r for r in recording if isinstance(r, Recording)]
    if len(several) < len(recording):
        raise RecordingError("recordings: expected time series only when there are several, got a published FRF")
    for r in several[1:]:
        refuse_other_body(several[0], r)
    groups: dict[tuple[object, ...], list[Recording]] = {}
    for r in several:
        groups.setdefault(tuple(getattr(r, name) for name in POOLED), []).append(r)
    parts = tuple(
        replace(
            own[0],
            trials=tuple(t for r in own for t in r.trials),
            suspicions=merged(*(r.suspicions for r in own)),
        )
        for own in groups.values()
    )
    return parts[0] if len(parts) == 1 else JointRecording(parts)


def discarded(discard: Discard, part: int) -> int:
    """The cycles left out of one part of a joint recording."""
    return discard if isinstance(discard, int) else discard[part]


def given_model(model: Model | None, recording: AnyRecording, lines: Lines) -> Model:
    """``model``, or the one on the recording's body and stimulus, or on all stimuli of a joint one.

    A recording calls the angles of a ``model`` theta1 and theta2, so its rows and angles get their usual names.

    Raises `InputError` for a ``model`` of a joint recording: it has one stimulus.
    """
    if not isinstance(recording, JointRecording):
        return model.with_usual_names() if model is not None else recording.base_model()
    if model is not None:
        raise InputError(f"model: expected none for recordings under different stimuli, got {model.name}")
    return recording.base_model(lines.counts)


def checked_lines(
    recording: AnyRecording | Sequence[Recording | FrfRecording],
    fmax: float | None = None,
    discard: Discard = 1,
    accept: Iterable[str] = (),
) -> tuple[AnyRecording, Lines]:
    """All trials as one recording, with its data quality warnings in ``suspicions``, and its lines.

    Parameters as in `mcstudy.gap.diagnose.diagnose`; ``discard`` may state a number for every part of a joint
    recording, whose parts are checked one by one. Raises `RecordingError` for a recording that cannot be analysed, for
    one that is there twice, and for channels that are certainly mislabelled unless their code is in ``accept``.
    """
    found = _checked(pooled(recording), fmax, discard, accept)
    if not isinstance(recording, AnyRecording):
        refuse_copies(numbered(recording), accept)
    elif not isinstance(recording, FrfRecording):
        parts = recording.parts if isinstance(recording, JointRecording) else (recording,)
        refuse_copies(numbered(parts), accept)
    return found


def _checked(
    one: AnyRecording, fmax: float | None, discard: Discard, accept: Iterable[str]
) -> tuple[AnyRecording, Lines]:
    if isinstance(one, JointRecording):
        checked = [_checked(p, fmax, discarded(discard, k), accept) for k, p in enumerate(one.parts)]
        parts = tuple(p for p, _ in checked if isinstance(p, Recording))
        return JointRecording(parts), joined([lines for _, lines in checked])
    discard = discarded(discard, 0)
    if isinstance(one, FrfRecording):
        lines = measure(one, fmax, discard)
        require_noise(lines, one.name)
        return one, lines
    noted = check(one)
    one = with_left_out(one, accept, discard)
    fmax = highest(one, fmax)
    wide = wide_lines(one, fmax, discard)
    lines = up_to(fmax, wide, one.name)
    require_noise(lines, one.name)
    # Collect all suspicions before deciding, because one check may find what another misses.
    found = merged(one.suspicions, noted, plausibility(one, wide))
    refuse(found, accept)
    return replace(one, suspicions=found), lines
