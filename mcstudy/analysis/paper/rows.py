"""The rows *paper | ours*: the value of a study for each entry of `mcstudy.analysis.paper.published.RESULTS`.

A row exists only if the study has a group with the Fmax and amplitudes of the paper's number.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr

from mcstudy.analysis import accuracy, minimum_curve
from mcstudy.analysis.montecarlo import Moments, jackknife, moments
from mcstudy.analysis.paper import published
from mcstudy.analysis.paper.explanations import explain_row
from mcstudy.analysis.paper.published import AMPLITUDES_NM, FMAX_HZ, RESULTS, Published
from mcstudy.analysis.selection import best
from mcstudy.analysis.sensitivity import influence
from mcstudy.analysis.view import StudyView

LIMIT = 3.0
"""Largest difference at which ours and the paper's number agree, in Monte Carlo standard errors."""


@dataclass(frozen=True)
class Row:
    """A published number and ours.

    Attributes
    ----------
    published: the paper's number. value, mcse: ours, in the same unit. n: number of realizations (or pools).
    floor: mean |bias| expected from chance alone, for unbiased estimates; else NaN. group: the group it comes from.
    agrees: None where the paper gives no number. distance: in our standard errors; NaN where undefined.
    distance_both: in standard errors of both studies; that of the paper is ours scaled to its 50 realizations.
    detail: the values behind a ranking. note: explanation for a row that does not agree.
    """

    published: Published
    value: float
    mcse: float
    n: int
    floor: float
    group: str
    agrees: bool | None
    distance: float
    distance_both: float
    detail: str
    note: str


@dataclass(frozen=True)
class Found:
    """A computed number before the comparison.

    ``n_paper``: realizations behind the paper's number. ``detail``: the values behind a ranking, as text.
    """

    result: xr.Dataset
    group: str
    n_paper: int = published.REALIZATIONS
    detail: str = ""


def rows(study: StudyView) -> list[Row]:
    """All rows that this study can fill, in the order of the paper."""
    out = []
    for key, compute in _COMPUTE.items():
        found = compute(study)
        if found is not None:
            out.append(_compare(RESULTS[key], found))
    return out


def _compare(paper: Published, found: Found) -> Row:
    value, mcse = float(found.result["value"]), float(found.result["mcse"])
    n = int(found.result["n"])
    floor = float(found.result["floor"]) if "floor" in found.result else float("nan")
    error = mcse if np.isfinite(mcse) else 0.0
    gap = value - paper.value
    if paper.criterion == "none" or not np.isfinite(value) or (paper.criterion == "equal" and not np.isfinite(mcse)):
        agrees = None
    elif paper.criterion == "equal":
        agrees = abs(gap) <= LIMIT * error
    elif paper.criterion == "at most":
        agrees = gap <= LIMIT * error
    else:
        agrees = gap >= -LIMIT * error
    both = error * np.sqrt(1 + n / found.n_paper)
    return Row(
        published=paper,
        value=value,
        mcse=mcse,
        n=n,
        floor=floor,
        group=found.group,
        agrees=agrees,
        distance=gap / error if error > 0 else float("nan"),
        distance_both=gap / both if both > 0 else float("nan"),
        detail=found.detail,
        note=explain_row(paper.key, abs(gap) <= LIMIT * both) if agrees is False else "",
    )


Compute = Callable[[StudyView], Found | None]


def _statistic(combine: bool, fmax: tuple[float, ...], statistic: Callable[[Moments], xr.DataArray]) -> Compute:
    """A statistic of the accuracy group at the paper's two amplitudes."""

    def compute(study: StudyView) -> Found | None:
        view = study.accuracy(fmax, AMPLITUDES_NM)
        if view is None:
            return None
        cells = view.combined if combine else view.cells
        if cells is None:
            return None
        cells = view.at(cells, fmax, AMPLITUDES_NM)
        return Found(jackknife(cells["estimate"], cells["truth"], statistic), view.name)

    return compute


def _bias(combine: bool, fmax: float, names: tuple[str, ...] | None = None) -> Compute:
    """Mean |bias| over amplitudes and parameters, with its floor."""

    def compute(study: StudyView) -> Found | None:
        view = study.accuracy([fmax], AMPLITUDES_NM)
        cells = None if view is None else view.combined if combine else view.cells
        if view is None or cells is None:
            return None
        cells = view.at(cells, [fmax], AMPLITUDES_NM).squeeze("fmax")
        cells = cells if names is None else cells.sel(parameter=list(names))
        return Found(accuracy.mean_absolute_bias_percent(cells, over=("amplitude", "parameter")), view.name)

    return compute


def _mean(x: xr.DataArray, *dims: str) -> xr.DataArray:
    return x.mean(list(dims))


def _spread_fmax(lower: float, upper: float, names: tuple[str, ...] | None = None) -> Callable[[Moments], xr.DataArray]:
    def statistic(m: Moments) -> xr.DataArray:
        sd = accuracy.relative_sd_of(m)
        sd = _mean(sd if names is None else sd.sel(parameter=list(names)), "amplitude", "parameter")
        return 100 * (1 - sd.sel(fmax=lower, drop=True) / sd.sel(fmax=upper, drop=True))

    return statistic


def _spread_amplitude(m: Moments) -> xr.DataArray:
    sd = _mean(accuracy.relative_sd_of(m).squeeze("fmax", drop=True), "parameter")
    low, high = (sd.sel(amplitude=a, drop=True) for a in AMPLITUDES_NM)
    return 100 * (1 - high / low)


def _bias_amplitude(m: Moments) -> xr.DataArray:
    b = _mean(accuracy.absolute_bias_of(m), "fmax", "parameter")
    low, high = (b.sel(amplitude=a, drop=True) for a in AMPLITUDES_NM)
    return low - high


def lead(x: xr.DataArray, first: tuple[str, ...], largest: bool) -> xr.DataArray:
    """Margin in percent by which the worst of ``first`` ranks ahead of the best other parameter (larger or smaller)."""
    chosen = x["parameter"].isin(list(first))
    inside, outside = x.sel(parameter=chosen), x.sel(parameter=~chosen)
    if largest:
        return 100 * (inside.min("parameter") / outside.max("parameter") - 1)
    return 100 * (outside.min("parameter") / inside.max("parameter") - 1)


def _cv(m: Moments) -> xr.DataArray:
    """CV averaged over the amplitudes, as in Fig. 7B; dims (parameter,) and the deleted realization."""
    return _mean(accuracy.cv_of(m).squeeze("fmax", drop=True), "amplitude")


def _combined_cv(single_names: tuple[str, ...], of: Callable[[xr.DataArray, xr.DataArray], xr.DataArray]) -> Compute:
    """A statistic of the CVs of combined and single stiffnesses, computed jointly (they share realizations)."""

    def compute(study: StudyView) -> Found | None:
        view = study.accuracy([1.2], AMPLITUDES_NM)
        if view is None or view.combined is None:
            return None
        pair = view.combined.sel(parameter=list(published.COMBINED_STIFFNESS))
        both = xr.concat([view.cells[["estimate", "truth"]], pair[["estimate", "truth"]]], dim="parameter")
        cells = view.at(both, [1.2], AMPLITUDES_NM)

        def statistic(m: Moments) -> xr.DataArray:
            cv = _cv(m)
            together = cv.sel(parameter=list(published.COMBINED_STIFFNESS))
            single = cv.sel(parameter=[n for n in view.model.names if not single_names or n in single_names])
            return of(together, single)

        return Found(jackknife(cells["estimate"], cells["truth"], statistic), view.name)

    return compute


def _below_all(together: xr.DataArray, single: xr.DataArray) -> xr.DataArray:
    return 100 * (single.min("parameter") / together.max("parameter") - 1)


def _ratio(together: xr.DataArray, single: xr.DataArray) -> xr.DataArray:
    paired = together.assign_coords(parameter=single["parameter"])
    return (paired / single).mean("parameter")


def _bias_1_2(m: Moments) -> xr.DataArray:
    """|bias| averaged over the amplitudes, percent; dims (parameter,) and the deleted realization."""
    return _mean(accuracy.absolute_bias_of(m).squeeze("fmax", drop=True), "amplitude")


def _order(of: Callable[[Moments], xr.DataArray], first: tuple[str, ...], largest: bool) -> Compute:
    """Whether ``first`` rank ahead of all other parameters at 1.2 Hz, and our ranking."""

    def compute(study: StudyView) -> Found | None:
        view = study.accuracy([1.2], AMPLITUDES_NM)
        if view is None:
            return None
        cells = view.at(view.cells, [1.2], AMPLITUDES_NM)
        estimate, truth = cells["estimate"], cells["truth"]
        result = jackknife(estimate, truth, lambda m: lead(of(m), first, largest))
        return Found(result, view.name, detail=_leaders(of(moments(estimate, truth)), len(first), largest))

    return compute


def _leaders(x: xr.DataArray, n: int, largest: bool) -> str:
    ranked = x.sortby(x, ascending=not largest).isel(parameter=slice(n + 1))
    return ", ".join(f"{p} {v:.3g}" for p, v in zip(ranked["parameter"].values, ranked.values, strict=True))


def _theory(of: Callable[[xr.Dataset], xr.DataArray]) -> Compute:
    """Noise-free fits: the best of each block of 50 starts; the blocks are the sample."""

    def compute(study: StudyView) -> Found | None:
        view = study.noise_free(8.0, published.STARTS)
        if view is None:
            return None
        cube = view.cube[["estimate", "cost", "status", "truth"]].drop_vars("start")
        cube = cube.sel(fmax=view.fmax(8.0)).isel(amplitude=0).compute()
        blocks = cube.coarsen(start=published.STARTS, boundary="trim").construct(start=("block", "start"))
        x = of(best(blocks))
        x = x.stack(all=("block", "realization"))
        n = int(x.notnull().sum())
        mcse = x.std(ddof=1) / np.sqrt(n) if n > 1 else x.max() * np.nan
        return Found(xr.Dataset({"value": x.mean(), "mcse": mcse, "n": n}), view.name)

    return compute


def _error_percent(cells: xr.Dataset) -> xr.DataArray:
    return 100 * abs(cells["estimate"] - cells["truth"]) / cells["truth"]


def _least_influential(study: StudyView) -> Found | None:
    view = study.accuracy([8.0], [])
    if view is None:
        return None
    matter = influence(view.model, view.model.truth, view.cube["frequency"].values)
    value = lead(matter, published.LEAST_INFLUENTIAL, largest=False)
    least = len(published.LEAST_INFLUENTIAL)
    return Found(xr.Dataset({"value": value, "mcse": 0.0, "n": 1}), view.name, detail=_leaders(matter, least, False))


def _unstable(study: StudyView) -> Found | None:
    view = study.accuracy([8.0], AMPLITUDES_NM)
    if view is None:
        return None
    growth = view.at(view.cells, [8.0], AMPLITUDES_NM)["growth_rate"].squeeze("fmax", drop=True)
    share = xr.where(growth > 0, 100.0, 0.0).where(growth.notnull())
    return Found(jackknife(share, xr.DataArray(0.0), lambda m: m.mean.mean("amplitude")), view.name)


def _starts(amplitude: float | None) -> Compute:
    """Number of starts at which Fig. 3B flattens, with noise at an amplitude or (None) without noise."""

    def compute(study: StudyView) -> Found | None:
        fmax, least = published.CONVERGENCE_FMAX_HZ, 100
        view = study.noise_free(fmax, least) if amplitude is None else study.pools(fmax, amplitude, least)
        if view is None:
            return None
        cube = view.cube.sel(fmax=[view.fmax(fmax)])
        cube = cube.isel(amplitude=[0]) if amplitude is None else cube.sel(amplitude=[view.amplitude(amplitude)])
        curve = minimum_curve.minimum_curve(cube).compute()
        out = minimum_curve.asymptote(curve).squeeze(("amplitude", "fmax"))
        return Found(out, view.name, n_paper=5 if amplitude is None else published.CONVERGENCE_REALIZATIONS)

    return compute


_COMPUTE: dict[str, Compute] = {
    "theory_mean_error": _theory(lambda c: _error_percent(c).mean("parameter")),
    "theory_max_error": _theory(lambda c: _error_percent(c).max("parameter")),
    "theory_cost": _theory(lambda c: c["cost"]),
    **{f"bias_12_{f:g}": _bias(False, f) for f in FMAX_HZ},
    **{f"bias_10_{f:g}": _bias(True, f) for f in FMAX_HZ},
    **{f"bias_2_{f:g}": _bias(True, f, published.COMBINED_STIFFNESS) for f in FMAX_HZ[:2]},
    "bias_amplitude": _statistic(False, FMAX_HZ, _bias_amplitude),
    "largest_bias": _order(_bias_1_2, published.LARGEST_BIAS, largest=True),
    "spread_fmax": _statistic(False, (0.41, 1.2), _spread_fmax(1.2, 0.41)),
    "spread_fmax_10": _statistic(True, (0.41, 1.2), _spread_fmax(1.2, 0.41)),
    "spread_fmax_2": _statistic(True, (0.41, 1.2), _spread_fmax(1.2, 0.41, published.COMBINED_STIFFNESS)),
    **{f"spread_amplitude_{f:g}": _statistic(False, (f,), _spread_amplitude) for f in FMAX_HZ},
    "spread_8hz_better": _statistic(False, (1.2, 8.0), _spread_fmax(8.0, 1.2, published.BETTER_AT_8HZ)),
    "spread_8hz_worse": _statistic(False, (1.2, 8.0), _spread_fmax(1.2, 8.0, published.WORSE_AT_8HZ)),
    "lowest_cv": _order(_cv, published.LOWEST_CV, largest=False),
    "highest_cv": _order(_cv, published.HIGHEST_CV, largest=True),
    "combined_cv_lowest": _combined_cv((), _below_all),
    "combined_cv_ratio": _combined_cv(("K11", "K22"), _ratio),
    "least_influential": _least_influential,
    "unstable_8": _unstable,
    "starts_noise_free": _starts(None),
    "starts_5": _starts(5.0),
    "starts_3": _starts(3.0),
}
