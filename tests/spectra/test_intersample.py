"""A stimulus made of straight lines is told from others, and its exact spectrum is used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.recordings.recording import Recording, Trial
from mcstudy.spectra.intersample import drive, is_straight
from mcstudy.spectra.periodic import cycle_coefficients
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.stimulus import Prts


@pytest.fixture(scope="module")
def silent() -> Recording:
    return _silent(200.0)


def _silent(rate_hz: float) -> Recording:
    protocol = Protocol(waveform=Prts(rate_hz=rate_hz), amplitudes=(5.0,), cycles=4, noise=SensorNoise((0.0, 0.0)))
    return simulate_recording(protocol, two_segment().truth, np.random.default_rng(0))


def test_a_prts_is_straight_and_what_rises_at_once_bends_or_is_noisy_is_not() -> None:
    rng, torque = np.random.default_rng(1), Prts().waveform()
    t = np.arange(12_000) / 200
    assert is_straight(torque)
    assert is_straight(torque + 0.001 * np.abs(np.diff(torque)).max() * rng.standard_normal(torque.size))
    assert not is_straight(torque + 0.2 * np.abs(np.diff(torque)).max() * rng.standard_normal(torque.size))
    assert not is_straight(np.sign(np.sin(2 * np.pi * 0.3 * t)))  # held between jumps
    assert not is_straight(sum(np.sin(2 * np.pi * k * 0.1 * t + k * k) for k in range(1, 40)))
    assert not is_straight(signal.sosfiltfilt(signal.butter(4, 6.0, fs=200, output="sos"), torque))
    assert not is_straight(np.zeros(100))


@pytest.mark.parametrize("rate_hz", [50.0, 100.0])
def test_a_prts_whose_slope_changes_every_sample_or_two_is_straight_and_stairs_are_not(rate_hz: float) -> None:
    rng, torque = np.random.default_rng(3), Prts(rate_hz=rate_hz).waveform()
    step = np.abs(np.diff(torque)).max()
    assert is_straight(torque)
    assert is_straight(torque + 0.001 * step * rng.standard_normal(torque.size))
    assert not is_straight(torque + 0.2 * step * rng.standard_normal(torque.size))
    assert not is_straight(signal.sosfiltfilt(signal.butter(4, 6.0, fs=rate_hz, output="sos"), torque))
    assert not is_straight(np.repeat(np.cumsum(rng.integers(-1, 2, 600)), 2))  # held for two samples
    assert not is_straight(rng.integers(-1, 2, 600))  # few values and few differences
    assert not is_straight(rng.standard_normal(600))


@pytest.mark.parametrize(("rate_hz", "error"), [(50.0, 3e-3), (100.0, 2e-4), (200.0, 2e-4)])
def test_the_frf_of_a_recording_without_noise_is_the_models_at_every_line(rate_hz: float, error: float) -> None:
    """At 50 Hz the sampled angles hold some of their motion near 42 Hz."""
    silent = _silent(rate_hz)
    cycles = cycle_coefficients(silent, 8.0, 2)
    lines = np.arange(1, round(8.0 * silent.period_s), 2)
    y = cycles.theta[0][:, lines].mean(axis=0) / cycles.stimulus[:, lines].mean(axis=0)[:, None]
    model = two_segment()
    expected = frf(model, model.truth, lines / silent.period_s)
    assert np.abs(y / expected - 1).max() < error  # with the samples' spectrum 5e-3 at 200 Hz, 8e-2 at 50 Hz


def test_one_trial_that_is_not_straight_leaves_the_samples_spectrum(silent: Recording) -> None:
    f = np.array([0.0, 1.0, 8.0])
    assert drive(silent, f) == pytest.approx(np.sinc(f / 200) ** 2)
    trial = silent.trials[0]
    noisy = Trial(trial.stimulus + np.random.default_rng(2).standard_normal(trial.samples), trial.theta, 5.0)
    assert (drive(replace(silent, trials=(trial, noisy)), f) == 1.0).all()
