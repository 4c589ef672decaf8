"""Sway in the frequency domain: exact steady state, right density, right size."""

import numpy as np
import pytest

from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise, record_frequencies
from mcstudy.stance.response import frf, noise_response
from mcstudy.stance.simulate_spectral import NoiseSway, stimulus_sway, sway_psd
from mcstudy.stance.stimulus import Prts

RATE, N = 200.0, 4 * 728
MODEL, NOISE = two_segment(), SensorNoise()


def test_sway_is_the_response_times_the_noise():
    sway = NoiseSway(MODEL, MODEL.truth, NOISE, N, RATE).coefficients(np.random.default_rng(1))
    noise = NOISE.coefficients(np.random.default_rng(1), N, RATE)
    f = record_frequencies(N, RATE)[1:-1]
    expected = np.einsum("nij,nj->ni", noise_response(MODEL, MODEL.truth, f), noise[1:-1])
    assert sway[1:-1] == pytest.approx(expected, rel=1e-12)
    assert (sway[0] == 0).all()


def test_a_record_has_the_length_asked_for_and_no_mean():
    once = NoiseSway(MODEL, MODEL.truth, NOISE, N, RATE).sample(np.random.default_rng(2))
    assert once.shape == (N, 2)
    assert once.mean(axis=0) == pytest.approx([0, 0], abs=1e-15)


def test_coefficients_have_the_stated_covariance():
    """E c c^H = S / (2 T), with the cross-density between the angles."""
    sampler, rng, runs = NoiseSway(MODEL, MODEL.truth, NOISE, N, RATE), np.random.default_rng(3), 1500
    lines = np.array([1, 5, 20, 36, 100])
    c = np.stack([sampler.coefficients(rng)[lines] for _ in range(runs)])
    expected = sway_psd(MODEL, MODEL.truth, NOISE, lines * RATE / N) / (2 * N / RATE)
    whitener = np.linalg.inv(np.linalg.cholesky(expected))
    white = np.einsum("nij,tnj->tni", whitener, c)
    covariance = np.einsum("tni,tnj->nij", white, white.conj()) / runs
    assert np.abs(covariance - np.eye(2)).max() < 6 / np.sqrt(runs)


def test_sway_has_the_size_of_quiet_stance():
    """RMS of the order the paper reports (0.11 and 0.08 deg; Methods); the stand-in truth gives 0.16 and 0.09."""
    sampler, rng = NoiseSway(MODEL, MODEL.truth, NOISE, 6 * 8744, RATE), np.random.default_rng(4)
    rms = np.degrees(np.sqrt(np.mean([sampler.sample(rng).var(axis=0) for _ in range(5)], axis=0)))
    assert 0.08 < rms[0] < 0.24
    assert 0.06 < rms[1] < 0.13


def test_stimulus_sway_is_the_frf_times_the_stimulus():
    prts = Prts(stages=5)
    sway = stimulus_sway(MODEL, MODEL.truth, prts.waveform(), prts.rate_hz)
    k = np.arange(1, 41, 2)
    measured = (np.fft.rfft(sway, axis=0) / prts.samples)[k] / prts.coefficients()[k, None]
    assert measured == pytest.approx(frf(MODEL, MODEL.truth, k / prts.period_s), rel=1e-9)
