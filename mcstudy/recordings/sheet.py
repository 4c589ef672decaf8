"""Recordings described by a small TOML file that states where the columns are and what they mean.

    name = "subject 1"
    person = "s01"             # for groups of people; may be left out, as condition
    condition = "eyes closed"
    rate_hz = 200              # or a time column
    period_s = 43.72           # leave out when the stimulus is not periodic
    stimulus = "ankle_torque"  # or hip_torque, platform_translation
    convention = "peak"        # or peak_to_peak: how the amplitudes are stated
    units = {angle = "deg", stimulus = "N m", time = "s"}
    body = {J1 = 51.26, J2 = 7.08, C1 = 11.93, C2 = 19.01, A1 = 50.42, A2 = 14.45}

    [[trials]]
    file = "trial1.csv"        # columns time, stimulus, theta1, theta2
    amplitude = 5.0

A trial may instead name a file and a column for each channel, and the body may be given by segments (or a file of
them); files are relative to the TOML file or to the folder given to `read_sheet`:

    [trials.theta1]
    file = "joints.txt"
    column = 1                 # a number from 0, or the header's name
    unit = "deg"
    scale = -1.0               # sign convention
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mcstudy.errors import ModelError, RecordingError
from mcstudy.files.plain_errors import one_line
from mcstudy.files.untrusted import toml
from mcstudy.recordings.checks import rate_of
from mcstudy.recordings.columns import TextTable, content
from mcstudy.recordings.frf import FrfRecording, frf_of_columns
from mcstudy.recordings.guards import inside
from mcstudy.recordings.recording import EXPECTED, Recording, Trial, refuse_size
from mcstudy.recordings.units import factor
from mcstudy.stance.body import SEGMENTS, STIMULI, Body

LARGEST_SHEET = 1_000_000
"""Bytes of a TOML file."""

OTHER_FILES = {
    "study": "study file (for mcstudy run)",
    "group": "study file (for mcstudy run)",
    "challenge": "challenge file (for mcstudy gap challenge)",
}
"""Other TOML files of this program, recognised by a section that only they have."""

LARGEST_SCALE = 1e9
"""Largest scale factor of a channel; the smallest is its reciprocal. Either sign is allowed."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Channel(_Strict):
    """One channel of a trial."""

    file: str | None = None
    column: int | str | None = None
    unit: str | None = None
    scale: float = Field(default=1.0, ge=-LARGEST_SCALE, le=LARGEST_SCALE)


class TrialSheet(_Strict):
    """One trial; channels that are not given are the columns of ``file`` with their own names."""

    file: str | None = None
    amplitude: float | None = Field(default=None, gt=0)
    time: Channel | None = None
    stimulus: Channel = Channel()
    theta1: Channel = Channel()
    theta2: Channel = Channel()


class Units(_Strict):
    """Units of the columns, unless a channel says otherwise."""

    time: str = "s"
    stimulus: str | None = None
    angle: str = "rad"


class BodySheet(_Strict):
    """The table's constants, or segments, or a file whose first row holds segments in the order of ``order``.

    ``reference = "goodworth2018"`` is the body of the paper.
    """

    J1: float | None = Field(default=None, gt=0)
    J2: float | None = Field(default=None, gt=0)
    C1: float | None = Field(default=None, gt=0)
    C2: float | None = Field(default=None, gt=0)
    A1: float | None = Field(default=None, gt=0)
    A2: float | None = Field(default=None, gt=0)
    g: float = Field(default=9.81, gt=0)
    m1: float | None = Field(default=None, gt=0)
    h1: float | None = Field(default=None, gt=0)
    I1: float | None = Field(default=None, gt=0)
    m2: float | None = Field(default=None, gt=0)
    h2: float | None = Field(default=None, gt=0)
    I2: float | None = Field(default=None, gt=0)
    L1: float | None = Field(default=None, gt=0)
    file: str | None = None
    order: tuple[str, ...] = ()
    reference: Literal["goodworth2018"] | None = None


class FrfSheet(_Strict):
    """A file of FRFs (columns of `mcstudy.recordings.frf.frf_of_columns`) in place of trials."""

    file: str


class Sheet(_Strict):
    """The whole TOML file."""

    name: str = "recording"
    provenance: str = ""
    person: str = ""
    condition: str = ""
    rate_hz: float | None = Field(default=None, gt=0)
    period_s: float | None = Field(default=None, gt=0)
    stimulus: str = "ankle_torque"
    convention: Literal["peak", "peak_to_peak"] = "peak"
    units: Units = Units()
    body: BodySheet = BodySheet()
    trials: tuple[TrialSheet, ...] = ()
    frf: FrfSheet | None = None


def read_sheet(path: str | Path, data: str | Path | None = None) -> Recording | FrfRecording:
    """The recording that a TOML file describes, with its data files in ``data`` (the TOML file's folder when None).

    Checks the structure only; `mcstudy.recordings.io` adds the checks of the data. Raises `RecordingError` naming the
    file and the field.
    """
    path = Path(path)
    try:
        text = toml(content(path, LARGEST_SHEET).decode("utf-8"))
    except ValueError as error:
        raise RecordingError(f"{path}: expected TOML: {error}") from error
    for section, kind in OTHER_FILES.items():
        if isinstance(text.get(section), dict):
            raise RecordingError(f"{path}: this is a {kind}; {EXPECTED}")
    try:
        sheet = Sheet.model_validate(text)
    except ValidationError as error:
        raise RecordingError(f"{path}: {one_line(error, Sheet)}") from error
    if sheet.stimulus not in STIMULI:
        raise RecordingError(f"{path}: stimulus: expected one of {', '.join(STIMULI)}, got {sheet.stimulus!r}")
    files = _Files(path.parent if data is None else Path(data), str(path))
    body = _body(sheet.body, files, str(path))
    if sheet.frf is not None:
        if sheet.trials:
            raise RecordingError(f"{path}: frf: expected either trials or an frf, got both")
        table = files.table(sheet.frf.file)
        columns = {n: table.column(n) for n in table.names}
        scale = factor(sheet.units.angle, "rad", f"{path}: units.angle")
        f, y, C, single = frf_of_columns(columns, scale, str(table.path))
        try:
            return FrfRecording(f, y, C, sheet.stimulus, body, single, sheet.name, sheet.provenance)
        except RecordingError as error:
            raise RecordingError(f"{table.path}: {error}") from error
    if not sheet.trials:
        raise RecordingError(f"{path}: trials: expected at least one")
    return _recording(sheet, files, body, path)


class _Files:
    """Data files of one sheet, each read once."""

    def __init__(self, folder: Path, where: str) -> None:
        self._folder, self._where = folder, where
        self._tables: dict[str, TextTable] = {}

    def table(self, name: str) -> TextTable:
        if name not in self._tables:
            self._tables[name] = TextTable(inside(self._folder, name, self._where))
        return self._tables[name]


def _recording(sheet: Sheet, files: _Files, body: Body, path: Path) -> Recording:
    stimulus_unit = sheet.units.stimulus or STIMULI[sheet.stimulus]
    refuse_size(len(sheet.trials), 0, str(path))
    trials, rates, total = [], [], 0
    for k, trial in enumerate(sheet.trials, start=1):
        where = f"{path}: trial {k}"

        def channel(
            name: str, given: Channel, unit: str, target: str, trial: TrialSheet = trial, where: str = where
        ) -> np.ndarray:
            file = given.file or trial.file
            if file is None:
                raise RecordingError(f"{where}: {name}: expected a file")
            values = files.table(file).column(name if given.column is None else given.column)
            scale = given.scale * factor(given.unit or unit, target, f"{where}: {name}")
            if abs(given.scale) < 1 / LARGEST_SCALE:
                raise RecordingError(
                    f"{where}: {name}.scale: expected a size from {1 / LARGEST_SCALE:g} to {LARGEST_SCALE:g}, "
                    f"got {given.scale:g}"
                )
            return values if scale == 1.0 else values * scale

        stimulus = channel("stimulus", trial.stimulus, stimulus_unit, STIMULI[sheet.stimulus])
        total += stimulus.size
        refuse_size(len(sheet.trials), total, str(path))
        angles = [channel(n, getattr(trial, n), sheet.units.angle, "rad") for n in ("theta1", "theta2")]
        for name, angle in zip(("theta1", "theta2"), angles, strict=True):
            if angle.size != stimulus.size:
                raise RecordingError(f"{where}: {name}: {angle.size} rows, but the stimulus has {stimulus.size}")
        if trial.time is not None or (trial.file and "time" in files.table(trial.file).names):
            time = channel("time", trial.time or Channel(), sheet.units.time, "s")
            if time.size != stimulus.size:
                raise RecordingError(f"{where}: time: {time.size} rows, but the stimulus has {stimulus.size}")
            rates.append(rate_of(time, sheet.rate_hz, where))
        elif sheet.rate_hz is None:
            raise RecordingError(f"{where}: rate_hz: expected a rate or a time column")
        trials.append(Trial(stimulus, np.column_stack(angles), trial.amplitude))
    rate = sheet.rate_hz or float(np.median(rates))
    for k, own in enumerate(rates, start=1):
        if abs(own / rate - 1) > 1e-3:
            raise RecordingError(f"{path}: trial {k}: time: {own:g} Hz, but the first trials have {rate:g} Hz")
    try:
        return Recording(
            tuple(trials),
            rate,
            sheet.period_s,
            sheet.stimulus,
            body,
            sheet.convention,
            sheet.name,
            sheet.provenance,
            person=sheet.person,
            condition=sheet.condition,
        )
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


def _body(sheet: BodySheet, files: _Files, where: str) -> Body:
    values = {n: getattr(sheet, n) for n in SEGMENTS if getattr(sheet, n) is not None}
    if sheet.file is not None:
        row = files.table(sheet.file).values[0]
        if len(sheet.order) != row.size or set(sheet.order) != set(SEGMENTS):
            raise RecordingError(
                f"{where}: body.order: expected the {len(SEGMENTS)} names {', '.join(SEGMENTS)} in the order of the "
                f"{row.size} columns of {sheet.file}"
            )
        values |= {n: float(v) for n, v in zip(sheet.order, row, strict=True)}
    constants = {n: getattr(sheet, n) for n in ("J1", "J2", "C1", "C2", "A1", "A2") if getattr(sheet, n) is not None}
    if values and constants:
        raise RecordingError(f"{where}: body: expected either segments or J1 ... A2, got both")
    for given, names in ((values, SEGMENTS), (constants, ("J1", "J2", "C1", "C2", "A1", "A2"))):
        missing = [n for n in names if n not in given]
        if given and missing:
            raise RecordingError(f"{where}: body: {', '.join(missing)} missing")
    try:
        if values:
            return Body.from_segments(**values, g=sheet.g)
        if constants:
            return Body(**constants, g=sheet.g)
    except ModelError as error:
        raise RecordingError(f"{where}: {error}") from error
    if sheet.reference is None:
        raise RecordingError(f'{where}: body: expected J1 ... A2, segments, or reference = "goodworth2018"')
    return Body()
