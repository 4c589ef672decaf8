"""`pipelines/examples/estimated_derivatives.py`: its solvers with estimated derivatives minimise the same cost."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

EXAMPLE = Path(__file__).parents[2] / "pipelines" / "examples" / "estimated_derivatives.py"


def test_with_estimated_derivatives_the_same_minimum_is_reached_in_units_of_the_bounds() -> None:
    spec = importlib.util.spec_from_file_location("estimated_derivatives", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    rng = np.random.default_rng(5)
    data, _ = example.experiment.frf(example.experiment.realization(rng), example.AMPLITUDE)
    problem = example.paper_cost(example.model, example.points.f, data)
    lowest = example.exact(problem, example.uniform(example.model, rng, 100)).min()
    near = example.model.truth + 0.05 * example.WIDTH * rng.uniform(-1, 1, (2, example.WIDTH.size))
    costs = example.SOLVERS["SLSQP, differences, units of the bounds"](problem, near)
    assert costs.min() == pytest.approx(lowest, rel=1e-3)
    assert (costs >= lowest * (1 - 1e-6)).all()
