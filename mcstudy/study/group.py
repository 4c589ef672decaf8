"""A group of a study: all settings that change a number, as validated sections.

A study file has one section of each kind, and groups may override any of them (`mcstudy.study.study_file` reads it).
Merging gives a `Group` in which every setting is explicit. Every number has an allowed range, far wider than any person
or robot needs; a value outside it is a typing error and would lead to numbers that cannot be computed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    create_model,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic_core import core_schema

from mcstudy.errors import InputError
from mcstudy.files.sections import Name, Section, without_defaults
from mcstudy.fitting.solvers import Options, solvers
from mcstudy.models.catalogue import DECLARED
from mcstudy.models.record import ModelTable
from mcstudy.stance.body import KINDS
from mcstudy.stance.feedback import ANGLES, MOST_ROWS
from mcstudy.stance.ranges import AMPLITUDE, GAIN, RATE, Range
from mcstudy.stance.truths import TRUTHS
from mcstudy.text_tables import starts_in_words

if TYPE_CHECKING:
    from mcstudy.stance.noise import MeasurementNoise, Noise

S = TypeVar("S", bound=Section)

GAIN_BOUND = Range(1e-12, 1e15, or_zero=True, signed=True)
"""Bounds of true values."""

MULTIPLE = Range(1e-6, 1e6, or_zero=True, signed=True)
"""Bounds as multiples of true values."""

BODY = Range(1e-9, 1e6, or_zero=True, signed=True)
"""Range of body constants, kg m^2, kg m and m/s^2; human values reach about 1e2."""

FREQUENCY = Range(1e-7, 1e6, "Hz")

HIGHEST_HZ = 8.0
"""Highest frequency point for every Fmax, so that points and data do not depend on the fits."""

NOISE_CORNER = Range(1e-6, 1e6, "Hz")
NOISE_PSD = Range(1e-18, 1e6, "deg^2/Hz", or_zero=True)
NOISE_DENSITY = Range(1e-18, 1e6, "deg^2/Hz")
MEASURED = Range(1e-12, 1e12, or_zero=True)
MEASURED_COVARIANCE = Range(1e-24, 1e24, or_zero=True, signed=True)
STABILITY_MARGIN = Range(1e-6, 1e6, "1/s", or_zero=True)
DELAY_MARGIN = Range(1e-9, 10.0, "s")
STATE = Range(1e-6, 1e6, "s")
LINE_WEIGHT = Range(1e-12, 1e12)
PHASE = Range(1e-12, 360.0, "deg", or_zero=True, signed=True)
EFFECT = Range(1e-12, 1e6, or_zero=True, signed=True)


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    """Sort coordinates, so that the order of a list in the file does not matter."""
    if len(set(values)) != len(values):
        raise ValueError("every value listed once")
    return tuple(sorted(values))


class OneOf:
    """Metadata of a field: the names of a registry that it may hold."""

    def __init__(self, registry: Iterable[str]) -> None:
        self.names = tuple(registry)

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return core_schema.literal_schema(list(self.names))


LENGTH = Field(min_length=1, max_length=1000)
ASCENDING = AfterValidator(_ascending)
"""A coordinate axis: its values distinct, kept ascending."""


class StudySection(Section):
    """Name and seed of the study; the description does not enter the fingerprint."""

    name: Name
    seed: int = Field(ge=0, lt=2**63)
    description: str = ""
    regenerates: tuple[str, ...] = ()


class BoundsSection(Section):
    """Bounds: gains as multiples of the true value, delays as the true value +- a margin, or absolute per parameter.

    Sensory weights lie between 0 and 1 unless absolute bounds are given.
    Defaults: Goodworth & Peterka 2018, Methods.
    """

    lower: Annotated[float, MULTIPLE] = 0.0
    upper: Annotated[float, MULTIPLE] = 2.0
    delay_margin_s: Annotated[float, DELAY_MARGIN] = 0.030
    absolute: dict[str, tuple[Annotated[float, GAIN_BOUND], Annotated[float, GAIN_BOUND]]] = Field(default={})


class ModelSection(ModelTable):
    """Which model, its true values (in the units of `mcstudy.stance.body`), its body and its bounds; or a whole model.

    A declared model states its own true values and bounds; ``truth`` and ``bounds`` replace them by name.
    """

    kind: Literal["two_segment", "one_segment", "declared"] = "two_segment"
    truth: dict[str, Annotated[float, GAIN]] = Field(default={})
    body: dict[str, Annotated[float, BODY]] = Field(default={})
    bounds: BoundsSection = BoundsSection()

    @field_validator("truth", mode="before")
    @classmethod
    def _named(cls, truth: Any) -> Any:
        """The values of a set that is given by its name."""
        if not isinstance(truth, str):
            return truth
        if truth not in TRUTHS:
            raise ValueError(f"expected a table, or one of {', '.join(TRUTHS)}")
        return dict(TRUTHS[truth].values)

    @model_validator(mode="after")
    def _one_form(self) -> ModelSection:
        own = ModelTable.model_fields.keys() & self.model_fields_set
        if not self.declared and own:
            raise ValueError(f"expected no {min(own)} beside kind = {self.kind!r}, whose table is not a file's")
        if self.declared and "body" in self.model_fields_set:
            raise ValueError("expected no body beside a declared model, whose terms are its body")
        return self

    @model_serializer(mode="wrap")
    def _short(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A design of a model that a study builds has the fingerprint that it had before there were declared ones."""
        whole, built = dump(self), ("kind", "truth", "body", "bounds")
        if not self.declared:
            return {name: whole[name] for name in built}
        fields = type(self).model_fields
        kept = [n for n in whole if n not in ("kind", "description") and getattr(self, n) != fields[n].default]
        return {name: whole[name] for name in ("kind", *kept)}

    @property
    def declared(self) -> bool:
        """Whether the section holds the whole model."""
        return self.kind == DECLARED

    @property
    def sensed(self) -> tuple[str, ...]:
        """Names of the angles, which are what is measured where no outputs are declared."""
        return self.angles or self.joints or (ANGLES[:1] if self.kind == "one_segment" else ANGLES)

    @property
    def title(self) -> str:
        """What the model is called."""
        return self.name or "model" if self.declared else self.kind


class LinesSection(Section):
    """Lines of a stimulus that replace the pseudorandom sequence; see `mcstudy.stance.line_stimulus.LineStimulus`."""

    harmonic: tuple[Annotated[int, Field(ge=1, le=1_000_000)], ...] = Field(default=(), max_length=10_000)
    weight: tuple[Annotated[float, LINE_WEIGHT], ...] = Field(default=(), max_length=10_000)
    phase_deg: tuple[Annotated[float, PHASE], ...] = Field(default=(), max_length=10_000)


class StimulusSection(Section):
    """Pseudorandom ternary stimulus: 3**stages - 1 states of state_s seconds; ``cycles`` periods, some discarded.

    ``lines``: the cycle of the sequence, with these lines instead of those of the sequence. ``applied``: names of the
    stimuli of a declared model that are applied, each in recordings of its own; all of them by default.
    """

    kind: Annotated[str, OneOf(KINDS)] = "ankle_torque"
    stages: int = Field(default=7, ge=2, le=9)
    state_s: Annotated[float, STATE] = 0.020
    rate_hz: Annotated[float, RATE] = 200.0
    cycles: int = Field(default=6, ge=1, le=100_000)
    discard: int = Field(default=1, ge=0, le=100_000)
    convention: Literal["peak", "peak_to_peak"] = "peak"
    lines: LinesSection = LinesSection()
    applied: Annotated[tuple[str, ...], Field(max_length=100)] = ()

    @model_serializer(mode="wrap")
    def _without_lines(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A study of the sequence has the design and the fingerprint that it had before there were lines."""
        return without_defaults(self, dump(self), ("lines", "applied"))


def _listed(given: Any) -> Any:
    """A single number as a list of one."""
    number = isinstance(given, int | float) and not isinstance(given, bool)
    return (given,) if number else tuple(given) if isinstance(given, list) else given


class NoiseTableSection(Section):
    """Measured noise that replaces the form of `NoiseSection`; see `mcstudy.stance.noise.TabulatedNoise`.

    ``theta1``, ``theta2``: densities on the first and the second angle; or ``psd``: by the name of the angle, none on
    angles that it does not name.
    """

    f_hz: tuple[Annotated[float, FREQUENCY], ...] = Field(default=(), max_length=10_000)
    theta1: tuple[Annotated[float, NOISE_DENSITY], ...] = Field(default=(), max_length=10_000)
    theta2: tuple[Annotated[float, NOISE_DENSITY], ...] = Field(default=(), max_length=10_000)
    psd: dict[str, Annotated[tuple[Annotated[float, NOISE_DENSITY], ...], Field(max_length=10_000)]] = Field(default={})

    @model_serializer(mode="wrap")
    def _without_names(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A table of two angles has the fingerprint that it had before there were others."""
        whole: dict[str, Any] = dump(self)
        for name in ("theta1", "theta2") if self.psd else ("psd",):
            whole.pop(name)
        return whole

    @model_validator(mode="after")
    def _one_form(self) -> NoiseTableSection:
        if self.psd and self.model_fields_set & {"theta1", "theta2"}:
            raise ValueError("expected either psd, or theta1 and theta2")
        return self

    def of(self, angles: tuple[str, ...], scale: float) -> Noise:
        """The noise on ``angles``; ``scale``: from the densities to deg^2/Hz."""
        from mcstudy.stance.noise import TabulatedNoise

        if unknown := [name for name in self.psd if name not in angles]:
            raise InputError(f"noise table.psd.{unknown[0]}: expected one of {', '.join(angles)}")
        names = tuple(f"psd.{angle}" if self.psd else f"theta{k}" for k, angle in enumerate(angles, 1))
        given = [self.psd.get(angle, (0.0,) * len(self.f_hz)) for angle in angles]
        densities = given if self.psd else [self.theta1, self.theta2][: len(angles)]
        if len(densities) < len(angles):
            raise InputError(f"noise table: expected psd, with a density for each of {', '.join(angles)}")
        return TabulatedNoise(self.f_hz, tuple(tuple(x * scale for x in d) for d in densities), names)


class MeasurementSection(Section):
    """White noise of the recorded outputs, outside the loop, up to half the sampling rate.

    ``sd``: of one sample of each output, or one for all, in its unit (deg where that is rad), with the matrix of their
    ``correlation``; or the matrix of their ``covariance``.
    """

    sd: tuple[Annotated[float, MEASURED], ...] = Field(default=(), max_length=1000)
    correlation: tuple[tuple[Annotated[float, Field(ge=-1, le=1)], ...], ...] = Field(default=(), max_length=1000)
    covariance: tuple[tuple[Annotated[float, MEASURED_COVARIANCE], ...], ...] = Field(default=(), max_length=1000)

    _lists = field_validator("sd", mode="before")(_listed)

    @model_validator(mode="after")
    def _one_form(self) -> MeasurementSection:
        if self.covariance and (self.sd or self.correlation):
            raise ValueError("expected either covariance, or sd and correlation")
        if self.correlation and not self.sd:
            raise ValueError("expected sd beside correlation")
        return self

    def of(self, units: tuple[str, ...]) -> MeasurementNoise | None:
        """The noise of outputs in these units, None for none. Raises `InputError`, which begins with the field."""
        from mcstudy.stance.noise import MeasurementNoise  # who reads a study draws nothing

        if not (any(self.sd) or self.covariance):
            return None
        Y, scale = len(units), np.array([np.pi / 180.0 if unit == "rad" else 1.0 for unit in units])
        if not self.covariance and len(self.sd) not in (1, Y):
            raise InputError(f"sd: expected {Y} numbers, one for each output, or one for all, got {len(self.sd)}")
        for name in ("correlation", "covariance"):
            given = getattr(self, name)
            if given and {len(given), *map(len, given)} != {Y}:
                raise InputError(f"{name}: expected {Y} rows of {Y} numbers, one for each output")
        sd = np.array(self.sd if len(self.sd) == Y else self.sd * Y)
        C = np.array(self.covariance or np.outer(sd, sd) * np.array(self.correlation or np.eye(Y)))
        if self.correlation and (np.diag(self.correlation) != 1).any():
            raise InputError("correlation: expected 1 on the diagonal")
        try:
            return MeasurementNoise(tuple(map(tuple, (C * np.outer(scale, scale)).tolist())))
        except InputError as error:
            given_as = "covariance" if self.covariance else "correlation"
            raise InputError(f"{given_as}: {str(error).partition('covariance: ')[2]}") from None


class NoiseSection(Section):
    """Sensor noise of the angles: one-sided PSD of each, or one for all, at 0.5 Hz in deg^2/Hz, low-pass corner in Hz;
    or a ``table``. ``measurement``: noise of what is recorded.

    Of a declared model whose unit is not rad the PSD is in the square of that unit per Hz.
    """

    psd: Annotated[tuple[Annotated[float, NOISE_PSD], ...], Field(min_length=1, max_length=MOST_ROWS)] = (4e-4, 7e-5)
    corner_hz: Annotated[float, NOISE_CORNER] = 0.15
    table: NoiseTableSection = NoiseTableSection()
    measurement: MeasurementSection = MeasurementSection()

    _lists = field_validator("psd", mode="before")(_listed)

    @model_validator(mode="after")
    def _one_form(self) -> NoiseSection:
        if self.tabulated and self.model_fields_set & {"psd", "corner_hz"}:
            raise ValueError("expected either a table, or psd and corner_hz")
        return self

    @model_serializer(mode="wrap")
    def _one_form_in_a_file(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A study without a table has the design and the fingerprint that it had before there were tables."""
        plain = without_defaults(self, dump(self), ("measurement",))
        for name in ("psd", "corner_hz") if self.tabulated else ("table",):
            plain.pop(name, None)
        return plain

    @property
    def tabulated(self) -> bool:
        """Whether the densities are those of the table."""
        return self.table != NoiseTableSection()

    @property
    def none(self) -> bool:
        """Whether nothing has noise."""
        measured = self.measurement.covariance or any(self.measurement.sd)
        return not self.tabulated and not any(self.psd) and not measured

    def of(self, angles: tuple[str, ...], unit: str = "rad") -> Noise:
        """The sensor noise of angles in this unit. Raises `InputError` for a table that is not one, or other angles."""
        from mcstudy.stance.noise import DEG2_TO_RAD2, SensorNoise  # who reads a study draws nothing

        scale = 1.0 if unit == "rad" else 1.0 / DEG2_TO_RAD2  # a noise takes deg^2/Hz
        if self.tabulated:
            return self.table.of(angles, scale)
        psd = self.psd * len(angles) if len(self.psd) == 1 else self.psd
        stated, n = psd != type(self).model_fields["psd"].default, len(angles)
        if len(psd) < n or (stated and len(psd) > max(n, 2)):  # of two, one segment takes the first
            got = len(psd) if stated else "none"
            raise InputError(f"noise psd: expected {n} numbers, one for each angle, or one for all, got {got}")
        return SensorNoise(tuple(x * scale for x in psd[: len(angles)]), self.corner_hz)


class SpectraSection(Section):
    """Choice of frequency points, removal of the ramp of each record before the DFT, and excluded points.

    ``width``: fraction of a point's lines that are averaged into it (`mcstudy.spectra.bands.narrower`).
    ``highest_hz``: highest of the ``odd_lines``; more than 8 Hz only for a declared model.
    ``covariance``: noise covariance from the even lines alone, from the even lines through a first fit of the loop
    (`mcstudy.spectra.loop_covariance`), or the true one, which no experiment knows; the last two with simulator
    "spectral" only.
    """

    points: Literal["published", "averaged", "odd_lines"] = "published"
    width: float = Field(default=1.0, gt=0, le=1)
    ramp: Literal["keep", "remove"] = "keep"
    covariance: Literal["even_lines", "through_loop", "true"] = "even_lines"
    exclude_hz: tuple[Annotated[float, FREQUENCY], ...] = ()
    highest_hz: Annotated[float, FREQUENCY] = HIGHEST_HZ

    @model_serializer(mode="wrap")
    def _without_highest(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A study of up to 8 Hz has the design and the fingerprint that it had before there were others."""
        return without_defaults(self, dump(self), ("highest_hz",))


def with_settings(section: type[S]) -> type[S]:
    """The section with a table for the settings of every solver that has some."""
    own: dict[str, Any] = {s.name: (s.settings, s.settings()) for s in solvers().values() if s.settings is not None}
    return create_model(
        section.__name__, __base__=section, __module__=section.__module__, __doc__=section.__doc__, **own
    )


@with_settings
class FitSection(Section):
    """Cost, solver, kind of starts and stop rules; the table of a solver's own name holds its settings.

    ``stability_margin``: how far left of the imaginary axis, in 1/s, every fitted loop must have all its characteristic
    roots (`mcstudy.fitting.stable`); without it a fit may end at an unstable loop.
    """

    cost: Literal["paper", "ml"] = "paper"
    solver: Annotated[str, OneOf(solvers())] = "lm"
    starts: Literal["uniform", "latin_hypercube", "sobol", "linearised"] = "uniform"
    tolerance: float = Field(default=1e-12, gt=0, lt=1)
    max_iterations: int = Field(default=1000, ge=1, le=1_000_000)
    stability_margin: Annotated[float, STABILITY_MARGIN] | None = None

    @property
    def settings(self) -> Section | None:
        """The settings of the solver."""
        return getattr(self, self.solver, None)

    def options(self) -> Options:
        """What the solver is handed."""
        return Options(self.tolerance, self.max_iterations, self.settings, self.stability_margin)

    @model_serializer(mode="wrap")
    def _without_unused(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Settings of a solver that is not used change no number: they do not enter the fingerprint."""
        unused = solvers().keys() - {self.solver}
        used = {name: value for name, value in dump(self).items() if name not in unused}
        return without_defaults(self, used, ("stability_margin",))


class EffectsSection(Section):
    """Effects of the library (``mcstudy gap effects``) of the body that is simulated and of the model that is fitted.

    ``truth``: by the name of the effect its size, or a table of its parameters, or of its detectability ``delta`` at
    the largest amplitude and Fmax. ``fit``: names of those that the fitted model has; what is in ``truth`` and not
    here is missing from it. ``reference_amplitude``: at which an effect that depends on the amplitude vanishes, the
    geometric mean of the amplitudes by default.
    """

    truth: dict[str, Annotated[float, EFFECT] | dict[str, Annotated[float, EFFECT]]] = Field(default={})
    fit: Annotated[tuple[str, ...], Field(max_length=20)] = ()
    reference_amplitude: Annotated[float, AMPLITUDE] | None = None

    @model_serializer(mode="wrap")
    def _without_reference(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return without_defaults(self, dump(self), ("reference_amplitude",))


class StoreSection(Section):
    """What the cube holds besides the fits.

    ``standard_errors``: those of the best fit of every cell (`mcstudy.fitting.standard_errors`).
    """

    standard_errors: bool = False


Label = str | int | float | bool
"""Where a cell of a sweep lies on an axis."""


class CellSection(Section):
    """Where a group lies among those of a sweep (`mcstudy.study.sweep`).

    ``sweep``: its name. ``at``: the label on every axis. ``setting``: what each axis sets, empty for several settings.
    """

    sweep: Name
    at: dict[str, Label] = Field(min_length=1)
    setting: dict[str, str]


UNTIL_CERTAIN = "until certain"
"""What a file says in place of a number of starts."""

MOST_STARTS = 1_000_000
DEFAULT_MOST_STARTS = 1000


class _Largest(int):
    """A number of starts that stands for `UNTIL_CERTAIN`, between two steps of validation."""


AXES = ("fmax", "amplitude")
"""Fields of a group that are lists of numbers."""


def with_lists(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a group in which a number stands for a list of one."""
    lists = {key: [fields[key]] for key in AXES if type(fields.get(key)) in (int, float)}
    return {**fields, **lists}


class Group(Section):
    """One group of the cube: its axes, and the sections that apply to it.

    ``fmax`` in Hz, ``amplitude`` in units of the stimulus, ``starts`` per fit problem. With simulator "none" a
    realization is a pool of starts: all pools share the same data and differ in their starts.

    A file may say ``starts = "until certain"``. Then ``starts`` is the largest number, ``most_starts`` of the file, and
    each fit problem gets as many of them as `mcstudy.fitting.certainty` asks for.
    """

    realizations: int = Field(ge=1, le=10_000_000)
    starts: int = Field(ge=1, le=MOST_STARTS)
    most_starts: Annotated[int, Field(ge=1, le=MOST_STARTS)] | None = None
    fmax: Annotated[tuple[Annotated[float, FREQUENCY], ...], LENGTH, ASCENDING]
    amplitude: Annotated[tuple[Annotated[float, AMPLITUDE], ...], LENGTH, ASCENDING]
    simulator: Literal["none", "spectral", "time_domain"] = "spectral"
    model: ModelSection = ModelSection()
    stimulus: StimulusSection = StimulusSection()
    noise: NoiseSection = NoiseSection()
    spectra: SpectraSection = SpectraSection()
    fit: FitSection = FitSection()
    effects: EffectsSection = EffectsSection()
    store: StoreSection = StoreSection()
    cell: CellSection | None = None

    @field_validator("starts", mode="wrap")
    @classmethod
    def _number_or_words(cls, given: Any, whole_number: ValidatorFunctionWrapHandler) -> int:
        if given == UNTIL_CERTAIN:
            return _Largest(DEFAULT_MOST_STARTS)
        if isinstance(given, str):
            raise ValueError(f"expected a whole number or {UNTIL_CERTAIN!r}")
        return int(whole_number(given))

    @field_validator("most_starts", mode="after")
    @classmethod
    def _only_beside_the_words(cls, most: int | None, info: ValidationInfo) -> int | None:
        if most is not None and type(info.data.get("starts")) is int:
            raise ValueError(f"expected starts = {UNTIL_CERTAIN!r} beside it")
        return most

    @model_validator(mode="after")
    def _with_the_largest_number(self) -> Group:
        if type(self.starts) is int:
            return self
        most = int(self.starts) if self.most_starts is None else self.most_starts
        return self.model_copy(update={"starts": most, "most_starts": most})

    @model_serializer(mode="wrap")
    def _as_in_a_file(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """What is not used has no place in the design, so that its fingerprint is that of older studies without it."""
        plain = without_defaults(self, dump(self), ("effects", "store", "cell"))
        if self.model.declared:  # its terms say what the stimulus moves
            plain["stimulus"].pop("kind", None)
        if self.until_certain:
            plain |= {"starts": UNTIL_CERTAIN, "most_starts": self.starts}
        else:
            plain.pop("most_starts", None)
        return plain

    @property
    def noise_source(self) -> Noise:
        """The sensor noise in the unit of the model's angles."""
        return self.noise.of(self.model.sensed, self.model.unit)

    @property
    def measurement_noise(self) -> MeasurementNoise | None:
        """The noise of what is recorded, in the units of the outputs; None for none."""
        section = self.model
        units = tuple(section.unit if o.unit is None else o.unit for o in section.output)
        return self.noise.measurement.of(units or (section.unit,) * len(section.sensed))

    @property
    def until_certain(self) -> bool:
        """Whether ``starts`` is the largest number, and those that are not needed are left out."""
        return self.most_starts is not None

    @property
    def starts_in_words(self) -> str:
        """Number of starts, for a reader."""
        return starts_in_words(self.starts, self.until_certain)

    @property
    def fits(self) -> int:
        """Number of fits of the group; the largest number where starts are drawn until certain."""
        return len(self.amplitude) * len(self.fmax) * self.realizations * self.starts

    @property
    def noisy(self) -> bool:
        """Whether realizations differ by noise (else they are pools of starts for the same data)."""
        return self.simulator != "none" and not self.noise.none


FITTED = ("model", "stimulus", "noise", "spectra", "fit", "effects")
"""Sections on which data and fits depend."""

SECTIONS = (*FITTED, "store")
"""Sections that a group may override."""
