"""Intervals of further quantities of a finished fit, without another search."""

from __future__ import annotations

from collections.abc import Sequence

from mcstudy.fitting.penalised import Data, Fitter, whiten
from mcstudy.identification.correction import correction, simulated
from mcstudy.identification.minimum import Minima, without_prior
from mcstudy.identification.profile import Linearised, Profile, profiles
from mcstudy.identification.quantities import Quantity
from mcstudy.spectra.lines import Lines
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import frf_jacobian
from mcstudy.streams import stream


def further_profiles(
    model: Model, base: Model, lines: Lines, minima: Minima, wanted: Sequence[Quantity], level: float, seed: int
) -> list[Profile]:
    """Profiles of the ``wanted`` quantities of a fit of ``model`` to ``lines`` that found the ``minima``.

    ``base``: ``model`` without effects. The threshold is chosen as in `mcstudy.identification.fit.fit_lines`.
    """
    if not wanted:
        return []
    data, theta = Data.of(lines), minima.theta[0]
    near = Linearised.at(model, minima, wanted)
    jacobian = whiten(data.weight, frf_jacobian(model, theta, lines.f)[1])
    free = near.free
    draws = simulated(lines.noise, stream(seed, "fit correction"))
    corrected = correction(jacobian[:, free], near.gradients[:, free], draws)
    worse = max(1.0, float(minima.chi2[0] / corrected.null_chi2.mean()))
    fitter = Fitter(model, without_prior(model, base), lines.f)
    return profiles(fitter, data, minima, wanted, worse * corrected.threshold(level))
