"""What 10 % more of each parameter does to the response of a model, and the statements of the abstract about it.

Derivatives are exact (`mcstudy.stance.response.frf_jacobian`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf_jacobian

MORE = 0.1
BANDS = ((0.05, 0.1), (0.1, 0.5), (0.5, 0.9), (0.9, 2.5))
"""Hz."""

F = np.arange(0.05, BANDS[-1][1] + 0.001, 0.01)
"""Hz."""

WEIGHTS = ("Wp", "Wv")
"""The weight of a sense, by what tilts."""


@dataclass(frozen=True)
class Sensitivity:
    """Changes of the first output of a ``model`` at the frequencies `F` when a parameter grows by `MORE`."""

    model: Model

    @cached_property
    def _relative(self) -> np.ndarray:
        H, slope = frf_jacobian(self.model, self.model.truth, F)
        return np.asarray(MORE * slope[:, 0] * self.model.truth / H[:, :1])

    def magnitude(self, name: str) -> np.ndarray:
        """Of the magnitude, percent, (N,)."""
        return np.asarray(100 * self._relative[:, self.model.names.index(name)].real)

    def phase(self, name: str) -> np.ndarray:
        """Of the phase, degrees, (N,)."""
        return np.asarray(np.degrees(self._relative[:, self.model.names.index(name)].imag))

    def rows(self) -> list[list[str]]:
        """Root mean squares of both over each band, by parameter."""
        return [
            [name, *(f"{rms(self.magnitude(name), *b):.2f} %, {rms(self.phase(name), *b):.2f}°" for b in BANDS)]
            for name in self.model.names
        ]

    def statements(self) -> dict[str, tuple[float, float]]:
        """The two numbers that decide each statement, which holds where the first is the larger one."""
        (weight,) = set(WEIGHTS) & set(self.model.names)
        changed = self.magnitude(weight)
        return {
            "Kp": _inside(self.magnitude("Kp"), 0.1, 1.0),
            "Kd": _inside(self.magnitude("Kd"), 0.5, 0.9),
            "delay": _inside(self.phase("tau"), 0.6, F[-1]),
            "weight_magnitude": (float(changed.min()), float(changed.max() / 10)),
            "weight_phase": (1.0, float(np.abs(self.phase(weight)).max())),
            "little": (
                min(self._both(name) for name in ("Kp", "Kd", "tau", weight)),
                max(self._both(name) for name in ("Kf", "Tf", "K")),
            ),
        }

    def _both(self, name: str) -> float:
        return rms(self.magnitude(name)) + rms(self.phase(name))


def rms(change: np.ndarray, low: float = F[0], high: float = F[-1]) -> float:
    """Root mean square of a change (N,) over a band."""
    return _root(change[_within(low, high)])


def _inside(change: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """Root mean squares inside and outside a band."""
    within = _within(low, high)
    return _root(change[within]), _root(change[~within])


def _within(low: float, high: float) -> np.ndarray:
    return np.asarray((low - 1e-9 <= F) & (high + 1e-9 >= F))


def _root(change: np.ndarray) -> float:
    return float(np.sqrt((change**2).mean()))
