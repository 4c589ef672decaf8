"""The transient that a cycle leaks: taken off every line, told by the even ones alone, paid for in the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from mcstudy.effect_library.protocol import Protocol, draw_case, simulate_recording
from mcstudy.recordings.recording import Recording
from mcstudy.spectra.even_lines import EvenLineCovariance
from mcstudy.spectra.lines import Lines
from mcstudy.spectra.measure import measure
from mcstudy.spectra.transient import FIRST_LINE, TransientMean
from mcstudy.stance.body import two_segment
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.stimulus import Prts

MODEL = two_segment()
SHORT = Prts(stages=6)
LINES = np.arange(1, 242, 2)
TOP = 301


@pytest.fixture(scope="module")
def estimator() -> EvenLineCovariance:
    return EvenLineCovariance(LINES, TOP - 1)


def white(rng: np.random.Generator, records: int) -> np.ndarray:
    x = rng.standard_normal((2, records, TOP, 2))
    return (x[0] + 1j * x[1]) / np.sqrt(2 * np.maximum(np.arange(TOP), 1.0))[:, None]


def fallen(rng: np.random.Generator, cycles: int) -> Recording:
    """Sway of a body whose slowest motion lasts for several cycles, and no noise."""
    theta, sizes = draw_case(MODEL, ["activation_dynamics"], np.random.default_rng(3), spread=0.05)
    protocol = Protocol(waveform=SHORT, amplitudes=(5.0,), cycles=cycles, noise=SensorNoise((0.0, 0.0)))
    return simulate_recording(protocol, theta, rng, effects=["activation_dynamics"], sizes=sizes)


def without(monkeypatch: pytest.MonkeyPatch, recording: Recording, discard: int) -> Lines:
    with monkeypatch.context() as patch:
        patch.setattr(TransientMean, "removed_from", lambda _self, theta, _trials: theta)
        return measure(recording, discard=discard)


def test_a_motion_that_outlasts_the_cycle_is_taken_off(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = fallen(np.random.default_rng(1), 6)
    settled = measure(fallen(np.random.default_rng(1), 16), discard=14).y
    left, taken = without(monkeypatch, recording, 4), measure(recording, discard=4)
    assert np.abs(taken.y / settled - 1).max() < np.abs(left.y / settled - 1).max() / 2


def test_a_response_at_odd_lines_is_left_as_it_is(estimator: EvenLineCovariance) -> None:
    rng = np.random.default_rng(5)
    noise, response = white(rng, 6), white(rng, 1)
    response[:, ::2] = 0.0
    mean = TransientMean(estimator)
    trials = noise.mean(axis=0, keepdims=True)
    more = mean.removed_from(noise + response, trials) - mean.removed_from(noise, trials)
    np.testing.assert_allclose(more, np.broadcast_to(response, more.shape), atol=1e-12)


def test_lines_below_the_first_are_left_as_they_are(estimator: EvenLineCovariance) -> None:
    noise = white(np.random.default_rng(6), 3)
    out = TransientMean(estimator).removed_from(noise, noise)
    np.testing.assert_array_equal(out[:, :FIRST_LINE], noise[:, :FIRST_LINE])
    assert (out[:, FIRST_LINE : LINES[-1]] != noise[:, FIRST_LINE : LINES[-1]]).all()


def test_the_understatement_is_what_independent_lines_show(estimator: EvenLineCovariance) -> None:
    mean = TransientMean(estimator)
    noise = white(np.random.default_rng(7), 4000)
    out = mean.removed_from(noise, noise[:200])
    power = (np.abs(out) ** 2).mean(axis=(0, 2)) * np.maximum(np.arange(TOP), 1.0)
    at = np.arange(FIRST_LINE + 1, 200, 2)
    found = power[at] / ((power[at - 1] + power[at + 1]) / 2)
    stated = mean.understatement(at)
    assert stated.max() > 1.04
    assert (mean.understatement(np.arange(1, FIRST_LINE, 2)) == 1.0).all()
    np.testing.assert_allclose(found[:10].mean(), stated[:10].mean(), rtol=0.01)
    np.testing.assert_allclose(found[10:].mean(), stated[10:].mean(), rtol=0.005)


def test_short_recordings_have_less_noise_for_it_and_their_covariance_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the quieter combination of angles; and the errors of the FRF are still what their covariance says."""
    quiet, squares = [], []
    for seed in range(12):
        protocol = Protocol(amplitudes=(5.0, 5.0), cycles=3)
        recording = simulate_recording(protocol, MODEL.truth, np.random.default_rng(seed))
        before, after = without(monkeypatch, recording, 1), measure(recording)
        assert after.harmonic is not None
        inside = (after.harmonic > 40) & (after.harmonic < 160)
        whitener = np.linalg.inv(np.linalg.cholesky(after.noise.C))
        expected = frf(MODEL, MODEL.truth, after.f)
        errors = [np.einsum("nij,nj->ni", whitener, lines.y - expected)[inside] for lines in (before, after)]
        quiet.append([np.sum(np.abs(e[:, 1]) ** 2) for e in errors])
        squares.append((np.abs(errors[1]) ** 2 * ((after.noise.dof - 2) / after.noise.dof)[inside, None]).mean())
    was, now = np.sum(quiet, axis=0)
    assert 0.7 < now / was < 0.95
    assert np.mean(squares) == pytest.approx(1.0, abs=4 * np.std(squares) / np.sqrt(len(squares)))
