"""The exact distribution of FRFs against FRFs of simulated records."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.spectra import periods
from mcstudy.spectra.bands import odd_lines
from mcstudy.spectra.estimate import SpectralExperiment
from mcstudy.spectra.frf_law import frf_law
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.stimulus import Prts


@pytest.mark.parametrize("ramp_removed", [False, True])
def test_the_law_is_that_of_simulated_records(ramp_removed: bool) -> None:
    model, noise, prts = two_segment(), SensorNoise(), Prts(4, 0.1, 40.0, 1.0)
    bands = odd_lines(4.0, prts.period_s)
    spectrum = periods.ramp_removed if ramp_removed else periods.raw
    subject = SpectralExperiment(model, model.truth, prts, noise, bands, 3, 1, spectrum)
    law = frf_law(model, prts, noise, bands, 3, 1, ramp_removed)
    rng = np.random.default_rng(1)
    records = np.array([subject.frf(subject.realization(rng), 2.0)[0] for _ in range(1000)])
    drawn = law.draw(rng.standard_normal((1000, law.size)), 2.0)
    np.testing.assert_allclose(law.mean, subject.noise_free())
    scale = np.sqrt(np.einsum("nii->ni", law.covariance).real) / 2.0

    def real(x: np.ndarray) -> np.ndarray:
        z = ((x - law.mean) / scale).reshape(len(x), -1)
        return np.concatenate([z.real, z.imag], axis=1)

    theirs, ours = (np.cov(real(x).T) for x in (records, drawn))
    parts = np.concatenate([1 / scale.ravel()] * 2)
    exact = law.root.T @ law.root / 4.0 * parts * parts[:, None]
    assert np.abs(theirs - exact).max() < 0.13  # 5 standard errors of a covariance of 1000
    assert np.abs(ours - exact).max() < 0.13
    assert np.abs(exact[np.triu_indices_from(exact, 1)]).max() > 0.3  # leakage and the two angles: not independent
