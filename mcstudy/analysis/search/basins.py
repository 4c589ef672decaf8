"""The local minima of a cell: their number, how often a random start ends in each, and whether they are stable.

Two converged fits belong to the same basin if their costs agree to `COST_TOLERANCE` (relative) and no parameter differs
by more than `WIDTH_TOLERANCE` of the distance between its bounds. Neither depends on units or on the size of the cost.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from mcstudy.analysis.labels import ONE, labelled, units_of
from mcstudy.analysis.montecarlo import wilson
from mcstudy.analysis.selection import attempted, usable
from mcstudy.fitting.certainty import COST_FLOOR
from mcstudy.fitting.status import Status

COST_TOLERANCE = 1e-3
"""Relative difference of cost within a basin."""

WIDTH_TOLERANCE = 0.02
"""Largest difference of a parameter within a basin, as a fraction of its bounds' distance."""


def _minima(cube: xr.Dataset) -> tuple[xr.DataArray, xr.DataArray]:
    """Costs (NaN for what is no minimum) and estimates in units of the bounds' distance, whole along the starts."""
    minimum = usable(cube) & (cube["status"] != int(Status.ITERATION_LIMIT))
    cost = cube["cost"].where(minimum)
    z = (cube["estimate"] - cube["lower"]) / (cube["upper"] - cube["lower"])
    if cost.chunks is not None:
        cost = cost.chunk({"start": -1})
    if z.chunks is not None:
        z = z.chunk({"start": -1, "parameter": -1})
    return cost, z


def _labels(cost: np.ndarray, z: np.ndarray, cost_tolerance: float, width_tolerance: float) -> np.ndarray:
    """Basin of every start, (S,) int32: 0 the lowest, in order of cost; -1 not a minimum.

    The lowest fit not yet labelled leads a basin and takes all fits near it, until none is left; so the result does
    not depend on the order of the starts. Fits that stopped at the iteration limit are not minima.
    """
    out = np.full(cost.size, -1, dtype=np.int32)
    # ties of cost are broken by the parameters, so that permuted starts give the same leaders
    order = np.lexsort((*z.T[::-1], cost))
    order = order[np.isfinite(cost[order])]
    basin = 0
    while order.size:
        leader = order[0]
        near = (cost[order] <= cost[leader] * (1 + cost_tolerance) + COST_FLOOR) & (
            np.abs(z[order] - z[leader]).max(axis=1) <= width_tolerance
        )
        out[order[near]] = basin
        order, basin = order[~near], basin + 1
    return out


def basins(
    cube: xr.Dataset,
    most: int = 10,
    cost_tolerance: float = COST_TOLERANCE,
    width_tolerance: float = WIDTH_TOLERANCE,
) -> xr.Dataset:
    """The lowest local minima of every cell, and how often they are reached. Needs all starts.

    Parameters
    ----------
    most
        Number of minima kept per cell.
    cost_tolerance, width_tolerance
        Starts ended in the same minimum if their costs differ by at most this, relative, and their estimates by at
        most this, in units of the distance between the bounds.

    Returns
    -------
    xarray.Dataset
        Dims (amplitude, fmax, realization, basin): ``value``, probability that a start ends there, with ``mcse``,
        ``lower``, ``upper``; ``cost``; ``estimate``; ``stable``; and per cell ``n_basins`` and ``n``, the starts.
    """
    cost, z = _minima(cube)
    growth = cube["growth_rate"]
    if growth.chunks is not None:
        growth = growth.chunk({"start": -1})
    # one pass over each chunk: with several reductions, dask would keep all chunks in memory until the last is done
    table, lead, count = xr.apply_ufunc(
        _basins_of_pool,
        cost,
        z,
        growth,
        input_core_dims=[["start"], ["start", "parameter"], ["start"]],
        output_core_dims=[["basin", "part"], ["basin", "parameter"], []],
        kwargs={"most": most, "cost_tolerance": cost_tolerance, "width_tolerance": width_tolerance},
        vectorize=True,
        dask="parallelized",
        output_dtypes=[float, float, np.int64],
        dask_gufunc_kwargs={"output_sizes": {"basin": most, "part": 3}},
    )
    tried = attempted(cube).sum("start")
    members, low, growth_rate = (table.isel(part=i) for i in range(3))
    reach = wilson(members, tried)
    out = reach[["value", "mcse", "lower", "upper"]].assign(
        cost=low,
        estimate=lead * (cube["upper"] - cube["lower"]) + cube["lower"],
        stable=xr.where(growth_rate < 0, 1.0, 0.0).where(growth_rate.notnull()),
        n_basins=count,
        n=tried,
    )
    return labelled(
        out.assign_coords(basin=np.arange(most)),
        cube,
        "probability that a start ends in the local minimum",
        cost=("cost at the local minimum", ONE),
        estimate=("parameters at the local minimum", units_of(cube)),
        stable=("whether the local minimum is a stable loop", ONE),
        n_basins=("number of local minima found", ONE),
        n=("starts attempted", ONE),
    )


def _basins_of_pool(
    cost: np.ndarray, z: np.ndarray, growth: np.ndarray, most: int, cost_tolerance: float, width_tolerance: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Per basin: members, cost and growth rate of its leader; its leader's parameters; and the number of basins."""
    label = _labels(cost, z, cost_tolerance, width_tolerance)
    count = int(label.max(initial=-1)) + 1
    table, lead = np.full((most, 3), np.nan), np.full((most, z.shape[1]), np.nan)
    for b in range(min(count, most)):
        member = np.flatnonzero(label == b)
        first = member[np.argmin(cost[member])]
        table[b] = member.size, cost[first], growth[first]
        lead[b] = z[first]
    return table, lead, count
