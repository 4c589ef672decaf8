"""Multilevel estimates against complete ones, and against formulas that somebody else wrote."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import mcstudy as mc
from mcstudy.analysis import accuracy
from mcstudy.planning import fits
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
    ours = estimated(Draws(x, TRUTH_VALUE), MEASURES[name])
    assert ours.value == pytest.approx(theirs["value"].item(), rel=1e-9)
    assert ours.error == pytest.approx(theirs["mcse"].item(), rel=0.05)


@pytest.mark.parametrize("name", MEASURES)
def test_a_control_changes_neither_the_expectation_nor_the_truth_of_the_error(name: str) -> None:
    """With a control that is wrong in 5 % of realizations and biased in all of them."""
    rng = np.random.default_rng(7)
    x = skewed(rng, 400, 1000)
    wrong = rng.random(x.shape) < 0.05
    control = np.where(wrong, x + rng.normal(0.5, 0.5, x.shape), x + 0.1)
    n = 150
    found = [
        estimated(Draws(y[:n], TRUTH_VALUE, c[:n], c[n:]), MEASURES[name]) for c, y in zip(control, x, strict=True)
    ]
    values, errors = np.array([f.value for f in found]), np.array([f.error for f in found])
    mean, sd = TRUTH_VALUE + 0.4 + 1.0, 0.5 * np.sqrt(2)
    exact = {"bias": 1.4, "sd": sd, "cv": sd / mean, "rmse": np.hypot(sd, 1.4)}[name]
    assert abs(values.mean() - exact) < 3.5 * values.std() / np.sqrt(len(values)) + 0.003 * exact
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(values.std(), rel=0.12)
    plain = [estimated(Draws(y[:n], TRUTH_VALUE), MEASURES[name]).value for y in x]
    assert values.std() < 0.8 * np.std(plain)


@pytest.mark.parametrize("name", MEASURES)
def test_the_error_of_a_measure_can_be_a_measure(name: str) -> None:
    x = skewed(np.random.default_rng(3), 1, 4000)[0]
    one = estimated(Draws(x, TRUTH_VALUE), of_one_realization(MEASURES[name]))
    again = estimated(Draws(x, TRUTH_VALUE), MEASURES[name]).error
    assert one.value / np.sqrt(x.size) == pytest.approx(again, rel=0.01)
    rng = np.random.default_rng(4)
    spread = np.std(
        [
            estimated(Draws(y, TRUTH_VALUE), of_one_realization(MEASURES[name])).value
            for y in (rng.choice(x, x.size) for _ in range(200))
        ]
    )
    assert one.error == pytest.approx(spread, rel=0.2)


def test_the_share_of_complete_fits_is_the_cheapest_one() -> None:
    cost, shares = 50.0, np.geomspace(0.001, 1, 2000)
    for difference in (0.001, 0.05):
        product = (1 + difference / shares) * (1 + shares * (cost + 1))  # variance times cost of both levels
        k = product.argmin()
        assert best_share(difference, 1.0, cost + 1) == pytest.approx(shares[k], rel=0.01)
        assert relative_cost(difference, 1.0, cost) == pytest.approx(product[k] / cost, rel=0.01)


def test_too_few_usable_fits_give_no_estimate() -> None:
    x = np.full(20, np.nan)
    x[:5] = 1.0
    assert np.isnan(estimated(Draws(x, 1.0), MEASURES["sd"]).value)


def test_realizations_without_a_usable_fit_are_left_out_with_their_control() -> None:
    rng = np.random.default_rng(5)
    x, c = rng.normal(1.0, 0.2, (2, 40))
    failed = np.concatenate([x, [np.nan] * 5])
    with_failed = estimated(Draws(failed, 1.0, np.concatenate([c, np.full(5, 9.0)]), c), MEASURES["cv"])
    assert with_failed.value == pytest.approx(estimated(Draws(x, 1.0, c, c), MEASURES["cv"]).value)
    assert (with_failed.own[40:] == 0).all()


def study_of(realizations: int) -> Study:
    """Records a seventh as long as the paper's."""
    return Study("fits", seed=4).group(
        "a",
        realizations=realizations,
        starts=8,
        fmax=[1.2],
        amplitude=[5.0],
        stimulus={"stages": 6, "cycles": 8, "rate_hz": 50.0},
        spectra={"points": "odd_lines"},
    )


@pytest.fixture(scope="module")
def fitter() -> Fitter:
    return Fitter(study_of(4).groups["a"], 4, (1.2,), threads=2)


def test_complete_fits_are_those_of_the_study(fitter: Fitter, tmp_path: Path) -> None:
    best = mc.run(study_of(12), tmp_path / "fits.zarr", workers=1)["a"].mc.best()
    ours = fitter.realizations(Design(8, 5.0, 1.2), FULL, 12)
    np.testing.assert_array_equal(ours, best["estimate"].values[0, 0])


def test_multilevel_and_complete_estimates_agree(fitter: Fitter) -> None:
    """Complete fits of other realizations against both levels, for every parameter and measure, in standard errors."""
    design, n, R = Design(8, 5.0, 1.2), 32, 160
    full = fitter.realizations(design, FULL, R)
    for kind in (TRUTH, LINEARISED):
        control, sample = fitter.realizations(design, kind, n), fitter.draws(design, kind, 256 if kind == TRUTH else 96)
        apart = []
        for k, truth in enumerate(fitter.model.truth):
            for measure in MEASURES.values():
                cheap = estimated(Draws(full[:n, k], truth, control[:, k], sample[:, k]), measure)
                whole = estimated(Draws(full[n:, k], truth), measure)
                apart.append((cheap.value - whole.value) / np.hypot(cheap.error, whole.error))
        assert np.abs(apart).max() < 4
        assert np.mean(np.square(apart)) < 2.5


def test_fits_are_made_once_and_counted(fitter: Fitter) -> None:
    design = Design(4, 5.0, 1.2)
    before = fitter.spent.fits
    first = fitter.realizations(design, FULL, 5)
    more = fitter.realizations(design, FULL, 9)
    np.testing.assert_array_equal(more[:5], first)
    assert fitter.spent.fits - before == 9 * 8
    fitter.realizations(design, TRUTH, 9)
    assert fitter.spent.fits - before == 9 * 8 + 9
    assert fitter.cost(TRUTH) < fitter.cost(FULL) / 2


def test_realizations_beyond_the_kept_ones_come_in_the_same_order(fitter: Fitter) -> None:
    design = Design(3, 5.0, 1.2)
    plain = fitter.realizations(design, TRUTH, 10)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(fits, "KEPT_REALIZATIONS", 4)
        other = Fitter(fitter.group, 4, (1.2,), threads=1).realizations(design, TRUTH, 10)
    np.testing.assert_array_equal(other, plain)


def test_a_control_that_agrees_saves_most_fits() -> None:
    rng = np.random.default_rng(2)
    x = rng.normal(1.0, 0.2, 300)
    assert difference_of(Draws(x, 1.0, x), MEASURES["cv"]) == 0
    assert difference_of(Draws(x, 1.0, rng.normal(1.0, 0.2, 300)), MEASURES["cv"]) > 1


def test_draws_have_the_noise_of_the_study_table_or_not() -> None:
    plain = study_of(4).groups["a"]
    joint = [Fitter(plain, 4, (1.2,)).law(8).joint]
    for level in (1e-3, 4e-3):
        table = {"f_hz": [0.1, 1.0], "theta1": [level, level / 2], "theta2": [level, level / 3]}
        fields = plain.model_dump(mode="json") | {"noise": {"table": table}}
        group = Study("table", seed=4).group("a", **fields).groups["a"]
        joint.append(Fitter(group, 4, (1.2,)).law(8).joint)
    np.testing.assert_allclose(joint[2], 4 * joint[1], rtol=1e-9)
    assert not np.allclose(np.diag(joint[0]), np.diag(joint[1]), rtol=0.1, atol=0)
