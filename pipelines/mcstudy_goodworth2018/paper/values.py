"""Values of the rows for any study: from its best fits, and in closed form from its model and noise.

All functions are pure: labelled arrays in, a dictionary from the key of a row to its `Value` out. A key is absent where
the data do not hold what the row needs (an Fmax, for example). `cells_of` labels plain arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from mcstudy.analysis.neural import j_nc_within
from mcstudy.analysis.publications.sampling import (
    Means,
    Sample,
    Value,
    bootstrap,
    correlation,
    in_blocks,
    jackknife,
    means,
    merged,
    pooled_samples,
    slabs,
    without_one,
)
from mcstudy.stance.feedback import Model
from mcstudy_goodworth2018.paper import accuracy_rows, published
from mcstudy_goodworth2018.paper.accuracy_rows import MID, NAMES, TWELVE, Measures, measures
from mcstudy_goodworth2018.paper.model_rows import influences

FMAX_ROUNDING = 1.011
"""The last point of an Fmax lies up to 1.1 % above it: the paper rounds (0.412 Hz for Fmax 0.41)."""

AXES = ("realization", "amplitude", "fmax")


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
    parts = slabs(cells.sizes["realization"], size)
    found = [_of_slab(cells.isel(realization=part).compute(), model, size) for part in parts]
    out = pooled_samples([samples for samples, _ in found], size)
    fmax = tuple(float(f) for f in cells["fmax"].values)
    truth = _sums_of(cells["truth"].sel(parameter=list(TWELVE)).values)
    return _with_details(out, measures(merged([of_all for _, of_all in found]), truth, fmax))


def _of_slab(cells: xr.Dataset, model: Model | None, size: int) -> tuple[dict[str, Sample], Means]:
    """Samples of some whole blocks, and the moments of all their realizations."""
    fmax = tuple(float(f) for f in cells["fmax"].values)
    x, truth = _with_sums(cells)
    blocks = in_blocks(x, size)

    def measured(m: Means) -> Measures:
        return measures(m, truth, fmax)

    def possible(table: dict[str, tuple[tuple[float, ...], accuracy_rows.Statistic]]) -> accuracy_rows.Statistics:
        return {key: of for key, (needed, of) in table.items() if set(needed) <= set(fmax)}

    counts = possible(accuracy_rows.COUNTED)
    if model is not None and "frequency" in cells.coords and MID in fmax:
        counts |= accuracy_rows.by_influence(*influences(model, cells["frequency"].values))
    whole, deleted = means(blocks)
    used = np.isfinite(blocks).any((2, 3, 4))
    out = jackknife(measured(whole), measured(deleted), used, possible(accuracy_rows.SMOOTH))
    out |= bootstrap(blocks, measured, counts)
    if "growth_rate" in cells:
        out |= _unstable(cells, fmax, size)
    if set(published.FMAX_HZ) <= set(fmax):
        out |= _together(blocks)
        if model is not None and "cost" in cells and "frequency" in cells.coords:
            out |= _relation_of_best(cells, model, size)
    return out, means(x[None])[0]


def _with_sums(cells: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Estimates (realization, amplitude, fmax, `NAMES`) and true values (`NAMES`,), the sums among them."""
    own = cells[["estimate", "truth"]].sel(parameter=list(TWELVE))
    return _sums_of(own["estimate"].transpose(*AXES, "parameter").values), _sums_of(own["truth"].values)


def _sums_of(values: np.ndarray) -> np.ndarray:
    """Values of `TWELVE` (..., 12) with the sums: (..., `NAMES`)."""
    of = dict(zip(TWELVE, np.moveaxis(values, -1, 0), strict=True))
    sums = [of[a] + of[b] for a, b in published.REDUNDANT]
    return np.concatenate([values, np.stack(sums, axis=-1)], axis=-1)


def _unstable(cells: xr.Dataset, fmax: tuple[float, ...], size: int) -> dict[str, Sample]:
    growth = cells["growth_rate"].transpose(*AXES).values
    share = in_blocks(np.where(np.isfinite(growth), np.where(growth > 0, 100.0, 0.0), np.nan), size)

    def at(f: float) -> accuracy_rows.OfMeans:
        return lambda m: m.mean[..., fmax.index(f)].mean(-1)

    statistics = {f"unstable_{f:g}": at(f) for f in published.FMAX_HZ if f in fmax}
    if len(statistics) == len(published.FMAX_HZ):
        low, mid, high = map(at, published.FMAX_HZ)
        statistics["unstable_8_most"] = lambda m: high(m) - np.maximum(low(m), mid(m))
    return jackknife(*means(share), np.isfinite(share).any((2, 3)), statistics)


def _together(blocks: np.ndarray) -> dict[str, Sample]:
    """Correlation of active and passive stiffness over realizations, mean over amplitudes and Fmax."""
    out: dict[str, Sample] = {}
    for i, (a, b) in enumerate(published.REDUNDANT, 1):
        x, y = (blocks[..., NAMES.index(n)] for n in (a, b))
        r, fewer = correlation(x, y, 1), correlation(without_one(x), without_one(y), 2)
        out |= jackknife(r, fewer, np.isfinite(x).any((2, 3)), {f"together_{i}": _mean_of_cells})
    return out


def _mean_of_cells(r: np.ndarray) -> np.ndarray:
    return np.asarray(r.mean((-2, -1)))


_RELATION = {"noise": accuracy_rows.weaker_with_noise, "8hz": accuracy_rows.weaker_at_8hz}


def _relation_of_best(cells: xr.Dataset, model: Model, size: int) -> dict[str, Sample]:
    """Fig. 3C over best fits: correlation over realizations of log J and log J_NC (of the fitted frequencies)."""
    cells = cells.sel(fmax=list(published.FMAX_HZ))
    if "n_frequencies" not in cells:
        counts = np.searchsorted(cells["frequency"].values, cells["fmax"].values * FMAX_ROUNDING, side="right")
        cells = cells.assign(n_frequencies=("fmax", counts))
    x, y = (in_blocks(np.log(z.transpose(*AXES).values), size) for z in (cells["cost"], j_nc_within(cells, model)))
    r, fewer = correlation(x, y, 1), correlation(without_one(x), without_one(y), 2)
    statistics = {f"relation_{key}_best": of for key, of in _RELATION.items()}
    return jackknife(r, fewer, np.isfinite(x).any((2, 3)), statistics)


def relation_values(r: xr.DataArray, size: int = published.REALIZATIONS) -> dict[str, Value]:
    """Fig. 3C over all starts: correlations of log J and log J_NC within a realization (amplitude, fmax, realization).

    The number of a study is the mean over realizations.
    """
    x = in_blocks(r.sel(fmax=list(published.FMAX_HZ)).transpose(*AXES).values, size)
    statistics = {f"relation_{key}_starts": lambda m, of=of: of(m.mean) for key, of in _RELATION.items()}
    return pooled_samples([jackknife(*means(x), np.isfinite(x).any((2, 3)), statistics)], size)


def _with_details(values: dict[str, Value], whole: Measures) -> dict[str, Value]:
    """The parameters behind a ranking, as text, from all realizations together."""
    shown = {
        key: accuracy_rows.leaders(whole.of(what, names, MID)[0], names, n, largest)
        for key, (what, names, n, largest) in accuracy_rows.RANKINGS.items()
        if key in values
    }
    return values | {key: replace(values[key], detail=text) for key, text in shown.items()}
