"""The linearised start solves the linear problem it states, and one start does the work of many."""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from fit_problems import F, example, measured, rich_model
from scipy.optimize import lsq_linear

from mcstudy.effect_library import library
from mcstudy.errors import ModelError
from mcstudy.fitting.equation_error import bounded_step, normal_equations
from mcstudy.fitting.linearised import LinearModel, linearised, linearised_many
from mcstudy.fitting.problem import Problem, ml_cost, paper_cost
from mcstudy.fitting.solvers import fit, fit_many
from mcstudy.fitting.starts import uniform
from mcstudy.spectra.bands import published
from mcstudy.spectra.estimate import SpectralExperiment
from mcstudy.stance.body import WEIGHTS, one_segment, two_segment
from mcstudy.stance.feedback import Filter, Model, Monomial, Parameter, Term
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf, system
from mcstudy.stance.stimulus import Prts


def filtered_model() -> Model:
    """Fixed filters inside the loop and on the angles, a gain on the stimulus, a delayed term without a gain."""
    lag = Filter("lag", (Monomial(1.0, 0),), (Monomial(1.0, 0), Monomial(0.03, 1)))
    model = two_segment().with_terms(
        parameters=(Parameter("drive", "1", 0.1, -0.5, 0.5, "stimulus felt at the hip"),),
        terms=(
            Term("hip", "stimulus", ("drive",), filters=("lag",)),
            Term("ankle", "theta2s", order=1, delay="Td1", coefficient=20.0),
        ),
        filters=(lag,),
        name="filtered",
    )
    return Model(model.name, model.parameters, model.terms, model.filters, output_filters=("lag", None))


def tilted(kind: str) -> Callable[[], Model]:
    return partial(two_segment, stimulus=kind)


def problem_of(kind: str) -> Problem:
    if kind == "filtered":
        model = filtered_model()
        return paper_cost(model, F, measured(model, np.random.default_rng(2)))
    return example(kind)


def equations(problem: Problem, x: np.ndarray, mix: float) -> tuple[float, np.ndarray, np.ndarray]:
    linear = LinearModel.of(problem.model, problem.f)
    gram, gradient = np.empty((x.size, x.size)), np.empty(x.size)
    data, weight = problem.y / linear.output, problem.weight * linear.output[:, None, :]
    return normal_equations(linear.table, x, mix, data, weight, gram, gradient), gradient, gram


@pytest.mark.parametrize("kind", ["paper", "ml", "one_segment", "filtered", "tilt"])
def test_regressing_on_the_model_is_the_gauss_newton_step_of_the_cost(kind: str) -> None:
    problem = problem_of(kind)
    for x in uniform(problem.model, np.random.default_rng(5), 5):
        cost, gradient, gram = equations(problem, x, 0.0)
        r, J = problem.residual(x), problem.jacobian(x)
        size = np.linalg.norm(J, axis=0)
        assert cost == pytest.approx(r @ r, rel=1e-10)
        np.testing.assert_allclose(gradient, J.T @ r, atol=1e-10 * float(size.max() * np.linalg.norm(r)))
        np.testing.assert_allclose(gram, J.T @ J, atol=1e-10 * float(size.max() ** 2))


@pytest.mark.parametrize("kind", ["ml", "tilt"])
@pytest.mark.parametrize("mix", [0.5, 1.0])
def test_the_equation_error_is_linear_in_the_gains(mix: float, kind: str) -> None:
    problem = problem_of(kind)
    model = problem.model
    gains = [k for k, name in enumerate(model.names) if name not in (*model.delays, *model.weights)]
    at, to = uniform(model, np.random.default_rng(6), 2)
    fixed = [k for k in range(at.size) if k not in gains]
    to[fixed] = at[fixed]
    s = 2j * np.pi * problem.f
    (A, _), (A_to, b_to) = system(model, at, s), system(model, to, s)
    z = mix * problem.y + (1 - mix) * frf(model, at, problem.f)
    error = np.linalg.solve(A, (b_to - np.einsum("nij,nj->ni", A_to, z))[..., None])[..., 0] + z - problem.y
    weighted = np.einsum("nij,nj->ni", problem.weight, error)
    cost, gradient, gram = equations(problem, at, mix)
    p = (to - at)[gains]
    predicted = cost + 2 * gradient[gains] @ p + p @ gram[np.ix_(gains, gains)] @ p
    assert predicted == pytest.approx(np.sum(np.abs(weighted) ** 2), rel=1e-9)


@pytest.mark.parametrize("seed", range(40))
def test_the_bounded_step_equals_scipys_bounded_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((20, 12)) * 10 ** rng.uniform(-3, 1, 12)
    b = rng.standard_normal(20)
    lower, upper = -rng.random(12) * (rng.random(12) > 0.2), rng.random(12) * (rng.random(12) > 0.2)
    lower[(lower == upper)] = -1.0
    p, side = np.empty(12), np.empty(12, dtype=np.int64)
    bounded_step(A.T @ A, -A.T @ b, lower, upper, p, side)
    reference = lsq_linear(A, b, (lower, upper), method="bvls", tol=1e-14)
    assert ((p >= lower - 1e-15) & (p <= upper + 1e-15)).all()
    assert np.sum((A @ p - b) ** 2) == pytest.approx(2 * reference.cost, rel=1e-10)
    assert ((side == 0) | (p == np.where(side < 0, lower, upper))).all()


def test_the_bounded_step_keeps_fixed_parameters_and_survives_a_singular_matrix() -> None:
    p, side = np.empty(3), np.empty(3, dtype=np.int64)
    gram = np.diag([1.0, 0.0, 1.0])
    bounded_step(gram, np.array([-0.5, 0.0, -3.0]), np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, 0.0]), p, side)
    assert p[2] == 0.0
    assert np.isfinite(p).all()


@pytest.mark.parametrize("kind", ["paper", "filtered", "tilt"])
def test_one_linear_step_with_the_true_delays_and_weights_finds_the_true_gains(kind: str) -> None:
    model = problem_of(kind).model
    problem = paper_cost(model, F, frf(model, model.truth, F))
    start = uniform(model, np.random.default_rng(7), 1)
    for name in (*model.delays, *model.weights):
        start[:, model.names.index(name)] = model.truth[model.names.index(name)]
    found = LinearModel.of(model, F).steps(problem, start, np.array([[1.0]]))
    np.testing.assert_allclose(found[0], model.truth, rtol=1e-6)


@pytest.mark.parametrize("make", [two_segment, one_segment, filtered_model, *map(tilted, WEIGHTS)])
def test_without_noise_one_start_finds_the_truth_to_rounding(make: Callable[[], Model]) -> None:
    model = make()
    problem = paper_cost(model, F, frf(model, model.truth, F))
    found = fit(problem, linearised(problem, np.random.default_rng(0), 1))
    np.testing.assert_allclose(found.estimate[0], model.truth, rtol=1e-9)


def test_with_noise_one_start_reaches_the_minimum_of_a_hundred() -> None:
    model, bands = two_segment(), published().below(1.2)
    experiment = SpectralExperiment(model, model.truth, Prts(), SensorNoise(), bands)
    R = 24
    rngs = [np.random.default_rng([5, r]) for r in range(R)]
    problems = [paper_cost(model, bands.f, experiment.frf(experiment.realization(rng), 3.0)[0]) for rng in rngs]
    lowest = [one.cost.min() for one in fit_many(problems, np.stack([uniform(model, r, 100) for r in rngs]))]
    fits = fit_many(problems, linearised_many(problems, rngs, 3))
    reached = np.array([one.cost <= low * (1 + 1e-6) for one, low in zip(fits, lowest, strict=True)])
    assert reached[:, 0].sum() >= R - 2
    assert reached.any(axis=1).sum() >= R - 1


@pytest.mark.parametrize("kind", ["paper", "ml", "one_segment", "filtered", "tilt"])
def test_starts_lie_between_the_bounds(kind: str) -> None:
    problem = problem_of(kind)
    starts = linearised(problem, np.random.default_rng(1), 3)
    assert starts.shape == (3, len(problem.model.parameters))
    assert (starts >= problem.model.lower).all()
    assert (starts <= problem.model.upper).all()


def test_the_first_start_is_deterministic_and_a_longer_draw_begins_with_a_shorter_one() -> None:
    problem = example("paper")
    one = linearised(problem, np.random.default_rng(1), 1)
    three = linearised(problem, np.random.default_rng(2), 3)
    five = linearised(problem, np.random.default_rng(2), 5)
    assert one.tobytes() == five[:1].tobytes()
    assert three.tobytes() == five[:3].tobytes()
    assert linearised(problem, np.random.default_rng(1), 0).shape == (0, 12)


def test_starts_do_not_depend_on_the_other_problems_of_a_call() -> None:
    problems = [example("paper", seed) for seed in range(3)]
    together = linearised_many(problems, [np.random.default_rng(k) for k in range(3)], 2)
    alone = np.stack([linearised(p, np.random.default_rng(k), 2) for k, p in enumerate(problems)])
    assert together.tobytes() == alone.tobytes()


@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.0])
def test_unusable_data_leave_points_between_the_bounds(bad: float) -> None:
    model = two_segment()
    data = frf(model, model.truth, F)
    data[3, 0] = bad
    starts = linearised(paper_cost(model, F, data), np.random.default_rng(0), 2)
    assert ((starts >= model.lower) & (starts <= model.upper)).all()


def test_unusable_covariances_leave_points_between_the_bounds() -> None:
    model = two_segment()
    problem = ml_cost(model, F, frf(model, model.truth, F), np.full((F.size, 2, 2), np.nan))
    starts = linearised(problem, np.random.default_rng(0), 2)
    assert ((starts >= model.lower) & (starts <= model.upper)).all()


def test_models_that_are_not_linear_in_their_gains_are_refused_by_name() -> None:
    product = two_segment().with_terms(terms=(Term("hip", "theta1", ("K22", "K12")),))
    with pytest.raises(ModelError, match=r"product K22 \* K12"):
        LinearModel.of(product, F)
    lag = Filter("lag", (Monomial(1.0, 0),), (Monomial(1.0, 0), Monomial(1.0, 1, (("Td1", 1),))))
    with pytest.raises(ModelError, match="filter lag holds Td1"):
        LinearModel.of(two_segment().with_terms(filters=(lag,)), F)
    with pytest.raises(ModelError, match=r"single delays, term hip <- stimulus holds Td2 \+ Tstim"):
        LinearModel.of(library.apply(two_segment(stimulus="visual_tilt"), "stimulus_delay"), F)
    both = two_segment().with_terms(terms=(Term("hip", "theta1", ("Td1",)),))
    with pytest.raises(ModelError, match="Td1 to be a gain or a delay"):
        LinearModel.of(both, F)
    with pytest.raises(ModelError, match="linearised starts need"):
        linearised(example("rich"), np.random.default_rng(0), 1)
    assert rich_model().names  # the model itself is fine
