"""Bias, spread, bound hits and stability of the best fits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis import accuracy
from mcstudy.analysis.selection import best

Cube = Callable[..., xr.Dataset]


def test_measures_match_their_definitions(make_cube: Cube) -> None:
    cells = best(make_cube(realizations=30))
    x, truth = cells["estimate"], cells["truth"]
    sd = x.std("realization", ddof=1)
    for got, expected in (
        (accuracy.bias(cells), x.mean("realization") - truth),
        (accuracy.sd(cells), sd),
        (accuracy.cv(cells), sd / x.mean("realization")),
        (accuracy.rmse(cells), np.sqrt(((x - truth) ** 2).mean("realization"))),
        (accuracy.absolute_bias_percent(cells), 100 * abs(x.mean("realization") - truth) / truth),
        (accuracy.mean_spread_percent(cells), (100 * sd / truth).mean("parameter")),
    ):
        np.testing.assert_allclose(got["value"], expected, rtol=1e-12)
        assert (got["mcse"] > 0).all()


def test_with_no_true_bias_the_papers_bias_shows_its_noise_floor_and_not_zero(make_cube: Cube) -> None:
    cells = best(make_cube(realizations=1)).isel(realization=0, fmax=1, drop=True)
    z = np.random.default_rng(1).standard_normal((400, 50, 2, 12))
    noise = xr.DataArray(z, dims=("study", "realization", "amplitude", "parameter"))
    cells["estimate"] = cells["truth"] * (1 + 0.4 * noise)
    out = accuracy.mean_absolute_bias_percent(cells, over=("amplitude", "parameter"))
    assert float(out["floor"].mean()) == pytest.approx(100 * 0.4 / np.sqrt(50) * np.sqrt(2 / np.pi), rel=0.02)
    scatter = float(out["value"].std(ddof=1))
    assert float(out["value"].mean()) == pytest.approx(float(out["floor"].mean()), abs=4 * scatter / np.sqrt(400))
    # with nothing inside the absolute values the error is overstated, by 1 / sqrt(1 - 2/pi) = 1.66, and never under
    assert 1.4 < float(out["mcse"].mean()) / scatter < 1.9


def test_a_parameter_whose_truth_is_zero_has_no_percentage(make_cube: Cube) -> None:
    cells = best(make_cube())
    cells["truth"][0] = 0.0
    out = accuracy.absolute_bias_percent(cells)["value"]
    assert out.isel(parameter=0).isnull().all()
    assert out.isel(parameter=1).notnull().all()


def test_bound_hits_are_counted_by_side(make_cube: Cube) -> None:
    cells = best(make_cube(realizations=10))
    cells["at_bound"][0, 0, :3, 4] = -1
    cells["at_bound"][0, 0, 3, 4] = 1
    out = accuracy.at_bound(cells).isel(amplitude=0, fmax=0, parameter=4)
    assert float(out["value"].sel(side="lower")) == pytest.approx(0.3)
    assert float(out["value"].sel(side="upper")) == pytest.approx(0.1)
    assert (out["lower"] < out["value"]).all()
    assert (out["value"] < out["upper"]).all()


def test_unstable_best_fits_are_counted_and_a_missing_growth_rate_is_left_out(make_cube: Cube) -> None:
    cells = best(make_cube(realizations=10))
    cells["growth_rate"][0, 0] = [0.1, 0.2, np.nan, -1, -1, -1, -1, -1, -1, -1]
    out = accuracy.unstable(cells).isel(amplitude=0, fmax=0)
    assert float(out["value"]) == pytest.approx(2 / 9)
    assert int(out["left_out"]) == 1


def test_pairs_of_conditions_share_their_noise_and_the_error_of_their_difference_knows(make_cube: Cube) -> None:
    cells = best(make_cube(realizations=50, starts=1))
    shared = cells["estimate"].isel(amplitude=0)
    cells["estimate"] = xr.concat([shared, shared * 0.9], dim=cells["amplitude"]).transpose(*cells["estimate"].dims)
    ratio = accuracy.statistic_of(cells, lambda m: m.sd.isel(amplitude=1) / m.sd.isel(amplitude=0))
    np.testing.assert_allclose(ratio["value"], 0.9)
    np.testing.assert_allclose(ratio["mcse"], 0.0, atol=1e-12)
