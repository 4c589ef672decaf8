"""Where fits start when only the bounds are known.

What to use when: `uniform` is the paper's choice and grows start by start; `sobol` fills the bounds more evenly and
grows too; `latin_hypercube` is even in every single parameter but only for the number of starts it was drawn for.
Starts that also look at the data are in `mcstudy.fitting.linearised`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mcstudy.fitting.sobol import sobol_points
from mcstudy.stance.feedback import Model


def uniform(model: Model, rng: np.random.Generator, n: int) -> np.ndarray:
    """``n`` starts uniform between the bounds, (n, P). A longer draw from the same stream begins with a shorter one."""
    return _between(model, rng.random((n, len(model.parameters))))


def sobol(model: Model, rng: np.random.Generator, n: int) -> np.ndarray:
    """``n`` scrambled Sobol points between the bounds, (n, P); most even when n is a power of two.

    The stream draws the scrambling alone, so a longer draw from the same stream begins with a shorter one.
    """
    return _between(model, sobol_points(len(model.parameters), rng, n))


def latin_hypercube(model: Model, rng: np.random.Generator, n: int) -> np.ndarray:
    """``n`` starts, (n, P), one in each of n equal slices of every parameter's bounds.

    The slices depend on ``n``: a longer draw from the same stream has other points, so a study that grows its number
    of starts must fit all of them again.
    """
    from scipy.stats import qmc  # half a second to import, which every other kind of start would wait for

    return _between(model, qmc.LatinHypercube(len(model.parameters), seed=rng).random(n))


def _between(model: Model, unit: np.ndarray) -> np.ndarray:
    return model.lower + (model.upper - model.lower) * unit


STARTS: dict[str, Callable[[Model, np.random.Generator, int], np.ndarray]] = {
    "uniform": uniform,
    "latin_hypercube": latin_hypercube,
    "sobol": sobol,
}
"""Starts that need no data, by the name a study file gives them."""
