"""Correlation of estimates over realizations: which parameters the data tell apart only together.

Goodworth & Peterka 2018 conclude that active and passive stiffness of a joint cannot be told apart while their sum can:
their estimates move in opposite directions from one realization to the next.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from mcstudy.analysis.labels import labelled
from mcstudy.analysis.montecarlo import NUMBERS_A_PIECE, REALIZATION


def correlation(cells: xr.Dataset) -> xr.Dataset:
    """Correlation of every pair of estimates over realizations. Reads the best fits at once.

    Pearson's, with the error of the delete-one jackknife: dims (..., parameter, parameter_2). NaN where an estimate
    does not vary; ``mcse`` is NaN for fewer than four realizations.
    """
    x = cells["estimate"].transpose(..., REALIZATION, "parameter").load()
    values = np.asarray(x.values, dtype=float)
    used = np.isfinite(values).all(axis=-1, keepdims=True)
    n = used.sum(axis=-2)[..., 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(used, values, 0.0).sum(axis=-2, keepdims=True) / n[..., None, None]
        d = np.where(used, values - mean, 0.0)
        products = np.einsum("...ri,...rj->...ij", d, d)
        value = _normalized(products)
        mcse = _jackknife_error(d, used, products, value, n)
    mcse[n < 4] = np.nan
    mcse[~np.isfinite(value)] = np.nan
    outer = x.dims[:-2]
    pair = (*outer, "parameter", "parameter_2")
    counts = {"n": (outer, n), "left_out": (outer, x.sizes[REALIZATION] - n)}
    coords = {k: x[k] for k in (*outer, "parameter")} | {"parameter_2": x["parameter"].values}
    out = xr.Dataset({"value": (pair, value), "mcse": (pair, mcse), **counts}, coords)
    return labelled(out, cells, "correlation of estimates over realizations")


def _jackknife_error(
    d: np.ndarray, used: np.ndarray, products: np.ndarray, value: np.ndarray, n: np.ndarray
) -> np.ndarray:
    """Standard error (..., P, P) of correlations ``value`` from deviations ``d`` (..., R, P), a piece of R at a time.

    Sums are of the changes from ``value``, which are small, so that nothing is lost by taking them together.
    """
    # without realization r the sum of products about the new mean is smaller by d_r d_r' n / (n - 1)
    factor = (n / np.where(n > 1, n - 1, np.nan))[..., None, None, None]
    depth = max(1, NUMBERS_A_PIECE // max(value.size, 1))
    total, squares = np.zeros_like(value), np.zeros_like(value)
    for first in range(0, d.shape[-2], depth):
        part = (..., slice(first, first + depth), slice(None))
        fewer = products[..., None, :, :] - factor * d[part][..., :, None] * d[part][..., None, :]
        change = np.where(used[part][..., None], _normalized(fewer) - value[..., None, :, :], 0.0)
        total, squares = total + np.nansum(change, axis=-3), squares + np.nansum(change**2, axis=-3)
    count = n[..., None, None]
    return np.asarray(np.sqrt((squares - total**2 / count).clip(min=0.0) * (count - 1) / count))


def _normalized(products: np.ndarray) -> np.ndarray:
    """Sums of products (..., P, P) as correlations."""
    scale = np.sqrt(np.diagonal(products, axis1=-2, axis2=-1).clip(min=0.0))
    both = scale[..., :, None] * scale[..., None, :]
    return np.asarray(np.clip(products / np.where(both > 0, both, np.nan), -1.0, 1.0))
