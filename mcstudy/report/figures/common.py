"""What the figures of studies share: reading their data, and choosing one of a group's conditions."""

from __future__ import annotations

from collections.abc import Sequence

import xarray as xr

from mcstudy.analysis.view import GroupView
from mcstudy.errors import InputError

GroupLike = GroupView | xr.Dataset | xr.DataTree
"""What a figure is made from: a group of a cube, e.g. ``mcstudy.open_results(path)["accuracy"]``."""

MOST_POINTS = 600
"""Largest number of points per condition in a scatter plot; if there are more, the first realizations are shown."""

MOST_STARTS = 1_000_000
"""Starts of a group that figures about single starts read at most: their curves do not change visibly with more."""


def view_of(data: GroupLike) -> GroupView:
    """The group behind ``data``; a `GroupView` keeps its best fits between figures, the others are read again."""
    if isinstance(data, GroupView):
        return data
    if isinstance(data, xr.DataTree):
        return GroupView(data.name or "group", data.to_dataset())
    return GroupView("group", data)


def sample(view: GroupView) -> xr.Dataset:
    """The cube with as many of its first realizations as hold `MOST_STARTS`."""
    return view.cube.isel(realization=slice(0, sampled(view)))


def sampled(view: GroupView) -> int:
    """Realizations of `sample`."""
    held = view.cube.sizes["realization"]
    return min(held, max(1, MOST_STARTS * held // max(view.cube["cost"].size, 1)))


def of_all(view: GroupView, shown: int) -> str:
    """Sentence for a figure that shows ``shown`` realizations; empty if these are all."""
    held = view.cube.sizes["realization"]
    if shown >= held:
        return ""
    return f" Shown are the first {shown:,} of {held:,} realizations, which are a random sample."


def chosen_fmax(view: GroupView, fmax: float | None = None) -> float:
    """The group's Fmax nearest to ``fmax``; by default 1.2 Hz, or its middle one. Raises `InputError`."""
    held = [float(f) for f in view.cube["fmax"].values]
    if fmax is None:
        return view.fmax(1.2) or held[len(held) // 2]
    nearest = view.fmax(fmax)
    if nearest is None:
        raise InputError(f"fmax: expected one of {_listed(held)} Hz, got {fmax:g}")
    return nearest


def chosen_amplitude(view: GroupView, amplitude: float | None = None) -> float:
    """The group's amplitude nearest to ``amplitude``; by default its largest. Raises `InputError`."""
    held = [float(a) for a in view.cube["amplitude"].values]
    if amplitude is None:
        return held[-1]
    nearest = view.amplitude(amplitude)
    if nearest is None:
        raise InputError(f"amplitude: expected one of {_listed(held)}, got {amplitude:g}")
    return nearest


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{v:g}" for v in values)
