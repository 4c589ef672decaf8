"""What the columns of a recording are: the two angles of a standing body, or the outputs of a declared model, by name.

A recording of a standing body holds `ANGLES` in rad, and a stimulus of one of the kinds in `STIMULI`. A recording of a
declared model holds what the model calls its outputs, in their units, and a stimulus in its unit.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, Self, TypeVar

import numpy as np

from mcstudy.errors import DesignError, RecordingError
from mcstudy.recordings.refusals import refused
from mcstudy.recordings.units import factor
from mcstudy.stance.body import STIMULI, standing
from mcstudy.stance.feedback import ANGLES, Model

ModelLike = Model | str | Path
"""A model, its name, or the path of its file."""


@dataclass(frozen=True)
class Columns:
    """The columns of a recording.

    Attributes
    ----------
    outputs
        Names of what was measured, Y of them.
    units
        Their units.
    stimulus_unit
        Unit of the stimulus.
    """

    outputs: tuple[str, ...]
    units: tuple[str, ...]
    stimulus_unit: str

    @classmethod
    def of(cls, model: Model | None, kind: str = "") -> Columns:
        """Those of a declared model, or of a standing body under a ``kind`` of stimulus."""
        if model is None:
            return cls(ANGLES, ("rad",) * len(ANGLES), STIMULI[kind])
        return cls(model.output_names, model.output_units, model.stimulus_unit)

    @property
    def names(self) -> str:
        """The outputs in one text."""
        return ", ".join(self.outputs)

    @property
    def unit(self) -> str:
        """The unit of all outputs; all units where they differ."""
        return ", ".join(dict.fromkeys(self.units))

    def places(self, named: Sequence[str], where: str, model: Model) -> list[int]:
        """Where the outputs are among the columns ``named``; `RecordingError` where one is missing."""
        for name in self.outputs:
            if name not in named:
                raise RecordingError(
                    f"{where}: {name}: expected the outputs of model {model.name} ({self.names}), "
                    f"got {', '.join(named)}"
                )
        return [named.index(name) for name in self.outputs]


def model_of(
    given: ModelLike | None, folder: Path | None = None, constants: Mapping[str, float] | None = None
) -> Model | None:
    """The declared model that is given as such, by its name or its file; None for that of a standing body.

    ``constants``: numbers of the person in place of those of the model's file, see `ModelTable.with_constants`; a
    `Model` has its own. Raises `RecordingError`, one line, for an unknown name or a wrong file.
    """
    if isinstance(given, Model):
        return None if standing(given) else given
    if given is None or given == "two_segment":
        return None
    from mcstudy.models.catalogue import BUILT, read_model

    if str(given) in BUILT:
        raise RecordingError(
            f"model: expected a declared model or two_segment, got {given!s}, which a recording of two angles excludes"
        )
    with refused(DesignError, where="model"):
        return read_model(given, folder).with_constants(constants or {}).model()


def constants_of(given: ModelLike | None, folder: Path | None = None) -> Collection[str]:
    """Names of the constants that a model takes of a person: those of its file; none for a `Model`."""
    from mcstudy.models.catalogue import read_model

    return () if given is None or isinstance(given, Model) else read_model(given, folder).constants


class Measured(Protocol):
    """A recording of any kind."""

    @property
    def name(self) -> str:
        """Text for people."""

    @property
    def model(self) -> Model | None:
        """The declared model whose outputs it holds."""

    @property
    def constants(self) -> Mapping[str, float]:
        """Numbers of the person that a declared model takes."""

    @property
    def columns(self) -> Columns:
        """What it holds."""

    def with_columns(self, model: Model, at: Sequence[int], factor: np.ndarray, drive: float) -> Self:
        """The same as one of another model."""


R = TypeVar("R", bound=Measured)


def of_model(recording: R, given: ModelLike | None) -> R:
    """The recording as one of a declared model: its columns are found by name and converted to the model's units.

    A model that is given by its name or its file has the constants of the person recorded. Raises `RecordingError`
    where an output is missing.
    """
    model = model_of(given, constants=recording.constants)
    if model is None or recording.model == model:
        return recording
    known, wanted = recording.columns, Columns.of(model)
    at = wanted.places(known.outputs, recording.name, model)
    outputs = zip(at, wanted.units, wanted.outputs, strict=True)
    per = np.array([factor(known.units[k], unit, f"{recording.name}: {name}") for k, unit, name in outputs])
    drive = factor(known.stimulus_unit, wanted.stimulus_unit, f"{recording.name}: stimulus")
    return recording.with_columns(model, at, per, drive)
