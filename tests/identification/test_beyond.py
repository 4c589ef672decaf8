"""What is said beyond the estimates agrees with oracles that know nothing of it."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.effect_library.protocol import Protocol, simulate_recording
from mcstudy.fitting.penalised import whiten
from mcstudy.fitting.problem import Data
from mcstudy.identification.belief import gap_found
from mcstudy.identification.paper_cost import averaged, paper_estimate
from mcstudy.identification.sway import predicted_sway
from mcstudy.identification.trades import bodies, elongations
from mcstudy.models.quantities import expression
from mcstudy.stance.noise import SensorNoise
from mcstudy.stance.response import frf
from mcstudy.stance.stability import growth_rate, roots_chebyshev
from mcstudy.stance.stimulus import Prts

Fits = dict[str, mc.FitResult]


def test_the_bodies_of_a_valley_fit_as_well_and_differ_as_it_says(fits: Fits) -> None:
    """Their deviance, computed here from the responses, is below the threshold of the intervals."""
    seen = 0
    for r in fits.values():
        data, everybody = Data.of(r.lines), bodies(r.estimates)
        most = max(e.profile.rise.max() for e in r.estimates)
        for v in r.valleys:
            at = [r.model.names.index(n) for n in v.names]
            for end in (v.first, v.second):
                body = everybody[np.abs(everybody[:, at] - end).sum(axis=1).argmin()]
                np.testing.assert_array_equal(body[at], end)
                residual = whiten(data.weight, data.y - frf(r.model, body, data.f))
                assert residual @ residual - r.chi2 <= most + 1e-6
            for c in v.combinations:
                q, opposite = expression(r.model, c.name), expression(r.model, c.opposite)
                spread = [np.ptp([x.value(b) for b in everybody]) for x in (q, opposite)]
                assert spread[1] > 3 * spread[0], c
                seen += 1
    assert seen > 4


def test_the_loop_is_as_stable_as_the_eigenvalues_of_the_delay_equation_say(fits: Fits) -> None:
    for r in (fits["good"], fits["low fmax"]):
        assert r.stability is not None
        everybody = bodies(r.estimates)
        rate = growth_rate(r.model, everybody)
        chosen = everybody[[rate.argmin(), rate.argmax(), *range(0, len(everybody), 60)]]
        growth = [float(roots_chebyshev(r.model, b, 40)[0].real) for b in (r.theta, *chosen)]
        assert growth[:3] == pytest.approx([r.stability.growth, r.stability.low, r.stability.high], abs=1e-6)
        assert r.stability.low - 1e-6 <= min(growth) <= max(growth) <= r.stability.high + 1e-6


def test_predicted_sway_is_that_of_a_simulation_in_time(fits: Fits) -> None:
    """Without and with sensor noise of the fitted level, cycle by cycle, at the frequencies of the fit."""
    r = fits["good"]
    assert r.sway is not None
    assert r.sway.noise_levels is not None
    waveform = Prts()
    period, rate = waveform.waveform().size, waveform.rate_hz
    f = np.fft.rfftfreq(period, 1 / rate)
    excited = np.isin(np.arange(f.size), r.lines.harmonic)

    def rms(noise: SensorNoise, amplitude: float, cycles: int, keep: np.ndarray) -> np.ndarray:
        protocol = Protocol(waveform=waveform, amplitudes=(amplitude,), cycles=cycles, noise=noise)
        trial = simulate_recording(protocol, r.theta, np.random.default_rng(1), model=r.model).trials[0]
        spectra = np.fft.rfft(trial.theta[period:].reshape(-1, period, 2), axis=1, norm="forward")
        return np.asarray(np.rad2deg(np.sqrt(2 * (np.abs(spectra[:, keep]) ** 2).sum(axis=1).mean(axis=0))))

    silent = rms(SensorNoise((0.0, 0.0)), 5.0, 3, excited)
    np.testing.assert_allclose([a.stimulus for a in r.sway.angles], silent, rtol=0.02)
    first, second = SensorNoise().psd_deg2_hz
    levels = SensorNoise((first * r.sway.noise_levels[0], second * r.sway.noise_levels[1]))
    noisy = rms(levels, 1e-3, 16, (f > 0) & (f <= r.lines.f[-1] * 1.001))
    np.testing.assert_allclose([a.noise for a in r.sway.angles], noisy, rtol=0.35)  # fifteen cycles of noise


def test_at_the_true_body_predicted_sway_and_noise_are_the_measured_ones(fits: Fits) -> None:
    r = fits["good"]
    s = predicted_sway(r.model, r.model.truth, r.model.truth[None], r.lines)
    assert s is not None
    assert s.noise_levels is not None
    for a in s.angles:
        assert abs(a.stimulus - a.measured) < 3 * a.measured_se
        assert a.noise is not None
        assert a.noise == pytest.approx(a.noise_measured, rel=0.35)
    np.testing.assert_allclose(s.noise_levels, 1, atol=0.8)


def test_the_gap_is_that_of_the_diagnosis(fits: Fits) -> None:
    r = fits["effect missing"]
    assert isinstance(r.recording, mc.Recording)
    d = mc.diagnose(r.recording, fast=True, fmax=3.0)
    assert r.gap is not None
    assert (r.gap.p_value, r.gap.p_least) == (d.p_value, d.p_least)
    assert gap_found(r.lines, r.recording.base_model(), 0)[0] == r.gap


def test_the_papers_cost_without_noise_fits_its_points(fits: Fits) -> None:
    """Points of few lines: the mean over neighbouring lines is not the response at their middle."""
    r = fits["low fmax"]
    model, lines = r.model, r.lines
    clean = replace(lines, y=frf(model, model.truth, lines.f))
    found = paper_estimate(model, model, clean, 0)
    points = averaged(clean)
    assert found is not None
    assert points is not None
    bands, y = points
    misfit = np.abs(frf(model, found, bands.f) / y - 1)
    assert misfit.max() < 0.03
    assert (np.abs(frf(model, model.truth, bands.f) / y - 1) ** 2).sum() >= (misfit**2).sum() * (1 - 1e-9)
    assert r.paper is not None


def test_twice_the_amplitude_narrows_intervals_as_forecast(fits: Fits) -> None:
    """The example that compares all forecasts with refits, at its smallest."""
    example = runpy.run_path(str(Path(__file__).parents[2] / "pipelines" / "validation" / "interval_forecasts.py"))
    r = fits["good"]
    twice = example["refit"](example["record"](11, amplitude=10.0, cycles=6), 3.0)
    log_ratio = [np.log((twice[f.name].high - twice[f.name].low) / 2 / f.amplitude) for f in r.forecasts if not f.rough]
    assert len(log_ratio) >= 4
    assert np.exp(np.mean(log_ratio)) == pytest.approx(1, abs=0.3)


def test_a_parameter_that_is_the_same_in_all_bodies_trades_for_none() -> None:
    theta = np.column_stack([np.linspace(1, 2, 9), np.full(9, 3.0), 5 - np.linspace(1, 2, 9)])
    assert [pair for pair, _ in elongations(theta, np.ones(3), [True] * 3)] == [(0, 2)]
