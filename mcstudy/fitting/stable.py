"""Fits whose closed loop must be stable: the lowest cost with all characteristic roots left of a margin.

A response says nothing of stability: an unstable loop can fit as well as a stable one. Where the lowest cost is that of
an unstable loop, the lowest cost of a stable one lies on the boundary, where one or more roots touch the margin. It is
found by augmented Lagrangians (Hestenes 1969, J Optim Theory Appl 4:303-320): every root that is, or has
been, right of the margin adds one residual to the sum of squares, sqrt(weight) max(0, Re s + margin + multiplier), so
that Levenberg-Marquardt steps serve. Roots are counted one by one, not as their largest real part, which has corners
where two of them change places. Each residual includes the certified rightmost root, so that none is overlooked.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mcstudy.fitting.batch_least_squares import minimised
from mcstudy.fitting.problem import Fits, Problem
from mcstudy.fitting.status import USABLE, Status
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf, frf_jacobian
from mcstudy.stance.roots import followed, loops_of, slopes
from mcstudy.stance.stability import growth_rate, rightmost_root

Residual = Callable[[np.ndarray, np.ndarray], np.ndarray]
Linearised = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

WATCHED = 6
"""Roots of each fit that may hold it at the boundary."""

ROUNDS, ITERATIONS = 12, 60
"""Updates of the multipliers, and steps between two of them."""

TOUCHING = 1e-4
"""How far left of the margin the roots are put that touch it, 1/s: the largest error of a constraint."""

SAME = 1e-5
"""Distance of two roots, relative to 1 + |s|, below which they are one."""

FALLEN, FIRMER = 0.25, 8.0
"""Share to which a round must reduce the largest excess, else the weight of the roots grows by this factor."""

STILL, IDLE = 0.9, 4
"""A fit whose excess no round of so many brings to this share is held off the margin: nothing stable is near."""

ROUGH = 1e-8
"""Relative decrease of the cost with its roots at which a round ends."""

SETTLED = 1e-6
"""Change of the cost over a round, relative to it, below which a fit that keeps the margin has converged."""


@dataclass
class _Watch:
    """The roots that each of B fits watches, with the weights and multipliers of their residuals."""

    loop: Model
    margin: float
    root: np.ndarray
    multiplier: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, loop: Model, margin: float, weight: np.ndarray) -> _Watch:
        """No roots yet."""
        nothing = np.zeros((len(weight), WATCHED))
        return cls(loop, margin, np.full(nothing.shape, np.nan, dtype=complex), nothing, weight.copy())

    def excess(self, theta: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (b, K + 1) at parameters (b, P) of fits ``at``, and the roots they are of.

        The last is that of the rightmost root, zero where it is a watched one.
        """
        worst = rightmost_root(self.loop, theta, fallback=False).root
        root = np.concatenate([followed(self.loop, theta, self.root[at]), worst[:, None]], axis=1)
        known = np.abs(root[:, :-1] - worst[:, None]) < SAME * (1 + np.abs(worst[:, None]))
        root[known.any(axis=1), -1] = np.nan
        moved = np.concatenate([self.multiplier[at], np.zeros((at.size, 1))], axis=1)
        with np.errstate(invalid="ignore"):
            beyond = np.nan_to_num(np.maximum(root.real + self.margin + moved, 0.0))
        # A loop without an answer, or without a number, is no place to step to.
        beyond[~np.isfinite(worst.real) & ~np.isneginf(worst.real), -1] = np.inf
        return np.sqrt(self.weight[at, None]) * beyond, root

    def pulled(self, theta: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The residuals with their derivatives, (b, K + 1, P), at parameters that a step has reached."""
        beyond, root = self.excess(theta, at)
        on = np.where(beyond > 0, np.sqrt(self.weight[at, None]), 0.0)
        change = slopes(self.loop, theta, root) * on[..., None]
        self._take_up(at, root)
        return beyond, change

    def update(self, theta: np.ndarray, at: np.ndarray, firmer: np.ndarray) -> None:
        """New multipliers after a round, and a larger weight of those fits that it did not bring far enough."""
        beyond, root = self.excess(theta, at)
        self.multiplier[at] = beyond[:, :-1] / np.sqrt(self.weight[at, None])
        self._take_up(at, root)
        self.weight[at[firmer]] *= FIRMER
        self.multiplier[at[firmer]] /= FIRMER

    def _take_up(self, at: np.ndarray, root: np.ndarray) -> None:
        """Watch the ``root`` (b, K + 1) of fits ``at`` from now on, the last one in place of the one farthest left."""
        self.root[at] = root[:, :-1]
        new = np.flatnonzero(np.isfinite(root[:, -1]) & (root[:, -1].real + self.margin > 0))
        place = np.nan_to_num(self.root[at[new]].real, nan=-np.inf).argmin(axis=1)
        self.root[at[new], place], self.multiplier[at[new], place] = root[new, -1], 0.0


def stabilised(
    model: Model, residual: Residual, linearised: Linearised, starts: np.ndarray, margin: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lowest sums of squares with no root right of -``margin``, from unstable ``starts`` (B, P).

    Parameters
    ----------
    residual, linearised: of parameters of the fits at positions, as in `mcstudy.fitting.batch_least_squares.minimised`.

    Returns
    -------
    Parameters (B, P), sums of squares (B,), and whether the loop keeps the margin, (B,): `growth_rate` certifies it.
    """
    B, every = len(starts), np.arange(len(starts))
    theta = np.clip(starts, model.lower, model.upper)
    cost, growth = (residual(theta, every) ** 2).sum(axis=1), growth_rate(model, theta)
    excess, goal = np.maximum(growth + margin, TOUCHING), margin + TOUCHING
    weight = np.maximum(cost, np.finfo(float).tiny) / np.maximum(excess, 1.0) ** 2
    watches = [_Watch.of(loop, goal, weight) for loop in loops_of(model)]
    going, idle = np.isfinite(cost) & np.isfinite(growth), np.zeros(B, dtype=int)
    for _ in range(ROUNDS):
        at = np.flatnonzero(going)
        if not at.size:
            break
        before = cost[at]
        theta[at] = _round(model, residual, linearised, theta, at, watches)
        cost[at] = (residual(theta[at], at) ** 2).sum(axis=1)
        growth[at] = growth_rate(model, theta[at])
        now = np.maximum(growth[at] + goal, 0.0)
        for watch in watches:
            watch.update(theta[at], at, now > np.maximum(FALLEN * excess[at], TOUCHING / 2))
        idle[at] = np.where(now > STILL * excess[at], idle[at] + 1, 0)
        excess[at] = now
        settled = (growth[at] <= -margin) & (np.abs(cost[at] - before) <= SETTLED * before)
        going[at] = ~settled & ~((growth[at] > -margin) & (idle[at] >= IDLE))
    return theta, cost, growth <= -margin


def _round(
    model: Model, residual: Residual, linearised: Linearised, theta: np.ndarray, at: np.ndarray, watches: list[_Watch]
) -> np.ndarray:
    """Parameters (b, P) of fits ``at`` with the lowest sum of squares and of the residuals of their roots."""

    def whole(q: np.ndarray, which: np.ndarray) -> np.ndarray:
        return np.concatenate([residual(q, at[which]), *(w.excess(q, at[which])[0] for w in watches)], axis=1)

    def with_slopes(q: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pulled = [w.pulled(q, at[which]) for w in watches]
        r, J = linearised(q, at[which])
        return np.concatenate([r, *(p[0] for p in pulled)], axis=1), np.concatenate(
            [J, *(p[1] for p in pulled)], axis=1
        )

    return minimised(whole, with_slopes, theta[at], model.lower, model.upper, ITERATIONS, ROUGH)[0]


def stable_ends(problems: Sequence[Problem], assignment: np.ndarray, fits: Fits, margin: float) -> Fits:
    """The ``fits`` of problems that share model and frequencies, each unstable end moved to a stable one.

    Where none is found the status is `Status.UNSTABLE`.
    """
    model = problems[0].model
    usable = np.flatnonzero(np.isin(fits.status, USABLE))
    unstable = usable[~(growth_rate(model, fits.estimate[usable]) <= -margin)]
    for m in unstable:  # one by one: what fits share a call must not show in their bits
        squares = Squares.of([problems[assignment[m]]])
        theta, cost, held = stabilised(model, squares.residual, squares.linearised, fits.estimate[[m]], margin)
        status = np.where(held, Status.CONVERGED, Status.UNSTABLE)
        fits.put(m[None], Fits.of(model, theta, np.where(held, cost, np.nan), status, fits.iterations[[m]]))
    return fits


class Squares(NamedTuple):
    """The sums of squares of B problems that share model and frequencies (`Problem.residual`)."""

    model: Model
    f: np.ndarray
    y: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, problems: Sequence[Problem]) -> Squares:
        """Those of ``problems``."""
        y, weight = np.stack([p.y for p in problems]), np.stack([p.weight for p in problems])
        return cls(problems[0].model, problems[0].f, y, weight)

    def residual(self, theta: np.ndarray, at: np.ndarray) -> np.ndarray:
        """At parameters (b, P) of the problems at positions ``at``, (b, 2 Y N)."""
        return _real(np.einsum("bnij,bnj->bni", self.weight[at], frf(self.model, theta, self.f) - self.y[at]))

    def linearised(self, theta: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same with derivatives, (b, 2 Y N, P)."""
        H, dH = frf_jacobian(self.model, theta, self.f)
        r = np.einsum("bnij,bnj->bni", self.weight[at], H - self.y[at])
        return _real(r), _real(np.einsum("bnij,bnjp->bnip", self.weight[at], dH), dH.shape[-1])


def _real(z: np.ndarray, *last: int) -> np.ndarray:
    return np.concatenate([part.reshape(len(z), -1, *last) for part in (z.real, z.imag)], axis=1)
