"""Compiled residual and Jacobian for the other packages, so that solvers are compared and not models.

Reads the same term table as the kernel, one fit at a time and in complex arithmetic. Terms through filters are left
out: the benchmark's model has none.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mcstudy.fitting.plans import plan
from mcstudy.fitting.problem import Problem


@njit(cache=True, error_model="numpy")
def _evaluate(theta, omega, constant, entry, weight, delay, data, weights, residual, jacobian):
    n_points, n_parameters = omega.size, theta.size
    t = np.empty((n_parameters, 2), dtype=np.complex128)
    factor = np.empty(delay.size, dtype=np.complex128)
    for n in range(n_points):
        s = 1j * omega[n]
        for g in range(delay.size):
            factor[g] = 1.0 if delay[g] < 0 else np.exp(-theta[delay[g]] * s)
        c = constant[n]
        a00, a01 = complex(c[0], c[1]), complex(c[2], c[3])
        a10, a11 = complex(c[4], c[5]), complex(c[6], c[7])
        b0, b1 = complex(c[8], c[9]), complex(c[10], c[11])
        for e in range(entry.shape[0]):
            q = weight[e, 0] * factor[entry[e, 2]] * s ** entry[e, 1]
            for k in range(3, 5):
                if entry[e, k] >= 0:
                    q *= theta[entry[e, k]]
            if entry[e, 0] == 0:
                a00, a01, b0 = a00 + weight[e, 1] * q, a01 + weight[e, 2] * q, b0 - weight[e, 3] * q
            else:
                a10, a11, b1 = a10 + weight[e, 1] * q, a11 + weight[e, 2] * q, b1 - weight[e, 3] * q
        scale = 1.0 / (a00 * a11 - a01 * a10)
        h0, h1 = scale * (a11 * b0 - a01 * b1), scale * (a00 * b1 - a10 * b0)
        t[:] = 0.0
        for e in range(entry.shape[0]):
            row = entry[e, 0]
            u = weight[e, 0] * factor[entry[e, 2]] * s ** entry[e, 1]
            u *= weight[e, 1] * h0 + weight[e, 2] * h1 + weight[e, 3]
            gain = 1.0
            for k in range(3, 5):
                p = entry[e, k]
                if p >= 0:
                    other = entry[e, 7 - k]
                    t[p, row] += u * theta[other] if other >= 0 else u
                    gain *= theta[p]
            if delay[entry[e, 2]] >= 0:
                t[delay[entry[e, 2]], row] -= s * gain * u
        w00, w10, w11 = weights[n, 0, 0], weights[n, 1, 0], weights[n, 1, 1]
        e0, e1 = h0 - data[n, 0], h1 - data[n, 1]
        r0, r1 = w00 * e0, w10 * e0 + w11 * e1
        residual[4 * n], residual[4 * n + 1] = r0.real, r0.imag
        residual[4 * n + 2], residual[4 * n + 3] = r1.real, r1.imag
        for p in range(n_parameters):
            d0 = -scale * (a11 * t[p, 0] - a01 * t[p, 1])
            d1 = -scale * (a00 * t[p, 1] - a10 * t[p, 0])
            j0, j1 = w00 * d0, w10 * d0 + w11 * d1
            jacobian[4 * n, p], jacobian[4 * n + 1, p] = j0.real, j0.imag
            jacobian[4 * n + 2, p], jacobian[4 * n + 3, p] = j1.real, j1.imag


class Compiled:
    """Residual (4 N,) and Jacobian (4 N, P) of one problem in units of the bounds' widths.

    ``z`` = (theta - lower) / width. Residual and Jacobian of the last point are kept, so that a solver that asks for
    one after the other pays once.
    """

    def __init__(self, problem: Problem) -> None:
        model, table = problem.model, plan(problem.model, problem.f)
        if model.table.n_filters:
            raise ValueError("the benchmark's compiled model has no filters")
        self.lower, self.width = model.lower, model.upper - model.lower
        tables = (table.omega, table.constant, table.entry, table.weight, table.group_delay[:, 0].copy())
        self.tables = (*tables, np.ascontiguousarray(problem.y), np.ascontiguousarray(problem.weight))
        self.evaluations = 0
        self._at = np.full(self.lower.size, np.nan)
        self._residual = np.empty(4 * problem.f.size)
        self._jacobian = np.empty((4 * problem.f.size, self.lower.size))

    def _move(self, z: np.ndarray) -> None:
        if not (z == self._at).all():
            self._at = np.array(z, dtype=float)
            self._residual, self._jacobian = np.empty_like(self._residual), np.empty_like(self._jacobian)
            _evaluate(self.lower + self.width * self._at, *self.tables, self._residual, self._jacobian)
            self._jacobian *= self.width
            self.evaluations += 1

    def residual(self, z: np.ndarray) -> np.ndarray:
        """Weighted residuals, (4 N,)."""
        self._move(z)
        return self._residual

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """Exact derivative of `residual`, (4 N, P)."""
        self._move(z)
        return self._jacobian

    def value(self, z: np.ndarray) -> float:
        """Half the cost: what general minimisers are given."""
        r = self.residual(z)
        return 0.5 * float(r @ r)

    def gradient(self, z: np.ndarray) -> np.ndarray:
        """Gradient of `value`, (P,)."""
        return self.jacobian(z).T @ self.residual(z)

    def hessian(self, z: np.ndarray) -> np.ndarray:
        """Gauss-Newton Hessian of `value`, (P, P)."""
        return self.jacobian(z).T @ self.jacobian(z)
