"""Recordings: their diagnosis, from paths or in memory. It needs nothing of studies, nor of what runs them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from mcstudy.errors import InputError
from mcstudy.gap.diagnose import BOOTSTRAP, diagnose_fast
from mcstudy.gap.diagnose import diagnose as diagnose_with_bootstrap
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.io import read_recording
from mcstudy.recordings.recording import Recording
from mcstudy.report.diagnosis.plots import DiagnosisWithFigures
from mcstudy.stance.feedback import Model

AnyRecording = Recording | FrfRecording | str | Path


def diagnose(
    recording: AnyRecording | Sequence[AnyRecording],
    *,
    fast: bool = False,
    bootstrap: int | None = None,
    seed: int = 0,
    model: Model | None = None,
    fmax: float = 8.0,
    discard: int = 1,
    accept: Iterable[str] = (),
) -> DiagnosisWithFigures:
    """Where the model fails on a recording, which effect is missing, and how far adding it closes the gap.

    Parameters
    ----------
    recording
        What `read_recording` or `simulate` returned, or a path. Several recordings of one person are pooled.
    fast
        Asymptotic null distributions instead of a bootstrap that refits the model, which takes longer.
    bootstrap
        Null samples of the bootstrap; 1000 when None.
    seed
        Random seed; the same seed gives the same numbers.
    model
        Base model; the two-segment model of the recording's body when None.
    fmax
        Highest frequency used, Hz.
    discard
        Transient cycles left out at the start of every trial.
    accept
        Codes of warnings about mislabelled channels that are to be accepted, e.g. ``"swapped"``.

    Returns
    -------
    Diagnosis
        With ``verdict()``, ``plot``, ``to_html(path)`` and ``to_dict()``.

    Raises
    ------
    RecordingError
        A recording cannot be analysed, or its channels are not what their labels say.
    InputError
        ``bootstrap`` was given together with ``fast``.
    """
    if fast and bootstrap is not None:
        raise InputError("bootstrap: expected without fast, which does not use it")
    given = [recording] if isinstance(recording, AnyRecording) else list(recording)
    read = [read_recording(r) if isinstance(r, str | Path) else r for r in given]
    if fast:
        found = diagnose_fast(read, seed=seed, model=model, fmax=fmax, discard=discard, accept=accept)
    else:
        found = diagnose_with_bootstrap(
            read,
            bootstrap=BOOTSTRAP if bootstrap is None else bootstrap,
            seed=seed,
            model=model,
            fmax=fmax,
            discard=discard,
            accept=accept,
        )
    return DiagnosisWithFigures.of(found)
