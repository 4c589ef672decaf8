"""Noise that neighbouring lines and other trials do not show: found, told, and paid for in the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.recordings import checks
from mcstudy.recordings.recording import Recording, Trial
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.measure import measure
from mcstudy.spectra.null_draws import NullDraws
from mcstudy.spectra.periodic import periodic_lines
from mcstudy.spectra.scatter import UNEQUAL, scatter, trial_power, with_scatter
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.simulate_spectral import NoiseSway, stimulus_sway
from mcstudy.stance.stimulus import Prts
from tests.helpers.examples import module

PRTS = Prts(rate_hz=100.0)
MODEL = two_segment()
CYCLES = 6
RINGS_HZ = 1.77
"""A third of a line beside an odd harmonic, so that its phase turns from cycle to cycle."""
NOISE = NoiseSway(MODEL, MODEL.truth, SensorNoise(), CYCLES * PRTS.samples, PRTS.rate_hz)
UNIT = stimulus_sway(MODEL, MODEL.truth, PRTS.waveform() / PRTS.amplitude, PRTS.rate_hz)


def recorded(
    seed: int, amplitudes: tuple[float, ...] = (5.0, 5.0), noise: tuple[float, ...] = (1.0, 1.0), ringing: float = 0.0
) -> Recording:
    """Steady sway with noise times a factor per trial, and with a mode that rings from the start, ``ringing`` rad."""
    rng, t = np.random.default_rng(seed), np.arange(CYCLES * PRTS.samples) / PRTS.rate_hz
    mode = ringing * np.exp(-0.01 * t) * np.cos(2 * np.pi * RINGS_HZ * t)
    return Recording(
        tuple(
            Trial(
                np.tile(PRTS.waveform() * a / PRTS.amplitude, CYCLES),
                np.tile(UNIT * a, (CYCLES, 1)) + level * NOISE.sample(rng) + np.outer(mode, (1.0, -2.0)),
                a,
            )
            for a, level in zip(amplitudes, noise, strict=True)
        ),
        PRTS.rate_hz,
        PRTS.samples / PRTS.rate_hz,
    )


def errors(lines: Lines) -> np.ndarray:
    """Squared whitened errors (N,) against the closed form, 4 on average."""
    e = np.einsum("nij,nj->ni", lines.noise.whitener, lines.y - frf(MODEL, MODEL.truth, lines.f))
    return np.asarray((np.abs(e) ** 2).sum(axis=1))


def surprise(lines: Lines) -> float:
    """Share of null samples of the noise with a larger sum of squares than the true errors have."""
    null = (NullDraws(lines.noise.dof, lines.noise.pooling, 2)(np.random.default_rng(0), 60) ** 2).sum(axis=0)
    return float((null > errors(lines).sum()).mean())


@pytest.fixture(scope="module")
def rings() -> Recording:
    return recorded(0, ringing=8e-3)


def test_a_ringing_mode_is_found_at_its_line_and_its_covariance_covers_the_truth(rings: Recording) -> None:
    as_assumed, lines = periodic_lines(rings), measure(rings)
    nearest = int(np.abs(lines.f - RINGS_HZ).argmin())
    assert errors(as_assumed)[nearest] > 50
    assert errors(lines)[nearest] < 20
    assert surprise(as_assumed) == 0.0
    assert surprise(lines) > 0.0
    assert any("at 1.76 Hz" in note for note in lines.notes)


def test_lines_away_from_the_mode_keep_their_covariance(rings: Recording) -> None:
    as_assumed, lines = periodic_lines(rings), measure(rings)
    away = np.abs(lines.f - RINGS_HZ) > 1.0
    np.testing.assert_array_equal(lines.noise.C[away], as_assumed.noise.C[away])


def test_a_sound_recording_is_left_as_it_is() -> None:
    recording = recorded(1, amplitudes=(3.0, 5.0))
    lines = measure(recording)
    assert lines.notes == ()
    np.testing.assert_array_equal(lines.noise.C, periodic_lines(recording).noise.C)


def test_a_ringing_mode_is_not_taken_for_a_wrong_clock(rings: Recording) -> None:
    samples, alike, gain = checks._common_delay([checks._alike(t.theta, PRTS.samples) for t in rings.trials])
    assert abs(samples) / PRTS.rate_hz > checks.CLOCK_S
    assert min(alike / checks.CLOCK_ALIKE, gain / checks.CLOCK_GAIN) > 1
    checks.check(rings)


def test_trials_of_unequal_noise_and_weight_get_the_covariance_of_their_mean() -> None:
    recordings = [recorded(seed, amplitudes=(3.0, 5.0), noise=(1.0, 4.0)) for seed in range(2)]
    as_assumed = [surprise(periodic_lines(r)) for r in recordings]
    lines = [measure(r) for r in recordings]
    assert max(as_assumed) < 0.05
    assert min(map(surprise, lines)) > 0.0
    assert all("trial 2 has" in x.notes[0] for x in lines)


def test_the_power_of_a_trial_is_the_one_it_was_made_with() -> None:
    power = trial_power(periodic_lines(recorded(3, noise=(1.0, 2.0))))
    assert power is not None
    ratio = np.median(power[1] / power[0])
    assert ratio == pytest.approx(4.0, rel=0.2)
    assert ratio > UNEQUAL


def test_one_repeat_of_a_trial_is_not_judged() -> None:
    lines = periodic_lines(recorded(4))
    one = lines.subset(np.flatnonzero(lines.cycle == 1))
    assert not scatter(one).sharp.any()
    assert trial_power(one) is None
    assert with_scatter(one) is one


def test_the_example_counts_the_notes() -> None:
    example = module("unusual_noise")
    assert example.noted(example.sound, "the cycles differ", 1).startswith("0 of 1,")
    assert example.noted(example.unequal, "the noise of trial", 1).startswith("1 of 1,")
