"""More starts give better fits, and the last point is the study itself."""

from __future__ import annotations

from collections.abc import Callable

import xarray as xr

from mcstudy.analysis.accuracy import mean_absolute_bias_percent
from mcstudy.analysis.search.by_starts import best_of_first, by_starts, mean_cv
from mcstudy.analysis.search.convergence import hits
from mcstudy.analysis.selection import best


def test_with_every_start_the_curve_is_the_study(make_cube: Callable[..., xr.Dataset]) -> None:
    cube = make_cube(realizations=8, starts=12)
    for statistic in (mean_absolute_bias_percent, mean_cv):
        curve = by_starts(cube, statistic)
        assert curve["drawn"].values.tolist() == [1, 2, 3, 5, 10, 12]
        xr.testing.assert_allclose(curve["value"].isel(drawn=-1, drop=True), statistic(best(cube))["value"])


def test_a_minimum_that_few_starts_reach_shows_as_bias_at_few_starts(make_cube: Callable[..., xr.Dataset]) -> None:
    """The invented cube's wrong minimum is off by 50 %: the first start is in it most of the time, all 60 never."""
    cube = make_cube(realizations=30, starts=60, hit_rate=0.2, spread=0.01)
    bias = by_starts(cube, mean_absolute_bias_percent)["value"].mean(("amplitude", "fmax"))
    assert float(bias.sel(drawn=1)) > 30
    assert float(bias.sel(drawn=60)) < 2


def test_the_best_of_the_first_starts_is_the_best_of_a_study_with_only_those(
    make_cube: Callable[..., xr.Dataset],
) -> None:
    cube = make_cube(realizations=5, starts=12, hit_rate=0.3)
    cube["status"][:, :, 2, :4] = 0  # not run
    for held in (cube, cube.chunk(realization=2)):
        cells = best_of_first(held)
        for x in cells["drawn"].values.tolist():
            few = best(cube.isel(start=slice(0, x)))
            for name in ("estimate", "cost", "status", "best_start", "usable_starts"):
                xr.testing.assert_equal(cells[name].sel(drawn=x, drop=True).transpose(*few[name].dims), few[name])


def test_beside_each_number_of_starts_stands_the_chance_that_they_miss_the_minimum(
    make_cube: Callable[..., xr.Dataset],
) -> None:
    cube = make_cube(realizations=6, starts=12, hit_rate=0.3)
    missed = by_starts(cube, mean_cv)["missed"]
    pool = hits(cube)
    for x in missed["drawn"].values.tolist():
        expected = ((1 - pool["hits"] / pool["starts"]) ** x).mean("realization")
        xr.testing.assert_allclose(missed.sel(drawn=x, drop=True), expected)
    all_starts = cube.mc.best()["missed"].mean("realization")
    xr.testing.assert_allclose(missed.isel(drawn=-1, drop=True), all_starts)
