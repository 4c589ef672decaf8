"""What answers are worth, and whether stated probabilities are right, where another share of recordings lacks nothing.

Posterior probabilities are calibrated for the shares of their prior. The cases of a challenge, weighted so that those
without a missing effect have another share, tell how far a method is off there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mcstudy_challenge.scores.grade import SCORES, Judged
from mcstudy_challenge.scores.rates import Bounds, Estimate
from mcstudy_challenge.scores.targets import nothing

SHARES = (0.1, 0.3, 0.5)
"""Of the cases without a missing effect."""


def other_shares(main: Sequence[Judged], shares: Sequence[float] = SHARES) -> list[dict[str, Any]]:
    """By share: stated probability of the first hypothesis minus how often it is right, and of nothing minus the share.

    Also the mean log loss. Empty unless some cases lack something and some lack nothing.
    """
    null = np.array([nothing(j) for j in main])
    if not null.any() or null.all():
        return []
    first = np.array([j.stated - j.top for j in main])
    none = np.array([j.none for j in main]) - null
    loss = np.array([j.log_loss for j in main])
    out = []
    for share in shares:
        weight = np.where(null, share / null.mean(), (1 - share) / (1 - null.mean()))
        found = {"first": _mean(first, weight), "none": _mean(none, weight)}
        found["log_loss"] = _mean(loss, weight, SCORES["log_loss"])
        out.append({"nulls": share, **{name: f.to_dict() for name, f in found.items()}})
    return out


def _mean(x: np.ndarray, weight: np.ndarray, bounds: Bounds = (-1.0, 1.0)) -> Estimate:
    """Weighted mean of bounded values with a normal 95 % interval."""
    lowest, highest = bounds
    keep = ~np.isnan(x)
    x, w = x[keep], weight[keep] / weight[keep].sum()
    value = float(w @ x)
    error = 1.96 * math.sqrt(float((w**2) @ (x - value) ** 2))
    return Estimate(value, max(value - error, lowest), min(value + error, highest), x.size)
