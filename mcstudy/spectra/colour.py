"""Noise of unknown colour at the lowest lines: estimation and removal of its spectral slope.

Line 1 has no even line below it, so its noise level is extrapolated from above. If pink noise is assumed but the noise
is brown or white, the result is wrong by a factor of three. This module therefore estimates the exponent s of a
residual power law k^-s well below line `BEND` from the even lines of every angle, by gamma likelihood with a normal
prior centred on zero. The power law fades out around `BEND` as (1 + (BEND / k)^2)^(s/2); with a sharp end the average
over neighbouring lines would be 6 % too small there for brown noise. If the spectrum of one angle is steeper, the
reason is the response of the body, which the autoregression models; so the flattest angle determines the exponent of
all. The estimate costs degrees of freedom, most at line 1; more records reduce this cost. Differences between cycles
are such records. Their noise level may differ from that of the mean, so every kind of record has its own level.
Derived.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

BEND = 24
"""Harmonic around which the power law at the lowest lines fades out."""

SPREAD = 1.0
"""Prior standard deviation of the exponent; white and brown noise differ from pink noise by one."""

STEPS = 8
"""Steps of Fisher scoring, which converges in four or five steps."""


class Colour:
    """Removal of the spectral slope at the lowest noise lines.

    Parameters
    ----------
    even: harmonics that hold only noise, ascending, (E,). lines: harmonics at which the noise is wanted, (L,).
    records: (G,) number of records averaged in the powers of each kind.

    Attributes
    ----------
    used: number of even lines, from the lowest, that determine the exponent.
    """

    def __init__(self, even: np.ndarray, lines: np.ndarray, records: Sequence[int]) -> None:
        self.used = int((even <= BEND).sum())
        self._even, self._lines = _fading(even), _fading(lines)
        x = self._even[: self.used]
        self._x, self._records = x - x.mean(), np.array(records, dtype=float)
        self._curvature = float(self._records.sum() * (self._x**2).sum()) + SPREAD**-2
        self._centre = float(x.mean())

    def exponent(self, power: np.ndarray) -> np.ndarray:
        """s (A, ...), the smallest of the exponents of all A angles, well below `BEND`.

        ``power``: mean squared lines (G, A, ..., E) of every kind of record.
        """
        power = power[..., : self.used]
        s = np.zeros(power.shape[1:-1])
        for _ in range(STEPS):
            level = power * np.exp(s[..., None] * self._x)
            ratio = level / np.maximum(level.mean(axis=-1, keepdims=True), 1e-300)
            # the score of the likelihood is -sum x ratio, since sum x = 0
            score = np.tensordot(self._records, ratio @ self._x, axes=1)
            s = s - np.clip((score + s * SPREAD**-2) / self._curvature, -1.0, 1.0)
        return np.broadcast_to(s.min(axis=0), s.shape)

    def levelled(self, s: np.ndarray) -> np.ndarray:
        """Factors (..., E) that flatten the amplitudes of even lines with exponent ``s`` (...)."""
        return np.exp(0.5 * np.asarray(s)[..., None] * self._even)

    def restored(self, s: np.ndarray) -> np.ndarray:
        """Factors (..., L) that restore the slope at the wanted lines."""
        return np.exp(-0.5 * np.asarray(s)[..., None] * self._lines)

    def dof(self, dof: np.ndarray) -> np.ndarray:
        """Degrees of freedom (L,) of the noise at the wanted lines, from those (L,) of a known colour.

        The error of the log noise at a line is the error of the exponent times the log distance to the lines used.
        """
        distance = np.minimum(self._lines - self._centre, 0.0)
        return np.asarray(1.0 / (1.0 / dof + distance**2 / self._curvature))


def _fading(k: np.ndarray) -> np.ndarray:
    """ln(k / BEND) far below, 0 far above."""
    return -0.5 * np.log1p((BEND / np.asarray(k, dtype=float)) ** 2)
