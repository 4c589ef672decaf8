"""Measures of estimates that need no mean: for parameters whose estimates lie on their bounds.

The mean of estimates that pile up on two bounds lies where few of them are, and their standard deviation is that of the
box. The median and the quantiles say where the estimates are, the median absolute deviation (MAD) how far apart.

Errors. The delete-one jackknife is inconsistent for quantiles (Efron 1982), so it is not used here. The error of a
quantile is Maritz & Jarrett's, the exact standard deviation of the quantile of a bootstrap sample; its interval lies
between order statistics and holds for every distribution (`mcstudy.analysis.montecarlo.quantiles`). The MAD has no such
closed form: its error is that of a bootstrap over realizations from a fixed stream; of more than `LARGEST_RESAMPLE`
realizations as many are drawn, and the error is scaled to all (m out of n bootstrap: Bickel, Götze & van Zwet 1997,
Statistica Sinica 7:1-31). All of these errors are themselves uncertain where a distribution has two peaks: trust the
interval.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from mcstudy.analysis.labels import labelled, units_of
from mcstudy.analysis.montecarlo import REALIZATION, quantiles

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
RESAMPLES = 400
LARGEST_RESAMPLE = 2000
"""Realizations in a resample at most: 13 MB, whatever the size of the study."""

FEWEST = 3
"""Fewest realizations with an error of the MAD."""


def estimate_quantiles(cells: xr.Dataset, q: tuple[float, ...] = QUANTILES) -> xr.Dataset:
    """Quantiles of the estimates over realizations: dims (amplitude, fmax, parameter, quantile), with interval.

    Parameters
    ----------
    q
        The quantiles, 0 to 1.
    """
    result = quantiles(cells["estimate"], q)
    return labelled(result, cells, "quantile of the estimates over realizations", units_of(cells))


def median_bias(cells: xr.Dataset) -> xr.Dataset:
    """Median estimate minus truth, with a 95 % interval; for parameters whose estimates lie on bounds.

    The interval (``lower``, ``upper``) is between order statistics and assumes no distribution.
    """
    result = quantiles(cells["estimate"], (0.5,)).isel(quantile=0, drop=True)
    for name in ("value", "lower", "upper"):
        result[name] = result[name] - cells["truth"]
    return labelled(result, cells, "median bias (median estimate minus truth)", units_of(cells))


def median_cost(cells: xr.Dataset) -> xr.Dataset:
    """Median cost of the best fits over realizations: dims (amplitude, fmax), with a 95 % interval."""
    result = quantiles(cells["cost"], (0.5,)).isel(quantile=0, drop=True)
    return labelled(result, cells, "median cost of the best fits")


def mad(cells: xr.Dataset) -> xr.Dataset:
    """Median absolute deviation of the estimates from their median; ``mcse`` by a bootstrap with a fixed stream.

    It is not scaled to the SD of a normal distribution.
    """
    x = cells["estimate"]
    if x.chunks is not None:
        x = x.chunk({REALIZATION: -1})
    value, mcse = xr.apply_ufunc(
        _mad_with_error,
        x,
        input_core_dims=[[REALIZATION]],
        output_core_dims=[[], []],
        vectorize=True,
        dask="parallelized",
        output_dtypes=[float, float],
    )
    n = x.notnull().sum(REALIZATION)
    result = xr.Dataset({"value": value, "mcse": mcse, "n": n, "left_out": x.sizes[REALIZATION] - n})
    return labelled(result, cells, "median absolute deviation from the median", units_of(cells))


def _mad_with_error(x: np.ndarray) -> tuple[float, float]:
    x = x[np.isfinite(x)]
    if x.size == 0:
        return np.nan, np.nan
    value = float(_mad(x[None])[0])
    if x.size < FEWEST:
        return value, np.nan
    rng = np.random.Generator(np.random.Philox(key=20190318))
    drawn = min(x.size, LARGEST_RESAMPLE)
    again = _mad(x[rng.integers(x.size, size=(RESAMPLES, drawn))])
    return value, float(again.std(ddof=1)) * (drawn / x.size) ** 0.5


def _mad(x: np.ndarray) -> np.ndarray:
    """Of every row of ``x`` (B, n)."""
    return np.asarray(np.median(np.abs(x - np.median(x, axis=1)[:, None]), axis=1))
