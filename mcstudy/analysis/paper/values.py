"""Values of the rows for any study: from its best fits, and in closed form from its model and noise.

All functions are pure: labelled arrays in, a dictionary from the key of a row to its `Value` out. A key is absent where
the data do not hold what the row needs (an Fmax, for example). `cells_of` labels plain arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from mcstudy.analysis.montecarlo import Statistic, moments
from mcstudy.analysis.neural import j_nc
from mcstudy.analysis.paper import accuracy_rows, model_rows, published
from mcstudy.analysis.paper.sampling import Value, in_blocks, of_moments, of_realizations, of_resampled_moments
from mcstudy.analysis.selection import combined
from mcstudy.stance.feedback import Model


def cells_of(
    estimate: np.ndarray,
    truth: np.ndarray,
    names: Sequence[str],
    amplitude: Sequence[float] = published.AMPLITUDES_NM,
    fmax: Sequence[float] = published.FMAX_HZ,
    *,
    cost: np.ndarray | None = None,
    growth_rate: np.ndarray | None = None,
    frequency: np.ndarray | None = None,
) -> xr.Dataset:
    """Best fits as labelled cells, for `fit_values`.

    Parameters
    ----------
    estimate: (A, F, R, P) best fits, NaN where there is none. truth: (P,). names: of the P parameters.
    amplitude: (A,) N m. fmax: (F,) Hz. cost, growth_rate: (A, F, R), of the best fits; rows that need them are absent
    without. frequency: (N,) Hz, the points of the FRFs.
    """
    axes = ("amplitude", "fmax", "realization")
    given = {"cost": cost, "growth_rate": growth_rate}
    data = {name: (axes, x) for name, x in given.items() if x is not None}
    coords = {"amplitude": list(amplitude), "fmax": list(fmax), "parameter": list(names)}
    out = xr.Dataset({"estimate": ((*axes, "parameter"), estimate), "truth": ("parameter", truth), **data}, coords)
    return out if frequency is None else out.assign_coords(frequency=frequency)


def fit_values(cells: xr.Dataset, model: Model | None = None, size: int = published.REALIZATIONS) -> dict[str, Value]:
    """Values of the rows about estimates with noise: bias, spread, CV, instability, relations.

    Parameters
    ----------
    cells: best fits ``estimate`` (amplitude, fmax, realization, parameter), ``truth`` (parameter,), and, if known,
    ``growth_rate`` and ``cost`` (amplitude, fmax, realization) and the coord ``frequency``; amplitudes 3 and 5 N m,
    any of the Fmax 0.41, 1.2 and 8 Hz. model: for the rows about J_NC and sensitivity. size: realizations of a block,
    which is the number behind the paper's value.
    """
    data = in_blocks(_with_sums(cells), size)
    held = {float(f) for f in cells["fmax"].values}
    smooth = {key: of for key, (needed, of) in accuracy_rows.SMOOTH.items() if held.issuperset(needed)}
    counts = {key: of for key, (needed, of) in accuracy_rows.COUNTED.items() if held.issuperset(needed)}
    every = held.issuperset(published.FMAX_HZ)
    if model is not None and "frequency" in cells.coords and accuracy_rows.MID in held:
        counts |= accuracy_rows.counted(*model_rows.influences(model, cells["frequency"].values))
    out = of_moments(data, smooth, size) | of_resampled_moments(data, counts, size)
    if every:
        pairs = {f"together_{i}": accuracy_rows.together(p) for i, p in enumerate(published.REDUNDANT, 1)}
        out |= of_realizations(data[["estimate"]], pairs, size)
    if "growth_rate" in data:
        out |= _unstable(data, held, size)
    if every and model is not None and "cost" in cells and "frequency" in cells.coords:
        out |= _relation_of_best(cells, model, size)
    return _with_details(out, cells)


def _with_sums(cells: xr.Dataset) -> xr.Dataset:
    """The cells with the two combined stiffnesses as further parameters, and nothing that has neither."""
    names = ("estimate", "truth", "growth_rate")
    kept = cells[[n for n in names if n in cells]].reset_coords(drop=True)
    sums = combined(kept[["estimate", "truth"]]).sel(parameter=list(published.COMBINED_STIFFNESS))
    own = kept.sel(parameter=list(accuracy_rows.TWELVE))
    both = xr.concat([own[["estimate", "truth"]], sums[["estimate", "truth"]]], dim="parameter")
    return both if "growth_rate" not in kept else both.assign(growth_rate=kept["growth_rate"])


def _unstable(data: xr.Dataset, held: set[float], size: int) -> dict[str, Value]:
    growth = data["growth_rate"]
    share = xr.where(growth > 0, 100.0, 0.0).where(growth.notnull())
    at = {f: _mean_at(f) for f in published.FMAX_HZ if f in held}
    statistics = {f"unstable_{f:g}": of for f, of in at.items()}
    if len(at) == len(published.FMAX_HZ):
        low, mid, high = at.values()
        others = accuracy_rows.most(low, mid)
        statistics["unstable_8_most"] = lambda m: high(m) - others(m)
    return of_moments(xr.Dataset({"estimate": share, "truth": 0.0}), statistics, size)


def _mean_at(fmax: float) -> Statistic:
    return lambda m: m.mean.sel(fmax=fmax, drop=True).mean("amplitude")


def _relation_of_best(cells: xr.Dataset, model: Model, size: int) -> dict[str, Value]:
    best = xr.Dataset({"cost": cells["cost"], "j_nc": j_nc(cells, model)}).reset_coords(drop=True)
    return of_realizations(
        in_blocks(best, size),
        {
            "relation_noise_best": lambda d: accuracy_rows.weaker_with_noise(accuracy_rows.relation(d)),
            "relation_8hz_best": lambda d: accuracy_rows.weaker_at_8hz(accuracy_rows.relation(d)),
        },
        size,
    )


def relation_values(correlation: xr.DataArray, size: int = published.REALIZATIONS) -> dict[str, Value]:
    """Fig. 3C over all starts: correlations of log J and log J_NC within a realization (amplitude, fmax, realization).

    The number of a study is the mean over realizations.
    """
    data = in_blocks(xr.Dataset({"estimate": correlation, "truth": 0.0}), size)
    return of_moments(
        data,
        {
            "relation_noise_starts": lambda m: accuracy_rows.weaker_with_noise(m.mean),
            "relation_8hz_starts": lambda m: accuracy_rows.weaker_at_8hz(m.mean),
        },
        size,
    )


def _with_details(values: dict[str, Value], cells: xr.Dataset) -> dict[str, Value]:
    """The parameters behind a ranking, as text."""
    if not values.keys() & accuracy_rows.RANKINGS.keys():
        return values
    whole = _with_sums(cells)
    m = moments(whole["estimate"], whole["truth"])
    shown = {
        key: accuracy_rows.leaders(accuracy_rows.each(of, names, accuracy_rows.MID)(m), n, largest)
        for key, (of, names, n, largest) in accuracy_rows.RANKINGS.items()
        if key in values
    }
    return values | {key: replace(values[key], detail=text) for key, text in shown.items()}
