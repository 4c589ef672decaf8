"""The compiled bounded Levenberg-Marquardt solver, from `Problem`s to `Fits`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcstudy.compiling.addresses import apart
from mcstudy.fitting import kernel
from mcstudy.fitting.arguments import Bounds, LaneStates, Outcomes, StopRules
from mcstudy.fitting.lanes import WIDTH
from mcstudy.fitting.plans import kept_plan, plan, workspace
from mcstudy.fitting.problem import Fits, Problem, queued, small_problem
from mcstudy.fitting.solvers import Options


def solve(problems: Sequence[Problem], assignment: np.ndarray, starts: np.ndarray, options: Options) -> Fits:
    """Fit M starts of K problems that share model and frequencies, in one queue that keeps the lanes full.

    Parameters
    ----------
    problems: K problems; their model and ``f`` must be the same.
    assignment: problem of each start, (M,) int.
    starts: (M, P).
    options: ``tolerance`` and ``max_iterations``.
    """
    model = problems[0].model
    table = kept_plan(model, np.asarray(problems[0].f, dtype=float).tobytes())
    out = Outcomes.empty(*starts.shape)
    if len(starts):
        queue = queued(problems, assignment, starts)
        bounds, rules = Bounds(model.lower, model.upper), StopRules(options.tolerance, options.max_iterations)
        kernel.levenberg_marquardt(table, workspace(table), LaneStates.idle(WIDTH), queue, bounds, rules, out)
    return Fits.of(model, *out)


def compile_kernel(rows: int) -> None:
    """Have the compiled code made for models of so many rows, by the smallest fit there is."""
    problem = small_problem(rows)
    with apart():
        solve([problem], np.zeros(1, dtype=np.int64), problem.model.truth[None], Options(max_iterations=1))


def normal_equations(problem: Problem, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the kernel computes at parameter vectors ``theta`` (S, P): cost (S,), J^T r (S, P), J^T J (S, P, P)."""
    table, packed = plan(problem.model, problem.f), problem.packed
    work = workspace(table)
    slots = work.w.reshape(-1, WIDTH)
    S, P = theta.shape
    lower = np.tril_indices(P)
    cost, gradient, gram = np.empty(S), np.empty((S, P)), np.empty((S, P, P))
    slots[work.data : work.data + packed.size] = packed[:, None]
    for first in range(0, S, WIDTH):
        batch = theta[first : first + WIDTH]
        slots[work.trial : work.trial + P] = batch[-1][:, None]
        slots[work.trial : work.trial + P, : len(batch)] = batch.T
        kernel.evaluate(table, work)
        done, triangles = slice(first, first + len(batch)), slots[work.gram_trial :, : len(batch)]
        triangle = triangles[: P * (P + 1) // 2].T
        gram[done][:, lower[0], lower[1]] = triangle
        gram[done][:, lower[1], lower[0]] = triangle
        gradient[done] = triangles[P * (P + 1) // 2 :][:P].T
        cost[done] = triangles[(P + 1) * (P + 2) // 2 - 1]
    return cost, gradient, gram
