"""One-segment stance as the field's own Python package fits it: Padé delay and basin hopping.

balancepy (PostureControlLab, MIT licence) is not on the package index, so its published method is written here from
its equations: the independent-channel model with torque feedback through an integrator (Peterka et al. 2018, Front
Neurol 9:1045), the delay as a Padé approximation of order 5, SciPy's `basinhopping` with L-BFGS-B and numerical
gradients inside its bounds, and its cost sum |H - y| / |H|. Here it evaluates polynomials where the package calls
python-control, which is slower; hops and temperature are SciPy's defaults.
"""

from __future__ import annotations

from collections.abc import Callable
from math import factorial

import numpy as np
from numpy.polynomial import polynomial as poly
from scipy.optimize import basinhopping

from mcstudy.fitting.problem import paper_cost
from mcstudy.fitting.solvers import Options, fit
from mcstudy.stance.feedback import Model, Output, OutputTerm, Parameter, Term
from mcstudy.stance.response import frf
from pipelines.benchmarks.measure import timed
from pipelines.benchmarks.report import Result, Sizes
from pipelines.benchmarks.speedup import SAME, needed

Cost = Callable[[np.ndarray, np.ndarray], float]
"""From modelled and measured responses (N,) to a cost."""

ORDER = 5
"""Order of the Padé approximation."""


def delay_polynomial(delay: float, sign: int) -> np.ndarray:
    """Numerator (``sign`` -1) or denominator (+1) of the Padé approximation of exp(-delay s), ascending in s."""
    k = range(ORDER + 1)
    weight = [factorial(2 * ORDER - i) * factorial(ORDER) / factorial(2 * ORDER) for i in k]
    weight = [w / (factorial(i) * factorial(ORDER - i)) for i, w in zip(k, weight, strict=True)]
    return np.array([w * (sign * delay) ** i for i, w in zip(k, weight, strict=True)])


def response(values: dict[str, float], inertia: float, load: float, f: np.ndarray) -> np.ndarray:
    """Sway over tilt of the surface, (N,) complex, of one transfer function with the Padé delay.

    ``values``: Kp (N m/rad), Kd (N m s/rad), Td (s), Kt (rad/(N m s)), W.
    ``inertia``: kg m^2; ``load``: m g h, N m/rad.
    """
    above, below = delay_polynomial(values["Td"], -1), delay_polynomial(values["Td"], 1)
    control = np.array([values["Kp"], values["Kd"]])
    integrator = np.array([0.0, 1.0])
    loop = poly.polysub(poly.polymul(integrator, below), values["Kt"] * poly.polymul(control, above))
    active = poly.polymul(integrator, poly.polymul(control, above))
    whole = poly.polyadd(poly.polymul(np.array([-load, 0.0, inertia]), loop), active)
    s = 2j * np.pi * f
    return values["W"] * poly.polyval(s, active) / poly.polyval(s, whole)


def l1(modelled: np.ndarray, measured: np.ndarray) -> float:
    """The package's own cost, whose denominator is the model."""
    return float(np.sum(np.abs(modelled - measured) / np.abs(modelled)))


def relative_squares(modelled: np.ndarray, measured: np.ndarray) -> float:
    """Mean squared error relative to the data, as `mcstudy.fitting.problem.paper_cost` has it."""
    return float(np.mean(np.abs((modelled - measured) / measured) ** 2))


COSTS = {"own_cost": l1, "same_cost": relative_squares}

INERTIA, LOAD = 90.0, 755.0
"""kg m^2, and m g h, N m/rad, of the body; both are known to the fit."""

TRUTH = {"Kp": 1019.25, "Kd": 354.85, "Td": 0.151, "Kt": 1.38e-4, "W": 0.534}
BOUNDS = {
    "Kp": (1.2 * LOAD, 1.7 * LOAD),
    "Kd": (0.3 * LOAD, 0.77 * LOAD),
    "Td": (0.10, 0.35),
    "Kt": (0.0, 1e-3),
    "W": (0.01, 1.0),
}
"""Defaults and bounds of the package's model of 2018; N m/rad, N m s/rad, s, rad/(N m s), 1."""

POINTS = ((1, 1), (1, 2), (2, 2), (2, 3), (3, 4), (4, 5), (5, 7), (6, 9), (8, 11), (10, 13), (12, 16), (16, 20))
"""First and last odd line averaged in each point of a cycle of 20 s."""

ERROR = 0.1
"""Relative standard deviation of a measured response (complex)."""


def frequencies() -> np.ndarray:
    """Frequencies of the points, Hz, (12,)."""
    return np.array([np.mean([(2 * j - 1) / 20.0 for j in range(first, last + 1)]) for first, last in POINTS])


def model() -> Model:
    """The same loop with its exact delay; the torque, which the sway does not show, is an unknown without inertia."""
    parameters = [
        Parameter(name, unit, TRUTH[name], *BOUNDS[name])
        for name, unit in zip(TRUTH, ("N m/rad", "N m s/rad", "s", "rad/(N m s)", "1"), strict=True)
    ]
    control = [("Kp", 0), ("Kd", 1)]
    muscle = [
        term
        for gain, order in control
        for term in (
            Term("muscle", "sway", gain, order, "Td", noisy=True),
            Term("muscle", "stimulus", (gain, "W"), order, "Td", noisy=True),
            Term("muscle", "torque", (gain, "Kt"), order - 1, "Td", coefficient=-1.0),
        )
    ]
    body = [
        Term("body", "sway", order=2, coefficient=INERTIA),
        Term("body", "sway", coefficient=-LOAD),
        Term("body", "torque", coefficient=-1.0),
        Term("muscle", "torque"),
    ]
    return Model(
        "peterka2018",
        tuple(parameters),
        (*body, *muscle),
        rows=("muscle", "body"),
        angles=("sway", "torque"),
        stimulus_unit="rad",
        outputs=(Output("sway", (OutputTerm("sway"),)),),
    )


def hopped(cost: Cost, data: np.ndarray, start: np.ndarray, seed: int, hops: int = 100) -> np.ndarray:
    """Parameters (5,) that basin hopping ends with, from a ``start`` (5,) in units of the bounds' widths."""
    f, lower = frequencies(), np.array([low for low, _ in BOUNDS.values()])
    width = np.array([high - low for low, high in BOUNDS.values()])

    def value(z: np.ndarray) -> float:
        return cost(response(dict(zip(TRUTH, lower + width * z, strict=True)), INERTIA, LOAD, f), data)

    local = {"method": "L-BFGS-B", "bounds": [(0.0, 1.0)] * len(TRUTH)}
    found = basinhopping(value, start, niter=hops, minimizer_kwargs=local, rng=seed)
    return lower + width * np.clip(found.x, 0.0, 1.0)


def run(sizes: Sizes) -> Result:
    """Time until a fit has found the lowest minimum with 95 % probability, and costs at the exact model."""
    result = Result("basin_hopping")
    loop, f = model(), frequencies()
    truth = frf(loop, loop.truth, f)
    seconds: dict[str, list[float]] = {name: [] for name in ("mcstudy", *COSTS)}
    hit: dict[str, list[bool]] = {name: [] for name in seconds}
    excess = []
    for realization in range(sizes.realizations):
        rng = np.random.default_rng([2018, realization])
        error = rng.standard_normal((f.size, 2)) @ np.array([1.0, 1j]) * (ERROR / np.sqrt(2.0))
        problem = paper_cost(loop, f, truth * (1.0 + error)[:, None])
        starts = rng.uniform(loop.lower, loop.upper, (200, len(TRUTH)))
        unit = (starts - loop.lower) / (loop.upper - loop.lower)
        fit(problem, starts)  # compiles, and warms the caches
        fits, took = timed(fit, problem, starts, "lm", Options())
        lowest = fits.cost.min()
        seconds["mcstudy"].append(took / len(starts))
        hit["mcstudy"] += list(fits.cost <= lowest * (1 + SAME))
        for name, cost in COSTS.items():
            for k in range(sizes.hops):
                estimate, took = timed(hopped, cost, problem.y[:, 0], unit[k], k)
                seconds[name].append(took)
                if name == "same_cost":
                    above = problem.cost(estimate) / lowest - 1.0
                    excess.append(above)
                    hit[name].append(above <= SAME)
    median = {name: float(np.median(each)) for name, each in seconds.items()}
    own = median["mcstudy"] * needed(float(np.mean(hit["mcstudy"])))
    for name in COSTS:
        result.keys[f"basin_hopping.{name}.time_ratio"] = float(
            np.median(seconds[name]) / np.median(seconds["mcstudy"])
        )
    hops = needed(float(np.mean(hit["same_cost"])))
    result.keys["basin_hopping.time_to_certainty"] = median["same_cost"] * hops / own
    result.keys["basin_hopping.lowest_cost_excess"] = float(min(excess))
    result.keys["basin_hopping.highest_cost_excess"] = float(max(excess))
    result.keys["basin_hopping.hit_rate"] = float(np.mean(hit["same_cost"]))
    result.keys["basin_hopping.own_hit_rate"] = float(np.mean(hit["mcstudy"]))
    result.table = [{"fit": name, "ms": 1e3 * each} for name, each in median.items()]
    result.notes.append(
        f"{sizes.realizations} sets of {f.size} points, {sizes.hops} runs of basin hopping each; excess: its cost, "
        "evaluated with the exact delay, over the lowest of mcstudy; own_cost: sum |H - y| / |H|"
    )
    return result
