"""Characteristic roots of a loop followed while its parameters change, with their derivatives.

A simple root s of det A(s; theta) = 0 has null vectors u^H A = 0 and A v = 0, and

    ds / dtheta_p = - (u^H (dA/dtheta_p) v) / (u^H (dA/ds) v)

(Lancaster 1964, Numer Math 6:377-387, of matrices that are not polynomial). `mcstudy.stance.stability` finds the roots.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mcstudy.stance.feedback import Model
from mcstudy.stance.joint import members
from mcstudy.stance.response import force_slopes, system

STEP = 1e-6
"""Of the differences in s, relative to 1 + |s|."""

STEPS, FOLLOWED = 12, 1e-9
"""Most steps of Newton's method, and the last one, relative to 1 + |s|, of a root that was followed."""


def loops_of(model: Model) -> list[Model]:
    """The model without stimuli and outputs, which has the same roots; or one for each recording where loops differ."""
    every = members(model) if model.loops_differ else (model,)
    return [replace(m, terms=tuple(t for t in m.terms if t.sense != "stimulus"), outputs=(), blocks=()) for m in every]


def followed(loop: Model, theta: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Roots (B, K) at parameters (B, P), from roots ``s`` (B, K) of others nearby; NaN where Newton's method fails.

    ``loop``: one of `loops_of` a model.
    """
    s = np.array(s, dtype=complex)
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            value, slope = _determinant(loop, theta, s)
            step = np.where(value == 0, 0.0, value / slope)
            s = s - step
            if not (np.abs(step) > FOLLOWED * (1 + np.abs(s))).any():
                break
        return np.where(np.abs(step) <= FOLLOWED * (1 + np.abs(s)), s, np.nan)


def slopes(loop: Model, theta: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Derivatives (B, K, P) of the real parts of simple roots ``s`` (B, K); zero where one is NaN."""
    known = np.isfinite(s)
    at = np.where(known, s, 1.0)
    h = STEP * (1 + np.abs(at))
    A, above, below = np.split(system(loop, theta, np.concatenate([at, at + h, at - h], axis=1))[0], 3, axis=1)
    left, _, right = np.linalg.svd(A)
    u, v = left[..., -1].conj(), right[..., -1, :].conj()
    turn = np.einsum("bki,bkij,bkj->bk", u, above - below, v) / (2 * h)
    change = np.einsum("bki,ipbk->bkp", u, force_slopes(loop, theta, at, v))
    return np.where(known[..., None], -(change / np.where(known, turn, 1.0)[..., None]).real, 0.0)


def _determinant(loop: Model, theta: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of A(s), and its derivative in s, (B, K) each."""
    h = STEP * (1 + np.abs(s))
    value, above, below = np.split(
        np.linalg.det(system(loop, theta, np.concatenate([s, s + h, s - h], axis=1))[0]), 3, axis=1
    )
    return value, (above - below) / (2 * h)
