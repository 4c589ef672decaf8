"""SciPy's trust-constr (an interior-point method) as the stand-in for the paper's fmincon."""

from __future__ import annotations

import warnings

import numpy as np
import scipy  # loads its `optimize` when it is first used: half a second that most studies never need

from mcstudy.fitting.problem import Fits, Problem
from mcstudy.fitting.status import Status

_STATUS = {0: Status.ITERATION_LIMIT, 1: Status.CONVERGED, 2: Status.CONVERGED, 3: Status.SOLVER_ERROR}

REACH = 0.0001
"""How near a bound its solutions end that lie on it, in widths of the bounds."""


def trust_constr(problem: Problem, starts: np.ndarray, tolerance: float, max_iterations: int) -> Fits:
    """Fit with ``scipy.optimize.minimize(method="trust-constr")``: barrier for the bounds, Gauss-Newton Hessian.

    Works in units of the bounds' widths and of the cost at the start; stops when the barrier has gone below
    ``tolerance`` and the gradient or the step vanish.
    """
    model = problem.model
    lower, width = model.lower, model.upper - model.lower
    estimate, cost = np.empty_like(starts), np.empty(len(starts))
    status, iterations = np.empty(len(starts), dtype=np.uint8), np.empty(len(starts), dtype=np.int32)
    for i, x0 in enumerate(starts):
        scale = problem.cost(x0) or 1.0

        def value(z: np.ndarray, scale: float = scale) -> float:
            return problem.cost(lower + width * z) / scale

        def gradient(z: np.ndarray, scale: float = scale) -> np.ndarray:
            x = lower + width * z
            return 2 * (problem.jacobian(x).T @ problem.residual(x)) * width / scale

        def hessian(z: np.ndarray, scale: float = scale) -> np.ndarray:
            J = problem.jacobian(lower + width * z) * width
            return 2 * (J.T @ J) / scale

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # quasi-Newton and degenerate-barrier notices; the status tells
            out = scipy.optimize.minimize(
                value,
                np.clip((x0 - lower) / width, 1e-6, 1 - 1e-6),
                jac=gradient,
                hess=hessian,
                method="trust-constr",
                bounds=scipy.optimize.Bounds(np.zeros_like(width), np.ones_like(width), keep_feasible=True),
                options={
                    "gtol": tolerance,
                    "xtol": 1e-12,
                    "barrier_tol": tolerance,
                    "initial_barrier_parameter": 1e-3,
                    "initial_barrier_tolerance": 1e-3,
                    "maxiter": max_iterations,
                },
            )
        estimate[i] = np.clip(lower + width * out.x, model.lower, model.upper)
        cost[i], iterations[i], status[i] = problem.cost(estimate[i]), out.nit, _STATUS[out.status]
    return Fits.of(model, estimate, cost, status, iterations, REACH)
