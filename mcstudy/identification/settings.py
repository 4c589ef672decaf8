"""What a user chooses about the fit of a person, and what of it the result states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mcstudy.errors import InputError
from mcstudy.lines.checked_recording import Discard
from mcstudy.lines.settings import LineSettings


@dataclass(frozen=True, kw_only=True)
class FitSettings(LineSettings):
    """How the parameters of a person are estimated; what is not stated here is as in `LineSettings`.

    Attributes
    ----------
    effects
        Linear effects that are added to the model.
    quantities
        Further quantities: expressions, or a mapping from names to expressions and functions.
    bounds
        Bounds of parameters by name, in their unit.
    level
        Level of the intervals.
    causes
        Whether parameters are averaged over the causes of the diagnosis (`mcstudy.identification.averaged`). None:
        where there is a gap and no effect is added.

    Raises
    ------
    InputError
        ``level`` is not between 0.5 and 1, or ``causes`` is true and effects are added.
    """

    effects: Sequence[str] = ()
    quantities: Sequence[str] | Mapping[str, Any] = ()
    bounds: Mapping[str, tuple[float, float]] | None = None
    level: float = 0.95
    causes: bool | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.5 <= self.level < 1:
            raise InputError(f"level: expected a number from 0.5 to below 1, got {self.level!r}")
        if self.causes and self.effects:
            raise InputError(f"causes: expected no added effects, got {', '.join(self.effects)}; the average has all")


@dataclass(frozen=True)
class FitMethod:
    """How a fit was made.

    Attributes
    ----------
    cost
        What was minimised: "ml", the negative log likelihood.
    seed
        Seed of all random numbers.
    effects
        Names of the effects that were added to the model.
    fmax
        Highest frequency used, Hz; None for lines without a recording.
    discard
        Cycles left out at the start of every trial, or those of each recording of a joint set; None likewise.
    """

    cost: str
    seed: int
    effects: tuple[str, ...]
    fmax: float | None = None
    discard: Discard | None = None

    def to_dict(self) -> dict[str, Any]:
        """What is known, by name."""
        known = {name: value for name, value in vars(self).items() if value is not None}
        return {**known, "effects": list(self.effects)}
