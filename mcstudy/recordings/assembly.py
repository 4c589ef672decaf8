"""Recordings from a description (`mcstudy.recordings.sheets.recording_sheet`) and its files, or files of the user."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcstudy.errors import RecordingError
from mcstudy.files.local_path import local_path
from mcstudy.recordings.channels import Read, trials_of
from mcstudy.recordings.columns import Columns, ModelLike, constants_of, model_of
from mcstudy.recordings.data_files import Files
from mcstudy.recordings.formats.source import SHOWN, Picked
from mcstudy.recordings.frf import FrfRecording, columns_of, frf_of_columns, labels_of
from mcstudy.recordings.recording import Recording, sentences
from mcstudy.recordings.refusals import refused
from mcstudy.recordings.sheets.body_sheet import Person, body_of
from mcstudy.recordings.sheets.recording_sheet import Sheet, TrialSheet, document, frf_factor
from mcstudy.recordings.sheets.tables import described
from mcstudy.recordings.units import FACTORS, KINDS, agreed, factor, kind_of
from mcstudy.stance.feedback import Model
from mcstudy.text_tables import printable

DEGREE = FACTORS["rad"]["deg"]


@dataclass(frozen=True)
class Assembled:
    """A recording, its trials as they were read, and in words what was done to them."""

    recording: Recording
    read: tuple[Read, ...]
    notes: tuple[str, ...]


def read_sheet(
    path: str | Path, data: str | Path | None = None, model: ModelLike | None = None
) -> Recording | FrfRecording:
    """The recording that a TOML file describes, with its data files in ``data`` (the TOML file's folder when None).

    ``model``: of which these are outputs, in place of the one that the file names.

    Checks the structure only; `mcstudy.recordings.io` adds the checks of the data. Raises `RecordingError` naming the
    file and the field.
    """
    path = local_path(path)
    sheet = described(Sheet, document(path), str(path))
    files = Files(path.parent if data is None else Path(data), sheet.text.dialect(), str(path))
    subject = _subject(sheet, files, str(path), model, path.parent)
    return _frf(sheet, files, str(path), subject) if sheet.frf else assemble(sheet, files, str(path), subject).recording


@dataclass(frozen=True)
class Subject:
    """Who or what was recorded: a person, or a declared model and the constants of the person that it took."""

    person: Person
    model: Model | None = None
    constants: Mapping[str, float] = field(default_factory=dict)

    @property
    def remark(self) -> str:
        """What there is to say of the body and of the constants."""
        return sentences(self.person.remark, ", ".join(f"{n} = {x:.4g}" for n, x in self.constants.items()))


def assembled(sheet: Sheet, folder: Path, where: str, own: Sequence[str] = ()) -> Assembled:
    """The recording of a description whose trials are in files of ``folder``, or among ``own`` (see `Files`)."""
    files = Files(folder, sheet.text.dialect(), where, own)
    return assemble(sheet, files, where, _subject(sheet, files, where, None, folder))


def assemble(sheet: Sheet, files: Files, where: str, subject: Subject) -> Assembled:
    """The recording of a description."""
    model = subject.model
    columns = Columns.of(model, sheet.stimulus)
    if not sheet.trials:
        raise RecordingError(f"{where}: trials: expected at least one")
    read, notes = trials_of(sheet, columns, files, subject.person, where)
    notes = (*notes, *([subject.remark] if subject.remark else []))
    with refused(RecordingError, where=where):
        recording = Recording(
            tuple(r.trial for r in read),
            read[0].rate_hz,
            sheet.period_s,
            sheet.stimulus,
            subject.person.body,
            sheet.convention,
            sheet.name,
            sentences(sheet.provenance, *notes),
            person=sheet.person,
            condition=sheet.condition,
            model=model,
            constants=subject.constants,
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


def _subject(sheet: Sheet, files: Files, where: str, given: ModelLike | None, folder: Path) -> Subject:
    """Who was recorded; ``given``: a model in place of the one that the description names.

    Of a declared model those constants are the person's that the description states, or that its body has.
    """
    stated = sheet.model if given is None else given
    at = folder if given is None else None
    with refused(RecordingError, where=where):
        model = model_of(stated, at)
        _require_outputs(sheet, Columns.of(model, sheet.stimulus))
        if model is None:
            if sheet.constants:
                raise RecordingError("constants: expected a model that has them (model, --model), got none")
            return Subject(body_of(sheet.body, files.source, where))
        if "upper_body" in sheet.model_fields_set:
            raise RecordingError(f"upper_body: expected none for outputs of the declared model {model.name}")
        person = body_of(sheet.body, files.source, where) if "body" in sheet.model_fields_set else Person(stated=False)
        constants = dict(sheet.constants)
        if "body" in sheet.model_fields_set:
            known = constants_of(stated, at)
            if not (of_body := {n: x for n, x in person.constants.items() if n in known}):
                raise RecordingError(
                    f"body: expected none for model {model.name}, which has none of the constants "
                    f"{', '.join(person.constants)}"
                )
            constants = {**of_body, **constants}
        return Subject(person, model_of(stated, at, constants), constants)


def _require_outputs(sheet: Sheet, columns: Columns) -> None:
    """Raise `RecordingError` for a key of a trial that is neither a setting nor an output."""
    for channels, name in ((sheet.channels, "channels"), *((t, f"trials.{k}") for k, t in enumerate(sheet.trials))):
        channels.require_outputs(columns.outputs, name)


def _frf(sheet: Sheet, files: Files, where: str, subject: Subject) -> FrfRecording:
    model = subject.model
    columns, labels = Columns.of(model, sheet.stimulus), labels_of(model)
    if sheet.trials or sheet.frf is None:
        raise RecordingError(f"{where}: frf: expected either trials or an frf, got both")
    file = files.source(sheet.frf.file)
    sheet.units.require_both(columns, where)
    picked = {name: file.pick(name) for name in columns_of(labels) if file.has(name)}
    if "f" not in picked:
        raise RecordingError(
            f"{file.path}: column 'f' (Hz) is missing; found {printable(', '.join(list(file.variables)[:SHOWN]))}"
        )
    angle, stimulus = _frf_units(sheet, picked, columns, str(file.path))
    scale = frf_factor(angle, stimulus, columns, where)
    f, y, C, single = frf_of_columns({n: p.values for n, p in picked.items()}, scale, str(file.path), labels)
    provenance = sentences(sheet.provenance, subject.remark, *files.remarks())
    with refused(RecordingError, where=file.path):
        return FrfRecording(
            f, y, C, sheet.stimulus, subject.person.body, single, sheet.name, provenance, model, subject.constants
        )


def _frf_units(sheet: Sheet, read: Mapping[str, Picked], columns: Columns, where: str) -> tuple[str | None, str | None]:
    """Units of angle and stimulus, declared or stated as deg/Nm in a header, which may not contradict each other."""
    angle, stimulus = sheet.units.angle, sheet.units.stimulus
    if sheet.units.stated == "ignored":
        return angle, stimulus
    for name, picked in read.items():
        kind, unit = kind_of(picked.unit), picked.unit or ""
        if name == "f" or name.startswith("phase"):
            expected = "Hz" if name == "f" else "deg"
            right = unit == "Hz" if name == "f" else kind == KINDS["rad"] and factor(unit, "rad", where) == DEGREE
            if kind is not None and not right:
                raise RecordingError(f"{where}: {name}: unit: expected {expected}, but the file states {unit}")
        elif not name.startswith("c"):
            over, _, under = unit.partition("/")
            angle = agreed(angle, over, columns.units[0], f"{where}: {name}", name)
            stimulus = agreed(stimulus, under, columns.stimulus_unit, f"{where}: {name}", name)
    return angle, stimulus
