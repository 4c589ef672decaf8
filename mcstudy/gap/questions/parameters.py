"""Parameters of the model without and with the leading cause, and whether data, prior or bounds determine them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcstudy.fitting.penalised import Fitted
from mcstudy.lines.priors import DECLARED_SPREAD, DELAY_SPREAD_S, GAIN_SPREAD, WEIGHT_SPREAD

MOSTLY_PRIOR = 0.5
"""Share of the precision of an estimate that the priors add, its own and those of parameters that trade for it, from
which its value counts as determined by the prior."""

SOURCES = {"data": "", "prior": "mostly prior", "bound": "on its bound"}
"""What determines the value of a parameter, and the text for it in a table."""

DECLARED_EXPLAINED = (
    "The diagnosis uses a weak prior: a normal distribution around the declared values, with a standard deviation of "
    f"{100 * DECLARED_SPREAD:.0f} % of the distance between the declared bounds. The command mcstudy fit estimates "
    "without a prior."
)
"""What the prior of a declared model is."""

PRIOR_EXPLAINED = (
    "The diagnosis uses a weak prior, not knowledge of this person: a normal distribution around the values of the "
    "base model (by default stand-ins for the subjects of Goodworth & Peterka, gains scaled to this weight), with "
    f"a standard deviation of {100 * GAIN_SPREAD:.0f} % of a gain, {1000 * DELAY_SPREAD_S:.0f} ms of a delay "
    f"and {WEIGHT_SPREAD} of the sensory weight of a tilt. "
    "The command mcstudy fit estimates without a prior."
)
"""What the prior of the diagnosis is (`mcstudy.lines.priors`)."""

SOURCES_EXPLAINED = {
    "prior": "mostly prior: without the priors its variance would be at least twice as large, so they determine the "
    "value and its error more than the data do; this includes the prior of a parameter that it trades for.",
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
    model = fitted.model
    share = prior_share(fitted)
    near = 1e-6 * (model.upper - model.lower)
    on_bound = (fitted.theta <= model.lower + near) | (fitted.theta >= model.upper - near)
    return tuple(
        "bound" if bound else "prior" if s >= MOSTLY_PRIOR else "data" for bound, s in zip(on_bound, share, strict=True)
    )


def prior_share(fitted: Fitted) -> np.ndarray:
    """(P,) share of the precision of every estimate that the priors add: 1 if the data alone do not determine it."""
    scale = fitted.prior.scale
    scaled = fitted.information * np.outer(scale, scale)
    value, vector = np.linalg.eigh(scaled)
    value = np.maximum(value, 1e-12)  # directions of which the data say nothing
    alone = (vector**2 / value).sum(axis=1)
    both = (vector**2 / (value + fitted.prior.weight)).sum(axis=1)
    return np.asarray(1 - both / alone)


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
