"""Criteria of an experiment: how well its Fisher information determines the parameters, averaged over bodies.

The information of a body is F = sum_k x_k M_k: linear in the power x_k of every line. With a matrix W whose columns are
the quantities of interest, a criterion is

- D: log det F / P, which is minus twice the mean logarithm of the lengths of the axes of the confidence ellipsoid;
- A: -log tr(W' F^-1 W) with W the unit matrix, the mean squared relative error;
- c: the same with one column, the squared relative error of one quantity.

All are concave in x: log det is, and the reciprocal of tr(W' F^-1 W) is, of which this is the logarithm (Pukelsheim
2006, Optimal Design of Experiments, ch. 6). So is their mean over bodies, and a maximum is the global one. A gain of a
criterion does not depend on the units of the parameters for D; for A and c the parameters are divided by their true
values.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular


class Slopes(NamedTuple):
    """Value, gradient (K,) and Hessian (K, K) of a criterion."""

    value: float
    gradient: np.ndarray
    hessian: np.ndarray


@dataclass(frozen=True, eq=False)
class Criterion:
    """A criterion of an experiment with K lines, averaged over B bodies.

    Attributes
    ----------
    information: of every line at unit power for parameters divided by their true values, (B, K, P, P).
    columns: W, (P, R), or None for the criterion D.
    """

    information: np.ndarray
    columns: np.ndarray | None = None

    def at(self, x: np.ndarray) -> np.ndarray:
        """Information of all lines with powers ``x`` (K,), (B, P, P)."""
        return np.tensordot(self.information, x, axes=(1, 0))

    def value(self, x: np.ndarray) -> float:
        """The criterion at powers ``x`` (K,); minus infinity where a body's information is singular."""
        try:
            return float(np.mean([self._of(_root(F)) for F in self.at(x)]))
        except np.linalg.LinAlgError:
            return -np.inf

    def _of(self, root: np.ndarray) -> float:
        if self.columns is None:
            return float(-2 * np.log(np.diag(root)).mean())
        return float(-np.log(((root @ self.columns) ** 2).sum()))

    def slopes(self, x: np.ndarray) -> Slopes:
        """Value and derivatives at powers ``x`` (K,); raises `LinAlgError` where the information is singular.

        With R F R' = 1 and Z_k = R M_k R', the derivatives of log det F are tr Z_k and -tr(Z_k Z_l), and those of
        t = tr(V' V), V = R W, are -tr(V' Z_k V) and 2 tr(V' Z_k Z_l V).
        """
        K, P = self.information.shape[1:3]
        value, gradient, hessian = 0.0, np.zeros(K), np.zeros((K, K))
        upper = np.triu_indices(P)
        twice = np.where(upper[0] == upper[1], 1.0, np.sqrt(2.0))
        for F, M in zip(self.at(x), self.information, strict=True):
            root = _root(F)
            value += self._of(root)
            Z = root @ M @ root.T
            if self.columns is None:
                flat = Z[:, upper[0], upper[1]] * twice
                gradient += np.trace(Z, axis1=1, axis2=2) / P
                hessian -= flat @ flat.T / P
            else:
                V = root @ self.columns
                t, ZV = (V**2).sum(), (Z @ V).reshape(K, -1)
                slope = ZV @ V.ravel() / t
                gradient += slope
                hessian += np.outer(slope, slope) - 2 * ZV @ ZV.T / t
        n = len(self.information)
        return Slopes(value / n, gradient / n, hessian / n)


def _root(F: np.ndarray) -> np.ndarray:
    """R, lower triangular, with R F R' = 1; the information is scaled first, because parameters differ in size."""
    scale = 1 / np.sqrt(np.diag(F))
    if not np.isfinite(scale).all():
        raise np.linalg.LinAlgError("a parameter without information")
    lower = np.linalg.cholesky(F * np.outer(scale, scale))
    return np.asarray(solve_triangular(lower, np.diag(scale), lower=True))
