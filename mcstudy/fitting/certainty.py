"""How certain it is that a pool of starts has found the lowest minimum, and when to stop drawing starts.

A *pool* is the set of fits of one problem from different starts. A fit is a success (*hit*) if its cost is within
`HIT_TOLERANCE` of the pool's minimum. The chance that as many new starts have no hit estimates the chance that the pool
missed a lower minimum. Over many problems the estimate is right in the mean; for a single pool it is not, because a
pool that missed the lowest minimum counts its hits in a higher one, which may be easy to reach. Who stops drawing where
the estimate is small therefore stops too early. `certain` is cautious in two ways: it needs `FIRST_LOOK` starts, and it
takes the success rate at the lower end of its 95 % interval (``pipelines/validation/until_certain.py`` measures both).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mcstudy.fitting.status import WANTED

MISSED = "chance that as many new starts miss the lowest minimum"
"""What `missed` is, for readers; it stands beside every best fit of several starts."""

HIT_TOLERANCE = 1e-3
"""Relative excess of cost that still counts as the same minimum (too small to matter for any recording)."""

COST_FLOOR = 1e-12
"""Excess of cost that counts as none: without noise the minimum is rounding, and no ratio to it means anything.
The paper's cost is 1 for a model that predicts no sway at all, so the floor is on a scale of 1."""

FIRST_LOOK = 100
"""Starts before the first decision; the number doubles from one decision to the next."""


def looks(most: int) -> list[int]:
    """Numbers of starts after which it is decided whether to go on; the last is ``most``, whatever was found.

    All but the last are the same for every ``most``, so that a larger maximum only adds starts.
    """
    out = [min(FIRST_LOOK, most)]
    while out[-1] < most:
        out.append(min(2 * out[-1], most))
    return out


def missed(rate: Any, starts: Any) -> Any:
    """Chance that ``starts`` new starts miss a minimum that a share ``rate`` of starts reaches; numbers or arrays."""
    return (1 - rate) ** starts


def certain(cost: np.ndarray) -> np.ndarray:
    """Which pools of costs (..., starts) have found the lowest minimum; infinite or NaN: a start without a success.

    The upper end of the 95 % interval of `missed`, from the lower end of that of the success rate, is below `WANTED`.
    """
    cost = np.where(np.isfinite(cost), cost, np.inf)
    lowest, n = cost.min(axis=-1), cost.shape[-1]
    hits = (cost <= (lowest * (1 + HIT_TOLERANCE) + COST_FLOOR)[..., None]).sum(axis=-1)
    centre, half = score_interval(hits / n, n)
    return np.isfinite(lowest) & (missed(np.maximum(centre - half, 0.0), n) < WANTED)


def normal_quantile(confidence: float) -> float:
    """Two-sided standard normal quantile, e.g. 1.96 for 0.95."""
    from scipy.special import ndtri  # SciPy, which those who count fits do not need

    return float(ndtri(0.5 + confidence / 2))


def score_interval(m: Any, n: Any, phi: float = 1.0, confidence: float = 0.95) -> tuple[Any, Any]:
    """Centre and half width of the score interval of a mean ``m`` of ``n`` values from 0 to 1 (numbers or arrays).

    It ends at the roots mu of n (m - mu)^2 = z^2 phi mu (1 - mu), with z `normal_quantile`: Wilson's interval of a
    fraction when ``phi`` is 1, a narrower one when the values vary less than those of 0 and 1 only
    (Wilson 1927, J Am Stat Assoc 22:209).
    """
    a = normal_quantile(confidence) ** 2 * phi / n
    return (m + a / 2) / (1 + a), np.sqrt(a * (m * (1 - m) + a / 4)) / (1 + a)
