"""Ranges of physical quantities: far wider than any person or robot, narrow enough that arithmetic stays sound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mcstudy.errors import InputError


@dataclass(frozen=True, slots=True)
class Range:
    """Allowed range of a number. In the annotation of a pydantic field, pydantic checks it.

    Attributes
    ----------
    low, high: smallest and largest value, or size with ``signed``. unit: of both, for people.
    or_zero: whether 0 is allowed below ``low``. signed: whether minus the value is allowed where the value is.
    """

    low: float
    high: float
    unit: str = ""
    or_zero: bool = False
    signed: bool = False

    def __str__(self) -> str:
        zero, sign = "0 or " if self.or_zero else "", " of either sign" if self.signed else ""
        return f"{zero}a number from {self.low:g} to {self.high:g}{self.unit and ' ' + self.unit}{sign}"

    def __contains__(self, value: float) -> bool:
        size = abs(value) if self.signed else value
        return self.low <= size <= self.high or (self.or_zero and value == 0)

    def fault(self, value: float) -> str:
        """What is wrong with a value, as "expected ..., got ..."; empty when it lies within (nan never does)."""
        return "" if value in self else f"expected {self}, got {value:.9g}"

    def require(self, value: float, where: str) -> float:
        """The value of an option or argument called ``where``; raises `InputError`, one line, when it lies outside."""
        if fault := self.fault(value):
            raise InputError(f"{where}: {fault}")
        return value

    def check(self, value: float) -> float:
        """The value; raises `ValueError` when it lies outside."""
        if value not in self:
            raise ValueError(f"expected {self}")
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema  # the physics does without pydantic

        return core_schema.no_info_after_validator_function(self.check, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {**handler(schema), "description": str(self)}


def within(low: float, high: float, unit: str) -> Mapping[str, Range]:
    """Metadata of a dataclass field that declare its range."""
    return {"within": Range(low, high, unit)}


GAIN = Range(1e-9, 1e9, or_zero=True, signed=True)
"""True values of gains, N m/rad or N m s/rad; a person has up to some 1e3."""

DELAY = Range(1e-9, 10.0, "s", or_zero=True)
"""Delays and their bounds; a person has some 0.1 s."""

WEIGHT = Range(0.0, 1.0)
"""Sensory weights."""

AMPLITUDE = Range(1e-6, 1e6)
"""N m, m or rad."""

LARGEST_TILT = 0.2
"""Largest peak of a tilt, rad (11.5 deg): experiments with standing people stay below; more is a value in deg."""

RATE = Range(1e-6, 1e6, "Hz")
"""Sampling rates of what is simulated."""

MAX_SAMPLES = 4_000_000
"""Longest record that is simulated: preparing one takes about half a kilobyte per sample."""
