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
from functools import lru_cache
from typing import Generic, TypeVar

import numpy as np
import xarray as xr
from scipy.special import bdtr, bdtrc, betainc

from mcstudy.fitting.certainty import normal_quantile, score_interval

REALIZATION = "realization"
"""Name of the dimension that is sampled."""


NUMBERS_A_PIECE = 1 << 18
"""Numbers of an array that are worked on at once, 2 MB and some fifteen times that in between; more are read piece by
piece."""

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
    return _with_coordinates(_sums(x, truth, pieces(x)).moments, x, truth)


@dataclass(frozen=True)
class _Sums:
    """Moments of all realizations, and the sums they are made of: squares about the mean, and about the truth."""

    moments: Moments[xr.Variable]
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


def _piece(x: xr.DataArray, part: slice) -> xr.DataArray:
    """Some realizations of an array, read now unless it is lazy; all of an array in memory is the array itself."""
    if x.chunks or (part.stop >= x.sizes[REALIZATION] and part.start == 0):
        return x
    return x.isel({REALIZATION: part}).compute()


def _sums(x: xr.DataArray, truth: xr.DataArray, parts: list[slice]) -> _Sums:
    """Two passes over the pieces of aligned ``x``: the mean, then the deviations from it."""
    t = truth.variable
    n = total = about_mean = about_truth = xr.Variable((), 0)
    for part in parts:
        v = _piece(x, part).variable
        n, total = n + v.notnull().sum(REALIZATION), total + v.fillna(0.0).sum(REALIZATION)
    mean = total / n.where(n > 0)
    for part in parts:
        deviation, error2 = _deviations(_piece(x, part).variable, mean, t)
        about_mean, about_truth = about_mean + (deviation**2).sum(REALIZATION), about_truth + error2.sum(REALIZATION)
    sd = (about_mean / (n - 1).where(n > 1)) ** 0.5
    return _Sums(Moments(mean, sd, about_truth / n.where(n > 0), t, n), about_mean, about_truth)


def _deviations(v: xr.Variable, mean: xr.Variable, truth: xr.Variable) -> tuple[xr.Variable, xr.Variable]:
    """Deviations from the mean and squared errors; zero where left out."""
    return (v - mean).fillna(0.0), ((v - truth) ** 2).fillna(0.0)


def _with_coordinates(m: Moments[xr.Variable], x: xr.DataArray, truth: xr.DataArray) -> Moments[xr.DataArray]:
    coordinates = _coordinates(x, m.mean.dims)
    mean, sd, n = (xr.DataArray(v, coordinates) for v in (m.mean, m.sd, m.n))
    return Moments(mean, sd, xr.DataArray(m.mse, _coordinates(x, m.mse.dims, truth)), truth, n)


def _coordinates(x: xr.DataArray, dims: tuple[Hashable, ...], other: xr.DataArray | None = None) -> xr.Coordinates:
    """The coordinates of ``x``, and of ``other``, that numbers with these dims made of them have."""
    coordinates = x.coords if other is None else x.coords.merge(other.coords).coords
    held = coordinates.to_dataset()
    return held.drop_vars([name for name, c in held.variables.items() if not set(c.dims) <= set(dims)]).coords


def _with_deleted(v: xr.Variable, sums: _Sums) -> Moments[xr.Variable]:
    """Moments of each cell with each realization of ``v``, one piece of all, deleted in turn (they keep its dim)."""
    full = sums.moments
    deviation, error2 = _deviations(v, full.mean, full.truth)
    n1 = full.n - v.notnull()
    some, several = n1.where(n1 > 0), (n1 - 1).where(n1 > 1)
    # deleting i moves the mean, so the sum of squares about the new mean drops by y_i^2 n / (n - 1)
    ss1 = (sums.about_mean - deviation**2 * full.n / some).clip(min=0.0)
    mse1 = (sums.about_truth - error2) / some
    return Moments(full.mean - deviation / some, (ss1 / several) ** 0.5, mse1, full.truth, n1)


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
    parts = pieces(x)
    sums = _sums(x, truth, parts)
    value = statistic(_with_coordinates(sums.moments, x, truth))
    spread = None
    for part in parts:
        piece = _piece(x, part)
        replicate = statistic(_with_coordinates(_with_deleted(piece.variable, sums), piece, truth))
        used = _used(piece.variable, value.dims)
        at = xr.DataArray(used, _coordinates(piece, used.dims))
        replicate, at = xr.align(replicate, at, join="inner", copy=False)
        spread = _Spread.of(replicate.variable, at.variable).after(spread)
    assert spread is not None  # there is at least one piece
    error = spread.error
    mcse = xr.DataArray(error, _coordinates(replicate, error.dims, at))
    least = _least(sums.moments.n, value.dims)
    n = xr.DataArray(least, _coordinates(x, least.dims))
    return xr.Dataset({"value": value, "mcse": mcse, "n": n, "left_out": x.sizes[REALIZATION] - n})


def jackknives(x: xr.DataArray, truth: xr.DataArray, statistics: Sequence[PlainStatistic]) -> list[xr.Dataset]:
    """`jackknife` of several statistics that need no coordinates and share the moments."""
    x, truth = xr.align(x, truth, join="inner", copy=False)
    parts = pieces(x)
    sums = _sums(x, truth, parts)
    values = [statistic(sums.moments) for statistic in statistics]
    spreads: dict[int, _Spread] = {}
    for part in parts:
        v = _piece(x, part).variable
        deleted = _with_deleted(v, sums)
        for k, statistic in enumerate(statistics):
            spreads[k] = _Spread.of(statistic(deleted), _used(v, values[k].dims)).after(spreads.get(k))
    out = []
    for k, value in enumerate(values):
        n = _least(sums.moments.n, value.dims)
        variables = {"value": value, "mcse": spreads[k].error, "n": n, "left_out": x.sizes[REALIZATION] - n}
        out.append(xr.Dataset(variables, _coordinates(x, value.dims, truth)))
    return out


@dataclass(frozen=True)
class _Spread:
    """Number, mean and summed squares about the mean of the values with each realization deleted in turn."""

    n: xr.Variable
    centre: xr.Variable
    squares: xr.Variable

    @classmethod
    def of(cls, replicate: xr.Variable, used: xr.Variable) -> _Spread:
        """Of some realizations; ``used``: whether one enters the value."""
        n = used.sum(REALIZATION)
        centre = replicate.where(used, 0.0).sum(REALIZATION) / n.where(n > 0)
        return cls(n, centre, ((replicate - centre) ** 2).where(used, 0.0).sum(REALIZATION, skipna=False))

    def after(self, before: _Spread | None) -> _Spread:
        """These and those before them together (Chan, Golub & LeVeque 1983)."""
        if before is None:
            return self
        n = before.n + self.n
        off = (self.centre - before.centre).where((before.n > 0) & (self.n > 0), 0.0)
        centre = before.centre.fillna(0.0).where(before.n > 0, self.centre) + off * self.n / n.where(n > 0)
        squares = before.squares + self.squares + off**2 * before.n * self.n / n.where(n > 0, 1)
        return _Spread(n, centre.where(n > 0), squares)

    @property
    def error(self) -> xr.Variable:
        """Jackknife standard error; NaN for fewer than two values."""
        root: xr.Variable = np.sqrt(self.squares * (self.n - 1) / self.n.where(self.n > 1))
        return root


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


def wilson(successes: xr.DataArray, trials: xr.DataArray, confidence: float = 0.95) -> xr.Dataset:
    """Fraction with its Wilson interval: Dataset ``value``, ``mcse``, ``lower``, ``upper``, ``n``.

    ``mcse`` is half the width of the interval in normal quantiles, so that it does not vanish at 0 of n or n of n.
    """
    successes, trials = xr.align(successes, trials, join="inner", copy=False)
    interval = _wilson(successes.variable, trials.variable, confidence)
    return xr.Dataset(interval, _coordinates(successes, interval["value"].dims, trials))


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
    interval = _wilson((event.variable & used.variable).sum(REALIZATION), count)
    interval["left_out"] = used.sizes[REALIZATION] - count
    return xr.Dataset(interval, _coordinates(event, count.dims, used))


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
        rank, weights, lower, upper = _of_order_statistics(n, level, confidence)
        first = weights @ x
        out[0, j] = x[rank - 1]
        out[1, j] = np.sqrt(weights @ (x - first) ** 2)
        out[2, j] = x[lower - 1] if lower >= 1 else np.nan
        out[3, j] = x[upper - 1] if upper <= n else np.nan
    return out


@lru_cache(maxsize=32)
def _of_order_statistics(n: int, q: float, confidence: float) -> tuple[int, np.ndarray, int, int]:
    """Rank of the q-quantile of n values, Maritz & Jarrett's weights (n,), and the ranks of its interval.

    Kept: they take longer than the rest, and most cells have the same n.
    """
    rank = max(int(np.ceil(q * n - 1e-9)), 1)
    return rank, np.diff(betainc(rank, n - rank + 1, np.arange(n + 1) / n)), *order_statistic_ranks(n, q, confidence)


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
