"""Estimates in pairs: their correlation over realizations, and the scatter of two of them."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from mcstudy.analysis.correlation import correlation
from mcstudy.analysis.view import GroupView
from mcstudy.errors import InputError
from mcstudy.report.axes import axes, fixed_ticks, legend_below
from mcstudy.report.figures.common import MOST_POINTS, GroupLike, chosen_amplitude, chosen_fmax, view_of
from mcstudy.report.labels import amplitude_label, cell_label, fmax_label, with_units
from mcstudy.report.style import COLOURS, DASHES, MARKERS, SERIES

WRITTEN = 0.3
"""Smallest |correlation| that a map also writes out."""


def correlations_of(view: GroupView, amplitude: float, fmax: float) -> xr.Dataset:
    """`mcstudy.analysis.correlation.correlation` of one condition."""
    return correlation(view.cells.sel(amplitude=amplitude, fmax=fmax, drop=True))


def correlation_map(
    data: GroupLike, amplitude: float | None = None, fmax: float | None = None, ax: Axes | None = None
) -> Axes:
    """Correlations of all pairs of estimates: area is |r|; discs positive, hollow squares negative.

    The values from `WRITTEN` on stand in the other half, in hundredths.
    """
    view, ax = view_of(data), axes(ax, (4.3, 4.3))
    a, f = chosen_amplitude(view, amplitude), chosen_fmax(view, fmax)
    r = correlations_of(view, a, f)["value"]
    draw_correlations(ax, [str(n) for n in r["parameter"].values], r.values)
    ax.set_title(cell_label(view, a, f))
    return ax


def draw_correlations(ax: Axes, names: list[str], matrix: np.ndarray) -> None:
    """Draw correlations ``matrix`` (P, P) as in `correlation_map`; those that are nan are left out.

    Hundredths, because two numbers such as -0.93 side by side would run together.
    """
    row, column = np.tril_indices(len(names), -1)
    value = matrix[row, column]
    for chosen, marker, colour, fill in ((value > 0, "o", "blue", True), (value < 0, "s", "orange", False)):
        ax.scatter(
            column[chosen],
            row[chosen],
            170 * np.abs(value[chosen]) * (12 / max(len(names), 4)) ** 2,
            marker=marker,
            facecolor=COLOURS[colour] if fill else "none",
            edgecolor=COLOURS[colour],
            linewidth=1.4,
        )
    for i, j, v in zip(row, column, value, strict=True):
        if abs(v) >= WRITTEN:
            ax.text(
                float(i),
                float(j),
                f"{100 * v:.0f}",
                fontsize=8.8,
                ha="center",
                va="center",
            )
    for axis in (ax.xaxis, ax.yaxis):
        fixed_ticks(axis, range(len(names)), names)
    ax.tick_params(axis="x", labelrotation=90)
    ax.set_xlim(-0.6, len(names) - 0.4)
    ax.set_ylim(len(names) - 0.4, -0.6)


def estimate_scatter(
    data: GroupLike, first: str, second: str, amplitude: float | None = None, ax: Axes | None = None
) -> Axes:
    """Best fits of two parameters, a point per realization (`MOST_POINTS`), a marker per Fmax; cross: the truth.

    Dashed, for parameters of the same unit: pairs with the true sum. Raises `InputError` for an unknown parameter.
    """
    view, ax = view_of(data), axes(ax)
    a = chosen_amplitude(view, amplitude)
    units = dict(zip(view.model.names, view.model.units, strict=True))
    for name in (first, second):
        if name not in units:
            raise InputError(f"parameter: expected one of {', '.join(units)}, got {name!r}")
    cells = view.cells.sel(amplitude=a).isel(realization=slice(0, MOST_POINTS))
    for i, f in enumerate(cells["fmax"].values):
        x, y = (cells["estimate"].sel(fmax=f, parameter=n).values for n in (first, second))
        ax.plot(x, y, MARKERS[i % len(MARKERS)], color=SERIES[i % len(SERIES)], alpha=0.8, label=fmax_label(float(f)))
    x0, y0 = (float(cells["truth"].sel(parameter=n)) for n in (first, second))
    ax.plot(x0, y0, "P", color=COLOURS["ink"], markersize=8, markeredgecolor=COLOURS["panel"], label="truth")
    if units[first] == units[second]:
        low, high = np.array(ax.get_xlim()), np.array(ax.get_ylim())
        line = np.clip(low, x0 + y0 - high[1], x0 + y0 - high[0])
        ax.plot(line, x0 + y0 - line, color=COLOURS["muted"], linestyle=DASHES[1], linewidth=1.0)
    ax.set_xlabel(f"{first} ({with_units(units[first])})")
    ax.set_ylabel(f"{second} ({with_units(units[second])})")
    ax.set_title(amplitude_label(view, a))
    legend_below(ax, 4)
    return ax
