"""The compiled kernel computes what the closed form says, lane by lane and bit by bit."""

import numpy as np
import pytest
from fit_problems import example
from numba import njit

from mcstudy.fitting import kernel
from mcstudy.fitting.lanes import WIDTH, load, store
from mcstudy.fitting.lm import normal_equations
from mcstudy.fitting.solvers import Options, fit, fit_queue
from mcstudy.fitting.starts import uniform

KINDS = ["paper", "ml", "rich", "one_segment", "late_tilt"]


@pytest.mark.parametrize("kind", KINDS)
def test_cost_gradient_and_gram_matrix_equal_the_closed_form(kind: str) -> None:
    problem = example(kind)
    theta = uniform(problem.model, np.random.default_rng(5), 11)
    cost, gradient, gram = normal_equations(problem, theta)
    for k, x in enumerate(theta):
        r, J = problem.residual(x), problem.jacobian(x)
        size = np.linalg.norm(J, axis=0)
        assert cost[k] == pytest.approx(r @ r, rel=1e-12)
        np.testing.assert_allclose(gradient[k] / size, J.T @ r / size, rtol=1e-9, atol=1e-12 * np.linalg.norm(r))
        np.testing.assert_allclose(gram[k] / np.outer(size, size), J.T @ J / np.outer(size, size), atol=1e-11)


@njit
def _sine_and_cosine(w):  # type: ignore[no-untyped-def]
    for slot in range(w.size // (3 * WIDTH)):
        s, c = kernel._sin_cos(load(w, 3 * slot))
        store(w, 3 * slot + 1, s)
        store(w, 3 * slot + 2, c)


def test_sine_and_cosine_are_right_to_two_units_in_the_last_place() -> None:
    x = np.random.default_rng(0).uniform(-60.0, 60.0, (4000, WIDTH))
    x[:4] = np.pi / 4 * np.arange(-16, 16).reshape(4, WIDTH)
    w = np.stack([x, x, x], axis=1)
    flat = w.ravel().copy()
    _sine_and_cosine(flat)
    _, s, c = np.moveaxis(flat.reshape(w.shape), 1, 0)
    np.testing.assert_allclose(s, np.sin(x), rtol=0, atol=3e-16)
    np.testing.assert_allclose(c, np.cos(x), rtol=0, atol=3e-16)


@pytest.mark.parametrize("kind", ["paper", "rich"])
def test_a_fit_does_not_depend_on_its_neighbours_in_the_lanes(kind: str) -> None:
    problem = example(kind)
    starts = uniform(problem.model, np.random.default_rng(1), 21)
    together = fit(problem, starts, "lm", Options(1e-12, 300))
    reverse = fit(problem, starts[::-1], "lm", Options(1e-12, 300))
    alone = [fit(problem, x[None], "lm", Options(1e-12, 300)) for x in starts]
    for name in ("estimate", "cost", "status", "iterations", "at_bound"):
        expected = getattr(together, name)
        np.testing.assert_array_equal(getattr(reverse, name)[::-1], expected)
        np.testing.assert_array_equal(np.concatenate([getattr(a, name) for a in alone]), expected)


def test_many_problems_in_one_queue_equal_one_problem_at_a_time() -> None:
    problems = [example("ml", seed) for seed in range(5)]
    starts = np.stack([uniform(p.model, np.random.default_rng(k), 7) for k, p in enumerate(problems)])
    shuffled = np.random.default_rng(9).permutation(35)
    which, options = np.repeat(np.arange(5), 7)[shuffled], Options(1e-12, 300)
    queue = fit_queue(problems, which, starts.reshape(35, -1)[shuffled], "lm", options)
    alone = [fit(p, x0, "lm", Options(1e-12, 300)).estimate for p, x0 in zip(problems, starts, strict=True)]
    np.testing.assert_array_equal(queue.estimate, np.concatenate(alone)[shuffled])
