"""What an effect is: its sizes, where it acts, how it changes a model. The library is in `mcstudy.gap.effects`.

Everything that tells one effect from another is a field of its declaration: no other code knows an effect by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mcstudy.errors import InputError
from mcstudy.stance.feedback import Model, Parameter
from mcstudy.stance.ranges import Range

Place = Literal["ankle", "hip", "stimulus", "sensor", "body"]
PLACES: tuple[Place, ...] = ("ankle", "hip", "stimulus", "sensor", "body")
Kind = Literal["linear", "nonlinear", "nonstationary"]
Contrast = Literal["amplitude", "time"]


@dataclass(frozen=True, slots=True)
class Mistake:
    """A value that a size takes when somebody made a known mistake, and what to check then.

    Attributes: value: of the size. advice: a sentence for the user.
    """

    value: float
    advice: str


@dataclass(frozen=True, slots=True)
class Size:
    """One parameter of an effect.

    Attributes
    ----------
    name, unit, meaning: as in `Parameter`.
    null: the value at which the effect vanishes; None for a companion that only shapes it (a resonance frequency).
    lower, upper: bounds of the fit; they hold ``null``.
    published: (low, high) magnitude reported for people; for a companion, its reported range.
    signed: whether people have it with either sign. Bounds reach below the null also where they do not, so that an
        estimate near the null is not cut off, unless a negative value has no meaning.
    mistakes: values that known mistakes give it; each has a prior share and a start of its own.
    """

    name: str
    unit: str
    null: float | None
    lower: float
    upper: float
    published: tuple[float, float]
    meaning: str = ""
    signed: bool = False
    mistakes: tuple[Mistake, ...] = ()

    @property
    def companion(self) -> bool:
        """Whether it shapes the effect without being its size."""
        return self.null is None

    @property
    def prior(self) -> tuple[float, float]:
        """(mean, standard deviation) of a normal prior, to be cut at the bounds.

        A size is centred on its null with the larger published magnitude as scale, so that "small" is never
        excluded; a companion is centred on its published range with half the range as scale.
        """
        low, high = self.published
        return ((low + high) / 2, (high - low) / 2) if self.null is None else (self.null, high)

    @property
    def parameter(self) -> Parameter:
        """As a model parameter; its nominal value is the null (for a companion, the middle of its range)."""
        value = sum(self.published) / 2 if self.null is None else self.null
        return Parameter(self.name, self.unit, value, self.lower, self.upper, self.meaning)

    def believable(self, value: float, where: str) -> float:
        """The value; raises `InputError`, one line that starts with ``where``, for one that no body can have.

        A size is 0, or within six orders below and two above the largest of its bounds.
        """
        largest = max(abs(self.lower), abs(self.upper), *self.published)
        allowed = Range(1e-6 * largest, 1e2 * largest, self.unit, or_zero=True, signed=True)
        allowed.require(value, where)
        return value

    def draw(self, rng: np.random.Generator, scale: float = 1.0) -> float:
        """A value from the published range times ``scale`` (companions unscaled), of either sign if it is signed."""
        value = float(rng.uniform(*self.published))
        if self.null is None:
            return value
        sign = rng.choice((-1.0, 1.0)) if self.signed else 1.0
        return float(np.clip(self.null + sign * scale * value, self.lower, self.upper))


@dataclass(frozen=True)
class TrialSetting:
    """What a time-domain rule may depend on.

    Attributes
    ----------
    model: the model simulated. amplitude, reference: peak of this trial's stimulus, and of the recording as a whole.
    samples, rate_hz: length of the record and its rate. rng: randomness of this trial.
    """

    model: Model
    amplitude: float
    reference: float
    samples: int
    rate_hz: float
    rng: np.random.Generator


@dataclass(frozen=True)
class Effect:
    """One declaration of the library.

    Attributes
    ----------
    name, equation: for people; the equation in the notation of the model's table.
    place: where it acts; more than one when it does.
    sizes: its parameters, the size proper first.
    build: adds it to a model whose parameters already hold ``sizes``; for a nonlinear effect, its linear trace.
    order: effects are applied in ascending order: 0 terms, 1 copies of terms, 2 filters and delays on terms.
    source: where the published size is from.
    kind: "linear", "nonlinear" (depends on amplitude) or "nonstationary" (depends on time or is noise).
    contrast: comparison that reveals a nonlinear or nonstationary effect: between amplitudes, or between the first and
        the last cycles. None for a linear effect, and for one that changes the noise and not the responses.
    gain_sign: sign of the change of the active gains, from the lower to the higher amplitude or from the first to the
        last cycles, for a positive size. Needed with ``contrast``.
    size_from_gain: the size from the relative change of the active gains and the two amplitudes compared (0 and 1 for
        first and last cycles); None where it does not follow.
    rule: the fields of `Rules` that carry it in simulation, from its sizes and the trial; None for a linear effect.
    family: effects of one family are variants of one cause.
    """

    name: str
    equation: str
    place: tuple[Place, ...]
    sizes: tuple[Size, ...]
    build: Callable[[Model], Model]
    source: str
    order: int = 0
    kind: Kind = "linear"
    contrast: Contrast | None = None
    gain_sign: Literal[-1, 1] | None = None
    size_from_gain: Callable[[float, tuple[float, float]], float | None] | None = None
    rule: Callable[[Mapping[str, float], TrialSetting], dict[str, Any]] | None = None
    family: str = ""

    def __post_init__(self) -> None:
        if not self.sizes or self.size.companion:
            raise InputError(f"effect {self.name!r}: sizes: expected the size proper, with a null value, first")
        if (self.kind == "linear") != (self.rule is None):
            raise InputError(f"effect {self.name!r}: rule: expected one exactly for an effect that is not linear")
        if self.contrast is not None and (self.kind == "linear" or self.gain_sign is None):
            raise InputError(
                f"effect {self.name!r}: contrast: expected an effect that is not linear, with gain_sign of 1 or -1"
            )

    @property
    def size(self) -> Size:
        """The parameter that is zero-effect at its null."""
        return self.sizes[0]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters it adds to a model."""
        return tuple(s.name for s in self.sizes)

    @property
    def cause(self) -> str:
        """Name of the family it belongs to, its own when it has none."""
        return self.family or self.name
