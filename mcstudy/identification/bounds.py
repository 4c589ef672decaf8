"""The bounds of a fit to a person."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mcstudy.errors import InputError
from mcstudy.stance.body import standing
from mcstudy.stance.feedback import Model

GAIN_UPTO = 5.0
"""Default upper bound of a gain, times its nominal value; the lower one is zero."""

DELAY_S = (0.01, 0.3)
"""Default bounds of a delay, s."""


def bounded(model: Model, base: Model, given: Mapping[str, tuple[float, float]]) -> Model:
    """The model with the bounds of a fit to a person, the ``given`` ones among them.

    A declared model has its own. By default gains of ``base`` lie between zero and `GAIN_UPTO` times the nominal value,
    its delays in `DELAY_S`, and sizes of effects within their own bounds. A nominal value outside its bounds is moved
    between them.

    Raises `InputError` for an unknown parameter or impossible bounds.
    """
    for name, ends in given.items():
        if name not in model.names:
            raise InputError(f"bounds: expected parameters of the model ({', '.join(model.names)}), got {name!r}")
        least = 0.0 if name in model.delays else -np.inf
        if not (len(ends) == 2 and np.isfinite(ends).all() and least <= ends[0] < ends[1]):
            raise InputError(f"bounds of {name}: expected a lower and a larger upper value, got {ends}")
    bounds = {**_default_bounds(base), **given}
    parameters = []
    for p in model.parameters:
        low, high = bounds.get(p.name, (p.lower, p.upper))
        value = p.value if low <= p.value <= high else (low + high) / 2
        parameters.append(replace(p, value=value, lower=low, upper=high))
    return replace(model, parameters=tuple(parameters))


def _default_bounds(model: Model) -> dict[str, tuple[float, float]]:
    low, high = DELAY_S
    if not standing(model):
        return {}
    return {
        p.name: (min(low, p.value), max(high, p.value))
        if p.name in model.delays
        else (p.lower, p.upper)
        if p.name in model.weights
        else (min(0.0, GAIN_UPTO * p.value), max(0.0, GAIN_UPTO * p.value))
        for p in model.parameters
    }
