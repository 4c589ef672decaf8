"""The table of estimates in a CSV file: every row has as many cells as the header, and names stay text.

A parameter may be called ``1``, ``TRUE`` or ``NA``; only the columns of numbers have missing values.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from mcstudy.errors import InputError
from mcstudy.files.delimited import decimal_sign, number, read_labelled

LARGEST = 1 << 30
"""Bytes of a file."""

NO_ESTIMATE = (".", "-", "none")
"""What programs of statistics write for a missing estimate, in small letters."""


def read_estimates(
    path: Path, names: tuple[str, ...], numbers: tuple[str, ...], required: tuple[str, ...]
) -> pd.DataFrame:
    """Columns of a CSV file with a header, as `mcstudy.files.delimited` reads it.

    ``names``: columns of text; each cell must hold one. ``numbers``: columns of numbers, NaN where they are missing.
    Columns that are not ``required`` may be missing; others are not read. Raises `InputError` with the line and the
    column; the message does not repeat the file's name.
    """
    table = read_labelled(path, LARGEST, name_rows=False)
    try:
        kept = {n: table.column(n) for n in (*names, *numbers) if n in required or n in table.header}
        lines = [line for line, _ in table.rows]
        columns = {n: [cells[k] for _, cells in table.rows] for n, k in kept.items()}
        decimal = decimal_sign([c for n in numbers for c in columns.get(n, ())])
    except ValueError as error:
        raise InputError(str(error)) from None
    for name in names:
        if "" in columns.get(name, ()):
            raise InputError(f"line {lines[columns[name].index('')]}: {name}: expected a name, got an empty cell")
    return pd.DataFrame(
        {
            n: _floats(n, cells, lines, decimal) if n in numbers else np.array(cells, dtype=object)
            for n, cells in columns.items()
        }
    )


def _floats(name: str, cells: list[str], lines: list[int], decimal: str) -> np.ndarray:
    """Numbers of a column; an error names the first cell that is none."""
    values = [number("" if c.lower() in NO_ESTIMATE else c, decimal) for c in cells]
    if None in values:
        k = values.index(None)
        hint = "; write all numbers with decimal points" if "," in cells[k] else ""
        raise InputError(f"line {lines[k]}: {name}: expected a number, got {cells[k][:40]!r}{hint}")
    return np.array(values, dtype=float)
