"""What a changed setting does: groups of one study compared realization by realization.

Groups of a study share their random numbers: realization r is the same noise in each, so that differences between
groups are far better known than either group alone. All numbers here are such differences, *group less reference*,
averaged over the amplitudes (and parameters) both have, with the jackknife error over their common realizations; a
realization that one of the two could not use is left out of both.

The reference is the study's group in the paper's setting, or else its first. A difference that the paper also makes a
claim about (`mcstudy.analysis.published.VARIANTS`) is put beside the claim.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import xarray as xr

from mcstudy.analysis import accuracy
from mcstudy.analysis.montecarlo import Moments, jackknife
from mcstudy.analysis.published import VARIANTS, Expectation, Variant
from mcstudy.analysis.view import GroupView, StudyView

LIMIT = 3.0
"""Standard errors beyond which a difference has a sign."""

LEAST = 3
"""Common realizations below which a difference has no error."""

GROUP, MEASURE = "group", "measure"


@dataclass(frozen=True)
class Measure:
    """One thing that is compared: a key, the head of its column, and its meaning; all are in percent."""

    key: str
    head: str
    meaning: str


MEASURES: dict[str, Measure] = {
    m.key: m
    for m in (
        Measure("bias", "|bias|", "mean |bias| of the parameters, % of the truth"),
        Measure("spread", "spread", "mean SD of the parameters, % of the truth"),
        Measure("rmse", "RMSE", "mean root mean squared error of the parameters, % of the truth"),
        Measure("unstable", "unstable", "best fits that are unstable, %"),
        Measure("on_bound", "on bound", "estimates that lie on a bound, %"),
        Measure("hits", "hits", "starts that reach the lowest cost of their cell, %"),
        Measure("frf_error", "FRF error", "mean distance of the mean FRF from the closed form, % of its magnitude"),
        Measure("frf_spread", "FRF spread", "mean SD of the FRF, % of its magnitude"),
    )
}


@dataclass(frozen=True)
class Verdict:
    """One statement of a claim beside the difference it is about.

    ``verdict``: agrees or contradicts when the difference is more than `LIMIT` standard errors from zero, else
    undecided.
    """

    claim: Variant
    expectation: Expectation
    fmax: float
    value: float
    mcse: float

    @property
    def verdict(self) -> str:
        """agrees, contradicts or undecided."""
        if not np.isfinite(self.mcse) or abs(self.value) <= LIMIT * self.mcse:
            return "undecided"
        return "agrees" if self.value * self.expectation.sign > 0 else "contradicts"


@dataclass(frozen=True)
class Comparison:
    """A group compared with the reference.

    Attributes
    ----------
    reference, group: names. differences: settings in which they differ, as ``field = value`` of the group.
    amplitudes: those averaged over. realizations: common ones.
    result: Dataset ``value``, ``mcse``, ``n`` with dims (measure, fmax); NaN where a measure does not exist.
    verdicts: what the paper claims about this change.
    """

    reference: str
    group: str
    differences: list[str]
    amplitudes: list[float]
    realizations: int
    result: xr.Dataset
    verdicts: list[Verdict]


def comparisons(study: StudyView) -> list[Comparison]:
    """Every group that differs from the study's reference in a setting, where both have noise and common cells."""
    noisy = [g for g in study.groups.values() if g.noisy]
    if len(noisy) < 2:
        return []
    reference = next((g for g in noisy if not g.differences), noisy[0])
    found = (compare(reference, other) for other in noisy if other is not reference)
    return [c for c in found if c is not None]


def compare(reference: GroupView, other: GroupView) -> Comparison | None:
    """One comparison; None for groups of the same setting or without common parameters, cells or realizations."""
    differences = other.differences_from(reference.group)
    if not differences or other.model.names != reference.model.names:
        return None
    pair = [_relative(view) for view in (reference, other)]
    cells = xr.concat(xr.align(*pair, join="inner"), dim=GROUP)
    if min(cells.sizes[d] for d in ("amplitude", "fmax")) == 0 or cells.sizes["realization"] < LEAST:
        return None
    cells = cells.where(cells["estimate"].notnull().all((GROUP, "parameter")))
    frf = _frf(reference, other, cells)
    parts = [_of_parameters(cells), _shares(cells), *([] if frf is None else [frf])]
    result = xr.concat(parts, dim=MEASURE, join="outer").reindex({MEASURE: list(MEASURES)})
    return Comparison(
        reference=reference.name,
        group=other.name,
        differences=differences,
        amplitudes=[float(a) for a in cells["amplitude"].values],
        realizations=int(cells.sizes["realization"]),
        result=result,
        verdicts=list(_verdicts(reference, other, result)),
    )


def _relative(view: GroupView) -> xr.Dataset:
    """Best fits with estimates in units of the truth, and what is counted in percent; no coordinates but the axes."""
    cells = view.cells
    out = xr.Dataset({"estimate": cells["estimate"] / cells["truth"].where(cells["truth"] != 0)})
    out["unstable"] = xr.where(cells["growth_rate"] > 0, 100.0, 0.0).where(cells["growth_rate"].notnull())
    out["on_bound"] = 100 * (cells["at_bound"] != 0).mean("parameter")
    out["hits"] = 100 * view.needed["hit_rate"]
    return out.reset_coords(drop=True)


def _difference(x: xr.DataArray) -> xr.DataArray:
    """Group less reference, averaged over amplitudes."""
    return (x.isel({GROUP: 1}) - x.isel({GROUP: 0})).mean("amplitude")


def _named(values: dict[str, xr.DataArray]) -> xr.DataArray:
    return xr.concat(list(values.values()), dim=xr.DataArray(list(values), dims=MEASURE, name=MEASURE))


def _of_parameters(cells: xr.Dataset) -> xr.Dataset:
    truth = xr.DataArray(1.0)

    def statistic(m: Moments) -> xr.DataArray:
        measures = {
            "bias": accuracy.absolute_bias_of(m),
            "spread": accuracy.relative_sd_of(m),
            "rmse": 100 * accuracy.rmse_of(m),
        }
        return _difference(_named(measures).mean("parameter"))

    return _numbers(jackknife(cells["estimate"], truth, statistic))


def _shares(cells: xr.Dataset) -> xr.Dataset:
    shares = _named({name: cells[name] for name in ("unstable", "on_bound", "hits")})
    return _numbers(jackknife(shares, xr.DataArray(0.0), lambda m: _difference(m.mean)))


def _frf(reference: GroupView, other: GroupView, cells: xr.Dataset) -> xr.Dataset | None:
    """FRFs at the frequencies up to each Fmax that both have; None for cubes that hold none."""
    if "frf" not in reference.cube or "frf" not in other.cube:
        return None
    data = [view.cube[["frf", "true_frf"]].reset_coords(drop=True) for view in (reference, other)]
    both = xr.concat(xr.align(*data, join="inner"), dim=GROUP).sel(amplitude=cells["amplitude"])
    if both.sizes["frequency"] == 0:
        return None
    both = both.sel(realization=cells["realization"]).compute()
    relative = both["frf"] / both["true_frf"]
    x = xr.concat([relative.real, relative.imag], dim="part")
    truth = xr.DataArray([1.0, 0.0], dims="part")
    inside = xr.DataArray(
        [reference.within(f, both["frequency"].values) for f in cells["fmax"].values],
        dims=("fmax", "frequency"),
        coords={"fmax": cells["fmax"], "frequency": both["frequency"]},
    )

    def statistic(m: Moments) -> xr.DataArray:
        measures = {"frf_error": (m.mean - m.truth) ** 2, "frf_spread": m.sd**2}
        size = 100 * _named(measures).sum("part", skipna=False) ** 0.5
        return _difference(size.mean("angle").where(inside).mean("frequency"))

    return _numbers(jackknife(x, truth, statistic))


def _numbers(result: xr.Dataset) -> xr.Dataset:
    return result[["value", "mcse"]].reset_coords(drop=True)


def _verdicts(reference: GroupView, other: GroupView, result: xr.Dataset) -> Iterator[Verdict]:
    if reference.differences or not other.comparable([], []):
        return
    for claim in VARIANTS:
        if set(claim.changes) != set(other.differences):
            continue
        for expectation in claim.expects:
            for wanted in expectation.fmax:
                fmax = other.fmax(wanted)
                if fmax is None or fmax not in result["fmax"]:
                    continue
                here = result.sel({MEASURE: expectation.measure, "fmax": fmax})
                yield Verdict(claim, expectation, fmax, float(here["value"]), float(here["mcse"]))
