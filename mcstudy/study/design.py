"""What a study is: every choice that changes a number, as validated sections.

A study file has one section of each kind, and groups that may override any of them (`mcstudy.study.study_file` reads
it). What is left after merging is a `Study`: groups with nothing left to default.
"""

from __future__ import annotations

import hashlib
import html
import json
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
"""A name that is also a safe folder name."""

Positive = Annotated[float, Field(gt=0)]


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    """Coordinates are stored in ascending order, so that the order of a list in the file means nothing."""
    if len(set(values)) != len(values):
        raise ValueError("every value listed once")
    return tuple(sorted(values))


Axis = Annotated[tuple[Positive, ...], Field(min_length=1, max_length=1000), AfterValidator(_ascending)]
"""A coordinate axis: positive, distinct, kept ascending."""


class Section(BaseModel):
    """A table of a study file: unknown keys, coerced types, NaN and infinity are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class StudySection(Section):
    """Name and seed; the prose is for people and does not enter the fingerprint."""

    name: Name
    seed: int = Field(ge=0, lt=2**63)
    description: str = ""
    regenerates: tuple[str, ...] = ()


class BoundsSection(Section):
    """Bounds: gains as multiples of the true value, delays as the true value +- a margin, or absolute per parameter.

    Defaults: Goodworth & Peterka 2018, Methods.
    """

    lower: float = 0.0
    upper: float = 2.0
    delay_margin_s: Positive = 0.030
    absolute: dict[str, tuple[float, float]] = {}


class ModelSection(Section):
    """Which model, its true values (in the units of `mcstudy.stance.body`), its body and its bounds."""

    kind: Literal["two_segment", "one_segment"] = "two_segment"
    truth: dict[str, float] = {}
    body: dict[str, float] = {}
    bounds: BoundsSection = BoundsSection()


class StimulusSection(Section):
    """Pseudorandom ternary stimulus: 3**stages - 1 states of state_s seconds; ``cycles`` periods, some dropped."""

    kind: Literal["ankle_torque", "hip_torque", "platform_translation"] = "ankle_torque"
    stages: int = Field(default=7, ge=2, le=9)
    state_s: Positive = 0.020
    rate_hz: Positive = 200.0
    cycles: int = Field(default=6, ge=1, le=100_000)
    discard: int = Field(default=1, ge=0)
    convention: Literal["peak", "peak_to_peak"] = "peak"


class NoiseSection(Section):
    """Sensor noise of the two angles: one-sided PSD at 0.5 Hz in deg^2/Hz, low-pass corner in Hz."""

    psd: tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(ge=0)]] = (4e-4, 7e-5)
    corner_hz: Positive = 0.15


class SpectraSection(Section):
    """Which frequency points, whether the ramp of each record is removed before the DFT, and points left out.

    ``width``: fraction of a point's lines that are averaged into it (`mcstudy.spectra.bands.narrower`).
    ``covariance``: noise covariance from the even lines alone, or from the even lines through a first fit of the loop
    (`mcstudy.spectra.loop_covariance`; simulator "spectral" only).
    """

    points: Literal["published", "averaged", "odd_lines"] = "published"
    width: float = Field(default=1.0, gt=0, le=1)
    ramp: Literal["keep", "remove"] = "keep"
    covariance: Literal["even_lines", "through_loop"] = "even_lines"
    exclude_hz: tuple[Positive, ...] = ()


class FitSection(Section):
    """Cost, solver, kind of starts and stop rules."""

    cost: Literal["paper", "ml"] = "paper"
    solver: Literal["lm", "trf", "trust-constr"] = "lm"
    starts: Literal["uniform", "latin_hypercube", "sobol", "linearised"] = "uniform"
    tolerance: float = Field(default=1e-12, gt=0, lt=1)
    max_iterations: int = Field(default=1000, ge=1, le=1_000_000)


class Group(Section):
    """One group of the cube: its axes, and the sections that hold for it.

    ``fmax`` in Hz, ``amplitude`` in units of the stimulus, ``starts`` per fit problem. With simulator "none" a
    realization is a pool: the data are the same, the starts are not.
    """

    realizations: int = Field(ge=1, le=10_000_000)
    starts: int = Field(ge=1, le=1_000_000)
    fmax: Axis
    amplitude: Axis
    simulator: Literal["none", "spectral", "time_domain"] = "spectral"
    model: ModelSection = ModelSection()
    stimulus: StimulusSection = StimulusSection()
    noise: NoiseSection = NoiseSection()
    spectra: SpectraSection = SpectraSection()
    fit: FitSection = FitSection()

    @property
    def fits(self) -> int:
        """Number of fits of the group."""
        return len(self.amplitude) * len(self.fmax) * self.realizations * self.starts


SECTIONS = ("model", "stimulus", "noise", "spectra", "fit")
"""Sections that a group may override."""


class Study(Section):
    """A fully resolved study: nothing is left to a default."""

    study: StudySection
    group: dict[Name, Group] = Field(min_length=1, max_length=200)

    @property
    def fits(self) -> int:
        """Number of fits of all groups."""
        return sum(group.fits for group in self.group.values())

    def _repr_html_(self) -> str:
        """What a notebook shows: the groups and what they cost in fits."""
        rows = "".join(
            f"<tr><th scope='row'>{html.escape(name)}</th><td>{g.realizations}</td><td>{g.starts}</td>"
            f"<td>{', '.join(f'{f:g}' for f in g.fmax)}</td><td>{', '.join(f'{a:g}' for a in g.amplitude)}</td>"
            f"<td>{html.escape(g.model.kind)}</td><td>{g.fit.cost}, {g.fit.solver}</td><td>{g.fits}</td></tr>"
            for name, g in self.group.items()
        )
        columns = ("group", "realizations", "starts", "Fmax (Hz)", "amplitude", "model", "fit", "fits")
        head = "".join(f"<th scope='col'>{c}</th>" for c in columns)
        return (
            f"<h3>Study {html.escape(self.study.name)}</h3><p>{html.escape(self.study.description)}</p>"
            f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
            f"<p>{self.fits} fits, seed {self.study.seed}, fingerprint {self.fingerprint[:12]}</p>"
        )

    def numbers(self) -> dict[str, Any]:
        """Everything that changes a number of the cube, as plain JSON values (the prose left out)."""
        return self.model_dump(mode="json", exclude={"study": {"description", "regenerates"}})

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the canonical JSON of `numbers`."""
        canonical = json.dumps(self.numbers(), sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(canonical.encode()).hexdigest()

    def to_json(self) -> str:
        """Lossless text for a task; `from_json` reads it."""
        return self.model_dump_json()

    @classmethod
    def from_json(cls, text: str) -> Study:
        """Inverse of `to_json`."""
        return cls.model_validate_json(text)
