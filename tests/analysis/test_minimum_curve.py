"""Fig. 3B from order statistics: against every possible draw, and against the paper's own resampling."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis.search import minimum_curve as mc

Cube = Callable[..., xr.Dataset]
COSTS = np.array([3.0, 1.0, 7.0, 1.0, 2.0, 40.0])


def one_pool(make_cube: Cube, costs: np.ndarray) -> xr.Dataset:
    cube = make_cube(realizations=1, starts=costs.size, fmax=(1.2,), amplitude=(3.0,))
    cube["cost"][:] = costs
    return cube


def test_without_replacement_it_is_the_mean_over_every_subset(make_cube: Cube) -> None:
    curve = mc.minimum_curve(one_pool(make_cube, COSTS)).squeeze()
    for x in range(1, 7):
        minima = [min(draw) for draw in combinations(COSTS, x)]
        assert float(curve["mean"].sel(drawn=x)) == pytest.approx(np.mean(minima), rel=1e-12)
        assert float(curve["sd"].sel(drawn=x)) == pytest.approx(np.std(minima), rel=1e-9, abs=1e-9)


def test_pools_with_failed_fits_have_the_curves_of_their_own(make_cube: Cube) -> None:
    cube = make_cube(realizations=4, starts=6, fmax=(1.2,), amplitude=(3.0,))
    cube["cost"][:] = np.random.default_rng(5).random((4, 6))
    for realization, failed in enumerate((0, 2, 5, 6)):
        cube["cost"][0, 0, realization, :failed] = np.nan
    together = mc.minimum_curve(cube)
    for realization, failed in enumerate((0, 2, 5)):
        pool = cube.isel(realization=[realization], start=slice(failed, None))
        alone = mc.minimum_curve(pool, np.arange(1, 7)).isel(realization=0)
        for name in ("mean", "sd"):
            ours = together[name].isel(realization=realization)
            np.testing.assert_allclose(ours, alone[name], rtol=1e-12, atol=1e-15)
    assert np.isnan(together["mean"].isel(realization=3)).all()


def test_the_papers_resampling_scatters_around_it(make_cube: Cube) -> None:
    rng = np.random.default_rng(3)
    costs = rng.lognormal(0, 2, 500)
    curve = mc.minimum_curve(one_pool(make_cube, costs), np.array([1, 5, 20])).squeeze()
    for x in (1, 5, 20):
        minima = np.array([rng.choice(costs, x, replace=False).min() for _ in range(500)])
        assert abs(minima.mean() - float(curve["mean"].sel(drawn=x))) < 4 * minima.std() / np.sqrt(500)


def test_weights_are_probabilities_also_for_large_pools() -> None:
    w = mc.weights_without_replacement(2000, (1, 10, 500, 2000))
    np.testing.assert_allclose(w.sum(1), 1.0, rtol=1e-9)
    assert (w >= 0).all()


def test_noise_free_costs_keep_their_digits(make_cube: Cube) -> None:
    costs = np.array([1e-28, 1.0, 1.0, 1.0])
    curve = mc.minimum_curve(one_pool(make_cube, costs)).squeeze()
    assert float(curve["mean"].sel(drawn=4)) == pytest.approx(1e-28, rel=1e-9)


def test_the_averaged_curves_error_is_that_of_a_mean_over_realizations(make_cube: Cube) -> None:
    curve = mc.minimum_curve(make_cube(realizations=8, starts=6))
    out = mc.average_curve(curve)
    expected = curve["mean"].std("realization", ddof=1) / np.sqrt(8)
    np.testing.assert_allclose(out["mcse"], expected, rtol=1e-12)


def test_the_asymptote_is_within_one_percent_of_the_mean_minimum_or_at_rounding_without_noise(make_cube: Cube) -> None:
    cube = make_cube(realizations=20, starts=100, hit_rate=0.3, fmax=(1.2,), amplitude=(3.0,))
    curve = mc.minimum_curve(cube)
    mean, minimum = curve["mean"].mean("realization").squeeze(), float(curve["minimum"].mean())
    out = mc.asymptote(curve).squeeze()
    assert float(out["value"]) == 1 + int((mean > 1.01 * minimum).sum())
    assert float(out["lower"]) <= float(out["value"]) <= float(out["upper"])
    noise_free = one_pool(make_cube, np.array([1e-31, 1e-28, 1e-25, 1e-3]))
    assert float(mc.asymptote(mc.minimum_curve(noise_free))["value"].squeeze()) == 2


def test_the_asymptotes_error_is_its_scatter_over_repeated_studies(make_cube: Cube) -> None:
    rng = np.random.default_rng(4)
    cube = make_cube(realizations=60 * 20, starts=60, fmax=(1.2,), amplitude=(3.0,))
    rate = rng.uniform(0.1, 0.9, (1200, 1))  # realizations differ in how hard they are
    cube["cost"][0, 0] = np.where(rng.random((1200, 60)) < rate, 1.0, 2.0)
    curve = mc.minimum_curve(cube)
    studies = [
        mc.asymptote(curve.isel(realization=slice(20 * i, 20 * i + 20)), resamples=200).squeeze() for i in range(60)
    ]
    values, errors = (np.array([float(s[name]) for s in studies]) for name in ("value", "mcse"))
    assert 0.7 < np.sqrt(np.mean(errors**2)) / values.std(ddof=1) < 1.4


def test_one_pool_has_an_asymptote_and_no_error(make_cube: Cube) -> None:
    out = mc.asymptote(mc.minimum_curve(make_cube(realizations=1, starts=30))).isel(amplitude=0, fmax=0)
    assert np.isfinite(out["value"])
    assert np.isnan(out["mcse"])
