"""A local model of a measure over the designs, from few noisy values of it.

A value is the measure relative to its limit: its logarithm, or the ratio itself where it may be negative. The model is
a prediction that holds roughly everywhere (`Prediction`), plus a plane in the logarithms of amplitude and used cycles,
plus a smooth remainder: Gaussian process regression with a linear trend. Realizations that several designs share make
their errors correlated; the covariance of the errors accounts for that. Without it, many values from the same noise
would look like much information.

Root finding with a fitted local model instead of bisection: Chalmers 2024, Solving variables with Monte Carlo
simulation experiments, Psychological Methods; bisection under noise: Waeber, Frazier & Henderson 2013, SIAM J Control
Optim 51:2261-2279.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.special import ndtri

from mcstudy.planning.multilevel import Estimate

QUANTILE = float(ndtri(0.975))
"""Half-width of a 95 % interval in standard errors."""

SMALLEST = 1e-6
"""Smallest ratio of a measure to its limit that is told apart from zero."""


@dataclass(frozen=True)
class Prior:
    """Standard deviations of the level, of the slopes, and of the remainder, which changes over ``length`` (log units).

    For logarithms, a slope of 0.3 says that the prediction errs by a factor of 1.2 where the signal doubles.
    """

    level: float = 1.0
    slope: float = 0.3
    remainder: float = 0.05
    length: float = 0.7


LOGARITHM = Prior()
RATIO = Prior(level=5.0, slope=5.0, remainder=0.1)


@dataclass(frozen=True)
class Prediction:
    """What is predicted at the logarithm of the signal, from values at some signals; constant beyond them."""

    log_signal: np.ndarray
    values: np.ndarray

    def __call__(self, log_signal: np.ndarray) -> np.ndarray:
        """Interpolated values, monotone between neighbours."""
        if len(self.values) < 2:
            return np.full(np.shape(log_signal), self.values[0])
        inside = np.clip(log_signal, self.log_signal[0], self.log_signal[-1])
        return np.asarray(self._curve(inside))

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.log_signal, self.values)


def scaled(value: np.ndarray, signed: bool) -> np.ndarray:
    """Ratios of a measure to its limit on the scale of the model."""
    return np.asarray(value) if signed else np.log(np.maximum(value, SMALLEST))


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
    found: the measure relative to its limit at each, with contributions of the realizations.
    groups: designs with equal numbers share realizations, (K,).
    """

    def __init__(
        self,
        prediction: Prediction,
        signed: bool,
        points: np.ndarray,
        found: Sequence[Estimate],
        groups: Sequence[int],
    ) -> None:
        self._prediction, self._signed = prediction, signed
        self._prior = RATIO if signed else LOGARITHM
        keep = [k for k, e in enumerate(found) if np.isfinite(e.value) and np.isfinite(e.error)]
        self._points = points[keep].reshape(-1, 2)
        self._centre = self._points.mean(axis=0) if keep else np.zeros(2)
        values = np.array([found[k].value for k in keep])
        self._residual = scaled(values, signed) - prediction(log_signal(self._points))
        if keep:
            K = self._kernel(self._points, self._points) + _errors(
                [found[k] for k in keep], [groups[k] for k in keep], signed
            )
            self._root = np.linalg.cholesky(K + 1e-9 * np.trace(K) / len(keep) * np.eye(len(keep)))

    def _kernel(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        p = self._prior
        u, v = a - self._centre, b - self._centre
        square = ((u[:, None] - v[None]) ** 2).sum(axis=2)
        return np.asarray(p.level**2 + p.slope**2 * u @ v.T + p.remainder**2 * np.exp(-square / (2 * p.length**2)))

    def at(self, points: np.ndarray) -> Band:
        """The measure at designs (n, 2)."""
        prior = self._prior
        predicted = self._prediction(log_signal(points))
        variance = prior.level**2 + prior.slope**2 * ((points - self._centre) ** 2).sum(axis=1) + prior.remainder**2
        if not self._residual.size:
            return Band(predicted, np.sqrt(variance), self._signed)
        cross = np.linalg.solve(self._root, self._kernel(self._points, points))
        mean = cross.T @ np.linalg.solve(self._root, self._residual)
        left = np.maximum(variance - (cross**2).sum(axis=0), 0.0)
        return Band(predicted + mean, np.sqrt(left), self._signed)


def log_signal(points: np.ndarray) -> np.ndarray:
    """Logarithm of amplitude times root of the used cycles, from their logarithms (n, 2)."""
    return np.asarray(points[:, 0] + points[:, 1] / 2)


def _errors(found: Sequence[Estimate], groups: Sequence[int], signed: bool) -> np.ndarray:
    """Covariance (K, K) of the errors on the model's scale; designs of different ``groups`` share no
    realizations, but all of them share the other draws."""
    scale = [1.0 if signed else 1.0 / max(abs(e.value), SMALLEST) for e in found]
    own, sampled = (
        _padded([getattr(e, level) * s for e, s in zip(found, scale, strict=True)]) for level in ("own", "sampled")
    )
    same = np.equal.outer(np.asarray(groups), np.asarray(groups))
    return np.asarray(np.where(same, own @ own.T, 0.0) + sampled @ sampled.T)


def _padded(rows: Sequence[np.ndarray]) -> np.ndarray:
    out = np.zeros((len(rows), max(r.size for r in rows)))
    for row, values in zip(out, rows, strict=True):
        row[: values.size] = values
    return out
