"""Sway as an exact steady state: products in the frequency domain over a whole record.

No solver, no transient, no history: a record of n samples is one exact period of a periodic process, so its Fourier
coefficients are those of the input times the closed-form response at the record's frequencies. The DC coefficient is
left zero (the noise has none and the stimuli are zero-mean).
"""

from __future__ import annotations

from functools import reduce

import numpy as np

from mcstudy.errors import InputError
from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import MeasurementNoise, Noise, record, record_frequencies, white_coefficients
from mcstudy.stance.response import frf, noise_response


def _require_sources(model: Model, noise: Noise) -> None:
    """Raise `InputError` unless there is a noise for each angle that is sensed."""
    if noise.sources != model.n_rows:
        raise InputError(
            f"noise: expected one for each angle of {model.name} ({', '.join(model.angles)}), got {noise.sources}"
        )


class NoiseSway:
    """Random records of the outputs without a stimulus, with the response evaluated once.

    Parameters
    ----------
    model, theta: the closed loop and its parameters, (P,).
    noise: sensor noise, on each of the model's S angles.
    n_samples, rate_hz: length and sampling rate of the records.
    measured: noise of the recording itself, drawn after the sensor noise.
    """

    def __init__(
        self,
        model: Model,
        theta: np.ndarray,
        noise: Noise,
        n_samples: int,
        rate_hz: float,
        measured: MeasurementNoise | None = None,
    ) -> None:
        _require_sources(model, noise)
        self.n_samples, self.rate_hz, self.measured = n_samples, rate_hz, measured
        f = record_frequencies(n_samples, rate_hz)
        shaping = np.zeros((f.size, model.n_outputs, noise.sources), dtype=complex)
        shaping[1:] = noise_response(model, theta, f[1:])
        if n_samples % 2 == 0:
            shaping[-1].imag = 0.0
        shaping *= noise.coefficient_scale(n_samples, rate_hz)[:, None, :]
        self._columns = [column.copy() for column in np.moveaxis(shaping, -1, 0)]

    def coefficients(self, rng: np.random.Generator) -> np.ndarray:
        """Fourier coefficients of a random record, in the outputs' units, (n_samples // 2 + 1, Y) complex."""
        white = white_coefficients(rng, self.n_samples, len(self._columns))
        total = reduce(np.add, [column * white[:, s : s + 1] for s, column in enumerate(self._columns)])
        return total if self.measured is None else total + self.measured.coefficients(rng, self.n_samples)

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """A random record, in the outputs' units, (n_samples, Y)."""
        return record(self.coefficients(rng), self.n_samples)


def sway_psd(
    model: Model, theta: np.ndarray, noise: Noise, f: np.ndarray, measured: np.ndarray | None = None
) -> np.ndarray:
    """One-sided cross-spectral density of what noise evokes at ``f`` > 0 (Hz, (N,)), (N, Y, Y) Hermitian.

    In the squares of the outputs' units (rad) per Hz. Entry (i, j) is the density of output i times the conjugate of
    output j (derived). ``measured``: density of the noise of the recording itself, (Y, Y), which is added.
    """
    _require_sources(model, noise)
    response = noise_response(model, theta, f)
    density = np.einsum("nis,ns,njs->nij", response, noise.psd(f), response.conj())
    return density if measured is None else density + measured


def stimulus_sway(model: Model, theta: np.ndarray, waveform: np.ndarray, rate_hz: float) -> np.ndarray:
    """Steady state of the outputs over one period of a zero-mean stimulus (n,), in their units, (n, Y)."""
    waveform = np.asarray(waveform, dtype=float)
    from scipy import fft  # only here: to read the status of a cube needs no SciPy

    coefficients = fft.rfft(waveform, norm="forward")
    sway = np.zeros((coefficients.size, model.n_outputs), dtype=complex)
    f = record_frequencies(waveform.size, rate_hz)[1:]
    sway[1:] = frf(model, theta, f) * coefficients[1:, None]
    return record(sway, waveform.size)
