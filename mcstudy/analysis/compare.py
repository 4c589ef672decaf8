"""Effect of a changed setting: groups of one study, or of two, compared realization by realization.

Groups with the same seed share their random numbers: realization r has the same noise in each, so a difference between
groups is known much more precisely than either group's value. All numbers here are differences *group minus reference*,
averaged over the common amplitudes (and parameters), with the jackknife error over the common realizations. A
realization that one of the two could not use is left out of both. Groups with different seeds are independent: each has
its own realizations, and their variances add.

Within a study the reference is the group with the defaults of a study file, or else the first group. If a publication
makes a claim about a difference (`mcstudy.analysis.publications`), the difference is compared with the claim.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import xarray as xr

from mcstudy.analysis import accuracy
from mcstudy.analysis.labels import PERCENT, labelled
from mcstudy.analysis.measures import MEASURES
from mcstudy.analysis.montecarlo import Moments, Statistic, jackknife
from mcstudy.analysis.publications.publication import publications
from mcstudy.analysis.publications.statement import Expectation, Variant
from mcstudy.analysis.view import GroupView, StudyView
from mcstudy.errors import InputError

LIMIT = 3.0
"""Smallest difference that counts as different from zero, in standard errors."""

LEAST = 3
"""Smallest number of common realizations for a standard error of a difference."""

GROUP, MEASURE = "group", "measure"


@dataclass(frozen=True)
class Verdict:
    """One statement of a claim, and the corresponding difference.

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
    amplitudes: those averaged over. realizations: number of common ones; the smaller number if independent.
    paired: whether equal realizations have the same noise in both.
    result: Dataset ``value``, ``mcse``, ``n`` with dims (measure, fmax); NaN where a measure does not exist.
    verdicts: comparison with published claims about this change.
    """

    reference: str
    group: str
    differences: list[str]
    amplitudes: list[float]
    realizations: int
    paired: bool
    result: xr.Dataset
    verdicts: list[Verdict]

    def dataset(self) -> xr.Dataset:
        """The differences with their names; the attributes describe the comparison."""
        meanings = xr.DataArray([m.meaning for m in MEASURES.values()], dims=MEASURE)
        out = self.result.sel({MEASURE: list(MEASURES)}).assign_coords(
            meaning=meanings.assign_attrs(long_name="what the difference is of")
        )
        out = labelled(out, None, f"difference, {self.group} minus {self.reference}", PERCENT)
        return out.assign_attrs(
            settings="; ".join(self.differences) or "the same",
            errors="paired by realization" if self.paired else "of independent realizations",
            realizations=self.realizations,
            amplitudes=self.amplitudes,
        )


def comparisons(study: StudyView) -> list[Comparison]:
    """Comparisons of all groups that differ in a setting from the study's reference and share cells with it.

    Cells of a sweep are compared along its axes instead.
    """
    noisy = [g for g in study.groups.values() if g.noisy and g.group.cell is None]
    if len(noisy) < 2:
        return []
    reference = next((g for g in noisy if not g.differences), noisy[0])
    compared = (compare(reference, other) for other in noisy if other is not reference)
    return [c for c in compared if c is not None]


def compare(reference: GroupView, other: GroupView) -> Comparison | None:
    """One comparison within a study; None for groups with the same settings, or when `refusal` gives a reason."""
    if not other.differences_from(reference.group) or refusal(reference, other, paired=True):
        return None
    return _compared(reference, other, paired=True)


def difference(reference: GroupView, other: GroupView) -> Comparison:
    """Compare two groups of any cubes, also with the same settings: paired if `same_streams`, else independent.

    Raises `InputError` for groups that cannot be compared.
    """
    paired = same_streams(reference, other)
    reason = refusal(reference, other, paired)
    if reason:
        raise InputError(reason)
    return _compared(reference, other, paired)


def same_streams(reference: GroupView, other: GroupView) -> bool:
    """Whether equal realizations of both have the same random numbers; streams are keyed by seed and realization."""
    seeds = [view.cube.attrs.get("seed") for view in (reference, other)]
    return seeds[0] is not None and seeds[0] == seeds[1] and len(_common(reference, other, "realization")) > 0


def refusal(reference: GroupView, other: GroupView, paired: bool) -> str | None:
    """Why two groups cannot be compared, in one line that starts with the field; None when they can."""
    names, theirs = ", ".join(reference.model.names), ", ".join(other.model.names)
    if names != theirs:
        return f"parameter: expected {names} as in {reference.name}, got {theirs} in {other.name}"
    units = [view.model.stimulus_unit for view in (reference, other)]
    if units[0] != units[1]:
        return f"amplitude: expected values in {units[0]} as in {reference.name}, got {units[1]} in {other.name}"
    for axis in ("amplitude", "fmax"):
        if not _common(reference, other, axis):
            held = [", ".join(f"{x:g}" for x in view.cube[axis].values) for view in (reference, other)]
            return f"{axis}: expected one of {held[0]} as in {reference.name}, got {held[1]} in {other.name}"
    n = [view.cube.sizes["realization"] for view in (reference, other)]
    if paired and len(_common(reference, other, "realization")) < LEAST:
        common = len(_common(reference, other, "realization"))
        return f"realization: expected at least {LEAST} in common of {reference.name} and {other.name}, got {common}"
    if min(n) < LEAST:
        return f"realization: expected at least {LEAST} each, got {n[0]} in {reference.name} and {n[1]} in {other.name}"
    return None


def _common(reference: GroupView, other: GroupView, axis: str) -> list[float]:
    return np.intersect1d(reference.cube[axis].values, other.cube[axis].values).tolist()


def _compared(reference: GroupView, other: GroupView, paired: bool) -> Comparison:
    cells = _side_by_side([_relative(view) for view in (reference, other)], paired)
    dims = (GROUP, "parameter") if paired else ("parameter",)
    cells = cells.where(cells["estimate"].notnull().all(dims))
    frf = _frf(reference, other, cells, paired)
    parts = [_of_parameters(cells, paired), _shares(cells, paired), *([] if frf is None else [frf])]
    result = xr.concat(parts, dim=MEASURE, join="outer").reindex({MEASURE: list(MEASURES)})
    return Comparison(
        reference=reference.name,
        group=other.name,
        differences=other.differences_from(reference.group) or _other_model(reference, other),
        amplitudes=[float(a) for a in cells["amplitude"].values],
        realizations=len(_common(reference, other, "realization")) if paired else _fewest(reference, other),
        paired=paired,
        result=result,
        verdicts=list(_verdicts(reference, other, result)),
    )


def _other_model(reference: GroupView, other: GroupView) -> list[str]:
    """A model declared in Python is not in the design."""
    return [] if reference.model == other.model else [f"model = {other.model.name}"]


def _fewest(reference: GroupView, other: GroupView) -> int:
    return min(int(view.cube.sizes["realization"]) for view in (reference, other))


def _side_by_side(data: list[xr.Dataset], paired: bool) -> xr.Dataset:
    """Both groups on their common axes; if paired, with common realizations, else with all of both (NaN if absent)."""
    if paired:
        return xr.concat(xr.align(*data, join="inner"), dim=GROUP)
    return xr.concat(xr.align(*data, join="inner", exclude="realization"), dim=GROUP, join="outer")


def _relative(view: GroupView) -> xr.Dataset:
    """Best fits with estimates in units of the truth, and counts in percent; the axes are the only coordinates."""
    cells = view.cells
    out = xr.Dataset({"estimate": cells["estimate"] / cells["truth"].where(cells["truth"] != 0)})
    out["unstable"] = xr.where(cells["growth_rate"] > 0, 100.0, 0.0).where(cells["growth_rate"].notnull())
    out["on_bound"] = 100 * (cells["at_bound"] != 0).mean("parameter")
    out["hits"] = 100 * view.needed["hit_rate"]
    return out.reset_coords(drop=True)


def _difference(x: xr.DataArray, truth: xr.DataArray, statistic: Statistic, paired: bool) -> xr.Dataset:
    """Group minus reference of a statistic averaged over amplitudes, ``value`` and ``mcse``."""
    if paired:

        def of_both(m: Moments[xr.DataArray]) -> xr.DataArray:
            each = statistic(m)
            return (each.isel({GROUP: 1}) - each.isel({GROUP: 0})).mean("amplitude")

        return jackknife(x, truth, of_both)[["value", "mcse"]].reset_coords(drop=True)
    each = jackknife(x, truth, lambda m: statistic(m).mean("amplitude")).reset_coords(drop=True)
    first, second = (each.isel({GROUP: i}, drop=True) for i in range(2))
    errors = np.sqrt(first["mcse"] ** 2 + second["mcse"] ** 2)
    return xr.Dataset({"value": second["value"] - first["value"], "mcse": errors})


def _named(values: dict[str, xr.DataArray]) -> xr.DataArray:
    return xr.concat(list(values.values()), dim=xr.DataArray(list(values), dims=MEASURE, name=MEASURE))


def _of_parameters(cells: xr.Dataset, paired: bool) -> xr.Dataset:
    truth = xr.DataArray(1.0)

    def statistic(m: Moments[xr.DataArray]) -> xr.DataArray:
        measures = {
            "bias": accuracy.absolute_bias_of(m),
            "spread": accuracy.relative_sd_of(m),
            "rmse": 100 * accuracy.rmse_of(m),
        }
        return _named(measures).mean("parameter")

    return _difference(cells["estimate"], truth, statistic, paired)


def _shares(cells: xr.Dataset, paired: bool) -> xr.Dataset:
    shares = _named({name: cells[name] for name in ("unstable", "on_bound", "hits")})
    return _difference(shares, xr.DataArray(0.0), lambda m: m.mean, paired)


def _frf(reference: GroupView, other: GroupView, cells: xr.Dataset, paired: bool) -> xr.Dataset | None:
    """FRFs under the common stimuli, at the common frequencies up to each Fmax; None for cubes without."""
    if any("frf" not in view.cube for view in (reference, other)):
        return None
    pair = _side_by_side([_by_stimulus(view) for view in (reference, other)], paired).sel(amplitude=cells["amplitude"])
    if not pair.sizes["frequency"] * pair.sizes["stimulus"]:
        return None
    pair = pair.sel(realization=cells["realization"]).compute()
    relative = pair["frf"] / pair["true_frf"]
    x = xr.concat([relative.real, relative.imag], dim="part")
    truth = xr.DataArray([1.0, 0.0], dims="part")
    inside = xr.DataArray(
        [reference.within(f, pair["frequency"].values) for f in cells["fmax"].values],
        dims=("fmax", "frequency"),
        coords={"fmax": cells["fmax"], "frequency": pair["frequency"]},
    )

    def statistic(m: Moments[xr.DataArray]) -> xr.DataArray:
        measures = {"frf_error": (m.mean - m.truth) ** 2, "frf_spread": m.sd**2}
        size = 100 * _named(measures).sum("part", skipna=False) ** 0.5
        return size.mean("angle").where(inside).mean("frequency").mean("stimulus")

    return _difference(x, truth, statistic, paired)


def _by_stimulus(view: GroupView) -> xr.Dataset:
    """FRFs with a dimension of stimuli, under each of which the cube has every frequency in turn."""
    names, data = view.model.stimulus_names, view.cube[["frf", "true_frf"]].reset_coords(drop=True)
    each = [data.isel(frequency=slice(k, None, len(names))) for k in range(len(names))]
    return xr.concat(each, dim=xr.DataArray(list(names), dims="stimulus", name="stimulus"))


def comparisons_with(study: StudyView, reference: StudyView, name: str) -> tuple[list[Comparison], dict[str, str]]:
    """Every group of a study minus the group of the same name of another study, called ``name``.

    Two studies with one group each are compared whatever the names of their groups. Returns the comparisons, and the
    reason for each group without one; raises `InputError` with one of these reasons when no group can be compared.
    """
    pairs = {g: (view, reference.groups[g]) for g, view in study.groups.items() if g in reference.groups}
    if len(study.groups) == len(reference.groups) == 1:
        (only,) = reference.groups.values()
        pairs = {g: (view, only) for g, view in study.groups.items()}
    if not pairs:
        held = [", ".join(view.groups) for view in (reference, study)]
        raise InputError(f"{name}: expected a group of the same name, one of {held[1]}, got {held[0]}")
    compared, without = [], {}
    for group, (ours, theirs) in pairs.items():
        theirs = GroupView(f"{theirs.name} of {name}", theirs.cube)
        try:
            compared.append(difference(theirs, ours))
        except InputError as error:
            without[group] = str(error)
    if not compared:
        raise InputError(next(iter(without.values())))
    return compared, without


def _verdicts(reference: GroupView, other: GroupView, result: xr.Dataset) -> Iterator[Verdict]:
    if reference.differences:
        return
    for claim in (c for p in publications() if p.claims_about(other) for c in p.claims):
        if set(claim.changes) != set(other.differences):
            continue
        for expectation in claim.expects:
            for wanted in expectation.fmax:
                fmax = other.fmax(wanted)
                if fmax is None or fmax not in result["fmax"]:
                    continue
                cell = result.sel({MEASURE: expectation.measure, "fmax": fmax})
                yield Verdict(claim, expectation, fmax, float(cell["value"]), float(cell["mcse"]))
