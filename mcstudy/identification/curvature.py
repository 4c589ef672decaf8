"""What the curvature of the model adds to the uncertainty of estimates: a factor of the likelihood ratio.

Responses are not linear in the parameters. Noise therefore finds more room than a tangent plane has, and the likelihood
ratio of a quantity exceeds chi-squared by a part that falls with the variance of the noise: 2 % for K21 and K11 + Kpas1
with a torque of 5 N m (peak), up to 3.1 Hz, and 10 % with half of it. Without it intervals of these hold the truth in
94.4 % at half the torque.

The mean of the whole deviance is F + e, with F parameters and

    e = sum over data of |a|^2 / 2 - (tr a)^2 / 4,

where ``a`` (F, F) are the second derivatives of a datum, in directions that are orthonormal in the data, less what the
tangent plane holds (Bartlett 1937; Cordeiro & Paula 1989, Biometrika 76:93-100, for normal errors). The same holds with
the quantity fixed, where the direction that changes it is no longer in the tangent plane; the difference of both is
that of the likelihood ratio. To second order: where the part is large, bounds hold the parameters and it is not right,
nor needed, because intervals are then wide enough. So it counts up to `MOST`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcstudy.fitting.penalised import whiten
from mcstudy.fitting.problem import Data
from mcstudy.identification.profile import Linearised
from mcstudy.models.quantities import Quantity
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf_jacobian

MOST = 0.2
"""Largest part that counts. Chosen with 1,500 recordings, judged with others (``interval_coverage.py``)."""

STEP = 1e-2
"""Of the differences, in standard errors of a parameter whose others are known."""


def curvature(model: Model, data: Data, theta: np.ndarray, near: Linearised, wanted: Sequence[Quantity]) -> np.ndarray:
    """Part (K,), 0 to `MOST`, by which the mean likelihood ratio of each quantity exceeds that of a linear model.

    ``theta``: (P,), the estimate. ``near``: the ``wanted`` quantities there, to first order.
    """
    J = whiten(data.weight, frf_jacobian(model, theta, data.f)[1])
    seen = near.free & (np.linalg.norm(J, axis=0) > 0)
    free, J = np.flatnonzero(seen), J[:, seen]
    if not free.size:
        return np.zeros(len(wanted))
    step = np.zeros((free.size, theta.size))
    step[np.arange(free.size), free] = STEP / np.linalg.norm(J, axis=0)
    slopes = frf_jacobian(model, np.concatenate([theta + step, theta - step]), data.f)[1]
    change = slopes[: free.size] - slopes[free.size :]
    second = np.stack([whiten(data.weight, d)[:, free] for d in change], axis=-1) / (2 * step.sum(axis=1))
    second = (second + second.swapaxes(1, 2)) / 2
    root = _root(near.covariance[np.ix_(seen[near.free], seen[near.free])])
    tangent = J @ root
    second = np.einsum("nij,ip,jq->npq", second, root, root, optimize=True)
    inside = np.tensordot(tangent.T, second, axes=1)  # (F, F, F): what the tangent plane holds
    normal = second - np.tensordot(tangent, inside, axes=1)
    whole = _excess((normal**2).sum(), np.trace(normal, axis1=1, axis2=2))
    out = np.zeros(len(wanted))
    for k, q in enumerate(wanted):
        slope = root.T @ near.gradients[k, free]
        if not (length := float(np.linalg.norm(slope))):
            continue  # bounds hold the quantity
        v = slope / length
        along = np.tensordot(v, inside, axes=1)
        if not q.linear:
            bent = [(q.gradient(theta + s) - q.gradient(theta - s))[free] / (2 * s.sum()) for s in step]
            along = along - root.T @ np.array(bent) @ root / length
        a = np.concatenate([normal, along[None]])
        across = a @ v
        twice = across @ v
        square = (a**2).sum() - 2 * (across**2).sum() + (twice**2).sum()
        out[k] = whole - _excess(square, np.trace(a, axis1=1, axis2=2) - twice)
    return np.clip(np.nan_to_num(out, nan=0.0, posinf=MOST, neginf=0.0), 0.0, MOST)


def _excess(square: float, traces: np.ndarray) -> float:
    """e of the module's formula, of the sum of squares of all ``a`` and their ``traces`` (M,)."""
    return 0.5 * square - 0.25 * float((traces**2).sum())


def _root(covariance: np.ndarray) -> np.ndarray:
    """R (F, F) with R R^T the covariance, also a singular one of parameters with different units."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
