"""Several recordings of one body as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mcstudy.errors import RecordingError
from mcstudy.gap.recording import Recording

SAME = ("rate_hz", "period_s", "stimulus", "body", "convention")
"""Fields that trials of one recording share."""


def together(recordings: Sequence[Recording]) -> Recording:
    """All trials of recordings that agree in `SAME`; `RecordingError` names the field in which they do not."""
    first = recordings[0]
    for other in recordings[1:]:
        for name in SAME:
            if getattr(other, name) != getattr(first, name):
                raise RecordingError(
                    f"{other.name}: {name}: {getattr(other, name)}, but {first.name} has {getattr(first, name)}; "
                    "expected recordings of one body with one stimulus"
                )
    return replace(
        first,
        trials=tuple(t for r in recordings for t in r.trials),
        name=" + ".join(r.name for r in recordings),
        suspicions=tuple(s for r in recordings for s in r.suspicions),
    )
