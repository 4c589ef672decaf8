"""An emulator of the study: expected moments at any configuration, by regression on the bank.

The regression is on the moments (bias, logarithm of the spread, sway, influence), which change smoothly with the
configuration; it is quadratic or linear, whichever predicts a moment better. The rows are computed from the predicted
moments with the same function as from simulated ones, so what is not smooth in them (absolute values, rankings) is not
left to the regression. The differences between the rows of each study of the bank and those predicted without that
study (leave one out) contain the Monte Carlo error of a study of 50 realizations, which is the paper's, and the lack of
fit; their covariance is the error model of the likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy_goodworth2018.lost_table.bank import Bank
from mcstudy_goodworth2018.lost_table.rows import columns
from mcstudy_goodworth2018.lost_table.simulate import PARAMETERS, Moments
from mcstudy_goodworth2018.lost_table.unknowns import Prior

RIDGES = 10.0 ** np.arange(-4, 3, 0.5)
"""Penalties that are tried, relative to the largest singular value squared times 1e-2."""

_CELLS = (3, 2, len(PARAMETERS) + 2)
_SIZES = (int(np.prod(_CELLS)), int(np.prod(_CELLS)), 4, len(PARAMETERS))
_ENDS = np.cumsum(_SIZES)


def regressors(x: np.ndarray) -> np.ndarray:
    """1, x and all products of two of x (..., U)."""
    i, j = np.triu_indices(x.shape[-1])
    return np.concatenate([np.ones((*x.shape[:-1], 1)), x, x[..., i] * x[..., j]], axis=-1)


def packed(m: Moments) -> np.ndarray:
    """Moments as one vector (..., C), on the scales of the regression."""
    lead = m.bias.shape[:-3]
    parts = (m.bias, np.log(np.maximum(m.spread, 1e-4)), np.log(m.sway), np.log(np.maximum(m.influence, 1e-12)))
    return np.concatenate([p.reshape(*lead, -1) for p in parts], axis=-1)


def unpacked(y: np.ndarray) -> Moments:
    """Inverse of `packed`."""
    lead = y.shape[:-1]
    bias, spread, sway, influence = np.split(y, _ENDS[:-1], axis=-1)
    return Moments(
        np.clip(bias, -1.0, 1.0).reshape(*lead, *_CELLS),
        np.minimum(np.exp(np.minimum(spread, 1.0)), 1.1).reshape(*lead, *_CELLS),
        np.exp(np.clip(sway, -10, 10)).reshape(*lead, 2, 2),
        np.exp(np.clip(influence, -30, 10)),
    )


@dataclass(frozen=True)
class Emulator:
    """Predicts rows.

    Attributes
    ----------
    prior: the unknowns. realizations: of a study. weights: of the regression, (K, C). span: place of ``sway_over``.
    offset: mean difference of simulated minus predicted rows, (R,). covariance: of these differences, (R, R).
    center, scale: of the regressors' features, (U,).
    """

    prior: Prior
    realizations: int
    weights: np.ndarray
    center: np.ndarray
    scale: np.ndarray
    offset: np.ndarray
    covariance: np.ndarray

    @classmethod
    def of(cls, prior: Prior, bank: Bank, realizations: int) -> Emulator:
        """The emulator made of a bank."""
        features = prior.features(bank.u)
        center, scale = features.mean(axis=0), np.maximum(features.std(axis=0), 1e-3)
        x, y = regressors((features - center) / scale), packed(bank.moments)
        weights, left_out = ridge(x, y)
        simple = np.arange(x.shape[1]) <= features.shape[1]
        linear, linear_left_out = ridge(x[:, simple], y)
        better = ((y - linear_left_out) ** 2).mean(axis=0) < ((y - left_out) ** 2).mean(axis=0)
        weights[:, better] = 0.0
        weights[np.ix_(simple, better)] = linear[:, better]
        left_out[:, better] = linear_left_out[:, better]
        over = prior.values(bank.u)[:, prior.names.index("sway_over")]
        difference = columns(bank.moments, over) - columns(unpacked(left_out), over, realizations)
        return cls(prior, realizations, weights, center, scale, difference.mean(axis=0), np.cov(difference.T))

    def moments(self, u: np.ndarray) -> Moments:
        """Expected moments at points ``u`` (..., U)."""
        return unpacked(regressors((self.prior.features(u) - self.center) / self.scale) @ self.weights)

    def rows(self, u: np.ndarray) -> np.ndarray:
        """Expected rows (..., R) at points ``u`` (..., U)."""
        over = self.prior.values(u)[..., self.prior.names.index("sway_over")]
        return columns(self.moments(u), over, self.realizations) + self.offset


def ridge(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights (K, C) of a ridge regression and its leave-one-out predictions (N, C).

    The penalty of each column of ``y`` is the one with the smallest leave-one-out error; the mean is not penalised.
    """
    mean = y.mean(axis=0)
    middle = x.mean(axis=0)
    xc, yc = x - middle, y - mean
    left, s, right = np.linalg.svd(xc, full_matrices=False)
    keep = s > 1e-9 * s[0]
    left, s, right = left[:, keep], s[keep], right[keep]
    target = left.T @ yc
    best = np.full(y.shape[1], np.inf)
    weights, out = np.zeros((x.shape[1], y.shape[1])), np.zeros_like(y)
    for penalty in RIDGES * 1e-2 * s[0] ** 2:
        shrink = s**2 / (s**2 + penalty)
        fitted = left @ (shrink[:, None] * target)
        leverage = np.minimum((left**2) @ shrink + 1.0 / len(y), 1 - 1e-6)
        residual = (yc - fitted) / (1 - leverage)[:, None]
        error = (residual**2).mean(axis=0)
        better = error < best
        best[better] = error[better]
        out[:, better] = (y - residual)[:, better]
        weights[:, better] = (right.T @ ((shrink / s)[:, None] * target))[:, better]
    weights = weights.copy()
    weights[0] += mean - middle @ weights  # the first regressor is 1
    return weights, out
