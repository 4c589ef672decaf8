"""Optimal powers: derivatives, the equivalence theorem, and another optimiser."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from mcstudy.errors import InputError
from mcstudy.stimulus_design.criteria import Criterion
from mcstudy.stimulus_design.optimum import Allowed, grouped, maximum, shortfall
from mcstudy.stimulus_design.phases import crest_factor, low_crest, schroeder


def problem(columns: np.ndarray | None = None, lines: int = 12, parameters: int = 4, bodies: int = 2) -> Criterion:
    rng = np.random.default_rng(8)
    J = rng.standard_normal((bodies, lines, 2, parameters))
    return Criterion(np.einsum("bkip,bkiq->bkpq", J, J), columns)


ONE = np.eye(4)[:, :1]
COLUMNS = (None, np.eye(4), ONE)


@pytest.mark.parametrize("columns", COLUMNS, ids=("D", "A", "c"))
def test_the_derivatives_of_a_criterion_are_those_of_its_values(columns: np.ndarray | None) -> None:
    criterion, x = problem(columns), np.linspace(0.5, 2.0, 12)
    found = criterion.slopes(x)
    assert np.isclose(found.value, criterion.value(x))
    for k, h in ((0, 1e-5), (7, 1e-5)):
        step = h * np.eye(12)[k]
        assert np.isclose(
            (criterion.value(x + step) - criterion.value(x - step)) / (2 * h), found.gradient[k], rtol=1e-6
        )
        ends = criterion.slopes(x + step).gradient - criterion.slopes(x - step).gradient
        np.testing.assert_allclose(ends / (2 * h), found.hessian[k], rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("columns", COLUMNS, ids=("D", "A", "c"))
def test_another_optimiser_finds_no_better_spectrum(columns: np.ndarray | None) -> None:
    criterion, rng = problem(columns), np.random.default_rng(3)
    allowed = Allowed(rng.uniform(0.2, 1.0, (3, 12)), np.full(12, 0.01), ("a", "b", "c"))
    found = maximum(criterion, allowed, 1e-6)
    assert (found.x >= allowed.least).all()
    assert (allowed.used(found.x) <= 1).all()
    assert 0 <= found.gap < 1e-6
    other = minimize(
        lambda x: -criterion.value(x),
        np.full(12, 0.05),
        jac=lambda x: -criterion.slopes(x).gradient,
        method="SLSQP",
        bounds=[(v, None) for v in allowed.least],
        constraints={"type": "ineq", "fun": lambda x: 1 - allowed.used(x), "jac": lambda _: -allowed.cost},
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assert other.success
    assert -other.fun == pytest.approx(found.value, abs=1e-5)


def test_at_the_optimum_no_line_has_a_larger_variance_than_there_are_parameters() -> None:
    """The equivalence theorem of Kiefer and Wolfowitz, for one limit and one body."""
    criterion = problem(bodies=1)
    allowed = Allowed(np.ones((1, 12)), np.zeros(12), ("power",))
    x = maximum(criterion, allowed, 1e-7).x
    variance = np.einsum("pq,kqp->k", np.linalg.inv(criterion.at(x)[0]), criterion.information[0])
    assert variance.max() == pytest.approx(4, rel=1e-5)
    assert variance[x > 1e-3] == pytest.approx(4, rel=1e-3)
    assert shortfall(criterion, allowed, np.full(12, 1 / 12)) > 0.01  # a flat spectrum is not optimal


def test_a_limit_that_the_kept_power_breaks_is_named() -> None:
    allowed = Allowed(np.ones((2, 12)) * [[0.1], [0.3]], np.full(12, 0.5), ("limits.rms", "limits.rate"))
    with pytest.raises(InputError, match=r"^limits\.rate: what is kept .* is 1\.34 times this limit"):
        maximum(problem(), allowed)


def test_detection_lines_are_one_of_every_group_and_never_the_first_line() -> None:
    harmonic = np.arange(1, 201, 2)
    for seed in range(20):
        empty = grouped(harmonic, 0.25, np.random.default_rng(seed))
        assert not empty[0]
        assert (empty.reshape(-1, 4).sum(axis=1) == 1).all()
    assert not grouped(harmonic, 0.0, np.random.default_rng(0)).any()


def test_clipping_lowers_the_crest_factor_below_that_of_schroeder() -> None:
    harmonic = np.arange(1, 121, 2)
    power = 1.0 / harmonic

    def crest(phase: np.ndarray) -> float:
        spectrum = np.zeros(2049, dtype=complex)
        spectrum[harmonic] = np.sqrt(power) * np.exp(1j * phase)
        return crest_factor(np.fft.irfft(spectrum, 4096))

    found = crest(low_crest(harmonic, power, 4096, np.random.default_rng(1), 2))
    assert found < crest(schroeder(power)) - 0.1
    assert found < 1.6
    assert crest(np.zeros(harmonic.size)) > 4  # cosines in phase
