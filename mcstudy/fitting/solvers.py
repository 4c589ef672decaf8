"""Solvers by name; each maps (problem, starts, options) to `Fits`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mcstudy.fitting.arguments import Options
from mcstudy.fitting.interior_point import interior_point_queue
from mcstudy.fitting.lm import lm_queue
from mcstudy.fitting.problem import Fits, Problem
from mcstudy.fitting.scipy_trf import trf
from mcstudy.fitting.scipy_trust_constr import trust_constr
from mcstudy.fitting.status import Status

QUEUES: dict[str, Callable[[Sequence[Problem], np.ndarray, np.ndarray, Options], Fits]] = {
    "lm": lambda problems, which, starts, o: lm_queue(problems, which, starts, o.tolerance, o.max_iterations),
    "interior_point": interior_point_queue,
}
"""Compiled solvers, which keep their lanes full across problems: (problems, problem of each start, starts, options)."""

SINGLE: dict[str, Callable[[Problem, np.ndarray, float, int], Fits]] = {"trf": trf, "trust-constr": trust_constr}
"""SciPy's solvers: (problem, starts, tolerance, iteration limit)."""

SOLVERS = (*QUEUES, *SINGLE)


def fit(problem: Problem, starts: np.ndarray, solver: str = "lm", options: Options | None = None) -> Fits:
    """Fit ``problem`` from every start.

    Parameters
    ----------
    problem: see `Problem`.
    starts: (S, P), inside the model's bounds.
    solver: one of `SOLVERS`.
    """
    return fit_queue([problem], np.zeros(len(starts), dtype=np.int64), starts, solver, options)


def fit_queue(
    problems: Sequence[Problem],
    which: np.ndarray,
    starts: np.ndarray,
    solver: str = "lm",
    options: Options | None = None,
) -> Fits:
    """Fit M starts (M, P), start m on problem ``which[m]`` of R problems that share model and frequencies.

    The same results as `fit` start by start; the compiled solvers keep their lanes full across problems.
    """
    options = options or Options()
    starts, which = np.ascontiguousarray(starts, dtype=float), np.asarray(which)
    out = Fits.failed(starts, Status.NON_FINITE_DATA)
    fine = np.flatnonzero(np.array([p.finite for p in problems])[which])
    if solver in QUEUES:
        if fine.size:
            used, index = np.unique(which[fine], return_inverse=True)
            out.put(fine, QUEUES[solver]([problems[r] for r in used], index, starts[fine], options))
        return out
    for r in np.unique(which[fine]):
        own = fine[which[fine] == r]
        out.put(own, SINGLE[solver](problems[r], starts[own], options.tolerance, options.max_iterations))
    return out


def fit_many(
    problems: Sequence[Problem], starts: np.ndarray, solver: str = "lm", options: Options | None = None
) -> list[Fits]:
    """Fit R problems that share model and frequencies, each from its own S starts (R, S, P), through `fit_queue`."""
    R, S, P = starts.shape
    fits = fit_queue(problems, np.repeat(np.arange(R), S), starts.reshape(R * S, P), solver, options)
    return [fits.take(slice(r * S, (r + 1) * S)) for r in range(R)]
