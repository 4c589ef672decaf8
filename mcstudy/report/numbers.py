"""Numbers as pages write them."""

from __future__ import annotations

from typing import Any

from mcstudy.text_tables import number


def finite(x: Any) -> float | None:
    """A float, or None where there is none or it is not finite."""
    if x is None:
        return None
    value = float(x)
    return value if value - value == 0 else None


def short(x: Any, digits: int = 3) -> str:
    """A number for people."""
    return number(finite(x), digits)
