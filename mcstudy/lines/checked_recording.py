"""From recordings of one person to frequency lines, with all checks that a fit or a diagnosis needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

from mcstudy.errors import InputError, RecordingError
from mcstudy.lines.labels import merged, plausibility, refuse
from mcstudy.lines.settings import LineSettings
from mcstudy.recordings.checks import check
from mcstudy.recordings.columns import of_model
from mcstudy.recordings.copies import numbered, refuse_copies
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.joint_recording import POOLED, AnyRecording, JointRecording, refuse_other_body
from mcstudy.recordings.recording import Recording
from mcstudy.recordings.soundness import with_left_out
from mcstudy.spectra.lines import Lines, joined
from mcstudy.spectra.measure import highest, measure, require_noise, up_to, wide_lines
from mcstudy.stance.body import standing
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
        raise RecordingError("recordings: a published FRF cannot be combined with other recordings")
    for r in several[1:]:
        refuse_other_body(several[0], r)
    groups: dict[tuple[object, ...], list[Recording]] = {}
    for r in several:
        groups.setdefault(tuple(getattr(r, name) for name in POOLED), []).append(r)
    parts = tuple(
        replace(
            group[0],
            trials=tuple(t for r in group for t in r.trials),
            suspicions=merged(*(r.suspicions for r in group)),
        )
        for group in groups.values()
    )
    return parts[0] if len(parts) == 1 else JointRecording(parts)


def discarded(discard: Discard, part: int) -> int:
    """The cycles left out of one part of a joint recording."""
    return discard if isinstance(discard, int) else discard[part]


def given_model(model: Model | None, recording: AnyRecording, lines: Lines) -> Model:
    """``model``, or the one on the recording's body and stimulus, or on all stimuli of a joint one.

    Raises `InputError` for a ``model`` of a joint recording: it has one stimulus.
    """
    if not isinstance(recording, JointRecording):
        return model if model is not None else recording.base_model()
    if model is not None:
        raise InputError(f"model: expected none for recordings under different stimuli, got {model.name}")
    return recording.base_model(lines.counts)


def _of_declared(recording: AnyRecording, model: Model | None) -> AnyRecording:
    """The recording, as one of a declared ``model`` where that is given."""
    if model is None or standing(model) or isinstance(recording, JointRecording):
        return recording
    if model.blocks:
        stimuli = ", ".join(model.stimulus_names)
        raise InputError(f"model {model.name}: expected one stimulus, which the recording holds, got {stimuli}")
    return of_model(recording, model)


@dataclass(frozen=True)
class CheckedRecording:
    """Recordings of one person that can be analysed: labels settled, cycles chosen, lines measured.

    Attributes
    ----------
    recording
        All trials as one recording, with its data quality warnings in ``suspicions``.
    lines
        Its frequency lines up to ``fmax``.
    nominal
        The base model, with values of the order of magnitude of a person's.
    fmax
        Highest frequency used, Hz.
    discard
        Cycles left out at the start of every trial, or of those of each part of a joint recording.
    """

    recording: AnyRecording
    lines: Lines
    nominal: Model
    fmax: float
    discard: Discard

    @property
    def warnings(self) -> tuple[str, ...]:
        """The data quality warnings in words."""
        return () if isinstance(self.recording, FrfRecording) else tuple(s.message for s in self.recording.suspicions)


def checked_recording(
    recordings: AnyRecording | Sequence[Recording | FrfRecording],
    settings: LineSettings = LineSettings(),
    discard: Discard | None = None,
) -> CheckedRecording:
    """Check recordings of one person and measure their lines, without their first ``discard`` cycles.

    ``discard``: a number, or one for every part of a joint recording, whose parts are checked one by one; None for that
    of ``settings``, or one.

    Raises `RecordingError` for a recording that cannot be analysed, for one that is there twice, and for channels that
    are certainly mislabelled unless their code is accepted; `InputError` for an unknown code, and for a model of a
    joint recording.
    """
    if discard is None:
        discard = 1 if settings.discard is None else settings.discard
    recording, lines = _measured(_of_declared(pooled(recordings), settings.model), settings, discard)
    if not isinstance(recordings, AnyRecording):
        refuse_copies(numbered(recordings), settings.accept)
    elif not isinstance(recordings, FrfRecording):
        parts = recordings.parts if isinstance(recordings, JointRecording) else (recordings,)
        refuse_copies(numbered(parts), settings.accept)
    nominal = given_model(settings.model, recording, lines)
    return CheckedRecording(recording, lines, nominal, highest(recording, settings.fmax), discard)


def _measured(recording: AnyRecording, settings: LineSettings, discard: Discard) -> tuple[AnyRecording, Lines]:
    """The recording with what is suspected of it, and its lines."""
    if isinstance(recording, JointRecording):
        measured = [_measured(part, settings, discarded(discard, k)) for k, part in enumerate(recording.parts)]
        parts = tuple(cast(Recording, part) for part, _ in measured)
        return replace(recording, parts=parts), joined([lines for _, lines in measured])
    discard = discarded(discard, 0)
    if isinstance(recording, FrfRecording):
        lines = measure(recording, settings.fmax, discard)
        require_noise(lines, recording)
        return recording, lines
    noted = check(recording)
    recording = with_left_out(recording, settings.accept, discard)
    fmax = highest(recording, settings.fmax)
    wide = wide_lines(recording, fmax, discard)
    lines = up_to(fmax, wide, recording.name)
    require_noise(lines, recording)
    # Collect all suspicions before deciding, because one check may find what another misses. What responses a declared
    # model can have is not known, so its labels are not judged by them.
    labels = plausibility(recording, wide) if recording.model is None else ()
    suspicions = merged(recording.suspicions, noted, labels)
    refuse(suspicions, settings.accept)
    return replace(recording, suspicions=suspicions), lines
