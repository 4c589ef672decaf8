"""Sensor noise: pink through a first-order low-pass, or with densities from a table.

One-sided power spectral density of source i at frequency f > 0

    S_i(f) = S_i(f_ref) * (f_ref / f)^a * (1 + (f_ref / f_c)^2) / (1 + (f / f_c)^2)

with a = 1 (pink) unless said otherwise, and S_i(f_ref) given at f_ref = 0.5 Hz for the noise *after* the filter
(Goodworth & Peterka 2018, Methods). The two sources, on theta1 and theta2, are independent Gaussian processes.

PSD convention: one-sided, so the variance of a record is the integral of S over f > 0. A record of duration T has
Fourier coefficients c_m = (1/n) sum x[n] exp(-2 pi i m n / n_samples) with E|c_m|^2 = S(m/T) / (2 T); the DC
coefficient is zero. Synthesis draws the coefficients themselves, so a record is one exact period of its own length.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from scipy import fft

from mcstudy.errors import InputError

DEG2_TO_RAD2 = (np.pi / 180.0) ** 2


def record_frequencies(n_samples: int, rate_hz: float) -> np.ndarray:
    """Frequencies of the coefficients of a record, Hz, (n_samples // 2 + 1,)."""
    return np.arange(n_samples // 2 + 1) * (rate_hz / n_samples)


def white_coefficients(rng: np.random.Generator, n_samples: int) -> np.ndarray:
    """Independent unit-variance complex Gaussian coefficients, (n_samples // 2 + 1, 2), E|w|^2 = 1.

    DC is zero and the Nyquist coefficient of an even record is real, as a real record demands.
    """
    n_lines = n_samples // 2 + 1
    draws = rng.standard_normal((n_lines, 4)).view(np.complex128)
    draws *= np.sqrt(0.5)
    draws[0] = 0.0
    if n_samples % 2 == 0:
        draws[-1] = np.sqrt(2.0) * draws[-1].real
    return draws


class Noise(ABC):
    """Noise on the two sensed angles: independent Gaussian processes with given spectra."""

    @abstractmethod
    def psd(self, f: np.ndarray) -> np.ndarray:
        """One-sided PSD at frequencies ``f`` > 0 (Hz, (N,)), rad^2/Hz, (N, 2); zero at f = 0."""

    def coefficient_scale(self, n_samples: int, rate_hz: float) -> np.ndarray:
        """Root-mean-square magnitude of the coefficients of a record, rad, (n_samples // 2 + 1, 2)."""
        return np.sqrt(self.psd(record_frequencies(n_samples, rate_hz)) * (rate_hz / n_samples / 2))

    def coefficients(self, rng: np.random.Generator, n_samples: int, rate_hz: float) -> np.ndarray:
        """Random Fourier coefficients of a record, rad, (n_samples // 2 + 1, 2) complex."""
        return self.coefficient_scale(n_samples, rate_hz) * white_coefficients(rng, n_samples)

    def sample(self, rng: np.random.Generator, n_samples: int, rate_hz: float) -> np.ndarray:
        """A random record, rad, (n_samples, 2); zero mean."""
        return record(self.coefficients(rng, n_samples, rate_hz), n_samples)


@dataclass(frozen=True)
class SensorNoise(Noise):
    """Sensor noise with the shape in the module's text.

    Attributes
    ----------
    psd_deg2_hz: one-sided PSD of the noise on theta1 and theta2 at ``reference_hz``, deg^2/Hz.
    corner_hz: corner of the low-pass, Hz.
    reference_hz: frequency at which the PSD is given, Hz.
    exponent: the PSD falls as f^-exponent before the low-pass: 0 white, 1 pink, 2 brown.

    Raises `InputError` when a field is not usable.
    """

    psd_deg2_hz: tuple[float, float] = (4e-4, 7e-5)
    corner_hz: float = 0.15
    reference_hz: float = 0.5
    exponent: float = 1.0

    def __post_init__(self) -> None:
        if len(self.psd_deg2_hz) != 2 or not all(np.isfinite(p) and p >= 0 for p in self.psd_deg2_hz):
            raise InputError(f"noise psd_deg2_hz: expected two non-negative numbers, got {self.psd_deg2_hz!r}")
        if not np.isfinite(self.exponent):
            raise InputError(f"noise exponent: expected a finite number, got {self.exponent!r}")
        for name in ("corner_hz", "reference_hz"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"noise {name}: expected a positive number, got {value!r}")

    def psd(self, f: np.ndarray) -> np.ndarray:
        """One-sided PSD at frequencies ``f`` > 0 (Hz, (N,)), rad^2/Hz, (N, 2); zero at f = 0."""
        f = np.asarray(f, dtype=float)
        shape = np.zeros_like(f)
        positive = f > 0
        fp = f[positive]
        low_pass = (1 + (self.reference_hz / self.corner_hz) ** 2) / (1 + (fp / self.corner_hz) ** 2)
        shape[positive] = (self.reference_hz / fp) ** self.exponent * low_pass
        return shape[:, None] * (np.array(self.psd_deg2_hz) * DEG2_TO_RAD2)


@dataclass(frozen=True)
class TabulatedNoise(Noise):
    """Sensor noise with measured spectra.

    Attributes
    ----------
    f_hz: (M,), frequencies above zero, ascending, Hz. theta1, theta2: (M,), one-sided PSD there, positive, deg^2/Hz.
    Between two frequencies the PSD is a straight line in logarithms; beyond them it stays what it is at the last one.

    Raises `InputError` when a field is not usable.
    """

    f_hz: tuple[float, ...]
    theta1: tuple[float, ...]
    theta2: tuple[float, ...]

    def __post_init__(self) -> None:
        f = np.asarray(self.f_hz)
        if not f.size or not np.isfinite(f).all() or f[0] <= 0 or (np.diff(f) <= 0).any():
            raise InputError("noise table.f_hz: expected frequencies above zero, ascending, each once")
        for name in ("theta1", "theta2"):
            values = np.asarray(getattr(self, name))
            if values.shape != f.shape or not (np.isfinite(values) & (values > 0)).all():
                raise InputError(f"noise table.{name}: expected {f.size} positive numbers, one per frequency")

    def psd(self, f: np.ndarray) -> np.ndarray:
        """One-sided PSD at frequencies ``f`` > 0 (Hz, (N,)), rad^2/Hz, (N, 2); zero at f = 0."""
        f = np.asarray(f, dtype=float)
        out = np.zeros((*f.shape, 2))
        at = np.log(f[f > 0])
        for k, values in enumerate((self.theta1, self.theta2)):
            out[f > 0, k] = np.exp(np.interp(at, np.log(self.f_hz), np.log(values))) * DEG2_TO_RAD2
        return out


SILENT = SensorNoise((0.0, 0.0))
"""No noise at all."""


def record(coefficients: np.ndarray, n_samples: int) -> np.ndarray:
    """Time record (n_samples, 2) of two channels from their Fourier coefficients (n_samples // 2 + 1, 2).

    Both channels share one complex transform (channel 1 as its real part, channel 2 as its imaginary part): record
    lengths such as 6 x 8744 hold the prime 1093, for which a transform is the costliest step of a realization.
    """
    n_lines = n_samples // 2 + 1
    spectrum = np.empty(n_samples, dtype=np.complex128)
    first, second = coefficients[:, 0], coefficients[:, 1]
    mirrored = slice(n_samples - n_lines, 0, -1)  # coefficients 1 .. below Nyquist, descending
    spectrum[:n_lines] = first + 1j * second
    if n_samples % 2 == 0:  # only the real part of a Nyquist coefficient shows in a real record
        spectrum[n_lines - 1] = first[-1].real + 1j * second[-1].real
    spectrum[n_lines:] = np.conj(first[mirrored]) + 1j * np.conj(second[mirrored])
    packed = fft.ifft(spectrum, norm="forward", overwrite_x=True)
    return packed.view(np.float64).reshape(n_samples, 2)
