"""The solver of Goodworth & Peterka (2018), emulated: an interior-point method that estimates its derivatives.

The paper minimised with fmincon of MATLAB 2013a, algorithm "interior-point", "a resolution of 1e-16" (Methods). The
source of that program is not public. This module is written from its documentation and from the papers that it names:
Byrd, Hribar & Nocedal (1999), Byrd, Gilbert & Nocedal (2000), Waltz, Morales, Nocedal & Orban (2006).

Known from the documentation:

- a logarithmic barrier for the bounds, with parameter 0.1 at the start, and a dense BFGS matrix;
- derivatives by forward differences, with the step sqrt(eps) times the larger of 1 and the parameter in its own units,
  on the other side where a bound is in the way;
- first a direct step by factorisation, and a conjugate-gradient step in a trust region where that fails;
- starts on a bound are moved inside;
- 3,000 evaluations and 1,000 iterations at most; unless told otherwise, optimality tolerance 1e-6 relative to the
  gradient at the start, and step tolerance 1e-10 relative to the parameter. A tolerance below the machine's precision
  switches its test off.

Known from the papers: the primal-dual equations, 0.995 of the way to a bound at most, acceptance of a step at 1e-8 of
the predicted decrease, the units of the trust region and its factors 2 and 7 with their thresholds 0.3 and 0.9.

Guesses, of which the first four are settings of a study file:

- which tolerances the paper's "resolution" set (``tolerance``, ``step_tolerance``);
- parameters are not rescaled (``units``), and the first BFGS matrix is the identity (``hessian``);
- evaluations are counted one by one (``max_evaluations``);
- the scale of the optimality tolerance is at least 1;
- Powell's damping of BFGS;
- the barrier parameter falls when the barrier problem is solved to within the parameter itself: by 5, or by 100 after
  fewer than three iterations;
- three halvings come before a trust-region step; multipliers begin at mu / slack; a start on a bound is moved by 1 % of
  the distance of the bounds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcstudy.compiling.addresses import apart
from mcstudy.fitting.arguments import Bounds, Outcomes
from mcstudy.fitting.lanes import WIDTH
from mcstudy.fitting.plans import kept_plan, workspace
from mcstudy.fitting.problem import Fits, Problem, queued, small_problem
from mcstudy.fitting.solvers import Options
from mcstudy_goodworth2018.solver import Settings
from mcstudy_goodworth2018.solver.kernel import Choices, interior_point, machines

REACH = 0.0001
"""How near a bound its solutions end that lie on it, in widths of the bounds."""


def solve(problems: Sequence[Problem], which: np.ndarray, starts: np.ndarray, options: Options) -> Fits:
    """Fit M starts of R problems that share model and frequencies, in one queue that keeps the lanes full.

    Parameters
    ----------
    problems: R problems; their model and ``f`` must be the same.
    which: problem of each start, (M,) int.
    starts: (M, P).
    options: ``tolerance`` is the optimality tolerance, relative to the gradient at the start; ``max_iterations`` counts
        steps; for ``settings`` see `Settings`.
    """
    model = problems[0].model
    table = kept_plan(model, np.asarray(problems[0].f, dtype=float).tobytes())
    out = Outcomes.empty(*starts.shape)
    if len(starts):
        queue, room = queued(problems, which, starts), machines(WIDTH, starts.shape[1])
        bounds = Bounds(model.lower, model.upper)
        interior_point(table, workspace(table), room, queue, bounds, choices(options), out)
    return Fits.of(model, *out, reach=REACH)


def choices(options: Options) -> Choices:
    """What the compiled solver is handed; the defaults of `Settings` where there are none."""
    settings = options.settings or Settings()
    return Choices(
        tolerance=options.tolerance,
        max_iterations=options.max_iterations,
        own_units=settings.units == "own",
        scaled=settings.hessian == "scaled",
        difference_step=settings.difference_step,
        step_tolerance=settings.step_tolerance,
        max_evaluations=settings.max_evaluations,
        barrier=settings.barrier,
    )


def compile_kernel(rows: int) -> None:
    """Have the compiled code made for models of so many rows, by the smallest fit there is."""
    problem = small_problem(rows)
    with apart():
        solve([problem], np.zeros(1, dtype=np.int64), problem.model.truth[None], Options(max_iterations=1))
