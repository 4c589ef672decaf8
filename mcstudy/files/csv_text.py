"""CSV text that people open in a spreadsheet: numbers stay numbers, and no text of others is taken for a formula."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from typing import Any

FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠")
"""How a cell begins that a spreadsheet computes instead of showing it."""


def csv_text(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A header and rows as CSV, without the last line end: numbers in full, NaN as an empty field, texts quoted.

    A text that a spreadsheet would compute gets an apostrophe in front, which it hides.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    for row in (header, *rows):
        writer.writerow([_cell(value) for value in row])
    return out.getvalue().removesuffix("\n")


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        return f"'{value}" if value.lstrip(" ").startswith(FORMULA) and not _number(value) else value
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return value.item() if hasattr(value, "item") else value


def _number(text: str) -> bool:
    if text.strip() == "-":  # the dash of an empty cell
        return True
    try:
        float(text)
    except ValueError:
        return False
    return text.isascii() and text.isprintable()
