"""The emulated solver of the paper: it finds published minima, and the same minima as Levenberg-Marquardt."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from fit_problems import example
from mcstudy_goodworth2018.solver import Settings
from mcstudy_goodworth2018.solver.barrier_step import direct_step, logarithm, trust_region_step
from mcstudy_goodworth2018.solver.emulation import REACH, choices
from mcstudy_goodworth2018.solver.kernel import advance, machines, reset

from mcstudy.fitting.arguments import Bounds
from mcstudy.fitting.problem import Fits, Problem
from mcstudy.fitting.solvers import Options, fit, fit_many, fit_queue
from mcstudy.fitting.starts import uniform
from mcstudy.fitting.status import Status
from mcstudy.stance.body import two_segment
from mcstudy.stance.feedback import Parameter, Term
from mcstudy.study.design import FitSection, Group, Study
from mcstudy.study.kernels import parts_of

PAPER = Options(1e-16, 1000, Settings(step_tolerance=1e-16))
"""The paper's "resolution of 1e-16", taken as both tolerances."""


def interior_point(problem: Problem, starts: np.ndarray, options: Options) -> Fits:
    return fit(problem, starts, "interior_point", options)


PATIENT = Options(1e-8, 10_000, Settings(units="bounds", max_evaluations=100_000))


def rosenbrock(x: np.ndarray) -> float:
    return float(100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2)


def wood(x: np.ndarray) -> float:
    a = 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2 + 90 * (x[3] - x[2] ** 2) ** 2 + (1 - x[2]) ** 2
    return float(a + 10.1 * ((x[1] - 1) ** 2 + (x[3] - 1) ** 2) + 19.8 * (x[1] - 1) * (x[3] - 1))


def hs25(x: np.ndarray) -> float:
    i = np.arange(1, 100) / 100
    u = 25 + (-50 * np.log(i)) ** (2 / 3)
    return float(np.sum((-i + np.exp(-1 / x[0] * (u - x[1]) ** x[2])) ** 2))


def hs110(x: np.ndarray) -> float:
    return float(np.sum(np.log(x - 2) ** 2 + np.log(10 - x) ** 2) - np.prod(x) ** 0.2)


INF = math.inf
PUBLISHED: dict[str, tuple[Callable[[np.ndarray], float], list[float], list[float], list[float], float]] = {
    "HS1": (rosenbrock, [-2, 1], [-INF, -1.5], [INF, INF], 0.0),
    "HS2": (rosenbrock, [-2, 1.6], [-INF, 1.5], [INF, INF], 0.0504261879),
    "HS3": (lambda x: float(x[1] + 1e-5 * (x[1] - x[0]) ** 2), [10, 1], [-INF, 0], [INF, INF], 0.0),
    "HS4": (lambda x: float((x[0] + 1) ** 3 / 3 + x[1]), [1.125, 0.125], [1, 0], [INF, INF], 8 / 3),
    "HS5": (
        lambda x: float(np.sin(x[0] + x[1]) + (x[0] - x[1]) ** 2 - 1.5 * x[0] + 2.5 * x[1] + 1),
        [0, 0],
        [-1.5, -3],
        [4, 3],
        -math.sqrt(3) / 2 - math.pi / 3,
    ),
    "HS25": (hs25, [100, 12.5, 3], [0.1, 0, 0], [100, 25.6, 5], 0.0),
    "HS38": (wood, [-3, -1, -3, -1], [-10] * 4, [10] * 4, 0.0),
    "HS45": (lambda x: float(2 - np.prod(x) / 120), [2] * 5, [0] * 5, [1, 2, 3, 4, 5], 1.0),
    "HS110": (hs110, [9] * 10, [2.001] * 10, [9.999] * 10, -45.77846971),
}
"""Bounded problems of Hock & Schittkowski (1981): objective, start, lower and upper bounds, published minimum."""


def minimised(name: str, start: list[float] | None = None) -> tuple[float, np.ndarray, Status, int]:
    """Lowest cost found by the compiled solver driven value by value: cost, x, status, evaluations."""
    objective, given, lower, upper, _ = PUBLISHED[name]
    options = choices(Options(1e-6, 1000))  # fmincon's defaults
    bounds, m = Bounds(np.array(lower, dtype=float), np.array(upper, dtype=float)), machines(1, len(given))
    reset(m, 0, np.array(start or given, dtype=float), bounds, options)
    outcome = 0
    while outcome == 0:
        assert (m.trial[0] >= bounds.lower).all()
        assert (m.trial[0] <= bounds.upper).all()
        outcome = advance(m, 0, objective(m.trial[0]), bounds, options)
    return float(m.value[0]), m.x[0].copy(), Status(outcome), int(m.evaluations[0])


@pytest.mark.parametrize("name", [name for name in PUBLISHED if name not in ("HS2", "HS25")])
def test_the_published_minimum_of_a_bounded_problem_is_found(name: str) -> None:
    cost, _, status, evaluations = minimised(name)
    assert status in (Status.CONVERGED, Status.STALLED)
    assert cost == pytest.approx(PUBLISHED[name][-1], abs=2e-5)
    assert evaluations < 3000


def test_where_a_problem_has_two_minima_it_ends_in_one_of_them() -> None:
    cost, x, _, _ = minimised("HS2")
    assert min(abs(cost - PUBLISHED["HS2"][-1]), abs(cost - 4.941229318)) < 1e-4  # (1.224371, 1.5), (-1.221028, 1.5)
    assert x[1] == pytest.approx(1.5, abs=1e-4)
    cost, _, _, _ = minimised("HS25", [60, 20, 2])
    assert 0 <= cost < 32.835  # the cost at the published start, where the function is flat


def test_a_start_on_a_bound_is_moved_inside() -> None:
    cost, x, _, _ = minimised("HS45", [0, 2, 3, 0, 5])
    assert cost == pytest.approx(1.0, abs=2e-5)
    np.testing.assert_allclose(x, [1, 2, 3, 4, 5], atol=1e-4)


@pytest.mark.parametrize("kind", ["paper", "ml", "rich"])
def test_where_it_converges_the_minimum_is_that_of_levenberg_marquardt(kind: str) -> None:
    """From where it converged Levenberg-Marquardt gains next to nothing, and both find the same lowest cost."""
    problem = example(kind, seed=1)
    starts = uniform(problem.model, np.random.default_rng(0), 40)
    own, other = interior_point(problem, starts, PATIENT), fit(problem, starts)
    done = own.status == Status.CONVERGED
    assert done.sum() >= 8
    polished = fit(problem, own.estimate[done])
    assert (polished.cost <= own.cost[done]).all()
    assert np.median(own.cost[done] / polished.cost) < 1 + 1e-3  # forward differences limit it
    assert own.cost.min() == pytest.approx(other.cost.min(), rel=1e-4)


def test_cost_and_estimate_belong_together_and_lie_inside_the_bounds() -> None:
    problem = example("paper", noise=0.4)
    model = problem.model
    fits = interior_point(problem, uniform(model, np.random.default_rng(2), 11), PAPER)
    for x, cost in zip(fits.estimate, fits.cost, strict=True):
        assert cost == pytest.approx(problem.cost(x), rel=1e-12)
    assert ((fits.estimate > model.lower) & (fits.estimate < model.upper)).all()
    near = REACH * (model.upper - model.lower)
    np.testing.assert_array_equal(fits.at_bound == 1, fits.estimate >= model.upper - near)


@pytest.mark.parametrize("options", [PAPER, PAPER._replace(settings=Settings(units="bounds", hessian="scaled"))])
def test_a_fit_does_not_depend_on_its_neighbours_in_the_lanes(options: Options) -> None:
    problems = [example("paper", seed) for seed in range(2)]
    starts = uniform(problems[0].model, np.random.default_rng(1), 13)
    which = np.arange(13) % 2
    together = fit_queue(problems, which, starts, "interior_point", options)
    for k in range(13):
        alone = interior_point(problems[which[k]], starts[k][None], options)
        assert alone.estimate.tobytes() == together.estimate[k].tobytes()
        assert (alone.cost[0], alone.status[0], alone.iterations[0]) == (
            together.cost[k],
            together.status[k],
            together.iterations[k],
        )


def test_a_fit_with_fewer_steps_is_the_beginning_of_one_with_more() -> None:
    """What `mcstudy replay` relies on. The merit falls at every step, the cost at most of them."""
    problem = example("paper")
    start = uniform(problem.model, np.random.default_rng(3), 1)
    costs = [interior_point(problem, start, PAPER._replace(max_iterations=k)) for k in range(1, 60)]
    assert [int(f.iterations[0]) for f in costs] == list(range(1, 60))
    assert all(f.status[0] == Status.ITERATION_LIMIT for f in costs)
    path = np.array([f.cost[0] for f in costs])
    assert (np.diff(path) < 0).mean() > 0.7
    assert path[-1] < 0.5 * path[0]


def test_every_end_is_told() -> None:
    problem = example("paper")
    starts = uniform(problem.model, np.random.default_rng(0), 9)
    few = interior_point(problem, starts, Options(1e-16, 1000, Settings(max_evaluations=100)))
    assert (few.status == Status.ITERATION_LIMIT).all()
    assert (few.iterations <= 8).all()  # twelve differences and a step each
    coarse = interior_point(problem, starts, Options(1e-16, 1000, Settings(step_tolerance=0.1)))
    assert (coarse.status == Status.STALLED).any()
    loose = interior_point(problem, starts, Options(1e-2, 1000, Settings(units="bounds")))
    assert (loose.status == Status.CONVERGED).all()
    integral = two_segment().with_terms(
        (Parameter("Ki", "N m/(rad s)", 10.0, 0.0, 20.0),), (Term("ankle", "theta1", ("Ki",), -1),)
    )
    f = np.array([0.0, 0.1, 1.0])
    endless = Problem(f, np.ones((3, 2), dtype=complex), np.tile(np.eye(2, dtype=complex), (3, 1, 1)), integral)
    bad = interior_point(endless, uniform(integral, np.random.default_rng(0), 3), PAPER)
    assert (bad.status == Status.NON_FINITE_MODEL).all()


def test_it_is_a_solver_like_the_others() -> None:
    problems = [example("paper", seed) for seed in range(3)]
    problems[1].y[0, 0] = np.inf
    starts = np.stack([uniform(p.model, np.random.default_rng(k), 4) for k, p in enumerate(problems)])
    many = fit_many(problems, starts, "interior_point", PAPER)
    assert (many[1].status == Status.NON_FINITE_DATA).all()
    for k in (0, 2):
        one = fit(problems[k], starts[k], "interior_point", PAPER)
        np.testing.assert_array_equal(many[k].estimate, one.estimate)
    assert fit(problems[0], np.empty((0, 12)), "interior_point").cost.shape == (0,)


def test_the_logarithm_is_right_to_rounding() -> None:
    x = np.concatenate([10.0 ** np.random.default_rng(0).uniform(-300, 300, 2000), [1.0, 0.999999, 1.000001, 5e-324]])
    own = np.array([logarithm(v) for v in x])
    np.testing.assert_allclose(own, np.log(x), rtol=4e-16, atol=1e-22)
    assert logarithm(0.0) == -math.inf
    assert logarithm(math.inf) == math.inf


def test_steps_solve_the_system_and_stop_at_the_trust_region() -> None:
    rng = np.random.default_rng(4)
    root = rng.standard_normal((6, 6))
    matrix, slope, scale = root @ root.T + np.eye(6), rng.standard_normal(6), rng.uniform(0.5, 2, 6)
    exact, direct, inner, short = np.linalg.solve(matrix, -slope), np.empty(6), np.empty(6), np.empty(6)
    assert direct_step(matrix, slope, direct)
    np.testing.assert_allclose(direct, exact, rtol=1e-10)
    trust_region_step(matrix, slope, scale, 1e6, inner)
    np.testing.assert_allclose(inner, exact, rtol=1e-6)
    radius = 0.1 * float(np.linalg.norm(scale * exact))
    trust_region_step(matrix, slope, scale, radius, short)
    assert np.linalg.norm(scale * short) == pytest.approx(radius, rel=1e-9)
    assert slope @ short + 0.5 * short @ matrix @ short < 0
    assert not direct_step(-matrix, slope, direct)


def test_who_uses_another_solver_never_waits_for_it() -> None:
    group = Group(realizations=1, starts=1, fmax=[1.2], amplitude=[5.0])
    assert "interior_point" not in parts_of([group])
    assert "interior_point" in parts_of([group.model_copy(update={"fit": FitSection(solver="interior_point")})])


def test_settings_of_a_solver_that_is_not_used_leave_the_fingerprint_alone() -> None:
    def study(**fit: object) -> Study:
        return Study("a", seed=1).group("g", realizations=1, starts=1, fmax=[1.2], amplitude=[5.0], fit=fit)

    assert study().fingerprint == study(interior_point={"units": "bounds"}).fingerprint
    emulated = study(solver="interior_point", interior_point={"units": "bounds"})
    assert emulated.fingerprint != study(solver="interior_point").fingerprint
    assert Study.from_json(emulated.to_json()).fingerprint == emulated.fingerprint
    assert emulated.groups["g"].fit.options().settings == Settings(units="bounds")
