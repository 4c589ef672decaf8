"""Where fits start."""

from __future__ import annotations

import numpy as np

from mcstudy.stance.feedback import Model


def uniform(model: Model, rng: np.random.Generator, n: int) -> np.ndarray:
    """``n`` starts uniform between the bounds, (n, P). A longer draw from the same stream begins with a shorter one."""
    return model.lower + (model.upper - model.lower) * rng.random((n, len(model.parameters)))
