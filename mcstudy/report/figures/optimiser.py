"""Influence of the optimiser: accuracy against the number of starts, and the atlas of local minima."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from mcstudy.analysis.accuracy import mean_absolute_bias_percent
from mcstudy.analysis.search.atlas import atlas_of_starts
from mcstudy.analysis.search.by_starts import best_of_first, mean_cv
from mcstudy.analysis.view import GroupView
from mcstudy.report.axes import axes, fixed_ticks, legend_below, plain_log_axis
from mcstudy.report.figures.common import GroupLike, chosen_amplitude, chosen_fmax, sample, view_of
from mcstudy.report.labels import amplitude_label, cell_label, fmax_label
from mcstudy.report.style import COLOURS, DASHES, MARKERS, SERIES

MOST_CLUSTERS = 8
"""Clusters an atlas shows."""

MOST_MINIMA = 40
"""Local minima of a realization that an atlas looks at: those of lowest cost."""

AT_ONCE = 300_000
"""Estimates whose statistics are computed at once: about 2 MB in each of some dozen temporary arrays."""


@lru_cache(maxsize=8)
def best_by_starts_of(view: GroupView) -> xr.Dataset:
    """`mcstudy.analysis.search.by_starts.best_of_first` of a `sample`; kept, because every statistic needs it."""
    return best_of_first(sample(view)).compute()


@lru_cache(maxsize=8)
def by_starts_of(view: GroupView, statistic: Callable[[xr.Dataset], xr.Dataset]) -> xr.Dataset:
    """``statistic``, with dims (amplitude, fmax, drawn), of the best of the first starts of a group."""
    cells = best_by_starts_of(view)
    drawn = cells.sizes["drawn"]
    step = max(1, AT_ONCE * drawn // cells["estimate"].size)
    parts = [statistic(cells.isel(drawn=slice(i, i + step))) for i in range(0, drawn, step)]
    return xr.concat(parts, dim="drawn", coords="minimal", compat="override")


def bias_by_starts(data: GroupLike, ax: Axes | None = None) -> Axes:
    """Mean |bias| of the best of x starts, ± MCSE, one line per Fmax and amplitude."""
    view, ax = view_of(data), axes(ax)
    _lines(ax, view, by_starts_of(view, mean_absolute_bias_percent))
    ax.set_ylabel("mean |bias| (% of true value)")
    return ax


def cv_by_starts(data: GroupLike, ax: Axes | None = None) -> Axes:
    """Mean coefficient of variation of the best of x starts, ± MCSE, one line per Fmax and amplitude."""
    view, ax = view_of(data), axes(ax)
    _lines(ax, view, by_starts_of(view, mean_cv))
    ax.set_ylabel("mean coefficient of variation")
    return ax


def _lines(ax: Axes, view: GroupView, result: xr.Dataset) -> None:
    drawn = result["drawn"].values
    for i, f in enumerate(result["fmax"].values):
        for j, a in enumerate(result["amplitude"].values):
            line = result.sel(fmax=f, amplitude=a)
            ax.errorbar(
                drawn * (1 + 0.03 * (i - j)),  # bars side by side
                line["value"],
                yerr=line["mcse"].fillna(0.0),
                color=SERIES[i % len(SERIES)],
                linestyle=DASHES[j % len(DASHES)],
                marker=MARKERS[i % len(MARKERS)],
                elinewidth=0.8,
                label=f"{fmax_label(float(f))}, {amplitude_label(view, float(a))}",
            )
    plain_log_axis(ax.xaxis, [t for t in (1, 2, 5, 10, 20, 50, 100, 200, 500) if t <= drawn.max()])
    ax.set_ylim(bottom=0)
    ax.set_xlabel("starts per realization")
    legend_below(ax, 2, -0.2)


@lru_cache(maxsize=32)
def atlas_of(view: GroupView, amplitude: float, fmax: float) -> xr.Dataset:
    """Clusters of local minima at one amplitude and Fmax; see `mcstudy.analysis.search.atlas`."""
    return atlas_of_starts(view.cube.sel(amplitude=amplitude, fmax=fmax), MOST_MINIMA)


def basin_atlas(
    data: GroupLike, amplitude: float | None = None, fmax: float | None = None, ax: Axes | None = None
) -> Axes:
    """Positions of the local minima: one row per cluster, one bar per parameter from the middle of its bounds.

    To the right: fraction of all starts that end there, and number of realizations in which the cluster has the lowest
    minimum. Green, solid: most of its fits are stable; orange, pale: most are unstable.
    """
    view, ax = view_of(data), axes(ax, (4.3, 4.4))
    a, f = chosen_amplitude(view, amplitude), chosen_fmax(view, fmax)
    table = atlas_of(view, a, f)
    shown = table.isel(cluster=slice(0, MOST_CLUSTERS))
    names = [str(n) for n in shown["parameter"].values]
    x = np.arange(len(names))
    rows = np.arange(shown.sizes["cluster"])
    ax.hlines([*(rows - 0.4), *(rows + 0.4)], -0.5, len(names) - 0.5, color=COLOURS["grid"], linewidth=0.6)  # bounds
    stable = shown["stable"].values >= 0.5
    tops = rows[:, None] - 0.8 * (shown["position"].transpose("cluster", "parameter").values - 0.5)
    for chosen, colour, alpha in ((stable, "green", 1.0), (~stable, "orange", 0.65)):
        bars = [
            [(x[p] - 0.35, row), (x[p] + 0.35, row), (x[p] + 0.35, tops[row, p]), (x[p] - 0.35, tops[row, p])]
            for row in rows[chosen]
            for p in range(len(names))
        ]
        ax.add_collection(PolyCollection(bars, facecolor=COLOURS[colour], alpha=alpha))
    ax.hlines(rows, -0.5, len(names) - 0.5, color=COLOURS["muted"], linewidth=0.6)
    for row in rows:
        cluster = shown.isel(cluster=row)
        ax.annotate(
            f"{100 * float(cluster['value']):.0f} %\n{int(cluster['lowest'])}/{table.attrs['realizations']}",
            (1.02, row),
            xycoords=("axes fraction", "data"),
            va="center",
            fontsize=9,
            color=COLOURS["ink"],
        )
    ax.annotate("starts\nlowest", (1.02, -0.5), xycoords=("axes fraction", "data"), va="bottom", fontsize=9)
    for words, at, side in (("upper bound", -0.46, "bottom"), ("lower bound", rows[-1] + 0.46, "top")):
        ax.annotate(words, (-0.5, at), va=side, fontsize=9, color=COLOURS["muted"])
    fixed_ticks(ax.xaxis, x, names)
    ax.tick_params(axis="x", labelrotation=90)
    fixed_ticks(ax.yaxis, rows, [str(i + 1) for i in rows])
    ax.set_xlim(-0.7, len(names) - 0.3)
    ax.set_ylim(rows[-1] + 1.0, -1.0)  # half a row beyond the bounds, for their names
    ax.grid(visible=False)
    ax.set_ylabel("cluster of local minima")
    ax.set_title(cell_label(view, a, f))
    return ax
