"""Declaration of an effect: its sizes, where it acts, and how it changes a model.

The library itself is in `mcstudy.effect_library.library`. All differences between effects are fields of their
declarations; no other code refers to an effect by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np

from mcstudy.errors import InputError
from mcstudy.stance.feedback import Model, Parameter
from mcstudy.stance.ranges import Range

LOCATIONS = ("ankle", "hip", "stimulus", "sensor", "body")
"""Where the effects of a standing body act."""

EffectKind = Literal["linear", "nonlinear", "nonstationary"]
ContrastKind = Literal["amplitude", "time"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """One parameter of an effect.

    Attributes
    ----------
    name, unit, meaning
        Name and unit of the parameter, and a description in one line.
    null
        The value at which the effect vanishes, 0 by default; None for a shape parameter (a resonance frequency).
    lower, upper
        Bounds of the fit, which include ``null``.
    published
        (low, high) usual magnitude in people, for a shape parameter its usual range. ``Effect.source`` says
        whether it is published, collected from several publications, or derived.
    signed
        Whether both signs occur in people. If not, the bounds still extend below the null, so that an estimate near
        the null is not truncated, unless a negative value has no meaning.
    most
        Largest magnitude that a body can have; an estimate certainly above it is no explanation. None where the bounds
        of the fit are the only limit.
    """

    name: str
    unit: str = ""
    null: float | None = 0.0
    lower: float
    upper: float
    published: tuple[float, float]
    meaning: str = ""
    signed: bool = False
    most: float | None = None

    @property
    def is_shape(self) -> bool:
        """Whether this is a shape parameter, which shapes the effect but is not its size."""
        return self.null is None

    @property
    def prior(self) -> tuple[float, float]:
        """(mean, standard deviation) of a normal prior, truncated at the bounds.

        A size is centred on its null with the larger published magnitude as scale, so that small sizes are never
        excluded; a shape parameter is centred on its published range with half the range as scale.
        """
        low, high = self.published
        return ((low + high) / 2, (high - low) / 2) if self.null is None else (self.null, high)

    @property
    def parameter(self) -> Parameter:
        """As a model parameter; its nominal value is the null (for a shape parameter, the middle of its range)."""
        value = sum(self.published) / 2 if self.null is None else self.null
        return Parameter(self.name, self.unit, value, self.lower, self.upper, self.meaning)

    def believable(self, value: float, where: str) -> float:
        """The value; raises `InputError`, one line that starts with ``where``, for an impossible value.

        A size is 0, or within six orders below and two above the largest of its bounds.
        """
        largest = max(abs(self.lower), abs(self.upper), *self.published)
        allowed = Range(1e-6 * largest, 1e2 * largest, self.unit, or_zero=True, signed=True)
        allowed.require(value, where)
        return value

    def draw(self, rng: np.random.Generator, scale: float = 1.0) -> float:
        """Random value from the published range, times ``scale`` unless a shape parameter; either sign if signed."""
        value = float(rng.uniform(*self.published))
        if self.null is None:
            return value
        sign = rng.choice((-1.0, 1.0)) if self.signed else 1.0
        return float(np.clip(self.null + sign * scale * value, self.lower, self.upper))


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """A shape constant of an effect that physiology leaves open: a damping ratio, an order, a split over the joints.

    Simulations and the first fits of a diagnosis use ``nominal``. The fits of the causes that lead then estimate it,
    with a normal prior: the middle of the range as mean and half the range as standard deviation.

    Attributes
    ----------
    name, unit, meaning
        Name and unit of the constant, and a description in one line. It is no delay.
    nominal
        The value of the declared form.
    low, high
        Its usual range in people. Fits stay between half of ``low`` and twice ``high``, where ``nominal`` must lie.
    source
        Origin of the range.
    """

    name: str
    unit: str = ""
    nominal: float = 0.0
    low: float = 0.0
    high: float
    meaning: str
    source: str

    def __post_init__(self) -> None:
        if not 0 <= self.low < self.high or not self.low / 2 <= self.nominal <= 2 * self.high:
            raise InputError(
                f"form {self.name!r}: expected 0 <= low < high and nominal between low / 2 and 2 high, got low "
                f"{self.low:g}, high {self.high:g}, nominal {self.nominal:g}"
            )

    @property
    def prior(self) -> tuple[float, float]:
        """(mean, standard deviation) of the normal prior, truncated at the bounds."""
        return (self.low + self.high) / 2, (self.high - self.low) / 2

    @property
    def parameter(self) -> Parameter:
        """As a model parameter."""
        return Parameter(self.name, self.unit, self.nominal, self.low / 2, 2 * self.high, self.meaning)


@dataclass(frozen=True)
class TrialSetting:
    """What the time-domain rule of an effect may depend on.

    Attributes
    ----------
    model
        The model simulated.
    amplitude, reference
        Peak of the stimulus in this trial, and in the recording as a whole, in the unit of the stimulus.
    samples, rate_hz
        Samples of the record and their rate, Hz.
    rng
        Randomness of this trial.
    """

    model: Model
    amplitude: float
    reference: float
    samples: int
    rate_hz: float
    rng: np.random.Generator


@dataclass(frozen=True, eq=False, kw_only=True)
class Effect:
    """An effect that a model may lack: one declaration of the library.

    Attributes
    ----------
    name, equation
        As displayed; the equation uses the notation of the model's table.
    place
        One or more locations where it acts: "ankle", "hip", "stimulus", "sensor", "body"; of a declared model its rows,
        "stimulus" or "sensor".
    sizes
        Its parameters (`Size`), the size itself first.
    build
        Adds the effect, or the linear trace of a nonlinear one, to a `Model` that already has the parameters of
        ``sizes``.
    source
        Origin of the published size.
    order
        Effects are applied in ascending order: 0 terms, 1 copies of terms, 2 filters and delays on terms.
    kind
        "linear", "nonlinear" (depends on amplitude) or "nonstationary" (depends on time or is noise).
    contrast
        Comparison that reveals a nonlinear or nonstationary effect: between amplitudes ("amplitude"), or between the
        first and the last cycles ("time"). None for a linear effect, and for one that changes the noise and not the
        responses.
    gain_sign
        Sign of the change of the active gains, from the lower to the higher amplitude or from the first to the last
        cycles, for a positive size. Needed with ``contrast``.
    unvaried
        Where the active gains are those of the model: at "large" or "small" amplitudes, or at the "middle" of
        amplitudes or times.
    size_from_gain
        The size from the relative change of the active gains and the two amplitudes compared (0 and 1 for first and
        last cycles); None where it does not follow.
    rule
        Function of the sizes and the trial (`TrialSetting`) that returns what the time-domain simulator changes; None
        for a linear effect.
    family
        Effects of one family are variants of one cause.
    forms
        Shape constants (`Form`) that ``build`` uses as parameters; they are numbers wherever the form is the declared
        one.
    scatters
        Whether it is nonlinear within a trial, so that it scatters energy between the lines of the response.
    words
        What it is called in a sentence, before its name; its name alone when empty.

    Raises
    ------
    InputError
        Fields contradict each other.
    """

    name: str
    equation: str
    place: tuple[str, ...]
    sizes: tuple[Size, ...]
    build: Callable[[Model], Model]
    source: str
    order: int = 0
    kind: EffectKind = "linear"
    contrast: ContrastKind | None = None
    unvaried: Literal["large", "small", "middle"] = "middle"
    gain_sign: Literal[-1, 1] | None = None
    size_from_gain: Callable[[float, tuple[float, float]], float | None] | None = None
    rule: Callable[[Mapping[str, float], TrialSetting], dict[str, Any]] | None = None
    family: str = ""
    forms: tuple[Form, ...] = ()
    scatters: bool = False
    words: str = ""

    def __post_init__(self) -> None:
        if not self.sizes or self.size.is_shape:
            raise InputError(f"effect {self.name!r}: sizes: expected the size itself, with a null value, first")
        if (self.kind == "linear") != (self.rule is None):
            raise InputError(f"effect {self.name!r}: rule: expected one exactly for an effect that is not linear")
        if self.contrast is not None and (self.kind == "linear" or self.gain_sign is None):
            raise InputError(
                f"effect {self.name!r}: contrast: expected an effect that is not linear, with gain_sign of 1 or -1"
            )
        if self.forms and self.kind != "linear":
            raise InputError(f"effect {self.name!r}: forms: expected none for an effect that is not linear")

    @property
    def size(self) -> Size:
        """The size itself; the effect vanishes when it equals its null."""
        return self.sizes[0]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters it adds to a model."""
        return tuple(s.name for s in self.sizes)

    @property
    def nominal_form(self) -> dict[str, float]:
        """The shape constants of the declared form by name."""
        return {f.name: f.nominal for f in self.forms}

    @property
    def corner_forms(self) -> list[tuple[float, ...]]:
        """Values of the shape constants from which fits in other forms start: the declared ones, and all combinations
        of the ends of their ranges."""
        return [tuple(self.nominal_form.values()), *product(*((f.low, f.high) for f in self.forms))]

    @property
    def cause(self) -> str:
        """Name of the family it belongs to, its own when it has none."""
        return self.family or self.name
