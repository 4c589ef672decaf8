"""Selection of fits: the best start of every cell, and counts of the fits that were not used.

A *cell* is one (amplitude, fmax, realization); its starts are repeated attempts at the same problem. A *cube* is a
Dataset with the dim ``start``; `best` reduces it to *cells*, on which all accuracy statistics work.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing  # documented: "How to add a new backend", lazy loading

from mcstudy.analysis.labels import ONE, label, labelled, relabelled
from mcstudy.errors import InputError
from mcstudy.fitting.status import NOT_RUN, USABLE, Status
from mcstudy.study.cube.conversion import PARAMETER_UNIT

COMBINED: dict[str, tuple[str, ...]] = {
    "K11+Kpas1": ("K11", "Kpas1"),
    "K22+Kpas2": ("K22", "Kpas2"),
    "K+Kpas": ("K", "Kpas"),
}
"""Sums of the active and the passive stiffness of a joint (Goodworth & Peterka 2018, Fig. 6)."""

INSIDE = "inside_bounds"
"""Variable of `combined` cells that holds what `inside_bounds` says of the parameters they were combined from."""

ERROR = "standard_error"
"""Variable with the standard errors of the best fit, in a cube that holds them."""

_OF_THE_BEST = {
    "estimate": "parameters of the best fit",
    "cost": "cost of the best fit",
    "growth_rate": "real part of the rightmost characteristic root of the best fit; positive is unstable",
    "status": "how the best fit ended; pending is a fit that has not been run",
    "at_bound": "bound the parameter of the best fit lies on",
    "iterations": "evaluations of the model with its derivatives for the best fit",
    ERROR: "standard error of the parameters of the best fit",
}

_CONDITIONAL = ("estimate", "cost", "growth_rate", ERROR)

_ACCOUNT = {
    "used": "with a usable fit",
    "not_run": "not run yet",
    "non_finite": "whose data or weights were not finite",
    "diverged": "whose model was not finite from any start",
    "failed": "whose fits failed otherwise",
}


def usable(cube: xr.Dataset) -> xr.DataArray:
    """Which fits are usable: the solver ran and returned a finite cost. Dims of ``status``."""
    return cube["status"].isin(USABLE) & np.isfinite(cube["cost"])


def attempted(cube: xr.Dataset) -> xr.DataArray:
    """Which fits were run, usable or not. Dims of ``status``."""
    return ~cube["status"].isin(NOT_RUN)


def best(cube: xr.Dataset, allowed: xr.DataArray | None = None) -> xr.Dataset:
    """The usable fit of lowest cost in each cell; of equal costs the first start wins.

    Parameters
    ----------
    cube: with dims (amplitude, fmax, realization, start, parameter) in any order.
    allowed: which starts may win (e.g. ``cube.growth_rate < 0``, the stable ones); all by default. The result has
        every further dim of it.

    Returns
    -------
    The cube without its starts: ``estimate``, ``cost``, ``status``, ``at_bound``, ``growth_rate``, ``iterations`` of
    the winner, ``best_start`` (label, -1 where no start was usable, and the floats are then NaN) and
    ``usable_starts``; variables without starts are passed through. Lazy where the cube is.
    """
    ok = usable(cube) if allowed is None else usable(cube) & allowed
    any_ok = ok.any("start")
    index = _whole_starts(cube["cost"].where(ok, np.inf)).argmin("start")
    out = cube.drop_dims("start")
    for name in ("estimate", "cost", "growth_rate"):
        if name in cube:
            out[name] = take(cube[name], index).where(any_ok)
    for name in ("status", "at_bound", "iterations"):
        if name in cube:
            out[name] = take(cube[name], index)
    if ERROR in cube and allowed is not None:  # they are those of the best of all starts
        first = _whole_starts(cube["cost"].where(usable(cube), np.inf)).argmin("start")
        out[ERROR] = cube[ERROR].where(any_ok & (index == first))
    which = take(cube["start"].broadcast_like(index), index) if "start" in cube.coords else index
    out["best_start"] = label(which.where(any_ok, -1).astype("int64"), "start of the best fit; -1 where none is usable")
    out["usable_starts"] = label(ok.sum("start"), "usable starts")
    return relabelled(out, **_OF_THE_BEST)


def _whole_starts(x: xr.DataArray) -> xr.DataArray:
    return x if x.chunks is None else x.chunk({"start": -1})


def take(values: xr.DataArray, index: xr.DataArray) -> xr.DataArray:
    """``values`` at one start per cell, without moving more than a chunk of them."""
    out = xr.apply_ufunc(
        _take_block,
        _whole_starts(values),
        index,
        input_core_dims=[["start"], []],
        dask="parallelized",
        output_dtypes=[values.dtype],
        keep_attrs=True,
    )
    order = [d for d in values.dims if d != "start"]
    return out.transpose(*order, ...)


def _take_block(values: np.ndarray, index: np.ndarray) -> np.ndarray:
    return np.take_along_axis(values, index[..., None].astype(np.intp), axis=-1)[..., 0]


def outcomes(cube: xr.Dataset) -> xr.DataArray:
    """Counts of fits by status: dims (outcome, amplitude, fmax). Needs all starts."""
    counts = [(cube["status"] == int(s)).sum(["realization", "start"]) for s in Status]
    names = xr.DataArray([s.name.lower() for s in Status], dims="outcome", name="outcome")
    return label(xr.concat(counts, dim=names), "number of fits").rename("fits")


def realizations(cube: xr.Dataset) -> xr.Dataset:
    """Counts of realizations used, not run, with data not finite, diverged, failed. Needs all starts.

    Dims (amplitude, fmax): ``used``, one start is usable; ``not_run``, none is, and one is still pending;
    ``non_finite``, nothing could be fitted to the data; ``diverged``, the model was not finite from any start;
    ``failed``, the rest.
    """
    status = cube["status"]
    used = usable(cube).any("start")
    pending = ~used & (status == int(Status.PENDING)).any("start")
    ended = ~used & ~pending
    non_finite = ended & (status == int(Status.NON_FINITE_DATA)).all("start")
    diverged = ended & (status == int(Status.NON_FINITE_MODEL)).all("start")
    failed = ended & ~non_finite & ~diverged
    groups = {"used": used, "not_run": pending, "non_finite": non_finite, "diverged": diverged, "failed": failed}
    counts = xr.Dataset({name: which.sum("realization") for name, which in groups.items()})
    return labelled(counts, cube, "", ONE, **{name: (f"realizations {what}", ONE) for name, what in _ACCOUNT.items()})


def stable(cells: xr.Dataset) -> xr.DataArray:
    """Mask of cells whose best fit is a stable loop: bool (amplitude, fmax, realization)."""
    return label(cells["growth_rate"] < 0, "whether the best fit is a stable loop").rename("stable")


def inside_bounds(cells: xr.Dataset) -> xr.DataArray:
    """Mask of cells whose best fit touches no bound: bool (amplitude, fmax, realization)."""
    inside = cells[INSIDE] if INSIDE in cells else (cells["at_bound"] == 0).all("parameter")
    return label(inside, "whether the best fit touches no bound").rename(INSIDE)


def only(cells: xr.Dataset, mask: xr.DataArray) -> xr.Dataset:
    """Best fits where ``mask`` holds, the rest left out: conditional statistics.

    Parameters
    ----------
    mask
        bool (amplitude, fmax, realization), e.g. `stable` or `inside_bounds`.

    Returns
    -------
    xarray.Dataset
        As `best`; estimates where the mask does not hold are NaN, and are counted in ``left_out``.
    """
    out = cells.copy()
    for name in _CONDITIONAL:
        if name in cells:
            out[name] = cells[name].where(mask)
    return relabelled(out, **{name: f"{_OF_THE_BEST[name]}, selected fits only" for name in _CONDITIONAL})


def combined(cells: xr.Dataset) -> xr.Dataset:
    """Best fits with active and passive stiffness of each joint summed: the paper's 10 numbers.

    ``parameter`` then has ``"K11+Kpas1"`` and ``"K22+Kpas2"``; ``combined().mc`` has the statistics. Bounds of a
    sum are not defined; ``inside_bounds`` says whether the fit touched any. Raises `InputError` when the model has no
    such pair.
    """

    def total(x: xr.DataArray, members: list[list[int]]) -> xr.Variable:
        weights = np.zeros((len(members), x.sizes["parameter"]))
        for row, own in zip(weights, members, strict=True):
            row[own] = 1.0
        summed = xr.dot(x, xr.DataArray(weights, dims=("combined", "parameter")), dim="parameter")
        return summed.rename(combined="parameter").transpose(*x.dims).variable

    return _combined(cells, total)


def combined_when_read(cells: xr.Dataset) -> xr.Dataset:
    """`combined` cells in memory, whose estimates take none of their own: they are summed wherever they are read."""

    def total(x: xr.DataArray, members: list[list[int]]) -> xr.Variable:
        if x.dims[-1] != "parameter":
            raise ValueError(f"expected parameter as the last dim, got {x.dims}")
        return xr.Variable(x.dims, indexing.LazilyIndexedArray(SumsOfColumns(x.values, members)))

    return _combined(cells, total)


class SumsOfColumns(BackendArray):
    """Sums of columns of an array (..., P), as an array (..., S) that xarray reads in parts."""

    def __init__(self, values: np.ndarray, members: list[list[int]]) -> None:
        self._values, self._members = values, members
        self.shape, self.dtype = (*values.shape[:-1], len(members)), values.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> np.ndarray:
        basic = indexing.IndexingSupport.BASIC
        return np.asarray(indexing.explicit_indexing_adapter(key, self.shape, basic, self._read))

    def _read(self, key: tuple[int | slice, ...]) -> np.ndarray:
        *rest, last = key
        x = self._values[tuple(rest)]
        if isinstance(last, slice):
            return np.stack([x[..., own].sum(axis=-1) for own in self._members[last]], axis=-1)
        return np.asarray(x[..., self._members[last]].sum(axis=-1))


def _combined(cells: xr.Dataset, total: Callable[[xr.DataArray, list[list[int]]], xr.Variable]) -> xr.Dataset:
    """`combined`, where ``total`` sums the columns of an array: those of each list are one sum."""
    names = [str(n) for n in cells["parameter"].values]
    groups = sums_of(names)
    if len(groups) == len(names):
        raise InputError(f"parameter: no active and passive stiffness to combine among {', '.join(names)}")
    members = [[names.index(n) for n in old] for old in groups.values()]
    out = cells.drop_dims("parameter").assign_coords(parameter=list(groups))
    for name in ("estimate", "truth"):
        out[name] = total(cells[name], members)
        out[name].attrs = dict(cells[name].attrs)
    out["parameter"] = out["parameter"].assign_attrs(cells["parameter"].attrs)
    if PARAMETER_UNIT in cells:
        unit = cells[PARAMETER_UNIT]
        out = out.assign_coords({PARAMETER_UNIT: ("parameter", unit.values[[m[0] for m in members]], unit.attrs)})
    if "at_bound" in cells:
        out[INSIDE] = inside_bounds(cells)
    return relabelled(
        out,
        estimate=f"{_OF_THE_BEST['estimate']}, active and passive stiffness summed",
        truth="true value, active and passive stiffness summed",
    )


def sums_of(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """What `combined` makes of parameters ``names``: the parameters behind each of its own, alone or as a sum."""
    pairs = {new: old for new, old in COMBINED.items() if set(old) <= set(names)}
    gone = {n for old in pairs.values() for n in old}
    return pairs | {n: (n,) for n in names if n not in gone}
