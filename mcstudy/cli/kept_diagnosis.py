"""Diagnoses that are kept, so that the next look at the same recordings need not compute them again.

They lie in ``$MCSTUDY_CACHE_DIR/diagnoses``, by default ``~/.cache/mcstudy/diagnoses``; whoever deletes them loses
nothing but time. The name of a file is a hash of everything that a diagnosis depends on: all that was read of the
recordings, the options, the source of this package, versions, CPU and settings. So other data, other options, another
program and another machine do not find it, and a process whose own source has changed keeps nothing.

A file is a `DiagnosisRecord` as data (`mcstudy.files.objects`: nothing in it can be executed) without the recorded
signals: these may be a patient's, and belong where their owner has put them. Only a folder is used that belongs to this
user and that nobody else may write to. A folder that cannot be used, and a damaged file, are as if they were not
there.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcstudy.analysis.kept import maker
from mcstudy.files.objects import NotData, from_bytes, to_bytes
from mcstudy.files.sealed import read_sealed, write_sealed
from mcstudy.recordings.recording import Recording, Trial

if TYPE_CHECKING:
    from mcstudy.gap.diagnosis import DiagnosisRecord
    from mcstudy.recordings.frf import FrfRecording

VARIABLE = "MCSTUDY_CACHE_DIR"
"""Environment variable: where files are kept that only save time; empty, none are kept."""

MOST = 32
"""Diagnoses that are kept; the oldest are removed. Each takes some 0.4 MB."""

OTHERS_WRITE = 0o022
"""Permission bits with which others may write."""


def folder() -> Path | None:
    """Where diagnoses are kept; None where none are."""
    chosen = os.environ.get(VARIABLE)
    if chosen is not None:
        return Path(chosen) / "diagnoses" if chosen else None
    caches = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not caches.is_absolute():
        try:
            caches = Path.home() / ".cache"
        except RuntimeError:  # a user without a home
            return None
    return caches / "mcstudy" / "diagnoses"


def kept_diagnosis(
    recordings: Sequence[Recording | FrfRecording],
    options: Mapping[str, Any],
    compute: Callable[[], DiagnosisRecord],
    also: Sequence[Mapping[str, Any]] = (),
) -> DiagnosisRecord:
    """What ``compute`` returns for these recordings and ``options`` (JSON values); computed only if it is not kept.

    ``also``: other options whose diagnosis holds all that is asked for, and the same numbers.
    """
    place, made_by = folder(), maker()
    if place is None or made_by is None:
        return compute()
    read = sha256(to_bytes(list(recordings))).hexdigest()
    trials = [trial for r in recordings if isinstance(r, Recording) for trial in r.trials]

    def name(options: Mapping[str, Any]) -> str:
        return sha256(json.dumps([read, dict(options), made_by], sort_keys=True).encode()).hexdigest()

    for each in (options, *also):
        found = _read(place / name(each), trials)
        if found is not None:
            return found
    diagnosis = compute()
    _ = diagnosis.sway_noise_deg  # computed when it is asked for, which every text and page does
    if maker() == made_by:
        _write(place / name(options), diagnosis, trials)
    return diagnosis


def _read(file: Path, trials: Sequence[Trial]) -> DiagnosisRecord | None:
    content = read_sealed(file) if _ours(file.parent) else None
    if content is None:
        return None
    diagnosis: DiagnosisRecord = from_bytes(content, trials)
    return diagnosis


def _write(file: Path, diagnosis: DiagnosisRecord, trials: Sequence[Trial]) -> None:
    with contextlib.suppress(OSError, NotData):  # a read-only or full disk; signals that were changed
        content = to_bytes(diagnosis, trials, only_apart=Trial)
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _ours(file.parent):
            write_sealed(file, content, MOST)


def _ours(place: Path) -> bool:
    """Whether a folder is this user's, and nobody else may write to it."""
    try:
        about = place.stat()
    except OSError:
        return False
    return about.st_uid == os.getuid() and not about.st_mode & OTHERS_WRITE
