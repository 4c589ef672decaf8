"""Fits of many people, spread over the scheduler's workers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcstudy.errors import InputError, McstudyError, RecordingError
from mcstudy.identification.conditions.fit import fit_conditions
from mcstudy.identification.conditions.settings import ConditionSettings
from mcstudy.identification.fit import fit
from mcstudy.identification.fit_record import FitRecord
from mcstudy.identification.people.combination import combine
from mcstudy.identification.people.group_record import GroupRecord
from mcstudy.identification.people.members import Member, at_once
from mcstudy.identification.settings import FitSettings
from mcstudy.recordings.copies import refuse_copies
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.io import read_recording
from mcstudy.recordings.joint_recording import JointRecording
from mcstudy.recordings.recording import Recording
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.scheduler.fan_out import fan_out

Known = Recording | FrfRecording | FitRecord | Path
"""What a person may be known by: a recording, the path of one, or a fit that was made before."""


@dataclass(frozen=True)
class _Failure:
    reason: str


def fit_members(
    members: Sequence[Member[Any]],
    settings: FitSettings,
    options: ClusterOptions,
    *,
    pair: bool | None = None,
    data: Path | None = None,
) -> GroupRecord:
    """Fit every member, then the population. With `ConditionSettings` all conditions of a person are fitted at once.

    Parameters
    ----------
    members: what they are known by is one of `Known`. settings: of every fit. options: where to run. pair: as in
    `mcstudy.fit_group`. data: folder of the data files of recordings.

    Raises `InputError` for a wrong argument, and when too few people could be fitted; `Stopped` when it was stopped.
    """
    if not members:
        raise InputError("recordings: expected at least one")
    for m in members:
        if len(m.items) > 1 and any(isinstance(i, FitRecord) for i in m.items):
            raise InputError(f"{m.name}: expected one fit per person and condition, got {len(m.items)}")
    members = at_once(members) if isinstance(settings, ConditionSettings) else members
    _refuse_copies(members, data, settings)

    def fitted(k: int) -> FitRecord | _Failure:
        return _fit(members[k], data, settings)

    outcomes = dict(
        fan_out(fitted, range(len(members)), options, f"{len(members)} fits of people", unit="fits", resumes=False)
    )
    fits = [
        Member(m.person, m.condition, (f,)) for k, m in enumerate(members) if isinstance(f := outcomes[k], FitRecord)
    ]
    failed = [
        (m.person, m.condition, f.reason) for k, m in enumerate(members) if isinstance(f := outcomes[k], _Failure)
    ]
    if not fits:
        person, condition, why = failed[0]
        raise InputError(f"people: none could be fitted; {person}, {condition}: {why}")
    return combine(fits, pair=pair, failed=failed)


def _refuse_copies(members: Sequence[Member[Known]], data: Path | None, settings: FitSettings) -> None:
    """Raise `RecordingError` for a file that is named twice, or for data that are there twice; what cannot be read is
    the business of the fits."""
    named: list[tuple[str, Recording | FrfRecording]] = []
    paths: dict[Path, str] = {}
    for m in members:
        for k, item in enumerate(m.items, start=1):
            name = f"{item} ({m.name})" if isinstance(item, Path) else f"{m.name}{f', {k}' if len(m.items) > 1 else ''}"
            if isinstance(item, Path):
                if (first := paths.setdefault(item.resolve(), name)) is not name:
                    raise RecordingError(f"people: {name}: the same file as {first}; expected every file once")
                try:
                    item = read_recording(item, data, settings.model)
                except McstudyError:
                    continue
            recording = item.recording if isinstance(item, FitRecord) else item
            parts = recording.parts if isinstance(recording, JointRecording) else (recording,)
            named += [(name, r) for r in parts if isinstance(r, Recording | FrfRecording)]
    refuse_copies(named, settings.accept, "people")


def _fit(member: Member[Known], data: Path | None, settings: FitSettings) -> FitRecord | _Failure:
    """The fit of one member; whatever fails is returned in words, so that it does not stop the others."""
    if isinstance(member.items[0], FitRecord):
        return member.items[0]
    try:
        read = [read_recording(i, data, settings.model) if isinstance(i, Path) else i for i in member.items]
        recordings = [r for r in read if not isinstance(r, FitRecord)]
        if isinstance(settings, ConditionSettings):
            return fit_conditions(recordings, settings, member.conditions).fit
        return fit(recordings, settings)
    except McstudyError as error:
        return _Failure(" ".join(str(error).split()))
    except Exception as error:
        return _Failure(f"{type(error).__name__}: {' '.join(str(error).split())}")
