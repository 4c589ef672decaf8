"""What is held to be known about a person before a recording is fitted.

Nothing is known about a new person beyond the order of magnitude of the parameters: a gain is its nominal value
(scaled to the body's weight) with a standard deviation of `GAIN_SPREAD` times it, a delay with `DELAY_SPREAD_S`, a
sensory weight with `WEIGHT_SPREAD`. The bounds are wider still (gains -1 to 4 times nominal, delays 5 to 250 ms,
weights -1 to 2): they are reached by nobody and keep the statistics regular.

Of a declared model the bounds are those that it declares, and nothing else is known: the standard deviation of a
parameter is `DECLARED_SPREAD` times their distance.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mcstudy.effect_library import library
from mcstudy.fitting.arguments import Prior
from mcstudy.stance.body import standing
from mcstudy.stance.feedback import Model, Parameter

GAIN_SPREAD = 0.5
"""Prior standard deviation of a gain, relative to its nominal value."""

WEIGHT_SPREAD = 0.3
"""Prior standard deviation of a sensory weight, which lies between 0 and 1."""

DECLARED_SPREAD = 0.25
"""Prior standard deviation of a parameter of a declared model, relative to the distance of its bounds; with bounds of
0 and twice the value that of a gain."""

DELAY_SPREAD_S = 0.025
"""Prior standard deviation of a delay, s."""


def opened(model: Model) -> Model:
    """The model with bounds so wide that nobody reaches them; a declared one with its own."""
    if not standing(model):
        return model
    return model.with_bounds(
        {
            p.name: (min(0.005, p.value), max(0.25, p.value))
            if p.name in model.delays
            else (-1.0, 2.0)
            if p.name in model.weights
            else (-abs(p.value), 4.0 * abs(p.value))
            for p in model.parameters
        }
    )


def weak_prior(model: Model, base: Model) -> Prior:
    """Weak priors on the parameters of ``base``; on what effects added, the whole range within the bounds; (P,) each.

    Published sizes enter the evidence (`mcstudy.gap.questions.evidence`), not the fit: an estimate must not be
    pulled.
    """
    spread = _spreads(base)
    # Effects of a declared model are generated, which takes longer than a fit.
    known = library.library_of(base) if set(model.names) - set(base.names) else library.LIBRARY
    sizes, forms = known.sizes, {f.name: f for e in known.values() for f in e.forms}
    mean, scale = [], []
    for p in model.parameters:
        if p.name in base.names:
            mean.append(p.value)
            scale.append(spread(p))
        elif p.name in forms:
            mean.append(forms[p.name].prior[0])
            scale.append(forms[p.name].prior[1])
        else:
            size = sizes[p.name]
            mean.append(size.prior[0])
            scale.append(size.prior[1] if size.is_shape else size.upper - size.lower)
    return Prior(np.array(mean), np.array(scale))


def _spreads(base: Model) -> Callable[[Parameter], float]:
    """Prior standard deviation of a parameter of ``base``."""
    if not standing(base):
        declared = {p.name: DECLARED_SPREAD * (p.upper - p.lower) for p in base.parameters}
        return lambda p: declared[p.name]

    def spread(p: Parameter) -> float:
        if p.name in base.delays:
            return DELAY_SPREAD_S
        return WEIGHT_SPREAD if p.name in base.weights else GAIN_SPREAD * abs(p.value)

    return spread
