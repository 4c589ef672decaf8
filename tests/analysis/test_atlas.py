"""The atlas gathers the basins of realizations whose minima the noise has moved."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis.atlas import atlas
from mcstudy.analysis.basins import basins


def _atlas(cube: xr.Dataset, tolerance: float = 0.5) -> xr.Dataset:
    one = cube.isel(amplitude=0, fmax=0)
    return atlas(basins(one, 5), cube["lower"], cube["upper"], tolerance)


def test_two_invented_minima_are_two_clusters_in_every_realization(make_cube: Callable[..., xr.Dataset]) -> None:
    """The invented cube: a stable minimum near the truth, and an unstable one at 1.5 times it and twice the cost."""
    cube = make_cube(realizations=20, starts=40, spread=0.02, hit_rate=0.7)
    table = _atlas(cube, tolerance=0.15)
    assert table.sizes["cluster"] == 2
    assert table["realizations"].values.tolist() == [20, 20]
    assert table["lowest"].values.tolist() == [20, 0]
    assert table["stable"].values.tolist() == [1.0, 0.0]
    assert table["excess"].values == pytest.approx([1.0, 2.0])
    assert float(table["value"].sum()) == pytest.approx(1.0)
    assert abs(float(table["value"][0]) - 0.7) < 4 * float(table["mcse"][0])


def test_places_are_between_the_bounds_whatever_the_units(make_cube: Callable[..., xr.Dataset]) -> None:
    cube = make_cube(realizations=10, starts=20, spread=0.02, hit_rate=0.8)
    first = _atlas(cube, 0.15)["position"].isel(cluster=0)
    scaled = cube.assign({name: 1000.0 * cube[name] for name in ("estimate", "lower", "upper")})
    assert np.allclose(first, 0.5, atol=0.05)
    assert np.allclose(_atlas(scaled, 0.15)["position"].isel(cluster=0), first)


def test_reach_over_all_clusters_is_every_start_that_found_a_minimum(make_cube: Callable[..., xr.Dataset]) -> None:
    cube = make_cube(realizations=12, starts=10, spread=0.3)
    assert float(_atlas(cube)["value"].sum()) == pytest.approx(1.0)


def test_a_cube_without_results_has_no_cluster(make_cube: Callable[..., xr.Dataset]) -> None:
    cube = make_cube(realizations=3, starts=4)
    empty = cube.assign(status=cube["status"] * 0, cost=cube["cost"] * np.nan)
    assert _atlas(empty).sizes["cluster"] == 0
