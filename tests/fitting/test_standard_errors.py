"""Standard errors of a fit, against another library's and against the scatter of repeated fits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import curve_fit

from mcstudy.fitting.arguments import Prior
from mcstudy.fitting.penalised import Fitter
from mcstudy.fitting.problem import Data, Problem, ml_cost, paper_cost
from mcstudy.fitting.standard_errors import joint_covariance, overlap_of, sandwich, standard_errors, wald_covariance
from mcstudy.spectra.bands import odd_lines, published
from mcstudy.stance.body import two_segment
from mcstudy.stance.response import frf

MODEL = two_segment()
F = odd_lines(8.0).f[::3]
THETA = MODEL.truth * np.linspace(0.8, 1.2, MODEL.truth.size)


def covariance_at(f: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(0)
    G = rng.standard_normal((f.size, 2, 2)) + 1j * rng.standard_normal((f.size, 2, 2)) + 2 * np.eye(2)
    G *= 1e-3 * np.abs(frf(MODEL, MODEL.truth, f))[:, :, None]
    return np.asarray(G @ G.conj().transpose(0, 2, 1))


def ml_problem() -> tuple[Problem, np.ndarray]:
    C = covariance_at(F)
    return ml_cost(MODEL, F, frf(MODEL, THETA, F), C), C


def test_those_of_maximum_likelihood_are_scipys() -> None:
    problem, C = ml_problem()
    width = MODEL.upper - MODEL.lower

    def whitened(_: np.ndarray, *x: float) -> np.ndarray:
        return np.sqrt(2) * problem.residual(np.array(x) * width)

    _, found = curve_fit(whitened, np.zeros(4 * F.size), np.zeros(4 * F.size), p0=THETA / width, absolute_sigma=True)
    ours = standard_errors(problem, THETA, C, np.eye(F.size), likelihood=True)
    np.testing.assert_allclose(ours, np.sqrt(np.diag(found)) * width, rtol=1e-4)


def test_they_come_from_the_information_of_a_fit_to_a_person() -> None:
    problem, C = ml_problem()
    size = MODEL.truth.size
    none = Prior(MODEL.truth, MODEL.upper - MODEL.lower, 0.0)
    whitener = Data(F, problem.y, np.sqrt(2) * problem.weight)
    fitter = Fitter(MODEL, none, F)
    fitted = fitter.fits(fitter.packed(whitener), THETA[None], tolerance=1e-12, max_iterations=20)
    wald = np.sqrt(np.diag(wald_covariance(fitted.information[0], np.ones(size, dtype=bool))))
    ours = standard_errors(problem, fitted.estimate[0], C, np.eye(F.size), likelihood=True)
    np.testing.assert_allclose(ours, wald, rtol=1e-6)


def test_the_sandwich_with_the_best_weights_is_the_inverse_information() -> None:
    problem, C = ml_problem()
    both = [standard_errors(problem, THETA, C, np.eye(F.size), likelihood=way) for way in (True, False)]
    np.testing.assert_allclose(*both, rtol=1e-6)


def test_points_that_share_lines_widen_them_as_repeated_fits_scatter() -> None:
    bands = published().below(3.0)
    weights, lines = bands.weights, bands.weights.shape[1]
    rng, n = np.random.default_rng(1), 1500
    white = (rng.standard_normal((n, lines, 2)) + 1j * rng.standard_normal((n, lines, 2))) / np.sqrt(2)
    true = frf(MODEL, MODEL.truth, bands.f)
    size = 1e-4 * np.abs(true)
    error = np.einsum("kl,nla->nka", weights, white) / np.sqrt(np.diag(weights @ weights.T))[:, None] * size
    C = np.zeros((len(bands), 2, 2), dtype=complex)
    C[:, [0, 1], [0, 1]] = size**2
    problem = paper_cost(MODEL, bands.f, true)
    J = problem.jacobian(MODEL.truth) * (width := MODEL.upper - MODEL.lower)
    weighted = np.einsum("nij,rnj->rni", problem.weight, error).reshape(n, -1)
    change = np.linalg.lstsq(J, np.concatenate([weighted.real, weighted.imag], axis=1).T, rcond=None)[0].T * width
    ours = standard_errors(problem, MODEL.truth, C, overlap_of(bands), likelihood=False)
    np.testing.assert_allclose(change.std(axis=0), ours, rtol=0.07)
    apart = standard_errors(problem, MODEL.truth, C, np.eye(len(bands)), likelihood=False)
    assert (abs(apart / ours - 1) > 0.02).any()
    assert sandwich(J.reshape(2, -1, 2, 12)[0], problem.weight, joint_covariance(C)).shape == (12, 12)


def test_a_parameter_on_a_bound_has_none_and_the_others_those_of_knowing_it() -> None:
    problem, C = ml_problem()
    k = MODEL.names.index("Kpas1")
    on = THETA.copy()
    on[k] = MODEL.lower[k]
    ours = standard_errors(problem, on, C, np.eye(F.size), likelihood=True)
    assert np.isnan(ours[k])
    free = np.delete(np.arange(on.size), k)
    J = np.sqrt(2) * problem.jacobian(on)[:, free]
    scale = np.linalg.norm(J, axis=0)
    expected = np.sqrt(np.diag(np.linalg.inv((J / scale).T @ (J / scale)))) / scale
    np.testing.assert_allclose(ours[free], expected, rtol=1e-6)


@pytest.mark.parametrize("likelihood", [True, False])
def test_a_covariance_that_is_none_gives_none(likelihood: bool) -> None:
    problem, C = ml_problem()
    assert np.isnan(standard_errors(problem, THETA, np.full_like(C, np.nan), np.eye(F.size), likelihood)).all()
    if not likelihood:
        assert np.isnan(standard_errors(problem, THETA, np.zeros_like(C), np.eye(F.size), likelihood)).all()
