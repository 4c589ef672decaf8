"""Accuracy of the best of the first x starts: what more starts buy.

Where bias and spread still move with x the optimiser causes part of them; where they have settled, what is left is the
estimator's own. Starts are independent draws, so the first x of them are x draws.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import xarray as xr

from mcstudy.analysis import accuracy
from mcstudy.analysis.labels import ONE
from mcstudy.analysis.selection import best

COUNTS = (1, 2, 3, 5, 10, 20, 50, 100, 200, 500)
"""Numbers of starts looked at, as far as the cube has them."""


def by_starts(
    cube: xr.Dataset, statistic: Callable[[xr.Dataset], xr.Dataset], counts: Iterable[int] = COUNTS
) -> xr.Dataset:
    """A statistic of cells, such as `mean_cv`, with the dim ``drawn``: the best of that many starts.

    The largest count is always the number of starts the cube has.
    """
    held = cube.sizes["start"]
    drawn = sorted({x for x in counts if x < held} | {held})
    needed = [n for n in ("estimate", "cost", "status", "truth") if n in cube]  # coordinates come along
    parts = [statistic(best(cube[needed].isel(start=slice(0, x)))) for x in drawn]
    out = xr.concat(parts, dim="drawn", coords="minimal", compat="override")
    return out.assign_coords(drawn=("drawn", drawn, {"long_name": "number of starts", "units": ONE}))


def mean_absolute_bias_percent(cells: xr.Dataset) -> xr.Dataset:
    """|bias| in percent of the truth averaged over parameters, dims (amplitude, fmax)."""
    return accuracy.mean_absolute_bias_percent(cells)


def mean_cv(cells: xr.Dataset) -> xr.Dataset:
    """Coefficient of variation averaged over parameters, dims (amplitude, fmax)."""
    name = "coefficient of variation, mean over every parameter"
    return accuracy.statistic_of(cells, lambda m: accuracy.cv_of(m).mean("parameter"), name)
