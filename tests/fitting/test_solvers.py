"""Solvers agree with each other, stay inside the bounds and say how they ended."""

import numpy as np
import pytest
from fit_problems import F, example, measured

from mcstudy.fitting.problem import Problem, paper_cost
from mcstudy.fitting.solvers import Options, fit, fit_many
from mcstudy.fitting.starts import uniform
from mcstudy.fitting.status import Status
from mcstudy.stance.body import WEIGHTS, two_segment
from mcstudy.stance.feedback import Parameter, Term
from mcstudy.stance.response import frf


def test_a_noise_free_single_stimulus_identifies_all_12_parameters() -> None:
    model = two_segment()
    f = np.append(F, np.array([259, 280, 310, 350]) / 43.72)
    problem = paper_cost(model, f, frf(model, model.truth, f))
    fits = fit(problem, uniform(model, np.random.default_rng(0), 50))
    best = fits.estimate[fits.best]
    assert np.abs(best / model.truth - 1).max() < 1e-8  # 1e-6 %; the paper reports 0.039 %


@pytest.mark.parametrize("stimulus", WEIGHTS)
def test_a_noise_free_tilt_identifies_the_12_parameters_and_its_weight(stimulus: str) -> None:
    model = two_segment(stimulus=stimulus)
    problem = paper_cost(model, F, frf(model, model.truth, F))
    fits = fit(problem, uniform(model, np.random.default_rng(0), 30))
    assert np.abs(fits.estimate[fits.best] / model.truth - 1).max() < 1e-7
    start = model.truth[None] * 1.05
    noisy = paper_cost(model, F, measured(model, np.random.default_rng(1), 0.003))
    lm, trf = (fit(noisy, start, s, Options(1e-12, 1000)) for s in ("lm", "trf"))
    assert lm.cost[0] == pytest.approx(trf.cost[0], rel=1e-9)


@pytest.mark.parametrize("kind", ["paper", "ml"])
def test_lm_trf_and_trust_constr_reach_the_same_minimum_from_the_same_start(kind: str) -> None:
    problem = example(kind, seed=1, noise=0.003)
    start = problem.model.truth[None] * 1.05
    fits = {s: fit(problem, start, s, Options(1e-12, 1000)) for s in ("lm", "trf", "trust-constr")}
    cost = {s: fits[s].cost[0] for s in fits}
    assert cost["lm"] == pytest.approx(cost["trf"], rel=1e-10)
    assert cost["lm"] == pytest.approx(cost["trust-constr"], rel=1e-6)  # its inner solves are inexact
    width = problem.model.upper - problem.model.lower
    assert np.abs((fits["lm"].estimate - fits["trf"].estimate) / width).max() < 1e-5
    assert np.abs((fits["lm"].estimate - fits["trust-constr"].estimate) / width).max() < 1e-3


def test_estimates_stay_inside_the_bounds_and_bound_hits_are_exact() -> None:
    problem = example("paper", noise=0.4)
    fits = fit(problem, uniform(problem.model, np.random.default_rng(2), 12))
    model = problem.model
    assert ((fits.estimate >= model.lower) & (fits.estimate <= model.upper)).all()
    np.testing.assert_array_equal(fits.at_bound == -1, fits.estimate == model.lower)
    np.testing.assert_array_equal(fits.at_bound == 1, fits.estimate == model.upper)


def test_solvers_agree_on_which_bounds_a_minimum_lies_on() -> None:
    problem = example("paper", noise=0.4)
    start = fit(problem, uniform(problem.model, np.random.default_rng(2), 8)).estimate
    lm, trf = fit(problem, start), fit(problem, start, "trf")
    assert (lm.at_bound != 0).any()
    assert (trf.estimate >= problem.model.lower).all()
    assert (trf.estimate <= problem.model.upper).all()
    same = np.abs(trf.cost / lm.cost - 1) < 1e-9
    assert same.sum() >= 4
    np.testing.assert_array_equal(trf.at_bound[same], lm.at_bound[same])


def test_converged_fits_are_minima_within_the_bounds() -> None:
    problem = example("ml", noise=0.3)
    model = problem.model
    fits = fit(problem, uniform(model, np.random.default_rng(4), 40))
    assert (fits.status == Status.CONVERGED).all()
    assert (fits.at_bound != 0).any()
    for x, cost, bound in zip(fits.estimate, fits.cost, fits.at_bound, strict=True):
        J = problem.jacobian(x)
        gradient = J.T @ problem.residual(x) / np.linalg.norm(J, axis=0) / np.sqrt(cost)
        assert np.abs(gradient[bound == 0]).max() < 1e-5
        assert (gradient[bound == -1] > -1e-5).all()
        assert (gradient[bound == 1] < 1e-5).all()


def test_the_iteration_limit_is_reported_and_counted() -> None:
    problem = example("paper")
    fits = fit(problem, uniform(problem.model, np.random.default_rng(0), 9), "lm", Options(max_iterations=3))
    assert (fits.status == Status.ITERATION_LIMIT).all()
    assert (fits.iterations == 3).all()


def test_a_model_that_is_not_finite_is_an_outcome() -> None:
    integral = two_segment().with_terms(
        (Parameter("Ki", "N m/(rad s)", 10.0, 0.0, 20.0),), (Term("ankle", "theta1", ("Ki",), -1),)
    )
    f = np.array([0.0, *F])
    weight = np.tile(np.eye(2, dtype=complex), (f.size, 1, 1))
    problem = Problem(f, np.ones((f.size, 2), dtype=complex), weight, integral)
    fits = fit(problem, uniform(integral, np.random.default_rng(0), 3))
    assert (fits.status == Status.NON_FINITE_MODEL).all()


def test_fit_many_keeps_finite_and_other_problems_apart() -> None:
    problems = [example("paper", seed) for seed in range(3)]
    problems[1].y[0, 0] = np.inf
    starts = np.stack([uniform(p.model, np.random.default_rng(k), 4) for k, p in enumerate(problems)])
    for solver in ("lm", "trf"):
        many = fit_many(problems, starts, solver)
        assert (many[1].status == Status.NON_FINITE_DATA).all()
        for k in (0, 2):
            np.testing.assert_array_equal(many[k].estimate, fit(problems[k], starts[k], solver).estimate)


def test_no_start_is_no_error() -> None:
    problem = example("paper")
    assert fit(problem, np.empty((0, 12))).cost.shape == (0,)
