"""Standard errors of a fit, to first order in the noise: from the information at the estimate.

For maximum likelihood they are the roots of the diagonal of the inverse information (Wald). For other weights, such as
the paper's cost, they are those of the sandwich A^-1 B A^-1, with A = Re(J^H W^H W J), B = Re(J^H W^H W C W^H W J) / 2,
J the derivatives of the FRFs and C the covariance of their errors. A parameter on a bound is held there: it has no
standard error, and those of the others are conditional on it. Derived.
"""

from __future__ import annotations

import numpy as np

from mcstudy.fitting.problem import Problem
from mcstudy.spectra.bands import Bands
from mcstudy.stance.response import frf_jacobian


def wald_covariance(information: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Covariance (F, F) of the ``free`` (P,) parameters, the others known, from an information matrix (P, P)."""
    known = information[np.ix_(free, free)]
    size = np.sqrt(np.diag(known))  # in own units the delays are 1e6 times smaller than the stiffnesses
    size = np.where(size > 0, size, 1.0)
    return np.asarray(np.linalg.pinv(known / size / size[:, None], hermitian=True) / size / size[:, None])


def joint_covariance(covariance: np.ndarray, overlap: np.ndarray | None = None) -> np.ndarray:
    """Covariance of all points together, (N Y, N Y), from that of each point (N, Y, Y).

    ``overlap`` (N, N) is the correlation of neighbouring points that share lines (`overlap_of`); none by default.
    Raises `LinAlgError` where a point's covariance is not positive definite.
    """
    n, Y = covariance.shape[:2]
    root = np.linalg.cholesky(covariance)
    overlap = np.eye(n) if overlap is None else overlap
    return np.einsum("nij,nm,mkj->nimk", root, overlap, root.conj()).reshape(Y * n, Y * n)


def overlap_of(bands: Bands, stimuli: int = 1) -> np.ndarray:
    """Correlation of the points' errors through shared lines, (N, N); exact where the lines' noise is alike.

    Under J ``stimuli`` in turn, each recorded by itself, (N J, N J).
    """
    gram = bands.weights @ bands.weights.T
    scale = np.sqrt(np.diag(gram))
    return np.kron(gram / scale[:, None] / scale[None, :], np.eye(stimuli))


def sandwich(J: np.ndarray, weight: np.ndarray, joint: np.ndarray) -> np.ndarray:
    """First-order covariance (F, F) of least squares with weights (N, Y, Y) for FRF errors ``joint`` (N Y, N Y).

    ``J`` (N, Y, F): derivatives of the FRFs in the free parameters, in units in which these are of one size.
    """
    weighted = np.einsum("nij,njp->nip", weight, J)
    G = np.einsum("nji,njp->nip", weight.conj(), weighted).reshape(-1, J.shape[-1])
    A = np.einsum("nip,niq->pq", weighted.conj(), weighted).real
    B = (G.conj().T @ joint @ G).real / 2
    half = np.linalg.solve(A, B)
    return np.asarray(np.linalg.solve(A, half.T))


def standard_errors(
    problem: Problem, theta: np.ndarray, covariance: np.ndarray, overlap: np.ndarray, likelihood: bool
) -> np.ndarray:
    """Standard errors (P,) of the estimate ``theta``; NaN for parameters on a bound.

    Parameters
    ----------
    covariance: of the FRF errors at each point, (N, Y, Y). overlap: (N, N), from `overlap_of`.
    likelihood: whether the weights of ``problem`` are those of this covariance (`ml_cost`).

    All are NaN where the data do not determine the free parameters, or where the covariance is not one.
    """
    model = problem.model
    free = (theta > model.lower) & (theta < model.upper)
    out = np.full(theta.size, np.nan)
    if not free.any() or not np.isfinite(covariance).all():
        return out
    scale = (model.upper - model.lower)[free]
    try:
        if likelihood and (overlap == np.eye(len(overlap))).all():
            J = problem.jacobian(theta)[:, free] * scale
            estimate_covariance = wald_covariance(2 * J.T @ J, np.ones(scale.size, dtype=bool))
        else:
            _, J = frf_jacobian(model, theta, problem.f)
            estimate_covariance = sandwich(J[..., free] * scale, problem.weight, joint_covariance(covariance, overlap))
    except np.linalg.LinAlgError:
        return out
    variance = np.diag(estimate_covariance)
    out[free] = np.sqrt(np.where(variance > 0, variance, np.nan)) * scale
    return out
