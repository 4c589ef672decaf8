"""Marginal likelihoods of deviations from a fit, all from one projection of its residual.

At a penalised fit with whitened Jacobian J and prior covariance L^-1 the residual r is what the base parameters cannot
explain. A deviation F c with c ~ N(0, v I) has the Bayes factor

    ln B = b' (A + I / v)^-1 b / 2 - ln |I + v A| / 2,   b = F' r,   A = F' M F,   M = I - J (J'J + L)^-1 J'

against no deviation, with the base parameters integrated out (Woodbury identity). One matrix product gives b for all
families, so thousands of simulated residuals are scored at once. Derived.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from mcstudy.fitting.penalised import Fitted
from mcstudy.fitting.problem import Data
from mcstudy.fitting.small_linear import gaussian_factor
from mcstudy.gap.candidates.free_deviations import Family, free_torques, plain_feedback, strange
from mcstudy.gap.candidates.signatures import Signature

TYPICAL_DELTA = 7.0
"""Scale of the prior on delta; effects of this visibility can usually be detected."""

WRONG_SIGN = 0.005
"""Prior probability of the sign that does not occur in people, for an effect with one sign."""


def log_factor(z: np.ndarray, scale: float | np.ndarray, one_sided: bool) -> np.ndarray:
    """ln Bayes factor of a deviation with delta ~ N(0, scale^2) along a unit signature, from its score z (any shape).

    One-sided priors put all but `WRONG_SIGN` on positive delta.
    """
    shrink = scale**2 / (1 + scale**2)
    both = 0.5 * shrink * z**2 - 0.5 * np.log1p(scale**2)
    if not one_sided:
        return both
    # 2 (1 - w) Phi(t) + 2 w Phi(-t): the share of the posterior on either side
    t = z * np.sqrt(shrink)
    sides = np.logaddexp(np.log(1 - WRONG_SIGN) + log_ndtr(t), np.log(WRONG_SIGN) + log_ndtr(-t))
    return both + np.log(2) + sides


@dataclass(frozen=True)
class Projection:
    """M = I - Q Q', with Q the top of an orthonormal basis of J stacked on the root of the prior's precision."""

    Q: np.ndarray

    @classmethod
    def of(cls, fitted: Fitted, data: Data) -> Projection:
        """Of one fit."""
        J = fitted.jacobian(data)
        return cls(np.linalg.qr(np.concatenate([J, np.diag(1 / fitted.prior.scale)]))[0][: J.shape[0]])

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """M x: the part that the parameters of the fit cannot explain, for (4 N,) or (4 N, K)."""
        return np.asarray(x - self.Q @ (self.Q.T @ x))


@dataclass(frozen=True)
class _Block:
    """A family after the projection: its rows of the score vector, Gram matrix and prior."""

    family: Family
    rows: slice
    gram: np.ndarray

    def log_factor(self, b: np.ndarray) -> np.ndarray:
        """ln Bayes factor (n,) from scores (K, n), averaged over the sizes."""
        return _mean(np.array([gaussian_factor(self.gram, np.ascontiguousarray(b), v) for v in self.family.variances]))


class Scores:
    """Scores of the library's signatures and of the unknown families at one fit.

    Parameters
    ----------
    fitted, data: the fit and what was fitted. signatures: those of the library at it (may be empty).
    signed: per signature, whether both signs of the effect occur in people.
    """

    def __init__(self, fitted: Fitted, data: Data, signatures: Sequence[Signature], signed: Sequence[bool]) -> None:
        self.project = Projection.of(fitted, data)
        self.library = [s for s in signatures if s.delta > 0.3]
        self._signed = [x for s, x in zip(signatures, signed, strict=True) if s.delta > 0.3]
        unit = np.array([s.vector / s.delta for s in self.library]).reshape(-1, 2 * data.y.size).T
        names, places, columns = zip(*plain_feedback(fitted, data), strict=True)
        self.plain = strange(list(zip(names, places, self.project(np.array(columns).T).T, strict=True)), unit)
        families = free_torques(fitted, data)
        X = np.concatenate([unit, *(c[:, None] for _, _, c in self.plain), *(f.columns for f in families)], axis=1)
        self._raw, self._projected = X, self.project(X)
        K, G = unit.shape[1], len(self.plain)
        square = np.einsum("ij,ij->j", X[:, : K + G], self._projected[:, : K + G])
        self._length = np.sqrt(np.maximum(square, 1e-12))
        self._blocks = []
        first = K + G
        for f in families:
            rows = slice(first, first + f.columns.shape[1])
            self._blocks.append(_Block(f, rows, f.columns.T @ self._projected[:, rows]))
            first = rows.stop

    def __call__(self, residual: np.ndarray, linear: bool = False) -> Scored:
        """Scores of residuals (4 N, n) of fits; ``linear``: first project out what the parameters can explain."""
        r = residual.reshape(residual.shape[0], -1)
        b = (self._projected if linear else self._raw).T @ r
        K, G = len(self.library), len(self.plain)
        z = b[: K + G] / self._length[:, None]
        named = np.array([log_factor(z[k], TYPICAL_DELTA, not self._signed[k]) for k in range(K)]).reshape(
            K, r.shape[1]
        )
        plain = np.array([log_factor(z[K + k], TYPICAL_DELTA, False) for k in range(G)]).reshape(G, r.shape[1])
        free = np.array([k.log_factor(b[k.rows]) for k in self._blocks])
        return Scored(z[:K], named, plain, free)

    @property
    def families(self) -> list[Family]:
        """The free families, in the order of ``Scored.free``."""
        return [k.family for k in self._blocks]


@dataclass(frozen=True)
class Scored:
    """z (K, n) along the library's signatures; ln Bayes factors against no deviation of the library's signatures
    ``named`` (K, n), of plain feedback ``plain`` (G, n) and of the free families ``free`` (B, n)."""

    z: np.ndarray
    named: np.ndarray
    plain: np.ndarray
    free: np.ndarray

    @property
    def unknown(self) -> np.ndarray:
        """ln Bayes factor of the unknown, (n,): half plain feedback, half free torques and sensors."""
        parts = [_mean(x) for x in (self.plain, self.free) if x.shape[0]]
        return np.asarray(np.logaddexp.reduce(parts) - np.log(len(parts)))

    @property
    def gap(self) -> np.ndarray:
        """ln Bayes factor of any gap against none, (n,): the statistic of detection."""
        if self.named.shape[0] == 0:
            return self.unknown
        return np.logaddexp(np.log(0.8) + _mean(self.named), np.log(0.2) + self.unknown)


def _mean(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.logaddexp.reduce(x) - np.log(x.shape[0]))
