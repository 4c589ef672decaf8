"""Fisher information of lines: its noise, its derivatives and its inverse."""

from __future__ import annotations

import numpy as np

from mcstudy.stance.body import one_segment, two_segment
from mcstudy.stance.information import expected_line_covariance, line_information, standard_errors, unit_variance
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_spectral import NoiseSway
from mcstudy.stance.stimulus import Prts

MODEL = two_segment()


def test_the_expected_covariance_is_that_of_simulated_lines() -> None:
    prts, noise, cycles = Prts(stages=4), SensorNoise(), 3
    lines = np.array([1, 3, 5])
    f = lines / prts.period_s
    drive = prts.coefficients()[lines]
    n = prts.samples * cycles
    expected = expected_line_covariance(MODEL, MODEL.truth, noise, f, drive, n / prts.rate_hz)
    sway = NoiseSway(MODEL, MODEL.truth, noise, n, prts.rate_hz)
    rng = np.random.default_rng(4)
    error = np.stack([sway.coefficients(rng)[lines * cycles] for _ in range(2000)]) / drive[:, None]
    measured = np.einsum("rni,rnj->nij", error, error.conj()) / 2000
    scale = np.sqrt(np.einsum("nii,njj->nij", expected, expected).real)
    assert (np.abs(measured - expected) / scale).max() < 0.1


def test_the_information_is_the_curvature_of_the_expected_deviance() -> None:
    f = np.array([0.2, 0.8, 2.0])
    C = expected_line_covariance(MODEL, MODEL.truth, SensorNoise(), f, np.full(3, 0.1), 218.6)
    whole = line_information(MODEL, MODEL.truth, f, unit_variance(C)).sum(axis=0)
    step = 1e-4 * MODEL.truth * np.random.default_rng(1).standard_normal(MODEL.truth.size)

    def deviance(change: np.ndarray) -> float:
        r = frf(MODEL, MODEL.truth + change, f) - frf(MODEL, MODEL.truth, f)
        return float(2 * np.einsum("ni,nij,nj->", r.conj(), np.linalg.inv(C), r).real)

    assert np.isclose((deviance(step) + deviance(-step)) / 2, step @ whole @ step, rtol=1e-5)


def test_the_information_of_one_angle_gives_its_standard_errors() -> None:
    model, f = one_segment(), np.array([0.2, 0.8, 2.0])
    C = expected_line_covariance(model, model.truth, SensorNoise((4e-4,)), f, np.full(3, 0.1), 218.6)
    information = line_information(model, model.truth, f, unit_variance(C)).sum(axis=0)
    sd = standard_errors(information, np.eye(4))
    assert np.allclose(sd, np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-6)
