"""Best fits as the quantities that a model declares (`mcstudy.stance.feedback.Derived`), instead of its parameters.

Statistics of these cells are those of the quantities: mean, bias and spread over realizations of each quantity itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing  # documented: "How to add a new backend", lazy loading

from mcstudy.analysis.context import fitted_model
from mcstudy.analysis.labels import relabelled
from mcstudy.analysis.selection import INSIDE, inside_bounds
from mcstudy.errors import InputError
from mcstudy.models import quantities
from mcstudy.models.quantities import Quantity
from mcstudy.study.cube.conversion import PARAMETER_UNIT


def derived(cells: xr.Dataset) -> xr.Dataset:
    """Best fits whose ``parameter`` are the quantities that the model derives from its parameters.

    ``derived().mc`` has their statistics. Bounds of a quantity are not defined; ``inside_bounds`` says whether the fit
    touched any. Raises `InputError` when the model declares none.
    """
    return _cells(cells, _derived(cells), _values)


def combined(cells: xr.Dataset) -> xr.Dataset:
    """Best fits with active and passive stiffness of each joint summed: the paper's 10 numbers.

    Of any model, its declared sums in place of what they add up. ``parameter`` then has ``"K11+Kpas1"`` and
    ``"K22+Kpas2"``; ``combined().mc`` has the statistics. Bounds of a sum are not defined; ``inside_bounds`` says
    whether the fit touched any. Raises `InputError` when the model has no such pair.
    """
    return _cells(cells, _combined(cells), _values)


def derived_when_read(cells: xr.Dataset) -> xr.Dataset:
    """`derived` cells in memory, whose estimates take none of their own: they are computed wherever they are read."""
    return _cells(cells, _derived(cells), _when_read)


def combined_when_read(cells: xr.Dataset) -> xr.Dataset:
    """The same for `combined`."""
    return _cells(cells, _combined(cells), _when_read)


def _derived(cells: xr.Dataset) -> list[Quantity]:
    model = fitted_model(cells)
    declared = quantities.derived(model)
    if not declared or list(model.names) != _names(cells):
        raise InputError(f"parameter: no quantity that the model derives from {', '.join(_names(cells))}")
    return list(declared)


def _combined(cells: xr.Dataset) -> list[Quantity]:
    model = fitted_model(cells)
    sums = quantities.sums(model)
    if not sums or list(model.names) != _names(cells):
        raise InputError(f"parameter: no active and passive stiffness to combine among {', '.join(_names(cells))}")
    gone = {n for members in sums.values() for n in members}
    declared = [q for q in quantities.derived(model) if q.name in sums]
    return declared + [quantities.parameter(model, n) for n in model.names if n not in gone]


def _names(cells: xr.Dataset) -> list[str]:
    return [str(n) for n in cells["parameter"].values]


def _values(x: xr.DataArray, wanted: list[Quantity]) -> xr.DataArray:
    values: xr.DataArray = xr.apply_ufunc(
        lambda theta: np.stack([_value(q, theta) for q in wanted], axis=-1),
        x,
        input_core_dims=[["parameter"]],
        output_core_dims=[["parameter"]],
        exclude_dims={"parameter"},
        dask="parallelized",
        dask_gufunc_kwargs={"output_sizes": {"parameter": len(wanted)}, "allow_rechunk": True},
        output_dtypes=[x.dtype],
    )
    return values.transpose(*x.dims)


def _value(q: Quantity, theta: np.ndarray) -> np.ndarray:
    assert q.of is not None  # only Python functions have none, and a model declares none
    return q.of(theta)


def _when_read(x: xr.DataArray, wanted: list[Quantity]) -> xr.DataArray:
    if x.dims[-1] != "parameter":
        raise ValueError(f"expected parameter as the last dim, got {x.dims}")
    return xr.DataArray(xr.Variable(x.dims, indexing.LazilyIndexedArray(OfColumns(x.values, wanted))))


class OfColumns(BackendArray):
    """Quantities of the columns of an array (..., P), as an array (..., S) that xarray reads in parts."""

    def __init__(self, values: np.ndarray, wanted: list[Quantity]) -> None:
        self._values, self._wanted = values, wanted
        self.shape, self.dtype = (*values.shape[:-1], len(wanted)), values.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        basic = indexing.IndexingSupport.BASIC
        return np.asarray(indexing.explicit_indexing_adapter(key, self.shape, basic, self._read))

    def _read(self, key: tuple[int | slice, ...]) -> np.ndarray:
        *rest, last = key
        x = self._values[tuple(rest)]
        if isinstance(last, slice):
            return np.stack([_value(q, x) for q in self._wanted[last]], axis=-1)
        return np.asarray(_value(self._wanted[last], x))


def _cells(
    cells: xr.Dataset, wanted: list[Quantity], values: Callable[[xr.DataArray, list[Quantity]], xr.DataArray]
) -> xr.Dataset:
    """The cells with ``values`` of the wanted quantities in place of the parameters."""
    out = cells.drop_dims("parameter").assign_coords(parameter=[q.label for q in wanted])
    for name in ("estimate", "truth"):
        out[name] = values(cells[name], wanted).variable
        out[name].attrs = dict(cells[name].attrs)
    out["parameter"] = out["parameter"].assign_attrs(cells["parameter"].attrs)
    if PARAMETER_UNIT in cells:
        unit = ("parameter", np.array([q.unit for q in wanted], dtype=object), cells[PARAMETER_UNIT].attrs)
        out = out.assign_coords({PARAMETER_UNIT: unit})
    if "at_bound" in cells:
        out[INSIDE] = inside_bounds(cells)
    return relabelled(
        out,
        estimate=f"{cells['estimate'].attrs.get('long_name', 'estimate')}, as quantities that follow from them",
        truth="true value of the quantities that follow from the parameters",
    )
