"""Parameters of the model without and with the leading cause, and whether data, prior or bounds determine them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.fitting.penalised import Fitted

MOSTLY_PRIOR = 0.7
"""Standard error relative to the prior standard deviation from which a value counts as determined by the prior."""

SOURCES = {"data": "", "prior": "mostly prior", "bound": "on its bound"}
"""What determines the value of a parameter, and the text for it in a table."""

SOURCES_EXPLAINED = {
    "prior": f"mostly prior: the standard error is at least {MOSTLY_PRIOR:g} times the prior standard deviation, so "
    "the prior determines the value more than the data do.",
    "bound": "on its bound: the fit ends on a bound, so there is no standard error.",
}
"""What those texts mean."""


@dataclass(frozen=True)
class Shift:
    """A parameter of the base model, estimated without and with the leading cause.

    Attributes
    ----------
    name, unit
        Name of the parameter, and the unit of all four numbers.
    without, without_se
        Estimate and standard error of the model without effects.
    added, added_se
        The same with the leading cause; None without one.
    without_from, added_from
        What determines the estimates: "data", "prior" (mostly the prior) or "bound".
    """

    name: str
    unit: str
    without: float
    without_se: float
    added: float | None
    added_se: float | None
    without_from: str = "data"
    added_from: str | None = None


def sources(fitted: Fitted) -> tuple[str, ...]:
    """Per parameter of a fit, a key of `SOURCES`."""
    model, prior = fitted.model, fitted.prior
    share = np.sqrt(np.diag(fitted.covariance)) / prior.scale
    near = 1e-6 * (model.upper - model.lower)
    on_bound = (fitted.theta <= model.lower + near) | (fitted.theta >= model.upper - near)
    return tuple(
        "bound" if bound else "prior" if s >= MOSTLY_PRIOR else "data" for bound, s in zip(on_bound, share, strict=True)
    )


def shifts(base: Fitted, added: Fitted | None) -> tuple[Shift, ...]:
    """Estimates of all base parameters by the base fit and, if there is a leading cause, by the fit with it."""
    se = np.sqrt(np.diag(base.covariance))
    added_se = None if added is None else np.sqrt(np.diag(added.covariance))
    origin = sources(base)
    added_origin = None if added is None else sources(added)
    out = []
    for k, p in enumerate(base.model.parameters):
        value = None if added is None else float(added.theta[k])
        error = None if added_se is None else float(added_se[k])
        origins = origin[k], None if added_origin is None else added_origin[k]
        out.append(Shift(p.name, p.unit, float(base.theta[k]), float(se[k]), value, error, *origins))
    return tuple(out)
