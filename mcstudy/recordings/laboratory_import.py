"""Import of a laboratory's files: a description and options become a checked recording and a table of what was read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.assembly import Assembled, assembled, with_files
from mcstudy.recordings.channels import Read, Series
from mcstudy.recordings.checks import change, check, repeats_every
from mcstudy.recordings.faults import constant_end
from mcstudy.recordings.formats import open_source
from mcstudy.recordings.formats.text_layout import Dialect
from mcstudy.recordings.recording import MINIMUM_CYCLES, PERIOD_S, Recording
from mcstudy.recordings.refusals import size_text
from mcstudy.recordings.sheets.recording_sheet import document
from mcstudy.recordings.stimulus_family import family
from mcstudy.recordings.units import as_shown
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
    found: Assembled = assembled(sheet, folder, where, names)
    _require_units(found.read, where)
    recording = found.recording
    if not recording.name or recording.name == "recording":
        recording = replace(recording, name=Path(names[0] if names else where).stem)
    recording, remarks = with_period(recording)
    recording = replace(recording, suspicions=check(recording))
    odd = [f"odd: {s.message}" for s in recording.suspicions]
    return Imported(recording, found.read, (*found.notes, *remarks, *_stimulus(recording), *odd))


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


SURELY = 0.025
"""Largest RMS difference of periods, relative to the RMS of the stimulus, of one that is found; noise of a platform."""

FIRST_STATE = 0.1
"""Largest part of the first cycle that may be at rest, and is not cut off with what is before it."""


def with_period(recording: Recording) -> tuple[Recording, list[str]]:
    """The recording with the period of its stimulus, where that was not stated but repeats; and that in words.

    A stimulus that is at rest for long before its first cycle, or after its last, is cut there.
    """
    if recording.period_s is not None:
        return recording, []
    rate, spans = recording.rate_hz, [_moving(t.stimulus, recording.rate_hz) for t in recording.trials]
    begin, stop = spans[0]
    u = recording.trials[0].stimulus[begin:stop]
    period = repeats_every(u, rate)
    if period is None or change(u - u.mean(), round(period * rate)) > SURELY:
        return recording, []
    if period < PERIOD_S.low:
        raise RecordingError(
            f"{recording.name}: stimulus: repeats every {period:.3g} s at {rate:g} Hz; is the unit of time right "
            "(units.time)?"
        )
    trials, remarks = [], []
    for k, (trial, (begin, stop)) in enumerate(zip(recording.trials, spans, strict=True), start=1):
        missing = (begin - stop) % round(period * rate)
        first = begin - missing if missing <= min(begin, FIRST_STATE * period * rate) else begin
        trials.append(replace(trial, stimulus=trial.stimulus[first:stop], theta=trial.theta[first:stop]))
        if stop - first < trial.samples:
            span = f"{first / rate:g} to {stop / rate:g} s"
            remarks.append(f"trial {k}: only {span} is used, because the stimulus is at rest before and after")
    periodic = replace(recording, trials=tuple(trials), period_s=period)
    if min(periodic.cycles) < MINIMUM_CYCLES:
        return recording, [
            f"the stimulus repeats every {period:g} s; with {MINIMUM_CYCLES} cycles it would be periodic"
        ]
    return periodic, [*remarks, f"period of {period:g} s found in the stimulus; for another, state it (--period)"]


def _moving(u: np.ndarray, rate_hz: float) -> tuple[int, int]:
    """From where to where a stimulus (n,) is not at rest for longer than ever between."""
    before, after = constant_end(u[::-1], rate_hz), constant_end(u, rate_hz)
    begin = 0 if before is None else before.stop - before.start - 1
    stop = u.size if after is None else after.start + 1
    return (begin, stop) if begin < stop else (0, u.size)


def _stimulus(recording: Recording) -> list[str]:
    """What the stimulus of the first trial is, and when its cycles begin."""
    period, trial = recording.period, recording.trials[0]
    if period is None:
        return []
    cycles = trial.stimulus[: recording.cycles[0] * period].reshape(-1, period)[1:]
    words = family(cycles.mean(axis=0), recording.rate_hz)
    size, unit = as_shown(recording.stimulus_unit)
    peaks = f"{size * np.ptp(cycles.mean(axis=0)):.3g} {unit} from peak to peak"
    return [f"stimulus: {words}; {peaks}"]


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
