"""A periodic stimulus given by its lines: a sum of cosines at odd harmonics (multisine).

It offers what a `mcstudy.stance.stimulus.Prts` offers, so simulators take either. Lines are odd, so that the even ones
stay free for the estimate of the noise and for even nonlinearities.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mcstudy.errors import InputError
from mcstudy.stance.stimulus import Prts, check_convention, peak_of


@dataclass(frozen=True)
class LineStimulus:
    """A stimulus with lines at given odd harmonics of its cycle.

    Attributes
    ----------
    harmonic: odd harmonics, ascending, below half the samples of a cycle.
    weight: amplitude of the cosine of each line, relative to the others.
    phase_deg: its phase at the first sample, degrees.
    samples: samples in a cycle.
    rate_hz: sampling rate, Hz.
    amplitude: amplitude of the sampled waveform, in units of the stimulus.
    convention: how the amplitude is read (`mcstudy.stance.stimulus.CONVENTIONS`).

    Raises `InputError` when a field is not usable.
    """

    harmonic: tuple[int, ...]
    weight: tuple[float, ...]
    phase_deg: tuple[float, ...]
    samples: int
    rate_hz: float = 200.0
    amplitude: float = 5.0
    convention: str = "peak"

    def __post_init__(self) -> None:
        n, k = len(self.harmonic), np.asarray(self.harmonic)
        if not n or (k % 2 == 0).any() or (np.diff(k) <= 0).any() or k[0] < 1:
            raise InputError("stimulus lines.harmonic: expected odd harmonics from 1 up, ascending, each once")
        if k[-1] * 2 >= self.samples:
            raise InputError(
                f"stimulus lines.harmonic: expected harmonics below half of the {self.samples} samples of a cycle, "
                f"got {k[-1]}"
            )
        for name in ("weight", "phase_deg"):
            if len(getattr(self, name)) != n:
                raise InputError(f"stimulus lines.{name}: expected {n} numbers, one per harmonic")
        if not all(math.isfinite(w) and w > 0 for w in self.weight):
            raise InputError("stimulus lines.weight: expected positive numbers")
        check_convention(self.convention)

    @property
    def period_s(self) -> float:
        """Duration of a cycle, s."""
        return self.samples / self.rate_hz

    @property
    def peak(self) -> float:
        """Largest absolute value of the waveform; the two extremes are equal because the cycle is half-wave odd."""
        return peak_of(self.amplitude, self.convention)

    @cached_property
    def _unit_coefficients(self) -> np.ndarray:
        c = np.zeros(self.samples // 2 + 1, dtype=complex)
        c[list(self.harmonic)] = 0.5 * np.array(self.weight) * np.exp(1j * np.radians(self.phase_deg))
        return c / np.abs(np.fft.irfft(c, self.samples, norm="forward")).max()

    def waveform(self) -> np.ndarray:
        """One cycle of the stimulus, (samples,) float."""
        return self.peak * np.fft.irfft(self._unit_coefficients, self.samples, norm="forward")

    def coefficients(self) -> np.ndarray:
        """Fourier coefficients of the cycle at harmonics 0, 1, ..., samples // 2, complex, as those of a `Prts`."""
        return self.peak * self._unit_coefficients


Stimulus = Prts | LineStimulus
"""A periodic stimulus with odd lines only: samples, rate, waveform and coefficients of one cycle."""
