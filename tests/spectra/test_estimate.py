"""FRFs with their covariance, simulated and from recordings."""

import numpy as np
import pytest

from mcstudy.errors import InputError, RecordingError
from mcstudy.spectra import bands, periods
from mcstudy.spectra.estimate import SpectralExperiment, SpectrumNoise, frf_from_recording
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_spectral import NoiseSway, stimulus_sway
from mcstudy.stance.stimulus import Prts

MODEL, NOISE = two_segment(), SensorNoise()
SHORT = Prts(stages=5)  # 4.84 s
ODD = bands.odd_lines(8.0, SHORT.period_s)


@pytest.fixture(scope="module")
def experiment():
    return SpectralExperiment(MODEL, MODEL.truth, Prts(), NOISE, bands.published())


def test_without_noise_the_sim_frf_is_the_band_mean_of_the_closed_form(experiment):
    lines = experiment.bands.lines.size
    silence = SpectrumNoise(np.zeros((lines, 2)), np.zeros((lines, 2, 2)), np.zeros((0, 2)))
    data, covariance = experiment.frf(silence, 5.0)
    assert data == pytest.approx(experiment.noise_free(), rel=1e-12)
    assert (covariance == 0).all()
    single = [i for i, m in enumerate(experiment.bands.members) if m.size == 1]
    assert data[single] == pytest.approx(experiment.true_frf[single], rel=1e-12)
    averaging = np.abs(experiment.noise_free() / experiment.true_frf - 1)
    assert 0.01 < averaging.max() < 0.5


def test_noise_is_shared_between_amplitudes(experiment):
    noise = experiment.realization(np.random.default_rng(1))
    (three, c3), (five, c5) = experiment.frf(noise, 3.0), experiment.frf(noise, 5.0)
    clean = experiment.noise_free()
    assert (three - clean) * 3 == pytest.approx((five - clean) * 5, rel=1e-9)
    assert c3 * 9 == pytest.approx(c5 * 25, rel=1e-9)
    again = experiment.realization(np.random.default_rng(1))
    assert np.array_equal(noise.coefficients, again.coefficients)


def test_peak_to_peak_halves_the_stimulus(experiment):
    noise = experiment.realization(np.random.default_rng(1))
    other = SpectralExperiment(MODEL, MODEL.truth, Prts(convention="peak_to_peak"), NOISE, bands.published())
    assert other.frf(noise, 6.0)[0] == pytest.approx(experiment.frf(noise, 3.0)[0], rel=1e-12)


def test_the_band_covariance_is_that_of_the_errors():
    """The mean estimate of each point's variance is the mean square of its error."""
    experiment = SpectralExperiment(MODEL, MODEL.truth, Prts(), NOISE, bands.published(), spectrum=periods.ramp_removed)
    rng, runs = np.random.default_rng(2), 60
    clean, estimated, actual = experiment.noise_free(), 0.0, 0.0
    for _ in range(runs):
        data, covariance = experiment.frf(experiment.realization(rng), 5.0)
        estimated = estimated + np.einsum("nii->ni", covariance).real / runs
        actual = actual + np.abs(data - clean) ** 2 / runs
    ratio = estimated / actual
    assert ratio.mean() == pytest.approx(1.0, abs=0.15)
    assert ratio.min() > 0.5
    assert ratio.max() < 2.0


def test_a_noise_free_recording_gives_the_closed_form():
    u = np.tile(SHORT.waveform(), 3)
    sway = np.tile(stimulus_sway(MODEL, MODEL.truth, SHORT.waveform(), 200.0), (3, 1))
    found = frf_from_recording(sway, u, 200.0, ODD)
    assert found.frf == pytest.approx(frf(MODEL, MODEL.truth, ODD.f), rel=1e-9)
    assert np.abs(found.covariance).max() < 1e-20
    assert np.array_equal(found.f, ODD.f)


def test_trials_average_towards_the_truth_with_the_stated_covariance():
    rng, trials = np.random.default_rng(3), 12
    u = np.tile(SHORT.waveform(), 6)
    evoked = np.tile(stimulus_sway(MODEL, MODEL.truth, SHORT.waveform(), 200.0), (6, 1))
    sampler = NoiseSway(MODEL, MODEL.truth, NOISE, u.size, 200.0)
    sway = np.stack([evoked + sampler.sample(rng) for _ in range(trials)])
    one, many = frf_from_recording(sway[0], u, 200.0, ODD), frf_from_recording(sway, u, 200.0, ODD)
    assert many.dof == pytest.approx(trials * one.dof)
    errors = many.frf - frf(MODEL, MODEL.truth, ODD.f)
    v = np.einsum("ni,nij,nj->n", errors.conj(), np.linalg.inv(many.covariance), errors).real
    assert v.mean() == pytest.approx(2.0, abs=1.0)
    shrink = np.einsum("nii->n", many.covariance).real / np.einsum("nii->n", one.covariance).real
    assert np.exp(np.log(shrink).mean()) == pytest.approx(1 / trials, rel=0.5)


def test_unusable_recordings_are_refused():
    u, sway = np.tile(SHORT.waveform(), 3), np.zeros((3 * SHORT.samples, 2))
    with pytest.raises(RecordingError, match="samples"):
        frf_from_recording(sway[1:], u, 200.0, ODD)
    with pytest.raises(RecordingError, match="rate_hz"):
        frf_from_recording(sway, u, 199.9, ODD)
    with pytest.raises(RecordingError, match="half the sampling rate"):
        frf_from_recording(sway[:726], u[:726], 50.0, bands.odd_lines(40.0, SHORT.period_s))
    with pytest.raises(RecordingError, match=r"no power at 0\.207 Hz"):
        frf_from_recording(sway, np.tile(np.sin(np.arange(968) * 2 * np.pi * 2 / 968), 3), 200.0, ODD)


def test_bands_of_another_period_are_refused():
    with pytest.raises(InputError, match=r"4\.84 s"):
        SpectralExperiment(MODEL, MODEL.truth, SHORT, NOISE, bands.published())
    with pytest.raises(InputError, match="discarded"):
        SpectralExperiment(MODEL, MODEL.truth, SHORT, NOISE, ODD, cycles=1)
