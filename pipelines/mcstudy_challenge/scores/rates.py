"""Figures with uncertainty: a rate with Wilson's interval, a mean with the corresponding one for bounded values."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from mcstudy.fitting.certainty import score_interval


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval from n cases, and the oracle bound for the same cases (nan when there is none)."""

    value: float
    low: float
    high: float
    n: int
    ceiling: float = math.nan

    def to_dict(self) -> dict[str, float | int | None]:
        """For JSON: nan becomes null."""
        plain = {"value": self.value, "low": self.low, "high": self.high, "ceiling": self.ceiling}
        return {"n": self.n, **{k: None if math.isnan(v) else round(v, 5) for k, v in plain.items()}}

    def widened(self, factor: float) -> Estimate:
        """The same with an interval ``factor`` times as wide."""
        low, high = (self.value + factor * (x - self.value) for x in (self.low, self.high))
        return replace(self, low=low, high=high)

    def text(self, percent: bool = True) -> str:
        """As text: 93.1 % [90.2, 95.2]; a single case has no interval."""
        if self.n == 0 or math.isnan(self.value):
            return "no cases"
        scale, unit = (100.0, " %") if percent else (1.0, "")
        digits = 1 if percent else 2
        v, lo, hi = (f"{scale * x:.{digits}f}" for x in (self.value, self.low, self.high))
        return f"{v}{unit}" if math.isnan(self.low) else f"{v}{unit} [{lo}, {hi}]"


NO_CASES = Estimate(math.nan, math.nan, math.nan, 0)
"""No cases to count."""


def rate(hits: Iterable[bool], ceilings: Iterable[float] = ()) -> Estimate:
    """Fraction of successes with Wilson's 95 % interval; the oracle bound is the mean of ``ceilings``."""
    x = np.fromiter(hits, dtype=bool)
    n = x.size
    if n == 0:
        return NO_CASES
    k = float(x.mean())
    return Estimate(k, *_score_interval(k, 1.0, n), n, _mean(ceilings))


Bounds = tuple[float, float]
"""Smallest and largest possible value of one case."""

PROBABILITY: Bounds = (0.0, 1.0)


def mean(values: Iterable[float], ceilings: Iterable[float] = (), bounds: Bounds = PROBABILITY) -> Estimate:
    """Mean of bounded values with a 95 % score interval, which lies within the bounds; nan values are left out.

    The interval contains every mean mu that is within 1.96 standard errors sqrt(phi mu (1 - mu) / n) of the observed
    mean (in units of the bounds). phi is the observed variance divided by that of values at the bounds only. If all
    values lie at the bounds, this is Wilson's interval; far from the bounds it is the mean +- 1.96 standard errors.
    """
    x = np.fromiter(values, dtype=float)
    x = x[~np.isnan(x)]
    if x.size == 0:
        return NO_CASES
    low, high = bounds
    if x.min() < low or x.max() > high:
        raise ValueError(f"expected values from {low:g} to {high:g}, got {x.min():g} to {x.max():g}")
    value = float(x.mean())
    if x.size == 1:
        return Estimate(value, math.nan, math.nan, 1, _mean(ceilings))
    m = (value - low) / (high - low)
    most = m * (1 - m)
    phi = min(1.0, float(x.var(ddof=1)) / (high - low) ** 2 / most) if most > 0 else 1.0
    ends = _score_interval(m, phi, x.size)
    first, last = (low + (high - low) * end for end in ends)
    return Estimate(value, min(first, value), max(last, value), int(x.size), _mean(ceilings))


def _score_interval(m: float, phi: float, n: int) -> tuple[float, float]:
    """Ends of `score_interval`, rounding kept from crossing m and the bounds."""
    centre, half = map(float, score_interval(m, n, phi))
    return min(m, max(0.0, centre - half)), max(m, min(1.0, centre + half))


def _mean(values: Iterable[float]) -> float:
    x = np.fromiter(values, dtype=float)
    x = x[~np.isnan(x)]
    return float(x.mean()) if x.size else math.nan
