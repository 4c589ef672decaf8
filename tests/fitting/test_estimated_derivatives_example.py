"""`pipelines/validation/estimated_derivatives.py`: solvers of the same cost, few fits unless told otherwise."""

from types import ModuleType

import numpy as np
import pytest
from examples import PLACES, module


@pytest.fixture(scope="module", name="example")
def _example() -> ModuleType:
    return module("estimated_derivatives")


def test_the_default_is_few_fits_and_the_page_names_the_command_that_makes_its_figures(example: ModuleType) -> None:
    small = example.arguments().parse_args([])
    assert small.realizations * small.starts <= 2
    assert "`--realizations 6 --starts 10`" in (PLACES[1] / "README.md").read_text(encoding="utf-8")


def test_with_estimated_derivatives_the_same_minimum_is_reached_in_units_of_the_bounds(example: ModuleType) -> None:
    rng = np.random.default_rng(5)
    data, _ = example.experiment.frf(example.experiment.realization(rng), example.AMPLITUDE)
    problem = example.paper_cost(example.model, example.points.f, data)
    lowest = example.exact(problem, example.uniform(example.model, rng, 100)).min()
    near = example.model.truth + 0.05 * example.WIDTH * rng.uniform(-1, 1, (2, example.WIDTH.size))
    costs = example.SOLVERS["SLSQP, differences, units of the bounds"](problem, near)
    assert costs.min() == pytest.approx(lowest, rel=1e-3)
    assert (costs >= lowest * (1 - 1e-6)).all()
