"""Ranges of physical quantities: far wider than any standing person, narrow enough that arithmetic stays sound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Within:
    """Smallest and largest believable value of a quantity, in ``unit``."""

    low: float
    high: float
    unit: str

    def fault(self, value: Any) -> str:
        """What is wrong with a value, as "expected ..., got ..."; empty when it lies within (nan never does)."""
        if self.low <= value <= self.high:
            return ""
        return f"expected a number from {self.low:g} to {self.high:g} {self.unit}".rstrip() + f", got {_words(value)}"


def within(low: float, high: float, unit: str) -> Mapping[str, Within]:
    """Metadata of a dataclass field that declare its range."""
    return {"within": Within(low, high, unit)}


def _words(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float) else repr(value)[:60]
