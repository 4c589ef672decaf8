"""Fits whose closed loop must be stable, against an optimiser and a root finder of another kind."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize

from mcstudy.fitting.problem import Problem, ml_cost
from mcstudy.fitting.solvers import Options, fit
from mcstudy.fitting.starts import uniform
from mcstudy.fitting.status import Status
from mcstudy.stance.feedback import Model, Parameter, Term
from mcstudy.stance.response import frf
from mcstudy.stance.roots import loops_of, slopes
from mcstudy.stance.stability import growth_rate, rightmost_root

J, MGH = 80.0, 700.0
MARGIN = 0.05
F = np.linspace(0.1, 1.2, 12)


def pendulum() -> Model:
    """An inverted pendulum on delayed feedback of angle and rate, near the end of what a delay of 0.12 s allows."""
    parameters = (
        Parameter("K", "N m/rad", 1250.0, 0.0, 4000.0),
        Parameter("B", "N m s/rad", 330.0, 0.0, 1500.0),
        Parameter("tau", "s", 0.20, 0.02, 0.4),
    )
    terms = (
        Term("ankle", "q", order=2, coefficient=J),
        Term("ankle", "q", coefficient=-MGH),
        Term("ankle", "q", ("K",), delay="tau", noisy=True),
        Term("ankle", "q", ("B",), order=1, delay="tau", noisy=True),
        Term("ankle", "stimulus"),
    )
    return Model("pendulum", parameters, terms, rows=("ankle",), angles=("q",))


def falling(seed: int) -> Problem:
    """Noisy data that an unstable loop fits best."""
    model, rng = pendulum(), np.random.default_rng(seed)
    response = frf(model, np.array([1250.0, 330.0, 0.26]), F)
    sd = 0.25 * np.abs(response)
    noise = sd * (rng.standard_normal(response.shape) + 1j * rng.standard_normal(response.shape)) / np.sqrt(2)
    return ml_cost(model, F, response + noise, (sd**2)[:, :, None].astype(complex))


def by_collocation(theta: np.ndarray, order: int = 16) -> float:
    """Largest real part of the pendulum's roots: eigenvalues of its history on Chebyshev points (Trefethen 2000)."""
    K, B, tau = theta
    x = np.cos(np.pi * np.arange(order + 1) / order)
    c = np.where((np.arange(order + 1) % order) == 0, 2.0, 1.0) * (-1.0) ** np.arange(order + 1)
    D = np.outer(c, 1 / c) / (x[:, None] - x + np.eye(order + 1))
    D -= np.diag(D.sum(axis=1))
    A = np.kron(2 / tau * D, np.eye(2))
    A[:2] = 0.0
    A[0, 1], A[1, 0] = 1.0, MGH / J
    A[1, -2:] = -K / J, -B / J
    return float(np.linalg.eigvals(A).real.max())


def constrained_by_scipy(problem: Problem, starts: np.ndarray) -> float:
    """Lowest cost that sequential quadratic programming finds from any of the starts."""
    model = problem.model
    lower, width = model.lower, model.upper - model.lower
    found = [
        scipy.optimize.minimize(
            lambda z: problem.cost(lower + width * z) / 100,
            (start - lower) / width,
            method="SLSQP",
            bounds=[(0, 1)] * len(lower),
            constraints={"type": "ineq", "fun": lambda z: -MARGIN - by_collocation(lower + width * z)},
            options={"ftol": 1e-9, "maxiter": 200},
        )
        for start in starts
    ]
    kept = [100 * f.fun for f in found if by_collocation(lower + width * f.x) < -MARGIN + 1e-5]
    return float(min(kept))


@pytest.mark.parametrize("seed", [1, 5])
def test_the_lowest_cost_of_a_stable_loop_is_that_of_sequential_quadratic_programming(seed: int) -> None:
    problem = falling(seed)
    starts = uniform(problem.model, np.random.default_rng(seed), 12)
    free, held = fit(problem, starts), fit(problem, starts, options=Options(margin=MARGIN))
    assert growth_rate(problem.model, free.estimate[free.best]) > 0
    best = held.estimate[held.best]
    assert by_collocation(best) <= -MARGIN + 1e-6
    assert free.cost[free.best] < held.cost[held.best]
    around = best * np.random.default_rng(seed).uniform(0.95, 1.05, (2, 3))
    assert held.cost[held.best] == pytest.approx(constrained_by_scipy(problem, around), rel=1e-3)


def test_a_stable_end_is_left_as_it_is() -> None:
    problem = falling(1)
    exact = problem.__class__(F, frf(problem.model, problem.model.truth, F), problem.weight, problem.model)
    starts = problem.model.truth[None] * [[1.0], [1.02]]
    free, held = fit(exact, starts), fit(exact, starts, options=Options(margin=MARGIN))
    assert (free.estimate == held.estimate).all()
    assert (free.cost == held.cost).all()


def test_derivatives_of_roots_are_those_of_differences() -> None:
    model = pendulum()
    theta = uniform(model, np.random.default_rng(3), 5)
    root = rightmost_root(model, theta).root[:, None]
    analytic = slopes(loops_of(model)[0], theta, root)[:, 0]
    step = 1e-5 * (model.upper - model.lower)
    for p in range(3):
        d = np.eye(3)[p] * step
        numeric = (growth_rate(model, theta + d) - growth_rate(model, theta - d)) / (2 * step[p])
        np.testing.assert_allclose(analytic[:, p] * step[p], numeric * step[p], rtol=1e-4, atol=1e-12)


def test_where_nothing_stable_exists_the_fit_is_left_out() -> None:
    """Half of gravity's stiffness at most: no delay makes this stand."""
    model = pendulum()
    weak = model.with_values({"K": 300.0}).with_bounds({"K": (0.0, 350.0)})
    problem = ml_cost(weak, F, frf(weak, weak.truth, F), np.ones((len(F), 1, 1), dtype=complex))
    fits = fit(problem, uniform(weak, np.random.default_rng(0), 3), options=Options(margin=MARGIN))
    assert (fits.status == Status.UNSTABLE).all()
    assert np.isnan(fits.cost).all()
