"""With one segment one start suffices, as long as the loop it starts from is stable."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis.search.stable_starts import hit_rate_by_start, stable_starts
from mcstudy.own_model import run_model
from mcstudy.stance.body import one_segment
from mcstudy.stance.stability import growth_rate

MODEL = one_segment()


@pytest.fixture(scope="module")
def cube() -> xr.Dataset:
    return run_model(MODEL, realizations=6, starts=40, fmax=(0.41, 1.2), amplitude=(5.0,), seed=3)


def test_a_stable_start_reaches_the_minimum_and_an_unstable_one_at_1_2_hz_does_not(cube: xr.Dataset) -> None:
    rate = hit_rate_by_start(cube, MODEL).sel(fmax=1.2, amplitude=5.0)
    assert float(rate["value"].sel(loop="stable")) == 1.0
    assert float(rate["value"].sel(loop="unstable")) < 0.1
    assert int(rate["starts"].sum()) == 6 * 40


def test_stability_is_that_of_the_start_in_its_place(cube: xr.Dataset) -> None:
    stable = stable_starts(cube, MODEL)
    assert stable.dims == cube["status"].dims
    for r, s in [(0, 0), (2, 17), (5, 39)]:
        start = cube["initial"].isel(amplitude=0, fmax=1, realization=r, start=s).values
        assert bool(stable[0, 1, r, s]) == bool(growth_rate(MODEL, start) < 0)


def test_a_fit_not_run_has_no_stable_start_and_no_hit(cube: xr.Dataset) -> None:
    pending = cube.copy(deep=True)
    pending["initial"][:, :, 0] = np.nan
    pending["cost"][:, :, 0] = np.nan
    pending["status"][:, :, 0] = 0
    assert not stable_starts(pending, MODEL).isel(realization=0).any()
    rate = hit_rate_by_start(pending, MODEL)
    rest = hit_rate_by_start(cube.isel(realization=slice(1, None)), MODEL)
    stable = {"loop": "stable"}
    xr.testing.assert_allclose(rate["value"].sel(stable), rest["value"].sel(stable))
