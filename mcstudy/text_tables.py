"""Numbers and columns as plain text."""

from __future__ import annotations

import math
from collections.abc import Sequence


def number(value: float | None, digits: int = 3) -> str:
    """A number to ``digits`` significant digits, or a dash."""
    if value is None:
        return "-"
    if value != 0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.{digits - 1}e}"
    decimals = digits - 1 - (math.floor(math.log10(abs(value))) if value else 0)
    return f"{round(value, decimals):.{max(decimals, 0)}f}"


def with_error(value: float | None, mcse: float | None) -> str:
    """``value ± mcse``, both to the second digit of the error."""
    if value is None or mcse is None or mcse <= 0:
        return number(value)
    if not 1e-3 <= max(abs(value), mcse) < 1e5:
        return f"{number(value, 2)} ± {number(mcse, 2)}"
    decimals = max(1 - math.floor(math.log10(mcse)), 0)
    if decimals > 5:
        return f"{number(value)} ± {number(mcse, 2)}"
    return f"{value:.{decimals}f} ± {mcse:.{decimals}f}"


def counted(n: int, what: str) -> str:
    """``1 start``, ``2 starts``."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, of_text: bool = False) -> str:
    """A text table with columns of minimal width; the first is left-aligned, the others are right-aligned.

    ``of_text``: all columns are left-aligned, with one rule under all headings.
    """
    widths = [max(len(line[i]) for line in (header, *rows)) for i in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        aligned = (
            c.ljust(w) if of_text or i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(cells, widths, strict=True))
        )
        return "  ".join(aligned).rstrip()

    first, *rest = (line(cells) for cells in (header, *rows))
    rule = "-" * max(map(len, (first, *rest))) if of_text else line(["-" * w for w in widths])
    return "\n".join([first, rule, *rest])
