"""Fits of one body to group FRFs in several conditions, of which a few parameters may differ: many at once.

The numbers of a condition (`mcstudy.spectra.frf_groups.as_real`) have one covariance with all their correlations, since
points overlap; the compiled kernel takes errors that are independent between frequencies, so these fits have a solver
of their own, a bounded Levenberg-Marquardt method in numpy that steps all problems of a call together. A test compares
its minima with those of `scipy.optimize.least_squares`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from mcstudy.errors import InputError
from mcstudy.spectra.frf_groups import as_real, points_of
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf, frf_jacobian
from mcstudy.stance.stability import growth_rate

LARGEST_CHANGE = 2.5
"""Largest logarithm of the factor by which a parameter may differ between conditions (a factor of 12)."""

TOLERANCE = 1e-9
"""Relative decrease of the cost below which a fit has converged."""


CALM = 1e-2
"""Damping below which a small decrease means a minimum and not a short step."""

SIDES = 6
"""Rounds in which unknowns of a step are put on the sides that they would cross."""


@dataclass(frozen=True)
class Change:
    """Which parameters may differ between conditions.

    Attributes
    ----------
    name: in words. factors: sets of parameters; those of a set are multiplied by the same factor.
    """

    name: str
    factors: tuple[tuple[str, ...], ...] = ()

    def design(self, model: Model) -> np.ndarray:
        """(P, K): whether log factor k acts on a parameter; a parameter that the model lacks is left out."""
        return np.array([[name in own for own in self.factors] for name in model.names], dtype=float).reshape(
            len(model.names), len(self.factors)
        )


def changes(model: Model) -> tuple[Change, ...]:
    """The accounts that are compared: what differs between two conditions of the same people."""
    gains = tuple(dict.fromkeys(t.gain[0] for t in model.terms if t.noisy and t.sense != "stimulus"))
    passive = tuple(n for n in model.names if n not in (*gains, *model.delays, *model.weights))
    weight = (model.weights,) if model.weights else ()
    delays = model.delays
    return (
        Change("nothing"),
        Change("weight", weight),
        Change("active gains", (gains,)),
        Change("passive stiffness", (passive,)),
        Change("delays", (delays,)),
        Change("weight and active gains", (*weight, gains)),
        Change("weight and passive stiffness", (*weight, passive)),
        Change("weight and delays", (*weight, delays)),
        Change("everything", tuple((n,) for n in model.names)),
    )


@dataclass(frozen=True)
class Conditions:
    """B fits of C conditions each. Q = P + (C - 1) K unknowns: parameters in the first condition, then log factors.

    Attributes
    ----------
    model, group: the model, and the group whose points it is compared at. change: what may differ.
    data: (B, C, D). whitening: (C D, C D), inverse of the Cholesky factor of the covariance of the numbers of all C
        conditions. centre, spread: (P,) or (B, P) normal prior of the parameters; an infinite spread is none.
    lower, upper: (P,) bounds of the parameters.
    """

    model: Model
    group: xr.Dataset
    change: Change
    data: np.ndarray
    whitening: np.ndarray
    centre: np.ndarray
    spread: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def __post_init__(self) -> None:
        _, C, D = self.data.shape
        if self.whitening.shape != (C * D, C * D):
            raise InputError(f"whitening: expected ({C * D}, {C * D}) for {C} conditions, got {self.whitening.shape}")

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(Q,) each."""
        changes = (self.data.shape[1] - 1) * len(self.change.factors)
        wide = np.full(changes, LARGEST_CHANGE)
        return np.r_[self.lower, -wide], np.r_[self.upper, wide]

    def parameters(self, q: np.ndarray) -> np.ndarray:
        """Parameters of every condition, (B, C, P), of unknowns (B, Q)."""
        P, C, A = len(self.model.names), self.data.shape[1], self.change.design(self.model)
        factor = np.zeros((len(q), C, P))
        factor[:, 1:] = q[:, P:].reshape(len(q), C - 1, A.shape[1]) @ A.T
        return np.asarray(q[:, None, :P] * np.exp(factor))

    def predicted(self, q: np.ndarray) -> np.ndarray:
        """What the fits say of the data, (B, C, D)."""
        return as_real(points_of(self.group, frf(self.model, self.parameters(q), self.group["f_line"].values)))

    def residual(self, q: np.ndarray) -> np.ndarray:
        """Whitened residuals, then those of the prior, (B, C D + P)."""
        r = (self.predicted(q) - self.data).reshape(len(q), -1) @ self.whitening.T
        return np.concatenate([r, (q[:, : self.lower.size] - self.centre) / self.spread], axis=1)

    def linearised(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`residual` and its exact derivatives (B, C D + P, Q)."""
        B, (C, D), P = len(q), self.data.shape[1:], self.lower.size
        A = self.change.design(self.model)
        K, theta = A.shape[1], self.parameters(q)
        H, J = frf_jacobian(self.model, theta, self.group["f_line"].values)
        r = (as_real(points_of(self.group, H)) - self.data).reshape(B, -1)
        slope = np.moveaxis(as_real(points_of(self.group, np.moveaxis(J, -1, 2))), 2, -1)  # (B, C, D, P)
        whole = np.zeros((B, C, D, P + (C - 1) * K))
        with np.errstate(invalid="ignore", divide="ignore"):
            whole[..., :P] = slope * np.where(q[:, None, :P] > 0, theta / q[:, None, :P], 1.0)[:, :, None]
        for c in range(1, C):
            whole[:, c, :, P + (c - 1) * K : P + c * K] = (slope[:, c] * theta[:, c, None]) @ A
        prior = np.zeros((P, whole.shape[-1]))
        prior[:, :P] = np.diag(1 / np.broadcast_to(self.spread, (P,)))
        J = np.concatenate(
            [self.whitening @ whole.reshape(B, C * D, -1), np.broadcast_to(prior, (B, *prior.shape))], axis=1
        )
        r = np.concatenate([r @ self.whitening.T, (q[:, :P] - self.centre) / self.spread], axis=1)
        return r, J


@dataclass(frozen=True)
class Fitted:
    """Minima. unknowns: (B, Q). cost: (B,) with the prior. misfit: (B,) whitened squared residual of the data."""

    unknowns: np.ndarray
    cost: np.ndarray
    misfit: np.ndarray


def fit(problem: Conditions, starts: np.ndarray, iterations: int = 150) -> Fitted:
    """Minima reached from ``starts`` (B, Q), by bounded Levenberg-Marquardt steps in units of the diagonal."""
    lower, upper = problem.bounds
    q = np.clip(starts, lower, upper)
    cost = (problem.residual(q) ** 2).sum(axis=1)
    damping = np.full(len(q), 1e-2)
    going = np.isfinite(cost)
    for _ in range(iterations):
        at = np.flatnonzero(going)
        if not at.size:
            break
        own = part(problem, at)
        r, J = own.linearised(q[at])
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
            after = (own.residual(trial) ** 2).sum(axis=1)
        better = after < cost[at]
        done = better & (cost[at] - after < TOLERANCE * cost[at]) & (damping[at] < CALM)
        q[at[better]] = trial[better]
        cost[at[better]] = after[better]
        damping[at] *= np.where(better, 0.2, 4.0)
        going[at[done | (damping[at] > 1e9)]] = False
        damping = np.maximum(damping, 1e-9)
    P = problem.lower.size
    return Fitted(q, cost, (problem.residual(q)[:, :-P] ** 2).sum(axis=1))


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


def part(problem: Conditions, at: np.ndarray) -> Conditions:
    """The problems ``at`` of many."""
    centre = problem.centre[at] if problem.centre.ndim == 2 else problem.centre
    return replace(problem, data=problem.data[at], centre=centre)


def best_of(problem: Conditions, starts: np.ndarray, stable: bool = True) -> Fitted:
    """The lowest of the minima from S starts for each of B problems.

    Parameters
    ----------
    starts: (S, B, Q), or (S, 1, Q) for the same ones everywhere.
    stable: whether to take the lowest at which the loop is stable in every condition, where there is one.
    """
    S, B = len(starts), len(problem.data)
    every = np.broadcast_to(starts, (S, B, starts.shape[-1])).reshape(S * B, -1)
    found = fit(part(problem, np.tile(np.arange(B), S)), every)
    cost = np.where(np.isfinite(found.cost), found.cost, np.inf)
    if stable:
        theta = problem.parameters(found.unknowns)
        falls = np.array([not (growth_rate(problem.model, x) < 0).all() for x in theta])
        cost = np.where(falls, cost + 1e12, cost)
    pick = cost.reshape(S, B).argmin(axis=0) * B + np.arange(B)
    return Fitted(found.unknowns[pick], found.cost[pick], found.misfit[pick])


def whitening_of(covariance: np.ndarray) -> np.ndarray:
    """Inverse of the Cholesky factor of a covariance."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
