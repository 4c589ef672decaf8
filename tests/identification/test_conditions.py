"""Fits of group FRFs in two conditions, and what they say of simulated people whose weights are known."""

from collections.abc import Iterator

import numpy as np
import pytest
import xarray as xr
from many_people import comtest, needs_comtest
from scipy.optimize import least_squares

from mcstudy.effect_library import library
from mcstudy.recordings.frf_group import group_dataset
from mcstudy.spectra.frf_groups import as_real, model_points, points_of
from mcstudy.stance.body import Body, two_segment
from mcstudy.stance.response import frf
from pipelines.validation import condition_changes
from pipelines.validation.condition_changes import Account, Pair, model_of_group
from pipelines.validation.condition_fits import best_of, fit, leaders
from pipelines.validation.conditions import Change, Conditions, changes, whitening_of
from pipelines.validation.mean_gap import mean_gap

HARMONICS = np.arange(1, 51, 2)
POINTS = [[1], [3], [5, 7], [7, 9], [9, 11, 13], [13, 15, 17], [17, 19, 21, 23], [23, 27, 31], [31, 37, 43, 49]]
WEIGHT_IN = 0.6, 0.36
PEOPLE = 10


def simulated(spread: float = 0.06, noise: float = 0.04, lag: float = 0.0, seed: int = 1) -> xr.Dataset:
    """People of different gains in two conditions, between which the weight falls from 0.6 to 0.36 and nothing else."""
    rng = np.random.default_rng(seed)
    average = np.array([np.isin(HARMONICS, p) / len(p) for p in POINTS])
    model = two_segment(stimulus="surface_tilt")
    theta = np.tile(model.truth, (PEOPLE, 2, 1))
    own = np.exp(spread * rng.standard_normal((PEOPLE, 1, len(model.names))))
    own[..., -3:-1] **= 0.5
    theta = theta * own
    theta[..., -1] = np.array(WEIGHT_IN) + 0.3 * np.log(own[..., -1])
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


@pytest.fixture(scope="module", autouse=True)
def few_starts() -> Iterator[None]:
    """Simulated people have few minima."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (
            ("LINEARISED", 1),
            ("STARTS", 40),
            ("ROUGH", 4),
            ("LEADERS", 2),
            ("KEPT", 2),
            ("AGAIN", 12),
        ):
            patch.setattr(condition_changes, name, value)
        yield


@pytest.fixture(scope="module")
def pair() -> Pair:
    group = simulated()
    return Pair(model_of_group(group), group, 0, 1)


WANTED = ("weight and active gains", "nothing", "weight", "active gains")


@pytest.fixture(scope="module")
def accounts(pair: Pair) -> dict[str, Account]:
    own = {c.name: c for c in changes(pair.model)}
    return {a.change.name: a for a in pair.accounts([own[name] for name in WANTED])}


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


def test_a_fit_never_ends_above_a_stable_start_and_is_stable_where_one_is() -> None:
    problem = two_conditions(Change("weight", (("Wprop",),)), 2)
    lower, upper = problem.bounds
    rng = np.random.default_rng(0)
    starts = rng.uniform(lower[:-1], upper[:-1], (3, 1, len(lower) - 1))
    starts = np.concatenate([starts, problem.model.truth[None, None]])
    starts = np.concatenate([starts, np.zeros((4, 1, 1))], axis=2)
    found = best_of(problem, starts, iterations=3)
    begun = np.array([problem.cost(np.tile(start, (2, 1))) for start in starts])
    stable = np.array([(problem.growth(np.tile(start, (2, 1))) < 0).all(axis=1) for start in starts])
    assert stable.any()
    assert not stable.all()
    assert (found.cost <= np.where(stable, begun, np.inf).min(axis=0)).all()
    assert (problem.growth(found.unknowns) < 0).all()


def test_an_unstable_minimum_is_led_to_the_limit_of_stability() -> None:
    """Data of a body that falls: the lowest fit falls too, and the best one that stands is beside the limit."""
    group = simulated()
    model = model_of_group(group)
    weak = model.truth.copy()
    weak[[model.names.index(n) for n in ("K11", "Kpas1")]] *= 0.72
    points = np.tile(as_real(model_points(model, weak, group)), (1, 1, 1))
    problem = condition_changes.problem_of(model, group, Change("nothing"), points, np.eye(points.size))
    assert problem.growth(weak[None])[0, 0] > 0
    free = fit(problem, weak[None])
    assert free.misfit[0] < 1e-12
    best = leaders(problem, weak[None], 2)[0]
    assert -0.1 < problem.growth(best[None])[0, 0] < 0
    assert problem.misfit(best[None])[0] < 0.1 * problem.misfit(model.truth[None])[0]


def test_no_account_is_worse_than_one_that_it_contains(pair: Pair, accounts: dict[str, Account]) -> None:
    pairs = [
        (a, b)
        for a in accounts.values()
        for b in accounts.values()
        if b.change.within(a.change, pair.model) is not None
    ]
    assert len(pairs) == 4 + 3 + 2  # itself, nothing, and the parts of two
    for larger, smaller in pairs:
        assert larger.misfit <= smaller.misfit * (1 + 1e-9), (larger.change.name, smaller.change.name)


def test_parameters_stay_within_their_bounds_in_every_condition(pair: Pair) -> None:
    model = pair.model
    weight = next(c for c in changes(model) if c.name == "weight")
    problem = pair.problem(weight, pair.mean[None], PEOPLE)
    q = np.append(model.truth, -3.0)[None]
    assert problem.parameters(q)[0, 1, -1] == 0.0
    assert weight.sizes(model, q)[0, 0] == -model.truth[-1]  # the shift that is left
    assert weight.applied(model, model.truth, q[0])[-1] == 0.0
    assert not problem.linearised(q)[1][0, :, -1].any()


def test_the_account_that_is_true_predicts_the_left_out_half(pair: Pair, accounts: dict[str, Account]) -> None:
    score = dict(zip(accounts, pair.halves(list(accounts.values()), 4), strict=True))
    assert score["weight"].mean() < 1.5
    for false in ("nothing", "active gains"):
        assert (score[false] > score["weight"]).mean() > 0.8, false
    # What is not needed does not help, and costs little
    assert score["weight and active gains"].mean() > 0.95 * score["weight"].mean()


def test_the_shift_of_the_weight_has_an_interval_near_it(pair: Pair, accounts: dict[str, Account]) -> None:
    (estimate,), true = accounts["weight"].sizes, WEIGHT_IN[1] - WEIGHT_IN[0]
    (drawn,) = pair.resampled([accounts["weight"]], 20)
    low, high = np.quantile(drawn, [0.025, 0.975])
    assert low < estimate < high
    # The mean of responses is not the response of a mean person, hence the margin.
    assert low - 0.02 < true < high + 0.02
    assert 0.0 < high - low < 0.15


def test_people_are_predicted_from_their_other_condition_by_the_others_change(
    pair: Pair, accounts: dict[str, Account]
) -> None:
    for reverse in (False, True):
        scores = pair.held_out([accounts[name] for name in ("nothing", "weight")], reverse=reverse)
        mean = {name: score.mean() for name, score in scores.items()}
        assert mean["weight"] < 0.5 * mean["nothing"]
        assert mean["weight"] < mean["mean of the others"]
        assert mean["mean of the others"] == pytest.approx(1.0, abs=0.15)


def test_the_gap_of_a_mean_names_the_effect_that_was_put_in() -> None:
    group = simulated(spread=0.03, noise=0.03, lag=0.08)
    effects = ["sensor_lag_theta1", "passive_damping_hip"]
    gap = mean_gap(model_of_group(group), group, 0, effects, folds=4)
    assert gap.gap > 4 * gap.gap_se
    assert gap.share.sum() == pytest.approx(1, rel=1e-9)
    closes = dict(zip(gap.effects, gap.closes, strict=True))
    assert closes["sensor_lag_theta1"] > 0.7
    assert max(closes, key=lambda e: closes[e]) == "sensor_lag_theta1"
    assert gap.sizes[0][0] == pytest.approx(0.08, abs=0.03)


@needs_comtest
def test_the_weight_falls_when_people_open_their_eyes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Group figure of the people on the platform at 1.0 deg (pipelines/people.md)."""
    for name, value in (("LINEARISED", 2), ("STARTS", 200), ("ROUGH", 10), ("LEADERS", 4), ("KEPT", 4)):
        monkeypatch.setattr(condition_changes, name, value)
    group = comtest()
    own = Pair(model_of_group(group), group, 1, 3)
    nothing, weight = own.accounts(changes(own.model)[:2])
    assert weight.sizes[0] < -0.1
    assert weight.misfit < 0.8 * nothing.misfit
