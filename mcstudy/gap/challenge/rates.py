"""Figures with their uncertainty: a rate with Wilson's interval, a mean with its standard error."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

Z95 = 1.959963984540054


@dataclass(frozen=True)
class Figure:
    """A value with its 95 % interval from n cases, and the ceiling for these very cases (nan when there is none)."""

    value: float
    low: float
    high: float
    n: int
    ceiling: float = math.nan

    def to_dict(self) -> dict[str, float | int | None]:
        """For JSON: nan becomes null."""
        plain = {"value": self.value, "low": self.low, "high": self.high, "ceiling": self.ceiling}
        return {"n": self.n, **{k: None if math.isnan(v) else round(v, 5) for k, v in plain.items()}}

    def widened(self, factor: float) -> Figure:
        """The same with an interval ``factor`` times as wide."""
        low, high = (self.value + factor * (x - self.value) for x in (self.low, self.high))
        return replace(self, low=low, high=high)

    def text(self, percent: bool = True) -> str:
        """For people: 93.1 % [90.2, 95.2]."""
        if self.n == 0 or math.isnan(self.value):
            return "no cases"
        scale, unit = (100.0, " %") if percent else (1.0, "")
        digits = 1 if percent else 2
        v, lo, hi = (f"{scale * x:.{digits}f}" for x in (self.value, self.low, self.high))
        return f"{v}{unit} [{lo}, {hi}]"


NOTHING = Figure(math.nan, math.nan, math.nan, 0)
"""No cases to count."""


def rate(hits: Iterable[bool], ceilings: Iterable[float] = ()) -> Figure:
    """Share of hits with Wilson's 95 % interval; the ceiling is the mean of ``ceilings``."""
    x = np.fromiter(hits, dtype=bool)
    n = x.size
    if n == 0:
        return NOTHING
    k = float(x.mean())
    centre = (k + Z95**2 / (2 * n)) / (1 + Z95**2 / n)
    half = Z95 / (1 + Z95**2 / n) * math.sqrt(k * (1 - k) / n + Z95**2 / (4 * n**2))
    return Figure(k, min(k, max(0.0, centre - half)), max(k, min(1.0, centre + half)), n, _mean(ceilings))


def mean(values: Iterable[float], ceilings: Iterable[float] = ()) -> Figure:
    """Mean with 1.96 standard errors either side; values that are nan are left out."""
    x = np.fromiter(values, dtype=float)
    x = x[~np.isnan(x)]
    if x.size == 0:
        return NOTHING
    half = Z95 * float(x.std(ddof=1)) / math.sqrt(x.size) if x.size > 1 else math.nan
    return Figure(float(x.mean()), float(x.mean()) - half, float(x.mean()) + half, int(x.size), _mean(ceilings))


def _mean(values: Iterable[float]) -> float:
    x = np.fromiter(values, dtype=float)
    x = x[~np.isnan(x)]
    return float(x.mean()) if x.size else math.nan
