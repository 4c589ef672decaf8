"""What linear theory says of a target: the closed form, without bounds on the parameters and without missed minima."""

from __future__ import annotations

import numpy as np

from mcstudy.analysis.efficiency import linearised_covariance
from mcstudy.errors import InputError
from mcstudy.fitting.problem import paper_cost
from mcstudy.planning.fits import Design, Fitter
from mcstudy.planning.targets import Target
from mcstudy.stance.information import cramer_rao
from mcstudy.stance.response import frf


def linear_values(fitter: Fitter, design: Design, target: Target) -> tuple[float, float]:
    """A target's measure at a design, for the study's own cost and at the Cramer-Rao bound, in the target's unit.

    NaN for a bias or a Monte Carlo error, without a law of the FRFs (`Fitter.law`), and where the frequencies do not
    determine the parameters.
    """
    if target.mcse or target.measure.signed or not fitter.controls:
        return np.nan, np.nan
    model, law = fitter.model, fitter.law(design.cycles)
    experiment = fitter.experiment(design.cycles)
    f = experiment.f[: experiment.points[design.fmax]]
    size = f.size * law.mean.shape[1]
    joint = law.joint[:size, :size] / design.amplitude**2
    slope = target.quantity.gradient(model.truth)
    unit = target.factor / (abs(target.truth) if target.measure.relative else 1.0)
    try:
        bound = cramer_rao(model, model.truth, f, joint)
        covariance = bound
        if fitter.group.fit.cost == "paper":
            weight = paper_cost(model, f, frf(model, model.truth, f)).weight
            covariance = linearised_covariance(model, model.truth, f, weight, joint)
    except (InputError, np.linalg.LinAlgError):
        return np.nan, np.nan
    moved = slope != 0
    values = (np.sqrt(slope[moved] @ c[np.ix_(moved, moved)] @ slope[moved]) * unit for c in (covariance, bound))
    first, second = values
    return float(first), float(second)
