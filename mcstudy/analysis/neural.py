"""J_NC: error of the four neural controllers of a fit (not only of the sway that they produce).

J_NC = 1/(4 n) sum over frequencies and controllers of |true - fit|^2 / |true|^2 (Goodworth & Peterka 2018, Methods),
computed in closed form from the stored estimates.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from mcstudy.analysis.context import model_of
from mcstudy.analysis.labels import label, labelled
from mcstudy.analysis.montecarlo import quantiles
from mcstudy.stance.feedback import Model
from mcstudy.stance.response import neural_controllers

_BLOCK = 4096  # parameter vectors evaluated at once: about 30 MB of controllers at 28 frequencies


def j_nc(fits: xr.Dataset, model: Model) -> xr.DataArray:
    """J_NC over all frequencies of the group, whatever Fmax was fitted, so that values compare across Fmax.

    Parameters
    ----------
    fits: a cube (J_NC of every start) or cells (of the best); needs ``estimate``, ``truth`` and coord ``frequency``.
    model: whose neural controllers; its own truth and bounds are not used.

    Returns
    -------
    DataArray with the dims of ``estimate`` without ``parameter``; NaN where there is no estimate. Lazy if fits are.
    """
    counts = xr.DataArray(np.array([fits.sizes["frequency"]]), dims="_n")
    return label(_errors(fits, model, counts).isel(_n=0), "error of the neural controllers, J_NC").rename("j_nc")


def j_nc_within(fits: xr.Dataset, model: Model) -> xr.DataArray:
    """J_NC over the fitted frequencies only, those up to each Fmax (variable ``n_frequencies``)."""
    counts = fits["n_frequencies"].reset_coords(drop=True).rename(fmax="_n")
    errors = _errors(fits, model, counts)
    layers = [errors.isel(_n=i, fmax=i) for i in range(fits.sizes["fmax"])]
    out = xr.concat(layers, dim=fits["fmax"]).transpose(*(d for d in fits["estimate"].dims if d != "parameter"))
    return label(out, "error of the neural controllers at the fitted frequencies, J_NC").rename("j_nc_within")


def median_j_nc(cells: xr.Dataset) -> xr.Dataset:
    """Median of `j_nc` of the best fits over realizations: dims (amplitude, fmax), with a 95 % interval."""
    median = quantiles(j_nc(cells, model_of(cells)), (0.5,)).isel(quantile=0, drop=True)
    return labelled(median, cells, "median error of the neural controllers, J_NC")


def _errors(fits: xr.Dataset, model: Model, counts: xr.DataArray) -> xr.DataArray:
    estimate = fits["estimate"]
    if estimate.chunks is not None:
        estimate = estimate.chunk({"parameter": -1})
    return xr.apply_ufunc(
        j_nc_of,
        estimate,
        input_core_dims=[["parameter"]],
        output_core_dims=[["_n"]],
        kwargs={
            "truth": fits["truth"].values,
            "model": model,
            "f": fits["frequency"].values,
            "counts": counts.values,
        },
        dask="parallelized",
        output_dtypes=[float],
        dask_gufunc_kwargs={"output_sizes": {"_n": counts.size}},
    )


def j_nc_of(theta: np.ndarray, truth: np.ndarray, model: Model, f: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """J_NC of parameter vectors (..., P) over the first ``counts`` (C,) of frequencies ``f`` in Hz: (..., C).

    Controllers that the model does not have (zero at the truth) are left out of the mean.
    """
    true = neural_controllers(model, truth, f)
    present = np.abs(true) > 0
    scale = np.where(present, np.abs(true), 1.0)
    flat = theta.reshape(-1, theta.shape[-1])
    out = np.full((flat.shape[0], counts.size), np.nan)
    controllers = np.where(present.any(), present.sum((1, 2)).cumsum(), np.nan)  # NaN for a loop without any
    for begin in range(0, flat.shape[0], _BLOCK):
        error = np.where(present, (neural_controllers(model, flat[begin : begin + _BLOCK], f) - true) / scale, 0.0)
        total = (np.abs(error) ** 2).sum((-2, -1)).cumsum(-1)
        out[begin : begin + _BLOCK] = total[:, counts - 1] / controllers[counts - 1]
    return out.reshape(*theta.shape[:-1], counts.size)
