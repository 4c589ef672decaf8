"""The difference of two means: of the same people under two conditions, or of different people."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import stdtr, stdtrit

from mcstudy.identification.population import Interval, Population, crossings

FAR, COARSE, FINER = 40.0, 81, 12
"""Standard errors up to which a difference of two means is sought, points of the first grid (denser in the middle), and
of the one between two of these."""


class Difference(NamedTuple):
    """A difference of two means, and the p-value of no difference."""

    interval: Interval
    p_value: float


def paired(population: Population) -> Difference:
    """Of people whose likelihoods are those of their own differences."""
    t = np.sqrt(np.interp(0.0, population.mu, population.t_squared))
    return Difference(population.mean(), float(2 * stdtr(population.n - 1, -t)))


def unpaired(second: Population, first: Population) -> Difference:
    """Mean of ``second`` minus mean of ``first``, different people.

    The squares of both t are added at the best pair of means with each difference; degrees of freedom after Welch.
    """
    a, b = first, second
    at, widths = b.mean().value - a.mean().value, [_half(p) for p in (a, b)]
    x = np.linspace(a.mu[0], a.mu[-1], 2001)
    left = np.interp(x, a.mu, a.t_squared)

    def least(wanted: np.ndarray) -> np.ndarray:
        right = np.array([np.interp(x + d, b.mu, b.t_squared, left=np.inf, right=np.inf) for d in wanted])
        return np.asarray((left + right).min(axis=1))

    ends = b.mu[0] - a.mu[-1], b.mu[-1] - a.mu[0]
    far = min(FAR * float(np.hypot(widths[0], widths[1])), 0.5 * (ends[1] - ends[0]))
    wanted = np.unique(np.clip(at + far * np.linspace(-1, 1, COARSE) ** 3, *ends))
    together = least(wanted)
    lowest = together.min()
    v = np.square(widths)
    dof = v.sum() ** 2 / (v[0] ** 2 / (a.n - 1) + v[1] ** 2 / (b.n - 1))
    goal = stdtrit(dof, 0.5 + a.level / 2) ** 2
    fine, values = wanted, together
    inside = np.flatnonzero(together - lowest <= goal)
    for n in (max(inside[0], 1), min(inside[-1] + 1, wanted.size - 1)):  # a finer grid around either end
        more = np.linspace(wanted[n - 1], wanted[n], FINER)[1:-1]
        fine, values = np.append(fine, more), np.append(values, least(more))
    order = np.argsort(fine)
    low, high = crossings(fine[order], values[order] - lowest, goal)
    m, k = a.mean(), b.mean()
    low_from, high_from = _worse(k.low_from, m.high_from), _worse(k.high_from, m.low_from)
    low = k.low - m.high if low_from != "data" else low
    high = k.high - m.low if high_from != "data" else high
    t = np.sqrt(max(float(least(np.zeros(1))[0] - lowest), 0.0))
    return Difference(Interval(at, min(low, at), max(high, at), low_from, high_from), float(2 * stdtr(dof, -t)))


def _worse(*ends: str) -> str:
    """What ends the interval of a difference of two means whose intervals end at these."""
    return next((end for end in ("bound", "flat") if end in ends), "data")


def _half(p: Population) -> float:
    """Standard error of a mean: half the distance between the values at which t is 1."""
    low, high = crossings(p.mu, p.t_squared, 1.0)
    return (high - low) / 2
