"""Starts needed: exact counts against brute force and simulation."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from math import comb

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis.search import convergence
from mcstudy.fitting.status import Status

Cube = Callable[..., xr.Dataset]


@pytest.mark.parametrize(("k", "n"), [(1, 7), (3, 7), (7, 7), (2, 9)])
def test_the_chance_to_miss_every_hit_is_that_of_all_possible_draws(k: int, n: int) -> None:
    for s in range(1, n + 1):
        missed = np.mean([all(i >= k for i in draw) for draw in combinations(range(n), s)])
        assert convergence.miss_probability(k, n, s) == pytest.approx(missed, abs=1e-14)
        if s <= n - k:
            assert convergence.miss_probability(k, n, s) == pytest.approx(comb(n - s, k) / comb(n, k), rel=1e-12)


def test_the_fewest_starts_are_the_first_that_suffice() -> None:
    n = 60
    k = np.arange(1, n + 1)
    found = convergence.fewest_starts(k, np.full(n, n), 0.95)
    for hits, s in zip(k, found.astype(int), strict=True):
        assert comb(n - hits, s) / comb(n, s) <= 0.05 * (1 + 1e-12)
        assert s == 1 or comb(n - hits, s - 1) / comb(n, s - 1) > 0.05


def test_one_hit_in_twenty_needs_exactly_nineteen_starts() -> None:
    # the chance to miss is then 1/20 to the last digit; rounding must not make it twenty
    assert convergence.fewest_starts(np.array([1]), np.array([20]), 0.95)[0] == 19


def test_endless_starts_follow_the_geometric_law_and_a_pool_never_needs_more() -> None:
    p = np.array([0.05, 0.3, 0.5, 0.95, 1.0])
    s = convergence.fewest_independent_starts(p, 0.95)
    assert list(s) == [59, 9, 5, 1, 1]
    pool = convergence.fewest_starts((p * 100).astype(int), np.full(5, 100), 0.95)
    assert (pool <= s).all()
    assert np.isnan(convergence.fewest_independent_starts(np.array([0.0]), 0.95)[0])


def test_a_larger_pool_approaches_endless_starts() -> None:
    assert convergence.fewest_starts(np.array([3000]), np.array([100_000]), 0.95)[0] == pytest.approx(
        convergence.fewest_independent_starts(np.array([0.03]), 0.95)[0], abs=1
    )


def test_hits_are_relative_to_the_pools_minimum_whatever_the_unit_of_cost(make_cube: Cube) -> None:
    cube = make_cube(starts=40)
    pool = convergence.hits(cube)
    np.testing.assert_array_equal(pool["hits"], (cube["growth_rate"] < 0).sum("start"))
    scaled = cube.assign(cost=cube["cost"] * 1e6)
    np.testing.assert_array_equal(convergence.hits(scaled)["hits"], pool["hits"])


def test_without_noise_all_fits_at_rounding_level_are_hits(make_cube: Cube) -> None:
    cube = make_cube(realizations=1, starts=6)
    cube["cost"][:] = [1e-29, 3e-25, 1e-20, 1e-13, 1e-6, 1e-3]
    assert (convergence.hits(cube)["hits"] == 4).all()


def test_a_failed_fit_is_a_start_spent_and_a_pending_one_is_not(make_cube: Cube) -> None:
    cube = make_cube(realizations=1, starts=10, hit_rate=1.0)
    cube["status"][..., 0] = Status.SOLVER_ERROR
    cube["status"][..., 1:3] = Status.PENDING
    pool = convergence.hits(cube)
    assert (pool["starts"] == 8).all()
    assert (pool["hits"] == 7).all()


def test_a_pool_without_a_usable_fit_has_no_answer(make_cube: Cube) -> None:
    cube = make_cube(realizations=2, starts=3)
    cube["status"][0, 0, 0] = Status.SOLVER_ERROR
    needed = convergence.starts_needed(cube).isel(amplitude=0, fmax=0)
    for name in ("value", "mcse", "lower", "upper", "from_pool"):
        assert np.isnan(needed[name].values[0]), name
        assert np.isfinite(needed[name].values[1]), name
    quantile = convergence.starts_needed_quantiles(needed)
    assert int(quantile["left_out"]) == 1


def test_quantiles_are_those_of_new_starts_and_exceed_what_a_pool_can_hold(make_cube: Cube) -> None:
    cube = make_cube(realizations=200, starts=20, hit_rate=0.05, fmax=(1.2,), amplitude=(3.0,))
    needed = convergence.starts_needed(cube)
    found = convergence.starts_needed_quantiles(needed)["value"].squeeze().values
    # one hit in twenty, the least a pool holds: ln 0.05 / ln 0.95 = 58.4, more than the 20 of the pool
    assert found.tolist() == [59.0, 59.0]
    assert float(needed["from_pool"].max()) == 19.0


def test_the_chance_of_a_missed_minimum_is_that_of_new_pools(make_cube: Cube) -> None:
    p, starts = 0.1, 30
    cube = make_cube(realizations=2000, starts=starts, hit_rate=p, fmax=(1.2,), amplitude=(3.0,))
    needed = convergence.starts_needed(cube)
    xr.testing.assert_identical(convergence.missed_minimum(cube).rename("missed"), needed["missed"])
    missed = float(needed["missed"].mean())
    # the invented pools hold at least one hit, so their rate is a little larger than p
    rate = float(needed["hit_rate"].mean())
    assert 0.5 * (1 - rate) ** starts < missed < 3 * (1 - p) ** starts


def test_the_interval_of_endless_starts_covers_the_true_number(make_cube: Cube) -> None:
    p = 0.2
    cube = make_cube(realizations=400, starts=100, hit_rate=p, fmax=(1.2,), amplitude=(3.0,))
    needed = convergence.starts_needed(cube)
    true = np.log(0.05) / np.log(1 - p)
    covered = float(((needed["lower"] - 1 < true) & (true <= needed["upper"])).mean())
    assert covered > 0.93
    scatter = float((np.log(0.05) / np.log1p(-needed["hit_rate"])).std())
    assert float(needed["mcse"].mean()) == pytest.approx(scatter, rel=0.15)
