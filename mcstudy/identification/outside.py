"""A cause outside the library beside the model without effects, refitted: a smooth unknown torque or error of a sensor.

A large deviation moves the parameters too far for a first-order step from the fit without it, which often ends on
bounds. So every deviation is first scored from several anchors (that fit, and those of the leading effects without the
effect), and the most probable are refitted: Gauss-Newton steps on the deviance r' (I + v F F')^-1 r, with F of the
anchor. The prior is so weak (`SLACK` times that of the diagnosis) that it only keeps what nothing determines between
its bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mcstudy.fitting.arguments import Prior
from mcstudy.fitting.penalised import Fitted, whiten
from mcstudy.fitting.problem import Data
from mcstudy.gap.candidates.free_deviations import free_torques
from mcstudy.models.quantities import Quantity
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf, frf_jacobian

SLACK = 4.0
"""Standard deviation of the prior, in those of the diagnosis."""

REFITTED, STEPS, ENOUGH = 8, 15, 0.02
"""Deviations that are refitted, most Gauss-Newton steps of each, and the decrease of the cost at which they end."""

SHARES = (1.0, 0.3, 0.1, 0.02)
"""Parts of a step, of which the first is taken that lowers the cost."""


class Unknown(NamedTuple):
    """One deviation: ln evidence up to that of the data alone, and of K quantities the centre and the variance."""

    log_evidence: float
    centre: np.ndarray
    variance: np.ndarray


@dataclass(frozen=True)
class Problem:
    """What is refitted: a model without effects inside its bounds, its very weak prior, and data."""

    model: Model
    prior: Prior
    data: Data

    def at(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual (M,) and Jacobian (M, P)."""
        H, dH = frf_jacobian(self.model, theta, self.data.f)
        return whiten(self.data.weight, self.data.y - H), whiten(self.data.weight, dH)

    def residual(self, theta: np.ndarray) -> np.ndarray:
        """Residual (M,)."""
        return whiten(self.data.weight, self.data.y - frf(self.model, theta, self.data.f))

    def within(self, theta: np.ndarray) -> np.ndarray:
        """Inside the bounds."""
        return np.clip(theta, self.model.lower, self.model.upper)


class Coloured:
    """Residuals with a deviation F c, c ~ N(0, v I), as if it were noise; F (M, C), none for the data alone."""

    def __init__(self, problem: Problem, F: np.ndarray, size: float) -> None:
        self._problem, self._F = problem, F
        self._root = np.linalg.cholesky(F.T @ F + np.eye(F.shape[1]) / size)
        self._log_size = 2 * float(np.log(np.diag(self._root)).sum()) + F.shape[1] * float(np.log(size))

    def _white(self, x: np.ndarray) -> np.ndarray:
        """(I + v F F')^-1 x."""
        y = np.linalg.solve(self._root, self._F.T @ x)
        return np.asarray(x - self._F @ np.linalg.solve(self._root.T, y))

    def _cost(self, theta: np.ndarray, r: np.ndarray) -> float:
        prior = self._problem.prior
        return float(r @ self._white(r)) + float((((theta - prior.mean) / prior.scale) ** 2).sum())

    def step(self, theta: np.ndarray, r: np.ndarray, J: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
        """Where a Gauss-Newton step within bounds leads, the ln evidence that it predicts, and the covariance."""
        prior, model = self._problem.prior, self._problem.model
        white = self._white(J)
        A = J.T @ white + np.diag(prior.scale**-2.0)
        b = white.T @ r - (theta - prior.mean) / prior.scale**2
        free = np.ones(theta.size, dtype=bool)
        move = np.zeros_like(theta)
        for _ in range(theta.size):
            move[~free] = self._problem.within(theta + move)[~free] - theta[~free]
            move[free] = np.linalg.solve(A[np.ix_(free, free)], (b - A[:, ~free] @ move[~free])[free])
            out = free & ((theta + move < model.lower) | (theta + move > model.upper))
            if not out.any():
                break
            free &= ~out
        cost = self._cost(theta, r) - 2 * float(b @ move) + float(move @ A @ move)
        size = float(np.linalg.slogdet(A * np.outer(prior.scale, prior.scale))[1])
        return theta + move, -0.5 * (cost + self._log_size + size), np.linalg.inv(A)

    def refitted(self, theta: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
        """The same at the minimum, from steps that are halved until the cost falls."""
        for _ in range(STEPS):
            r, J = self._problem.at(theta)
            goal, before = self.step(theta, r, J)[0], self._cost(theta, r)
            ways = [theta + share * (goal - theta) for share in SHARES]
            costs = (self._cost(x, self._problem.residual(x)) for x in ways)
            found = next(((x, c) for x, c in zip(ways, costs, strict=True) if c < before), None)
            if found is None:
                break
            theta = found[0]
            if before - found[1] < ENOUGH:
                break
        _, log_evidence, covariance = self.step(theta, *self._problem.at(theta))
        return theta, log_evidence, covariance


def unknown(problem: Problem, anchors: Sequence[np.ndarray], wanted: Sequence[Quantity]) -> list[Unknown]:
    """The most probable deviations, refitted; the last is none at all. ``anchors``: (P,) each."""
    scored: dict[tuple[int, float], tuple[float, np.ndarray, Coloured]] = {}
    for theta in map(problem.within, anchors):
        r, J = problem.at(theta)
        fitted = Fitted(problem.model, problem.prior, theta, float(r @ r), 0.0, J.T @ J)
        for k, family in enumerate(free_torques(fitted, problem.data)):
            for size in family.variances:
                coloured = Coloured(problem, family.columns, size)
                one = coloured.step(theta, r, J)[1], theta, coloured
                scored[k, size] = max(scored.get((k, size), one), one, key=lambda x: x[0])
    best = sorted(scored.values(), key=lambda x: -x[0])[:REFITTED]
    none = Coloured(problem, np.zeros((len(problem.residual(anchors[0])), 0)), 1.0)
    return [_summary(c.refitted(theta), wanted) for theta, c in (*(x[1:] for x in best), (anchors[0], none))]


def _summary(found: tuple[np.ndarray, float, np.ndarray], wanted: Sequence[Quantity]) -> Unknown:
    theta, log_evidence, covariance = found
    gradients = np.array([q.gradient(theta) for q in wanted])
    variance = np.einsum("kp,pq,kq->k", gradients, covariance, gradients)
    return Unknown(log_evidence, np.array([q.value(theta) for q in wanted]), variance)
