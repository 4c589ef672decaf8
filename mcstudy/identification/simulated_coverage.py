"""How often intervals of simulated recordings hold the truth, for the kind of recording that was fitted.

``interval_coverage.csv`` holds the answers of the coverage study
(``pipelines/validation/interval_coverage.py --table``):
percent of 95 % intervals that hold the true value, over all bodies, and of the body with the fewest and the most.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

from mcstudy.files.json_files import named
from mcstudy.identification.bounds import bounded
from mcstudy.recordings.joint_recording import AnyRecording
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Model

FILE = "interval_coverage.csv"

LEAST, MOST = 93.0, 97.0
"""Percent of 95 % intervals that should hold the truth."""

LEVEL = 0.95
"""Of the simulated intervals."""

TRIALS, DISCARD = 2, 1
"""Of the simulated recordings: trials, and cycles left out of each."""

RMS = 0.442
"""Of the simulated torque, a pseudorandom ternary sequence, over its peak."""


class Covered(NamedTuple):
    """Percent of simulated intervals of one quantity that hold the truth: all bodies, worst and best body."""

    percent: float
    lowest: float
    highest: float

    @property
    def remark(self) -> str:
        """Words "wider than needed", "too narrow", or none between `LEAST` and `MOST`."""
        return "wider than needed" if self.percent > MOST else "too narrow" if self.percent < LEAST else ""

    def to_dict(self) -> dict[str, float | str]:
        """Plain data for ``fit.json``."""
        return {**self._asdict(), "remark": self.remark}


@dataclass(frozen=True)
class Coverage:
    """Coverage in the simulated condition that is nearest to a recording.

    Attributes
    ----------
    cycles
        Stimulus periods in each of the two simulated trials.
    fmax
        Highest frequency of the simulated fits, Hz.
    amplitude
        Peak of the simulated torque, N m.
    realizations
        Simulated recordings in this condition.
    quantities
        Name to `Covered`.
    """

    cycles: int
    fmax: float
    amplitude: float
    realizations: int
    quantities: dict[str, Covered]

    def with_remark(self, remark: str) -> list[str]:
        """Names of the quantities with a remark."""
        return [name for name, covered in self.quantities.items() if covered.remark == remark]

    def to_dict(self) -> dict[str, Any]:
        """The condition as plain data for ``fit.json``."""
        return named(self, "cycles", "fmax", "amplitude", "realizations")

    @property
    def condition(self) -> str:
        """The simulated recordings in words."""
        return f"two trials of {self.cycles} cycles at {self.amplitude:g} N m (peak), up to {self.fmax:g} Hz"


@cache
def simulated() -> tuple[Coverage, ...]:
    """All simulated conditions."""
    conditions: dict[tuple[int, float, float, int], dict[str, Covered]] = {}
    text = files("mcstudy.identification").joinpath(FILE).read_text(encoding="utf-8")
    for row in csv.DictReader(text.splitlines()):
        key = int(row["cycles"]), float(row["fmax"]), float(row["amplitude"]), int(row["realizations"])
        covered = Covered(*(float(row[c]) for c in Covered._fields))
        conditions.setdefault(key, {})[row["quantity"]] = covered
    return tuple(Coverage(*key, quantities) for key, quantities in conditions.items())


def nearest(recording: AnyRecording | None, lines: Lines, model: Model, level: float) -> Coverage | None:
    """The condition that is nearest to a fit in cycles, highest frequency and RMS of the torque, on logarithmic scales.

    None where the study says nothing: another stimulus, level, model or bounds, several recordings with stimuli of
    their own, or published responses.
    """
    alike = (
        isinstance(recording, Recording)
        and recording.stimulus == "ankle_torque"
        and recording.period_s is not None
        and level == LEVEL
        and model.names == two_segment().names
        and bounded(model, model, {}) == model
    )
    if not alike:
        return None
    repeats, rms = len(lines.repeats), math.sqrt(2 * float(lines.power.sum()))

    def distance(c: Coverage) -> float:
        longer = math.log(TRIALS * (c.cycles - DISCARD) / repeats)
        larger = math.log(RMS * c.amplitude / rms)
        return math.hypot(longer, larger, math.log(c.fmax / float(lines.f.max())))

    return min(simulated(), key=distance)
