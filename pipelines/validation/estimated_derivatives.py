"""How many starts does a fit need when a solver of SciPy estimates derivatives? (Slow reference for `interior_point`.)

Goodworth & Peterka 2018 (Fig. 3B) needed about 20 starts with fmincon, which by default estimates derivatives by
differences in the parameters' own units. This script compares, with the same noise and the same starts up to 1.2 Hz and
at 5 N m, the compiled Levenberg-Marquardt solver with exact derivatives and quasi-Newton solvers of SciPy with forward
differences (trust-constr is an interior-point method, like fmincon's). The differences are in the parameters' own units
or in units of the width of their bounds. `success` is the fraction of starts within 0.1 % of the lowest known cost;
`starts` is the number of starts needed for 95 % certainty at that fraction.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import Bounds, minimize

from mcstudy.analysis.search.convergence import fewest_independent_starts
from mcstudy.fitting.certainty import HIT_TOLERANCE
from mcstudy.fitting.problem import Problem, paper_cost
from mcstudy.fitting.solvers import fit
from mcstudy.fitting.starts import uniform
from mcstudy.spectra.bands import published
from mcstudy.spectra.estimate import SpectralExperiment
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.stimulus import Prts

FMAX, AMPLITUDE, EVALUATIONS = 1.2, 5.0, 3000
"""``EVALUATIONS``: default limit of fmincon's interior-point method."""

STEP = 2.0**-26
"""Step of the forward differences, relative for parameters above 1: the usual choice, also fmincon's."""

model, points = two_segment(), published().below(FMAX)
experiment = SpectralExperiment(model, model.truth, Prts(), SensorNoise(), points)
WIDTH = model.upper - model.lower


def exact(problem: Problem, starts: np.ndarray) -> np.ndarray:
    """Costs of the compiled solver."""
    return fit(problem, starts).cost


def estimated(method: str, scale: np.ndarray) -> Callable[[Problem, np.ndarray], np.ndarray]:
    """Costs of a SciPy solver with forward differences in parameters divided by ``scale``."""
    smallest = {"xtol": 1e-16, "gtol": 1e-16} if method == "trust-constr" else {"ftol": 1e-16}
    options = {"maxiter": EVALUATIONS // (model.truth.size + 1), **smallest}

    def costs(problem: Problem, starts: np.ndarray) -> np.ndarray:
        def cost(z: np.ndarray) -> np.ndarray:
            return np.mean(np.abs(frf(model, z * scale, problem.f) / problem.y - 1) ** 2, axis=(-2, -1))

        def cost_and_slope(z: np.ndarray) -> tuple[float, np.ndarray]:
            step = STEP * np.maximum(np.abs(z), 1.0)
            values = cost(np.vstack([z, z + np.diag(step)]))
            return float(values[0]), (values[1:] - values[0]) / step

        bounds = Bounds(model.lower / scale, model.upper / scale)
        return np.array(
            [
                minimize(cost_and_slope, x / scale, method=method, jac=True, bounds=bounds, options=options).fun
                for x in starts
            ]
        )

    return costs


SOLVERS = {
    "lm, exact derivatives": exact,
    "SLSQP, differences, units of the bounds": estimated("SLSQP", WIDTH),
    "SLSQP, differences, own units": estimated("SLSQP", np.ones_like(WIDTH)),
    "L-BFGS-B, differences, units of the bounds": estimated("L-BFGS-B", WIDTH),
    "L-BFGS-B, differences, own units": estimated("L-BFGS-B", np.ones_like(WIDTH)),
    "trust-constr, differences, units of the bounds": estimated("trust-constr", WIDTH),
    "trust-constr, differences, own units": estimated("trust-constr", np.ones_like(WIDTH)),
}


def arguments() -> argparse.ArgumentParser:
    """Few fits by default, since some solvers take more than a second each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--realizations", type=int, default=2, help="noise realizations (default 2; the page uses 6)")
    parser.add_argument("--starts", type=int, default=1, help="starts per realization (default 1; the page uses 10)")
    parser.add_argument("--seed", type=int, default=2018)
    return parser


if __name__ == "__main__":
    given = arguments().parse_args()
    hits = {name: np.zeros(given.realizations) for name in SOLVERS}
    seconds = dict.fromkeys(SOLVERS, 0.0)
    for r, rng in enumerate(np.random.default_rng(given.seed).spawn(given.realizations)):
        data, _ = experiment.frf(experiment.realization(rng), AMPLITUDE)
        problem = paper_cost(model, points.f, data)
        lowest = fit(problem, uniform(model, rng, 300)).cost.min()
        starts = uniform(model, rng, given.starts)
        for name, solver in SOLVERS.items():
            begun = time.process_time()
            cost = solver(problem, starts)
            seconds[name] += time.process_time() - begun
            hits[name][r] = np.mean(cost <= lowest * (1 + HIT_TOLERANCE))
    fits = given.realizations * given.starts
    print("{:<48}{:>14}{:>9}{:>12}".format("", "success ± MCSE", "starts", "ms per fit"))
    for name, share in hits.items():
        error = share.std(ddof=1) / np.sqrt(share.size) if share.size > 1 else float("nan")
        needed = float(fewest_independent_starts(share.mean(), 0.95)) if share.any() else float("nan")
        print(f"{name:<48}{share.mean():>7.2f} ± {error:.2f}{needed:>9.0f}{1e3 * seconds[name] / fits:>12.2f}")
