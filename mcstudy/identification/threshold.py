"""How far the deviance of one recording may rise: the threshold of every interval of its fit.

Where two separate sets of parameters fit almost equally well, chance decides which of them fits best. The likelihood
ratio of a quantity that differs between them is then that of one minimum, plus the advantage of the other one where
that is the lower of both, so that the usual threshold holds the truth too rarely. How much higher it must be follows
from two facts. The ratio within the true minimum is chi-squared with one degree of freedom. The difference of the
deviances of two fixed predictions whose squared distance is d, in standard errors of the noise, is normal with mean d
and variance 4 d. The distance is not known, so the threshold is that of the worst one (derived).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import chdtrc, chdtri

from mcstudy.fitting.penalised import whiten
from mcstudy.fitting.problem import Data
from mcstudy.identification.correction import Draws, correction
from mcstudy.identification.curvature import curvature
from mcstudy.identification.minimum import Minima
from mcstudy.identification.profile import Linearised
from mcstudy.models.quantities import Quantity
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf_jacobian

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
    reached = np.where(np.abs(lower) < REACH, raised, plain)
    tail = chdtrc(1.0, np.maximum(reached - np.maximum(lower, 0.0), 0.0))
    density = np.exp(-(away**2) / 2) / np.sqrt(2 * np.pi)
    return float(np.trapezoid(density * tail, away))


def separated(values: np.ndarray, rise: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Which quantities (K,) another minimum within `REACH` puts beyond the interval around the lowest one.

    Parameters
    ----------
    values: (M, K) of the quantities at M minima, the lowest first. rise: (M,) of their deviances above the lowest.
    reach: (K,) half-widths of the Gauss-Newton intervals at the lowest; nan counts as zero.
    """
    near = np.flatnonzero(rise[1:] < REACH) + 1
    return np.asarray((np.abs(values[near] - values[0]) > np.nan_to_num(reach)).any(axis=0))


@dataclass(frozen=True)
class Threshold:
    """Of K quantities at the lowest minimum.

    Attributes
    ----------
    rise: (K,) increase of the deviance up to which values belong to an interval.
    several: (K,) whether it is raised because another minimum fits almost as well.
    near: the quantities to first order. jacobian: (4 N, P) whitened derivatives.
    null_chi2: (D,) deviances of fits to noise alone.
    """

    rise: np.ndarray
    several: np.ndarray
    near: Linearised
    jacobian: np.ndarray
    null_chi2: np.ndarray


def threshold(
    model: Model, data: Data, minima: Minima, wanted: Sequence[Quantity], draws: Draws, level: float
) -> Threshold:
    """The threshold of ``wanted`` quantities of a fit that found the ``minima``; ``draws``: of the noise of its lines.

    A squared residual above that of noise multiplies it by their ratio (Birge 1932), the curvature of the model by
    `mcstudy.identification.curvature`, and another minimum that competes with the lowest one by
    `factor`.
    """
    near = Linearised.at(model, minima, wanted)
    jacobian = whiten(data.weight, frf_jacobian(model, minima.theta[0], data.f)[1])
    corrected = correction(jacobian[:, near.free], near.gradients[:, near.free], draws)
    worse = max(1.0, float(minima.chi2[0] / corrected.null_chi2.mean()))
    bent = curvature(model, data, minima.theta[0], near, wanted)
    rise = worse * (1 + bent) * corrected.threshold(level)
    values = np.array([[q.value(theta) for q in wanted] for theta in minima.theta])
    several = separated(values, (minima.chi2 - minima.chi2[0]) / worse, np.sqrt(rise * near.variance))
    rise = np.where(several, factor(level) * rise, rise)
    return Threshold(rise, several, near, jacobian, corrected.null_chi2)
