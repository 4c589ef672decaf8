"""Frequency points of an FRF: the harmonics that are averaged into each point.

The paper prints 28 frequencies (Goodworth & Peterka 2018, Methods). With a 43.72 s cycle they are harmonics
1 3 5 8 10 12 14 16 18 19 21 23 24 28 35 44 56 71 88 107 133 165 201 235 259 280 310 350; only odd harmonics are
excited, so the even numbers must be means over neighbouring odd lines.

Fixed by the paper: the numbers themselves; that 19, 21, 23 (0.435-0.526 Hz) are not averaged; "adjacent" points.
Our choice: the members. Every point is the mean of *consecutive* odd lines centred on its number. 1, 3, 5 are single
lines; 8 to 18 and 24 are the mean of the two adjacent lines (so neighbouring points share a line); from 28 on the sets
cover the odd lines without gap or overlap. Given the centres and a first set 25 < {27, 29}, there is exactly one such
tiling, and its widths grow as the paper says, "approximately equally spaced on
a logarithmic scale": 2 5 4 8 7 10 9 17 15 21 13 11 10 20 20 lines. The last set reaches harmonic 369 (8.44 Hz).

About the widths the paper says only that they tend to grow with frequency, so narrower ones agree with it equally well
above 0.6 Hz; `narrower` makes them.

Three printed values are not these numbers rounded: 0.275 Hz (12 gives 0.2745, the mean of its two lines after each
was rounded), 1.00 Hz (44 gives 1.006) and 8.00 Hz (350 gives 8.005). We keep the numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mcstudy.errors import InputError

PERIOD_S = 43.72
"""Duration of the paper's stimulus cycle, s."""

_CENTRE_AND_COUNT = (
    (1, 1), (3, 1), (5, 1), (8, 2), (10, 2), (12, 2), (14, 2), (16, 2), (18, 2), (19, 1), (21, 1), (23, 1), (24, 2),
    (28, 2), (35, 5), (44, 4), (56, 8), (71, 7), (88, 10), (107, 9), (133, 17), (165, 15), (201, 21), (235, 13),
    (259, 11), (280, 10), (310, 20), (350, 20),
)  # fmt: skip

EXCEPTION = (19, 21, 23)
"""Harmonics the paper leaves unaveraged between averaged neighbours (0.435-0.526 Hz)."""


@dataclass(frozen=True, eq=False)
class Bands:
    """Frequency points as sets of harmonics of one period.

    Attributes
    ----------
    members: per point, the harmonic numbers averaged into it, ascending int arrays; N points.
    period_s: duration of the period, s.
    """

    members: tuple[np.ndarray, ...]
    period_s: float = PERIOD_S

    def __post_init__(self) -> None:
        if not self.members or any(m.size == 0 or m.min() < 1 for m in self.members):
            raise InputError("bands: expected at least one point, each with at least one harmonic from 1 up")

    def __len__(self) -> int:
        return len(self.members)

    @cached_property
    def harmonic(self) -> np.ndarray:
        """Mean harmonic number of each point, (N,)."""
        return np.array([m.mean() for m in self.members])

    @cached_property
    def f(self) -> np.ndarray:
        """Mean member frequency of each point, Hz, (N,): where a fitted model is evaluated."""
        return self.harmonic / self.period_s

    @cached_property
    def lines(self) -> np.ndarray:
        """All harmonics that are members of a point, ascending, (L,) int."""
        return np.unique(np.concatenate(self.members))

    @cached_property
    def line_f(self) -> np.ndarray:
        """Frequencies of `lines`, Hz, (L,)."""
        return self.lines / self.period_s

    @cached_property
    def weights(self) -> np.ndarray:
        """The means as a matrix: point values = weights @ line values, (N, L)."""
        w = np.zeros((len(self), self.lines.size))
        for row, members in zip(w, self.members, strict=True):
            row[np.searchsorted(self.lines, members)] = 1.0 / members.size
        return w

    @cached_property
    def _gather(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions of all members in `lines`, where each point starts among them, and its number of members."""
        counts = np.array([m.size for m in self.members])
        return np.searchsorted(self.lines, np.concatenate(self.members)), np.cumsum(counts) - counts, counts

    def average(self, values: np.ndarray) -> np.ndarray:
        """Means over members of values at `lines`, (..., L, A) -> (..., N, A)."""
        position, start, count = self._gather
        return np.add.reduceat(values[..., position, :], start, axis=-2) / count[:, None]

    def average_covariance(self, covariance: np.ndarray) -> np.ndarray:
        """Covariance of each point's mean, (L, 2, 2) -> (N, 2, 2), for errors independent from line to line.

        Points that share lines are correlated; this array does not include that correlation.
        """
        position, start, count = self._gather
        return np.add.reduceat(covariance[position], start, axis=0) / (count**2)[:, None, None]

    def below(self, fmax: float) -> Bands:
        """The points up to ``fmax`` (Hz) plus half a line spacing; raises `InputError` when none is left.

        The half line allows for rounding: the paper's Fmax of 0.41 and 8 Hz keep its points at 0.412 and 8.00 Hz,
        which are harmonics 18 and 350 (0.4117 and 8.0055 Hz). 0.41 / 1.2 / 8 Hz keep 9 / 16 / 28 published points.
        """
        return self._keep(self.harmonic <= fmax * self.period_s + 0.5, f"bands fmax: {fmax:g} Hz")

    def without(self, f: float) -> Bands:
        """All points except the one nearest to ``f`` (Hz)."""
        keep = np.ones(len(self), dtype=bool)
        keep[int(np.argmin(np.abs(self.f - f)))] = False
        return self._keep(keep, f"bands without {f:g} Hz")

    def among(self, harmonics: Sequence[int]) -> Bands:
        """The points with only those members that are among the ``harmonics``; points without any are left out."""
        members = tuple(m[np.isin(m, harmonics)] for m in self.members)
        groups = tuple(m for m in members if m.size)
        if not groups:
            raise InputError("bands: expected at least one excited line in a frequency point, got none")
        return Bands(groups, self.period_s)

    def _keep(self, keep: np.ndarray, what: str) -> Bands:
        if not keep.any():
            raise InputError(f"{what} leaves no frequency; the first is {self.f[0]:.3g} Hz")
        return Bands(tuple(m for m, k in zip(self.members, keep, strict=True) if k), self.period_s)


def consecutive(centre: int, count: int) -> np.ndarray:
    """``count`` consecutive odd harmonics with mean ``centre``; (count + centre) must be odd for them to be odd."""
    return np.arange(centre - count + 1, centre + count, 2)


def narrower(bands: Bands, width: float) -> Bands:
    """Every point averaged over fewer lines: the count nearest to ``width`` times its own that keeps its centre.

    Parameters
    ----------
    bands: points made of consecutive odd lines.
    width: fraction of the lines, in (0, 1]. A centre that is an odd line keeps an odd number of lines and at least
        one, a centre between lines an even number and at least two; so 1 is the bands themselves and a width near 0
        the narrowest points at the same frequencies. Of two counts equally near, the larger.

    Raises `InputError` for a width outside (0, 1].
    """
    if not 0 < width <= 1:
        raise InputError(f"bands width: expected a fraction above 0 and at most 1, got {width!r}")
    members = []
    for m in bands.members:
        least = 2 - m.size % 2
        count = least + 2 * int(max(width * m.size - least, 0.0) / 2 + 0.5)
        members.append(consecutive(round(m.mean()), count))
    return Bands(tuple(members), bands.period_s)


def published(period_s: float = PERIOD_S) -> Bands:
    """The paper's 28 points."""
    return Bands(tuple(consecutive(c, n) for c, n in _CENTRE_AND_COUNT), period_s)


def averaged(period_s: float = PERIOD_S) -> Bands:
    """The 28 points without the exception: 19, 21 and 23 are averaged with their two neighbouring lines each."""
    return Bands(
        tuple(consecutive(c, 3 if c in EXCEPTION else n) for c, n in _CENTRE_AND_COUNT),
        period_s,
    )


def odd_lines(f_max: float = 8.0, period_s: float = PERIOD_S) -> Bands:
    """Every odd harmonic up to ``f_max`` (Hz, half a line of tolerance), unaveraged: 9, 26, 175 at 0.41, 1.2, 8 Hz."""
    k = np.arange(1, int(f_max * period_s + 0.5) + 1, 2)
    if k.size == 0:
        raise InputError(f"bands f_max: {f_max:g} Hz leaves no frequency; the first is {1 / period_s:.3g} Hz")
    return Bands(tuple(np.array([j]) for j in k), period_s)
