"""The best start of every cell, and an account of everything that was not used."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis import accuracy, derived, selection, slabs
from mcstudy.errors import InputError
from mcstudy.fitting.status import Status

Cube = Callable[..., xr.Dataset]


def test_the_best_start_has_the_lowest_cost_of_its_cell_and_brings_its_own_values(make_cube: Cube) -> None:
    cube = make_cube(starts=9)
    cube["cost"][:] = np.random.default_rng(0).random(cube["cost"].shape)
    cells = selection.best(cube)
    assert (cells["cost"] == cube["cost"].min("start")).all()
    for index in np.ndindex(cells["cost"].shape):
        winner = int(cells["best_start"].values[index])
        assert np.array_equal(cells["estimate"].values[index], cube["estimate"].values[(*index, winner)])
        assert cells["growth_rate"].values[index] == cube["growth_rate"].values[(*index, winner)]


def test_of_equal_costs_the_first_start_wins(make_cube: Cube) -> None:
    cube = make_cube(starts=4)
    cube["cost"][:] = 1.0
    assert (selection.best(cube)["best_start"] == 0).all()


@pytest.mark.parametrize(
    "status", [Status.PENDING, Status.SOLVER_ERROR, Status.NON_FINITE_MODEL, Status.NON_FINITE_DATA]
)
def test_a_fit_that_did_not_run_or_failed_never_wins_whatever_its_cost(make_cube: Cube, status: Status) -> None:
    cube = make_cube(starts=3)
    cube["cost"][..., 1] = -1.0
    cube["status"][..., 1] = status
    assert (selection.best(cube)["best_start"] != 1).all()


def test_a_cost_that_is_not_finite_never_wins(make_cube: Cube) -> None:
    cube = make_cube(starts=3)
    cube["cost"][..., 0] = np.nan
    cube["cost"][..., 1] = -np.inf
    assert (selection.best(cube)["best_start"] == 2).all()


def test_realizations_without_a_usable_start_are_counted_by_what_became_of_them(make_cube: Cube) -> None:
    cube = make_cube(realizations=6, starts=3)
    cube["status"][0, 0, 0] = Status.PENDING
    cube["status"][0, 0, 1] = Status.NON_FINITE_DATA
    cube["status"][0, 0, 2] = [Status.SOLVER_ERROR, Status.NON_FINITE_MODEL, Status.SOLVER_ERROR]
    cube["status"][0, 0, 5] = Status.NON_FINITE_MODEL
    cube["status"][0, 0, 3, :2] = Status.SOLVER_ERROR  # one start is left, which is enough
    counts = selection.realizations(cube).isel(amplitude=0, fmax=0)
    assert {k: int(v) for k, v in counts.data_vars.items()} == {
        "used": 2, "not_run": 1, "non_finite": 1, "diverged": 1, "failed": 1,
    }  # fmt: skip
    fits = selection.outcomes(cube).isel(amplitude=0, fmax=0)
    assert int(fits.sel(outcome="pending")) == 3
    assert int(fits.sel(outcome="solver_error")) == 4
    assert int(fits.sum()) == 18
    bias = accuracy.bias(selection.best(cube)).isel(amplitude=0, fmax=0)
    assert (bias["n"] == 2).all()
    assert (bias["left_out"] == 4).all()


def test_the_best_among_stable_starts_is_stable(make_cube: Cube) -> None:
    cube = make_cube(starts=6)
    cube["growth_rate"][..., 0] = 1.0
    cube["cost"][..., 0] = 0.0
    cells = selection.best(cube, allowed=cube["growth_rate"] < 0)
    assert not (cells["growth_rate"] >= 0).any()


def test_conditional_statistics_leave_the_others_out_and_say_how_many(make_cube: Cube) -> None:
    cells = selection.best(make_cube(realizations=6))
    cells["growth_rate"][0, 0, :2] = 0.1
    conditional = accuracy.bias(selection.only(cells, selection.stable(cells))).isel(amplitude=0, fmax=0)
    assert (conditional["left_out"] == 2).all()
    expected = cells["estimate"][0, 0, 2:].mean("realization") - cells["truth"]
    np.testing.assert_allclose(conditional["value"], expected)
    assert (accuracy.bias(cells)["left_out"] == 0).all()


def test_combined_stiffness_is_the_sum_of_active_and_passive(make_cube: Cube) -> None:
    cells = selection.best(make_cube())
    ten = derived.combined(cells)
    assert ten.sizes["parameter"] == 10
    total = cells["estimate"].sel(parameter="K11") + cells["estimate"].sel(parameter="Kpas1")
    np.testing.assert_allclose(ten["estimate"].sel(parameter="K11+Kpas1"), total)
    np.testing.assert_allclose(ten["truth"].sel(parameter="K22+Kpas2"), 201.0 + 69.0)
    assert ten["estimate"].dims == cells["estimate"].dims


def test_one_missing_realization_stays_missing_in_the_sum(make_cube: Cube) -> None:
    cube = make_cube()
    cube["status"][0, 0, 0] = Status.PENDING
    ten = derived.combined(selection.best(cube))
    assert ten["estimate"][0, 0, 0].isnull().all()
    assert ten["estimate"].isnull().sum() == 10


def test_a_model_without_pairs_cannot_be_combined(make_cube: Cube) -> None:
    cells = selection.best(make_cube()).sel(parameter=["K12", "Td1"])
    with pytest.raises(InputError, match="no active and passive stiffness"):
        derived.combined(cells)


def test_best_fits_read_in_slabs_are_those_read_at_once(make_cube: Cube, monkeypatch: pytest.MonkeyPatch) -> None:
    cube = make_cube(realizations=23, starts=4, spread=0.3)
    read: list[int] = []

    def of(part: xr.Dataset) -> xr.Dataset:
        read.append(part.sizes["realization"])
        return selection.best(part)

    monkeypatch.setattr(slabs, "FITS_A_SLAB", cube["cost"].size // 3)
    found = slabs.in_slabs(cube.chunk(amplitude=1, realization=3), of)
    assert read == [6, 6, 6, 5]
    xr.testing.assert_identical(found, selection.best(cube))
    assert slabs.in_slabs(cube, of).sizes["realization"] == read[-1] == 23


def test_counts_summed_over_slabs_are_those_of_all_at_once(make_cube: Cube, monkeypatch: pytest.MonkeyPatch) -> None:
    cube = make_cube(realizations=23, starts=4, spread=0.3)
    cube["status"][:, :, 3] = 0
    monkeypatch.setattr(slabs, "FITS_A_SLAB", cube["cost"].size // 3)
    found = slabs.summed(cube.chunk(amplitude=1, realization=3), selection.realizations)
    xr.testing.assert_identical(found, selection.realizations(cube))
    assert int(found["not_run"].min()) == 1


def test_sums_that_are_read_in_parts_are_the_combined_ones(make_cube: Cube) -> None:
    cells = selection.best(make_cube(realizations=7))
    ten, lazy = derived.combined(cells), derived.combined_when_read(cells)
    xr.testing.assert_identical(lazy, ten)
    for part in ({"realization": slice(2, 5), "parameter": 0}, {"parameter": [9, 1], "fmax": 0}):
        xr.testing.assert_identical(lazy["estimate"].isel(part), ten["estimate"].isel(part))
    assert not lazy["estimate"].variable._in_memory
