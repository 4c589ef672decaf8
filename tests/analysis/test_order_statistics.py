"""Median, quantiles and MAD of the estimates, with their Monte Carlo errors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr
from scipy.stats import median_abs_deviation

from mcstudy.analysis import order_statistics
from mcstudy.analysis.order_statistics import estimate_quantiles, mad, median_bias

Cube = Callable[..., xr.Dataset]


def cells_of(x: np.ndarray, truth: float = 0.0) -> xr.Dataset:
    """Estimates (..., R) of one parameter as cells; leading dim: repeated studies, as Fmax."""
    estimate = xr.DataArray(np.atleast_2d(x)[..., None], dims=("fmax", "realization", "parameter"))
    return xr.Dataset({"estimate": estimate, "truth": ("parameter", [truth])})


def on_two_bounds(rng: np.random.Generator, studies: int, n: int) -> np.ndarray:
    """65 % on the lower bound 0, 25 % on the upper 2, the others between."""
    u = rng.random((studies, n))
    return np.where(u < 0.65, 0.0, np.where(u < 0.9, 2.0, rng.random((studies, n)) * 2))


def test_they_are_numpys_and_scipys() -> None:
    x = np.random.default_rng(0).standard_normal(101)
    cells = cells_of(x, truth=0.3)
    assert float(median_bias(cells)["value"].squeeze()) == pytest.approx(np.median(x) - 0.3)
    assert float(mad(cells)["value"].squeeze()) == pytest.approx(median_abs_deviation(x))
    found = estimate_quantiles(cells)["value"].squeeze()
    np.testing.assert_allclose(found, np.quantile(x, found["quantile"], method="inverted_cdf"))


def test_their_errors_are_the_scatter_of_repeated_studies() -> None:
    x = np.random.default_rng(1).standard_normal((400, 100))
    for statistic in (median_bias, mad):
        found = statistic(cells_of(x))
        assert float((found["mcse"] ** 2).mean() ** 0.5) == pytest.approx(float(found["value"].std()), rel=0.12)


def test_errors_from_smaller_resamples_are_the_scatter_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 300 realizations 60 are drawn; once normal, once with 38 % on a bound."""
    monkeypatch.setattr(order_statistics, "LARGEST_RESAMPLE", 60)
    rng = np.random.default_rng(4)
    for x in (rng.standard_normal((200, 300)), np.maximum(rng.standard_normal((200, 300)), -0.3)):
        found = mad(cells_of(x))
        assert float((found["mcse"] ** 2).mean() ** 0.5) == pytest.approx(float(found["value"].std()), rel=0.2)


def test_the_time_of_a_resample_does_not_grow_with_the_study(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []
    plain = order_statistics._mad
    monkeypatch.setattr(order_statistics, "_mad", lambda x: seen.append(x.size) or plain(x))
    mad(cells_of(np.arange(50_000.0)))
    assert seen == [50_000, order_statistics.RESAMPLES * order_statistics.LARGEST_RESAMPLE]


def test_the_interval_of_the_median_holds_it_also_where_estimates_sit_on_two_bounds() -> None:
    rng = np.random.default_rng(2)
    normal = median_bias(cells_of(rng.standard_normal((1000, 50))))
    bounds = median_bias(cells_of(on_two_bounds(rng, 1000, 50)))
    for found in (normal, bounds):
        held = float(((found["lower"] <= 0) & (found["upper"] >= 0)).mean())
        assert held > 0.93


def test_the_median_of_estimates_on_two_bounds_is_where_they_are_and_the_mean_is_not() -> None:
    x = on_two_bounds(np.random.default_rng(3), 1, 500)
    assert float(median_bias(cells_of(x))["value"].squeeze()) == 0
    assert float(mad(cells_of(x))["value"].squeeze()) == 0
    assert 0.4 < x.mean() < 0.8


def test_they_leave_out_what_is_missing_and_are_the_same_chunk_by_chunk(make_cube: Cube) -> None:
    cube = make_cube(realizations=12, starts=2, fmax=(1.2,))
    cube["estimate"][0, 0, :4] = np.nan
    cube["cost"][0, 0, :4] = np.nan
    lazy = cube.chunk({"realization": 5})
    for name in ("median_bias", "mad", "quantiles"):
        eager = getattr(cube.mc, name)()
        xr.testing.assert_allclose(getattr(lazy.mc, name)(), eager)
        assert int(eager["left_out"].isel(amplitude=0, fmax=0, parameter=0)) == 4
    assert float(cube.mc.quantiles((0.1,))["quantile"][0]) == 0.1


def test_two_realizations_have_no_error_of_the_mad() -> None:
    found = mad(cells_of(np.array([1.0, 2.0])))
    assert float(found["value"].squeeze()) == 0.5
    assert np.isnan(found["mcse"]).all()
