"""What a smooth deviation beside a fit does to its quantities, to first order.

The fit has whitened Jacobian J and residual r. Beside it acts a deviation F c with c ~ N(0, v I)
(`mcstudy.gap.candidates.free_deviations`). With A = J'J, M = I - J A^-1 J', G = F'MF and U the gradients of the
quantities times A^-1 J'F, its coefficients are c = (G + I/v)^-1 F'Mr, and it

- moves the quantities by -U c (and by their gradients times A^-1 J'r, where the fit has not quite converged),
- adds diag(U (G + I/v)^-1 U') to their variances,
- multiplies the evidence by exp(c'F'Mr / 2) |I + v G|^-1/2.

No prior is put on the parameters. Derived (Woodbury identity).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.free_deviations import Family, free_torques
from mcstudy.identification.profile import Linearised


class Deviation(NamedTuple):
    """One deviation beside a fit: ln Bayes factor against none, and of K quantities the shift and added variance."""

    name: str
    log_factor: float
    shift: np.ndarray
    variance: np.ndarray


class Deviations:
    """Smooth deviations beside one fit without prior.

    Parameters
    ----------
    fitted, data: the fit and what was fitted. near: its quantities to first order.
    """

    def __init__(self, fitted: Fitted, data: Data, near: Linearised) -> None:
        self._J = fitted.jacobian(data)[:, near.free]
        self._residual, self._covariance = fitted.residual(data), near.covariance
        self._pull = near.gradients[:, near.free] @ near.covariance
        self._rest = self._pull @ (self._J.T @ self._residual)
        self._families = [self._solved(f) for f in free_torques(fitted, data)]

    def _solved(self, family: Family) -> tuple[Family, np.ndarray, np.ndarray, np.ndarray]:
        """Eigenvalues of G (C,), and F'Mr (C,) and U (K, C) in its eigenvectors."""
        F = family.columns
        across = self._J.T @ F
        value, vector = np.linalg.eigh(F.T @ F - across.T @ self._covariance @ across)
        score = F.T @ self._residual - across.T @ (self._covariance @ (self._J.T @ self._residual))
        return family, np.maximum(value, 0.0), vector.T @ score, self._pull @ across @ vector

    def sized(self) -> list[Deviation]:
        """Every family with each of its own sizes."""
        return [self._one(f, v, s, u, size) for f, v, s, u in self._families for size in f.variances]

    def of_energies(self, energies: Sequence[float]) -> list[Deviation]:
        """Every family, so large that it adds each of ``energies`` to the squared residual on average."""
        return [
            self._one(f, v, s, u, energy / max(float(v.sum()), 1e-300))
            for f, v, s, u in self._families
            for energy in energies
        ]

    def _one(self, family: Family, value: np.ndarray, score: np.ndarray, U: np.ndarray, size: float) -> Deviation:
        inverse = 1 / (value + 1 / size)
        log_factor = 0.5 * float(score**2 @ inverse) - 0.5 * float(np.log1p(size * value).sum())
        return Deviation(family.name, log_factor, self._rest - U @ (inverse * score), U**2 @ inverse)
