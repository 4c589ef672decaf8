"""Local minima found across starts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis.search.basins import basins
from mcstudy.fitting.status import Status

Cube = Callable[..., xr.Dataset]


def test_two_minima_are_told_apart_with_their_cost_reach_and_stability(make_cube: Cube) -> None:
    cube = make_cube(starts=40, hit_rate=0.7)
    out = basins(cube, most=3)
    assert (out["n_basins"] == 2).all()
    stable = (cube["growth_rate"] < 0).mean("start")
    np.testing.assert_allclose(out["value"].sel(basin=0), stable)
    assert (out["stable"].sel(basin=0) == 1).all()
    assert (out["stable"].sel(basin=1) == 0).all()
    assert out["stable"].sel(basin=2).isnull().all()
    np.testing.assert_allclose(out["cost"].sel(basin=1), 2 * out["cost"].sel(basin=0))
    assert ((out["lower"] < out["value"]) & (out["value"] < out["upper"])).isel(basin=[0, 1]).all()


def test_equal_costs_at_different_parameters_are_different_basins(make_cube: Cube) -> None:
    cube = make_cube(starts=20)
    cube["cost"][:] = 1.0
    assert (basins(cube)["n_basins"] == 2).all()


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_units_of_parameters_and_cost_do_not_matter(make_cube: Cube, unit: float) -> None:
    cube = make_cube(starts=20)
    scaled = cube.assign({n: cube[n] * unit for n in ("estimate", "lower", "upper", "truth", "cost")})
    for name in ("value", "n_basins", "stable"):
        np.testing.assert_array_equal(basins(scaled)[name], basins(cube)[name])


def test_the_order_of_the_starts_does_not_matter(make_cube: Cube) -> None:
    cube = make_cube(starts=25)
    order = np.random.default_rng(0).permutation(25)
    xr.testing.assert_allclose(basins(cube.isel(start=order)), basins(cube), rtol=1e-12)


def test_fits_that_did_not_converge_are_no_minima(make_cube: Cube) -> None:
    cube = make_cube(starts=6)
    cube["status"][..., 0] = Status.ITERATION_LIMIT
    cube["status"][..., 1] = Status.SOLVER_ERROR
    np.testing.assert_allclose(basins(cube)["value"].sum("basin"), 4 / 6)


def test_reach_is_a_fraction_of_all_starts_attempted(make_cube: Cube) -> None:
    cube = make_cube(starts=10, hit_rate=1.0)
    cube["status"][..., 0] = Status.SOLVER_ERROR
    cube["status"][..., 1] = Status.PENDING
    np.testing.assert_allclose(basins(cube)["value"].sel(basin=0), 8 / 9)
