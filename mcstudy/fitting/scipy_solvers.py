"""Solvers of SciPy: trust-region-reflective least squares as an independent reference, and the barrier trust-constr.

Each start is fitted by itself, in Python.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
import scipy  # loads its `optimize` when it is first used: half a second that most studies never need

from mcstudy.fitting.problem import Fits, Problem
from mcstudy.fitting.solvers import Options
from mcstudy.fitting.status import Status

End = tuple[np.ndarray, float, Status, int]
"""Where one start ended: estimate (P,), cost, status, iterations."""

TRF = {0: Status.ITERATION_LIMIT, 1: Status.CONVERGED, 2: Status.CONVERGED, 3: Status.STALLED, 4: Status.CONVERGED}
TRUST_CONSTR = {0: Status.ITERATION_LIMIT, 1: Status.CONVERGED, 2: Status.CONVERGED, 3: Status.SOLVER_ERROR}

TRF_REACH = 1e-06
TRUST_CONSTR_REACH = 0.0001
"""How near a bound the solutions of a solver end that lie on it, in widths of the bounds."""


def trf(problems: Sequence[Problem], assignment: np.ndarray, starts: np.ndarray, options: Options) -> Fits:
    """Fit with ``scipy.optimize.least_squares(method="trf")`` and the exact Jacobian, scaled by the bounds' widths."""
    return _one_by_one(_trf, TRF_REACH, problems, assignment, starts, options)


def trust_constr(problems: Sequence[Problem], assignment: np.ndarray, starts: np.ndarray, options: Options) -> Fits:
    """Fit with ``scipy.optimize.minimize(method="trust-constr")``: barrier for the bounds, Gauss-Newton Hessian.

    Works in units of the bounds' widths and of the cost at the start; stops when the barrier has gone below
    the tolerance and the gradient or the step vanish.
    """
    return _one_by_one(_trust_constr, TRUST_CONSTR_REACH, problems, assignment, starts, options)


def _one_by_one(
    solve: Callable[[Problem, np.ndarray, Options], End],
    reach: float,
    problems: Sequence[Problem],
    assignment: np.ndarray,
    starts: np.ndarray,
    options: Options,
) -> Fits:
    ends = [solve(problems[r], start, options) for r, start in zip(assignment, starts, strict=True)]
    estimate, cost, status, iterations = map(np.array, zip(*ends, strict=True))
    return Fits.of(problems[0].model, estimate, cost, status, iterations, reach)


def _trf(problem: Problem, start: np.ndarray, options: Options) -> End:
    model = problem.model
    out = scipy.optimize.least_squares(
        problem.residual,
        np.clip(start, model.lower, model.upper),
        problem.jacobian,
        bounds=(model.lower, model.upper),
        x_scale=model.upper - model.lower,
        method="trf",
        ftol=options.tolerance,
        xtol=1e-15,
        gtol=None,
        max_nfev=options.max_iterations,
    )
    return out.x, 2 * out.cost, TRF[out.status], out.njev


def _trust_constr(problem: Problem, start: np.ndarray, options: Options) -> End:
    model = problem.model
    lower, width, scale = model.lower, model.upper - model.lower, problem.cost(start) or 1.0

    def value(z: np.ndarray) -> float:
        return problem.cost(lower + width * z) / scale

    def gradient(z: np.ndarray) -> np.ndarray:
        x = lower + width * z
        return 2 * (problem.jacobian(x).T @ problem.residual(x)) * width / scale

    def hessian(z: np.ndarray) -> np.ndarray:
        J = problem.jacobian(lower + width * z) * width
        return 2 * (J.T @ J) / scale

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # quasi-Newton and degenerate-barrier notices; the status tells
        out = scipy.optimize.minimize(
            value,
            np.clip((start - lower) / width, 1e-6, 1 - 1e-6),
            jac=gradient,
            hess=hessian,
            method="trust-constr",
            bounds=scipy.optimize.Bounds(np.zeros_like(width), np.ones_like(width), keep_feasible=True),
            options={
                "gtol": options.tolerance,
                "xtol": 1e-12,
                "barrier_tol": options.tolerance,
                "initial_barrier_parameter": 1e-3,
                "initial_barrier_tolerance": 1e-3,
                "maxiter": options.max_iterations,
            },
        )
    estimate = np.clip(lower + width * out.x, model.lower, model.upper)
    return estimate, problem.cost(estimate), TRUST_CONSTR[out.status], out.nit
