"""The content of ``show`` as plain data: the values of `results_schema/<version>/show.json`, before any formatting."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import xarray as xr

from mcstudy.analysis import accuracy, order_statistics, selection
from mcstudy.analysis.compare import MEASURES, Comparison, comparisons, comparisons_with
from mcstudy.analysis.efficiency import efficiency
from mcstudy.analysis.montecarlo import PlainStatistic, jackknives
from mcstudy.analysis.performance import WITH_ERRORS, performance
from mcstudy.analysis.publications.publication import Row, compared
from mcstudy.analysis.search.convergence import starts_needed_quantiles
from mcstudy.analysis.show import SCHEMA
from mcstudy.analysis.show.notes import notes
from mcstudy.analysis.statistics import CELL_STATISTICS
from mcstudy.analysis.view import GroupView, StudyView
from mcstudy.files.schema import identifier
from mcstudy.fitting.status import WANTED

_BESIDE = ("floor", "lower", "upper", "box", "box_mcse", "used")
"""Further numbers of a result that the tables hold."""

_QUANTILES = (0.05, 0.95)
"""Quantiles of the estimates that the tables hold."""

_FLAGS = ("applies", "held")
"""Variables of a result that are true or false."""


def show_data(study: StudyView, reference: StudyView | None = None, name: str = "") -> dict[str, Any]:
    """Everything that ``show`` prints, as JSON values (a number that does not exist is None).

    ``reference``: another study, called ``name``; if given, its groups are the reference instead of a group of the same
    study. Raises `InputError` when no group can be compared.
    """
    attributes = study.attributes
    comparable, without = (comparisons(study), {}) if reference is None else comparisons_with(study, reference, name)
    publication, rows = compared(study)
    return {
        "schema": identifier(SCHEMA),
        "study": {key: attributes.get(key) for key in ("title", "fingerprint", "seed")},
        "paper": {"reference": publication.reference, "rows": [_row(r) for r in rows]},
        "comparisons": [_comparison(c) for c in comparable],
        "not_compared": without,
        "groups": {name: _group(view) for name, view in study.groups.items()},
    }


def json_number(x: Any) -> float | None:
    """A JSON number, or None for NaN and infinities."""
    value = float(x)
    return value if math.isfinite(value) else None


def _row(row: Row) -> dict[str, Any]:
    p, ours, v = row.published, row.ours, row.verdict
    return {
        "key": p.key,
        "label": p.label,
        "unit": p.unit,
        "where": p.where,
        "criterion": p.criterion,
        "paper": json_number(p.value),
        "paper_text": p.shown,
        "half_unit": p.half_unit,
        "margin": p.margin if p.criterion == "equal" else None,
        "value": json_number(ours.value),
        "mcse": json_number(ours.mcse),
        "low": json_number(ours.low),
        "high": json_number(ours.high),
        "n": ours.n,
        "blocks": ours.blocks,
        "floor": json_number(row.floor),
        "group": row.group,
        "verdict": v.name or None,
        "distance": json_number(v.distance),
        "paper_mcse": json_number(v.paper_error),
        "needed": v.needed or None,
        "limited_by": v.limited_by or None,
        "detail": ours.detail,
        "explanation": row.note,
    }


def _comparison(c: Comparison) -> dict[str, Any]:
    read = _reader(c.result.sel(measure=list(MEASURES)), "fmax", "measure")
    return {
        "reference": c.reference,
        "group": c.group,
        "differences": c.differences,
        "amplitudes": c.amplitudes,
        "realizations": c.realizations,
        "paired": c.paired,
        "cells": [
            {"fmax": float(fmax), **{key: read(f, k) for k, key in enumerate(MEASURES)}}
            for f, fmax in enumerate(c.result["fmax"].values)
        ],
        "claims": [
            {
                "claim": v.claim.claim,
                "where": v.claim.where,
                "measure": v.expectation.measure,
                "expected": "higher" if v.expectation.sign > 0 else "lower",
                "fmax": v.fmax,
                "value": json_number(v.value),
                "mcse": json_number(v.mcse),
                "verdict": v.verdict,
            }
            for v in c.verdicts
        ],
    }


def _group(view: GroupView) -> dict[str, Any]:
    g = view.group
    fits = view.counts["fits"].sum(["amplitude", "fmax"])
    return {
        "design": {
            "simulator": g.simulator,
            "realizations": g.realizations,
            "starts": g.starts,
            "until_certain": g.until_certain,
            "fmax": list(g.fmax),
            "amplitude": list(g.amplitude),
            "amplitude_unit": view.model.stimulus_unit,
            "convention": g.stimulus.convention,
            "model": g.model.title,
            "cost": g.fit.cost,
            "solver": g.fit.solver,
            "points": g.spectra.points,
            "ramp": g.spectra.ramp,
            "width": g.spectra.width,
            "noise": view.noisy,
        },
        **({} if g.cell is None else {"cell": g.cell.model_dump(include={"sweep", "at"})}),
        "differences": view.differences,
        "truth_provenance": view.provenance,
        "notes": notes(view),
        "fits": {str(k): int(v) for k, v in zip(fits["outcome"].values, fits.values, strict=True)},
        "cells": _cells(view),
    }


def _cells(view: GroupView) -> list[dict[str, Any]]:
    cells = view.cells
    account = view.counts.drop_vars("fits").drop_dims("outcome", errors="ignore")
    needed = view.needed
    quantile = starts_needed_quantiles(needed)
    results = {s.key: s.load()(cells) for s in CELL_STATISTICS}
    results |= {
        "missed_minimum": _mean_over_realizations(needed["missed"]),
        "missed_minimum_upper": _mean_over_realizations(needed["missed_upper"].clip(min=WANTED)),
        "starts_needed_median": quantile.sel(quantile=0.5, drop=True),
        "starts_needed_90th": quantile.sel(quantile=0.9, drop=True),
    }
    if view.combined is not None:
        results |= {f"{s.key}_combined": s.load()(view.combined) for s in CELL_STATISTICS if s.summed}
    axes = ("amplitude", "fmax")
    readers = {name: _reader(result, *axes) for name, result in results.items()}
    hit_rate = needed["hit_rate"].mean("realization").transpose(*axes).values
    parameters = _parameters(view)
    out = []
    for a, amplitude in enumerate(cells["amplitude"].values):
        for f, fmax in enumerate(cells["fmax"].values):
            counts = account.isel(amplitude=a, fmax=f)
            out.append(
                {
                    "amplitude": float(amplitude),
                    "fmax": float(fmax),
                    "realizations": {str(k): int(v) for k, v in counts.data_vars.items()},
                    "hit_rate": json_number(hit_rate[a, f]),
                    **{name: read(a, f) for name, read in readers.items()},
                    "parameters": [entry(a, f) for entry in parameters],
                }
            )
    return out


def _mean_over_realizations(x: xr.DataArray) -> xr.Dataset:
    """Mean with its standard error, dims (amplitude, fmax)."""
    return jackknives(x, xr.DataArray(0.0), [lambda m: m.mean])[0]


def _reader(result: xr.Dataset, *dims: str) -> Callable[..., dict[str, Any]]:
    """Function from positions along ``dims`` to ``value``, ``mcse`` and, where they exist, floor, bounds and flags.

    It converts to arrays once instead of selecting each number with xarray, because a table has thousands of numbers.
    """
    names = ("value", "mcse", *(name for name in (*_BESIDE, *_FLAGS) if name in result))
    sizes = result["value"].sizes
    arrays = {}
    for name in names:
        arrays[name] = result.variables[name].set_dims({d: sizes[d] for d in dims}).transpose(*dims).values
    return lambda *at: {name: bool(x[at]) if name in _FLAGS else json_number(x[at]) for name, x in arrays.items()}


def _parameters(view: GroupView) -> list[Callable[[int, int], dict[str, Any]]]:
    """Per parameter and derived quantity, a function from a cell's position to its entry."""
    single = _measures(view.cells)
    bounds = accuracy.at_bound(view.cells)
    for side in ("lower", "upper"):
        single[f"at_{side}_bound"] = bounds.sel(side=side)
    single |= {"median_bias": order_statistics.median_bias(view.cells), "mad": order_statistics.mad(view.cells)}
    spread = order_statistics.estimate_quantiles(view.cells, _QUANTILES)
    single |= {f"quantile_{100 * q:02.0f}": spread.sel(quantile=q, drop=True) for q in _QUANTILES}
    single |= _of_errors(view.cells)
    if view.bounds_on_sd is not None:
        single["efficiency"] = efficiency(view.cells, view.bounds_on_sd)
    entries = _entries(view.cells, view.units, single)
    if view.derived is not None:
        further = _measures(view.derived)
        if view.derived_bounds_on_sd is not None:
            further["efficiency"] = efficiency(view.derived, view.derived_bounds_on_sd)
        entries += _entries(view.derived, view.units, further)
    return entries


def _of_errors(cells: xr.Dataset) -> dict[str, xr.Dataset]:
    """How true the standard errors are, where the cube holds them."""
    if selection.ERROR not in cells:
        return {}
    measures = performance(cells["estimate"], cells["truth"], cells[selection.ERROR])
    measures = measures.assign(used=measures["n"]).drop_vars(["meaning", "measure_unit"])
    keys = [m.key for m in WITH_ERRORS]
    without = {k: [] if "coverage" in k else ["lower", "upper"] for k in keys}
    return {f"se_{k}" if k == "relative_error" else k: measures.sel(measure=k).drop_vars(without[k]) for k in keys}


def _entries(
    cells: xr.Dataset, units: dict[str, str], measures: dict[str, xr.Dataset]
) -> list[Callable[[int, int], dict[str, Any]]]:
    readers = {key: _reader(result, "amplitude", "fmax", "parameter") for key, result in measures.items()}
    truth = cells["truth"].values

    def entry(p: int, name: str) -> Callable[[int, int], dict[str, Any]]:
        fixed = {"name": name, "unit": units[name], "truth": json_number(truth[p])}
        return lambda a, f: {**fixed, **{key: read(a, f, p) for key, read in readers.items()}}

    return [entry(p, str(name)) for p, name in enumerate(cells["parameter"].values)]


_MEASURES: dict[str, PlainStatistic] = {
    "bias": accuracy.bias_of,
    "absolute_bias_percent": accuracy.absolute_bias_of,
    "sd": accuracy.sd_of,
    "cv": accuracy.cv_of,
    "rmse": accuracy.rmse_of,
}


def _measures(cells: xr.Dataset) -> dict[str, xr.Dataset]:
    """All measures of every parameter, from one jackknife."""
    results = jackknives(cells["estimate"], cells["truth"], list(_MEASURES.values()))
    out = dict(zip(_MEASURES, results, strict=True))
    out["absolute_bias_percent"] = out["absolute_bias_percent"].assign(floor=accuracy.floor_percent(cells))
    return out
