"""From a recording of any kind to `Lines`."""

from __future__ import annotations

from mcstudy.gap.frf_only import FrfRecording
from mcstudy.gap.lines import Lines
from mcstudy.gap.periodic import periodic_lines
from mcstudy.gap.recording import Recording
from mcstudy.gap.segments import segment_lines


def measure(recording: Recording | FrfRecording, fmax: float = 8.0, discard: int = 1) -> Lines:
    """Lines of a recording up to ``fmax`` (Hz); ``discard`` transient cycles are left out of a periodic one.

    A periodic stimulus gives its excited lines, any other the lines of overlapping segments, a published FRF itself.
    Raises `RecordingError` when the recording is too short.
    """
    if isinstance(recording, FrfRecording):
        return recording.lines.below(fmax)
    if recording.period_s is None:
        return segment_lines(recording, fmax)
    return periodic_lines(recording, fmax, discard)
