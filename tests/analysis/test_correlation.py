"""Correlation of estimates over realizations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis import correlation as correlation_module
from mcstudy.analysis.correlation import correlation
from mcstudy.analysis.selection import best

Cube = Callable[..., xr.Dataset]


def test_correlations_are_pearsons_and_leave_out_what_was_not_fitted(make_cube: Cube) -> None:
    cells = best(make_cube(realizations=12)).compute()
    cells["estimate"][0, 0, 3, :] = np.nan
    out = correlation(cells)
    x = cells["estimate"].transpose("amplitude", "fmax", "realization", "parameter").values[0, 0]
    np.testing.assert_allclose(out["value"][0, 0], np.corrcoef(np.delete(x, 3, axis=0).T), rtol=1e-10, atol=1e-12)
    assert int(out["n"][0, 0]) == 11
    assert int(out["left_out"][0, 0]) == 1


@pytest.mark.parametrize("numbers", [1 << 20, 1000])
def test_the_standard_error_is_that_of_deleting_every_realization_in_turn(
    make_cube: Cube, monkeypatch: pytest.MonkeyPatch, numbers: int
) -> None:
    """Whether realizations are worked on at once or two at a time."""
    monkeypatch.setattr(correlation_module, "NUMBERS_A_PIECE", numbers)
    cells = best(make_cube(realizations=9, fmax=(1.2, 8.0))).compute()
    cells["estimate"][0, 0, 3, :] = np.nan
    found = correlation(cells)["mcse"].isel(amplitude=0)
    for f, kept in ((0, [0, 1, 2, 4, 5, 6, 7, 8]), (1, list(range(9)))):
        x = cells["estimate"].transpose("amplitude", "fmax", "realization", "parameter").values[0, f][kept]
        deleted = np.array([np.corrcoef(np.delete(x, r, axis=0).T) for r in range(len(kept))])
        expected = np.sqrt((len(kept) - 1) * deleted.var(axis=0))
        np.testing.assert_allclose(found.isel(fmax=f), expected, rtol=1e-8, atol=1e-12)


def test_the_standard_error_is_the_scatter_of_repeated_studies(make_cube: Cube) -> None:
    """60 realizations of two parameters correlated at -0.8; the scatter of r is then (1 - r^2) / sqrt(n)."""
    rng = np.random.default_rng(3)
    cells = best(make_cube(realizations=1)).isel(realization=0, fmax=0, amplitude=0, drop=True)
    z = rng.standard_normal((300, 60, 12))
    z[..., 1] = -0.8 * z[..., 0] + 0.6 * z[..., 1]
    cells["estimate"] = xr.DataArray(z, dims=("study", "realization", "parameter"))
    out = correlation(cells).isel(parameter=0, parameter_2=1)
    scatter = float(out["value"].std(ddof=1))
    assert scatter == pytest.approx((1 - 0.8**2) / np.sqrt(60), rel=0.15)
    assert float(out["mcse"].mean()) == pytest.approx(scatter, rel=0.15)


def test_an_estimate_that_does_not_vary_has_no_correlation(make_cube: Cube) -> None:
    cells = best(make_cube(realizations=6)).compute()
    cells["estimate"][..., 2] = 1.0
    out = correlation(cells).isel(amplitude=0, fmax=0, parameter=2)
    assert out["value"].isnull().all()
    assert out["mcse"].isnull().all()
