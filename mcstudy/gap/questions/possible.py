"""Whether a body can have what a hypothesis says: sizes within limits, none of them on a bound of the fit.

A size on a bound of the fit is where the search ended, not an estimate: the effect would explain the data only with
a size that was excluded. Bounds are two or more times the usual sizes. A bound at the null of an effect is different:
there the effect vanishes. The largest size a body can have (`Size.most`) is stated with its source in the library.
"""

from __future__ import annotations

from mcstudy.effect_library.library import LIBRARY
from mcstudy.fitting.penalised import Fitted
from mcstudy.gap.questions.evidence import Hypothesis

ON_BOUND = 1e-3
"""Distance from a bound, relative to the range between the bounds, that counts as on it."""

CERTAINLY = 1.96
"""Standard errors by which an estimate must exceed the largest size of a body."""


def possible(hypothesis: Hypothesis, base: Fitted) -> bool:
    """Whether a body can have the sizes of the effects; ``base``: the fit without effects."""
    fitted = hypothesis.fitted
    sizes = {s.name: s for e in LIBRARY.values() for s in e.sizes}
    for p, x in zip(fitted.model.parameters, fitted.theta, strict=True):
        if p.name in base.model.names or p.name not in sizes:
            continue
        margin = ON_BOUND * (p.upper - p.lower)
        if any(abs(x - b) <= margin and b != sizes[p.name].null for b in (p.lower, p.upper)):
            return False
    for estimate in hypothesis.sizes:
        most = sizes[estimate.name].most if estimate.name in sizes else None
        if most is not None and abs(estimate.estimate) - CERTAINLY * estimate.se > most:
            return False
    return True
