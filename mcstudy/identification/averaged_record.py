"""The outcome of averaging over causes: each quantity without effects and averaged, and where its variance is from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

OUTSIDE = "outside the library"
"""A cause that is no effect of the library."""

NOTHING = "nothing missing"

WIDE = 1.0
"""Half-width of an interval relative to its middle from which a quantity is called not determined."""


@dataclass(frozen=True)
class CauseShare:
    """A cause with its weight in the average; no effects: nothing is missing. `OUTSIDE` may be beside effects."""

    effects: tuple[str, ...]
    probability: float

    @property
    def name(self) -> str:
        """In words."""
        return cause_name(self.effects)


@dataclass(frozen=True)
class AveragedQuantity:
    """One quantity of the model, without effects and averaged over the causes.

    Attributes
    ----------
    name, unit: as in `Estimate`. base, base_low, base_high: estimate and interval of the model without effects.
    estimate: median of the average. low, high: its interval. low_from, high_from: what ends it, "data" or "bound".
    data, form, cause: shares of its variance. moved_by: the cause that moved it most; empty where none did.
    """

    name: str
    unit: str
    base: float
    base_low: float
    base_high: float
    estimate: float
    low: float
    high: float
    low_from: str
    high_from: str
    data: float
    form: float
    cause: float
    moved_by: str

    @property
    def determined(self) -> bool:
        """Whether data end the interval on both sides, and it does not reach as far as the estimate is large."""
        return self.low_from == self.high_from == "data" and self.high - self.low < 2 * WIDE * abs(self.estimate)

    @property
    def moved(self) -> float:
        """How far the estimate moved, in standard errors of the model without effects."""
        half = (self.base_high - self.base_low) / 2
        return 1.96 * (self.estimate - self.base) / half if half > 0 else 0.0


@dataclass(frozen=True)
class Averaged:
    """Parameters averaged over causes: the ``causes``, most probable first, and the ``quantities`` by name."""

    causes: tuple[CauseShare, ...]
    quantities: tuple[AveragedQuantity, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "causes": [{"effects": c.effects, "probability": c.probability} for c in self.causes],
            "quantities": [{**vars(q), "determined": q.determined} for q in self.quantities],
        }

    def __getitem__(self, name: str) -> AveragedQuantity:
        for q in self.quantities:
            if q.name == name:
                return q
        raise KeyError(f"{name!r}; expected one of {', '.join(q.name for q in self.quantities)}")


def cause_name(effects: Sequence[str]) -> str:
    """A cause in words."""
    return " and ".join(effects) if effects else NOTHING
