"""Noise at the lowest lines when its colour is not known: its slope, estimated and levelled.

Line 1 has no even line below it, so its noise is continued from above. Under a presumed pink fall that is off by a
factor of three when the noise is brown or white. Here the exponent s of what is left of a power law k^-s well below
line `BEND` is estimated from the even lines of every angle by gamma likelihood, with a normal prior around none. The
power law fades out around `BEND` as (1 + (BEND / k)^2)^(s/2): a sharp end would leave the average over neighbouring
lines 6 % too small there under brown noise. An angle that falls faster than another does so because the body responds
less, which an autoregression follows, so the flattest angle tells the colour of all. It costs degrees of freedom, most
at line 1; the fewer, the more records tell the colour. Differences between cycles do, although their level need not be
that of the mean's noise, so every kind of record has a level of its own. Derived.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

BEND = 24
"""Harmonic around which noise of another colour at the lowest lines passes into that above."""

SPREAD = 1.0
"""Prior standard deviation of the exponent: white and brown are one away from pink."""

STEPS = 8
"""Steps of Fisher scoring, which converges in four or five."""


class Colour:
    """Levelling of the lowest noise lines.

    Parameters
    ----------
    even: harmonics that hold only noise, ascending, (E,). lines: harmonics whose noise is wanted, (L,). records: (G,)
    how many records the powers of every kind will be means of.

    Attributes
    ----------
    used: how many even lines, the lowest, tell the colour.
    """

    def __init__(self, even: np.ndarray, lines: np.ndarray, records: Sequence[int]) -> None:
        self.used = int((even <= BEND).sum())
        self._even, self._lines = _fading(even), _fading(lines)
        x = self._even[: self.used]
        self._x, self._records = x - x.mean(), np.array(records, dtype=float)
        self._curvature = float(self._records.sum() * (self._x**2).sum()) + SPREAD**-2
        self._centre = float(x.mean())

    def exponent(self, power: np.ndarray) -> np.ndarray:
        """s (A, ...), the same for all A angles, such that none falls less than k^-s well below `BEND`.

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
        """Factors (..., E) that level the amplitudes of even lines of exponent ``s`` (...)."""
        return np.exp(0.5 * np.asarray(s)[..., None] * self._even)

    def restored(self, s: np.ndarray) -> np.ndarray:
        """Factors (..., L) that undo it at the wanted lines."""
        return np.exp(-0.5 * np.asarray(s)[..., None] * self._lines)

    def dof(self, dof: np.ndarray) -> np.ndarray:
        """Degrees of freedom (L,) of the noise at the wanted lines, from those (L,) of a known colour.

        The log of the noise at a line moves by the exponent's error times its distance from where the level is known.
        """
        distance = np.minimum(self._lines - self._centre, 0.0)
        return np.asarray(1.0 / (1.0 / dof + distance**2 / self._curvature))


def _fading(k: np.ndarray) -> np.ndarray:
    """ln(k / BEND) far below, 0 far above."""
    return -0.5 * np.log1p((BEND / np.asarray(k, dtype=float)) ** 2)
