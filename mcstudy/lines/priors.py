"""What is held to be known about a person before a recording is fitted.

Nothing is known about a new person beyond the order of magnitude of the parameters: a gain is its nominal value
(scaled to the body's weight) with a standard deviation of `GAIN_SPREAD` times it, a delay with `DELAY_SPREAD_S`, a
sensory weight with `WEIGHT_SPREAD`. The bounds are wider still (gains -1 to 4 times nominal, delays 5 to 250 ms,
weights -1 to 2): they are reached by nobody and keep the statistics regular.
"""

from __future__ import annotations

import numpy as np

from mcstudy.effect_library import library
from mcstudy.fitting.arguments import Prior
from mcstudy.stance.feedback import Model

GAIN_SPREAD = 0.5
"""Prior standard deviation of a gain, relative to its nominal value."""

WEIGHT_SPREAD = 0.3
"""Prior standard deviation of a sensory weight, which lies between 0 and 1."""

DELAY_SPREAD_S = 0.025
"""Prior standard deviation of a delay, s."""


def opened(model: Model) -> Model:
    """The model with bounds so wide that nobody reaches them."""
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
    sizes = {s.name: s for e in library.LIBRARY.values() for s in e.sizes}
    forms = {f.name: f for e in library.LIBRARY.values() for f in e.forms}
    mean, scale = [], []
    for p in model.parameters:
        if p.name in base.names:
            mean.append(p.value)
            scale.append(
                DELAY_SPREAD_S
                if p.name in base.delays
                else WEIGHT_SPREAD
                if p.name in base.weights
                else GAIN_SPREAD * abs(p.value)
            )
        elif p.name in forms:
            mean.append(forms[p.name].prior[0])
            scale.append(forms[p.name].prior[1])
        else:
            size = sizes[p.name]
            mean.append(size.prior[0])
            scale.append(size.prior[1] if size.is_shape else size.upper - size.lower)
    return Prior(np.array(mean), np.array(scale))
