"""Sensor noise of other colours than pink, to ask how robust a diagnosis is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.gap.challenge.design import Noise
from mcstudy.stance.noise import DEG2_TO_RAD2, SensorNoise


@dataclass(frozen=True)
class ColouredNoise(SensorNoise):
    """`SensorNoise` whose PSD falls as f^-``colour`` before the low-pass: 0 white, 1 pink, 2 brown."""

    colour: float = 1.0

    def psd(self, f: np.ndarray) -> np.ndarray:
        """One-sided PSD at frequencies ``f`` > 0 (Hz, (N,)), rad^2/Hz, (N, 2); zero at f = 0."""
        f = np.asarray(f, dtype=float)
        shape = np.zeros_like(f)
        positive = f > 0
        fp, ref, corner = f[positive], self.reference_hz, self.corner_hz
        shape[positive] = (ref / fp) ** self.colour * (1 + (ref / corner) ** 2) / (1 + (fp / corner) ** 2)
        return shape[:, None] * (np.array(self.psd_deg2_hz) * DEG2_TO_RAD2)


def noise_of(section: Noise) -> SensorNoise:
    """The noise a challenge file describes."""
    first, second = (p * section.level for p in section.psd)
    return ColouredNoise((first, second), section.corner_hz, colour=section.colour)


SILENT = SensorNoise((0.0, 0.0))
"""No noise at all."""
