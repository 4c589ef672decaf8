"""One number of a Monte Carlo study, its error, and the error of a study of the paper's size.

The paper's numbers come from 50 realizations, and several of them depend on that number: a mean |bias| falls with it,
because an absolute value does not average to zero. A larger study is therefore cut into blocks of the paper's size, and
its number is the mean over the blocks. Realizations beyond the last whole block are not used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from mcstudy.analysis.montecarlo import REALIZATION, Moments, Statistic, jackknives

BLOCK = "block"
"""Dimension of the blocks of realizations."""

MANY = 20
"""From this many blocks on, the error of one is the standard deviation between them; below, its own estimate."""

DRAWS = 200
"""Resamples of a bootstrap over the realizations of a block."""


@dataclass(frozen=True)
class Value:
    """One number of a study.

    Attributes
    ----------
    value: mean over blocks of the paper's size. mcse: its standard error; NaN for fewer than three realizations.
    one: standard error of the number of a single study of the paper's size. n: realizations used (the smallest number
    of any cell). blocks: number of blocks; 1 for a study of the paper's size or a smaller one.
    detail: the values behind the number, as text. low, high: range over the readings of a definition; NaN without.
    """

    value: float
    mcse: float
    one: float
    n: int
    blocks: int = 1
    detail: str = ""
    low: float = float("nan")
    high: float = float("nan")


def exact(value: float, detail: str = "", one: float = 0.0) -> Value:
    """A number without Monte Carlo error; ``one``: the error the paper's has nevertheless."""
    return Value(float(value), 0.0, one, 1, detail=detail)


def in_blocks(data: xr.Dataset, size: int) -> xr.Dataset:
    """``data`` with the dims (block, realization) in place of realization; fewer than ``size`` are one block."""
    n = data.sizes[REALIZATION]
    if n < size:
        return data.drop_vars(REALIZATION, errors="ignore").expand_dims({BLOCK: 1})
    cut = data.isel({REALIZATION: slice(0, n // size * size)}).drop_vars(REALIZATION, errors="ignore")
    return cut.coarsen({REALIZATION: size}).construct({REALIZATION: (BLOCK, REALIZATION)})


def pooled(value: xr.DataArray, error: xr.DataArray, n: int, size: int) -> Value:
    """`Value` of numbers (block,) and their errors, each from ``n`` realizations; ``size``: those of the paper."""
    v, e = (np.atleast_1d(x.values).astype(float) for x in (value, error))
    keep = np.isfinite(v)
    if not keep.any():
        return Value(float("nan"), float("nan"), float("nan"), 0)
    v, e = v[keep], e[keep]
    one = float(v.std(ddof=1)) if v.size >= MANY else float(np.sqrt(np.mean(e**2)))
    return Value(float(v.mean()), one / np.sqrt(v.size), one * np.sqrt(n / size), n * v.size, int(v.size))


def of_moments(data: xr.Dataset, statistics: Mapping[str, Statistic], size: int) -> dict[str, Value]:
    """Smooth functions of the moments of ``estimate`` (block, realization, ...), with the delete-one jackknife."""
    found = jackknives(data["estimate"], data["truth"], list(statistics.values()))
    return {
        key: pooled(r["value"], r["mcse"], int(r["n"].max()), size) for key, r in zip(statistics, found, strict=True)
    }


def of_resampled_moments(data: xr.Dataset, statistics: Mapping[str, Statistic], size: int) -> dict[str, Value]:
    """Counts and ranks, for which a jackknife fails: the same with a bootstrap over realizations (a fixed stream)."""
    x, truth = data["estimate"], data["truth"]
    R = x.sizes[REALIZATION]
    rng = np.random.Generator(np.random.Philox(key=20180115))
    drawn = rng.multinomial(R, np.full(R, 1 / R), size=DRAWS).astype(float)
    whole = _weighted(x, truth, xr.DataArray(np.ones((1, R)), dims=("draw", REALIZATION)))
    again = _weighted(x, truth, xr.DataArray(drawn, dims=("draw", REALIZATION)))
    n = int(x.notnull().any([d for d in x.dims if d not in (BLOCK, REALIZATION)]).sum(REALIZATION).max())
    return {
        key: pooled(of(whole).isel(draw=0), of(again).std("draw", ddof=1), n, size) for key, of in statistics.items()
    }


def _weighted(x: xr.DataArray, truth: xr.DataArray, weight: xr.DataArray) -> Moments:
    """Moments with the weight (draw, realization) of every realization."""
    used, y = x.notnull().astype(float), (x - truth).fillna(0.0)  # about the truth: no cancellation
    n = xr.dot(weight, used, dim=REALIZATION)
    some, several = n.where(n > 0), (n - 1).where(n > 1)
    mean, square = xr.dot(weight, y, dim=REALIZATION) / some, xr.dot(weight, y**2, dim=REALIZATION) / some
    sd = ((square - mean**2).clip(min=0.0) * n / several) ** 0.5
    return Moments(mean + truth, sd, square, truth, n)


def of_realizations(
    data: xr.Dataset, statistics: Mapping[str, Callable[[xr.Dataset], xr.DataArray]], size: int
) -> dict[str, Value]:
    """Functions of all realizations of a block that leave out NaN, such as a correlation, by deleting one at a time."""
    R = data.sizes[REALIZATION]
    apart = xr.DataArray(~np.eye(R, dtype=bool), dims=("deleted", REALIZATION))
    deleted = data.assign({name: x.where(apart) for name, x in data.data_vars.items() if REALIZATION in x.dims})
    out = {}
    for key, of in statistics.items():
        value, replicates = of(data), of(deleted)
        error = replicates.std("deleted") * np.sqrt(R - 1)
        out[key] = pooled(value, error.where(R > 2), R, size)
    return out
