"""Mean and spread of a quantity among people, from the likelihood of every person's value.

The values of people are drawn from a normal distribution with mean mu and standard deviation tau, on the scale of the
quantity itself, which is the scale of published means. What a person adds to the likelihood of mu and tau is

    w / sqrt(w^2 + tau^2)  max over x of  L(x) exp(-(x - mu)^2 / (2 tau^2)),    w = integral of L / sqrt(2 pi)

with the person's profile likelihood L, relative to its maximum. For a Gaussian L this is the integral over the
person's unknown value x, the likelihood of the usual random-effects model; for every L it has the limits of that
integral for small and large tau. In between the value is maximised instead of integrated, because L is a profile: where
it is flat, two parameters trade for each other, and the integral would prefer values in the middle of the flat part for
no other reason than that there are more of them. So a person of whom little is known adds little.

- tau maximises the likelihood integrated over mu (REML for Gaussian likelihoods).
- The interval of mu is that of its profile likelihood, in which the scale of all variances w^2 + tau^2 is free besides
  tau: how far people scatter is taken from how far they do, and w says only how people weigh. Likelihoods of fits are
  wider than their errors, so with the stated w intervals of small spreads would be too wide. The threshold
  n log(1 + t^2 / (n - 1)), with Student's t of n - 1 degrees of freedom, makes it exact for few people who are measured
  without error, or equally well: it is their t interval. At a fixed tau it is that of Hartung & Knapp (2001, Stat Med
  20:3875), which is too narrow where people are known unequally well and tau is not known.
- The interval of tau is that of its restricted likelihood with the threshold n log(1 + t^2 / (n - 1)). It is 4.50 for
  10 people; exact for normal people measured without error would be 3.99. The rest allows for people and errors that
  are not quite normal, to which a variance is more sensitive than a mean.
- Where likelihoods are flatter than Gaussian ones, the interval also covers the means of people who are all at the low,
  or all at the high, end of their flat part (each with its t interval). If flat parts make up half of it, it is said to
  be "flat", which is not determined.
- The value of each person, given the others, has weights averaged over mu and tau (flat priors).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import fft
from scipy.interpolate import CubicSpline
from scipy.special import logsumexp, ndtr, ndtri, stdtrit

from mcstudy.identification.people.likelihood import Likelihood

FINE = 8.0
"""Points of the grid per standard error of the best known value."""

MOST = 1 << 13
"""Most points of the grid."""

TAUS = 64
"""Values of tau, geometric, beside zero."""

BETWEEN = 100
"""Points between two of a grid at which a spline is looked at for its greatest value."""

NONE = 1e-3
"""Log likelihood ratio up to which no spread at all counts as the best estimate."""

MOST_UNDETERMINED = 0.5
"""Share of people whose interval a bound ends, from which the mean counts as undetermined on that side."""

FLAT = 0.25
"""Share of the interval of the mean, from which flat parts of the likelihoods are taken at their full length."""

MOST_FLAT = 0.5
"""Share of the interval of the mean, from which flat parts of the likelihoods count as what makes it wide."""

FLOOR = 1e-6
"""Least mean square of people in units of what is expected of them: flat likelihoods that overlap have none."""

NEGLIGIBLE = -20.0
"""Log likelihood ratio below which a standard deviation does not count."""

LEAST_TO_SHRINK = 3
"""Fewest people from whom the spread is known well enough to draw individual values towards the mean."""


class Interval(NamedTuple):
    """A value with the ends of its interval, and what sets each: "data", "bound" or "flat"."""

    value: float
    low: float
    high: float
    low_from: str = "data"
    high_from: str = "data"


@dataclass(frozen=True)
class Population:
    """n people with one quantity; at least two.

    Attributes
    ----------
    people: likelihood of every person's value. level: of the intervals.
    limits: values that are possible for the quantity, for example what the bounds of the fits allow.
    """

    people: Sequence[Likelihood]
    level: float
    limits: tuple[float, float] = (-np.inf, np.inf)

    @property
    def n(self) -> int:
        """Number of people."""
        return len(self.people)

    @cached_property
    def mu(self) -> np.ndarray:
        """Grid of values and means, (G,), evenly spaced."""
        support = np.array([p.support for p in self.people])
        low, high = support[:, 0].min(), support[:, 1].max()
        widths = np.array([p.width for p in self.people])
        narrowest = widths[widths > 0].min() if (widths > 0).any() else 0.0
        pad = self._wide(float(np.ptp([p.estimate for p in self.people])) + float(np.median(widths)))
        low, high = low - pad, high + pad
        step = max(narrowest / FINE, (high - low) / MOST) or 1.0
        return np.asarray(low + step * np.arange(int(np.ceil((high - low) / step)) + 1))

    def _wide(self, span: float) -> float:
        """Half-width beyond which no end of the interval lies when estimates lie within ``span``."""
        return float(stdtrit(self.n - 1, 0.5 + self.level / 2) / np.sqrt(self.n)) * span

    @property
    def _step(self) -> float:
        return float(self.mu[1] - self.mu[0])

    @cached_property
    def tau(self) -> np.ndarray:
        """Grid of standard deviations among people, (T,), ascending from 0."""
        longest = 2 * max(np.ptp([p.estimate for p in self.people]), np.median([p.width for p in self.people]))
        longest = max(longest, self._wide(longest), 4 * self._step)
        return np.concatenate([[0.0], np.geomspace(0.5 * self._step, longest, TAUS)])

    @cached_property
    def _log(self) -> np.ndarray:
        """Log likelihoods of the people on the grid, (n, G); widened where the grid is coarser than they are."""
        out = np.empty((self.n, self.mu.size))
        for i, p in enumerate(self.people):
            x = self.mu
            if p.width < self._step:
                x = p.estimate + (x - p.estimate) * (p.width / self._step if p.width else 0.0)
                out[i] = p.log(x) if p.width else -0.5 * ((self.mu - p.estimate) / self._step) ** 2
            else:
                out[i] = p.log(x)
        return out

    @cached_property
    def marginal(self) -> np.ndarray:
        """What every person adds to the log likelihood of tau and mu, (n, T, G)."""
        return np.array([self._greatest(log) for log in self._log]) + self._normaliser[..., None]

    @cached_property
    def _normaliser(self) -> np.ndarray:
        """Logarithm of what makes the integral of each person's share one, (n, T)."""
        w = np.exp(self._log).sum(axis=1)[:, None] * self._step / np.sqrt(2 * np.pi)
        return np.asarray(np.log(w / np.hypot(w, self.tau)))

    def _greatest(self, log: np.ndarray) -> np.ndarray:
        """Greatest log likelihood of one person's value and its distance from mu together, (T, G); ``log`` (G,)."""
        known = np.isfinite(log)
        x, log = self.mu[known], log[known]
        out = np.empty((self.tau.size, self.mu.size))
        out[0] = np.where(known, 0.0, -np.inf)
        out[0, known] = log
        # Of two neighbours the upper one is better for means above ``between - tau^2 slope``, which rises with x.
        between, slope, tau = (x[1:] + x[:-1]) / 2, np.diff(log) / self._step, self.tau[1:, None]
        above = np.ceil((between - tau**2 * slope - self.mu[0]) / self._step)
        above = np.clip(above, 0, self.mu.size).astype(int)  # the first mean on the grid for which it is better
        G, rows = self.mu.size, np.arange(tau.size)[:, None]
        counts = np.bincount((above + (G + 1) * rows).ravel(), minlength=tau.size * (G + 1))
        best = np.cumsum(counts.reshape(tau.size, G + 1)[:, :G], axis=1)
        away = x[best] - self.mu
        out[1:] = log[best] - (0.5 / tau**2) * (away * away)
        return out

    @cached_property
    def joint(self) -> np.ndarray:
        """Log likelihood of (tau, mu), (T, G); -inf for impossible means."""
        possible = (self.mu >= self.limits[0]) & (self.mu <= self.limits[1])
        return np.where(possible, self.marginal.sum(axis=0), -np.inf)

    @cached_property
    def restricted(self) -> np.ndarray:
        """Log likelihood of tau, integrated over mu, (T,), relative to its greatest value."""
        value = logsumexp(self.joint, axis=1)
        return np.asarray(value - value.max())

    @cached_property
    def _best_tau(self) -> float:
        """Standard deviation among people at which the restricted likelihood is greatest."""
        none = self.restricted[0] > -NONE
        return 0.0 if none else max(_argmax(self.tau, self.restricted), 0.0)

    @cached_property
    def scaled(self) -> np.ndarray:
        """Log likelihood of (tau, mu), (T, G), at the best common scale of all variances, w^2 + tau^2."""
        total = self._normaliser.sum(axis=0)[:, None]
        squares = np.maximum(-2 * (self.joint - total), FLOOR * self.n)
        return np.asarray(total - 0.5 * self.n * np.log(squares))

    @cached_property
    def deviance(self) -> np.ndarray:
        """Of mu, (G,): twice the log likelihood ratio, at the best tau and scale for each."""
        peak = _peak(self.scaled)
        return np.asarray(2 * (peak.max() - peak))

    @cached_property
    def t_squared(self) -> np.ndarray:
        """`deviance` as the square of a Student's t of n - 1 degrees of freedom, (G,)."""
        return np.asarray((self.n - 1) * np.expm1(np.minimum(self.deviance / self.n, 500.0)))

    def _t(self, level: float) -> float:
        """Student's t at the ends of an interval of the mean."""
        return float(stdtrit(self.n - 1, 0.5 + level / 2))

    @cached_property
    def _flat(self) -> np.ndarray:
        """Ends of the flat part of every person's likelihood, (n, 2)."""
        return np.array([p.flat for p in self.people])

    @cached_property
    def _flatness(self) -> float:
        """Length of the flat part of most people's likelihoods, as a share of the interval of the mean; at most 1."""
        length = float(np.median(np.diff(self._flat)))  # one who is not determined tells nothing
        low, high = crossings(self.mu, self.t_squared, self._t(self.level) ** 2)
        return length / max(high - low, length, 1e-300)

    @cached_property
    def _value(self) -> float:
        """The mean at the best standard deviation among people."""
        k = int(np.argmax(self.restricted))
        near = slice(max(k - 1, 0), k + 2)
        return float(np.interp(self._best_tau, self.tau[near], [_argmax(self.mu, row) for row in self.joint[near]]))

    def mean(self, level: float | None = None) -> Interval:
        """The mean, with its interval of ``level``, by default `level`; an interval holds those of lower levels."""
        level = self.level if level is None else level
        t = self._t(level)
        low, high = crossings(self.mu, self.t_squared, t * t)
        flat = self._flat
        end = "flat" if self._flatness > MOST_FLAT else "data"
        # All people may be at the same end of the flat parts of their likelihoods, which is no matter of chance.
        away, weight = t / np.sqrt(self.n) * flat.std(axis=0, ddof=1), min(self._flatness / FLAT, 1.0)
        low += weight * min(flat[:, 0].mean() - away[0] - low, 0.0)
        high += weight * max(flat[:, 1].mean() + away[1] - high, 0.0)
        return self._bounded(Interval(self._value, float(low), float(high), end, end), level)

    @cached_property
    def _normal(self) -> np.ndarray:
        """Fourier transforms of the normal densities of all tau, on at least twice the grid of values."""
        size = fft.next_fast_len(2 * self.mu.size, real=True)
        edges = (np.arange(size // 2 + 2) - 0.5) * self._step
        scale = np.maximum(self.tau, 1e-3 * self._step)[:, None]
        k = np.arange(size)
        return np.asarray(fft.rfft(np.diff(ndtr(edges / scale), axis=1)[:, np.minimum(k, size - k)], axis=1))

    def _spread(self, density: np.ndarray, some: np.ndarray) -> np.ndarray:
        """Sum over ``some`` tau, (G,), of densities of means, each convolved with the normal density of its tau."""
        G, size = self.mu.size, fft.next_fast_len(2 * self.mu.size, real=True)
        together = (self._normal[some] * fft.rfft(density, size, axis=1)).sum(axis=0)
        return np.asarray(fft.irfft(together, size)[:G])

    def _bounded(self, interval: Interval, level: float) -> Interval:
        """An interval that reaches as far as any person's on every side that most people leave undetermined."""
        goal = float(ndtri(0.5 + level / 2))
        open_low, open_high = np.mean([p.open for p in self.people], axis=0) >= MOST_UNDETERMINED
        _, low, high, low_from, high_from = interval
        if open_low or low <= self.limits[0]:
            low, low_from = min(low, *(p.at_root(-goal) for p in self.people)), "bound"
        if open_high or high >= self.limits[1]:
            high, high_from = max(high, *(p.at_root(goal) for p in self.people)), "bound"
        low, high = max(low, self.limits[0]), min(high, self.limits[1])
        return Interval(interval.value, min(low, interval.value), max(high, interval.value), low_from, high_from)

    def between(self) -> Interval:
        """Standard deviation among people, with the interval of its restricted likelihood.

        A lower end of zero, or an upper one at the end of the grid, is a "bound".
        """
        value, goal = self._best_tau, self.n * np.log1p(self._t(self.level) ** 2 / (self.n - 1))
        low, high = crossings(self.tau, -2 * self.restricted, goal)
        low_from = "bound" if low <= 0 else "data"
        high_from = "bound" if high >= self.tau[-1] else "data"
        return Interval(value, min(low, value), max(high, value), low_from, high_from)

    def individual(self) -> list[Interval]:
        """Value of each person, given the others too: posterior mean with central interval.

        Empty for fewer than `LEAST_TO_SHRINK` people.
        """
        if self.n < LEAST_TO_SHRINK:
            return []
        goal, flat = float(ndtri(0.5 + self.level / 2)), min(self._flatness / FLAT, 1.0)
        width = np.gradient(self.tau)[:, None]  # a flat prior on tau, whose grid is not even
        out = []
        possible = np.isfinite(self.joint)  # without spread, no mean beyond the bounds of any person is
        for i in range(self.n):
            others = np.where(possible, self.joint, 0.0) - np.where(possible, self.marginal[i], np.inf)
            others -= others.max()
            some = others.max(axis=1) > NEGLIGIBLE
            others = np.exp(others[some]) * width[some]
            prior = np.log(np.maximum(self._spread(others, some), 1e-300))
            log = self._log[i] + prior
            weight = np.exp(log - log.max())
            weight /= weight.sum()
            tail = (1 - self.level) / 2
            below = np.cumsum(weight) - weight / 2
            low, high = (float(np.interp(q, below, self.mu)) for q in (tail, 1 - tail))
            alone = [self.people[i].at_root(root) for root in (-goal, goal)]
            low, high = low + flat * min(alone[0] - low, 0.0), high + flat * max(alone[1] - high, 0.0)
            out.append(Interval(float(weight @ self.mu), low, high))
        return out


def _peak(log: np.ndarray) -> np.ndarray:
    """Greatest value along the first axis (T, G), with a parabola through the three points around it."""
    k = np.clip(np.argmax(log, axis=0), 2, len(log) - 2)  # the first interval, from tau = 0, is not of equal ratio
    column = np.arange(log.shape[1])
    with np.errstate(invalid="ignore", divide="ignore"):
        a, b, c = (log[k + i, column] for i in (-1, 0, 1))
        rise = np.where(a - 2 * b + c < 0, b - (c - a) ** 2 / (8 * (a - 2 * b + c)), b)
    greatest = log.max(axis=0)
    inner = (b >= a) & (b >= c) & np.isfinite(a) & np.isfinite(c)
    return np.where(inner, np.maximum(rise, greatest), greatest)


def _argmax(x: np.ndarray, log: np.ndarray) -> float:
    """The value at which a function is greatest, by a spline through the points around the greatest."""
    k = int(np.argmax(log))
    near = slice(max(k - 3, 0), k + 4)
    x, log = x[near], log[near]
    fine = np.linspace(x[0], x[-1], 6 * BETWEEN + 1)
    return float(fine[np.argmax(CubicSpline(x, log)(fine))] if np.isfinite(log).all() else x[np.argmax(log)])


def crossings(x: np.ndarray, deviance: np.ndarray, goal: float) -> tuple[float, float]:
    """The outermost values at which a deviance is ``goal``, or the ends of ``x``; between points by its root."""
    root = np.sqrt(np.maximum(np.minimum(deviance, 1e12), 0.0))
    inside = np.flatnonzero(root <= np.sqrt(goal))
    ends = []
    for k, step in ((inside[0], -1), (inside[-1], 1)):
        if not 0 <= k + step < x.size:
            ends.append(float(x[k]))
            continue
        share = (np.sqrt(goal) - root[k]) / (root[k + step] - root[k])
        ends.append(float(x[k] + share * (x[k + step] - x[k])))
    return ends[0], ends[1]
