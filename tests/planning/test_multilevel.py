"""Multilevel estimates against complete ones, and against formulas that somebody else wrote."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from mcstudy.analysis import accuracy
from mcstudy.planning.fits import FULL, LINEARISED, TRUTH, Design, Fitter
from mcstudy.planning.multilevel import (
    MEASURES,
    Draws,
    best_share,
    difference_of,
    estimated,
    of_one_realization,
    relative_cost,
)
from mcstudy.study.design import Study

TRUTH_VALUE = 3.0


def skewed(rng: np.random.Generator, repetitions: int, n: int) -> np.ndarray:
    """Estimates (repetitions, n) that are neither normal nor unbiased."""
    return TRUTH_VALUE + 0.4 + 0.5 * rng.gamma(2.0, 1.0, (repetitions, n))


@pytest.mark.parametrize("name", MEASURES)
def test_without_a_control_the_estimate_and_its_error_are_those_of_a_study(name: str) -> None:
    x = skewed(np.random.default_rng(1), 1, 400)[0]
    cells = xr.Dataset(
        {
            "estimate": (("amplitude", "fmax", "realization", "parameter"), x[None, None, :, None]),
            "truth": (("parameter",), [TRUTH_VALUE]),
            "parameter_unit": (("parameter",), ["s"]),
        },
        coords={"parameter": ["Td1"], "amplitude": [5.0], "fmax": [1.2], "realization": np.arange(400)},
    ).set_coords("parameter_unit")
    theirs = getattr(accuracy, name)(cells)  # the jackknife of the analysis, not the delta method
    ours = estimated(Draws(x, x, TRUTH_VALUE), MEASURES[name])
    assert ours.value == pytest.approx(theirs["value"].item(), rel=1e-9)
    assert ours.error == pytest.approx(theirs["mcse"].item(), rel=0.05)


@pytest.mark.parametrize("name", MEASURES)
def test_a_control_changes_neither_the_expectation_nor_the_truth_of_the_error(name: str) -> None:
    """With a control that is wrong in 5 % of realizations and biased in all of them."""
    rng = np.random.default_rng(7)
    x = skewed(rng, 400, 600)
    wrong = rng.random(x.shape) < 0.05
    control = np.where(wrong, x + rng.normal(0.5, 0.5, x.shape), x + 0.1)
    n = 150
    found = [estimated(Draws(c, y[:n], TRUTH_VALUE), MEASURES[name]) for c, y in zip(control, x, strict=True)]
    values, errors = np.array([f.value for f in found]), np.array([f.error for f in found])
    mean, sd = TRUTH_VALUE + 0.4 + 1.0, 0.5 * np.sqrt(2)
    exact = {"bias": 1.4, "sd": sd, "cv": sd / mean, "rmse": np.hypot(sd, 1.4)}[name]
    assert abs(values.mean() - exact) < 3.5 * values.std() / np.sqrt(len(values)) + 0.003 * exact
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(values.std(), rel=0.12)
    plain = [estimated(Draws(y[:n], y[:n], TRUTH_VALUE), MEASURES[name]).value for y in x]
    assert values.std() < 0.8 * np.std(plain)


@pytest.mark.parametrize("name", MEASURES)
def test_the_error_of_a_measure_can_be_a_measure(name: str) -> None:
    x = skewed(np.random.default_rng(3), 1, 4000)[0]
    one = estimated(Draws(x, x, TRUTH_VALUE), of_one_realization(MEASURES[name]))
    again = estimated(Draws(x, x, TRUTH_VALUE), MEASURES[name]).error
    assert one.value / np.sqrt(x.size) == pytest.approx(again, rel=0.01)
    rng = np.random.default_rng(4)
    spread = np.std(
        [
            estimated(Draws(y, y, TRUTH_VALUE), of_one_realization(MEASURES[name])).value
            for y in (rng.choice(x, x.size) for _ in range(200))
        ]
    )
    assert one.error == pytest.approx(spread, rel=0.2)


def test_the_share_of_complete_fits_is_the_cheapest_one() -> None:
    cost, shares = 50.0, np.geomspace(0.001, 1, 2000)
    for difference in (0.001, 0.05):
        # independent levels: variance times fits, of one control and a share of pairs
        product = (1 + difference / shares) * (1 + shares * (cost + 1))
        assert best_share(difference, 1.0, cost) == pytest.approx(shares[product.argmin()], rel=0.1)
        assert relative_cost(difference, 1.0, cost) == pytest.approx(product.min() / cost, rel=0.01)


def test_too_few_usable_fits_give_no_estimate() -> None:
    x = np.full(20, np.nan)
    x[:5] = 1.0
    assert np.isnan(estimated(Draws(np.zeros(20), x, 1.0), MEASURES["sd"]).value)


@pytest.fixture(scope="module")
def fitter() -> Fitter:
    study = Study("fits", seed=4).group("a", realizations=4, starts=8, fmax=[1.2], amplitude=[5.0])
    return Fitter(study.groups["a"], 4, (1.2, 8.0), threads=2)


def test_complete_fits_are_those_of_the_study(fitter: Fitter, tmp_path: object) -> None:
    import mcstudy as mc

    study = mc.Study("fits", seed=4).group("a", realizations=12, starts=8, fmax=[1.2], amplitude=[3.0])
    best = mc.run(study, f"{tmp_path}/fits.zarr", workers=1)["a"].mc.best()
    ours = fitter.estimates(Design(6, 3.0, 1.2), FULL, 12)
    np.testing.assert_array_equal(ours, best["estimate"].values[0, 0])


def test_multilevel_and_complete_estimates_differ_by_no_more_than_their_difference_varies(fitter: Fitter) -> None:
    """The paired difference of both estimates over blocks of realizations, for every parameter and measure."""
    design, R, n = Design(6, 5.0, 1.2), 96, 32
    full = fitter.estimates(design, FULL, R)
    for kind in (TRUTH, LINEARISED):
        control = fitter.estimates(design, kind, R)
        for k, truth in enumerate(fitter.model.truth):
            for measure in MEASURES.values():
                cheap = estimated(Draws(control[:, k], full[:n, k], truth), measure)
                whole = estimated(Draws(full[:, k], full[:, k], truth), measure)
                apart = np.sqrt(np.sum((cheap.contributions - whole.contributions) ** 2))
                assert abs(cheap.value - whole.value) < 4 * apart + 0.02 * abs(whole.value)


def test_fits_are_made_once_and_counted(fitter: Fitter) -> None:
    design = Design(4, 5.0, 1.2)
    before = fitter.spent.fits
    first = fitter.estimates(design, FULL, 5)
    more = fitter.estimates(design, FULL, 9)
    np.testing.assert_array_equal(more[:5], first)
    assert fitter.spent.fits - before == 9 * 8
    fitter.estimates(design, TRUTH, 9)
    assert fitter.spent.fits - before == 9 * 8 + 9
    assert fitter.cost(TRUTH) < fitter.cost(FULL) / 2


def test_realizations_beyond_the_kept_ones_come_in_the_same_order(fitter: Fitter) -> None:
    from mcstudy.planning import fits

    study = Study("fits", seed=4).group("a", realizations=4, starts=8, fmax=[1.2], amplitude=[5.0])
    design = Design(3, 5.0, 1.2)
    plain = fitter.estimates(design, TRUTH, 10)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(fits, "KEPT_REALIZATIONS", 4)
        other = Fitter(study.groups["a"], 4, (1.2,), threads=1).estimates(design, TRUTH, 10)
    np.testing.assert_array_equal(other, plain)


def test_a_control_that_agrees_saves_most_fits() -> None:
    rng = np.random.default_rng(2)
    x = rng.normal(1.0, 0.2, 300)
    assert difference_of(Draws(x, x, 1.0), MEASURES["cv"]) == 0
    other = rng.normal(1.0, 0.2, 300)
    assert difference_of(Draws(other, x, 1.0), MEASURES["cv"]) > 1
