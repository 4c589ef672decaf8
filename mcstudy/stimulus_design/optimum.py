"""The powers of lines that maximise a concave criterion under linear limits, with a certificate.

Every limit (torque, sway, rate) is linear in the powers of the lines, so the powers that are allowed are a polytope.
The maximum is found with a logarithmic barrier and Newton steps (Boyd & Vandenberghe 2004, Convex Optimization, ch.
11). The certificate does not rely on that: by concavity no allowed spectrum is better than the one found by more than
the largest directional derivative towards any allowed one (the general equivalence theorem, Kiefer & Wolfowitz 1960,
Whittle 1973), and that is a linear program, which SciPy's HiGHS solves. For D and a single limit it says that the
directional derivative towards any single line is at most the number of parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import linprog

from mcstudy.errors import InputError
from mcstudy.stimulus_design.criteria import Criterion

GAP = 1e-3
"""Gap of the certificate that is enough: half of it is the largest relative gain in the mean SD that is left."""

FALL = 10.0
"""Factor between barrier weights."""

STEPS = 60
"""Most Newton steps at one barrier weight."""

INWARD = 0.95
"""Largest part of the way to the nearest limit that a step takes."""


@dataclass(frozen=True, eq=False)
class Allowed:
    """Powers x (K,) with ``cost`` x <= 1 and x >= ``least``.

    Attributes
    ----------
    cost: share of each limit that one unit of power of a line uses, (L, K), not negative.
    least: smallest powers, (K,).
    names: of the limits, L.
    """

    cost: np.ndarray
    least: np.ndarray
    names: tuple[str, ...]

    def used(self, x: np.ndarray) -> np.ndarray:
        """Share of every limit that powers ``x`` use, (L,)."""
        return np.asarray(self.cost @ x)

    def check(self) -> None:
        """Raise `InputError`, one line that names the limit, if even the smallest powers break one.

        Every cost is at least zero, so nothing is allowed if the smallest powers are not.
        """
        used = self.used(self.least)
        worst = int(used.argmax())
        if used[worst] >= 1:
            raise InputError(
                f"{self.names[worst]}: what is kept of the sequence alone is {np.sqrt(used[worst]):.3g} times this "
                "limit; raise the limit or lower design.keep"
            )


@dataclass(frozen=True, eq=False)
class Optimum:
    """Optimal powers.

    Attributes
    ----------
    x: powers, (K,). value: the criterion there. gap: no allowed powers are better by more (from the linear program).
    steps: Newton steps.
    """

    x: np.ndarray
    value: float
    gap: float
    steps: int


def maximum(criterion: Criterion, allowed: Allowed, gap: float = GAP) -> Optimum:
    """The allowed powers with the largest criterion.

    Raises
    ------
    InputError
        No powers are allowed, or the lines do not determine the parameters.
    """
    allowed.check()
    unit = 1 / allowed.cost.max(axis=0)  # power with which a line alone uses up its strictest limit
    scaled = Criterion(criterion.information * unit[:, None, None], criterion.columns)
    inside = Allowed(allowed.cost * unit, allowed.least / unit, allowed.names)
    K, L = inside.cost.shape[1], len(inside.names)
    room = 1 - inside.used(inside.least)
    x = inside.least + 0.5 * (room / inside.cost.sum(axis=1)).min()
    if not np.isfinite(scaled.value(x)):
        raise InputError(f"design: {K} lines do not determine the {scaled.information.shape[-1]} parameters")
    steps, mu = 0, 0.1
    while True:
        x, n = _centred(scaled, inside, x, mu)
        steps += n
        if mu * (K + L) < gap:
            break
        mu /= FALL
    left = shortfall(scaled, inside, x)
    return Optimum(x * unit, scaled.value(x), left, steps)


def shortfall(criterion: Criterion, allowed: Allowed, x: np.ndarray) -> float:
    """Upper bound on what the criterion gains from ``x`` to the best allowed powers: the certificate."""
    gradient = criterion.slopes(x).gradient
    best = linprog(
        -gradient, A_ub=allowed.cost, b_ub=np.ones(len(allowed.names)), bounds=[(v, None) for v in allowed.least]
    )
    if not best.success:  # a bounded and feasible linear program always has a solution
        raise InputError(f"design: the linear program of the certificate failed ({best.message})")
    return float(-best.fun - gradient @ x)


def _centred(criterion: Criterion, allowed: Allowed, x: np.ndarray, mu: float) -> tuple[np.ndarray, int]:
    """The maximum of the criterion plus ``mu`` times the logarithms of all slacks, and the Newton steps to it."""

    def objective(at: np.ndarray) -> float:
        slack = np.concatenate([1 - allowed.used(at), at - allowed.least])
        return criterion.value(at) + mu * float(np.log(slack).sum()) if (slack > 0).all() else -np.inf

    now = objective(x)
    for step in range(1, STEPS + 1):
        _, gradient, hessian = criterion.slopes(x)
        room, above = 1 - allowed.used(x), x - allowed.least
        gradient = gradient - mu * (allowed.cost.T @ (1 / room)) + mu / above
        hessian = hessian - mu * (allowed.cost.T / room**2) @ allowed.cost - np.diag(mu / above**2)
        move = np.linalg.solve(-hessian, gradient)
        gain = float(gradient @ move)
        far = min(1.0, *(INWARD / r for r in (-move / above).tolist() + (allowed.used(move) / room).tolist() if r > 0))
        while (then := objective(x + far * move)) < now + 1e-4 * far * gain and far > 1e-10:
            far /= 2
        if far <= 1e-10:
            return x, step
        x, now = x + far * move, then
        if gain < mu:
            return x, step
    return x, STEPS


def grouped(harmonic: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Which odd lines (K,) stay empty as detection lines: one at random of every 1 / ``share`` consecutive ones.

    The random harmonic grid with one line left out per group (Schoukens, Pintelon, Dobrowiecki & Rolain 2005). The
    first line of a cycle is never left out.
    """
    empty = np.zeros(harmonic.size, dtype=bool)
    if share > 0:
        edges = range(0, harmonic.size + 1, max(round(1 / share), 2))
        for first, last in pairwise(edges):
            empty[int(rng.integers(max(first, 1), last))] = True
    return empty
