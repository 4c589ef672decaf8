"""Selection of fits: the best start of every cell, and counts of the fits that were not used.

A *cell* is one (amplitude, fmax, realization); its starts are repeated attempts at the same problem. A *cube* is a
Dataset with the dim ``start``; `best` reduces it to *cells*, on which all accuracy statistics work.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from mcstudy.analysis.labels import ONE, label, labelled, relabelled
from mcstudy.fitting.status import NOT_RUN, USABLE, Status

INSIDE = "inside_bounds"
"""Variable of `mcstudy.analysis.derived` cells: what `inside_bounds` says of the parameters they follow from."""

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
    start = take(cube["start"].broadcast_like(index), index) if "start" in cube.coords else index
    out["best_start"] = label(start.where(any_ok, -1).astype("int64"), "start of the best fit; -1 where none is usable")
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
    counts = xr.Dataset({name: member.sum("realization") for name, member in groups.items()})
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
