"""When a parameter counts as determined by the data; plain numbers, so that kept tables need no library for it."""

from __future__ import annotations

DETERMINED = 0.2
"""Largest CV of a parameter that counts as determined, as in the paper."""

OFTEN = 0.05
"""Fraction of estimates on a bound from which the bounds have a part in what is estimated."""

LOST = 0.5
"""CV, and fraction of estimates on a bound, from which a parameter counts as not determined."""


def determined(cv: float | None, on_bound: float) -> bool:
    """Whether the CV is below 20 %, and not because of the bounds of the fit."""
    return cv is not None and cv < DETERMINED and on_bound < OFTEN


def lost(cv: float | None, on_bound: float) -> bool:
    """Whether half of the estimates lie on a bound, or they scatter by half of the true value."""
    return cv is None or cv >= LOST or on_bound >= LOST
