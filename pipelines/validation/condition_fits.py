"""Search for the lowest minima of `pipelines.validation.conditions`: many problems and starts at once.

Errors of points correlate, so the fits are those of `mcstudy.fitting.batch_least_squares`. A test compares their minima
with those of `scipy.optimize.least_squares`. People stand, so a fit must be stable in every condition: an unstable
minimum is led to the limit of stability by a barrier.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mcstudy.fitting.batch_least_squares import minimised
from pipelines.validation.conditions import Conditions, part

BARRIERS = (10.0, 100.0)
"""Weights of the barrier, s, with which an unstable minimum is led to the nearest stable one."""

FALLS = 1e12
"""Added to the cost of an unstable fit."""

LED = 3
"""Unstable minima of a problem, the lowest ones, that are led to the limit of stability."""


@dataclass(frozen=True)
class Fitted:
    """Minima. unknowns: (B, Q). cost: (B,) with the prior, and the barrier if there is one. misfit: (B,) whitened
    squared residual of the data."""

    unknowns: np.ndarray
    cost: np.ndarray
    misfit: np.ndarray


def fit(problem: Conditions, starts: np.ndarray, iterations: int = 150) -> Fitted:
    """Minima reached from ``starts`` (B, Q)."""
    lower, upper = problem.bounds
    q, cost = minimised(
        lambda x, at: part(problem, at).residual(x),
        lambda x, at: part(problem, at).linearised(x),
        starts,
        lower,
        upper,
        iterations,
    )
    return Fitted(q, cost, problem.misfit(q))


@dataclass(frozen=True)
class Minima:
    """Where fits ended. unknowns: (M, Q). cost: (M,), with `FALLS` added to unstable ones. of: (M,), their problems."""

    unknowns: np.ndarray
    cost: np.ndarray
    of: np.ndarray


def minima_of(problem: Conditions, starts: np.ndarray, of: np.ndarray, iterations: int = 150) -> Minima:
    """Minima from ``starts`` (M, Q) of the problems ``of`` (M,).

    The lowest unstable ones are there a second time, led to the limit of stability.
    """
    found = fit(part(problem, of), starts, iterations)
    cost = np.where(np.isfinite(found.cost), found.cost, np.inf)
    falls = _falls(problem, found.unknowns)
    led = [k for b in np.unique(of) for k in _promising(cost, falls, np.flatnonzero(of == b))]
    q = found.unknowns[led]
    for weight in BARRIERS if led else ():
        q = fit(replace(part(problem, of[led]), barrier=weight), q, iterations).unknowns
    return _judged(problem, np.concatenate([found.unknowns, q]), np.concatenate([of, of[led]]))


def _judged(problem: Conditions, unknowns: np.ndarray, of: np.ndarray) -> Minima:
    own = part(problem, of)
    cost = own.cost(unknowns)
    return Minima(unknowns, np.where(np.isfinite(cost), cost, np.inf) + FALLS * _falls(own, unknowns), of)


def _falls(problem: Conditions, unknowns: np.ndarray) -> np.ndarray:
    """Whether the loop is unstable in a condition, (B,)."""
    return np.asarray(~(problem.growth(unknowns) < 0).all(axis=1))


def _promising(cost: np.ndarray, falls: np.ndarray, at: np.ndarray) -> list[int]:
    """Of the fits ``at`` of one problem, the lowest distinct unstable ones, if they are below the stable ones."""
    best = cost[at][~falls[at]].min(initial=np.inf)
    wanted = at[falls[at] & (cost[at] < best)]
    return [int(wanted[k]) for k in distinct(cost[wanted], LED)]


def best_of(problem: Conditions, starts: np.ndarray, iterations: int = 150) -> Fitted:
    """The lowest stable fit from S starts for each of B problems; where none is stable, the lowest.

    ``starts``: (S, B, Q), or (S, 1, Q) for the same ones everywhere. A stable start counts as a fit, so that no fit is
    worse than it.
    """
    S, B = len(starts), len(problem.data)
    every = np.clip(np.broadcast_to(starts, (S, B, starts.shape[-1])).reshape(S * B, -1), *problem.bounds)
    of = np.tile(np.arange(B), S)
    ends, begun = minima_of(problem, every, of, iterations), _judged(problem, every, of)
    unknowns, cost = np.concatenate([ends.unknowns, begun.unknowns]), np.concatenate([ends.cost, begun.cost])
    belongs = np.concatenate([ends.of, begun.of])
    pick = np.array([at[cost[at].argmin()] for at in (np.flatnonzero(belongs == b) for b in range(B))])
    return Fitted(unknowns[pick], problem.cost(unknowns[pick]), problem.misfit(unknowns[pick]))


def leaders(problem: Conditions, starts: np.ndarray, most: int) -> np.ndarray:
    """The lowest distinct fits of one problem from ``starts`` (S, Q), stable ones first, (up to ``most``, Q).

    The first is no worse than any stable start.
    """
    of = np.zeros(len(starts), dtype=int)
    ends = minima_of(problem, starts, of)
    found = ends.unknowns[distinct(ends.cost, most)]
    first = best_of(problem, np.concatenate([found, starts])[:, None], iterations=0).unknowns
    return np.concatenate([first, found[1:] if np.array_equal(first[0], found[0]) else found])[:most]


def distinct(cost: np.ndarray, most: int, apart: float = 0.5) -> list[int]:
    """Positions of the lowest costs that are ``apart``, lowest first."""
    kept: list[int] = []
    for k in np.argsort(cost):
        if np.isfinite(cost[k]) and (not kept or cost[k] > cost[kept[-1]] + apart):
            kept.append(int(k))
        if len(kept) == most:
            break
    return kept
