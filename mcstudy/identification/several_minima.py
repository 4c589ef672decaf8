"""What a second minimum does to the likelihood ratio, and how much farther an interval must reach for it.

Where two separate sets of parameters fit almost equally well, chance decides which of them fits best. The likelihood
ratio of a quantity that differs between them is then that of one minimum, plus the advantage of the other one where
that is the lower of both, so that the usual threshold holds the truth too rarely.

The law follows from two facts. The ratio within the true minimum is chi-squared with one degree of freedom. The
difference of the deviances of two fixed predictions whose squared distance is d, in standard errors of the noise, is
normal with mean d and variance 4 d. The distance is not known, so the threshold is that of the worst one (derived).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, chdtri

REACH = 10.0
"""Rise of the deviance up to which another minimum competes with the lowest."""

_DISTANCES = np.geomspace(0.5, 20.0, 16)
"""Squared distances that are tried; the worst one is about 3."""


@cache
def factor(level: float) -> float:
    """By what the threshold must be multiplied where another minimum competes; 1.33 for ``level`` 0.95."""
    plain = float(chdtri(1.0, 1 - level))

    def excess(raised: float) -> float:
        return max(missed(raised, plain, d) for d in _DISTANCES) - (1 - level)

    return float(brentq(excess, plain, 4 * plain, xtol=1e-4)) / plain


def missed(raised: float, plain: float, distance: float) -> float:
    """Chance that an interval does not hold the truth, with two minima at a squared ``distance``.

    The threshold is ``raised`` where the other minimum is within `REACH`, otherwise ``plain``.
    """
    away = np.linspace(-7.0, 7.0, 1001)
    lower = 2 * np.sqrt(distance) * away - distance  # by how much the wrong minimum is the lower one
    upto = np.where(np.abs(lower) < REACH, raised, plain)
    tail = chdtrc(1.0, np.maximum(upto - np.maximum(lower, 0.0), 0.0))
    density = np.exp(-(away**2) / 2) / np.sqrt(2 * np.pi)
    return float(np.trapezoid(density * tail, away))


def apart(values: np.ndarray, rise: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Which quantities (K,) another minimum within `REACH` puts beyond the interval around the lowest one.

    Parameters
    ----------
    values: (M, K) of the quantities at M minima, the lowest first. rise: (M,) of their deviances above the lowest.
    reach: (K,) half-widths of the Gauss-Newton intervals at the lowest; nan counts as zero.
    """
    near = np.flatnonzero(rise[1:] < REACH) + 1
    return np.asarray((np.abs(values[near] - values[0]) > np.nan_to_num(reach)).any(axis=0))
