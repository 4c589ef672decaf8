"""One number of a Monte Carlo study, its error, and the error of a study of the paper's size.

The paper's numbers come from 50 realizations, and several of them depend on that number: a mean |bias| falls with it,
because an absolute value does not average to zero. A larger study is therefore cut into blocks of the paper's size, and
its number is the mean over the blocks. Realizations beyond the last whole block are not used.

Everything here is numpy: a study has thousands of small arrays, for which labels cost a hundred times the arithmetic.
Arrays have the axes (block, realization, ...); those with a realization deleted have the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

MANY = 20
"""From this many blocks on, the error of one is the standard deviation between them; below, its own estimate."""

BLOCKS_AT_ONCE = 100
"""Blocks that are worked on together, so that memory does not grow with the number of realizations."""

DRAWS = 200
"""Resamples of a bootstrap over the realizations of a block."""

T = TypeVar("T")
Statistics = Mapping[str, Callable[[T], np.ndarray]]
"""Functions by key: of what is averaged over realizations, to one number per leading index."""


@dataclass(frozen=True)
class Value:
    """One number of a study.

    Attributes
    ----------
    value: mean over blocks of the paper's size. mcse: its standard error; NaN for fewer than three realizations.
    study_error: standard error of the number of a single study of the paper's size.
    n: realizations used (the largest number of any cell).
    blocks: number of blocks; 1 for a study of the paper's size or a smaller one.
    detail: the values behind the number, as text. low, high: range over the readings of a definition; NaN without.
    """

    value: float
    mcse: float
    study_error: float
    n: int
    blocks: int = 1
    detail: str = ""
    low: float = float("nan")
    high: float = float("nan")


def exact(value: float, detail: str = "", study_error: float = 0.0) -> Value:
    """A number without Monte Carlo error; ``study_error``: the error the paper's has nevertheless."""
    return Value(float(value), 0.0, study_error, 1, detail=detail)


def slabs(realizations: int, size: int) -> list[slice]:
    """Realizations of `BLOCKS_AT_ONCE` blocks of ``size`` each; the last slab has at least one whole block, if any."""
    depth = size * BLOCKS_AT_ONCE
    blocks = max(realizations // size, 1)
    last = -(-blocks // BLOCKS_AT_ONCE) - 1
    return [slice(k * depth, (k + 1) * depth if k < last else realizations) for k in range(last + 1)]


def in_blocks(x: np.ndarray, size: int) -> np.ndarray:
    """``x`` (realization, ...) as (block, realization, ...) with blocks of ``size``; fewer are one block."""
    n = x.shape[0]
    if n < size:
        return x[None]
    return x[: n // size * size].reshape(n // size, size, *x.shape[1:])


@dataclass(frozen=True)
class Means:
    """First two moments of a sample over realizations.

    Attributes
    ----------
    mean, sd: (..., cells), NaN where too few realizations have a value. n: number of them.
    """

    mean: np.ndarray
    sd: np.ndarray
    n: np.ndarray


def means(x: np.ndarray) -> tuple[Means, Means]:
    """Moments of ``x`` (block, realization, cells), and those with each realization deleted in turn.

    NaN is left out. The first have the axes (block, cells), the second (block, realization, cells).
    """
    used = np.isfinite(x)
    n = used.sum(1).astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(used, x, 0.0).sum(1) / n
        d = np.where(used, x - mean[:, None], 0.0)
        ss = (d**2).sum(1)
        whole = Means(mean, np.sqrt(ss / np.where(n > 1, n - 1, np.nan)), n)
        n, mean, ss = n[:, None], mean[:, None], ss[:, None]
        fewer = n - used
        # deleting i moves the mean, so the sum of squares about the new mean drops by d_i^2 n / (n - 1)
        rest = np.maximum(ss - d**2 * n / np.where(n > 1, n - 1, np.nan), 0.0)
        sd = np.sqrt(rest / np.where(fewer > 1, fewer - 1, np.nan))
        return whole, Means(mean - d / np.where(fewer > 0, fewer, np.nan), sd, fewer)


def merged(parts: Sequence[Means]) -> Means:
    """Moments of all realizations from those of parts of them (Chan, Golub & LeVeque 1983)."""
    if len(parts) == 1:
        return parts[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        n = np.stack([m.n for m in parts])
        centres = np.where(n > 0, np.stack([m.mean for m in parts]), 0.0)
        squares = np.where(n > 1, np.stack([m.sd for m in parts]) ** 2 * (n - 1), 0.0)
        total = n.sum(0)
        mean = (centres * n).sum(0) / total
        ss = squares.sum(0) + (n * (centres - mean) ** 2).sum(0)
        return Means(mean, np.sqrt(ss / np.where(total > 1, total - 1, np.nan)), total)


def pooled(value: np.ndarray, error: np.ndarray, n: int, size: int) -> Value:
    """`Value` of numbers (block,) and their errors, each from ``n`` realizations; ``size``: those of the paper."""
    keep = np.isfinite(value)
    if not keep.any():
        return Value(float("nan"), float("nan"), float("nan"), 0)
    v, e = value[keep], error[keep]
    spread = float(v.std(ddof=1)) if v.size >= MANY else float(np.sqrt(np.mean(e**2)))
    return Value(float(v.mean()), spread / np.sqrt(v.size), spread * np.sqrt(n / size), n * v.size, int(v.size))


@dataclass(frozen=True)
class Sample:
    """A number of every block: ``value`` and ``error`` (block,), each from at most ``n`` realizations."""

    value: np.ndarray
    error: np.ndarray
    n: int


def pooled_samples(parts: Sequence[dict[str, Sample]], size: int) -> dict[str, Value]:
    """`pooled` by key, of the blocks of all parts together."""
    out = {}
    for key in parts[0]:
        samples = [part[key] for part in parts]
        joined = (np.concatenate([s.value for s in samples]), np.concatenate([s.error for s in samples]))
        out[key] = pooled(*joined, max(s.n for s in samples), size)
    return out


def jackknife(whole: T, deleted: T, used: np.ndarray, statistics: Statistics[T]) -> dict[str, Sample]:
    """Smooth statistics with the delete-one jackknife; ``used`` (block, realization): realizations with any value."""
    g = used.sum(1)
    out = {}
    for key, statistic in statistics.items():
        with np.errstate(invalid="ignore", divide="ignore"):
            value, r = statistic(whole), np.where(used, statistic(deleted), 0.0)
            centre = r.sum(1) / np.maximum(g, 1)
            squares = np.where(used, (r - centre[:, None]) ** 2, 0.0).sum(1)
        error = np.sqrt(squares * (g - 1) / np.where(g > 2, g, np.nan))
        out[key] = Sample(value, error, int(g.max()))
    return out


def bootstrap(x: np.ndarray, of_means: Callable[[Means], T], statistics: Statistics[T]) -> dict[str, Sample]:
    """Counts and ranks, for which a jackknife fails: the same with a bootstrap over realizations (a fixed stream).

    ``x``: (block, realization, cells). ``of_means``: from the moments to what the statistics take.
    """
    R = x.shape[1]
    rng = np.random.Generator(np.random.Philox(key=20180115))
    drawn = rng.multinomial(R, np.full(R, 1 / R), size=DRAWS).astype(float)
    used = np.isfinite(x)
    whole = means(x)[0]
    flat = (slice(None), None) + (slice(None),) * (x.ndim - 2)
    y = np.where(used, x - whole.mean[flat], 0.0)

    def total(z: np.ndarray) -> Any:
        return np.moveaxis(np.tensordot(drawn, z, axes=(1, 1)), 0, 1)

    with np.errstate(invalid="ignore", divide="ignore"):
        n = total(used.astype(float))
        mean = total(y) / n
        sd = np.sqrt(np.maximum(total(y**2) / n - mean**2, 0.0) * n / np.where(n > 1, n - 1, np.nan))
    again = of_means(Means(mean + whole.mean[flat], sd, n))
    most = int(used.reshape(*used.shape[:2], -1).any(-1).sum(1).max())
    first = of_means(whole)
    with np.errstate(invalid="ignore", divide="ignore"):
        return {key: Sample(f(first), f(again).std(1, ddof=1), most) for key, f in statistics.items()}


def without_one(x: np.ndarray) -> np.ndarray:
    """``x`` (block, realization, ...) as (block, deleted, realization, ...) with NaN where deleted."""
    R = x.shape[1]
    away = np.eye(R, dtype=bool).reshape(1, R, R, *(1,) * (x.ndim - 2))
    return np.where(away, np.nan, x[:, None])


def correlation(x: np.ndarray, y: np.ndarray, axis: int) -> np.ndarray:
    """Pearson's correlation along an axis; pairs with a number that is not finite are left out.

    NaN for fewer than three pairs and where one side varies by rounding only.
    """
    used = np.isfinite(x) & np.isfinite(y)
    n = used.sum(axis, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        (a, flat_x), (b, flat_y) = (_centred(z, used, n, axis) for z in (x, y))
        r = (a * b).sum(axis) / np.sqrt((a**2).sum(axis) * (b**2).sum(axis))
    return np.where((n.squeeze(axis) > 2) & ~flat_x & ~flat_y, r, np.nan)


def _centred(z: np.ndarray, used: np.ndarray, n: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Deviations from the mean, zero where not used; and whether they are rounding."""
    z = np.where(used, z, 0.0)
    d = np.where(used, z - z.sum(axis, keepdims=True) / n, 0.0)
    return d, np.abs(d).max(axis) <= 1e-12 * np.abs(z).max(axis)
