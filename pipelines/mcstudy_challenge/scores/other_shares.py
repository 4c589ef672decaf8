"""Whether stated probabilities are right where another share of the recordings lacks nothing.

Posterior probabilities are calibrated for the shares of their prior. The cases of a challenge, weighted so that those
without a missing effect have another share, tell how far a method is off there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mcstudy_challenge.scores.grade import Judged
from mcstudy_challenge.scores.rates import Estimate
from mcstudy_challenge.scores.targets import nothing

SHARES = (0.1, 0.3, 0.5)
"""Of the cases without a missing effect."""


def other_shares(main: Sequence[Judged]) -> list[dict[str, Any]]:
    """By share: stated probability of the first hypothesis minus how often it is right, and of nothing minus the share.

    Empty unless some cases lack something and some lack nothing.
    """
    null = np.array([nothing(j) for j in main])
    if not null.any() or null.all():
        return []
    first = np.array([j.stated - j.top for j in main])
    none = np.array([j.none for j in main]) - null
    out = []
    for share in SHARES:
        weight = np.where(null, share / null.mean(), (1 - share) / (1 - null.mean()))
        found = {"first": _mean(first, weight), "none": _mean(none, weight)}
        out.append({"nulls": share, **{name: f.to_dict() for name, f in found.items()}})
    return out


def _mean(x: np.ndarray, weight: np.ndarray) -> Estimate:
    """Weighted mean with a normal 95 % interval; values are between -1 and 1."""
    keep = ~np.isnan(x)
    x, w = x[keep], weight[keep] / weight[keep].sum()
    value = float(w @ x)
    error = 1.96 * math.sqrt(float((w**2) @ (x - value) ** 2))
    return Estimate(value, max(value - error, -1.0), min(value + error, 1.0), x.size)
