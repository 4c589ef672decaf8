"""Multilevel estimates of bias, spread and error: many cheap fits, corrected by few complete ones.

The estimate x of a realization is that of the best of many starts. A control c is the estimate of a cheap fit of the
same data. A moment of x is the mean of the control over N other draws of the data, plus the mean of the difference over
n realizations:

    M_k = mean_N(c^k) + mean_n(x^k - c^k)

Its expectation is that of x^k, whatever the control is. Where control and estimate agree in most realizations, the
difference varies little and a small n is enough. Bias, standard deviation, coefficient of variation, root mean squared
error and the Monte Carlo standard error of each are functions of the first four moments about the truth. Their own
errors follow from the contributions of the draws (delta method). Kept apart, the contributions also give the covariance
of the estimates at two designs that share draws.

Source: Giles 2015, Multilevel Monte Carlo methods, Acta Numerica 24:259-328.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
    """Estimates of one quantity at one design; draws with NaN are left out.

    Attributes
    ----------
    full: those of the complete fits of n realizations, (n,). truth: the true value.
    control: those of the cheap fits of the same realizations, (n,); None without a control.
    sample: those of cheap fits of other draws of the data, (N,).
    """

    full: np.ndarray
    truth: float
    control: np.ndarray | None = None
    sample: np.ndarray | None = None


@dataclass(frozen=True)
class Estimate:
    """A measure with its Monte Carlo error.

    Attributes
    ----------
    value: of the measure. own: contributions of the realizations to its deviation from the expectation, (n,).
    sampled: those of the other draws, (N,), empty without a control.
    """

    value: float
    own: np.ndarray
    sampled: np.ndarray

    @property
    def error(self) -> float:
        """Monte Carlo standard error."""
        return float(np.sqrt(np.sum(self.own**2) + np.sum(self.sampled**2)))

    def with_draws(self, realizations: int, others: int, alike: float = 1.0) -> Estimate:
        """The same value with the contributions that other numbers of realizations and draws are expected to have.

        ``alike``: correlation of the contributions of the same realizations and draws with those of this estimate.
        """
        own, sampled = _resized(self.own, realizations, alike), _resized(self.sampled, others, alike)
        return Estimate(self.value, own, sampled)

    def with_unseen(self, part: float) -> Estimate:
        """The same with an error that counts one more realization, whose difference from its control is ``part``."""
        return Estimate(self.value, np.append(self.own, part), self.sampled)

    def times(self, factor: float) -> Estimate:
        """The same in another unit."""
        return Estimate(self.value * factor, self.own * factor, self.sampled * factor)


def _resized(parts: np.ndarray, n: int, alike: float) -> np.ndarray:
    """Contributions of n draws, inversely proportional to n. The last number stands for all that is new in them."""
    if not parts.size or not n:
        return np.zeros(0)
    shared = np.zeros(max(parts.size, n) + 1)
    shared[: min(parts.size, n)] = alike * parts[:n]
    every = np.sum(parts**2) * n / parts.size
    shared[-1] = np.sqrt(max(every - np.sum(shared**2), 0.0))
    return shared * parts.size / n


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
    x, c = draws.full, draws.control
    usable = np.isfinite(x) if c is None else np.isfinite(x) & np.isfinite(c)
    if usable.sum() < FEWEST:
        return Estimate(np.nan, np.full(x.size, np.inf), np.empty(0))
    scale = float(np.sqrt(np.mean((x[usable] - draws.truth) ** 2))) or max(abs(draws.truth), 1.0)

    def powers(values: np.ndarray) -> np.ndarray:
        return np.asarray(((values - draws.truth) / scale) ** np.arange(1, ORDERS + 1)[:, None])

    levels = [(usable, powers(x[usable]) if c is None else powers(x[usable]) - powers(c[usable]))]
    if c is not None and draws.sample is not None:
        known = np.isfinite(draws.sample)
        levels.append((known, powers(draws.sample[known])))
    moments, parts = np.zeros(ORDERS), [np.zeros((ORDERS, 0))] * 2
    for level, (kept, values) in enumerate(levels):
        n, mean = values.shape[1], values.mean(axis=1)
        moments += mean
        parts[level] = np.zeros((ORDERS, kept.size))
        parts[level][:, kept] = (values - mean[:, None]) / np.sqrt(n * (n - 1))
    truth = draws.truth / scale
    slope = _slope(measure.of, moments, truth)
    if measure is not MEASURES["rmse"]:  # the square of the mean is too large by the variance of the mean
        moments[1] += sum(np.sum(p[0] ** 2) for p in parts)
    unit = 1.0 if measure.relative else scale
    own, sampled = (slope @ p * unit for p in parts)
    return Estimate(float(measure.of(moments, truth)) * unit, own, sampled)


def unlike(samples: Sequence[np.ndarray]) -> np.ndarray:
    """A value for each sample, (K,), that it might hold although it does not, as far away as the farthest of all.

    Few draws may hold none of the rare ones that end in another minimum, and then show a spread that is far too small
    with an error that is far too small. Other samples, of the same draws at other designs, may hold some. Distances
    count from the sample's median, in units of the 68 % quantile of its distances; none is larger than the largest of
    all samples. NaN in the samples are left out.

    Parameters
    ----------
    samples: K arrays, each with at least one number.
    """
    centres = [float(np.nanmedian(x)) for x in samples]
    apart = [np.abs(x - c)[np.isfinite(x)] for x, c in zip(samples, centres, strict=True)]
    usual = [float(np.quantile(d, 0.68)) for d in apart]
    far = max(float(d.max()) for d in apart)
    ratio = max((float(d.max()) / u for d, u in zip(apart, usual, strict=True) if u > 0), default=1.0)
    return np.array([c + (min(ratio * u, far) if u > 0 else far) for c, u in zip(centres, usual, strict=True)])


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
    """Realizations with complete fits for every draw of the control, n / N, that cost least for the same error.

    Parameters
    ----------
    difference: variance of what x - c contributes, relative to that of what c contributes.
    control_cost, full_cost: of one draw of the control, and of one realization with both fits.

    Source: Giles 2015, section 1.3, for two levels.
    """
    return float(np.sqrt(max(difference, 0.0) * control_cost / full_cost))


def relative_cost(difference: float, control_cost: float, full_cost: float) -> float:
    """Cost of the multilevel estimate at its best share, relative to complete fits alone, for the same error."""
    root = np.sqrt(control_cost / full_cost) + np.sqrt(max(difference, 0.0) * (1 + control_cost / full_cost))
    return float(root**2)


def difference_of(draws: Draws, measure: Measure) -> float:
    """Variance of the contributions of x - c to a measure, relative to those of x, from realizations with both."""
    assert draws.control is not None
    usable = np.isfinite(draws.full) & np.isfinite(draws.control)
    x, c = draws.full[usable], draws.control[usable]
    if x.size < FEWEST or not np.any(x != draws.truth):
        return 1.0
    scale = float(np.sqrt(np.mean((x - draws.truth) ** 2)))
    power = np.arange(1, ORDERS + 1)[:, None]
    u, v = (((y - draws.truth) / scale) ** power for y in (x, c))
    slope = _slope(measure.of, u.mean(axis=1), draws.truth / scale)
    full = slope @ u
    return float((slope @ (u - v)).var() / full.var()) if full.var() > 0 else 1.0
