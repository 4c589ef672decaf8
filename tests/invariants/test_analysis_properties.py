"""Properties that hold for every cube, found or refuted by Hypothesis."""

from __future__ import annotations

import numpy as np
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mcstudy.analysis.montecarlo import jackknife, quantiles, wilson
from mcstudy.analysis.search.basins import basins
from mcstudy.analysis.search.convergence import fewest_starts, hits, miss_probability, starts_needed
from mcstudy.analysis.search.minimum_curve import minimum_curve, weights_without_replacement
from mcstudy.analysis.selection import best
from mcstudy.fitting.status import Status

COSTS = arrays(float, st.tuples(st.just(3), st.integers(1, 12)), elements=st.floats(1e-6, 1e3))
quick = settings(max_examples=40, deadline=None)


def cube(costs: np.ndarray, status: np.ndarray | None = None) -> xr.Dataset:
    """One amplitude, one Fmax; two parameters that follow the cost."""
    cell = ("amplitude", "fmax", "realization", "start")
    R, S = costs.shape
    estimate = np.stack([costs, np.sqrt(costs)], axis=-1)
    return xr.Dataset(
        {
            "cost": (cell, costs[None, None]),
            "status": (cell, (np.full((R, S), Status.CONVERGED) if status is None else status)[None, None]),
            "estimate": ((*cell, "parameter"), estimate[None, None]),
            "growth_rate": (cell, np.zeros((1, 1, R, S))),
            "at_bound": ((*cell, "parameter"), np.zeros((1, 1, R, S, 2), dtype=np.int8)),
            "truth": ("parameter", [1.0, 1.0]),
            "lower": ("parameter", [0.0, 0.0]),
            "upper": ("parameter", [1e3, 40.0]),
        },
        coords={"start": np.arange(S), "parameter": ["a", "b"]},
    )


@given(COSTS, st.randoms(use_true_random=False))
@quick
def test_the_best_fit_does_not_depend_on_the_order_of_the_starts(costs: np.ndarray, random: st.DataObject) -> None:
    data = cube(costs)
    order = list(range(costs.shape[1]))
    random.shuffle(order)  # type: ignore[attr-defined]
    shuffled = best(data.isel(start=order))
    np.testing.assert_array_equal(shuffled["cost"], best(data)["cost"])
    np.testing.assert_array_equal(shuffled["estimate"], best(data)["estimate"])


@given(COSTS, st.data())
@quick
def test_no_status_but_a_usable_one_ever_wins(costs: np.ndarray, data: st.DataObject) -> None:
    status = data.draw(arrays(np.uint8, costs.shape, elements=st.sampled_from([int(s) for s in Status])))
    cells = best(cube(costs, status))
    usable = np.isin(status, [int(s) for s in Status if s.usable])
    lowest = np.where(usable, costs, np.inf).min(axis=1)
    np.testing.assert_array_equal(cells["cost"].values[0, 0], np.where(np.isfinite(lowest), lowest, np.nan))
    np.testing.assert_array_equal(cells["best_start"].values[0, 0] == -1, ~usable.any(axis=1))


@given(COSTS, st.floats(1e-3, 1e3))
@quick
def test_starts_needed_and_basins_have_no_unit(costs: np.ndarray, unit: float) -> None:
    data, scaled = cube(costs), cube(costs).assign(cost=cube(costs)["cost"] * unit)
    one, other = (hits(d, floor=0.0)["hits"] for d in (data, scaled))
    boundary = np.abs(costs / costs.min(axis=1, keepdims=True) - 1.001) < 1e-9
    if not boundary.any():
        np.testing.assert_array_equal(one, other)
    assert (basins(data)["n_basins"] >= 1).all()


@given(st.integers(1, 300), st.data())
@quick
def test_more_starts_never_hurt_and_all_of_them_always_suffice(n: int, data: st.DataObject) -> None:
    k = data.draw(st.integers(1, n))
    missed = miss_probability(k, n, np.arange(n + 1))
    assert missed[0] == 1.0
    assert (np.diff(missed) <= 1e-12).all()
    assert missed[n - k + 1 :].max(initial=0.0) == 0.0
    assert 1 <= fewest_starts(np.array([k]), np.array([n]), 0.95)[0] <= n - k + 1


@given(COSTS)
@quick
def test_every_start_a_hit_needs_one_start_and_otherwise_no_more_than_the_pool(costs: np.ndarray) -> None:
    needed = starts_needed(cube(costs))
    assert ((needed["from_pool"] >= 1) & (needed["from_pool"] <= costs.shape[1])).all()
    for name in ("from_pool", "value"):
        assert (needed[name].where(needed["hits"] == needed["starts"], 1) == 1).all()
    assert ((needed["from_pool"] <= needed["value"]) & (needed["lower"] <= needed["value"])).all()
    assert (needed["value"] <= needed["upper"]).all()


@given(COSTS)
@quick
def test_the_minimum_curve_falls_from_the_mean_to_the_minimum(costs: np.ndarray) -> None:
    curve = minimum_curve(cube(costs))
    np.testing.assert_allclose(curve["mean"].isel(drawn=0).squeeze(), costs.mean(1), rtol=1e-9)
    np.testing.assert_allclose(curve["mean"].isel(drawn=-1).squeeze(), costs.min(1), rtol=1e-9)
    steps = curve["mean"].diff("drawn")
    assert (steps <= 1e-9 * curve["mean"].isel(drawn=0)).all()


@given(st.integers(1, 80), st.integers(1, 200))
@quick
def test_order_weights_are_probabilities(n: int, x: int) -> None:
    w = weights_without_replacement(n, (x,))
    assert w.min() >= 0
    assert np.isclose(w.sum(), 1.0, rtol=1e-9)


VALUES = arrays(float, st.integers(3, 30), elements=st.floats(-1e3, 1e3, width=32))


@given(VALUES, st.floats(0.1, 10), st.floats(-100, 100))
@quick
def test_errors_scale_with_the_unit_and_do_not_move_with_the_origin(x: np.ndarray, unit: float, origin: float) -> None:
    truth = xr.DataArray(0.0)

    def error(values: np.ndarray) -> float:
        return float(jackknife(xr.DataArray(values, dims="realization"), truth, lambda m: m.sd)["mcse"])

    spread = float(np.ptp(x)) + 1.0
    np.testing.assert_allclose(error(x * unit + origin), unit * error(x), atol=1e-5 * unit * spread)


@given(VALUES)
@quick
def test_a_quantile_is_an_observed_value_inside_its_interval(x: np.ndarray) -> None:
    out = quantiles(xr.DataArray(x, dims="realization"), (0.5, 0.9))
    assert np.isin(out["value"], x).all()
    assert (out["lower"].isnull() | (out["lower"] <= out["value"])).all()
    assert (out["upper"].isnull() | (out["upper"] >= out["value"])).all()


@given(st.integers(1, 500), st.data())
@quick
def test_wilson_intervals_hold_the_fraction_and_stay_in_range(n: int, data: st.DataObject) -> None:
    k = data.draw(st.integers(0, n))
    out = wilson(xr.DataArray(k), xr.DataArray(n))
    assert 0 <= float(out["lower"]) <= k / n + 1e-12
    assert k / n - 1e-12 <= float(out["upper"]) <= 1
    assert float(out["mcse"]) > 0
