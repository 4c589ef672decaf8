"""The atlas gathers the basins of realizations whose minima the noise has moved."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis.search import atlas as module
from mcstudy.analysis.search.atlas import atlas, atlas_of_starts
from mcstudy.analysis.search.basins import basins


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


def _readable_to(data: xr.DataArray, last: int) -> xr.DataArray:
    """The same, in chunks of four realizations, of which those from ``last`` on cannot be read."""
    axis = data.get_axis_num("realization")

    def read(x: np.ndarray, block_info: Any = None) -> np.ndarray:
        assert not block_info or block_info[0]["array-location"][axis][0] < last
        return x

    return data.copy(
        data=data.chunk(realization=4).data.map_blocks(read, dtype=data.dtype, meta=np.array((), data.dtype))
    )


def test_an_atlas_of_a_large_cube_reads_the_realizations_it_shows(
    make_cube: Callable[..., xr.Dataset], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MOST_BASINS", 40)
    monkeypatch.setattr(module, "_ROWS", 7)
    cube = make_cube(realizations=20, starts=12, spread=0.3, fmax=(1.2,), amplitude=(5.0,)).isel(amplitude=0, fmax=0)
    names = ("estimate", "cost", "status", "growth_rate")
    expected = atlas(basins(cube, 5), cube["lower"], cube["upper"])
    found = atlas_of_starts(cube.assign({name: _readable_to(cube[name], 8) for name in names}), 5)
    xr.testing.assert_identical(found, expected)
    assert found.attrs["realizations"] == 8
    with pytest.raises(AssertionError):
        atlas_of_starts(cube.assign({name: _readable_to(cube[name], 4) for name in names}), 5)


def test_clusters_are_those_of_the_definition() -> None:
    """Every leader has the largest remaining probability around it, summed anew for each cluster."""
    rng = np.random.default_rng(7)
    place, reach, tolerance = rng.random((600, 3)), rng.integers(1, 9, 600) / 16, 0.2
    label = module._clusters(place, reach, tolerance)
    near = (np.abs(place[:, None] - place[None]) <= tolerance).all(2)
    left = np.ones(600, dtype=bool)
    for cluster in range(label.max() + 1):
        around = np.where(left, near @ (reach * left), -1.0)
        taken = near[int(np.argmax(around))] & left
        assert (np.flatnonzero(taken) == np.flatnonzero(label == cluster)).all()
        left &= ~taken
    assert not left.any()
