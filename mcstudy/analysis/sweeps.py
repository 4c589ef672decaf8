"""Cells of a sweep as one array, and every statistic of them.

A sweep is stored as one group for each of its cells (`mcstudy.study.sweep`). An opened cube holds them as one Dataset
with the axes of the sweep as further dimensions and the coordinate ``cell``, the name of each cell's group, empty where
a combination was left out. Cells may fit different models: ``parameter`` has those of all, NaN where a cell lacks one.
``.mc`` computes every statistic of each cell by itself, as of any group, and joins the results in the same way.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import xarray as xr

from mcstudy.errors import InputError
from mcstudy.study.cube.conversion import structured

CELL, CELLS = "cell", "cells"
"""Coordinate with the names of the cells, and attribute with what is said of each."""

_OF_PARAMETERS = ("parameter_unit", "parameter_meaning")
_EMPTY = {"status": 0, "at_bound": 0, "iterations": 0}

T = TypeVar("T", xr.Dataset, xr.DataArray)


def label_of(data: xr.Dataset) -> dict[str, Any] | None:
    """Where a group lies in a sweep: the fields of `mcstudy.study.group.CellSection`; None for no cell of one."""
    found: dict[str, Any] | None = (structured(data.attrs, "design") or {}).get(CELL)
    return found


def together(groups: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """The groups of a cube by name, those of a sweep joined under its name at the place of the first."""
    out: dict[str, xr.Dataset] = {}
    sweeps: dict[str, dict[str, xr.Dataset]] = {}
    for name, data in groups.items():
        label = label_of(data)
        sweep = name if label is None else label["sweep"]
        if label is not None:
            sweeps.setdefault(sweep, {})[name] = data
        out[sweep] = data
    return {name: _sweep(sweeps[name]) if name in sweeps else data for name, data in out.items()}


def _sweep(cells: Mapping[str, xr.Dataset]) -> xr.Dataset:
    at = {name: (label_of(data) or {})["at"] for name, data in cells.items()}
    for axis in next(iter(at.values())):
        if len({isinstance(place[axis], str) for place in at.values()}) > 1:  # an index holds one kind
            at = {name: {**place, axis: str(place[axis])} for name, place in at.items()}
    axes = {axis: list(dict.fromkeys(place[axis] for place in at.values())) for axis in next(iter(at.values()))}
    names = xr.DataArray(np.full([len(labels) for labels in axes.values()], "", dtype=object), axes, list(axes))
    for name, place in at.items():
        names.loc[place] = name
    said = {name: dict(data.attrs) for name, data in cells.items()}
    return joined(cells, names.astype(str), said)


def joined(results: Mapping[str, T], names: xr.DataArray, said: Mapping[str, Any]) -> T:
    """Results by cell as one, with ``names`` (of the axes that are left) as coordinate."""
    first = next(iter(results.values()))
    if not names.dims:
        return first.assign_coords(names.coords)
    union: dict[str, dict[str, Any]] = {n: {} for n in _OF_PARAMETERS if n in first.coords}
    for result in results.values():
        for name, known in union.items():
            known |= dict(zip(result["parameter"].values.tolist(), result[name].values.tolist(), strict=True))
    bare = {name: result.drop_vars([n for n in union if n in result.coords]) for name, result in results.items()}
    out = _along(list(names.dims), names, bare)
    attributes = {name: known_attributes(first[name]) for name in union}
    for name, known in union.items():
        texts = [known[p] for p in out["parameter"].values.tolist()]
        out = out.assign_coords({name: ("parameter", texts, attributes[name])})
    shared = {k: v for k, v in first.attrs.items() if all(r.attrs.get(k) == v for r in results.values())}
    out.attrs = {**shared, CELLS: json.dumps(said, ensure_ascii=False, default=str)}
    return out.assign_coords({CELL: names})


def known_attributes(x: xr.DataArray) -> dict[Any, Any]:
    """Its attributes, as a copy."""
    return dict(x.attrs)


def _along(axes: list[Any], names: xr.DataArray, results: Mapping[str, T]) -> T:
    """The results joined along the axes; what was left out is NaN."""
    axis, *others = axes
    parts = []
    for k, label in enumerate(names[axis].values.tolist()):
        inner = names.isel({axis: k}, drop=True)
        held = [name for name in np.ravel(inner.values).tolist() if name]
        if held:
            part = _along(others, inner, results) if others else results[held[0]]
            parts.append((label, part))
    index = pd.Index([label for label, _ in parts], name=axis, dtype=None)
    settings: dict[str, Any] = {"join": "outer", "combine_attrs": "override", "coords": "minimal", "compat": "override"}
    if isinstance(parts[0][1], xr.Dataset):
        settings |= {"data_vars": "all", "fill_value": {v: _EMPTY.get(str(v), np.nan) for v in parts[0][1].data_vars}}
    joined: T = xr.concat([part for _, part in parts], index, **settings)
    return joined.reindex({axis: names[axis].values}) if len(parts) < names.sizes[axis] else joined


def cells_of(data: xr.Dataset) -> dict[str, xr.Dataset] | None:
    """The cells of a sweep, or of a part of one, by name, each as a group of its own; None for no sweep."""
    if CELL not in data.coords or CELLS not in data.attrs:
        return None
    said = json.loads(data.attrs[CELLS])
    names, out = data[CELL], {}
    for place in np.ndindex(names.shape):
        at = dict(zip(names.dims, place, strict=True))
        if name := str(names.values[place]):
            alone = data.isel(at, drop=True).drop_vars(
                [CELL, *(c for c in names.coords if c in data.coords)], errors="ignore"
            )
            out[name] = _own(alone).assign_attrs({CELLS: None} | said[name])
            del out[name].attrs[CELLS]
    return out


def _own(cell: xr.Dataset) -> xr.Dataset:
    """A cell without the parameters and frequencies that only other cells have."""
    for dim, variable in (("parameter", "truth"), ("frequency", "true_frf")):
        if dim in cell.dims and variable in cell:
            there = cell[variable].notnull()
            held = there.any([d for d in there.dims if d != dim]).values
            if not held.all():
                cell = cell.isel({dim: np.flatnonzero(held)})
    kept = {"status": "|u1", "at_bound": "|i1", "iterations": "<i4", "n_frequencies": "<i8"}
    return cell.assign({n: cell[n].astype(kind) for n, kind in kept.items() if n in cell and cell[n].dtype.kind == "f"})


def alone(data: xr.Dataset) -> xr.Dataset:
    """A group, or the one cell of a sweep that was chosen; raises `InputError` for several cells."""
    cells = cells_of(data)
    if cells is None:
        return data
    if len(cells) != 1:
        axes = ", ".join(map(str, data[CELL].dims))
        raise InputError(f"expected one cell of the sweep, got {len(cells)}: choose with .sel({axes}=...)")
    return next(iter(cells.values()))
