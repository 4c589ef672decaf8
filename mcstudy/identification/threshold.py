"""How far the deviance of one recording may rise: the threshold of every interval of its fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mcstudy.fitting.penalised import Data, whiten
from mcstudy.identification.correction import Draws, correction
from mcstudy.identification.minimum import Minima
from mcstudy.identification.profile import Linearised
from mcstudy.identification.quantities import Quantity
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf_jacobian


@dataclass(frozen=True)
class Threshold:
    """Of K quantities at the lowest minimum.

    Attributes
    ----------
    rise: (K,) increase of the deviance up to which values belong to an interval.
    near: the quantities to first order. jacobian: (4 N, P) whitened derivatives.
    null_chi2: (D,) deviances of fits to noise alone.
    """

    rise: np.ndarray
    near: Linearised
    jacobian: np.ndarray
    null_chi2: np.ndarray


def threshold(
    model: Model, data: Data, minima: Minima, wanted: Sequence[Quantity], draws: Draws, level: float
) -> Threshold:
    """The threshold of ``wanted`` quantities of a fit that found the ``minima``; ``draws``: of the noise of its lines.

    A squared residual above that of noise multiplies it by their ratio (Birge 1932).
    """
    near = Linearised.at(model, minima, wanted)
    jacobian = whiten(data.weight, frf_jacobian(model, minima.theta[0], data.f)[1])
    corrected = correction(jacobian[:, near.free], near.gradients[:, near.free], draws)
    worse = max(1.0, float(minima.chi2[0] / corrected.null_chi2.mean()))
    return Threshold(worse * corrected.threshold(level), near, jacobian, corrected.null_chi2)
