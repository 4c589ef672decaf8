"""SciPy's trust-region-reflective least squares as an independent reference."""

from __future__ import annotations

import numpy as np
import scipy  # loads its `optimize` when it is first used: half a second that most studies never need

from mcstudy.fitting.problem import Fits, Problem
from mcstudy.fitting.status import Status

_STATUS = {0: Status.ITERATION_LIMIT, 1: Status.CONVERGED, 2: Status.CONVERGED, 3: Status.STALLED, 4: Status.CONVERGED}

REACH = 1e-06
"""How near a bound its solutions end that lie on it, in widths of the bounds."""


def trf(problem: Problem, starts: np.ndarray, tolerance: float, max_iterations: int) -> Fits:
    """Fit with ``scipy.optimize.least_squares(method="trf")`` and the exact Jacobian, scaled by the bounds' widths."""
    model = problem.model
    estimate, cost = np.empty_like(starts), np.empty(len(starts))
    status, iterations = np.empty(len(starts), dtype=np.uint8), np.empty(len(starts), dtype=np.int32)
    for i, x0 in enumerate(starts):
        out = scipy.optimize.least_squares(
            problem.residual,
            np.clip(x0, model.lower, model.upper),
            problem.jacobian,
            bounds=(model.lower, model.upper),
            x_scale=model.upper - model.lower,
            method="trf",
            ftol=tolerance,
            xtol=1e-15,
            gtol=None,
            max_nfev=max_iterations,
        )
        estimate[i], cost[i], iterations[i] = out.x, 2 * out.cost, out.njev
        status[i] = _STATUS[out.status]
    return Fits.of(model, estimate, cost, status, iterations, REACH)
