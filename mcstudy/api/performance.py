"""Performance of estimates made elsewhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from mcstudy.analysis import performance as measures
from mcstudy.analysis.estimates_file import read_estimates
from mcstudy.analysis.montecarlo import REALIZATION
from mcstudy.analysis.selection import ERROR
from mcstudy.errors import InputError
from mcstudy.files.local_path import local_path

PARAMETER = "parameter"
KEYS = (REALIZATION, PARAMETER)
VALUES = ("estimate", "truth")

LARGEST = 1e100
"""Size of an estimate, a truth or a standard error at most: their squares are numbers still."""

METHOD = "method"
"""Column of the methods."""

ESTIMATOR = "estimator"
"""Dim of the methods: `xarray.Dataset.sel` has an argument that is called method."""


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
        columns; a semicolon or a tab may separate its fields, with decimal commas then. Or a Dataset with variables
        ``estimate``, ``truth`` and ``standard_error``, a dim ``realization`` and maybe a dim ``estimator`` (the
        methods). A missing estimate or standard error is NaN, in a file an empty field, NA or NaN. Parameters and
        methods of a table are names: 1 becomes ``"1"``.
    reference
        Method to which ``relative_precision`` refers; the first in the table by default.
    level
        Of the normal intervals whose coverage is counted, 0 to 1.

    Returns
    -------
    xarray.Dataset
        Dims (measure, parameter), and ``estimator`` where there are methods. ``value``, ``mcse`` (Monte Carlo standard
        error), ``n`` and ``left_out``; ``lower`` and ``upper`` for coverages. Measures and formulas: Morris, White &
        Crowther 2019, Statistics in Medicine 38:2074. ``relative_precision``, in percent, is paired by realization.

    Raises
    ------
    InputError
        A column is missing or there twice, a row is there twice or has more or fewer fields than the header, a true
        value is missing or not the same in all rows, a standard error is negative, or the level or the method does not
        exist.
    """
    if not 0 < level < 1:
        raise InputError(f"level: expected a number between 0 and 1, got {level!r}")
    if isinstance(data, (str, Path)):
        try:
            return performance(_read(local_path(data)), reference=reference, level=level)
        except InputError as error:
            raise InputError(f"{data}: {error}") from None
    cells = data if isinstance(data, xr.Dataset) else _cells(_table(data))
    if METHOD in cells.dims:
        cells = cells.rename({METHOD: ESTIMATOR})
    for name in VALUES:
        if name not in cells:
            raise InputError(f"{name}: expected a variable of this name, got {', '.join(map(str, cells.data_vars))}")
    if REALIZATION not in cells["estimate"].dims:
        raise InputError(f"estimate: expected a dim 'realization', got {', '.join(map(str, cells['estimate'].dims))}")
    if 0 in cells["estimate"].shape:
        raise InputError("estimate: expected at least one value, got none")
    for name in (*VALUES, ERROR):
        if name in cells:
            _require_numbers(name, cells[name])
    standard = cells.get(ERROR)
    if standard is not None and bool((standard < 0).any()):
        raise InputError(f"{ERROR}: expected no negative value, got {float(standard.min()):g}")
    measured = measures.performance(cells["estimate"], cells["truth"], standard, level)
    if ESTIMATOR not in cells["estimate"].dims:
        if reference is not None:
            raise InputError(f"reference: expected a column 'method' to hold {reference!r}, got none")
        return measured
    methods = [str(m) for m in cells[ESTIMATOR].values]
    if (reference := methods[0] if reference is None else reference) not in methods:
        raise InputError(f"reference: expected one of {', '.join(methods)}, got {reference!r}")
    other = cells["estimate"].isel({ESTIMATOR: methods.index(reference)}, drop=True)
    gain = measures.relative_precision(cells["estimate"], other).expand_dims(measure=[measures.PRECISION.key])
    others = xr.DataArray([m != reference for m in methods], dims=ESTIMATOR)
    gain[["value", "mcse"]] = gain[["value", "mcse"]].where(others)
    plain = measured.drop_vars(["meaning", "measure_unit"])
    return measures.described(xr.concat([plain, gain], dim="measure", coords="minimal", compat="override"))


def _read(path: Path) -> pd.DataFrame:
    """The table of a CSV file, whose methods may have either name."""
    table = read_estimates(path, (METHOD, ESTIMATOR, *KEYS), (*VALUES, ERROR), required=(*KEYS, *VALUES))
    realization = pd.to_numeric(table[REALIZATION], errors="coerce")
    if np.isfinite(realization).all():
        table[REALIZATION] = realization
    return table


def _table(data: pd.DataFrame | Mapping[str, Sequence[Any]]) -> pd.DataFrame:
    try:
        table = pd.DataFrame(data).copy()
    except (TypeError, ValueError) as error:
        raise InputError(f"data: expected a table, a Dataset or columns of equal length ({error})") from None
    for name in (*KEYS, *VALUES):
        if name not in table:
            held = ", ".join(map(str, table.columns)) or "none"
            raise InputError(f"{name}: expected a column of this name, got {held}")
    for name in (*KEYS, *VALUES, METHOD, ESTIMATOR, ERROR):
        if (count := list(table.columns).count(name)) > 1:
            raise InputError(f"{name}: expected one column of this name, got {count}")
    if ESTIMATOR in table:
        if METHOD in table:
            raise InputError(f"{ESTIMATOR}: expected one column of methods, got {METHOD} too")
        table = table.rename(columns={ESTIMATOR: METHOD})
    if not len(table):
        raise InputError("data: expected at least one row")
    for name in (PARAMETER, *([METHOD] if METHOD in table else [])):
        if table[name].isna().any() or (table[name] == "").any():
            raise InputError(f"{name}: expected a name in every row")
        table[name] = [str(label) for label in table[name]]
    if table[REALIZATION].isna().any():
        raise InputError(f"{REALIZATION}: expected a number or a name in every row")
    for name in (*VALUES, *([ERROR] if ERROR in table else [])):
        try:
            table[name] = pd.to_numeric(table[name]).astype(float)
        except (TypeError, ValueError):
            raise InputError(f"{name}: expected numbers") from None
    return table


def _require_numbers(name: str, values: xr.DataArray) -> None:
    """Raise `InputError` for what is no number, or too large a one."""
    if values.dtype.kind not in "iuf":
        raise InputError(f"{name}: expected numbers, got values of type {values.dtype}")
    if bool(np.isinf(values).any()):
        raise InputError(f"{name}: expected finite numbers or NaN, got infinity")
    if (largest := float(abs(values).max())) > LARGEST:
        raise InputError(f"{name}: expected numbers up to {LARGEST:g}, whose squares are numbers, got {largest:.3g}")


def _cells(table: pd.DataFrame) -> xr.Dataset:
    keys = [*([METHOD] if METHOD in table else []), *KEYS]
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
