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

import functools
import operator
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import xarray as xr
from scipy.special import bdtr, bdtrc, betainc, ndtri

REALIZATION = "realization"
"""Name of the dimension that is sampled."""

NUMBERS_A_PIECE = 1 << 20
"""Numbers of an array that are worked on at once, 8 MB and some fifteen times that in between; more are read piece by
piece."""

T = TypeVar("T")


@dataclass(frozen=True)
class Moments:
    """Per-cell moments of an estimate over realizations; their dims are those of the estimate without realizations.

    Attributes
    ----------
    mean: sample mean. sd: sample standard deviation (divisor n - 1). mse: mean squared distance from the truth.
    truth: the true value, broadcastable.
    n: number of realizations in each cell.
    """

    mean: xr.DataArray
    sd: xr.DataArray
    mse: xr.DataArray
    truth: xr.DataArray
    n: xr.DataArray


Statistic = Callable[[Moments], xr.DataArray]
"""A statistic of the study: a function of the cells' moments, possibly averaging over cells and parameters."""


def moments(x: xr.DataArray, truth: xr.DataArray) -> Moments:
    """Moments over realizations; NaN entries of ``x`` are realizations that are left out."""
    x, truth = xr.align(x, truth, join="inner", copy=False)
    return _sums(x, truth, pieces(x)).moments


@dataclass(frozen=True)
class _Sums:
    """Moments of all realizations, and the sums they are made of: squares about the mean, and about the truth."""

    moments: Moments
    about_mean: xr.Variable
    about_truth: xr.Variable


def pieces(x: xr.DataArray | xr.Dataset) -> list[slice]:
    """Slices of the realizations of at most about `NUMBERS_A_PIECE` numbers each; one for a lazy (Dask) array."""
    n = x.sizes[REALIZATION]
    if x.chunks:
        return [slice(0, n)]
    largest = x.size if isinstance(x, xr.DataArray) else max(v.size for v in x.variables.values())
    depth = max(1, NUMBERS_A_PIECE * n // max(largest, 1))
    return [slice(first, first + depth) for first in range(0, max(n, 1), depth)]


def _total(parts: Iterable[T]) -> T:
    return functools.reduce(operator.add, parts)


def _sums(x: xr.DataArray, truth: xr.DataArray, parts: list[slice]) -> _Sums:
    """Two passes over the pieces of aligned ``x``: the mean, then the deviations from it."""
    t = truth.variable

    def count_and_sum(part: slice) -> np.ndarray:
        v = _piece(x, part).variable
        return _pair(v.notnull().sum(REALIZATION), v.fillna(0.0).sum(REALIZATION))

    n, total = _total(count_and_sum(part) for part in parts)
    mean = total / n.where(n > 0)

    def squares(part: slice) -> np.ndarray:
        v = _piece(x, part).variable
        deviation, error2 = _deviations(v, mean, t)
        return _pair((deviation**2).sum(REALIZATION), error2.sum(REALIZATION))

    about_mean, about_truth = _total(squares(part) for part in parts)
    sd = (about_mean / (n - 1).where(n > 1)) ** 0.5
    mse = about_truth / n.where(n > 0)
    own, both = _coordinates(x, mean.dims), _coordinates(x, mse.dims, truth)
    made = [xr.DataArray(m, c) for m, c in ((mean, own), (sd, own), (mse, both), (n, own))]
    return _Sums(Moments(made[0], made[1], made[2], truth, made[3]), about_mean, about_truth)


def _pair(a: xr.Variable, b: xr.Variable) -> np.ndarray:
    """Two variables that are added to others each for itself."""
    out = np.empty(2, dtype=object)
    out[:] = a, b
    return out


def _piece(x: xr.DataArray, part: slice) -> xr.DataArray:
    """Some realizations of an array, read now unless it is lazy; all of an array in memory is the array itself."""
    if x.chunks or (part.stop >= x.sizes[REALIZATION] and part.start == 0):
        return x
    return x.isel({REALIZATION: part}).compute()


def _deviations(v: xr.Variable, mean: xr.Variable, truth: xr.Variable) -> tuple[xr.Variable, xr.Variable]:
    """Deviations from the mean and squared errors; zero where left out."""
    return (v - mean).fillna(0.0), ((v - truth) ** 2).fillna(0.0)


def _coordinates(x: xr.DataArray, dims: tuple[Hashable, ...], other: xr.DataArray | None = None) -> xr.Coordinates:
    """The coordinates of ``x``, and of ``other``, that numbers with these dims made of them have.

    The arithmetic itself is on variables, which have no coordinates: to compare and copy those in every step takes
    several times as long as the numbers do.
    """
    every = x.coords if other is None else x.coords.merge(other.coords).coords
    held = every.to_dataset()
    return held.drop_vars([name for name, c in held.variables.items() if not set(c.dims) <= set(dims)]).coords


def _with_deleted(x: xr.DataArray, truth: xr.DataArray, sums: _Sums) -> Moments:
    """Moments of each cell with each realization of ``x``, one piece of all, deleted in turn (they keep its dim)."""
    n, mean = sums.moments.n.variable, sums.moments.mean.variable
    deviation, error2 = _deviations(x.variable, mean, truth.variable)
    every = _coordinates(x, x.dims, truth)
    n1 = n - x.variable.notnull()
    some, several = n1.where(n1 > 0), (n1 - 1).where(n1 > 1)
    # deleting i moves the mean, so the sum of squares about the new mean drops by y_i^2 n / (n - 1)
    ss1 = (sums.about_mean - deviation**2 * n / some).clip(min=0.0)
    mse1 = (sums.about_truth - error2) / some
    mean1, sd1, mse1, n1 = (xr.DataArray(m, every) for m in (mean - deviation / some, (ss1 / several) ** 0.5, mse1, n1))
    return Moments(mean1, sd1, mse1, truth, n1)


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
    return jackknives(x, truth, [statistic])[0]


def jackknives(x: xr.DataArray, truth: xr.DataArray, statistics: Sequence[Statistic]) -> list[xr.Dataset]:
    """`jackknife` of several statistics, which share the moments; memory for one of the `pieces` of ``x`` at a time."""
    own, truth = xr.align(x, truth, join="inner", copy=False)
    parts = pieces(own)
    sums = _sums(own, truth, parts)
    values = [statistic(sums.moments) for statistic in statistics]
    spreads: list[_Spread | None] = [None] * len(statistics)
    for part in parts:
        piece = _piece(own, part)
        deleted = _with_deleted(piece, truth, sums)
        for k, statistic in enumerate(statistics):
            pooled = [d for d in x.dims if d not in (*values[k].dims, REALIZATION)]
            found = _Spread.of(piece, statistic(deleted), pooled)
            before = spreads[k]
            spreads[k] = found if before is None else before.merged(found)
    return [_result(x, sums.moments, *pair) for pair in zip(values, spreads, strict=True)]


@dataclass(frozen=True)
class _Spread:
    """Number, mean and summed squares about the mean of the replicates of a statistic; ``squares`` has coordinates."""

    n: xr.Variable
    centre: xr.Variable
    squares: xr.DataArray

    @classmethod
    def of(cls, x: xr.DataArray, replicate: xr.DataArray, pooled: list[Hashable]) -> _Spread:
        """Replicates of the realizations of ``x`` that have a number in any of the cells that are pooled."""
        used = x.variable.notnull()
        used = used.any(pooled) if pooled else used
        at = xr.DataArray(used, _coordinates(x, used.dims))
        replicate, at = xr.align(replicate, at, join="inner", copy=False)
        r, joined = replicate.variable, at.variable
        g = joined.sum(REALIZATION)
        centre = r.where(joined, 0.0).sum(REALIZATION) / g.where(g > 0)
        squares = ((r - centre) ** 2).where(joined, 0.0).sum(REALIZATION, skipna=False)
        return cls(g, centre, xr.DataArray(squares, _coordinates(replicate, squares.dims, at)))

    def merged(self, other: _Spread) -> _Spread:
        """Both together (Chan, Golub & LeVeque 1983)."""
        n = self.n + other.n
        off = (other.centre - self.centre).where((self.n > 0) & (other.n > 0), 0.0)
        centre = self.centre.fillna(0.0).where(self.n > 0, other.centre) + off * other.n / n.where(n > 0)
        squares = self.squares.variable + other.squares.variable + off**2 * self.n * other.n / n.where(n > 0, 1)
        return _Spread(n, centre.where(n > 0), self.squares.copy(data=squares.transpose(*self.squares.dims).data))


def _result(x: xr.DataArray, full: Moments, value: xr.DataArray, spread: _Spread | None) -> xr.Dataset:
    assert spread is not None
    g, pooled = spread.n, [d for d in x.dims if d not in (*value.dims, REALIZATION)]
    mcse = np.sqrt(spread.squares.variable * (g - 1) / g.where(g > 1))
    mcse = xr.DataArray(mcse, spread.squares.coords)
    least = full.n.variable.min(pooled) if pooled else full.n.variable
    n = xr.DataArray(least, _coordinates(x, least.dims))
    return xr.Dataset({"value": value, "mcse": mcse, "n": n, "left_out": x.sizes[REALIZATION] - n})


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
    n = trials.where(trials > 0)
    p = successes / n
    centre, half = score_interval(p, n, confidence=confidence)
    return xr.Dataset(
        {
            "value": p,
            "mcse": half / normal_quantile(confidence),
            "lower": (centre - half).clip(min=0.0),
            "upper": (centre + half).clip(max=1.0),
            "n": trials,
        }
    )


def fraction(event: xr.DataArray, used: xr.DataArray) -> xr.Dataset:
    """Fraction of the used realizations in which ``event`` holds, with `wilson` interval and ``left_out``."""
    event, used = xr.broadcast(event, used)
    out = wilson((event & used).sum(REALIZATION), used.sum(REALIZATION))
    return out.assign(left_out=used.sizes[REALIZATION] - out["n"])


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
