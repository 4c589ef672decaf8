"""The paper's Fig. 3B: the expected lowest cost of x starts, from order statistics instead of resampling.

The paper drew x costs at random from a pool of 500 fits, 500 times, and plotted mean and SD of their minimum,
averaged over 20 realizations. The limit of infinitely many draws is a weighted sum of the sorted pool.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import xarray as xr
from scipy.special import gammaln

from mcstudy.analysis.labels import ONE, labelled
from mcstudy.analysis.montecarlo import REALIZATION
from mcstudy.analysis.selection import usable
from mcstudy.fitting.certainty import COST_FLOOR

ROUNDING = 12**-0.5
"""Standard error of a whole number that nothing else moves."""


@lru_cache(maxsize=32)
def weights_without_replacement(n: int, drawn: tuple[int, ...]) -> np.ndarray:
    """C(n-i, x-1) / C(n, x), shape (len(drawn), n); more draws than the pool holds are the whole pool."""
    x, i = np.minimum(np.array(drawn), n)[:, None], np.arange(1, n + 1)[None, :]
    possible = x - 1 <= n - i
    m = np.where(possible, n - i, x - 1)
    log_rest = gammaln(m + 1) - gammaln(x) - gammaln(m - x + 2)
    log_all = gammaln(n + 1) - gammaln(x + 1) - gammaln(n - x + 1)
    return np.where(possible, np.exp(log_rest - log_all), 0.0)


def minimum_curve(cube: xr.Dataset, drawn: np.ndarray | None = None) -> xr.Dataset:
    """Mean and SD of the lowest cost among ``drawn`` usable fits of each pool, drawn without replacement.

    The paper does not say whether it put them back, which matters as x nears the pool's size.

    Parameters
    ----------
    cube: with dims (amplitude, fmax, realization, start).
    drawn: numbers of starts x; 1 to 500 (or to the size of the pool) by default.

    Returns
    -------
    Dataset ``mean``, ``sd`` with dims (amplitude, fmax, realization, drawn), and ``minimum`` of each pool.
    """
    drawn = np.arange(1, min(cube.sizes["start"], 500) + 1) if drawn is None else np.asarray(drawn)
    cost = cube["cost"].where(usable(cube))
    if cost.chunks is not None:
        cost = cost.chunk({"start": -1})
    mean, sd = xr.apply_ufunc(
        _curves,
        cost,
        input_core_dims=[["start"]],
        output_core_dims=[["drawn"], ["drawn"]],
        kwargs={"drawn": tuple(int(x) for x in drawn)},
        dask="parallelized",
        output_dtypes=[float, float],
        dask_gufunc_kwargs={"output_sizes": {"drawn": drawn.size}},
    )
    out = xr.Dataset({"mean": mean, "sd": sd, "minimum": cost.min("start")}).assign_coords(drawn=drawn)
    return labelled(
        out,
        cube,
        mean=("expected lowest cost of that many starts", ONE),
        sd=("standard deviation of the lowest cost of that many starts", ONE),
        minimum=("lowest cost of the pool", ONE),
    )


def _curves(cost: np.ndarray, drawn: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and SD (..., len(drawn)) of the lowest of costs (..., start); all pools with as many costs at once."""
    pools = np.sort(np.where(np.isfinite(cost), cost, np.nan).reshape(-1, cost.shape[-1]))  # NaN last
    held = np.isfinite(pools).sum(1)
    mean, sd = (np.full((len(pools), len(drawn)), np.nan) for _ in range(2))
    for n in np.unique(held[held > 0]):
        rows = np.flatnonzero(held == n)
        pool, weights = pools[rows, :n], weights_without_replacement(int(n), drawn)
        mean[rows] = pool @ weights.T
        for i, w in enumerate(weights):
            sd[rows, i] = np.sqrt((pool - mean[rows, i, None]) ** 2 @ w)
    shape = (*cost.shape[:-1], len(drawn))
    return mean.reshape(shape), sd.reshape(shape)


def average_curve(curve: xr.Dataset) -> xr.Dataset:
    """Fig. 3B itself: a `minimum_curve` averaged over realizations.

    Dataset ``value`` (mean of the means), ``sd`` (mean of the SDs, the paper's bars), ``mcse`` (standard error of
    ``value`` over realizations), ``n``, ``left_out``; dims (amplitude, fmax, drawn).
    """
    mean = curve["mean"]
    n = mean.notnull().sum(REALIZATION)
    value = mean.mean(REALIZATION)
    ss = ((mean - value) ** 2).sum(REALIZATION)
    mcse = np.sqrt(ss / (n * (n - 1)).where(n > 1))
    left_out = mean.sizes[REALIZATION] - n
    sd = curve["sd"].mean(REALIZATION)
    return labelled(
        xr.Dataset({"value": value, "sd": sd, "mcse": mcse, "n": n, "left_out": left_out}),
        curve,
        "expected lowest cost of that many starts, mean over realizations",
        sd=("standard deviation of the lowest cost of that many starts, mean over realizations", ONE),
    )


def excess(mean: np.ndarray, minimum: np.ndarray, floor: float = COST_FLOOR) -> np.ndarray:
    """Relative excess over the pools' minima; none below ``floor`` (without noise it is rounding)."""
    over = np.maximum(mean - minimum[:, None] - floor, 0.0)
    return over / np.maximum(minimum, np.finfo(float).tiny)[:, None]


def asymptote(
    curve: xr.Dataset,
    tolerance: float = 0.01,
    resamples: int = 400,
    confidence: float = 0.95,
    floor: float = COST_FLOOR,
) -> xr.Dataset:
    """Number of starts at which the averaged curve has flattened: the first x with its `excess` at most ``tolerance``.

    The paper reads it off a logarithmic axis and gives no tolerance, and the number depends on it.

    Parameters
    ----------
    curve: from `minimum_curve`.
    floor: excess of cost that counts as none; it decides without noise, where a ratio to the minimum is rounding.
    resamples: of a bootstrap over realizations, from a fixed stream.

    Returns
    -------
    Dataset ``value``, ``mcse``, ``lower``, ``upper``, ``n``, ``left_out`` with dims (amplitude, fmax). NaN where the
    curve does not get there. Starts are counted in whole numbers, so ``mcse`` is at least `ROUNDING`.
    """
    mean, minimum = curve["mean"], curve["minimum"]
    if mean.chunks is not None:
        mean, minimum = mean.chunk({REALIZATION: -1}), minimum.chunk({REALIZATION: -1})
    names = ("value", "mcse", "lower", "upper")
    parts = xr.apply_ufunc(
        _asymptote_of_pools,
        mean,
        minimum,
        input_core_dims=[[REALIZATION, "drawn"], [REALIZATION]],
        output_core_dims=[[]] * len(names),
        kwargs={
            "drawn": curve["drawn"].values.astype(float),
            "tolerance": tolerance,
            "resamples": resamples,
            "confidence": confidence,
            "floor": floor,
        },
        vectorize=True,
        dask="parallelized",
        output_dtypes=[float] * len(names),
    )
    n = minimum.notnull().sum(REALIZATION)
    out = xr.Dataset(dict(zip(names, parts, strict=True)))
    out = out.assign(n=n, left_out=minimum.sizes[REALIZATION] - n)
    return labelled(out, curve, "number of starts at which the mean lowest cost has flattened")


def _asymptote_of_pools(
    mean: np.ndarray,
    minimum: np.ndarray,
    drawn: np.ndarray,
    tolerance: float,
    resamples: int,
    confidence: float,
    floor: float,
) -> tuple[float, float, float, float]:
    keep = np.isfinite(minimum)
    mean, minimum = mean[keep], minimum[keep]
    if not keep.any():
        return np.nan, np.nan, np.nan, np.nan
    n = minimum.size
    rng = np.random.Generator(np.random.Philox(key=20180114))
    resampled = rng.multinomial(n, np.full(n, 1 / n), size=resamples) / n
    weights = np.vstack([np.full((1, n), 1 / n), resampled])
    there = excess(weights @ mean, weights @ minimum, floor) <= tolerance
    first = np.where(there.any(1), drawn[np.argmax(there, axis=1)], np.nan)
    needed = first[1:][np.isfinite(first[1:])]
    # one pool does not show the variation between pools; if the bootstrap often has no solution, its spread is unknown
    if n < 2 or needed.size < 0.9 * resamples:
        return float(first[0]), np.nan, np.nan, np.nan
    tail = (1 - confidence) / 2
    lower, upper = np.quantile(needed, [tail, 1 - tail])
    return float(first[0]), max(float(needed.std(ddof=1)), ROUNDING), float(lower), float(upper)
