"""The same fits by others: each function takes a problem and starts (S, P) and returns costs (S,).

Everyone gets the compiled residual and exact Jacobian of `benchmarks.model`, in units of the bounds' widths, and the
tolerance 1e-12 of the study in their own terms:

- trf, ls_trf, lmfit: ``ftol`` = 1e-12 (relative decrease of the cost), ``xtol`` = 1e-15 and no test of the gradient,
  so that no other test stops them first;
- fides: ``frtol`` = 1e-12, its absolute tests off; Gauss-Newton Hessian, full-space steps;
- trust-constr: it has no test of the decrease; ``gtol``, ``xtol`` and ``barrier_tol`` = 1e-12 of the cost at the
  start.

At most 1000 iterations.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from scipy.optimize import BFGS, Bounds, least_squares, minimize

from mcstudy.fitting.problem import Problem
from mcstudy.fitting.solvers import Options, fit
from pipelines.benchmarks.model import Compiled

TOLERANCE = 1e-12
XTOL = 1e-15
LOOSE = 1e-9
MOST = 1000

Peer = Callable[[Problem, np.ndarray], np.ndarray]


def _unit(compiled: Compiled, starts: np.ndarray) -> np.ndarray:
    return np.clip((starts - compiled.lower) / compiled.width, 0.0, 1.0)


def own(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """This program's compiled solver."""
    return fit(problem, starts, "lm", Options(TOLERANCE, MOST)).cost


def own_trf(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """This program's reference solver: SciPy trf on the model in NumPy."""
    return fit(problem, starts, "trf", Options(TOLERANCE, MOST)).cost


def scipy_trf(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """`scipy.optimize.least_squares`, trust region reflective."""
    model = Compiled(problem)
    cost = np.empty(len(starts))
    for i, z in enumerate(_unit(model, starts)):
        out = least_squares(model.residual, z, model.jacobian, (0.0, 1.0), "trf", TOLERANCE, XTOL, None, max_nfev=MOST)
        cost[i] = 2 * out.cost
    return cost


def _trust_constr(problem: Problem, starts: np.ndarray, newton: bool, tolerance: float) -> np.ndarray:
    model = Compiled(problem)
    cost = np.empty(len(starts))
    for i, z in enumerate(_unit(model, starts)):
        scale = model.value(z) or 1.0
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            out = minimize(
                lambda z, scale=scale: model.value(z) / scale,
                np.clip(z, 1e-6, 1 - 1e-6),
                jac=lambda z, scale=scale: model.gradient(z) / scale,
                hess=(lambda z, scale=scale: model.hessian(z) / scale) if newton else BFGS(),
                method="trust-constr",
                bounds=Bounds(np.zeros(z.size), np.ones(z.size), keep_feasible=True),
                options={"gtol": tolerance, "xtol": tolerance, "barrier_tol": tolerance, "maxiter": MOST},
            )
        cost[i] = 2 * model.value(np.clip(out.x, 0.0, 1.0))
    return cost


def scipy_trust_constr(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """`scipy.optimize.minimize` trust-constr with the Gauss-Newton Hessian and the default barrier."""
    return _trust_constr(problem, starts, True, TOLERANCE)


def scipy_trust_constr_loose(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """The same with tolerances of 1e-9, since at 1e-12 it spends much of its time below what the others resolve."""
    return _trust_constr(problem, starts, True, LOOSE)


def scipy_trust_constr_bfgs(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """At 1e-12 with a BFGS Hessian, which is what the paper's fmincon uses unless told otherwise."""
    return _trust_constr(problem, starts, False, TOLERANCE)


def _pypesto(problem: Problem, starts: np.ndarray, optimizer: Any, **objective: str) -> np.ndarray:
    import pypesto

    model = Compiled(problem)
    given = {name: getattr(model, method) for name, method in objective.items()}
    names = list(problem.model.names)
    task = pypesto.Problem(
        objective=pypesto.Objective(**given),
        lb=np.zeros(len(names)),
        ub=np.ones(len(names)),
        x_names=names,
        x_guesses=_unit(model, starts),
    )
    result = pypesto.optimize.minimize(
        task,
        optimizer,
        n_starts=len(starts),
        engine=pypesto.engine.SingleCoreEngine(),
        progress_bar=False,
        options=pypesto.optimize.OptimizeOptions(allow_failed_starts=True),
    ).optimize_result
    by_id = {int(one["id"]): one["x"] for one in result.list}
    points = [by_id[i] for i in range(len(starts))]
    return np.array([np.nan if x is None else 2 * model.value(np.clip(x, 0.0, 1.0)) for x in points])


def pypesto_ls_trf(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """PyPESTO multi-start, SciPy trf, one core; tr_solver "exact" (its default, lsmr, is 40 times slower)."""
    import pypesto.optimize

    options = {"maxfun": MOST, "xtol": XTOL, "gtol": None, "tr_solver": "exact"}
    optimizer = pypesto.optimize.ScipyOptimizer(method="ls_trf", tol=TOLERANCE, options=options)
    return _pypesto(problem, starts, optimizer, res="residual", sres="jacobian")


def pypesto_fides(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """PyPESTO multi-start, fides, one core."""
    import pypesto.optimize

    logging.getLogger("fides").setLevel(logging.ERROR)
    options = {"frtol": TOLERANCE, "fatol": 0.0, "gatol": 0.0, "grtol": 0.0, "xtol": XTOL, "maxiter": MOST}
    optimizer = pypesto.optimize.FidesOptimizer(
        hessian_update=None, options={**options, "subspace_solver": "full"}, verbose=logging.ERROR
    )
    return _pypesto(problem, starts, optimizer, fun="value", grad="gradient", hess="hessian")


def lmfit(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """Lmfit, ``leastsq`` (MINPACK) with bounds by transformation of the parameters, exact Jacobian."""
    import lmfit as package

    model, names = Compiled(problem), problem.model.names

    def vector(parameters: Any) -> np.ndarray:
        values = parameters.valuesdict()
        return np.fromiter((values[n] for n in names), dtype=float, count=len(names))

    minimizer = None
    cost = np.empty(len(starts))
    for i, z in enumerate(_unit(model, starts)):
        parameters = package.Parameters()
        for name, value in zip(names, np.clip(z, 1e-9, 1 - 1e-9), strict=True):
            parameters.add(name, value=value, min=0.0, max=1.0)
        minimizer = package.Minimizer(lambda p: model.residual(vector(p)), parameters, calc_covar=False)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            out = minimizer.leastsq(
                Dfun=lambda p: model.jacobian(vector(p)), ftol=TOLERANCE, xtol=XTOL, gtol=0.0, max_nfev=MOST
            )
        cost[i] = 2 * model.value(np.clip(vector(out.params), 0.0, 1.0))
    return cost


PEERS: dict[str, Peer] = {
    "scipy_trf": scipy_trf,
    "scipy_trf_numpy_model": own_trf,
    "scipy_trust_constr": scipy_trust_constr,
    "scipy_trust_constr_loose": scipy_trust_constr_loose,
    "scipy_trust_constr_bfgs": scipy_trust_constr_bfgs,
    "pypesto_ls_trf": pypesto_ls_trf,
    "pypesto_fides": pypesto_fides,
    "lmfit": lmfit,
}


@cache
def missing() -> tuple[str, ...]:
    """Peers whose packages are not installed."""
    needs = {"pypesto_ls_trf": ("pypesto",), "pypesto_fides": ("pypesto", "fides"), "lmfit": ("lmfit",)}
    absent = []
    for peer, packages in needs.items():
        for package in packages:
            try:
                __import__(package)
            except ImportError:
                absent.append(peer)
                break
    return tuple(absent)
