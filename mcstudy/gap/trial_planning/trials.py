"""A trial that could be recorded: its lines, and the noise that they would have.

Sensor noise and all other noise inside a linear loop evoke the same sway under every stimulus. The density of the sway
that noise evokes is therefore taken from the recordings at hand, and only the stimulus changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mcstudy.effect_library.protocol import smoothed
from mcstudy.errors import RecordingError
from mcstudy.spectra.lines import Lines
from mcstudy.stance.body import STIMULI, TORQUES
from mcstudy.stance.line_stimulus import LineStimulus, Stimulus
from mcstudy.stance.stimulus import Prts

SPECTRA = ("prts", "flat")
"""Spectra of a planned stimulus: a pseudorandom ternary sequence, and equal amplitudes of all odd lines."""

SMOOTH = 0.05
"""Standard deviation, in ln frequency, of the weights with which the density of the noise is averaged over lines. The
density is steep: the average is 5 % too large, and three times as wide it would be 18 %."""

RATE_HZ = 100.0
"""Sampling rate of a planned trial."""

PERIOD_S = Prts(rate_hz=RATE_HZ).period_s
"""Its period: that of the sequence of Goodworth & Peterka (2018)."""


@dataclass(frozen=True)
class PlannedTrial:
    """Trials of one stimulus that could be recorded.

    Attributes
    ----------
    kind
        Kind of stimulus.
    amplitude
        Its peak, in the unit of the kind.
    spectrum
        One of `SPECTRA`.
    trials, cycles, discard
        Number of trials, periods of each, and how many of these are left out at its start.
    fmax
        Highest frequency that is analysed, Hz.
    """

    kind: str
    amplitude: float
    spectrum: str
    trials: int
    cycles: int
    discard: int
    fmax: float

    @property
    def unit(self) -> str:
        """Unit of the amplitude."""
        return STIMULI[self.kind]

    @property
    def duration_s(self) -> float:
        """Time of recording, s."""
        return self.trials * self.cycles * PERIOD_S

    @cached_property
    def waveform(self) -> Stimulus:
        """One cycle, before a motion is smoothed."""
        prts = Prts(rate_hz=RATE_HZ, amplitude=self.amplitude, convention="peak")
        if self.spectrum == "prts":
            return prts
        k = np.arange(1, int(min(self.fmax * PERIOD_S, prts.samples / 2 - 1)) + 1, 2)
        phase = np.mod(-180.0 * np.arange(k.size) ** 2 / k.size, 360.0)  # Schroeder (1970): a low crest factor
        lines, equal, turned = tuple(map(int, k)), (1.0,) * k.size, tuple(map(float, phase))
        return LineStimulus(lines, equal, turned, prts.samples, RATE_HZ, self.amplitude)

    @cached_property
    def harmonic(self) -> np.ndarray:
        """(N,) harmonics of its lines."""
        top = min(self.fmax * PERIOD_S * (1 + 1e-9), self.waveform.samples / 2 - 1)
        return np.arange(1, int(top) + 1, 2)

    @property
    def f(self) -> np.ndarray:
        """(N,) Hz."""
        return self.harmonic / PERIOD_S

    @cached_property
    def drive(self) -> np.ndarray:
        """(N,) Fourier coefficients of the stimulus at its lines."""
        period = self.waveform.waveform()
        if self.kind not in TORQUES:
            period = smoothed(period, RATE_HZ, self.amplitude)
        return np.asarray(np.fft.rfft(period)[self.harmonic] / period.size)

    def covariance(self, noise: SwayNoise) -> np.ndarray:
        """(N, 2, 2) of the errors of its responses."""
        seconds = self.trials * (self.cycles - self.discard) * PERIOD_S
        return noise(self.f) / (2 * seconds) / (np.abs(self.drive) ** 2)[:, None, None]


@dataclass(frozen=True, eq=False)
class SwayNoise:
    """Density of the sway that noise evokes: one-sided, (K, 2, 2) rad^2/Hz at frequencies (K,) Hz, measured."""

    f: np.ndarray
    density: np.ndarray

    @classmethod
    def of(cls, lines: Lines, name: str) -> SwayNoise:
        """From the recordings with a period; raises `RecordingError` when there is none."""
        f, density = [], []
        for part in lines.parts:
            if part.harmonic is None:
                continue
            period_s = float((part.harmonic / part.f).mean())
            repeats = 1 / (part.weight**2).sum(axis=0)
            f.append(part.f)
            density.append(part.noise.C * (2 * period_s * part.power * repeats)[:, None, None])
        if not f:
            raise RecordingError(f"{name}: expected a recording with a periodic stimulus, whose cycles show the noise")
        return cls(np.concatenate(f), np.concatenate(density))

    def __call__(self, f: np.ndarray) -> np.ndarray:
        """At other frequencies (N,), averaged over neighbouring lines, (N, 2, 2)."""
        distance = (np.log(f)[:, None] - np.log(self.f)) / SMOOTH
        weight = np.exp(-0.5 * np.minimum(distance**2, 700.0))
        nearest = np.abs(distance) <= np.abs(distance).min(axis=1, keepdims=True)
        weight = np.where(weight.sum(axis=1, keepdims=True) > 1e-6, weight, nearest)  # beyond the measured lines
        return np.asarray(np.einsum("nk,kij->nij", weight / weight.sum(axis=1, keepdims=True), self.density))
