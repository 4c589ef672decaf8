"""Conversion factors to the units used internally: rad, s, N m, m."""

from __future__ import annotations

import math

from mcstudy.errors import RecordingError

FACTORS: dict[str, dict[str, float]] = {
    "rad": {
        "rad": 1.0,
        "mrad": 1e-3,
        "deg": math.pi / 180,
        "degree": math.pi / 180,
        "degrees": math.pi / 180,
        "°": math.pi / 180,
    },
    "s": {"s": 1.0, "ms": 1e-3},
    "N m": {
        "N m": 1.0,
        "Nm": 1.0,
        "N*m": 1.0,
        "N.m": 1.0,
        "N mm": 1e-3,
        "Nmm": 1e-3,
        "kgf m": 9.80665,
        "kgf cm": 9.80665e-2,
    },
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
}
"""Accepted spellings per target unit; a kilogram-force is 9.80665 N (CGPM 1901)."""


def factor(unit: str, target: str, where: str) -> float:
    """Factor that converts values in ``unit`` to ``target``; `RecordingError` names ``where``."""
    try:
        return FACTORS[target][unit.strip()]
    except KeyError:
        raise RecordingError(f"{where}: unit: expected one of {', '.join(FACTORS[target])}, got {unit!r}") from None


def known(unit: str | None, target: str) -> float | None:
    """The same factor, None for a unit that is not known."""
    return None if unit is None else FACTORS[target].get(unit.strip())
