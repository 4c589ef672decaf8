"""The emulation of the paper's solver beside SciPy's interior-point method: time, and success from the same starts.

SciPy's trust-constr is an implementation by others of the same published barrier method (Byrd, Hribar & Nocedal 1999).
It gets what the emulation gets: the cost alone, forward differences of the same step, a BFGS matrix, and as many steps
as 3,000 evaluations allow. It differs in that it never takes a direct step. The solver trust-constr of a study, with
exact derivatives, is the reference for the time, since it used to stand in for the paper's solver.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable

import numpy as np
from mcstudy_goodworth2018.solver import Settings
from scipy.optimize import BFGS, Bounds, minimize

from mcstudy.fitting.problem import Problem
from mcstudy.fitting.solvers import Options, fit
from mcstudy.fitting.starts import uniform
from pipelines.benchmarks.cases import AMPLITUDE, cases
from pipelines.benchmarks.measure import timed
from pipelines.benchmarks.report import Result, Sizes

SUCCESS = 1e-3
"""Relative excess over the lowest cost of 300 fits by Levenberg-Marquardt that counts as success."""

VARIANTS = {
    f"{units}_{hessian}": Settings(units=units, hessian=hessian, step_tolerance=1e-16)
    for units in ("own", "bounds")
    for hessian in ("identity", "scaled")
}
"""Units of the parameters and first BFGS matrix."""

FMAX = 1.2


def scipy_differences(problem: Problem, starts: np.ndarray, settings: Settings) -> np.ndarray:
    """Costs of SciPy's trust-constr with the same differences, matrix, units and evaluations."""
    model = problem.model
    lower, width = (np.zeros_like(model.lower), np.ones_like(model.lower))
    if settings.units == "bounds":
        lower, width = model.lower, model.upper - model.lower
    P = model.lower.size
    cost = np.empty(len(starts))

    def value(z: np.ndarray) -> float:
        return problem.cost(lower + width * z)

    def slope(z: np.ndarray) -> np.ndarray:
        at, step = value(z), settings.difference_step * np.maximum(np.abs(z), 1.0)
        step = np.where(lower + width * (z + step) > model.upper, -step, step)
        return np.array([(value(z + step[i] * np.eye(P)[i]) - at) / step[i] for i in range(P)])

    for i, start in enumerate(starts):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # quasi-Newton notices
            out = minimize(
                value,
                (start - lower) / width,
                jac=slope,
                hess=BFGS(init_scale="auto" if settings.hessian == "scaled" else 1.0, exception_strategy="damp_update"),
                method="trust-constr",
                bounds=Bounds((model.lower - lower) / width, (model.upper - lower) / width, keep_feasible=True),
                options={
                    "gtol": 1e-16,
                    "xtol": 1e-16,
                    "barrier_tol": 1e-16,
                    "maxiter": settings.max_evaluations // (P + 1),
                },
            )
        cost[i] = out.fun
    return cost


def run(sizes: Sizes) -> Result:
    """Alternating, on the cells of the paper's study at 1.2 Hz and 5 N m."""
    result = Result("paper_solver")
    rng = np.random.default_rng(2018)
    cells = [case for case in cases(sizes.realizations, max(2, sizes.slow_starts // 2)) if case.fmax == FMAX]
    fit(cells[0].problem, cells[0].starts, "interior_point")  # compiles
    seconds: dict[str, list[float]] = {}
    hits: dict[str, list[np.ndarray]] = {}
    for case in cells:
        lowest = fit(case.problem, uniform(case.problem.model, rng, 300)).cost.min()
        solvers: dict[str, Callable[[Problem, np.ndarray], np.ndarray]] = {}
        for name, settings in VARIANTS.items():
            options = Options(1e-16, 1000, settings)
            solvers[f"own {name}"] = lambda p, x, o=options: fit(p, x, "interior_point", o).cost
            solvers[f"scipy {name}"] = lambda p, x, s=settings: scipy_differences(p, x, s)
        solvers["trust-constr, exact"] = lambda p, x: fit(p, x, "trust-constr").cost
        for name, solve in solvers.items():
            starts = case.starts[:2] if name == "trust-constr, exact" else case.starts
            costs, took = timed(solve, case.problem, starts)
            seconds.setdefault(name, []).append(took / len(starts))
            hits.setdefault(name, []).append(costs <= lowest * (1 + SUCCESS))
    for name, parts in hits.items():
        hit = np.concatenate(parts)
        error = hit.std(ddof=1) / math.sqrt(hit.size) if hit.size > 1 else math.nan
        took = float(np.mean(seconds[name]))
        result.table.append({"solver": name, "success": hit.mean(), "±": error, "ms a start": 1e3 * took})
    slow = np.array(seconds["trust-constr, exact"])
    for name in VARIANTS:
        own, theirs = np.concatenate(hits[f"own {name}"]), np.concatenate(hits[f"scipy {name}"])
        more = own.astype(float) - theirs
        result.keys[f"paper_solver.speedup.{name}"] = float(np.median(slow / np.array(seconds[f"own {name}"])))
        result.keys[f"paper_solver.speedup_differences.{name}"] = float(
            np.median(np.array(seconds[f"scipy {name}"]) / np.array(seconds[f"own {name}"]))
        )
        result.keys[f"paper_solver.success_difference.{name}"] = float(more.mean())
        result.keys[f"paper_solver.success_difference_se.{name}"] = float(more.std(ddof=1) / math.sqrt(more.size))
    total = sum(len(case.starts) for case in cells)
    result.notes.append(
        f"{total} starts of {len(cells)} realizations at {FMAX:g} Hz and {AMPLITUDE:g} N m; success: within "
        f"{SUCCESS:g} of the lowest cost of 300 fits by lm; speedup: CPU time of the solver trust-constr over that of "
        "interior_point; speedup_differences: the same of SciPy's with forward differences"
    )
    return result
