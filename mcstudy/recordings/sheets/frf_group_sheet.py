"""Description of FRFs of a group of people: a small TOML file that says what the columns of a table mean.

    name = "tilting platform"
    stimulus = "surface_tilt"      # or ankle_torque, hip_torque, platform_translation, visual_tilt
    upper_body = "space"           # what "upper" is: the upper body's angle in space, or "hip", the hip angle
    units = {angle = "deg", stimulus = "deg"}
    body = {height = 1.75, weight = 72}

    [frf_group]
    file = "frf.csv"               # one row per person, condition and segment
    person = "person"              # column with the person's name
    conditions = ["eyes", "tilt"]  # columns that together are the condition; [] for one condition
    segment = "segment"            # column with the words lower and upper
    gain = "gain_*Hz"              # columns of the points, lowest frequency first; * stands for any text
    phase = "phase_*Hz"            # in deg; or real = "..." and imaginary = "..." in place of both
    period_s = 20.0                # of the stimulus
    harmonics = "odd"              # number n below is the n-th odd harmonic, (2 n - 1) / period; "all": n / period
    points = [[1], [2], [3, 4]]    # the harmonics that every point averages; points may overlap
    prts_state_s = 0.25            # stimulus power of an integrated pseudorandom ternary sequence with this state;
    # power = [[1.0], [0.2], [0.1, 0.05]]   or the power itself, in the form of points

The FRF of a point is the sum of the cross spectra over the sum of the stimulus spectra of its harmonics. The FRF of a
model at a point is therefore the mean of its FRF at the harmonics, weighted with the power of the stimulus.
Where * stands for a number, it must be the mean frequency of the point in Hz.
Ways to state the body: `mcstudy.recordings.sheets.body_sheet`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from mcstudy.errors import RecordingError
from mcstudy.recordings.sheets.body_sheet import BodySheet
from mcstudy.recordings.sheets.recording_sheet import Units, toml_file
from mcstudy.recordings.sheets.tables import Description, Table, described

LARGEST_HARMONIC = 100_000
"""Highest number of a harmonic in a description."""

SECTION = "frf_group"
"""The section that makes a TOML file a description of a group."""

PATTERNS = ("gain", "phase", "real", "imaginary")
"""Fields that name columns by a pattern."""


class TableSheet(Table):
    """The section ``frf_group``: the table, its columns and its points."""

    file: str
    person: str = "person"
    conditions: tuple[str, ...] = ()
    segment: str = "segment"
    gain: str | None = None
    phase: str | None = None
    real: str | None = None
    imaginary: str | None = None
    period_s: float = Field(gt=0)
    harmonics: Literal["odd", "all"] = "odd"
    points: tuple[tuple[int, ...], ...]
    prts_state_s: float | None = Field(default=None, gt=0)
    power: tuple[tuple[float, ...], ...] | None = None

    @model_validator(mode="after")
    def _complete(self) -> TableSheet:
        given = tuple(name for name in PATTERNS if getattr(self, name) is not None)
        if given not in (PATTERNS[:2], PATTERNS[2:]):
            raise ValueError(f"expected gain and phase, or real and imaginary, got {' and '.join(given) or 'none'}")
        for name in given:
            if getattr(self, name).count("*") != 1:
                raise ValueError(f"expected {name} with one *, which stands for the point")
        if not self.points or any(not p or list(p) != sorted(set(p)) or p[0] < 1 for p in self.points):
            raise ValueError("expected points of ascending numbers of harmonics from 1 up, at least one in each")
        if max(p[-1] for p in self.points) > LARGEST_HARMONIC:
            raise ValueError(f"expected points of harmonics up to {LARGEST_HARMONIC}")
        if (np.diff([np.mean(p) for p in self.points]) <= 0).any():
            raise ValueError("expected points in ascending order of their mean frequency")
        if self.power is None:
            if self.prts_state_s is None and any(len(p) > 1 for p in self.points):
                raise ValueError("expected prts_state_s or power, because a point averages several harmonics")
        elif self.prts_state_s is not None:
            raise ValueError("expected either prts_state_s or power, got both")
        elif [len(p) for p in self.power] != [len(p) for p in self.points] or min(map(min, self.power)) <= 0:
            raise ValueError("expected power in the form of points, positive")
        return self

    def lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies (L,) of all harmonics of the points, Hz, and the mean that each point is of them, (N, L)."""
        numbers = sorted({k for p in self.points for k in p})
        f = (
            2.0 * np.array(numbers) - 1.0 if self.harmonics == "odd" else np.array(numbers, dtype=float)
        ) / self.period_s
        average = np.zeros((len(self.points), len(numbers)))
        for row, point in enumerate(self.points):
            at = [numbers.index(k) for k in point]
            average[row, at] = self.power[row] if self.power is not None else self._prts_power(f[at])
        return f, average / average.sum(axis=1, keepdims=True)

    def _prts_power(self, f: np.ndarray) -> np.ndarray:
        """Power of an integrated PRTS at its odd harmonics: all lines of the sequence are equal (derived)."""
        return np.asarray((np.sinc(f * (self.prts_state_s or 0.0)) / f) ** 2)


class GroupSheet(Description):
    """The whole TOML file."""

    name: str = "group"
    provenance: str = ""
    stimulus: str
    upper_body: Literal["hip", "space"]
    units: Units = Units()
    body: BodySheet = BodySheet()
    frf_group: TableSheet


def read_group_sheet(path: Path) -> GroupSheet:
    """The description in a TOML file; raises `RecordingError`, one line that names the file and the field."""
    text = toml_file(path)
    if SECTION not in text:
        raise RecordingError(f"{path}: {SECTION}: missing; expected the description of a group of FRFs")
    return described(GroupSheet, text, str(path))


def is_group(path: Path) -> bool:
    """Whether a file is a description of a group of FRFs; False for one that cannot be read."""
    if path.suffix != ".toml" or not path.is_file():
        return False
    try:
        return SECTION in toml_file(path)
    except RecordingError:
        return False
