"""``dataset.mc``: the analysis as methods, lazily, also on a cube larger than memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import Any

import dask
import dask.array as da
import numpy as np
import pytest
import xarray as xr

import mcstudy.analysis.accessor  # noqa: F401 - registers .mc
from mcstudy.analysis import accuracy, derived, selection
from mcstudy.errors import InputError, StoreError

Cube = Callable[..., xr.Dataset]

ON_CUBE = (
    "best", "combined", "derived", "outcomes", "realizations", "bias", "absolute_bias_percent",
    "mean_absolute_bias_percent", "sd", "cv", "rmse", "at_bound", "unstable", "j_nc", "j_nc_within",
    "starts_needed", "starts_needed_quantiles", "minimum_curve", "asymptote", "basins", "stable", "inside_bounds",
    "efficiency",
)  # fmt: skip


class Tripwire:
    """An array on disk, as dask sees one: it may be read a chunk at a time and never as a whole."""

    def __init__(self, values: np.ndarray, most: int) -> None:
        self._values, self._most = values, most
        self.shape, self.dtype, self.ndim = values.shape, values.dtype, values.ndim

    def __getitem__(self, key: Any) -> np.ndarray:
        part = self._values[key]
        if part.size > self._most:
            raise MemoryError(f"{part.size} values read at once")
        return part.copy()


def on_disk(cube: xr.Dataset) -> xr.Dataset:
    """The cube as it is opened from disk: one chunk an amplitude and two realizations."""
    out = cube.copy()
    for name, variable in cube.data_vars.items():
        if "realization" in variable.dims:
            size = {"amplitude": 1, "realization": 2}
            chunks = tuple(size.get(str(d), n) for d, n in zip(variable.dims, variable.shape, strict=True))
            wire = Tripwire(variable.values, int(np.prod(chunks)))
            out[name] = (variable.dims, da.from_array(wire, chunks=chunks, asarray=False, meta=np.empty(0, wire.dtype)))
    return out


@pytest.mark.parametrize("method", ON_CUBE)
def test_every_method_is_lazy_and_gives_the_numbers_of_a_cube_in_memory(make_cube: Cube, method: str) -> None:
    cube = make_cube(realizations=6, starts=8)
    lazy = getattr(on_disk(cube).mc.lazy, method)()
    parts = [lazy] if isinstance(lazy, xr.DataArray) else list(lazy.data_vars.values())
    assert method == "efficiency" or any(p.chunks is not None for p in parts)
    with dask.config.set(scheduler="synchronous"):
        xr.testing.assert_allclose(lazy.compute(), getattr(cube.mc, method)(), rtol=1e-12)


@pytest.mark.parametrize("method", ON_CUBE)
def test_a_result_of_moderate_size_is_numbers(make_cube: Cube, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    lazy = on_disk(make_cube(realizations=6, starts=8))
    with dask.config.set(scheduler="synchronous"):
        result = getattr(lazy.mc, method)()
    assert "dask" not in repr(result)
    monkeypatch.setattr("mcstudy.analysis.accessor.MOST_BYTES", result.nbytes - 1)
    large = getattr(lazy.mc, method)()
    assert method == "efficiency" or "dask" in repr(large)


def test_statistics_of_a_large_cube_hold_a_few_chunks_in_memory(make_cube: Cube) -> None:
    cube = make_cube(realizations=80, starts=1000, fmax=(1.2, 8.0), amplitude=(3.0,))
    size = cube["estimate"].nbytes
    assert len(on_disk(cube)["estimate"].data.chunks[2]) == 40
    lazy = on_disk(cube)
    wanted = {
        "bias": lazy.mc.bias,
        "bias, computed later": lazy.mc.lazy.bias().compute,
        "starts": lazy.mc.starts_needed_quantiles,
        "j_nc": lambda: lazy.mc.lazy.best().mc.j_nc(),
        "basins": lambda: lazy.mc.basins(most=2),
    }
    del cube
    for name, result in wanted.items():
        tracemalloc.start()
        with dask.config.set(scheduler="synchronous"):
            result()
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < size / 2, name  # about 40 chunks of graph and bookkeeping, and a few of data


def test_best_fits_of_a_large_cube_are_taken_a_few_chunks_at_a_time(make_cube: Cube) -> None:
    lazy = on_disk(make_cube(realizations=20, starts=8000, fmax=(1.2,), amplitude=(3.0,)))
    size = lazy["estimate"].nbytes
    tracemalloc.start()
    with dask.config.set(scheduler="synchronous"):
        cells = lazy.mc.best()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert cells["estimate"].chunks is None
    assert peak < size / 2


def test_reading_the_whole_cube_at_once_would_have_been_noticed(make_cube: Cube) -> None:
    wire = Tripwire(make_cube(realizations=6)["estimate"].values, most=100)
    whole = da.from_array(wire, chunks=-1, asarray=False, meta=np.empty(0, wire.dtype))
    with dask.config.set(scheduler="synchronous"), pytest.raises(MemoryError, match="read at once"):
        whole.compute()


def test_methods_work_on_cells_as_on_the_cube(make_cube: Cube) -> None:
    cube = make_cube()
    xr.testing.assert_identical(cube.mc.bias(), cube.mc.best().mc.bias())
    xr.testing.assert_identical(cube.mc.combined().mc.cv(), accuracy.cv(derived.combined(selection.best(cube))))
    assert cube.mc.best().mc.j_nc().dims == ("amplitude", "fmax", "realization")
    stable = cube.mc.only(cube.mc.stable()).mc.bias()
    assert (stable["n"] <= cube.mc.bias()["n"]).all()


def test_what_needs_all_starts_says_so_on_cells(make_cube: Cube) -> None:
    with pytest.raises(InputError, match="all its starts"):
        make_cube().mc.best().mc.starts_needed()


def test_a_dataset_without_a_design_is_refused_in_one_line(make_cube: Cube) -> None:
    cube = make_cube()
    for broken in ({}, {"design": {"realizations": "many"}}, {"design": "no"}):
        with pytest.raises(StoreError, match="design of") as error:
            cube.assign_attrs(broken).drop_attrs(deep=False).assign_attrs(broken).mc.j_nc()
        assert "\n" not in str(error.value)


def test_the_model_is_that_of_the_design(make_cube: Cube) -> None:
    cube = make_cube(model={"truth": {"K12": 300.0}})
    assert dict(zip(cube.mc.model.names, cube.mc.model.truth, strict=True))["K12"] == 300.0
    with pytest.raises(StoreError, match="as in the design"):
        _ = cube.isel(parameter=slice(None, None, -1)).mc.model


def test_sensitivity_is_at_the_groups_truth_and_frequencies(make_cube: Cube) -> None:
    plain, other = make_cube().mc.sensitivity(), make_cube(model={"truth": {"K12": 300.0}}).mc.sensitivity()
    assert list(plain["range"].values) == ["low", "mid", "high"]
    assert (plain["value"] != other["value"]).all()
