"""How well a mechanism resembles a gap: the share of the gap that it predicts at lines that were not fitted.

*Likeness* is 1 minus the squared residual that the mechanism leaves over the one that the base model leaves, both at
lines that were left out of the fit and less their noise. Each of `FOLDS` interleaved sets of lines is left out in turn.
Residuals count in the space of smooth deviations and signatures of effects (`mcstudy.gap.questions.closure`): the gap
of a linear body lies there, and most of the noise does not. A likeness of 1 says that nothing smooth is left, 0 that
the mechanism predicts no better than no mechanism.

The interval is that of two normal variables with the sampling variances and the covariance of both sums, which share
their noise. The first must be positive; a negative second one counts as zero. Derived.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcstudy.fitting.penalised import Fitted, Fitter, whiten
from mcstudy.fitting.problem import Data
from mcstudy.gap.questions.interval import Interval
from mcstudy.stance.response import frf

FOLDS = 5

SAMPLES = 4000

LEAST = 40
"""Fewest samples with a gap."""


def likeness(
    base: Fitted,
    added: Sequence[Fitted],
    data: Data,
    directions: np.ndarray,
    heavier: float,
    rng: np.random.Generator,
) -> list[Interval]:
    """Likeness of every fit in ``added`` to the gap of ``base``.

    ``directions``: (4 N, K) orthonormal, where residuals count. ``heavier``: variance of the squared noise relative to
    that of a known covariance.
    """
    before, noise = _held_out(base, data, directions)
    out = []
    for fitted in added:
        after, noise_after = _held_out(fitted, data, directions)
        out.append(_likeness(before, noise, after, noise_after, heavier, rng))
    return out


def _held_out(fitted: Fitted, data: Data, directions: np.ndarray) -> tuple[np.ndarray, float]:
    """(K,) residual at left-out lines along the directions, and the expected square that its noise adds."""
    n = data.f.size
    fold = np.arange(n) % FOLDS
    without = [Data(data.f, data.y, data.weight * (fold != k)[:, None, None]) for k in range(FOLDS)]
    fitter = Fitter(fitted.model, fitted.prior, data.f)
    packed = np.array([fitter.packed(d) for d in without])
    theta = fitter.fits(packed, np.tile(fitted.theta, (FOLDS, 1)), np.arange(FOLDS)).estimate
    response = frf(fitted.model, theta, data.f)[fold, np.arange(n)]
    inside = directions.T @ whiten(data.weight, data.y - response)
    return np.asarray(inside), _noise(fitted, data, directions, fold)


def _noise(fitted: Fitted, data: Data, directions: np.ndarray, fold: np.ndarray) -> float:
    """Expected square of unit noise along the directions, after fits to the other lines (linearised)."""
    J, part = fitted.jacobian(data), np.tile(np.repeat(fold, data.y.shape[1]), 2)
    prior = fitted.prior.weight * np.diag(fitted.prior.scale**-2)
    through = directions.T.copy()
    for k in range(FOLDS):
        out = part == k
        kept = np.where(out[:, None], 0.0, J)
        step = np.linalg.solve(kept.T @ kept + prior, kept.T)
        through -= (directions[out].T @ J[out]) @ step
    return float((through**2).sum())


def _likeness(
    before: np.ndarray, noise: float, after: np.ndarray, noise_after: float, heavier: float, rng: np.random.Generator
) -> Interval:
    """From residuals (K,) with the squares of their noise."""
    first, second = float(before @ before) - noise, float(after @ after) - noise_after
    both = float(before @ after) - np.sqrt(noise * noise_after)
    noise_variance = 2 * heavier * before.size
    covariance = np.array(
        [
            [4 * max(first, 0.0) + noise_variance, 4 * max(both, 0.0) + noise_variance],
            [4 * max(both, 0.0) + noise_variance, 4 * max(second, 0.0) + noise_variance + 1e-9],
        ]
    )
    value, vector = np.linalg.eigh(covariance)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    E = np.array([first, second]) + rng.standard_normal((SAMPLES, 2)) @ root.T
    E = E[E[:, 0] > 0]
    if len(E) < LEAST:  # the base model leaves certainly less than noise
        return Interval(0.0, 0.0, 1.0)
    return Interval.of(np.clip(1 - E[:, 1] / E[:, 0], 0.0, 1.0))
