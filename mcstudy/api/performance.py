"""Performance of estimates made elsewhere."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from mcstudy.analysis import performance as measures
from mcstudy.analysis.montecarlo import REALIZATION
from mcstudy.analysis.selection import ERROR
from mcstudy.errors import InputError, StoreError
from mcstudy.files.untrusted import real_bytes

KEYS = (REALIZATION, "parameter")
VALUES = ("estimate", "truth")

LARGEST_TABLE = 1 << 30
"""Bytes of a CSV file."""


def performance(
    data: pd.DataFrame | xr.Dataset | Mapping[str, Sequence[Any]] | str | Path,
    *,
    reference: str | None = None,
    level: float = 0.95,
) -> xr.Dataset:
    """Performance of estimates made by any program: bias, errors, coverage, and precision of one method over another.

    Parameters
    ----------
    data
        A table with the columns ``parameter``, ``realization``, ``estimate``, ``truth``, and where they exist
        ``standard_error`` and ``method``: one row per realization, parameter and method. Or a CSV file with these
        columns. Or a Dataset with variables ``estimate``, ``truth`` and ``standard_error`` and a dim ``realization``.
        A missing estimate or standard error is NaN, in a file an empty field, NA or NaN.
    reference
        Method to which ``relative_precision`` refers; the first in the table by default.
    level
        Of the normal intervals whose coverage is counted, 0 to 1.

    Returns
    -------
    xarray.Dataset
        Dims (measure, parameter), and method where given. ``value``, ``mcse`` (Monte Carlo standard error), ``n`` and
        ``left_out``; ``lower`` and ``upper`` for coverages. Measures and formulas: Morris, White & Crowther 2019,
        Statistics in Medicine 38:2074. ``relative_precision``, in percent, is paired by realization.

    Raises
    ------
    InputError
        A column is missing, a row is there twice, a true value is missing or not the same in all rows, a standard error
        is negative, or the level or the method does not exist.
    """
    if not 0 < level < 1:
        raise InputError(f"level: expected a number between 0 and 1, got {level!r}")
    if isinstance(data, (str, Path)):
        try:
            return performance(_read(Path(data)), reference=reference, level=level)
        except InputError as error:
            raise InputError(f"{data}: {error}") from None
    cells = data if isinstance(data, xr.Dataset) else _cells(_table(data))
    for name in VALUES:
        if name not in cells:
            raise InputError(f"{name}: expected a variable of this name, got {', '.join(map(str, cells.data_vars))}")
    if REALIZATION not in cells["estimate"].dims:
        raise InputError(f"estimate: expected a dim 'realization', got {', '.join(map(str, cells['estimate'].dims))}")
    standard = cells.get(ERROR)
    if standard is not None and bool((standard < 0).any()):
        raise InputError(f"{ERROR}: expected no negative value, got {float(standard.min()):g}")
    found = measures.performance(cells["estimate"], cells["truth"], standard, level)
    if "method" not in cells["estimate"].dims:
        if reference is not None:
            raise InputError(f"reference: expected a column 'method' to hold {reference!r}, got none")
        return found
    methods = [str(m) for m in cells["method"].values]
    if (reference := methods[0] if reference is None else reference) not in methods:
        raise InputError(f"reference: expected one of {', '.join(methods)}, got {reference!r}")
    other = cells["estimate"].sel({"method": reference}, drop=True)
    gain = measures.relative_precision(cells["estimate"], other).expand_dims(measure=[measures.PRECISION.key])
    gain[["value", "mcse"]] = gain[["value", "mcse"]].where(cells["method"] != reference)
    plain = found.drop_vars(["meaning", "measure_unit"])
    return measures.described(xr.concat([plain, gain], dim="measure", coords="minimal", compat="override"))


def _read(path: Path) -> pd.DataFrame:
    """The table of a CSV file; the message of an error does not repeat the file's name."""
    try:
        text = real_bytes(path, LARGEST_TABLE, follow=True).decode("utf-8-sig")
        first = text.partition("\n")[0]
        separator = next((s for s in ("\t", ";") if s in first), ",")
        return pd.read_csv(io.StringIO(text), sep=separator, skipinitialspace=True)
    except (OSError, StoreError) as error:
        why = getattr(error, "strerror", None) or str(error).removeprefix(f"{path}: ")
        raise InputError(f"cannot be read: {why}") from None
    except UnicodeDecodeError:
        raise InputError("expected UTF-8 text") from None
    except ValueError as error:  # pandas raises subclasses of it for text that is no table
        raise InputError(f"expected a CSV file with a header ({' '.join(str(error).split())})") from None


def _table(data: pd.DataFrame | Mapping[str, Sequence[Any]]) -> pd.DataFrame:
    try:
        table = pd.DataFrame(data)
    except (TypeError, ValueError) as error:
        raise InputError(f"data: expected a table, a Dataset or columns of equal length ({error})") from None
    for name in (*KEYS, *VALUES):
        if name not in table:
            held = ", ".join(map(str, table.columns)) or "none"
            raise InputError(f"{name}: expected a column of this name, got {held}")
    for name in (*VALUES, *([ERROR] if ERROR in table else [])):
        try:
            table[name] = pd.to_numeric(table[name]).astype(float)
        except (TypeError, ValueError):
            raise InputError(f"{name}: expected numbers") from None
        if np.isinf(table[name]).any():
            raise InputError(f"{name}: expected finite numbers or NaN, got infinity")
    return table


def _cells(table: pd.DataFrame) -> xr.Dataset:
    keys = [*(["method"] if "method" in table else []), *KEYS]
    twice = table[table.duplicated(keys)]
    if len(twice):
        where = ", ".join(f"{k} {twice.iloc[0][k]}" for k in keys)
        raise InputError(f"data: expected one row per {', '.join(keys)}, got two for {where}")
    for name, values in table.groupby("parameter", sort=False)["truth"]:
        if values.isna().any() or values.nunique() != 1:
            raise InputError(f"truth: expected the same number in all rows of parameter {name}")
    wanted = ["estimate", *([ERROR] if ERROR in table else [])]
    cells = xr.Dataset.from_dataframe(table.set_index(keys)[wanted])
    order = {k: pd.unique(table[k]) for k in keys if k != REALIZATION}  # as in the table, not by name
    truth = table.groupby("parameter", sort=False)["truth"].first().to_xarray()
    return cells.assign(truth=truth).reindex(order)
