"""Monte Carlo standard errors: the standard deviation of a result over repetitions of the study with new noise.

The sampling unit is the *realization*: one draw of the sensor noise serves every amplitude, every Fmax and every
parameter (common random numbers), so whatever is averaged over those is correlated. One engine respects that for
every statistic, simple or aggregated: the delete-one jackknife over realizations, applied to the first two moments
of each cell. It needs three sums per cell, works chunk by chunk, and stays lazy on dask-backed data.

A result is a Dataset with ``value`` and ``mcse`` (one standard error), ``n`` (realizations used) and ``left_out``
(realizations that could not be used).

Sources: Efron & Stein 1981 (jackknife variance); Wilson 1927 (binomial interval); Maritz & Jarrett 1978 (standard
error of a sample quantile); Morris, White & Crowther 2019 (MCSE of the simple measures, which the jackknife equals
to first order).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
import xarray as xr
from scipy.special import bdtr, bdtrc, betainc, ndtri

REALIZATION = "realization"
"""Name of the dimension that is sampled."""


A = TypeVar("A", xr.DataArray, xr.Variable)
"""Numbers with coordinates or without."""


@dataclass(frozen=True)
class Moments(Generic[A]):
    """Per-cell moments of an estimate over realizations; their dims are those of the estimate without realizations.

    Attributes
    ----------
    mean: sample mean. sd: sample standard deviation (divisor n - 1). mse: mean squared distance from the truth.
    truth: the true value, broadcastable.
    n: number of realizations in each cell.
    """

    mean: A
    sd: A
    mse: A
    truth: A
    n: A


Statistic = Callable[[Moments[xr.DataArray]], xr.DataArray]
"""A statistic of the study: a function of the cells' moments, possibly averaging over cells and parameters."""

PlainStatistic = Callable[[Moments[xr.Variable]], xr.Variable]
"""The same where it needs no coordinates: arithmetic, and means over dims. It takes a fifth of the time, because to
compare and copy coordinates in every step takes longer than the numbers do."""


def moments(x: xr.DataArray, truth: xr.DataArray) -> Moments[xr.DataArray]:
    """Moments over realizations; NaN entries of ``x`` are realizations that are left out."""
    x, truth = xr.align(x, truth, join="inner", copy=False)
    return _with_coordinates(_moments(x.variable, truth.variable)[0], x, truth)


def _moments(v: xr.Variable, truth: xr.Variable) -> tuple[Moments[xr.Variable], xr.Variable, xr.Variable]:
    """Moments, and the deviations from the mean and squared errors they are made of (zero where left out)."""
    n = v.notnull().sum(REALIZATION)
    mean = v.fillna(0.0).sum(REALIZATION) / n.where(n > 0)
    deviation, error2 = (v - mean).fillna(0.0), ((v - truth) ** 2).fillna(0.0)
    sd = ((deviation**2).sum(REALIZATION) / (n - 1).where(n > 1)) ** 0.5
    mse = error2.sum(REALIZATION) / n.where(n > 0)
    return Moments(mean, sd, mse, truth, n), deviation, error2


def _with_coordinates(m: Moments[xr.Variable], x: xr.DataArray, truth: xr.DataArray) -> Moments[xr.DataArray]:
    own = _coordinates(x, m.mean.dims)
    mean, sd, n = (xr.DataArray(v, own) for v in (m.mean, m.sd, m.n))
    return Moments(mean, sd, xr.DataArray(m.mse, _coordinates(x, m.mse.dims, truth)), truth, n)


def _coordinates(x: xr.DataArray, dims: tuple[Hashable, ...], other: xr.DataArray | None = None) -> xr.Coordinates:
    """The coordinates of ``x``, and of ``other``, that numbers with these dims made of them have."""
    every = x.coords if other is None else x.coords.merge(other.coords).coords
    held = every.to_dataset()
    return held.drop_vars([name for name, c in held.variables.items() if not set(c.dims) <= set(dims)]).coords


def _with_deleted(v: xr.Variable, truth: xr.Variable) -> tuple[Moments[xr.Variable], Moments[xr.Variable]]:
    """Moments of each cell, and the same with each realization deleted in turn (those keep the realization dim)."""
    full, deviation, error2 = _moments(v, truth)
    n, mean = full.n, full.mean
    n1 = n - v.notnull()
    some, several = n1.where(n1 > 0), (n1 - 1).where(n1 > 1)
    # deleting i moves the mean, so the sum of squares about the new mean drops by y_i^2 n / (n - 1)
    ss1 = ((deviation**2).sum(REALIZATION) - deviation**2 * n / some).clip(min=0.0)
    mse1 = (error2.sum(REALIZATION) - error2) / some
    return full, Moments(mean - deviation / some, (ss1 / several) ** 0.5, mse1, truth, n1)


def jackknife(x: xr.DataArray, truth: xr.DataArray, statistic: Statistic) -> xr.Dataset:
    """Value of a statistic and its Monte Carlo standard error.

    Parameters
    ----------
    x: estimates, any dims with ``realization`` among them; NaN marks a realization that is left out of a cell.
    truth: broadcastable to ``x`` without its realizations.
    statistic: maps `Moments` to the number(s) of interest.

    Returns
    -------
    Dataset ``value``, ``mcse``, ``n``, ``left_out``. Where cells that enter one value used different numbers of
    realizations, ``n`` is the smallest. ``mcse`` is NaN for fewer than three realizations.
    """
    x, truth = xr.align(x, truth, join="inner", copy=False)
    full, deleted = _with_deleted(x.variable, truth.variable)
    value = statistic(_with_coordinates(full, x, truth))
    replicate = statistic(_with_coordinates(deleted, x, truth))
    used = _used(x.variable, value.dims)
    at = xr.DataArray(used, _coordinates(x, used.dims))
    replicate, at = xr.align(replicate, at, join="inner", copy=False)
    error = _error(replicate.variable, at.variable)
    mcse = xr.DataArray(error, _coordinates(replicate, error.dims, at))
    least = _least(full.n, value.dims)
    n = xr.DataArray(least, _coordinates(x, least.dims))
    return xr.Dataset({"value": value, "mcse": mcse, "n": n, "left_out": x.sizes[REALIZATION] - n})


def jackknives(x: xr.DataArray, truth: xr.DataArray, statistics: Sequence[PlainStatistic]) -> list[xr.Dataset]:
    """`jackknife` of several statistics that need no coordinates and share the moments."""
    x, truth = xr.align(x, truth, join="inner", copy=False)
    full, deleted = _with_deleted(x.variable, truth.variable)
    out = []
    for statistic in statistics:
        value = statistic(full)
        mcse = _error(statistic(deleted), _used(x.variable, value.dims))
        n = _least(full.n, value.dims)
        variables = {"value": value, "mcse": mcse, "n": n, "left_out": x.sizes[REALIZATION] - n}
        out.append(xr.Dataset(variables, _coordinates(x, value.dims, truth)))
    return out


def _pooled(dims: tuple[Hashable, ...], kept: tuple[Hashable, ...]) -> list[Hashable]:
    return [d for d in dims if d not in (*kept, REALIZATION)]


def _used(v: xr.Variable, dims: tuple[Hashable, ...]) -> xr.Variable:
    """Whether a realization enters a value with these dims."""
    pooled, used = _pooled(v.dims, dims), v.notnull()
    return used.any(pooled) if pooled else used


def _least(n: xr.Variable, dims: tuple[Hashable, ...]) -> xr.Variable:
    """Realizations that enter a value with these dims; of cells that are pooled in it, the smallest number."""
    pooled = _pooled(n.dims, dims)
    return n.min(pooled) if pooled else n


def _error(replicate: xr.Variable, used: xr.Variable) -> xr.Variable:
    """Standard error from the values with each realization deleted in turn."""
    g = used.sum(REALIZATION)
    centre = replicate.where(used, 0.0).sum(REALIZATION) / g.where(g > 0)
    squares = ((replicate - centre) ** 2).where(used, 0.0).sum(REALIZATION, skipna=False)
    root: xr.Variable = np.sqrt(squares * (g - 1) / g.where(g > 1))
    return root


def normal_quantile(confidence: float) -> float:
    """Two-sided standard normal quantile, e.g. 1.96 for 0.95."""
    return float(ndtri(0.5 + confidence / 2))


def score_interval(m: Any, n: Any, phi: float = 1.0, confidence: float = 0.95) -> tuple[Any, Any]:
    """Centre and half width of the score interval of a mean ``m`` of ``n`` values from 0 to 1 (numbers or arrays).

    It ends at the roots mu of n (m - mu)^2 = z^2 phi mu (1 - mu), with z `normal_quantile`: Wilson's interval of a
    fraction when ``phi`` is 1, a narrower one when the values vary less than those of 0 and 1 only.
    """
    a = normal_quantile(confidence) ** 2 * phi / n
    return (m + a / 2) / (1 + a), np.sqrt(a * (m * (1 - m) + a / 4)) / (1 + a)


def wilson(successes: xr.DataArray, trials: xr.DataArray, confidence: float = 0.95) -> xr.Dataset:
    """Fraction with its Wilson interval: Dataset ``value``, ``mcse``, ``lower``, ``upper``, ``n``.

    ``mcse`` is half the width of the interval in normal quantiles, so that it does not vanish at 0 of n or n of n.
    """
    successes, trials = xr.align(successes, trials, join="inner", copy=False)
    found = _wilson(successes.variable, trials.variable, confidence)
    return xr.Dataset(found, _coordinates(successes, found["value"].dims, trials))


def _wilson(successes: xr.Variable, trials: xr.Variable, confidence: float = 0.95) -> dict[str, xr.Variable]:
    n = trials.where(trials > 0)
    p = successes / n
    centre, half = score_interval(p, n, confidence=confidence)
    return {
        "value": p,
        "mcse": half / normal_quantile(confidence),
        "lower": (centre - half).clip(min=0.0),
        "upper": (centre + half).clip(max=1.0),
        "n": trials,
    }


def fraction(event: xr.DataArray, used: xr.DataArray) -> xr.Dataset:
    """Fraction of the used realizations in which ``event`` holds, with `wilson` interval and ``left_out``."""
    event, used = xr.broadcast(event, used)
    count = used.variable.sum(REALIZATION)
    found = _wilson((event.variable & used.variable).sum(REALIZATION), count)
    found["left_out"] = used.sizes[REALIZATION] - count
    return xr.Dataset(found, _coordinates(event, count.dims, used))


def quantiles(x: xr.DataArray, q: tuple[float, ...], confidence: float = 0.95) -> xr.Dataset:
    """Quantiles over realizations: Dataset ``value``, ``mcse``, ``lower``, ``upper`` (dim ``quantile``), ``n``.

    The value is an observed one (the smallest with at least a fraction q at or below it); the standard error is
    Maritz & Jarrett's (the bootstrap's, without resampling); the interval is between order statistics, free of any
    distribution, and is NaN at an end that so few realizations cannot bound.
    """
    if x.chunks is not None:
        x = x.chunk({REALIZATION: -1})
    parts = xr.apply_ufunc(
        _quantiles,
        x,
        input_core_dims=[[REALIZATION]],
        output_core_dims=[["part", "quantile"]],
        kwargs={"q": q, "confidence": confidence},
        vectorize=True,
        dask="parallelized",
        output_dtypes=[float],
        dask_gufunc_kwargs={"output_sizes": {"part": 4, "quantile": len(q)}},
    ).assign_coords(quantile=list(q))
    names = ("value", "mcse", "lower", "upper")
    out = xr.Dataset({name: parts.isel(part=i) for i, name in enumerate(names)})
    n = x.notnull().sum(REALIZATION)
    return out.assign(n=n, left_out=x.sizes[REALIZATION] - n)


def _quantiles(x: np.ndarray, q: tuple[float, ...], confidence: float) -> np.ndarray:
    x = np.sort(x[np.isfinite(x)])
    n, out = x.size, np.full((4, len(q)), np.nan)
    if n == 0:
        return out
    for j, level in enumerate(q):
        rank = max(int(np.ceil(level * n - 1e-9)), 1)
        weights = np.diff(betainc(rank, n - rank + 1, np.arange(n + 1) / n))
        first = weights @ x
        lower, upper = order_statistic_ranks(n, level, confidence)
        out[0, j] = x[rank - 1]
        out[1, j] = np.sqrt(weights @ (x - first) ** 2)
        out[2, j] = x[lower - 1] if lower >= 1 else np.nan
        out[3, j] = x[upper - 1] if upper <= n else np.nan
    return out


def order_statistic_ranks(n: int, q: float, confidence: float = 0.95) -> tuple[int, int]:
    """Ranks (l, u), 1-based, whose order statistics cover the q-quantile with each tail at most (1 - confidence) / 2.

    l = 0 or u = n + 1 when n values cannot bound that end.
    """
    tail = (1 - confidence) / 2
    ranks = np.arange(1, n + 1)
    # X_(l) exceeds the quantile when fewer than l values fall at or below it
    below = ranks[bdtr(ranks - 1, n, q) <= tail]
    above = ranks[bdtrc(ranks - 1, n, q) <= tail]
    return (int(below[-1]) if below.size else 0), (int(above[0]) if above.size else n + 1)
