"""Fits of group FRFs in two conditions, and what they say of simulated people whose weights are known."""

import numpy as np
import pytest
import xarray as xr
from many_people import comtest, needs_comtest
from scipy.optimize import least_squares

from mcstudy.effect_library import library
from mcstudy.identification import condition_changes
from mcstudy.identification.condition_changes import Account, Pair, model_of_group
from mcstudy.identification.conditions import Change, Conditions, changes, fit, whitening_of
from mcstudy.identification.mean_gap import mean_gap
from mcstudy.recordings.frf_group import group_dataset
from mcstudy.spectra.frf_groups import as_real, model_points, points_of
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf

HARMONICS = np.arange(1, 51, 2)
POINTS = [[1], [3], [5, 7], [7, 9], [9, 11, 13], [13, 15, 17], [17, 19, 21, 23], [23, 27, 31], [31, 37, 43, 49]]
WEIGHT_IN = 0.6, 0.36
PEOPLE = 24


def simulated(spread: float = 0.06, noise: float = 0.04, lag: float = 0.0, seed: int = 1) -> xr.Dataset:
    """People of different gains in two conditions, between which the weight falls from 0.6 to 0.36 and nothing else."""
    rng = np.random.default_rng(seed)
    average = np.array([np.isin(HARMONICS, p) / len(p) for p in POINTS])
    model = two_segment(stimulus="surface_tilt")
    theta = np.tile(model.truth, (PEOPLE, 2, 1))
    own = np.exp(spread * rng.standard_normal((PEOPLE, 1, len(model.names))))
    own[..., -3:-1] **= 0.5
    theta = theta * own
    theta[..., -1] = np.array(WEIGHT_IN) * own[..., -1]
    if lag:
        model = library.apply(model, "sensor_lag_theta1")
        theta = np.concatenate([theta, np.full((PEOPLE, 2, 1), lag)], axis=-1)
    empty = np.zeros((PEOPLE, 2, 2, len(POINTS)), dtype=complex)
    f = HARMONICS * 0.05
    conditions = [("small",), ("large",)]
    people = [str(k) for k in range(PEOPLE)]
    group = group_dataset(empty, people, conditions, ["tilt"], f, average, "surface_tilt", Body())
    lines = frf(model, theta, f)
    error = rng.standard_normal((2, *lines.shape)) * np.abs(lines) * noise
    group["frf"].values[:] = points_of(group, lines + error[0] + 1j * error[1])
    return group


@pytest.fixture(scope="module")
def pair() -> Pair:
    group = simulated()
    patch = pytest.MonkeyPatch()
    patch.setattr(condition_changes, "STARTS", 100)
    try:
        return Pair(model_of_group(group), group, 0, 1)
    finally:
        patch.undo()


@pytest.fixture(scope="module")
def accounts(pair: Pair) -> dict[str, Account]:
    wanted = ("nothing", "weight", "active gains", "delays", "weight and active gains")
    return {c.name: pair.account(c) for c in changes(pair.model) if c.name in wanted}


def two_conditions(change: Change, B: int = 3) -> Conditions:
    """Noisy problems with correlated errors and a prior."""
    group, rng = simulated(), np.random.default_rng(3)
    model = model_of_group(group)
    truth = as_real(model_points(model, model.truth, group))
    root = np.tril(rng.standard_normal((2 * truth.size, 2 * truth.size))) * 0.02 + 0.1 * np.eye(2 * truth.size)
    data = truth + 0.1 * rng.standard_normal((B, 2, truth.size))
    spread = model.truth.copy()
    return Conditions(
        model, group, change, data, whitening_of(root @ root.T), model.truth, spread, model.lower, model.upper
    )


def test_derivatives_of_the_residual_are_those_of_differences() -> None:
    model = two_segment(stimulus="surface_tilt")
    for change in changes(model):
        problem = two_conditions(change, 2)
        K = len(change.factors)
        q = np.hstack([np.tile(0.9 * problem.model.truth, (2, 1)), np.full((2, K), 0.2)])
        r, J = problem.linearised(q)
        np.testing.assert_allclose(r, problem.residual(q), rtol=1e-9, atol=1e-12)
        for k in range(q.shape[1]):
            h = 1e-5 * max(abs(q[0, k]), 0.1) * np.eye(q.shape[1])[k]
            slope = (problem.residual(q + h) - problem.residual(q - h)) / (2 * h[k])
            np.testing.assert_allclose(J[..., k], slope, rtol=1e-5, atol=1e-6 * np.abs(J[..., k]).max())


def test_minima_are_those_of_scipy() -> None:
    problem = two_conditions(Change("weight and gains", (("Wprop",), ("K11", "K12", "B11", "B12"))))
    lower, upper = problem.bounds
    start = np.hstack([np.tile(problem.model.truth, (3, 1)), np.zeros((3, 2))])
    found = fit(problem, start)
    for b in range(3):
        one = Conditions(**{**vars(problem), "data": problem.data[b : b + 1]})
        reference = least_squares(
            lambda x, one=one: one.residual(x[None])[0],
            start[b],
            lambda x, one=one: one.linearised(x[None])[1][0],
            bounds=(lower - 1e-12, upper + 1e-12),
            x_scale="jac",
            ftol=1e-12,
        )
        assert found.cost[b] <= 2 * reference.cost * (1 + 1e-5)
        assert ((found.unknowns[b] >= lower) & (found.unknowns[b] <= upper)).all()


def test_the_account_that_is_true_predicts_the_left_out_half(pair: Pair, accounts: dict[str, Account]) -> None:
    names = list(accounts)
    score = dict(zip(names, pair.halves(list(accounts.values()), 8), strict=True))
    assert score["weight"].mean() < 1.5
    for false in ("nothing", "active gains", "delays"):
        assert (score[false] > score["weight"]).mean() > 0.9, false
    # What is not needed does not help, and costs little
    assert score["weight and active gains"].mean() > 0.95 * score["weight"].mean()


def test_the_factor_of_the_weight_has_an_interval_that_holds_it(pair: Pair, accounts: dict[str, Account]) -> None:
    true = WEIGHT_IN[1] / WEIGHT_IN[0]
    (drawn,) = pair.resampled([accounts["weight"]], 30)
    low, high = np.quantile(drawn, [0.025, 0.975])
    assert low < true < high
    assert high - low < 0.3


def test_people_are_predicted_from_their_other_condition_by_the_others_change(
    pair: Pair, accounts: dict[str, Account]
) -> None:
    for reverse in (False, True):
        scores = pair.held_out(list(accounts.values()), reverse=reverse)
        mean = {name: score.mean() for name, score in scores.items()}
        assert mean["weight"] < 0.5 * mean["nothing"]
        assert mean["weight"] < mean["mean of the others"]
        assert mean["mean of the others"] == pytest.approx(1.0, abs=0.15)


def test_the_gap_of_a_mean_names_the_effect_that_was_put_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(condition_changes, "STARTS", 100)
    group = simulated(spread=0.03, noise=0.03, lag=0.08)
    effects = ["sensor_lag_theta1", "passive_damping_hip", "stimulus_gain"]
    gap = mean_gap(model_of_group(group), group, 0, effects, splits=4)
    assert gap.share.sum() == pytest.approx(gap.misfit, rel=1e-9)
    assert gap.held_out.mean() > 1.5
    closes = dict(zip(gap.effects, gap.closes.mean(axis=1), strict=True))
    assert closes["sensor_lag_theta1"] > 0.7
    assert max(closes, key=lambda e: closes[e]) == "sensor_lag_theta1"
    assert gap.sizes[0][0] == pytest.approx(0.08, abs=0.03)


@needs_comtest
def test_the_weight_falls_when_people_open_their_eyes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Group figure of the people on the platform at 1.0 deg (pipelines/people.md)."""
    monkeypatch.setattr(condition_changes, "STARTS", 200)
    group = comtest()
    model: Model = model_of_group(group)
    own = Pair(model, group, 1, 3)
    nothing, weight, gains = (own.account(c) for c in changes(model)[:3])
    assert weight.factor[0] < 0.7
    assert weight.misfit < 0.8 * min(nothing.misfit, gains.misfit)
