"""Numbers as pages write them."""

from __future__ import annotations

from typing import Any

from mcstudy.text_tables import number, with_error


def finite(x: Any) -> float | None:
    """A float, or None where there is none or it is not finite."""
    if x is None:
        return None
    value = float(x)
    return value if value - value == 0 else None


def short(x: Any, digits: int = 3) -> str:
    """A number for people."""
    return number(finite(x), digits)


LEAST_PERCENT = 0.01
"""Smallest chance, in percent, that is worth a number of its own."""


def chance(share: Any, mcse: Any = None) -> str:
    """A chance in percent, with its Monte Carlo error if given; tiny ones as a limit."""
    value, error = finite(share), finite(mcse)
    if value is not None and 100 * value < LEAST_PERCENT:
        return f"< {LEAST_PERCENT}"
    scaled = None if value is None else 100 * value
    return number(scaled, 2) if error is None else with_error(scaled, 100 * error)
