"""The pseudorandom ternary sequence (PRTS) stimulus.

A ternary maximum-length sequence of -1, 0, +1 is read as a velocity, each state held for a whole number of samples;
its zero-mean integral is the stimulus (Goodworth & Peterka 2018, Methods: 43.72 s cycles, amplitude ~ 1/f from 0.023
to 16.7 Hz). That 43.72 s = (3^7 - 1) x 20 ms identifies the sequence is derived, not printed in the paper.

Two consequences carry the analysis: the second half of a cycle is minus the first, so **only odd harmonics are
excited**; and every odd harmonic of the state sequence has the same magnitude, so the waveform falls as 1/f.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mcstudy.errors import InputError

RECURRENCES: dict[int, tuple[tuple[int, int], ...]] = {
    2: ((1, 1), (2, 1)),
    3: ((2, 1), (3, 2)),
    4: ((3, 1), (4, 1)),
    5: ((4, 1), (5, 2)),
    6: ((5, 1), (6, 1)),
    7: ((5, 1), (7, 2)),
    8: ((5, 1), (8, 1)),
    9: ((5, 1), (9, 2)),
}
"""Per number of stages, (lag, coefficient) pairs of x[n] = sum coefficient * x[n - lag] mod 3.

Each is primitive over GF(3), so the period is the longest possible, 3**stages - 1 (derived by exhaustive search over
two-term recurrences, checked by the tests; the one for 7 stages is that of the balance literature).
"""

CONVENTIONS = ("peak", "peak_to_peak")
"""How an amplitude is read: the largest absolute value, or the distance between the extremes."""


def check_convention(convention: str) -> None:
    """Raise `InputError` for none of `CONVENTIONS`."""
    if convention not in CONVENTIONS:
        raise InputError(f"stimulus convention: expected one of {', '.join(CONVENTIONS)}, got {convention!r}")


def peak_of(amplitude: float, convention: str) -> float:
    """Largest absolute value of a waveform whose two extremes are equal, from its amplitude in a convention."""
    return amplitude if convention == "peak" else amplitude / 2


def ternary_m_sequence(stages: int) -> np.ndarray:
    """One period of the ternary m-sequence, (3**stages - 1,) int8 in {-1, 0, 1}.

    Raises `InputError` for a number of stages that `RECURRENCES` does not hold.
    """
    if stages not in RECURRENCES:
        raise InputError(
            f"stimulus stages: expected a whole number from {min(RECURRENCES)} to {max(RECURRENCES)}, got {stages!r}"
        )
    recurrence = RECURRENCES[stages]
    x = [0] * (stages - 1) + [1]
    for n in range(stages, 3**stages - 1):
        x.append(sum(c * x[n - lag] for lag, c in recurrence) % 3)
    sequence = np.array(x, dtype=np.int8)
    sequence[sequence == 2] = -1
    return sequence


@dataclass(frozen=True)
class Prts:
    """A PRTS stimulus.

    Attributes
    ----------
    stages: stages of the shift register; a cycle has 3**stages - 1 states.
    state_s: duration of a state, s; must be a whole number of samples.
    rate_hz: sampling rate, Hz.
    amplitude: amplitude of the waveform, in units of the stimulus (N m for a torque).
    convention: how the amplitude is read, one of `CONVENTIONS`. The paper's Methods say peak-to-peak, its Fig. 2
        caption peak; peak reproduces its results better and is the default.

    Raises `InputError` when a field is not usable.
    """

    stages: int = 7
    state_s: float = 0.02
    rate_hz: float = 200.0
    amplitude: float = 5.0
    convention: str = "peak"

    def __post_init__(self) -> None:
        if self.stages not in RECURRENCES:
            raise InputError(
                f"stimulus stages: expected a whole number from {min(RECURRENCES)} to {max(RECURRENCES)}, "
                f"got {self.stages!r}"
            )
        for name in ("state_s", "rate_hz", "amplitude"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"stimulus {name}: expected a positive number, got {value!r}")
        held = self.state_s * self.rate_hz
        if round(held) < 1 or abs(held - round(held)) > 1e-9 * held:
            raise InputError(
                f"stimulus state_s: expected a whole number of samples per state, got {self.state_s} s "
                f"x {self.rate_hz} Hz = {held:g}"
            )
        check_convention(self.convention)

    @property
    def states(self) -> int:
        """States in a cycle."""
        return 3**self.stages - 1

    @property
    def samples_per_state(self) -> int:
        """Samples each state is held for."""
        return round(self.state_s * self.rate_hz)

    @property
    def samples(self) -> int:
        """Samples in a cycle."""
        return self.states * self.samples_per_state

    @property
    def period_s(self) -> float:
        """Duration of a cycle, s."""
        return self.samples / self.rate_hz

    @property
    def peak(self) -> float:
        """Largest absolute value of the waveform; the two extremes are equal because the cycle is half-wave odd."""
        return peak_of(self.amplitude, self.convention)

    @cached_property
    def _unit_waveform(self) -> np.ndarray:
        velocity = ternary_m_sequence(self.stages).astype(float)
        position = np.cumsum(velocity) - velocity  # at the start of each state
        position -= (position.max() + position.min()) / 2
        # The cycle starts at a state boundary where the stimulus is zero, so that a simulation from rest sees no step.
        start = int(np.argmin(np.abs(position)))
        position, velocity = np.roll(position, -start), np.roll(velocity, -start)
        held = self.samples_per_state
        waveform = (position[:, None] + velocity[:, None] * np.arange(held) / held).ravel()
        waveform /= np.abs(waveform).max()
        return waveform

    def waveform(self) -> np.ndarray:
        """One cycle of the stimulus, (samples,) float: the exact integral of the held velocity at the sample times."""
        return self.peak * self._unit_waveform

    @cached_property
    def _unit_coefficients(self) -> np.ndarray:
        c = np.fft.rfft(self._unit_waveform) / self.samples
        c[::2] = 0.0  # exactly zero by the half-wave symmetry; the transform leaves rounding errors there
        return c

    def coefficients(self) -> np.ndarray:
        """Fourier coefficients of the sampled cycle at harmonics 0, 1, ..., samples // 2, (samples // 2 + 1,) complex.

        Coefficient k is (1 / samples) * sum waveform[n] exp(-2 pi i k n / samples); even harmonics are exactly zero.
        """
        return self.peak * self._unit_coefficients
