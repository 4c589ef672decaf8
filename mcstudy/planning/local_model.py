"""A local model of a measure over the designs, from few noisy values of it.

A value is the measure relative to its limit: its logarithm, or the ratio itself where it may be negative. The model is
Gaussian process regression of two functions at once. One is the measure of the cheap fits over the signal, of which a
few values are known (`Prediction`). The other is what complete fits differ from it: a plane in the logarithms of
amplitude and used cycles, and a small smooth remainder. Realizations and draws that several designs share make their
errors correlated; the covariance of the errors accounts for that. Without it, many values from the same noise would
look like much information. A prediction taken as exact, on the other hand, would turn the noise of its few draws into
slopes of the measure.

Root finding with a fitted local model instead of bisection: Chalmers 2024, Solving variables with Monte Carlo
simulation experiments, Psychological Methods; bisection under noise: Waeber, Frazier & Henderson 2013, SIAM J Control
Optim 51:2261-2279.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.special import ndtri

from mcstudy.planning.multilevel import Estimate

QUANTILE = float(ndtri(0.975))
"""Half-width of a 95 % interval in standard errors."""

SMALLEST = 1e-6
"""Smallest ratio of a measure to its limit that is told apart from zero."""


@dataclass(frozen=True)
class Prior:
    """Standard deviations of the level, of the slopes, and of the remainder, which changes over ``length`` (log units).

    For logarithms, a slope of 0.3 says that a function changes by a factor of 1.2 where the signal doubles.
    """

    level: float
    slope: float
    remainder: float
    length: float = 0.7

    def covariance(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Covariance (n, m) of the function at points (n, D) and (m, D), which are relative to a centre."""
        square = ((a[:, None] - b[None]) ** 2).sum(axis=2)
        smooth = self.remainder**2 * np.exp(-square / (2 * self.length**2))
        return np.asarray(self.level**2 + self.slope**2 * a @ b.T + smooth)

    def variance(self, a: np.ndarray) -> np.ndarray:
        """Diagonal (n,) of `covariance` of points (n, D) with themselves."""
        return np.asarray(self.level**2 + self.slope**2 * (a**2).sum(axis=1) + self.remainder**2)


@dataclass(frozen=True)
class Priors:
    """Of the measure of the cheap fits over the signal, and of what complete fits differ from it."""

    cheap: Prior
    difference: Prior


LOGARITHM = Priors(cheap=Prior(3.0, 1.5, 0.4), difference=Prior(1.0, 0.3, 0.05))
RATIO = Priors(cheap=Prior(10.0, 10.0, 3.0), difference=Prior(5.0, 5.0, 0.1))

EXACT = 1e-3
"""Standard deviation of a value of the prediction that its draws do not explain, on the scale of the model."""


@dataclass(frozen=True)
class Prediction:
    """Values (K,) of a measure of the cheap fits at logarithms (K,) of the signal, on the scale of the model.

    ``errors``: contributions of the draws that all values share, (K, n). ``unseen``: what one more draw, unlike those
    that are known, might change, (K,); see `mcstudy.planning.multilevel.unlike`.
    """

    log_signal: np.ndarray
    values: np.ndarray
    errors: np.ndarray
    unseen: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (K, K) of the errors of the values."""
        return np.asarray(self.errors @ self.errors.T + np.diag(self.unseen**2 + EXACT**2))


def scaled(value: np.ndarray, signed: bool) -> np.ndarray:
    """Ratios of a measure to its limit on the scale of the model."""
    return np.asarray(value) if signed else np.log(np.maximum(value, SMALLEST))


def unit(estimate: Estimate, signed: bool) -> float:
    """From errors of an estimate to errors on the scale of the model, to first order."""
    return 1.0 if signed else 1.0 / max(abs(estimate.value), SMALLEST)


@dataclass(frozen=True)
class Band:
    """What the model says at designs: excess over the limit on its scale, (n,) each; zero is the limit.

    ``low``, ``high``: 95 % interval of the excess. ``value``, ``error``: on the scale of the model.
    """

    value: np.ndarray
    error: np.ndarray
    signed: bool

    @property
    def middle(self) -> np.ndarray:
        """Best estimate of the excess."""
        return np.abs(self.value) - 1 if self.signed else self.value

    @property
    def low(self) -> np.ndarray:
        """Lower end."""
        if not self.signed:
            return np.asarray(self.value - QUANTILE * self.error)
        return np.asarray(np.maximum(np.abs(self.value) - QUANTILE * self.error, 0.0) - 1)

    @property
    def high(self) -> np.ndarray:
        """Upper end."""
        if not self.signed:
            return np.asarray(self.value + QUANTILE * self.error)
        return np.asarray(np.abs(self.value) + QUANTILE * self.error - 1)


class LocalModel:
    """The model of one measure at one Fmax.

    Parameters
    ----------
    prediction: over the logarithm of the signal. signed: whether values are ratios, not logarithms.
    points: logarithms of amplitude and used cycles of the designs that were looked at, (K, 2).
    estimates: the measure relative to its limit at each, with contributions of the realizations.
    groups: designs with equal numbers share realizations, (K,).
    """

    def __init__(
        self,
        prediction: Prediction,
        signed: bool,
        points: np.ndarray,
        estimates: Sequence[Estimate],
        groups: Sequence[int],
    ) -> None:
        self._signed = signed
        self._priors = RATIO if signed else LOGARITHM
        keep = [k for k, e in enumerate(estimates) if np.isfinite(e.value) and np.isfinite(e.error)]
        self._points = points[keep].reshape(-1, 2)
        self._centre = self._points.mean(axis=0) if keep else np.zeros(2)
        self._signals = np.concatenate([prediction.log_signal, log_signal(self._points)])
        self._middle = float(prediction.log_signal.mean())
        values = np.concatenate([prediction.values, scaled(np.array([estimates[k].value for k in keep]), signed)])
        self._level = float(prediction.values.mean())
        errors = _errors([estimates[k] for k in keep], [groups[k] for k in keep], signed) if keep else np.zeros((0, 0))
        K = self._between(self._signals, self._points, self._signals, self._points)
        K += block_diag(prediction.covariance, errors)
        self._root = np.linalg.cholesky(K + 1e-9 * np.trace(K) / len(K) * np.eye(len(K)))
        self._weights = np.linalg.solve(self._root, values - self._level)

    def _between(self, s: np.ndarray, a: np.ndarray, t: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Covariance of values at logarithms of signals ``s`` and ``t``, of which the last are of the designs ``a`` and
        ``b``, (n, 2) and (m, 2); those before are of cheap fits alone."""
        K = self._priors.cheap.covariance((s - self._middle)[:, None], (t - self._middle)[:, None])
        difference = self._priors.difference.covariance(a - self._centre, b - self._centre)
        K[len(s) - len(a) :, len(t) - len(b) :] += difference
        return K

    def at(self, points: np.ndarray) -> Band:
        """The measure at designs (n, 2)."""
        signals = log_signal(points)
        cross = np.linalg.solve(self._root, self._between(self._signals, self._points, signals, points))
        variance = self._priors.cheap.variance((signals - self._middle)[:, None])
        variance = variance + self._priors.difference.variance(points - self._centre)
        left = np.maximum(variance - (cross**2).sum(axis=0), 0.0)
        return Band(self._level + cross.T @ self._weights, np.sqrt(left), self._signed)


def log_signal(points: np.ndarray) -> np.ndarray:
    """Logarithm of amplitude times root of the used cycles, from their logarithms (n, 2)."""
    return np.asarray(points[:, 0] + points[:, 1] / 2)


def _errors(estimates: Sequence[Estimate], groups: Sequence[int], signed: bool) -> np.ndarray:
    """Covariance (K, K) of the errors on the model's scale; designs of different ``groups`` share no
    realizations, but all of them share the other draws."""
    scale = [unit(e, signed) for e in estimates]
    realized, sampled = (
        _padded([getattr(e, level) * s for e, s in zip(estimates, scale, strict=True)]) for level in ("own", "sampled")
    )
    same = np.equal.outer(np.asarray(groups), np.asarray(groups))
    return np.asarray(np.where(same, realized @ realized.T, 0.0) + sampled @ sampled.T)


def _padded(rows: Sequence[np.ndarray]) -> np.ndarray:
    out = np.zeros((len(rows), max(r.size for r in rows)))
    for row, values in zip(out, rows, strict=True):
        row[: values.size] = values
    return out
