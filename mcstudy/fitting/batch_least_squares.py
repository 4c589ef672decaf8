"""Bounded Levenberg-Marquardt steps of many small problems together, in numpy.

The compiled solver (`mcstudy.fitting.kernel`) takes errors that are independent between frequencies. Where they are
not, problems are stepped together instead: one call of the model serves all that are still moving.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

TOLERANCE = 1e-9
"""Relative decrease of the cost below which a fit has converged."""

CALM = 1e-2
"""Damping below which a small decrease means a minimum and not a short step."""

SIDES = 6
"""Rounds in which unknowns of a step are put on the sides that they would cross."""


def minimised(
    residual: Callable[[np.ndarray, np.ndarray], np.ndarray],
    linearised: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
    starts: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    iterations: int = 150,
    tolerance: float = TOLERANCE,
) -> tuple[np.ndarray, np.ndarray]:
    """Local minima (B, Q) of sums of squares from ``starts`` (B, Q), and these sums (B,).

    Parameters
    ----------
    residual: of unknowns (b, Q) of the problems at positions (b,), (b, M).
    linearised: the same with its derivatives, (b, M) and (b, M, Q).
    lower, upper: (Q,) bounds. iterations: steps at most. tolerance: see `TOLERANCE`.
    """
    every = np.arange(len(starts))
    q = np.clip(starts, lower, upper)
    cost = (residual(q, every) ** 2).sum(axis=1)
    damping = np.full(len(q), 1e-2)
    going = np.isfinite(cost)
    for _ in range(iterations):
        at = np.flatnonzero(going)
        if not at.size:
            break
        r, J = linearised(q[at], at)
        gram, gradient = np.swapaxes(J, 1, 2) @ J, np.einsum("bmq,bm->bq", J, r)
        held = ((q[at] <= lower) & (gradient > 0)) | ((q[at] >= upper) & (gradient < 0))
        gradient[held] = 0.0
        gram[held[:, :, None] | held[:, None, :]] = 0.0
        diagonal = np.einsum("bqq->bq", gram)
        size = np.maximum(diagonal, 1e-12 * diagonal.max(axis=1, keepdims=True) + 1e-300)
        for k in range(gram.shape[1]):
            gram[:, k, k] += np.where(held[:, k], size[:, k], damping[at] * size[:, k])
        step = _inside(gram, gradient, lower - q[at], upper - q[at])
        trial = np.clip(q[at] + step, lower, upper)
        with np.errstate(all="ignore"):
            after = (residual(trial, at) ** 2).sum(axis=1)
        better = after < cost[at]
        done = better & (cost[at] - after < tolerance * cost[at]) & (damping[at] < CALM)
        q[at[better]] = trial[better]
        cost[at[better]] = after[better]
        damping[at] *= np.where(better, 0.2, 4.0)
        going[at[done | (damping[at] > 1e9)]] = False
        damping = np.maximum(damping, 1e-9)
    return q, cost


def _inside(gram: np.ndarray, gradient: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Steps (B, Q) to the minimum; unknowns that would cross a side are put on it and the others solved again."""
    fixed, step = np.zeros(gradient.shape, dtype=bool), np.zeros_like(gradient)
    diagonal = np.arange(gradient.shape[1])
    for _ in range(SIDES):
        matrix = np.where(fixed[:, :, None] | fixed[:, None, :], 0.0, gram)
        matrix[:, diagonal, diagonal] = np.where(fixed, 1.0, gram[:, diagonal, diagonal])
        pushed = -gradient - np.einsum("bqp,bp->bq", gram, np.where(fixed, step, 0.0))
        solved = np.linalg.solve(matrix, np.where(fixed, step, pushed)[..., None])[..., 0]
        crossing = ~fixed & ((solved < lower) | (solved > upper))
        step = np.clip(solved, lower, upper)
        if not crossing.any():
            break
        fixed |= crossing
    return np.asarray(step)
