"""What ``show`` says, as plain data: the values of `results_schema/<version>/show.json`, before any formatting."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr

from mcstudy.analysis import accuracy, neural, selection
from mcstudy.analysis.compare import MEASURES, Comparison, comparisons
from mcstudy.analysis.convergence import starts_needed_quantiles
from mcstudy.analysis.efficiency import efficiency
from mcstudy.analysis.montecarlo import Statistic, fraction, quantiles
from mcstudy.analysis.paper_rows import Row, rows
from mcstudy.analysis.published import PAPER
from mcstudy.analysis.view import GroupView, StudyView
from mcstudy.study.schema import identifier

SCHEMA = "show"


def summary(study: StudyView) -> dict[str, Any]:
    """Everything ``show`` prints, JSON values only (a number that does not exist is None)."""
    attributes = study.attributes
    return {
        "schema": identifier(SCHEMA),
        "study": {key: attributes.get(key) for key in ("title", "fingerprint", "seed")},
        "paper": {"reference": PAPER, "rows": [_row(r) for r in rows(study)]},
        "comparisons": [_comparison(c) for c in comparisons(study)],
        "groups": {name: _group(view) for name, view in study.groups.items()},
    }


def number(x: Any) -> float | None:
    """A JSON number, or None for NaN and infinities."""
    value = float(x)
    return value if math.isfinite(value) else None


def _row(row: Row) -> dict[str, Any]:
    p = row.published
    return {
        "key": p.key,
        "label": p.label,
        "unit": p.unit,
        "where": p.where,
        "criterion": p.criterion,
        "paper": number(p.value),
        "paper_text": p.shown,
        "value": number(row.value),
        "mcse": number(row.mcse),
        "n": row.n,
        "floor": number(row.floor),
        "group": row.group,
        "agrees": row.agrees,
        "distance_in_mcse": number(row.distance),
        "distance_in_both_errors": number(row.distance_both),
        "detail": row.detail,
        "explanation": row.note,
    }


def _comparison(c: Comparison) -> dict[str, Any]:
    def stat(measure: str, fmax: float) -> dict[str, Any]:
        return _stat(c.result.sel(measure=measure, fmax=fmax))

    return {
        "reference": c.reference,
        "group": c.group,
        "differences": c.differences,
        "amplitudes": c.amplitudes,
        "realizations": c.realizations,
        "cells": [{"fmax": float(f), **{key: stat(key, f) for key in MEASURES}} for f in c.result["fmax"].values],
        "claims": [
            {
                "claim": v.claim.claim,
                "where": v.claim.where,
                "measure": v.expectation.measure,
                "expected": "higher" if v.expectation.sign > 0 else "lower",
                "fmax": v.fmax,
                "value": number(v.value),
                "mcse": number(v.mcse),
                "verdict": v.verdict,
            }
            for v in c.verdicts
        ],
    }


def _group(view: GroupView) -> dict[str, Any]:
    g = view.group
    fits = selection.outcomes(view.cube).sum(["amplitude", "fmax"]).compute()
    return {
        "design": {
            "simulator": g.simulator,
            "realizations": g.realizations,
            "starts": g.starts,
            "fmax": list(g.fmax),
            "amplitude": list(g.amplitude),
            "amplitude_unit": view.model.stimulus_unit,
            "convention": g.stimulus.convention,
            "model": g.model.kind,
            "cost": g.fit.cost,
            "solver": g.fit.solver,
            "points": g.spectra.points,
            "ramp": g.spectra.ramp,
            "width": g.spectra.width,
            "noise": view.noisy,
        },
        "differences": view.differences,
        "truth_provenance": view.provenance,
        "fits": {str(k): int(v) for k, v in zip(fits["outcome"].values, fits.values, strict=True)},
        "cells": _cells(view),
    }


def _cells(view: GroupView) -> list[dict[str, Any]]:
    cells = view.cells
    account = selection.realizations(view.cube).compute()
    needed = view.needed
    quantile = starts_needed_quantiles(needed)
    whole = {
        "mean_absolute_bias_percent": accuracy.mean_absolute_bias_percent(cells),
        "mean_spread_percent": accuracy.mean_spread_percent(cells),
        "unstable": accuracy.unstable(cells),
        "inside_bounds": fraction(selection.inside_bounds(cells), cells["cost"].notnull()),
        "median_cost": quantiles(cells["cost"], (0.5,)).isel(quantile=0, drop=True),
        "median_j_nc": quantiles(neural.j_nc(cells, view.model), (0.5,)).isel(quantile=0, drop=True),
        "starts_needed_median": quantile.sel(quantile=0.5, drop=True),
        "starts_needed_90th": quantile.sel(quantile=0.9, drop=True),
    }
    if view.combined is not None:
        whole["mean_absolute_bias_percent_combined"] = accuracy.mean_absolute_bias_percent(view.combined)
        whole["mean_spread_percent_combined"] = accuracy.mean_spread_percent(view.combined)
    parameters = _parameters(view)
    out = []
    for amplitude in cells["amplitude"].values:
        for fmax in cells["fmax"].values:
            at = {"amplitude": amplitude, "fmax": fmax}
            out.append(
                {
                    "amplitude": float(amplitude),
                    "fmax": float(fmax),
                    "realizations": {str(k): int(v) for k, v in account.sel(at).data_vars.items()},
                    "hit_rate": number(needed["hit_rate"].sel(at).mean()),
                    **{name: _stat(result.sel(at)) for name, result in whole.items()},
                    "parameters": [entry(at) for entry in parameters],
                }
            )
    return out


def _stat(result: xr.Dataset) -> dict[str, Any]:
    """``value`` and ``mcse``, and whatever else of floor, lower, upper the statistic has."""
    extra = [name for name in ("floor", "lower", "upper") if name in result]
    return {name: number(result[name]) for name in ("value", "mcse", *extra)}


def _parameters(view: GroupView) -> list[Any]:
    """Per parameter (and combined stiffness), a function from a cell's coordinates to its entry."""
    single = _measures(view.cells)
    single["at_bound"] = accuracy.at_bound(view.cells)
    if view.bounds_on_sd is not None:
        single["efficiency"] = efficiency(view.cells, view.bounds_on_sd)
    truth, units = view.cells["truth"], dict(zip(view.model.names, view.model.units, strict=True))
    entries = [_entry(name, units[name], float(truth.sel(parameter=name)), single) for name in view.model.names]
    if view.combined is not None:
        measures = _measures(view.combined)
        new = [str(n) for n in view.combined["parameter"].values if str(n) not in units]
        for name in new:
            value = float(view.combined["truth"].sel(parameter=name))
            entries.append(_entry(name, units[name.split("+")[0]], value, measures))
    return entries


_MEASURES: dict[str, Statistic] = {
    "bias": accuracy.bias_of,
    "absolute_bias_percent": accuracy.absolute_bias_of,
    "sd": accuracy.sd_of,
    "cv": accuracy.cv_of,
    "rmse": accuracy.rmse_of,
}


def _measures(cells: xr.Dataset) -> dict[str, xr.Dataset]:
    """All measures of every parameter, from one jackknife."""
    names = xr.DataArray(list(_MEASURES), dims="measure", name="measure")
    every = accuracy.statistic_of(cells, lambda m: xr.concat([f(m) for f in _MEASURES.values()], dim=names))
    out = {name: every.sel(measure=name) for name in _MEASURES}
    out["absolute_bias_percent"] = out["absolute_bias_percent"].assign(floor=accuracy.floor_percent(cells))
    return out


def _entry(name: str, unit: str, truth: float, measures: dict[str, xr.Dataset]) -> Any:
    def at(where: dict[str, np.floating[Any]]) -> dict[str, Any]:
        out: dict[str, Any] = {"name": name, "unit": unit, "truth": number(truth)}
        for measure, result in measures.items():
            here = result.sel(where).sel(parameter=name)
            if measure == "at_bound":
                for side in ("lower", "upper"):
                    out[f"at_{side}_bound"] = _stat(here.sel(side=side))
            else:
                out[measure] = _stat(here)
        return out

    return at
