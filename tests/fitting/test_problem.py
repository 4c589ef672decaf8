"""The two costs, and what happens to data that cannot be fitted."""

import numpy as np
import pytest
from fit_problems import F, covariances, example, measured

from mcstudy.fitting.problem import ml_cost, paper_cost
from mcstudy.fitting.solvers import fit, solvers
from mcstudy.fitting.starts import uniform
from mcstudy.fitting.status import Status
from mcstudy.stance.body import one_segment, two_segment
from mcstudy.stance.response import frf


def test_paper_cost_is_the_mean_squared_error_relative_to_the_data() -> None:
    model, rng = two_segment(), np.random.default_rng(0)
    data = measured(model, rng)
    theta = uniform(model, rng, 1)[0]
    error = np.abs((data - frf(model, theta, F)) / np.abs(data)) ** 2
    J = error.sum() / (2 * len(F))
    assert paper_cost(model, F, data).cost(theta) == pytest.approx(J, rel=1e-13)


def test_ml_cost_is_the_quadratic_form_of_the_inverse_covariance() -> None:
    model, rng = two_segment(), np.random.default_rng(1)
    data = measured(model, rng)
    C = covariances(rng, data)
    theta = uniform(model, rng, 1)[0]
    r = frf(model, theta, F) - data
    V = np.einsum("ni,nij,nj->", r.conj(), np.linalg.inv(C), r).real
    assert ml_cost(model, F, data, C).cost(theta) == pytest.approx(V, rel=1e-12)


def test_costs_of_one_angle_are_those_of_its_relative_errors() -> None:
    model, rng = one_segment(), np.random.default_rng(2)
    data = measured(model, rng)
    error = np.abs((data - frf(model, model.truth, F)) / data) ** 2
    assert data.shape == (len(F), 1)
    assert paper_cost(model, F, data).cost(model.truth) == pytest.approx(error.mean(), rel=1e-13)
    C = np.abs(data[:, :, None]) ** 2
    assert ml_cost(model, F, data, C).cost(model.truth) == pytest.approx(error.sum(), rel=1e-13)


@pytest.mark.parametrize("solver", solvers())
def test_data_that_are_not_finite_are_an_outcome_not_an_exception(solver: str) -> None:
    problem = example("paper")
    problem.y[3, 1] = np.nan
    fits = fit(problem, uniform(problem.model, np.random.default_rng(0), 3), solver)
    assert (fits.status == Status.NON_FINITE_DATA).all()
    assert np.isnan(fits.cost).all()


def test_every_status_explains_itself() -> None:
    assert len({s.text for s in Status}) == len(Status)
    assert [s for s in Status if s.usable] == [Status.CONVERGED, Status.STALLED, Status.ITERATION_LIMIT]
