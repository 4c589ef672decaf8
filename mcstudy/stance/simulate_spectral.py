"""Sway as an exact steady state: products in the frequency domain over a whole record.

No solver, no transient, no history: a record of n samples is one exact period of a periodic process, so its Fourier
coefficients are those of the input times the closed-form response at the record's frequencies. The DC coefficient is
left zero (the noise has none and the stimuli are zero-mean).
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from mcstudy.stance.feedback import Model
from mcstudy.stance.noise import Noise, record, record_frequencies, white_coefficients
from mcstudy.stance.response import frf, noise_response


class NoiseSway:
    """Random sway evoked by sensor noise alone, with the response evaluated once.

    Parameters
    ----------
    model, theta: the closed loop and its parameters, (P,).
    noise: sensor noise.
    n_samples, rate_hz: length and sampling rate of the records.
    """

    def __init__(self, model: Model, theta: np.ndarray, noise: Noise, n_samples: int, rate_hz: float) -> None:
        self.n_samples, self.rate_hz = n_samples, rate_hz
        f = record_frequencies(n_samples, rate_hz)
        shaping = np.zeros((f.size, 2, 2), dtype=complex)
        shaping[1:] = noise_response(model, theta, f[1:])
        if n_samples % 2 == 0:
            shaping[-1].imag = 0.0
        shaping *= noise.coefficient_scale(n_samples, rate_hz)[:, None, :]
        self._columns = shaping[..., 0].copy(), shaping[..., 1].copy()

    def coefficients(self, rng: np.random.Generator) -> np.ndarray:
        """Fourier coefficients of a random record of sway, rad, (n_samples // 2 + 1, 2) complex."""
        white = white_coefficients(rng, self.n_samples)
        first, second = self._columns
        return first * white[:, :1] + second * white[:, 1:]

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """A random record of sway, rad, (n_samples, 2)."""
        return record(self.coefficients(rng), self.n_samples)


def sway_psd(model: Model, theta: np.ndarray, noise: Noise, f: np.ndarray) -> np.ndarray:
    """One-sided cross-spectral density of noise-evoked sway at ``f`` > 0 (Hz, (N,)), rad^2/Hz, (N, 2, 2) Hermitian.

    Entry (i, j) is the density of angle i times the conjugate of angle j (derived).
    """
    response = noise_response(model, theta, f)
    return np.einsum("nis,ns,njs->nij", response, noise.psd(f), response.conj())


def stimulus_sway(model: Model, theta: np.ndarray, waveform: np.ndarray, rate_hz: float) -> np.ndarray:
    """Steady-state sway over one period of a zero-mean stimulus (n,), rad, (n, 2)."""
    waveform = np.asarray(waveform, dtype=float)
    coefficients = fft.rfft(waveform, norm="forward")
    sway = np.zeros((coefficients.size, 2), dtype=complex)
    f = record_frequencies(waveform.size, rate_hz)[1:]
    sway[1:] = frf(model, theta, f) * coefficients[1:, None]
    return record(sway, waveform.size)
