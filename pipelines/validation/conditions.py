"""Fits of one body to group FRFs in several conditions, of which a few parameters may differ: many at once.

The numbers of a condition (`mcstudy.spectra.frf_groups.as_real`) have one covariance with all their correlations, since
points overlap.
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

LARGEST_CHANGE = 3.0
"""Largest logarithm of the factor by which a parameter may differ between conditions. Bounds of the parameters hold in
all conditions; they limit the shift of a weight."""

MARGIN = 0.05
"""Distance of the rightmost root of a loop from the imaginary axis, 1/s, from which on a barrier acts."""

NUDGE = 1e-5
"""Relative step of the derivative of the rightmost root by differences."""


@dataclass(frozen=True)
class Change:
    """Which parameters may differ between conditions.

    Attributes
    ----------
    name: in words. factors: sets of parameters; those of a set are multiplied by the same factor, but a sensory weight,
        which may be near zero, is shifted.
    """

    name: str
    factors: tuple[tuple[str, ...], ...] = ()

    def design(self, model: Model) -> np.ndarray:
        """(P, K): whether log factor k acts on a parameter; a parameter that the model lacks is left out."""
        return np.array([[name in own for own in self.factors] for name in model.names], dtype=float).reshape(
            len(model.names), len(self.factors)
        )

    def sizes(self, model: Model, unknowns: np.ndarray) -> np.ndarray:
        """Factors, or shifts of weights, (..., K), of the unknowns of a fit of two conditions, (..., Q).

        A shift is the one that is left within the bounds of the weight.
        """
        own = unknowns[..., len(model.names) :]
        moved = self.applied(model, unknowns[..., : len(model.names)], unknowns) - unknowns[..., : len(model.names)]
        out = np.exp(own)
        for k, names in enumerate(self.factors):
            if set(names) <= set(model.weights):
                out[..., k] = moved[..., model.names.index(names[0])]
        return out

    def applied(self, model: Model, theta: np.ndarray, unknowns: np.ndarray) -> np.ndarray:
        """Parameters (..., P) of the second condition for ``theta`` of the first, with the change of ``unknowns``.

        They stay within the bounds of the model.
        """
        step = unknowns[..., len(model.names) :] @ self.design(model).T
        return np.clip(np.where(shifted(model), theta + step, theta * np.exp(step)), model.lower, model.upper)

    def undone(self, model: Model, theta: np.ndarray, unknowns: np.ndarray) -> np.ndarray:
        """The inverse of `applied`: parameters of the first condition for ``theta`` of the second."""
        step = unknowns[..., len(model.names) :] @ self.design(model).T
        return np.clip(np.where(shifted(model), theta - step, theta / np.exp(step)), model.lower, model.upper)

    def within(self, other: Change, model: Model) -> np.ndarray | None:
        """(K of other, K): what turns this change into the same one by ``other``; None if ``other`` is no larger."""
        own, larger = self.design(model), other.design(model)
        turn = np.linalg.pinv(larger) @ own
        return turn if np.allclose(larger @ turn, own) else None


def shifted(model: Model) -> np.ndarray:
    """Which parameters (P,) a change shifts; the others it multiplies."""
    return np.array([name in model.weights for name in model.names])


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
    """B fits of C conditions each. Q = P + (C - 1) K unknowns: parameters in the first condition, then log factors
    (shifts of weights).

    Attributes
    ----------
    model, group: the model, and the group whose points it is compared at. change: what may differ.
    data: (B, C, D). whitening: (C D, C D), inverse of the Cholesky factor of the covariance of the numbers of all C
        conditions. centre, spread: (P,) or (B, P) normal prior of the parameters; an infinite spread is none.
    lower, upper: (P,) bounds of the parameters. barrier: weight, s, of the instability of every condition's loop, one
        residual each; 0 for none.
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
    barrier: float = 0.0

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
        """Parameters of every condition, (B, C, P), of unknowns (B, Q), within their bounds."""
        return np.clip(self._unbounded(q), self.lower, self.upper)

    def _unbounded(self, q: np.ndarray) -> np.ndarray:
        P, C, A = len(self.model.names), self.data.shape[1], self.change.design(self.model)
        step = np.zeros((len(q), C, P))
        step[:, 1:] = q[:, P:].reshape(len(q), C - 1, A.shape[1]) @ A.T
        first = q[:, None, :P]
        return np.asarray(np.where(shifted(self.model), first + step, first * np.exp(step)))

    def predicted(self, q: np.ndarray) -> np.ndarray:
        """What the fits say of the data, (B, C, D)."""
        return as_real(points_of(self.group, frf(self.model, self.parameters(q), self.group["f_line"].values)))

    def residual(self, q: np.ndarray) -> np.ndarray:
        """Whitened residuals, those of the prior, and with a barrier those of instability, (B, C D + P (+ C))."""
        r = (self.predicted(q) - self.data).reshape(len(q), -1) @ self.whitening.T
        parts = [r, (q[:, : self.lower.size] - self.centre) / self.spread]
        if self.barrier:
            parts.append(self.barrier * np.maximum(self.growth(q) + MARGIN, 0.0))
        return np.concatenate(parts, axis=1)

    def misfit(self, q: np.ndarray) -> np.ndarray:
        """Whitened squared residual of the data, (B,)."""
        r = (self.predicted(q) - self.data).reshape(len(q), -1) @ self.whitening.T
        return np.asarray((r**2).sum(axis=1))

    def cost(self, q: np.ndarray) -> np.ndarray:
        """Squared residual with that of the prior, (B,)."""
        return self.misfit(q) + (((q[:, : self.lower.size] - self.centre) / self.spread) ** 2).sum(axis=1)

    def growth(self, q: np.ndarray) -> np.ndarray:
        """Growth rate of the loop in every condition, 1/s, (B, C); negative is stable."""
        theta = self.parameters(q)
        return growth_rate(self.model, theta.reshape(-1, theta.shape[-1])).reshape(theta.shape[:2])

    def barrier_slope(self, q: np.ndarray) -> np.ndarray:
        """Derivatives (B, C, Q) of the residuals of instability, by differences."""
        here = self.growth(q)
        out = np.zeros((*here.shape, q.shape[1]))
        near = np.flatnonzero((here > -MARGIN).any(axis=1))
        if near.size:
            step = np.full(q.shape[1], NUDGE)
            step[: self.lower.size] *= self.upper - self.lower
            moved = self.growth((q[near] + np.diag(step)[:, None]).reshape(-1, q.shape[1]))
            slope = (moved.reshape(len(step), len(near), -1) - here[near]) / step[:, None, None]
            out[near] = self.barrier * np.moveaxis(slope, 0, -1) * (here[near] > -MARGIN)[..., None]
        return out

    def linearised(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`residual` and its derivatives (B, C D + P (+ C), Q); those of the barrier are not exact."""
        B, (C, D), P = len(q), self.data.shape[1:], self.lower.size
        A = self.change.design(self.model)
        K, theta = A.shape[1], self.parameters(q)
        inside = theta == self._unbounded(q)  # a parameter that a change would move beyond its bound stays there
        H, J = frf_jacobian(self.model, theta, self.group["f_line"].values)
        r = (as_real(points_of(self.group, H)) - self.data).reshape(B, -1)
        slope = np.moveaxis(as_real(points_of(self.group, np.moveaxis(J, -1, 2))), 2, -1)  # (B, C, D, P)
        slope = slope * inside[:, :, None]
        whole = np.zeros((B, C, D, P + (C - 1) * K))
        adds = shifted(self.model)
        with np.errstate(invalid="ignore", divide="ignore"):
            whole[..., :P] = slope * np.where(adds | (q[:, None, :P] <= 0), 1.0, theta / q[:, None, :P])[:, :, None]
        for c in range(1, C):
            whole[:, c, :, P + (c - 1) * K : P + c * K] = (slope[:, c] * np.where(adds, 1.0, theta[:, c])[:, None]) @ A
        prior = np.zeros((P, whole.shape[-1]))
        prior[:, :P] = np.diag(1 / np.broadcast_to(self.spread, (P,)))
        J = np.concatenate(
            [self.whitening @ whole.reshape(B, C * D, -1), np.broadcast_to(prior, (B, *prior.shape))], axis=1
        )
        parts = [r @ self.whitening.T, (q[:, :P] - self.centre) / self.spread]
        if self.barrier:
            parts.append(self.barrier * np.maximum(self.growth(q) + MARGIN, 0.0))
            J = np.concatenate([J, self.barrier_slope(q)], axis=1)
        return np.concatenate(parts, axis=1), J


def part(problem: Conditions, at: np.ndarray) -> Conditions:
    """The problems ``at`` of many."""
    centre = problem.centre[at] if problem.centre.ndim == 2 else problem.centre
    return replace(problem, data=problem.data[at], centre=centre)


def whitening_of(covariance: np.ndarray) -> np.ndarray:
    """Inverse of the Cholesky factor of a covariance."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
