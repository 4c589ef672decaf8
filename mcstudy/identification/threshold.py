"""How far the deviance of one recording may rise: the threshold of every interval of its fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.fitting.penalised import Data, whiten
from mcstudy.identification.correction import Draws, correction
from mcstudy.identification.curvature import curvature
from mcstudy.identification.minimum import Minima
from mcstudy.identification.profile import Linearised
from mcstudy.identification.quantities import Quantity
from mcstudy.identification.several_minima import apart, factor
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf_jacobian


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
    `mcstudy.identification.several_minima.factor`.
    """
    near = Linearised.at(model, minima, wanted)
    jacobian = whiten(data.weight, frf_jacobian(model, minima.theta[0], data.f)[1])
    corrected = correction(jacobian[:, near.free], near.gradients[:, near.free], draws)
    worse = max(1.0, float(minima.chi2[0] / corrected.null_chi2.mean()))
    bent = curvature(model, data, minima.theta[0], near, wanted)
    rise = worse * (1 + bent) * corrected.threshold(level)
    values = np.array([[q.value(theta) for q in wanted] for theta in minima.theta])
    several = apart(values, (minima.chi2 - minima.chi2[0]) / worse, np.sqrt(rise * near.variance))
    rise = np.where(several, factor(level) * rise, rise)
    return Threshold(rise, several, near, jacobian, corrected.null_chi2)
