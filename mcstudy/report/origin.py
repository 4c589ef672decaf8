"""Where the numbers of a page come from: the rows of a table about a recording."""

from __future__ import annotations

from mcstudy.recordings.joint_recording import AnyRecording, JointRecording
from mcstudy.recordings.recording import Recording
from mcstudy.report.labels import with_units


def recording_rows(name: str, recording: AnyRecording | None) -> list[list[str]]:
    """Name, origin, stimulus, trials and period of a recording, or of each part of a joint one, as rows of words."""
    if isinstance(recording, JointRecording):
        return [row for part in recording.parts for row in recording_rows(part.name, part)]
    rows = [["recording", name]]
    if recording is not None:
        rows += [["origin", recording.provenance or "not stated"], ["stimulus", recording.stimulus]]
    if isinstance(recording, Recording):
        peaks = ", ".join(f"{a:.3g}" for a in recording.amplitudes)
        rows += [
            ["trials", f"{len(recording.trials)}, {recording.duration_s:.0f} s together at {recording.rate_hz:g} Hz"],
            ["amplitudes (peak)", f"{peaks} {with_units(recording.stimulus_unit)}"],
            ["period", "none" if recording.period_s is None else f"{recording.period_s:g} s"],
        ]
    return rows
