"""Sensor noise: pink through a first-order low-pass, or with densities from a table.

One-sided power spectral density of source i at frequency f > 0

    S_i(f) = S_i(f_ref) * (f_ref / f)^a * (1 + (f_ref / f_c)^2) / (1 + (f / f_c)^2)

with a = 1 (pink) unless said otherwise, and S_i(f_ref) given at f_ref = 0.5 Hz for the noise *after* the filter
(Goodworth & Peterka 2018, Methods). The sources, one on each sensed angle, are independent Gaussian processes.
Densities are held in deg^2/Hz and given out in rad^2/Hz; for angles in another unit see `mcstudy.study.group`.

Sensor noise enters the loop. Measurement noise (`MeasurementNoise`) does not: it is added to what is recorded.

PSD convention: one-sided, so the variance of a record is the integral of S over f > 0. A record of duration T has
Fourier coefficients c_m = (1/n) sum x[n] exp(-2 pi i m n / n_samples) with E|c_m|^2 = S(m/T) / (2 T); the DC
coefficient is zero. Synthesis draws the coefficients themselves, so a record is one exact period of its own length.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mcstudy.errors import InputError

DEG2_TO_RAD2 = (np.pi / 180.0) ** 2


def record_frequencies(n_samples: int, rate_hz: float) -> np.ndarray:
    """Frequencies of the coefficients of a record, Hz, (n_samples // 2 + 1,)."""
    return np.arange(n_samples // 2 + 1) * (rate_hz / n_samples)


def white_coefficients(rng: np.random.Generator, n_samples: int, sources: int = 2) -> np.ndarray:
    """Independent unit-variance complex Gaussian coefficients, (n_samples // 2 + 1, S), E|w|^2 = 1.

    DC is zero and the Nyquist coefficient of an even record is real, as a real record demands. A single source is the
    first of two.
    """
    n_lines = n_samples // 2 + 1
    draws = rng.standard_normal((n_lines, 2 * max(sources, 2))).view(np.complex128)
    draws *= np.sqrt(0.5)
    draws[0] = 0.0
    if n_samples % 2 == 0:
        draws[-1] = np.sqrt(2.0) * draws[-1].real
    return draws[:, :sources]


class Noise(ABC):
    """Noise on the S sensed angles: independent Gaussian processes with given spectra."""

    @property
    @abstractmethod
    def sources(self) -> int:
        """S."""

    @abstractmethod
    def psd(self, f: np.ndarray) -> np.ndarray:
        """One-sided PSD at frequencies ``f`` > 0 (Hz, (N,)), rad^2/Hz, (N, S); zero at f = 0."""

    def coefficient_scale(self, n_samples: int, rate_hz: float) -> np.ndarray:
        """Root-mean-square magnitude of the coefficients of a record, rad, (n_samples // 2 + 1, S)."""
        return np.sqrt(self.psd(record_frequencies(n_samples, rate_hz)) * (rate_hz / n_samples / 2))

    def coefficients(self, rng: np.random.Generator, n_samples: int, rate_hz: float) -> np.ndarray:
        """Random Fourier coefficients of a record, rad, (n_samples // 2 + 1, S) complex."""
        return self.coefficient_scale(n_samples, rate_hz) * white_coefficients(rng, n_samples, self.sources)

    def sample(self, rng: np.random.Generator, n_samples: int, rate_hz: float) -> np.ndarray:
        """A random record, rad, (n_samples, S); zero mean."""
        return record(self.coefficients(rng, n_samples, rate_hz), n_samples)


@dataclass(frozen=True)
class SensorNoise(Noise):
    """Sensor noise with the shape in the module's text.

    Attributes
    ----------
    psd_deg2_hz: one-sided PSD of the noise on each sensed angle at ``reference_hz``, deg^2/Hz, (S,).
    corner_hz: corner of the low-pass, Hz.
    reference_hz: frequency at which the PSD is given, Hz.
    exponent: the PSD falls as f^-exponent before the low-pass: 0 white, 1 pink, 2 brown.

    Raises `InputError` when a field is not usable.
    """

    psd_deg2_hz: tuple[float, ...] = (4e-4, 7e-5)
    corner_hz: float = 0.15
    reference_hz: float = 0.5
    exponent: float = 1.0

    def __post_init__(self) -> None:
        if not self.psd_deg2_hz or not all(np.isfinite(p) and p >= 0 for p in self.psd_deg2_hz):
            raise InputError(f"noise psd_deg2_hz: expected non-negative numbers, got {self.psd_deg2_hz!r}")
        if not np.isfinite(self.exponent):
            raise InputError(f"noise exponent: expected a finite number, got {self.exponent!r}")
        for name in ("corner_hz", "reference_hz"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"noise {name}: expected a positive number, got {value!r}")

    @property
    def sources(self) -> int:
        """S."""
        return len(self.psd_deg2_hz)

    def psd(self, f: np.ndarray) -> np.ndarray:
        """One-sided PSD at frequencies ``f`` > 0 (Hz, (N,)), rad^2/Hz, (N, S); zero at f = 0."""
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
    f_hz: (M,), frequencies above zero, ascending, Hz.
    densities: by sensed angle, (S, M), one-sided PSD there, positive or all zero, deg^2/Hz. Between two frequencies the
        PSD is a straight line in logarithms; beyond them it stays what it is at the last one.
    names: of the angles in messages.

    Raises `InputError` when a field is not usable.
    """

    f_hz: tuple[float, ...]
    densities: tuple[tuple[float, ...], ...]
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        f = np.asarray(self.f_hz)
        if not f.size or not np.isfinite(f).all() or f[0] <= 0 or (np.diff(f) <= 0).any():
            raise InputError("noise table.f_hz: expected frequencies above zero, ascending, each once")
        for name, values in zip(self.names, map(np.asarray, self.densities), strict=True):
            if values.shape != f.shape or not (np.isfinite(values) & ((values > 0) | ~values.any())).all():
                raise InputError(f"noise table.{name}: expected {f.size} positive numbers, one per frequency")

    @property
    def sources(self) -> int:
        """S."""
        return len(self.densities)

    def psd(self, f: np.ndarray) -> np.ndarray:
        """One-sided PSD at frequencies ``f`` > 0 (Hz, (N,)), rad^2/Hz, (N, S); zero at f = 0."""
        f = np.asarray(f, dtype=float)
        out = np.zeros((*f.shape, self.sources))
        at = np.log(f[f > 0])
        for k, values in enumerate(self.densities):
            if any(values):
                out[f > 0, k] = np.exp(np.interp(at, np.log(self.f_hz), np.log(values))) * DEG2_TO_RAD2
        return out


SILENT = SensorNoise((0.0, 0.0))
"""No noise at all, on two angles."""


@dataclass(frozen=True)
class MeasurementNoise:
    """White noise of what records the outputs, outside the loop, up to half the sampling rate.

    Attributes
    ----------
    covariance: (Y, Y) of the outputs of one sample, in their units; angles that share markers are correlated.

    Raises `InputError` unless it is a covariance.
    """

    covariance: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        C = self.matrix
        size = np.sqrt(np.maximum(np.diag(C), np.finfo(float).tiny)) if C.ndim == 2 else np.ones(1)
        if C.ndim != 2 or C.shape[0] != C.shape[1] or not np.isfinite(C).all():
            raise InputError(
                f"measurement noise covariance: expected a square matrix of numbers, got {self.covariance!r}"
            )
        if not np.allclose(C, C.T, rtol=1e-9, atol=0.0) or np.linalg.eigvalsh(C / size / size[:, None])[0] < -1e-9:
            raise InputError("measurement noise covariance: expected a symmetric matrix without negative eigenvalues")

    @property
    def matrix(self) -> np.ndarray:
        """(Y, Y)."""
        return np.array(self.covariance, dtype=float)

    def psd(self, rate_hz: float) -> np.ndarray:
        """One-sided cross-spectral density at any frequency up to half the rate, (Y, Y) per Hz."""
        return self.matrix / (rate_hz / 2)

    def psd_without_ramp(self, f: np.ndarray, duration_s: float, rate_hz: float) -> np.ndarray:
        """The density that spectra have from which the ramp of the record is removed, at ``f`` (Hz, (N,)), (N, Y, Y).

        The ramp over ``duration_s`` goes through two samples, so that their noise is in every line: at low lines far
        more than that of all other samples. With c = 1 / (2 pi i f duration) the coefficient of a ramp of height 1, the
        coefficients hold 2 C |c|^2 more (derived).
        """
        return self.psd(rate_hz) + self.matrix / (np.pi**2 * duration_s * f[:, None, None] ** 2)

    @cached_property
    def _root(self) -> np.ndarray:
        """L with L L^T the covariance; that of a singular one, too."""
        value, vector = np.linalg.eigh(self.matrix)
        return np.asarray(vector * np.sqrt(np.maximum(value, 0.0)))

    def coefficients(self, rng: np.random.Generator, n_samples: int) -> np.ndarray:
        """Random Fourier coefficients of a record, (n_samples // 2 + 1, Y) complex; without mean."""
        return white_coefficients(rng, n_samples, len(self.covariance)) @ self._root.T / np.sqrt(n_samples)

    def sample(self, rng: np.random.Generator, n_samples: int) -> np.ndarray:
        """A random record, (n_samples, Y)."""
        return record(self.coefficients(rng, n_samples), n_samples)


def record(coefficients: np.ndarray, n_samples: int) -> np.ndarray:
    """Time record (n_samples, C) of channels from their Fourier coefficients (n_samples // 2 + 1, C).

    Two channels share one complex transform (the first as its real part, the second as its imaginary part): record
    lengths such as 6 x 8744 hold the prime 1093, for which a transform is the costliest step of a realization.
    """
    from scipy import fft  # checking the noise of a study needs no SciPy

    n_lines, channels = n_samples // 2 + 1, coefficients.shape[1]
    if channels > 2:
        pairs = [record(coefficients[:, k : k + 2], n_samples) for k in range(0, channels, 2)]
        return np.concatenate(pairs, axis=1)
    if channels == 1:  # the first of two, to the last bit
        return record(np.pad(coefficients, ((0, 0), (0, 1))), n_samples)[:, :1]
    spectrum = np.empty(n_samples, dtype=np.complex128)
    first, second = coefficients[:, 0], coefficients[:, 1]
    mirrored = slice(n_samples - n_lines, 0, -1)  # coefficients 1 .. below Nyquist, descending
    spectrum[:n_lines] = first + 1j * second
    if n_samples % 2 == 0:  # only the real part of a Nyquist coefficient shows in a real record
        spectrum[n_lines - 1] = first[-1].real + 1j * second[-1].real
    spectrum[n_lines:] = np.conj(first[mirrored]) + 1j * np.conj(second[mirrored])
    packed = fft.ifft(spectrum, norm="forward", overwrite_x=True)
    return packed.view(np.float64).reshape(n_samples, 2)
