"""Deviations that scatter from line to line are seen in the whole residual, and noise is not taken for one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from mcstudy.gap.candidates.unstructured_residual import PRIOR, UnstructuredResidual

DOF = 680


@pytest.fixture(scope="module")
def null() -> np.ndarray:
    """Sums of squares under the null, wider than chi-squared as an estimated covariance makes them."""
    rng = np.random.default_rng(1)
    return 1.5 * rng.chisquare(DOF / 1.5, 4000)


def test_the_null_is_fitted_by_its_mean_and_variance(null: np.ndarray) -> None:
    unstructured = UnstructuredResidual.of(null)
    assert unstructured.scale * unstructured.dof == pytest.approx(DOF, rel=0.01)
    assert unstructured.scale == pytest.approx(1.5, rel=0.1)
    fewer = UnstructuredResidual.of(null, taken=80)
    assert fewer.scale * fewer.dof == pytest.approx(DOF - 80, rel=0.01)


def test_mean_bayes_factor_of_noise_is_one() -> None:
    """So belief in an unstructured gap is neither won nor lost by looking, on average."""
    x = np.linspace(1.0, 6 * DOF, 200_001)
    log_factor = UnstructuredResidual(1.5, DOF / 1.5).log_factor(x)
    log_density = stats.chi2.logpdf(x / 1.5, DOF / 1.5) - np.log(1.5)
    assert np.trapezoid(np.exp(log_density + log_factor), x) == pytest.approx(1.0, abs=0.01)
    assert np.interp(DOF, x, log_factor) < np.log(0.8)


def test_an_unstructured_gap_of_fifteen_is_found_and_one_of_three_is_not(null: np.ndarray) -> None:
    unstructured = UnstructuredResidual.of(null)
    rng = np.random.default_rng(2)
    found = unstructured.log_factor(1.5 * rng.noncentral_chisquare(DOF / 1.5, 15**2 / 1.5, 500))
    missed = unstructured.log_factor(1.5 * rng.noncentral_chisquare(DOF / 1.5, 3**2 / 1.5, 500))
    assert (found > 3).mean() > 0.8
    assert (missed > 3).mean() < 0.1


def test_draws_hold_the_size_and_are_zero_without_a_gap(null: np.ndarray) -> None:
    unstructured = UnstructuredResidual.of(null)
    rng = np.random.default_rng(3)
    without = unstructured.samples(DOF - 60.0, rng, 4000)
    assert (without == 0).mean() > 1 - PRIOR
    low, high = np.quantile(np.sqrt(unstructured.samples(DOF + 400.0, rng, 4000)), (0.025, 0.975))
    assert low < 20 < high
