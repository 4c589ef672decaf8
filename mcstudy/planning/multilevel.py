"""Multilevel estimates of bias, spread and error: many cheap fits, corrected by few complete ones.

The estimate x of a realization is that of the best of many starts. A control c is the estimate of a cheap fit of the
same data. A moment of x is the mean of the control over N realizations plus the mean of the difference over the first
n of them:

    M_k = mean_N(c^k) + mean_n(x^k - c^k)

Its expectation is that of x^k, whatever the control is; with n = N the control cancels. Where control and estimate
agree in most realizations, the difference varies little and a small n is enough (Giles 2015). Bias, standard deviation,
coefficient of variation, root mean squared error and the Monte Carlo standard error of each are functions of the first
four moments about the truth. Their own errors follow from the contributions of the realizations (delta method). Kept
apart, the contributions also give the covariance of the estimates at two designs that share realizations.

Source: Giles 2015, Multilevel Monte Carlo methods, Acta Numerica 24:259-328.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

ORDERS = 4
"""Moments that the measures need: their own errors are made of the third and fourth."""

STEP = 1e-4
"""Step of the central differences of a measure over the moments, which are of order one."""

FEWEST = 8
"""Complete fits below which no moments are computed."""

Function = Callable[[np.ndarray, float], np.ndarray]
"""From moments (4,) or (4, n) about the truth, and the truth, to a number; all in one unit."""


@dataclass(frozen=True)
class Measure:
    """A property of an estimator.

    Attributes
    ----------
    of: its value from the moments. relative: whether it has no unit. signed: whether it may be negative.
    """

    name: str
    of: Function
    relative: bool = False
    signed: bool = False


@dataclass(frozen=True)
class Draws:
    """Estimates of one quantity at one design.

    Attributes
    ----------
    control: those of the cheap fit, (N,). full: those of the complete fit of the first n realizations, (n,), n <= N;
    NaN where no start gave a usable fit. truth: the true value.
    """

    control: np.ndarray
    full: np.ndarray
    truth: float


@dataclass(frozen=True)
class Estimate:
    """A measure with its Monte Carlo error.

    Attributes
    ----------
    value: of the measure. contributions: of every realization to its deviation from the expectation, (N,).
    """

    value: float
    contributions: np.ndarray

    @property
    def error(self) -> float:
        """Monte Carlo standard error."""
        return float(np.sqrt(np.sum(self.contributions**2)))


def _bias(moments: np.ndarray, truth: float) -> np.ndarray:
    del truth
    return np.asarray(moments[0])


def _sd(moments: np.ndarray, truth: float) -> np.ndarray:
    del truth
    return np.asarray(np.sqrt(np.maximum(moments[1] - moments[0] ** 2, 0.0)))


def _cv(moments: np.ndarray, truth: float) -> np.ndarray:
    return np.asarray(_sd(moments, truth) / np.abs(truth + moments[0]))


def _rmse(moments: np.ndarray, truth: float) -> np.ndarray:
    del truth
    return np.asarray(np.sqrt(np.maximum(moments[1], 0.0)))


MEASURES = {
    m.name: m
    for m in (
        Measure("cv", _cv, relative=True),
        Measure("sd", _sd),
        Measure("bias", _bias, signed=True),
        Measure("rmse", _rmse),
    )
}
"""Measures by the name that a target gives them; definitions as in `mcstudy.analysis.accuracy`."""


def of_one_realization(measure: Measure) -> Measure:
    """The Monte Carlo standard error of ``measure``, a function of two moments, times the root of the realizations."""

    def error(moments: np.ndarray, truth: float) -> np.ndarray:
        slope = _slope(measure.of, moments, truth)
        variance = sum(
            slope[i] * slope[j] * (moments[i + j + 1] - moments[i] * moments[j]) for i in range(2) for j in range(2)
        )
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    return Measure(f"mcse of {measure.name}", error, measure.relative)


def estimated(draws: Draws, measure: Measure) -> Estimate:
    """The multilevel estimate of a measure, in the unit of the estimates unless ``measure.relative``.

    NaN, with an infinite error, for fewer than `FEWEST` usable complete fits.
    """
    n, N = draws.full.size, draws.control.size
    usable = np.isfinite(draws.full)
    if usable.sum() < FEWEST:
        return Estimate(np.nan, np.full(N, np.inf))
    scale = float(np.sqrt(np.mean((draws.full[usable] - draws.truth) ** 2))) or max(abs(draws.truth), 1.0)
    powers = np.arange(1, ORDERS + 1)[:, None]
    c = ((draws.control - draws.truth) / scale) ** powers
    d = ((draws.full[usable] - draws.truth) / scale) ** powers - c[:, :n][:, usable]
    m = d.shape[1]
    parts = (c - c.mean(axis=1, keepdims=True)) / N
    parts[:, np.flatnonzero(usable)] += (d - d.mean(axis=1, keepdims=True)) / m
    parts *= np.sqrt(m / (m - 1))
    moments = c.mean(axis=1) + d.mean(axis=1)
    truth = draws.truth / scale
    slope = _slope(measure.of, moments, truth)
    # the square of the mean is too large by the variance of the mean, and the variance too small
    spread = moments.copy()
    if measure is not MEASURES["rmse"]:
        spread[1] += np.sum(parts[0] ** 2)
    unit = 1.0 if measure.relative else scale
    return Estimate(float(measure.of(spread, truth)) * unit, slope @ parts * unit)


def _slope(function: Function, moments: np.ndarray, truth: float) -> np.ndarray:
    """Derivatives over the moments, of the shape of ``moments``."""
    out = np.zeros_like(moments)
    for k in range(ORDERS):
        low, high = moments.copy(), moments.copy()
        low[k] -= STEP
        high[k] += STEP
        out[k] = (function(high, truth) - function(low, truth)) / (2 * STEP)
    return out


def best_share(difference: float, control_cost: float, full_cost: float) -> float:
    """Share n / N of realizations with complete fits that gives the smallest error for a given number of fits.

    Parameters
    ----------
    difference: variance of what a realization contributes through x - c, relative to that of what c contributes.
    control_cost, full_cost: fits of one control, and of one complete fit.

    Source: Giles 2015, eq. 1.4 for two levels; the levels share realizations here, so it is nearly the best.
    """
    if difference <= 0:
        return 0.0
    return float(min(1.0, np.sqrt(difference * control_cost / (full_cost + control_cost))))


def relative_cost(difference: float, control_cost: float, full_cost: float) -> float:
    """Fits of the multilevel estimate at its best share, relative to complete fits alone, for the same error."""
    root = np.sqrt(control_cost) + np.sqrt(max(difference, 0.0) * (full_cost + control_cost))
    return float(root**2 / full_cost)


def difference_of(draws: Draws, measure: Measure) -> float:
    """Variance of the contributions of x - c to a measure, relative to those of x, from realizations with both."""
    usable = np.isfinite(draws.full)
    x, c = draws.full[usable], draws.control[: draws.full.size][usable]
    both = estimated(Draws(x, x, draws.truth), measure)
    if not np.isfinite(both.value) or both.error == 0:
        return 1.0
    scale = float(np.sqrt(np.mean((x - draws.truth) ** 2))) or 1.0
    powers = np.arange(1, ORDERS + 1)[:, None]
    u, v = ((y - draws.truth) / scale for y in (x, c))
    slope = _slope(measure.of, (u**powers).mean(axis=1), draws.truth / scale)
    full, apart = slope @ u**powers, slope @ (u**powers - v**powers)
    return float(apart.var() / full.var()) if full.var() > 0 else 1.0
