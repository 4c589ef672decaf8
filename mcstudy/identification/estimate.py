"""One quantity of a fit: its estimate, its interval and what ends it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.identification.profile import Profile
from mcstudy.text_tables import number

BANDS_HZ = (0.0, 0.3, 1.0, 3.0, np.inf)
"""Edges of the bands by which the information on a quantity is told."""

ENDED = {"data": "", "bound": " (bound)", "not finite": " (not defined beyond)", "steps": ""}
"""What is printed behind an end of an interval, by what ends it."""

AT_MOST, AT_LEAST = "≤", "≥"
"""In front of a lower and an upper end that the search did not reach: the interval extends at least to there."""


@dataclass(frozen=True, repr=False)
class Estimate:
    """One quantity of a fit.

    Attributes
    ----------
    name, unit
        A parameter and its unit, or an expression; the unit is empty when it is not known.
    estimate
        Value at the lowest minimum.
    low, high
        Profile likelihood interval.
    low_from, high_from
        What ends it: "data", "bound" (of the parameters), "not finite" (the quantity is not defined beyond) or "steps"
        (the search did not converge: the interval extends at least to there).
    wald_low, wald_high
        Gauss-Newton interval, for comparison; nan on a bound.
    information
        Share of the information in the bands below 0.3, 1 and 3 Hz, and above; sums to 1.
    profile
        The profile (`Profile`).
    """

    name: str
    unit: str
    estimate: float
    low: float
    high: float
    low_from: str
    high_from: str
    wald_low: float
    wald_high: float
    information: tuple[float, ...]
    profile: Profile

    def __repr__(self) -> str:
        return f"{self.name} = {with_unit(self)}"

    @property
    def verdict(self) -> str:
        """One of "identifiable", "lower limit only", "upper limit only" or "not identifiable"."""
        return determined(self.low_from, self.high_from, "identifiable")

    @property
    def half_width(self) -> float:
        """Half of the interval."""
        return (self.high - self.low) / 2


def determined(low_from: str, high_from: str, word: str) -> str:
    """Whether data end an interval: ``word``, "lower limit only", "upper limit only" or "not" with ``word``."""
    if low_from == high_from == "data":
        return word
    return "lower limit only" if low_from == "data" else "upper limit only" if high_from == "data" else f"not {word}"


def interval(e: Estimate, below: str = "", above: str = "") -> str:
    """``586 to 1309``, with what ends it where that is not the data; ``below`` and ``above``: marks behind its ends."""
    at_most, at_least = (AT_MOST if e.low_from == "steps" else ""), (AT_LEAST if e.high_from == "steps" else "")
    low, high = f"{number(e.low)}{ENDED[e.low_from]}{below}", f"{number(e.high)}{ENDED[e.high_from]}{above}"
    return f"{at_most}{low} to {at_least}{high}"


def with_unit(e: Estimate) -> str:
    """``815, 586 to 1309 N m/rad``: estimate and interval on one line."""
    return f"{number(e.estimate)}, {interval(e)} {e.unit}".rstrip()
