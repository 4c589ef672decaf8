"""Intervals of all realizations, ordered by how far they are from the truth: how honest the standard errors are."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from mcstudy.analysis.performance import LEVEL, intervals, performance
from mcstudy.analysis.selection import ERROR
from mcstudy.analysis.view import GroupView
from mcstudy.errors import InputError
from mcstudy.report.axes import axes
from mcstudy.report.figures.common import MOST_POINTS, GroupLike, chosen_amplitude, chosen_fmax, view_of
from mcstudy.report.labels import cell_label, with_units
from mcstudy.report.style import COLOURS, DASHES


def performance_of(view: GroupView) -> xr.Dataset:
    """`mcstudy.analysis.performance.performance` of the group; raises `InputError` where it has no standard errors."""
    cells = view.cells
    if ERROR not in cells:
        raise InputError("standard_error: the group has none; expected a study with store.standard_errors = true")
    return performance(cells["estimate"], cells["truth"], cells[ERROR])


def zipper(
    data: GroupLike, parameter: str, amplitude: float | None = None, fmax: float | None = None, ax: Axes | None = None
) -> Axes:
    """95 % intervals of one parameter, one line per realization (`MOST_POINTS`), the farthest from the truth on top.

    Height: share of realizations that are at most as many standard errors from the truth. Orange: the interval misses
    the truth. Of honest intervals those above 95 % do (dashed); dotted: the 95 % interval of the fraction that holds
    the truth. A fit with the parameter on a bound has no interval. Source: Morris, White & Crowther 2019, Figure 5.

    Raises `InputError` for an unknown parameter or a group without standard errors.
    """
    view, ax = view_of(data), axes(ax, (3.2, 3.4))
    a, f = chosen_amplitude(view, amplitude), chosen_fmax(view, fmax)
    units = dict(zip(view.model.names, view.model.units, strict=True))
    if parameter not in units:
        raise InputError(f"parameter: expected one of {', '.join(units)}, got {parameter!r}")
    cell = {"amplitude": a, "fmax": f, "parameter": parameter}
    held = performance_of(view).sel(cell).sel(measure="coverage")
    cells = view.cells.sel(cell)
    shown = intervals(cells["estimate"], cells["truth"], cells[ERROR]).dropna("realization")
    shown = shown.isel(realization=slice(0, MOST_POINTS))
    for holds, colour in ((True, "blue"), (False, "orange")):
        lines = shown.isel(realization=np.flatnonzero(shown["holds"].values == holds))
        ax.hlines(100 * lines["centile"], lines["lower"], lines["upper"], color=COLOURS[colour], linewidth=0.8)
    ax.axvline(float(cells["truth"]), color=COLOURS["ink"], linewidth=1.0)
    ax.axhline(100 * LEVEL, color=COLOURS["muted"], linewidth=1.0, linestyle=DASHES[1])
    for end in ("lower", "upper"):
        if np.isfinite(held[end]):
            ax.axhline(100 * float(held[end]), color=COLOURS["orange"], linewidth=1.0, linestyle=":")
    ax.set_ylim(0, 100)
    ax.set_xlabel(f"{parameter} ({with_units(units[parameter])})")
    ax.set_ylabel("centile of the distance from the truth")
    ax.set_title(cell_label(view, a, f))
    return ax
