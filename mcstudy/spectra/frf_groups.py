"""Group FRFs: what a model says of their points, the mean of people, and the covariance from the scatter between them.

An FRF of two segments at N points is handled as 4 N real numbers, in the order of `as_real`. Neighbouring points share
harmonics, and one person's gains are high or low together, so these numbers correlate. People are independent; the
scatter between them is the only error that such data have. With fewer people than numbers its sample covariance is
singular. It is therefore shrunk (Schäfer & Strimmer 2005, Stat Appl Genet Mol Biol 4:32, target D): variances are kept,
correlations are multiplied by 1 - lambda with the lambda that minimises the expected squared error of all of them,
estimated from the data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from mcstudy.errors import InputError
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf, frf_jacobian

LEAST_PEOPLE = 4
"""Fewest people from whom a covariance is estimated."""


def as_real(points: np.ndarray) -> np.ndarray:
    """Complex FRFs (..., 2, N) as real numbers (..., 4 N): real parts of lower, upper, then imaginary parts of both."""
    flat = points.reshape(*points.shape[:-2], -1)
    return np.concatenate([flat.real, flat.imag], axis=-1)


def as_complex(numbers: np.ndarray) -> np.ndarray:
    """The inverse of `as_real`, (..., 4 N) to (..., 2, N)."""
    half = numbers.shape[-1] // 2
    return np.asarray(numbers[..., :half] + 1j * numbers[..., half:]).reshape(*numbers.shape[:-1], 2, half // 2)


def in_space(angles: np.ndarray) -> np.ndarray:
    """Angles theta1 and theta2 (the hip) in the last axis as those of the lower and the upper body in space."""
    return np.stack([angles[..., 0], angles[..., 0] + angles[..., 1]], axis=-1)


def points_of(group: xr.Dataset, lines: np.ndarray) -> np.ndarray:
    """FRFs (..., L, 2) of theta1 and theta2 at the harmonics of a group as its points (..., 2, N), angles in space."""
    return np.moveaxis(np.einsum("nl,...ls->...ns", group["average"].values, in_space(lines)), -1, -2)


def model_points(model: Model, theta: np.ndarray, group: xr.Dataset) -> np.ndarray:
    """What a model with parameters ``theta`` (..., P) says of the points of a group, (..., 2, N)."""
    return points_of(group, frf(model, theta, group["f_line"].values))


def model_points_jacobian(model: Model, theta: np.ndarray, group: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """`model_points` (2, N) at ``theta`` (P,), and its exact derivatives (P, 2, N)."""
    H, J = frf_jacobian(model, theta, group["f_line"].values)
    return points_of(group, H), points_of(group, np.moveaxis(J, -1, 0))


@dataclass(frozen=True)
class Scatter:
    """Covariance between people of what `as_real` gives.

    Attributes
    ----------
    covariance: (D, D), shrunk. shrinkage: lambda, between 0 (sample covariance) and 1 (uncorrelated).
    dof: degrees of freedom of the variances.
    """

    covariance: np.ndarray
    shrinkage: float
    dof: int


def scatter(*samples: np.ndarray) -> Scatter:
    """Covariance of one person about the mean of a group, pooled over ``samples``, each (people, D) of one group.

    Raises `InputError` for fewer than `LEAST_PEOPLE` people in all beyond the means that are estimated.
    """
    about = np.concatenate([x - x.mean(axis=0) for x in samples])
    dof = len(about) - len(samples)
    if dof < LEAST_PEOPLE - 1:
        raise InputError(f"people: expected at least {LEAST_PEOPLE} with all responses, got {len(about)}")
    S = about.T @ about / dof
    sd = np.sqrt(np.diag(S))
    if not (sd > 0).all():
        raise InputError("people: expected FRFs that differ between people, got a point at which all are equal")
    z = about / sd
    R = z.T @ z / dof
    # variance of every correlation from the scatter of the products of standardised values
    n = len(about)
    spread = ((z * z).T @ (z * z) - (z.T @ z) ** 2 / n) * n / (dof**2 * (n - 1))
    off = ~np.eye(len(R), dtype=bool)
    lam = float(np.clip(spread[off].sum() / (R[off] ** 2).sum(), 0.0, 1.0))
    R = np.where(off, (1 - lam) * R, 1.0)
    return Scatter(R * np.outer(sd, sd), lam, dof)
