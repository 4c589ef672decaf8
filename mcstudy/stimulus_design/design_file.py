"""Reading design files: what a stimulus is designed for, under which limits, and how the design is verified.

A design file is TOML: ``[design]``, and optionally ``[limits]``, ``[prior]``, ``[verify]`` and the sections
``[model]``, ``[stimulus]`` and ``[noise]`` of a study file. Every mistake gives one line: ``file: field: what was
expected``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from mcstudy.errors import DesignError, InputError
from mcstudy.files.plain_errors import validated
from mcstudy.files.sections import Name, Positive, Section
from mcstudy.stance.feedback import Model
from mcstudy.stance.ranges import AMPLITUDE, RATE
from mcstudy.stimulus_design.difference import check_effects
from mcstudy.study.catalogue import located, read_file
from mcstudy.study.checks import check_group, noisy_outputs
from mcstudy.study.group import FREQUENCY, HIGHEST_HZ, Group, ModelSection, NoiseSection, StimulusSection
from mcstudy.study.models import build_model
from mcstudy.study.study_file import check_tables, named_model, with_model

KIND = "design"

DIFFERENCE = "difference"
"""The criterion of two models."""


class DesignSection(Section):
    """What is optimal, and what is kept of the sequence.

    Attributes
    ----------
    name, seed, description: as in a study file.
    amplitude: of the sequence that the design is compared with and that its limits refer to.
    criterion: D (volume of the confidence ellipsoid), A (mean squared relative error), c (that of ``parameter``),
    difference (distance of the model with one of ``effects`` from the model without, or with the other).
    keep: share of the sequence's power that every line keeps at least, so that the stimulus stays unpredictable.
    detection: share of the odd lines that stay empty, to detect odd nonlinearities; the first line never does.
    fmax: highest line, Hz.
    phase_starts: starts of the search for phases.
    waveform_rate_hz: sampling rate of the waveform that is written; the stimulus' own when 0.
    """

    name: Name
    seed: int = Field(ge=0, lt=2**63)
    description: str = ""
    amplitude: Annotated[float, AMPLITUDE] = 5.0
    criterion: Literal["D", "A", "c", "difference"] = "D"
    parameter: str = ""
    effects: tuple[str, ...] = ()
    keep: float = Field(default=0.5, ge=0, lt=1)
    detection: float = Field(default=0.0, ge=0, le=0.5)
    fmax: Annotated[float, FREQUENCY] = 8.0
    phase_starts: int = Field(default=8, ge=1, le=1000)
    waveform_rate_hz: float = Field(default=0.0, ge=0, le=1e6)


class LimitsSection(Section):
    """Limits of the stimulus; ratios are to the sequence; 0 is no limit.

    Attributes
    ----------
    rms: root mean square of the stimulus. sway: that of the sway of either angle that it evokes in a body.
    bodies_within: share of the bodies of the prior that keep the limit of the sway, beside the body of ``[model]``; 0
    for that body alone. rate: root mean square of the stimulus' rate of change. crest_factor: largest absolute value
    over root mean square. peak: largest absolute value,
    in units of the stimulus. duration_s: of all recorded cycles, s.
    """

    rms: float = Field(default=1.1, gt=0, le=1000)
    sway: float = Field(default=1.1, gt=0, le=1000)
    bodies_within: float = Field(default=0.95, ge=0, le=0.99)
    rate: float = Field(default=5.0, ge=0, le=100_000)
    crest_factor: float = Field(default=0.0, ge=0, le=1000)
    peak: float = Field(default=0.0, ge=0, le=1e6)
    duration_s: float = Field(default=0.0, ge=0, le=1e9)


class PriorSection(Section):
    """Bodies that may stand on the platform instead of the one of ``[model]``.

    Attributes
    ----------
    bodies: number of those over which the criterion is averaged, beside the body of ``[model]``. spread: half-width of
    the uniform distributions of every parameter, and of one factor of all inertias and moments of the body (its mass),
    relative to the values of ``[model]``.
    """

    bodies: int = Field(default=12, ge=0, le=1000)
    spread: float = Field(default=0.2, ge=0, lt=0.9)


class VerifySection(Section):
    """Monte Carlo studies of design and sequence with the same noise and bounded fits.

    Attributes
    ----------
    realizations: of the body of ``[model]``; 0 for no verification. bodies: further bodies drawn from the prior, none
    of them used by the design. body_realizations: of each. starts: per fit. fmax: of the fits of the body of
    ``[model]``, Hz; the others are fitted up to ``design.fmax``.
    """

    realizations: int = Field(default=200, ge=0, le=1_000_000)
    bodies: int = Field(default=20, ge=0, le=99)
    body_realizations: int = Field(default=50, ge=3, le=1_000_000)
    starts: int = Field(default=5, ge=1, le=1_000_000)
    fmax: tuple[Positive, ...] = Field(default=(1.2, 8.0), min_length=1, max_length=20)


class DesignFile(Section):
    """A design file with every setting explicit."""

    design: DesignSection
    limits: LimitsSection = LimitsSection()
    prior: PriorSection = PriorSection()
    verify: VerifySection = VerifySection()
    model: ModelSection = ModelSection()
    stimulus: StimulusSection = StimulusSection()
    noise: NoiseSection = NoiseSection()

    def group(self, **fields: Any) -> Group:
        """A group of a study with this model, stimulus and noise, and other ``fields``; checked by nobody yet."""
        axes = {"realizations": 1, "starts": 1, "fmax": [self.design.fmax], "amplitude": [self.design.amplitude]}
        sections = {"model": self.model, "stimulus": self.stimulus, "noise": self.noise}
        spectra: dict[str, Any] = {"points": "odd_lines"}
        if self.model.declared:
            spectra["highest_hz"] = self.design.fmax
        return Group(**{**axes, "spectra": spectra, **sections, **fields})

    @property
    def period_s(self) -> float:
        """Duration of a cycle."""
        return (3**self.stimulus.stages - 1) * self.stimulus.state_s

    @property
    def cycles(self) -> int:
        """Recorded cycles: those of the stimulus, or fewer where ``limits.duration_s`` is shorter."""
        cycles, longest = self.stimulus.cycles, self.limits.duration_s
        return cycles if longest == 0 else min(cycles, int(longest / self.period_s * (1 + 1e-9)))


def read_design(path: str | Path, model: Model | str | Path | None = None) -> DesignFile:
    """The design of a file, or of a shipped one by name; raises `DesignError` with one line.

    ``model``: a `Model`, a name or the file of one, instead of that of the file.
    """
    folder = located(path, KIND).parent
    return read_file(path, KIND, lambda raw: parse_design(with_model(raw, model), folder))


def parse_design(raw: dict[str, Any], folder: Path | None = None) -> DesignFile:
    """The design of a parsed file, which may name its model; the one-line `DesignError` starts with the field."""
    if "model" in raw:
        raw = {**raw, "model": named_model(raw["model"], "model", folder)}
    check_tables(raw, tuple(DesignFile.model_fields))
    if KIND not in raw:
        raise DesignError(f"{KIND}: missing, expected a table [{KIND}] with name and seed")
    file: DesignFile = validated(DesignFile, raw)
    _check(file)
    return file


def _check(file: DesignFile) -> None:
    design, s = file.design, file.stimulus
    if s.lines.harmonic:
        raise DesignError("stimulus.lines: expected none: a design is compared with the sequence")
    check_group(file.group())
    if s.discard == 0:
        raise DesignError(
            "stimulus.discard: expected at least 1 (the ramp of a record needs the preceding sample), got 0"
        )
    if not noisy_outputs(file.group(), build_model(file.group())):
        raise DesignError("noise.psd: expected noise on all outputs; without noise every stimulus is as good")
    if file.cycles <= s.discard:
        raise DesignError(
            f"limits.duration_s: expected room for {s.discard + 1} cycles ({s.discard} of them discarded) of "
            f"{file.period_s:g} s, got {file.limits.duration_s:g} s"
        )
    highest = s.rate_hz / 2 if file.model.declared else HIGHEST_HZ
    if design.fmax > highest:
        raise DesignError(f"design.fmax: expected at most {highest:g} Hz, got {design.fmax}")
    if (design.criterion == "c") != bool(design.parameter):
        raise DesignError("design.parameter: expected a parameter for criterion 'c', and none for the others")
    if design.criterion != DIFFERENCE and design.effects:
        raise DesignError(f"design.effects: expected none for criterion {design.criterion!r}")
    if design.criterion == DIFFERENCE and file.model.declared:
        raise DesignError("design.criterion: expected D, A or c for a declared model, to which no effects attach here")
    if design.criterion == DIFFERENCE:
        try:
            check_effects(design.effects)
        except InputError as error:
            raise DesignError(str(error)) from None
    if max(file.verify.fmax) > design.fmax:
        raise DesignError(
            f"verify.fmax: expected at most design.fmax = {design.fmax:g} Hz, got {max(file.verify.fmax)}"
        )
    if len(set(file.verify.fmax)) < len(file.verify.fmax):
        raise DesignError("verify.fmax: expected every value once")
    rate, period = design.waveform_rate_hz, file.period_s
    if rate and (rate not in RATE or rate <= 2 * design.fmax or abs(rate * period - round(rate * period)) > 1e-6):
        raise DesignError(
            f"design.waveform_rate_hz: expected more than twice design.fmax, with a whole number of samples in a cycle "
            f"of {period:g} s, got {rate:g} Hz"
        )
