"""Descriptions of recordings: a small TOML file that states which variable is which and what it means.

    name = "subject 1"
    person = "s01"             # for groups of people; may be left out, as condition
    condition = "eyes closed"
    rate_hz = 200              # or a time column, or the rate that a C3D file states
    period_s = 43.72           # leave out when the stimulus is not periodic
    stimulus = "ankle_torque"  # or hip_torque, platform_translation, surface_tilt, visual_tilt
    convention = "peak"        # or peak_to_peak: how the amplitudes are stated
    upper_body = "hip"         # what theta2 is in the files: the hip angle, or "space", the upper body's angle in space
    units = {angle = "deg", stimulus = "N m", time = "s"}  # what the file states must agree; stated = "ignored"
    body = {height = 1.80, weight = 75}

    [[trials]]
    file = "trial1.csv"        # columns time, stimulus, theta1, theta2
    amplitude = 5.0

A file is text with columns (any other ending), MATLAB (``.mat``) or C3D (``.c3d``). Where variables have other names,
``[channels]`` states them for all trials, and a trial may have its own. Files are relative to the TOML file or to the
folder given to `read_sheet`:

    [channels]
    stimulus = "data.torque"                 # struct field; a header's name; the position of a column, from 0
    theta1 = {column = "data.angles[:,0]", unit = "deg", scale = -1.0}  # scale turns the sign
    theta2 = {file = "joints.txt", column = 1, rate_hz = 100}           # another file, another rate

    [text]                     # text files only; what is left out is found
    delimiter = ";"
    decimal = ","
    skip = 3                   # lines above the header

    [split]                    # several trials in one file
    by = "columns"             # of matrices; or rows; or elements (of struct arrays and cells)
    starts = [10.0, 240.0]     # or s at which trials start; or a variable with these times: {column = "EVENT.start"};
    length_s = 218.6           # or one that rises above a level: {column = "trigger", above = 2.5}

    [markers]                  # angles from markers in place of theta1 and theta2
    ankle = ["LANK", "RANK"]
    hip = ["LGT", "RGT"]
    shoulder = ["LSHO", "RSHO"]
    forward = "+x"
    up = "+z"

    resample_hz = 100          # of all channels; without it, the lowest of their rates (top level)
    fill_gaps_s = 0.1          # longest gap that is interpolated; without it, gaps are refused (top level)

A recording of a declared model (`mcstudy.models`) names it instead of stimulus and body; its columns are the model's
outputs under their names, in the model's units unless ``units`` or a channel says otherwise:

    model = "elbow.toml"       # or the name of a model
    units = {angle = "deg"}    # of all outputs
    constants = {inertia = 0.07}  # of this person, in place of those of the model; J, mgh, m and h follow from a body

The one angle of a standing body (``model = "sensorimotor_integration"``) may be a displacement of the centre of mass or
of pressure, or come from markers or sway rods at hip and shoulder (`mcstudy.recordings.markers`):

    sway = {column = "COM", unit = "cm", of = "com"}    # height of the centre of mass from the body; or height = 0.93
    markers = {hip = ["hip"], shoulder = ["shld"], columns = "{marker}_{axis}pos", forward = "+z", up = "+y"}

Ways to state the body: `mcstudy.recordings.sheets.body_sheet`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from mcstudy.errors import RecordingError
from mcstudy.files.untrusted import toml
from mcstudy.recordings.columns import Columns
from mcstudy.recordings.formats.text_layout import Dialect
from mcstudy.recordings.guards import content
from mcstudy.recordings.markers import MarkerSheet
from mcstudy.recordings.recording import EXPECTED
from mcstudy.recordings.sheets.body_sheet import BodySheet
from mcstudy.recordings.sheets.tables import Description, Table
from mcstudy.recordings.units import factor
from mcstudy.stance.feedback import ANGLES

LARGEST_SHEET = 1_000_000
"""Bytes of a TOML file."""

OTHER_FILES = {
    "study": "study file (for mcstudy run)",
    "group": "study file (for mcstudy run)",
    "challenge": "challenge file (for mcstudy gap challenge)",
    "frf_group": "description of the FRFs of a group (for mcstudy gap compare)",
}
"""Other TOML files of this program, recognised by a section that only they have."""

LARGEST_SCALE = 1e9
"""Largest scale factor of a channel; the smallest is its reciprocal. Either sign is allowed."""

ONE_ANGLE = '; outputs of a model, such as one sway angle, need its name (model = "sensorimotor_integration", --model)'
"""The way on for somebody who names another channel than the two angles."""

DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t", "blank": " "}
"""Words for delimiters."""


class Channel(Table):
    """One channel of a trial; text or a number alone is its column.

    An angle may be given as a displacement: at a ``height`` in m above its axis, or ``of`` the centre of mass (com) or
    of pressure (cop) of the body.
    """

    file: str | None = None
    column: int | str | None = None
    unit: str | None = None
    scale: float = Field(default=1.0, ge=-LARGEST_SCALE, le=LARGEST_SCALE)
    rate_hz: float | None = Field(default=None, gt=0)
    height: float | None = None
    of: Literal["com", "cop"] | None = None

    @property
    def displacement(self) -> bool:
        """Whether it is a displacement of which an angle is made."""
        return self.height is not None or self.of is not None

    @model_validator(mode="before")
    @classmethod
    def _column_alone(cls, given: Any) -> Any:
        return {"column": given} if isinstance(given, str | int) and not isinstance(given, bool) else given


class Channels(Table):
    """The channels of a trial; those that are not given are the variables of its file with their own names.

    Outputs are channels under their names.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Channel] = Field(init=False)

    time: Channel | None = None
    stimulus: Channel = Channel()

    def channel(self, name: str) -> Channel | None:
        """What is stated of an output or the stimulus, None for nothing."""
        if name in type(self).model_fields:
            return getattr(self, name) if name in self.model_fields_set else None
        return self.__pydantic_extra__.get(name)

    def require_outputs(self, outputs: Sequence[str], where: str) -> None:
        """Raise `RecordingError` for a key that is no output."""
        for name in self.__pydantic_extra__:
            if name not in outputs:
                known = ", ".join((*reversed(type(self).model_fields), *outputs))
                one = "" if name in ANGLES or ANGLES[0] not in outputs else ONE_ANGLE
                raise RecordingError(f"{where}.{name}: unknown key, expected one of {known}{one}")


class TrialSheet(Channels):
    """One file, which holds a trial or, with ``split``, several; its channels come before those of `Channels`."""

    amplitude: float | None = Field(default=None, gt=0)
    file: str | None = None


class Units(Table):
    """Units of the columns, unless a channel says otherwise; what the file states must agree, unless it is ignored."""

    time: str = "s"
    stimulus: str | None = None
    angle: str | None = None
    stated: Literal["checked", "ignored"] = "checked"

    def require_both(self, columns: Columns, where: str) -> None:
        """Raise `RecordingError` where an FRF of angles to an angle states only one of its two units."""
        if columns.stimulus_unit == columns.unit and (self.angle is None) != (self.stimulus is None):
            per = f"{columns.unit} per {columns.stimulus_unit}"
            raise RecordingError(f"{where}: units: expected both angle and stimulus for responses in {per}")


def frf_factor(angle: str | None, unit: str | None, columns: Columns, where: str) -> np.ndarray:
    """Factors (Y,) that convert FRFs in ``angle`` per ``unit`` of the stimulus to the units of the columns."""
    target = columns.stimulus_unit
    per = factor(unit or target, target, f"{where}: units.stimulus")
    return np.array([factor(angle or declared, declared, f"{where}: units.angle") for declared in columns.units]) / per


class TextSheet(Table):
    """How text files are written."""

    delimiter: str | None = None
    decimal: Literal[".", ","] | None = None
    skip: int | None = Field(default=None, ge=0, le=10_000)

    def dialect(self) -> Dialect:
        """The same for the reader."""
        given = None if self.delimiter is None else DELIMITERS.get(self.delimiter, self.delimiter)
        return Dialect(given, self.decimal, self.skip)

    @model_validator(mode="after")
    def _one_sign(self) -> TextSheet:
        given = self.dialect().delimiter
        if given is not None and len(given) != 1:
            raise ValueError(f"expected delimiter of one character or {', '.join(DELIMITERS)}")
        if given is not None and given == self.decimal:
            raise ValueError("expected delimiter and decimal to differ")
        return self


class Starts(Table):
    """A variable that holds the times at which trials start, or that rises above a level when they do."""

    column: int | str
    unit: str = "s"
    above: float | None = None


class Split(Table):
    """How one file holds several trials."""

    by: Literal["columns", "rows", "elements"] | None = None
    starts: tuple[float, ...] | Starts | None = None
    length_s: float | None = Field(default=None, gt=0)


class FrfSheet(Table):
    """A file of FRFs (columns of `mcstudy.recordings.frf.frf_of_columns`) in place of trials."""

    file: str


class Sheet(Description):
    """The whole TOML file."""

    name: str = "recording"
    provenance: str = ""
    person: str = ""
    condition: str = ""
    rate_hz: float | None = Field(default=None, gt=0)
    period_s: float | None = Field(default=None, gt=0)
    stimulus: str = "ankle_torque"
    model: str | None = None
    constants: dict[str, Annotated[float, Field(gt=0)]] = Field(default={})
    convention: Literal["peak", "peak_to_peak"] = "peak"
    upper_body: Literal["hip", "space"] = "hip"
    resample_hz: float | None = Field(default=None, gt=0)
    fill_gaps_s: float = Field(default=0.0, ge=0, le=10.0)
    units: Units = Units()
    body: BodySheet = BodySheet()
    text: TextSheet = TextSheet()
    channels: Channels = Channels()
    split: Split = Split()
    markers: MarkerSheet | None = None
    trials: tuple[TrialSheet, ...] = ()
    frf: FrfSheet | None = None


def toml_file(path: Path) -> dict[str, Any]:
    """The content of a small TOML file; raises `RecordingError` naming the file."""
    try:
        return toml(content(path, LARGEST_SHEET).decode("utf-8"))
    except ValueError as error:
        raise RecordingError(f"{path}: expected TOML: {error}") from error


def document(path: Path) -> dict[str, Any]:
    """The content of a TOML file that describes recordings; raises `RecordingError` naming the file."""
    text = toml_file(path)
    for section, kind in OTHER_FILES.items():
        if isinstance(text.get(section), dict):
            raise RecordingError(f"{path}: this is a {kind}; {EXPECTED}")
    return text
