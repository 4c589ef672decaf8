"""The chance of a missed minimum in words: no more precise than it is known."""

from __future__ import annotations

import math
from typing import Any

from mcstudy.fitting.status import WANTED
from mcstudy.text_tables import number, with_error


def missed_words(cell: dict[str, Any], error: bool = False) -> str:
    """In percent, of a cell of the tables; ``error``: with its Monte Carlo error."""
    chance, limit = cell["missed_minimum"], cell.get("missed_minimum_upper")
    alone = sum(cell["realizations"].values()) == 1
    upper = limit["value"] if limit is not None and alone else None
    return missed_percent(chance["value"], chance["mcse"] if error else None, upper)


def missed_percent(chance: float | None, mcse: float | None = None, upper: float | None = None) -> str:
    """In percent, with its Monte Carlo error if given; a limit where it is below what is known of it.

    ``upper``: limit for one realization, whose own chance may be orders too small.
    """
    if chance is None or not math.isfinite(chance):
        return number(None)
    known = WANTED if upper is None or not math.isfinite(upper) else max(upper, WANTED)
    if chance < known:
        return f"< {100 * known:.2g}"
    return number(100 * chance, 2) if mcse is None or not math.isfinite(mcse) else with_error(100 * chance, 100 * mcse)
