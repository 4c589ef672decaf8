"""Names and units of the variables of results, for tables, plots and files.

Arithmetic keeps the attributes of its input (an SD would be named like the estimates), so every function that makes a
result names all its variables with this module. One table names the numbers that accompany a statistic, another the
axes that results have and cubes do not.
"""

from __future__ import annotations

from typing import TypeVar

import xarray as xr

from mcstudy.study.cube.conversion import PARAMETER_UNIT

T = TypeVar("T", xr.Dataset, xr.DataArray)

ONE = "1"
"""Unit of pure numbers."""

PERCENT = "%"

EACH_ITS_OWN = "unit of the parameter"
"""Unit of a variable whose parameters have different units; the coordinate `PARAMETER_UNIT` holds them."""

Label = tuple[str, str]
"""Name and unit."""

_BESIDE: dict[str, str] = {
    "mcse": "Monte Carlo standard error of the {}",
    "lower": "lower end of the 95 % interval of the {}",
    "upper": "upper end of the 95 % interval of the {}",
    "floor": "{} expected from chance alone, without any bias",
}
"""Numbers that accompany a value, in its unit."""

_COUNTS: dict[str, str] = {"n": "realizations used", "left_out": "realizations left out"}

_AXES: dict[str, str] = {
    "basin": "rank of the local minimum by its cost",
    "cluster": "rank of the cluster by how often it is reached",
    "direction": "relative change of the parameter",
    "drawn": "number of starts",
    "loop": "loop at the start of the fit",
    "measure": "what is compared",
    "outcome": "how the fit ended",
    "parameter": "model parameter",
    "parameter_2": "model parameter",
    "quantile": "quantile over realizations",
    "range": "frequency range",
    "side": "side of the bound",
}
"""Axes that results have and cubes do not, or that results redefine."""

_PROVENANCE = ("fingerprint", "seed", "model", "truth_provenance")
"""Attributes of a group that its statistics keep, to identify their origin."""


def label(x: xr.DataArray, name: str, units: str = ONE) -> xr.DataArray:
    """``x`` with these attributes and no others."""
    out = x.copy(deep=False)
    out.attrs = {"long_name": name, "units": units}
    return _with_axes(out)


def labelled(
    result: xr.Dataset, source: xr.Dataset | None, name: str = "", units: str = ONE, **others: Label
) -> xr.Dataset:
    """A statistic with every variable named.

    Parameters
    ----------
    result: the computed statistic. source: its cube or cells, for the attributes `_PROVENANCE`.
    name, units: of ``value``; the numbers that accompany a value are named after it.
    others: name and unit of the other variables, by variable.

    Raises `KeyError` for a variable that nothing names.
    """
    known = {kind: (text.format(name), units) for kind, text in _BESIDE.items()}
    known |= {kind: (text, ONE) for kind, text in _COUNTS.items()} | {"value": (name, units)} | others
    out = result.copy(deep=False)
    for variable in out.data_vars:  # not `out[variable]`: that makes an array with coordinates first
        out.variables[variable].attrs = dict(zip(("long_name", "units"), known[str(variable)], strict=True))
    attributes = {} if source is None else source.attrs
    out.attrs = {k: attributes[k] for k in _PROVENANCE if k in attributes}
    return _with_axes(out)


def relabelled(data: xr.Dataset, **names: str) -> xr.Dataset:
    """``data`` with other names for those of its variables that it has; their units and flags stay."""
    out = data.copy(deep=False)
    for variable, name in names.items():
        if variable in out:
            out[variable].attrs = {**out[variable].attrs, "long_name": name}
    return out


def units_of(data: xr.Dataset) -> str:
    """Unit of the parameters if all have the same, else `EACH_ITS_OWN`."""
    units = set(map(str, data[PARAMETER_UNIT].values.ravel())) if PARAMETER_UNIT in data else set()
    return units.pop() if len(units) == 1 else EACH_ITS_OWN


def _with_axes(out: T) -> T:
    for axis, name in _AXES.items():
        if axis in out.coords and "long_name" not in out.coords[axis].attrs:
            units = {"units": ONE} if out[axis].dtype.kind in "if" else {}
            out = out.assign_coords({axis: out[axis].assign_attrs(long_name=name, **units)})
    return out
