"""Import of a laboratory's files: a description and options become a checked recording and a table of what was read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.assembly import Assembled, assemble, with_files
from mcstudy.recordings.channels import Read, Series
from mcstudy.recordings.checks import check, repeats_every
from mcstudy.recordings.columns import model_of
from mcstudy.recordings.formats import open_source
from mcstudy.recordings.formats.text_layout import Dialect
from mcstudy.recordings.recording import Recording
from mcstudy.recordings.refusals import refused, size_text
from mcstudy.recordings.sheets.recording_sheet import document
from mcstudy.text_tables import escaped, number, table


@dataclass(frozen=True)
class Imported:
    """A checked recording, and what was read of it.

    Attributes
    ----------
    recording
        For `mcstudy.write_recording`, `mcstudy.fit`, `mcstudy.diagnose`.
    read
        Every trial as it was read.
    notes
        What was done to the data, and what is odd about them, in words.
    """

    recording: Recording
    read: tuple[Read, ...]
    notes: tuple[str, ...]

    def text(self) -> str:
        """A table of every channel, the period, the body, and the notes."""
        r = self.recording
        header = ["trial", "channel", "variable", "unit", "Hz", "samples", "RMS", "peak", "missing"]
        rows = [
            [str(k), s.channel, _placed(read, s), s.unit, f"{s.rate_hz:g}", str(s.values.size), *_sizes(s)]
            for k, read in enumerate(self.read, start=1)
            for s in read.parts
        ]
        period = "none stated" if r.period_s is None else f"{r.period_s:g} s"
        cycles = "" if r.period_s is None else f", {', '.join(map(str, r.cycles))} whole cycles"
        facts = [
            f"period: {period}{cycles}; {r.duration_s:g} s in all at {r.rate_hz:g} Hz",
            f"body: m g h = {number(r.body.mgh)} N m/rad; J about the ankle = {number(r.body.J1 + r.body.C2)} kg m^2"
            if r.model is None
            else f"model: {r.model.name}",
        ]
        return "\n".join([table(header, rows), "", *facts, *self.notes])


def _placed(read: Read, series: Series) -> str:
    return f"{Path(read.file).name}: {series.variable}" if read.file else series.variable


def _sizes(series: Series) -> list[str]:
    """RMS about the mean and half the range, in the declared unit, and how many values were interpolated."""
    values = series.values / series.factor
    return [number(float(np.std(values))), number(float(np.ptp(values)) / 2), str(series.missing)]


def import_files(
    files: Sequence[str | Path], described: str | Path | None = None, options: Mapping[str, Any] | None = None
) -> Imported:
    """Read and check a recording.

    Parameters
    ----------
    files
        One per trial, or per group of trials (``split``); none when the description names them.
    described
        TOML file (`mcstudy.recordings.sheets.recording_sheet`), or None.
    options
        Fields of a description, which replace those of the file; tables are merged.

    Raises
    ------
    RecordingError
        One line that names file and field.
    """
    names = [str(f) for f in files]
    where = str(described) if described is not None else names[0] if names else "import"
    stated = document(Path(described)) if described is not None else {}
    sheet = with_files(merged(stated, options or {}), names, where)
    folder = Path(described).parent if described is not None else Path(".")
    with refused(RecordingError, where=where):
        model = model_of(sheet.model, folder)
    assembled: Assembled = assemble(sheet, folder, where, names, model)
    _require_units(assembled.read, where)
    recording = assembled.recording
    if not recording.name or recording.name == "recording":
        recording = replace(recording, name=Path(names[0] if names else where).stem)
    recording = replace(recording, suspicions=check(recording))
    return Imported(recording, assembled.read, (*assembled.notes, *_odd(recording)))


def merged(stated: Mapping[str, Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """Two descriptions as one; where both state a field, the second holds."""
    out = dict(stated)
    for key, value in options.items():
        both = isinstance(value, Mapping) and isinstance(out.get(key), Mapping)
        out[key] = merged(out[key], value) if both else value
    return out


def _require_units(read: Sequence[Read], where: str) -> None:
    """A unit is declared, or stated by the file; it is never taken for granted."""
    for series in (s for trial in read for s in trial.parts if s.assumed):
        key, option = ("stimulus", "--stimulus-unit") if series.channel == "stimulus" else ("angle", "--unit")
        raise RecordingError(f"{where}: units.{key}: expected the unit of {series.channel} ({option}), got none")


def _odd(recording: Recording) -> list[str]:
    remarks = [f"odd: {s.message}" for s in recording.suspicions]
    if recording.period_s is None:
        period = repeats_every(recording.trials[0].stimulus, recording.rate_hz)
        if period:
            remarks.append(
                f"the stimulus repeats every {period:g} s; to analyse its periods, state period_s (--period {period:g})"
            )
    return remarks


def listing(file: str | Path, dialect: Dialect | None = None) -> str:
    """A table of the variables in a file: name, number of a column, size, unit and rate."""
    source = open_source(Path(file), dialect or Dialect())
    rows = []
    for k, (name, variable) in enumerate(source.variables.items()):
        shape = size_text(variable.shape) + (f" {variable.content}" if variable.content else "")
        rate = "-" if variable.rate_hz is None else f"{variable.rate_hz:g}"
        unit = variable.unit or (f"{variable.angle_unit} (angles)" if variable.angle_unit else "-")
        rows.append([name, *([str(k)] if source.numbered else []), shape, unit, rate])
    head = "\n".join([f"{escaped(str(file))}: {source.kind}, {len(rows)} variables", *source.remarks])
    header = ["variable", *(["column"] if source.numbered else []), "size", "unit", "Hz"]
    parts = [head, table(header, rows) if rows else "", "\n".join(map(escaped, source.others.values()))]
    return "\n\n".join(filter(None, parts))
