"""The likelihood of one person's value of a quantity, and of the difference between two of that person's values.

A profile gives the deviance at some values. It is continued here to a function of every value: the signed root of the
deviance, which is a straight line for a Gaussian likelihood, is interpolated between the points and continued in a
straight line beyond ends that the data set. Beyond an end that a bound sets the likelihood is zero. No Gaussian shape
is assumed, so flat, one-sided and skewed likelihoods stay what they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from mcstudy.identification.estimate import Estimate
from mcstudy.identification.fit_record import FitRecord
from mcstudy.stance.feedback import Model

REACH = 6.0
"""Root of the deviance up to which a likelihood counts as not zero."""

NODES = 400
"""Values at which the likelihood of a difference is computed."""

FREE = "data", "steps"
"""Ends beyond which a likelihood goes on."""


@dataclass(frozen=True)
class Likelihood:
    """Profile likelihood of one value, relative to its maximum.

    Attributes
    ----------
    value, root
        (M,), ascending: values, and the signed root of the deviance, scaled so that it is compared with a standard
        normal distribution.
    estimate
        The value of the greatest likelihood, one of ``value``.
    low_from, high_from
        What ends the individual interval, as in `Estimate`. Beyond a bound the likelihood is zero.
    limits
        Values that are possible; beyond them the likelihood is zero.
    open
        For either side, whether something else than the data ends the individual interval there.
    """

    value: np.ndarray
    root: np.ndarray
    estimate: float
    low_from: str = "data"
    high_from: str = "data"
    limits: tuple[float, float] = (-np.inf, np.inf)
    open: tuple[bool, bool] = (False, False)

    @classmethod
    def of(cls, e: Estimate, level: float, limits: tuple[float, float] = (-np.inf, np.inf)) -> Likelihood:
        """Of an estimate whose interval has ``level``; ``limits``: values that are possible.

        The threshold of that interval holds all corrections for the estimated noise. The deviance is divided by its
        ratio to the threshold of a known noise.
        """
        goal = float(ndtri(0.5 + level / 2))
        value, root = e.profile.value, np.sqrt(np.maximum(e.profile.rise, 0.0))
        ends = [k for k, end in ((0, e.low_from), (-1, e.high_from)) if end == "data"]
        root = root * goal / max([goal, *root[ends]])
        root[[k for k in ends if value[k] != e.estimate]] = goal  # also where the deviance jumps over the threshold
        value, root = hull(value, root, e.estimate)
        open_ = e.low_from not in FREE, e.high_from not in FREE
        return cls(value, np.sign(value - e.estimate) * root, e.estimate, e.low_from, e.high_from, limits, open_)

    @property
    def width(self) -> float:
        """Half the distance between the values at which the root is -1 and 1, or between the ends."""
        return float(self.at_root(1.0) - self.at_root(-1.0)) / 2

    @property
    def support(self) -> tuple[float, float]:
        """Between which values the likelihood is not zero."""
        return self.at_root(-REACH), self.at_root(REACH)

    @property
    def flat(self) -> tuple[float, float]:
        """Between which values the likelihood is flatter than a Gaussian one with the same interval.

        On either side: how much farther from the estimate the root is 1/2 than if it rose in a straight line up to 2.
        """
        ends = []
        for side in (-1, 1):
            near, far = (abs(self.at_root(side * root) - self.estimate) for root in (0.5, 2.0))
            ends.append(self.estimate + side * max(near - far / 4, 0.0))
        return ends[0], ends[1]

    def at_root(self, root: float) -> float:
        """The value at which the signed root of the deviance is ``root``, or the end before it."""
        return float(np.clip(self._at_root(root), *self.limits))

    def _at_root(self, root: float) -> float:
        k, slope = (-1, self._slope(-1)) if root > 0 else (0, self._slope(0))
        if (root - self.root[k]) * np.sign(root) <= 0:
            return float(np.interp(root, self.root, self.value))
        if (self.high_from if root > 0 else self.low_from) not in FREE or slope == 0:
            return float(self.value[k])
        return float(self.value[k] + (root - self.root[k]) / slope)

    def log(self, x: np.ndarray) -> np.ndarray:
        """Logarithm of the likelihood at values ``x``, same shape; -inf beyond a bound."""
        root = np.interp(x, self.value, self.root)
        for k, end, beyond in ((0, self.low_from, x < self.value[0]), (-1, self.high_from, x > self.value[-1])):
            far = self.root[k] + self._slope(k) * (x - self.value[k]) if end in FREE else np.inf
            root = np.where(beyond, far, root)
        possible = (x >= self.limits[0]) & (x <= self.limits[1])
        return np.where(possible, -0.5 * root**2, -np.inf)

    def _slope(self, k: int) -> float:
        """Slope of the root beyond the first or last point: that of the last two points, so that it stays convex."""
        near, far = (1, 0) if k == 0 else (-2, -1)
        away = self.value[far] - self.value[near]
        return float((self.root[far] - self.root[near]) / away) if away and self.value[k] != self.estimate else 0.0


def of_fit(fitted: FitRecord) -> dict[str, Likelihood]:
    """Likelihoods of all quantities of a fit, by name."""
    return {e.name: Likelihood.of(e, fitted.level, possible(fitted.model, e.name)) for e in fitted.estimates}


def possible(model: Model, name: str) -> tuple[float, float]:
    """Between which values the bounds of the fit allow a parameter or a sum of parameters; others are not limited."""
    terms = name.split(" + ")
    if not set(terms) <= set(model.names):
        return -np.inf, np.inf
    positions = [model.names.index(t) for t in terms]
    return float(model.lower[positions].sum()), float(model.upper[positions].sum())


def hull(value: np.ndarray, root: np.ndarray, at: float) -> tuple[np.ndarray, np.ndarray]:
    """Values and roots of the deviance (without sign) on the lower convex hull of the points of a profile.

    The root of a Gaussian likelihood's deviance is convex: it rises in a straight line on both sides of the estimate
    ``at``. A point above the hull belongs to a farther valley, or the profile levels off there; the hull then gives
    values between the estimate and the end of the interval more likelihood, never less.
    """
    keep = value != at
    value, root = np.append(value[keep], at), np.append(root[keep], 0.0)
    order = np.lexsort((root, value))
    chosen: list[int] = []
    for k in order:
        while len(chosen) > 1 and _above(value, root, chosen[-2], chosen[-1], k):
            chosen.pop()
        chosen.append(int(k))
    return value[chosen], root[chosen]


def _above(x: np.ndarray, y: np.ndarray, a: int, b: int, c: int) -> bool:
    """Whether point b lies above the line from a to c."""
    return bool((y[b] - y[a]) * (x[c] - x[a]) > (y[c] - y[a]) * (x[b] - x[a]))


def difference(second: Likelihood, first: Likelihood) -> Likelihood:
    """The likelihood of ``second`` minus ``first``, two values of one person: the greatest over their level."""
    (a, b), (c, d) = second.support, first.support
    x, y = np.linspace(a, b, NODES), np.linspace(c, d, NODES)
    x, y = (np.unique(np.append(v, p.estimate)) for v, p in ((x, second), (y, first)))
    at = second.estimate - first.estimate
    wanted = np.unique(np.append(np.linspace(a - d, b - c, NODES), at))
    best = np.full(wanted.size, -np.inf)
    for values, fixed, moved in (
        (x, second, lambda z: (first, z[None, :] - wanted[:, None])),
        (y, first, lambda z: (second, wanted[:, None] + z[None, :])),
    ):
        best = np.maximum(best, _greatest(values, fixed, moved))
    keep = np.isfinite(best)
    value, root = hull(wanted[keep], np.sqrt(np.maximum(-2 * best[keep], 0.0)), at)
    root = np.sign(value - at) * root
    ends = _end(second.low_from, first.high_from), _end(second.high_from, first.low_from)
    open_ = second.open[0] or first.open[1], second.open[1] or first.open[0]
    return Likelihood(value, root, at, *ends, open=open_)


def _greatest(
    values: np.ndarray, fixed: Likelihood, moved: Callable[[np.ndarray], tuple[Likelihood, np.ndarray]]
) -> np.ndarray:
    other, at = moved(values)
    return np.asarray((fixed.log(values)[None, :] + other.log(at)).max(axis=1))


def _end(*ends: str) -> str:
    """What ends the interval of a difference whose terms end at these."""
    return next((end for end in ends if end not in FREE), "data")
