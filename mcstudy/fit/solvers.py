"""Solvers by name; each maps (problem, starts, options) to `Fits`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.fit.lm import lm, lm_many
from mcstudy.fit.problem import Fits, Problem
from mcstudy.fit.scipy_trf import trf
from mcstudy.fit.scipy_trust_constr import trust_constr
from mcstudy.fit.status import Status


@dataclass(frozen=True)
class Options:
    """Stop rules. ``tolerance``: predicted relative decrease of the cost below which a fit has converged."""

    tolerance: float = 1e-12
    max_iterations: int = 1000


SOLVERS: dict[str, Callable[[Problem, np.ndarray, float, int], Fits]] = {
    "lm": lm,
    "trf": trf,
    "trust-constr": trust_constr,
}


def fit(problem: Problem, starts: np.ndarray, solver: str = "lm", options: Options | None = None) -> Fits:
    """Fit ``problem`` from every start.

    Parameters
    ----------
    problem: see `Problem`.
    starts: (S, P), inside the model's bounds.
    solver: a key of `SOLVERS`.
    """
    options = options or Options()
    starts = np.ascontiguousarray(starts, dtype=float)
    if not problem.finite:
        return Fits.failed(starts, Status.NON_FINITE_DATA)
    return SOLVERS[solver](problem, starts, options.tolerance, options.max_iterations)


def fit_many(
    problems: Sequence[Problem], starts: np.ndarray, solver: str = "lm", options: Options | None = None
) -> list[Fits]:
    """Fit R problems that share model and frequencies, each from its own starts (R, S, P).

    The same results as `fit` problem by problem; the compiled solver keeps its lanes full across problems.
    """
    options = options or Options()
    starts = np.ascontiguousarray(starts, dtype=float)
    if solver != "lm":
        return [fit(p, x0, solver, options) for p, x0 in zip(problems, starts, strict=True)]
    finite = [r for r, p in enumerate(problems) if p.finite]
    fits = [Fits.failed(x0, Status.NON_FINITE_DATA) for x0 in starts]
    if finite:
        done = lm_many([problems[r] for r in finite], starts[finite], options.tolerance, options.max_iterations)
        for r, one in zip(finite, done, strict=True):
            fits[r] = one
    return fits
