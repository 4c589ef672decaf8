"""Recordings from a description (`mcstudy.recordings.sheets.recording_sheet`) and its files, or files of the user."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcstudy.errors import RecordingError
from mcstudy.files.local_path import local_path
from mcstudy.recordings.channels import Read, trials_of
from mcstudy.recordings.data_files import Files
from mcstudy.recordings.formats.source import SHOWN, Picked
from mcstudy.recordings.frf import COLUMNS, FrfRecording, frf_of_columns
from mcstudy.recordings.recording import Recording
from mcstudy.recordings.refusals import refused
from mcstudy.recordings.sheets.body_sheet import body_of
from mcstudy.recordings.sheets.recording_sheet import Sheet, TrialSheet, document
from mcstudy.recordings.sheets.tables import described
from mcstudy.recordings.units import FACTORS, KINDS, agreed, factor, kind_of
from mcstudy.stance.body import STIMULI
from mcstudy.text_tables import printable

DEGREE = FACTORS["rad"]["deg"]


@dataclass(frozen=True)
class Assembled:
    """A recording, its trials as they were read, and in words what was done to them."""

    recording: Recording
    read: tuple[Read, ...]
    notes: tuple[str, ...]


def read_sheet(path: str | Path, data: str | Path | None = None) -> Recording | FrfRecording:
    """The recording that a TOML file describes, with its data files in ``data`` (the TOML file's folder when None).

    Checks the structure only; `mcstudy.recordings.io` adds the checks of the data. Raises `RecordingError` naming the
    file and the field.
    """
    path = local_path(path)
    sheet = described(Sheet, document(path), str(path))
    folder = path.parent if data is None else Path(data)
    if sheet.frf is not None:
        return _frf(sheet, Files(folder, sheet.text.dialect(), str(path)), str(path))
    return assemble(sheet, folder, str(path)).recording


def assemble(sheet: Sheet, folder: Path, where: str, own: Sequence[str] = ()) -> Assembled:
    """The recording of a description whose trials are in files of ``folder``, or among ``own`` (see `Files`)."""
    files = Files(folder, sheet.text.dialect(), where, own)
    body, source = body_of(sheet.body, files.source, where)
    if not sheet.trials:
        raise RecordingError(f"{where}: trials: expected at least one")
    read, notes = trials_of(sheet, files, where)
    notes = (*notes, *([source] if source else []))
    with refused(RecordingError, where=where):
        recording = Recording(
            tuple(r.trial for r in read),
            read[0].rate_hz,
            sheet.period_s,
            sheet.stimulus,
            body,
            sheet.convention,
            sheet.name,
            "; ".join(filter(None, (sheet.provenance, *notes))),
            person=sheet.person,
            condition=sheet.condition,
        )
    return Assembled(recording, read, notes)


def with_files(content: Mapping[str, Any], names: Sequence[str], where: str) -> Sheet:
    """A description whose trials are the named files, one each."""
    sheet = described(Sheet, content, where)
    if sheet.frf is not None:
        raise RecordingError(f"{where}: frf: expected a description of time series")
    if sheet.trials and names:
        raise RecordingError(f"{where}: trials: expected none, because files are named for the import")
    if not names:
        return sheet
    return sheet.model_copy(update={"trials": tuple(TrialSheet(file=name) for name in names)})


def _frf(sheet: Sheet, files: Files, where: str) -> FrfRecording:
    body, remark = body_of(sheet.body, files.source, where)
    if sheet.trials or sheet.frf is None:
        raise RecordingError(f"{where}: frf: expected either trials or an frf, got both")
    file = files.source(sheet.frf.file)
    target = STIMULI[sheet.stimulus]
    if target == "rad" and (sheet.units.angle is None) != (sheet.units.stimulus is None):
        raise RecordingError(f"{where}: units: expected both angle and stimulus for the FRF of a {sheet.stimulus}")
    picked = {name: file.pick(name) for name in COLUMNS if file.has(name)}
    if "f" not in picked:
        raise RecordingError(
            f"{file.path}: column 'f' (Hz) is missing; found {printable(', '.join(list(file.variables)[:SHOWN]))}"
        )
    angle, stimulus = _frf_units(sheet, picked, str(file.path))
    scale = factor(angle or "rad", "rad", f"{where}: units.angle") / factor(
        stimulus or target, target, f"{where}: units.stimulus"
    )
    f, y, C, single = frf_of_columns({n: p.values for n, p in picked.items()}, scale, str(file.path))
    provenance = "; ".join(filter(None, (sheet.provenance, remark, *files.remarks())))
    with refused(RecordingError, where=file.path):
        return FrfRecording(f, y, C, sheet.stimulus, body, single, sheet.name, provenance)


def _frf_units(sheet: Sheet, columns: Mapping[str, Picked], where: str) -> tuple[str | None, str | None]:
    """Units of angle and stimulus, declared or stated as deg/Nm in a header, which may not contradict each other."""
    angle, stimulus = sheet.units.angle, sheet.units.stimulus
    if sheet.units.stated == "ignored":
        return angle, stimulus
    for name, picked in columns.items():
        kind, unit = kind_of(picked.unit), picked.unit or ""
        if name == "f" or name.startswith("phase"):
            expected = "Hz" if name == "f" else "deg"
            right = unit == "Hz" if name == "f" else kind == KINDS["rad"] and factor(unit, "rad", where) == DEGREE
            if kind is not None and not right:
                raise RecordingError(f"{where}: {name}: unit: expected {expected}, but the file states {unit}")
        elif not name.startswith("c12"):
            over, _, under = unit.partition("/")
            angle = agreed(angle, over, "rad", f"{where}: {name}", name)
            stimulus = agreed(stimulus, under, STIMULI[sheet.stimulus], f"{where}: {name}", name)
    return angle, stimulus
