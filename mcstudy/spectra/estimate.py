"""FRFs with their covariance: from simulated noise on an ideal response, or from a periodic recording.

- `SpectralExperiment` is the paper's "sim" FRF (Goodworth & Peterka 2018, Methods): ideal response plus the spectrum of
  noise-evoked sway, over the ideal stimulus spectrum, averaged over the lines of each point. One noise realization
  is used for all stimulus amplitudes, because the noise does not depend on the amplitude.
- `frf_from_recording` estimates the same quantity from measured sway.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mcstudy.errors import InputError, RecordingError
from mcstudy.spectra import periods
from mcstudy.spectra.bands import Bands
from mcstudy.spectra.even_lines import EvenLineCovariance
from mcstudy.spectra.loop_covariance import LoopCovariance
from mcstudy.stance.feedback import Model
from mcstudy.stance.line_stimulus import Stimulus
from mcstudy.stance.noise import MeasurementNoise, Noise
from mcstudy.stance.response import frf, noise_response
from mcstudy.stance.simulate_spectral import NoiseSway, sway_psd


@dataclass(frozen=True)
class SpectrumNoise:
    """Noise on the mean spectrum of one realization, at the lines of the bands.

    Attributes
    ----------
    coefficients: Fourier coefficients of the Y outputs, rad, (L, Y) complex.
    covariance: their covariance estimated from the even lines, rad^2, (L, Y, Y) complex.
    even: Fourier coefficients at the even lines that `SpectralExperiment.through_loop` averages, (E, Y) complex.
    """

    coefficients: np.ndarray
    covariance: np.ndarray
    even: np.ndarray


@dataclass(frozen=True)
class FrfEstimate:
    """An FRF at N frequency points.

    Attributes
    ----------
    f: frequencies, Hz, (N,).
    frf: FRFs of the Y outputs, rad per unit of stimulus, (N, Y) complex.
    covariance: E[r r^H] of their errors, (N, Y, Y) complex.
    dof: equivalent independent complex lines behind each covariance, averaged over the point's lines, (N,).
    """

    f: np.ndarray
    frf: np.ndarray
    covariance: np.ndarray
    dof: np.ndarray


def frf_from_noise(
    response: np.ndarray, noise: SpectrumNoise, stimulus: np.ndarray, bands: Bands
) -> tuple[np.ndarray, np.ndarray]:
    """Band means of H + N/U and their covariance: (N, Y) and (N, Y, Y).

    Parameters
    ----------
    response: ideal FRF at the bands' lines, (L, Y).
    noise: noise on the mean spectrum at those lines.
    stimulus: Fourier coefficients of the stimulus at those lines, (L,).
    bands: the points.
    """
    data = bands.average(response + noise.coefficients / stimulus[:, None])
    return data, bands.average_covariance(noise.covariance / np.abs(stimulus[:, None, None]) ** 2)


class SpectralExperiment:
    """The paper's experiment on one subject, in the frequency domain; one object generates many realizations.

    Parameters
    ----------
    model, theta: the subject and its true parameters, (P,).
    stimulus: periodic, odd lines only; its amplitude is not used, because every call states one.
    noise: sensor noise.
    bands: frequency points, on harmonics of the stimulus' period.
    cycles, discard: recorded cycles, and how many are dropped at the start.
    spectrum: `periods.raw` (the paper) or `periods.ramp_removed`.
    measured: noise of the recording itself.

    Raises `InputError` when the bands do not fit the stimulus or no cycle is left.
    """

    def __init__(
        self,
        model: Model,
        theta: np.ndarray,
        stimulus: Stimulus,
        noise: Noise,
        bands: Bands,
        cycles: int = 6,
        discard: int = 1,
        spectrum: periods.Spectrum = periods.raw,
        measured: MeasurementNoise | None = None,
    ) -> None:
        check_period(bands, stimulus.period_s)
        if not 0 <= discard < cycles:
            raise InputError(f"cycles: expected more than the {discard} discarded, got {cycles}")
        self.bands, self.discard, self.spectrum = bands, discard, spectrum
        self.period = stimulus.samples
        self.true_frf = frf(model, theta, bands.f)
        """The closed form at the points' frequencies, (N, Y): what the paper's noise-free fits use as data."""
        self._response = frf(model, theta, bands.line_f)
        self._unit_stimulus = replace(stimulus, amplitude=1.0).coefficients()[bands.lines]
        self._sway = NoiseSway(model, theta, noise, cycles * stimulus.samples, stimulus.rate_hz, measured)
        self._covariance = EvenLineCovariance(bands.lines, stimulus.samples // 2)
        self._loop_covariance = LoopCovariance(bands.lines, stimulus.samples // 2)
        self._model, self._theta, self._noise, self._measured = model, theta, noise, measured
        self._rate_hz, self._duration_s = stimulus.rate_hz, (cycles - discard) * stimulus.period_s
        self.dof = bands.average(self._covariance.dof[:, None])[:, 0]
        """Equivalent independent complex lines behind each point's covariance, (N,)."""

    def realization(self, rng: np.random.Generator) -> SpectrumNoise:
        """One realization of the noise, used for all amplitudes."""
        coefficients = self.spectrum(self._sway.sample(rng), self.period, self.discard)
        even = coefficients[self._loop_covariance.even]
        return SpectrumNoise(coefficients[self.bands.lines], self._covariance(coefficients), even)

    def through_loop(self, noise: SpectrumNoise, theta: np.ndarray) -> SpectrumNoise:
        """The same noise with its covariance re-estimated through a loop with parameters ``theta`` (a first fit), (P,).

        See `mcstudy.spectra.loop_covariance`; for noise of the loop alone, and as many outputs as sensed angles.
        """
        at_even = noise_response(self._model, theta, self._loop_covariance.even / self.bands.period_s)
        at_lines = noise_response(self._model, theta, self.bands.line_f)
        return replace(noise, covariance=self._loop_covariance(noise.even, at_even, at_lines))

    def known(self, noise: SpectrumNoise) -> SpectrumNoise:
        """The same noise with its true covariance at every line, from theory: without leakage."""
        return replace(noise, covariance=self._true_covariance)

    @cached_property
    def _true_covariance(self) -> np.ndarray:
        f, recorded = self.bands.line_f, self._measured
        density = None if recorded is None else recorded.psd(self._rate_hz)
        if recorded is not None and self.spectrum is periods.ramp_removed:
            density = recorded.psd_without_ramp(f, self._duration_s, self._rate_hz)
        return sway_psd(self._model, self._theta, self._noise, f, density) / (2 * self._duration_s)

    def noise_free(self) -> np.ndarray:
        """Band means of the ideal FRF, (N, Y): differs from `true_frf` only by the averaging."""
        return self.bands.average(self._response)

    def frf(self, noise: SpectrumNoise, amplitude: float) -> tuple[np.ndarray, np.ndarray]:
        """The "sim" FRF (N, Y) and its covariance (N, Y, Y) at a stimulus amplitude (in the stimulus' convention)."""
        return frf_from_noise(self._response, noise, amplitude * self._unit_stimulus, self.bands)


def check_period(bands: Bands, period_s: float) -> None:
    """Raise `InputError` unless the bands are harmonics of this period (s)."""
    if not np.isclose(bands.period_s, period_s, rtol=1e-6, atol=0.0):
        raise InputError(f"bands: expected harmonics of the stimulus' {period_s:g} s cycle, got {bands.period_s:g} s")


def frf_from_recording(
    theta: np.ndarray,
    stimulus: np.ndarray,
    rate_hz: float,
    bands: Bands,
    discard: int = 1,
    spectrum: periods.Spectrum = periods.ramp_removed,
) -> FrfEstimate:
    """FRFs from sway recorded under a periodic stimulus.

    Parameters
    ----------
    theta: what was recorded, (n, Y), or (T, n, Y) for trials with the same stimulus, whose spectra are averaged.
    stimulus: the stimulus, (n,), or (T, n).
    rate_hz: sampling rate, Hz; the bands' period must be a whole number of samples.
    bands: frequency points.
    discard: cycles dropped at the start.
    spectrum: `periods.ramp_removed` or `periods.raw`, applied to the sway (the stimulus is periodic).

    Raises `RecordingError` when the period does not fit the rate, the record is too short, or the stimulus has no
    power at a line of the bands.
    """
    theta, stimulus = np.asarray(theta, dtype=float), np.asarray(stimulus, dtype=float)
    period = round(bands.period_s * rate_hz)
    if abs(period - bands.period_s * rate_hz) > 1e-6 * period:
        raise RecordingError(f"recording rate_hz: a period of {bands.period_s:g} s is no whole number of samples")
    trials = theta[None] if theta.ndim == 2 else theta
    inputs = np.atleast_2d(stimulus)
    if trials.shape[1] != inputs.shape[1]:
        raise RecordingError(f"recording: sway has {trials.shape[1]} samples, the stimulus {inputs.shape[1]}")
    sway = np.stack([spectrum(trial, period, discard) for trial in trials])
    drive = np.mean([periods.raw(u, period, discard) for u in inputs], axis=0)
    if bands.lines.max() >= drive.size:
        raise RecordingError(f"recording rate_hz: harmonic {bands.lines.max()} lies above half the sampling rate")
    u = drive[bands.lines]
    silent = np.abs(u) <= 1e-6 * np.abs(drive[1:]).max()
    if silent.any():
        where = bands.line_f[silent][0]
        raise RecordingError(f"recording stimulus: no power at {where:.3f} Hz, a line of a {bands.period_s:g} s period")
    estimator = EvenLineCovariance(bands.lines, drive.size - 1)
    silence = np.zeros((u.size, sway.shape[-1]))
    noise = SpectrumNoise(silence, estimator(sway), silence[:0])
    data, covariance = frf_from_noise(sway.mean(axis=0)[bands.lines] / u[:, None], noise, u, bands)
    dof = bands.average(estimator.dof[:, None])[:, 0] * len(trials)
    return FrfEstimate(bands.f, data, covariance, dof)
