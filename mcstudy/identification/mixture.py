"""Distributions of one quantity in several explanations of the same recording, pooled by their weights.

The distribution of a quantity in one explanation is the one that its profile likelihood implies: the signed root of the
rise of the deviance is standard normal (the confidence distribution). Pooled by weight, the ends of an interval are the
values at which the weighted tails have the wanted probability: the model-averaged tail area of Turek & Fletcher (2012,
Computational Statistics & Data Analysis 56:2809), with profiles in place of normal tails. One explanation alone gives
back its profile likelihood interval.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr, ndtri

from mcstudy.identification.profile import Profile

NODES = np.linspace(-4.5, 4.5, 181)
"""Standard normal deviates at which a distribution is kept."""

NEAR, POINTS = 0.02, 41
"""Probability around that of a quantile in which it is sought, and points at which the distributions are read there."""

AT_BOUND = 0.005
"""Probability exactly on the end of an interval from which a bound ends it, not the data."""

WEIGHT = np.exp(-(NODES**2) / 2) / np.exp(-(NODES**2) / 2).sum()
"""Probability of each."""


def distribution(profile: Profile, estimate: float, threshold: float, level: float) -> np.ndarray:
    """Values (Z,) of a quantity at `NODES`; ``threshold``: rise of the deviance at the ends of the ``level`` interval.

    Beyond the last point of the profile it goes on along the line from the estimate; a bound ends it.
    """
    root = np.sqrt(np.maximum(profile.rise, 0.0) / threshold) * ndtri(0.5 + level / 2)
    root *= np.sign(profile.value - estimate)
    first = np.concatenate([[True], np.diff(root) > 0])
    root, value = root[first], profile.value[first]
    out = np.interp(NODES, root, value)
    for end, beyond in ((-1, root[-1] < NODES), (0, root[0] > NODES)):
        if root[end]:
            out[beyond] = value[end] + (NODES[beyond] - root[end]) * (value[end] - estimate) / root[end]
    return np.clip(
        out,
        profile.low if profile.low_from == "bound" else -np.inf,
        profile.high if profile.high_from == "bound" else np.inf,
    )


def quantiles(values: np.ndarray, weight: np.ndarray, at: Sequence[float]) -> np.ndarray:
    """Quantiles ``at`` some probabilities of distributions (C, Z) with weights (C,) that sum to 1.

    The pooled nodes tell where a quantile lies within their spacing, the distributions there where exactly.
    """
    q, w = values.ravel(), np.outer(weight, WEIGHT).ravel()
    order = np.argsort(q)
    q, below = q[order], np.cumsum(w[order]) - w[order] / 2
    out = []
    for p in at:
        near = np.interp(p + NEAR * np.linspace(-1, 1, POINTS), below, q)
        exact = weight @ np.array([np.interp(near, one, ndtr(NODES), left=0.0, right=1.0) for one in values])
        out.append(float(np.interp(p, exact, near)))
    return np.array(out)


def on_bound(values: np.ndarray, weight: np.ndarray, end: float) -> bool:
    """Whether distributions (C, Z) with weights (C,) have at least `AT_BOUND` of their probability on an ``end``."""
    return bool((weight @ (np.abs(values - end) <= 1e-9 * abs(end)) @ WEIGHT) > AT_BOUND)
