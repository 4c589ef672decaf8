"""The difference of two means: of the same people under two conditions, or of different people."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from mcstudy.identification.people.population import Interval, Population, crossings

FAR, COARSE, FINER = 40.0, 81, 12
"""Standard errors up to which a difference of two means is sought, points of the first grid (denser in the middle), and
of the one between two of these."""


LEAST_P = 1e-12
"""p-values below are not told apart."""

STEPS = 40
"""Bisections of a p-value."""


class Difference(NamedTuple):
    """A difference of two means, and the p-value of no difference: 1 minus the level of the interval that ends at 0."""

    interval: Interval
    p_value: float


def paired(population: Population) -> Difference:
    """Of people whose likelihoods are those of their own differences."""
    return _tested(population.mean, population.level)


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
    fine = np.unique(np.clip(np.append(at + far * np.linspace(-1, 1, COARSE) ** 3, 0.0), *ends))
    values = least(fine)
    lowest = values.min()
    v = np.square(widths)
    dof = v.sum() ** 2 / (v[0] ** 2 / (a.n - 1) + v[1] ** 2 / (b.n - 1))
    inside = np.flatnonzero(values - lowest <= stdtrit(dof, 0.5 + a.level / 2) ** 2)
    near = max(inside[0], 1), min(inside[-1] + 1, fine.size - 1)
    more = np.concatenate([np.linspace(fine[n - 1], fine[n], FINER)[1:-1] for n in near])  # a finer grid at both ends
    fine, values = np.append(fine, more), np.append(values, least(more))
    order = np.argsort(fine)
    fine, values = fine[order], values[order]

    def interval(level: float) -> Interval:
        low, high = crossings(fine, values - lowest, stdtrit(dof, 0.5 + level / 2) ** 2)
        m, k = a.mean(level), b.mean(level)
        low_from, high_from = _worse(k.low_from, m.high_from), _worse(k.high_from, m.low_from)
        low = min(low, k.low - m.high) if low_from != "data" else low
        high = max(high, k.high - m.low) if high_from != "data" else high
        return Interval(at, min(low, at), max(high, at), low_from, high_from)

    return _tested(interval, a.level)


def _tested(interval: Callable[[float], Interval], level: float) -> Difference:
    """The interval of ``level``, and the p-value of zero from the intervals of all levels, each of which holds those of
    lower levels: below 1 - ``level`` if, and only if, the interval does not hold zero."""
    stated = interval(level)
    holds = stated.low <= 0 <= stated.high
    low, high = (1 - level, 1.0) if holds else (LEAST_P, 1 - level)
    for _ in range(STEPS):
        p = float(np.sqrt(low * high))
        tried = interval(1 - p)
        low, high = (p, high) if tried.low <= 0 <= tried.high else (low, p)
    return Difference(stated, high if holds else low)


def _worse(*ends: str) -> str:
    """What ends the interval of a difference of two means whose intervals end at these."""
    return next((end for end in ("bound", "flat") if end in ends), "data")


def _half(p: Population) -> float:
    """Standard error of a mean: half the distance between the values at which t is 1."""
    low, high = crossings(p.mu, p.t_squared, 1.0)
    return (high - low) / 2
