"""Even lines seen through the loop estimate the noise covariance better than even lines alone."""

import numpy as np
import pytest

from mcstudy.fitting.linearised import linearised
from mcstudy.fitting.problem import ml_cost
from mcstudy.fitting.solvers import fit
from mcstudy.spectra import periods
from mcstudy.spectra.bands import odd_lines
from mcstudy.spectra.estimate import SpectralExperiment
from mcstudy.spectra.even_lines import EvenLineCovariance
from mcstudy.spectra.loop_covariance import LoopCovariance
from mcstudy.stance.body import one_segment, two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.simulate_spectral import sway_psd
from mcstudy.stance.stimulus import Prts

BANDS = odd_lines(8.0)


def relative(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Estimates whitened by the truth, (..., 2, 2): the identity when right, in every direction."""
    root = np.linalg.inv(np.linalg.cholesky(truth))
    return root @ estimate @ root.conj().swapaxes(-1, -2)


@pytest.fixture(scope="module")
def estimates() -> dict[str, np.ndarray]:
    """Estimates relative to the truth over 40 realizations, by estimator, (40, L, 2, 2); each with a first fit."""
    model, noise = two_segment(), SensorNoise()
    subject = SpectralExperiment(model, model.truth, Prts(), noise, BANDS, spectrum=periods.ramp_removed)
    duration_s = 5 * BANDS.period_s
    truth = sway_psd(model, model.truth, noise, BANDS.f) / (2 * duration_s)
    out: dict[str, list[np.ndarray]] = {"loop": [], "alone": []}
    for r in range(40):
        line_noise = subject.realization(np.random.default_rng(r))
        first = ml_cost(model, BANDS.f, *subject.frf(line_noise, 5.0))
        guess = fit(first, linearised(first, np.random.default_rng(), 1)).estimate[0]
        out["loop"].append(relative(subject.through_loop(line_noise, guess).covariance, truth))
        out["alone"].append(relative(line_noise.covariance, truth))
    return {name: np.array(values) for name, values in out.items()}


def test_the_strong_direction_is_right_within_a_third_at_every_line(estimates: dict[str, np.ndarray]) -> None:
    power = estimates["loop"].mean(axis=0)[:, 0, 0].real
    assert power.min() > 0.7
    assert power.max() < 1.35


def test_it_scatters_less_than_the_even_lines_alone(estimates: dict[str, np.ndarray]) -> None:
    scatter = {name: (v.std(axis=0) / v.mean(axis=0).real)[:, 0, 0] for name, v in estimates.items()}
    above = BANDS.lines > 40
    assert scatter["loop"][above].mean() < 0.75 * scatter["alone"][above].mean()


def test_its_degrees_of_freedom_grow_with_frequency() -> None:
    dof, alone = LoopCovariance(BANDS.lines, 4000).dof, EvenLineCovariance(BANDS.lines, 4000).dof
    assert (dof > 1.5 * alone).all()
    assert dof[-1] > 4 * alone[-1]


def test_an_experiment_replaces_the_covariance_and_nothing_else() -> None:
    for model in (two_segment(), one_segment()):
        noise = SensorNoise((4e-4, 7e-5)[: model.n_rows])
        subject = SpectralExperiment(model, model.truth, Prts(), noise, BANDS, spectrum=periods.ramp_removed)
        first = subject.realization(np.random.default_rng(1))
        second = subject.through_loop(first, model.truth)
        np.testing.assert_array_equal(first.coefficients, second.coefficients)
        assert (np.linalg.eigvalsh(second.covariance) > 0).all()
        assert 0.3 < (second.covariance[:, 0, 0] / first.covariance[:, 0, 0]).real.mean() < 3
