"""Stability of the closed loop at the estimate and over the intervals, along the paths of the profiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.identification.estimate import Estimate
from mcstudy.stance.feedback import Model
from mcstudy.stance.stability import rightmost_root


@dataclass(frozen=True)
class StableRange:
    """Where along the profile of a quantity the closed loop is stable.

    Attributes
    ----------
    name
        The quantity.
    low, high
        Smallest and largest value among the stable bodies of the profile.
    whole
        Whether all bodies of the profile are stable; then these are the ends of the interval.
    """

    name: str
    low: float
    high: float
    whole: bool


@dataclass(frozen=True)
class Stability:
    """The rightmost characteristic root of the closed loop.

    Attributes
    ----------
    growth
        Its real part at the estimate, 1/s; negative is stable. The slowest mode decays with this rate.
    frequency_hz
        Frequency of that mode; 0 without oscillation.
    low, high
        Range of the real part over all bodies that fit as well, 1/s.
    ranges
        The stable range of every quantity (`StableRange`).
    """

    growth: float
    frequency_hz: float
    low: float
    high: float
    ranges: tuple[StableRange, ...]

    @property
    def stable(self) -> bool:
        """Whether the loop is stable over all intervals."""
        return self.high < 0


def stability(model: Model, theta: np.ndarray, estimates: Sequence[Estimate]) -> Stability:
    """Stability at ``theta`` (P,) and along the profiles of ``estimates``."""
    at = complex(rightmost_root(model, theta).root)
    growth = [rightmost_root(model, e.profile.theta).root.real for e in estimates]
    return Stability(
        growth=at.real,
        frequency_hz=abs(at.imag) / (2 * np.pi),
        low=float(min(g.min() for g in growth)),
        high=float(max(g.max() for g in growth)),
        ranges=tuple(_range(e, g < 0) for e, g in zip(estimates, growth, strict=True)),
    )


def _range(e: Estimate, stable: np.ndarray) -> StableRange:
    value = e.profile.value[stable]
    ends = (float(value.min()), float(value.max())) if value.size else (e.estimate, e.estimate)
    return StableRange(e.name, *ends, bool(stable.all()))
