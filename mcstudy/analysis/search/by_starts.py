"""Accuracy of the best of the first x starts.

Where bias and spread still change with x, the optimiser causes part of them; where they are constant, they are
properties of the estimator. Starts are independent random draws, so the first x of them are a random sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import xarray as xr

from mcstudy.analysis import accuracy
from mcstudy.analysis.labels import ONE, label
from mcstudy.analysis.montecarlo import REALIZATION
from mcstudy.analysis.search.convergence import starts_needed
from mcstudy.analysis.selection import best
from mcstudy.fitting.certainty import MISSED, missed

COUNTS = (1, 2, 3, 5, 10, 20, 50, 100, 200, 500)
"""Numbers of starts that are evaluated, up to the number in the cube."""


def mean_cv(cells: xr.Dataset) -> xr.Dataset:
    """Coefficient of variation averaged over parameters, dims (amplitude, fmax)."""
    name = "coefficient of variation, mean over every parameter"
    return accuracy.statistic_of(cells, lambda m: accuracy.cv_of(m).mean("parameter"), name)


def by_starts(
    cube: xr.Dataset, statistic: Callable[[xr.Dataset], xr.Dataset] = mean_cv, counts: Iterable[int] = COUNTS
) -> xr.Dataset:
    """A statistic as a function of the number of starts (dim ``drawn``). Needs all starts.

    Parameters
    ----------
    statistic
        Function of best fits; the coefficient of variation averaged over parameters by default.
    counts
        Numbers of starts; all there are is always the last.

    Returns
    -------
    xarray.Dataset
        What the statistic returns, with the dim ``drawn``: the best of the first so many starts. ``missed``: the
        chance that as many new starts miss the lowest minimum, mean over realizations.
    """
    cells = best_of_first(cube, counts)
    parts = [statistic(cells.isel(drawn=i, drop=True)) for i in range(cells.sizes["drawn"])]
    out = xr.concat(parts, dim=cells["drawn"], coords="minimal", compat="override")
    return out.assign(missed=missed_by(starts_needed(cube)["hit_rate"], cells["drawn"]))


def missed_by(hit_rate: xr.DataArray, drawn: xr.DataArray) -> xr.DataArray:
    """Chance that ``drawn`` new starts miss the pool's minimum, mean over realizations; see `fitting.certainty`."""
    return label(missed(hit_rate.where(hit_rate > 0), drawn).mean(REALIZATION), f"{MISSED}, mean over realizations")


def best_of_first(cube: xr.Dataset, counts: Iterable[int] = COUNTS) -> xr.Dataset:
    """`best` of the first starts, with the dim ``drawn``, their number; reads every start once.

    The largest count is always the number of starts the cube has.
    """
    held = cube.sizes["start"]
    drawn = sorted({x for x in counts if x < held} | {held})
    needed = [n for n in ("estimate", "cost", "status", "truth") if n in cube]  # coordinates come along
    number = xr.DataArray(drawn, dims="drawn", attrs={"long_name": "number of starts", "units": ONE})
    first = xr.DataArray(np.arange(held), dims="start") < number
    return best(cube[needed], first).assign_coords(drawn=number)
