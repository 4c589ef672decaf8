"""From recordings of one person to frequency lines, with all checks that a diagnosis needs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from mcstudy.errors import RecordingError
from mcstudy.gap.questions.labels import merged, plausibility, refuse
from mcstudy.recordings.checks import check
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.measure import measure, require_noise

LABELS_HZ = 8.0
"""Labels are checked with responses up to this frequency, even if fewer lines are diagnosed, because inertia
determines the responses above 2 Hz."""


def pooled(recording: Recording | FrfRecording | Sequence[Recording | FrfRecording]) -> Recording | FrfRecording:
    """One recording with all trials; raises `RecordingError` when stimulus, sampling or body differ."""
    if isinstance(recording, Recording | FrfRecording):
        return recording
    if not recording:
        raise RecordingError("recordings: expected at least one")
    if len(recording) == 1:
        return recording[0]
    several = [r for r in recording if isinstance(r, Recording)]
    if len(several) < len(recording):
        raise RecordingError("recordings: expected time series only when there are several, got a published FRF")
    first, *rest = several
    for r in rest:
        for field in ("rate_hz", "period_s", "stimulus", "body", "convention"):
            if getattr(r, field) != getattr(first, field):
                raise RecordingError(
                    f"{r.name}: {field}: expected {getattr(first, field)!r} as in {first.name}, "
                    f"got {getattr(r, field)!r}; diagnose them separately"
                )
    return replace(
        first,
        trials=tuple(t for r in several for t in r.trials),
        suspicions=merged(*(r.suspicions for r in several)),
    )


def checked_lines(
    recording: Recording | FrfRecording | Sequence[Recording | FrfRecording],
    fmax: float = 8.0,
    discard: int = 1,
    accept: Iterable[str] = (),
) -> tuple[Recording | FrfRecording, Lines]:
    """All trials as one recording, with its data quality warnings in ``suspicions``, and its lines.

    Parameters as in `mcstudy.gap.diagnose.diagnose`. Raises `RecordingError` for a recording that
    cannot be analysed, and for channels that are certainly mislabelled unless their code is in ``accept``.
    """
    one = pooled(recording)
    if isinstance(one, FrfRecording):
        lines = measure(one, fmax, discard)
        require_noise(lines, one.name)
        return one, lines
    noted = check(one)
    lines = measure(one, fmax, discard)
    require_noise(lines, one.name)
    at_least = min(LABELS_HZ, one.rate_hz / 2.5)
    judged = lines if fmax >= at_least else measure(one, at_least, discard)
    # Collect all suspicions before deciding, because one check may find what another misses.
    found = merged(one.suspicions, noted, plausibility(one, judged))
    refuse(found, accept)
    return replace(one, suspicions=found), lines
