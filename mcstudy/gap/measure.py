"""From a recording of any kind to `Lines`."""

from __future__ import annotations

import math

from mcstudy.errors import RecordingError
from mcstudy.gap.frf_only import FrfRecording
from mcstudy.gap.lines import Lines
from mcstudy.gap.periodic import periodic_lines
from mcstudy.gap.recording import LEAST_LINES, Recording
from mcstudy.gap.segments import segment_lines


def measure(recording: Recording | FrfRecording, fmax: float = 8.0, discard: int = 1) -> Lines:
    """Lines of a recording up to ``fmax`` (Hz); ``discard`` transient cycles are left out of a periodic one.

    A periodic stimulus gives its excited lines, any other the lines of overlapping segments, a published FRF itself.
    Raises `RecordingError` when the recording is too short, or has fewer than `LEAST_LINES` lines up to ``fmax``.
    """
    if not (math.isfinite(fmax) and fmax > 0):
        raise RecordingError(f"{recording.name}: fmax: expected a positive number of Hz, got {fmax!r}")
    if isinstance(recording, FrfRecording):
        lines = recording.lines.below(fmax)
    elif recording.period_s is None:
        lines = segment_lines(recording, fmax)
    else:
        lines = periodic_lines(recording, fmax, discard)
    if len(lines) < LEAST_LINES:
        raise RecordingError(
            f"{recording.name}: expected at least {LEAST_LINES} lines up to fmax = {fmax:g} Hz, got {len(lines)}"
        )
    return lines
