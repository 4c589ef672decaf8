"""Results of the search for the minimum: Fig. 3A-C and the waterfall of costs."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from mcstudy.analysis.neural import j_nc
from mcstudy.analysis.search.convergence import starts_needed_quantiles
from mcstudy.analysis.search.minimum_curve import average_curve, minimum_curve
from mcstudy.analysis.selection import attempted, usable
from mcstudy.analysis.view import GroupView
from mcstudy.fitting.certainty import COST_FLOOR
from mcstudy.report.axes import axes, colour_of, log_axis, plain_log_axis
from mcstudy.report.figures.common import MOST_POINTS, GroupLike, chosen_amplitude, chosen_fmax, sample, view_of
from mcstudy.report.labels import amplitude_label, cell_label, fmax_label
from mcstudy.report.style import COLOURS, DASHES, MARKERS, SERIES

MOST_CURVES = 60
"""Largest number of realizations in a waterfall plot."""


def pools_of_points(view: GroupView) -> int:
    """Realizations whose starts are the points of `controller_error`."""
    return max(1, MOST_POINTS // view.cube.sizes["start"])


def controller_error(
    data: GroupLike, amplitude: float | None = None, fmax: float | None = None, ax: Axes | None = None
) -> Axes:
    """Fig. 3A: cost of every start's fit against the error of its neural controllers."""
    view, ax = view_of(data), axes(ax)
    a, f = chosen_amplitude(view, amplitude), chosen_fmax(view, fmax)
    cube = view.cube.sel(amplitude=[a], fmax=[f])
    cube = cube.isel(realization=slice(0, pools_of_points(view)))
    ok = usable(cube).values.ravel()
    cost, error = cube["cost"].values.ravel()[ok], j_nc(cube, view.model).values.ravel()[ok]
    stable = cube["growth_rate"].values.ravel()[ok] < 0
    for chosen, colour, marker, label in ((stable, "blue", "o", "stable"), (~stable, "orange", "x", "unstable")):
        if chosen.any():
            ax.plot(cost[chosen], error[chosen], marker, color=COLOURS[colour], markersize=3.5, alpha=0.7, label=label)
    log_axis(ax.xaxis, 6)
    log_axis(ax.yaxis)
    ax.set_xlabel("cost J of the fit")
    ax.set_ylabel("error of neural controllers J_NC")
    ax.set_title(cell_label(view, a, f))
    ax.legend()
    return ax


def controller_error_by_noise(data: GroupLike, fmax: float | None = None, ax: Axes | None = None) -> Axes:
    """One panel of Fig. 3C: cost against error of the neural controllers, best fit of every realization by amplitude.

    Small dots: all local minima of the first realizations. Hollow: the loop of the best fit is unstable.
    """
    view, ax = view_of(data), axes(ax)
    f = chosen_fmax(view, fmax)
    amplitudes = view.cube["amplitude"].values
    for i, a in enumerate(amplitudes):
        colour, marker = colour_of(amplitudes, a), MARKERS[i % len(MARKERS)]
        cube = view.cube.sel(amplitude=[a], fmax=[f])
        cube = cube.isel(realization=slice(0, max(1, MOST_POINTS // 3 // cube.sizes["start"])))
        ok = usable(cube).values.ravel()
        minima = np.unique(_rounded(cube["cost"].values.ravel()[ok], j_nc(cube, view.model).values.ravel()[ok]), axis=0)
        ax.plot(*minima.T, ".", color=colour, markersize=3, alpha=0.35)
        cells = view.cells.sel(amplitude=[a], fmax=[f]).isel(realization=slice(0, MOST_POINTS))
        cost, error = cells["cost"].values.ravel(), j_nc(cells, view.model).values.ravel()
        stable = cells["growth_rate"].values.ravel() < 0
        ax.plot(cost[stable], error[stable], marker, color=colour, markersize=5, label=amplitude_label(view, a))
        if not stable.all():
            label = f"{amplitude_label(view, a)}, unstable"
            fill = COLOURS["panel"]
            ax.plot(
                cost[~stable], error[~stable], marker, color=colour, markersize=5, markerfacecolor=fill, label=label
            )
    log_axis(ax.xaxis, 6)
    log_axis(ax.yaxis)
    ax.set_xlabel("cost J of the fit")
    ax.set_ylabel("error of neural controllers J_NC")
    ax.set_title(f"Fmax {fmax_label(f)}")
    ax.legend()
    return ax


def _rounded(*columns: np.ndarray) -> np.ndarray:
    """Columns to three digits, so that fits of the same minimum are one point."""
    x = np.stack(columns, axis=1)
    scale = 10.0 ** (np.floor(np.log10(np.where(x > 0, x, 1.0))) - 2)
    return np.asarray(np.round(x / scale) * scale)


@lru_cache(maxsize=8)
def curve_of(view: GroupView) -> xr.Dataset:
    """`average_curve` of a `sample` of a group at all numbers of starts that the page draws or prints; one pass."""
    drawn = np.union1d(_points(view.cube.sizes["start"]), printed_starts(view))
    return average_curve(minimum_curve(sample(view), drawn)).compute()


def printed_starts(view: GroupView) -> list[int]:
    """Numbers of starts in the table of `curve_of`."""
    return [x for x in (1, 2, 5, 10, 20, 50, 100, 200, 500) if x <= view.cube.sizes["start"]]


def _points(pool: int) -> np.ndarray:
    return np.unique(np.round(np.geomspace(1, pool, min(60, pool))).astype(int))


def starts_curve(data: GroupLike, fmax: float | None = None, ax: Axes | None = None) -> Axes:
    """Fig. 3B: expected lowest cost of x starts, mean over realizations ± MCSE, one curve per amplitude.

    Dots: the starts needed, with which nine of ten realizations are 95 % sure of their lowest minimum.
    Call it with several groups on the same axes: the paper's figure is two groups with noise and one without.
    """
    view, ax = view_of(data), axes(ax)
    f = chosen_fmax(view, fmax)
    pool = view.cube.sizes["start"]
    drawn = _points(pool)
    curve = curve_of(view).sel(fmax=f, drawn=drawn)
    needed = starts_needed_quantiles(view.needed, (0.9,))["value"].sel(fmax=f).squeeze("quantile")
    for a in curve["amplitude"].values:
        line = curve.sel(amplitude=a)
        i = len(ax.lines)
        colour = SERIES[i % len(SERIES)]
        n = float(needed.sel(amplitude=a))
        label = amplitude_label(view, a) + (f": {n:.0f} needed" if np.isfinite(n) else "")
        ax.plot(drawn, line["value"], color=colour, linestyle=DASHES[i % len(DASHES)], label=label)
        if n <= pool:
            ax.scatter([n], np.interp([n], drawn, line["value"]), color=colour, s=36.0, zorder=3)
        low = np.maximum(line["value"] - line["mcse"].fillna(0.0), 0.5 * line["value"])
        ax.fill_between(drawn, low, line["value"] + line["mcse"].fillna(0.0), color=colour, alpha=0.2, linewidth=0)
    log_axis(ax.yaxis)
    plain_log_axis(
        ax.xaxis, [t for t in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if t <= max(pool, ax.get_xlim()[1])]
    )
    ax.set_xlabel("number of starts")
    ax.set_ylabel("expected lowest cost J")
    ax.set_title(f"Fmax {fmax_label(f)}")
    ax.legend()
    return ax


def waterfall(
    data: GroupLike, amplitude: float | None = None, fmax: float | None = None, ax: Axes | None = None
) -> Axes:
    """Sorted costs of all starts, one line per realization, relative to the realization's lowest cost.

    The flat beginning of a line is the fraction of starts that reached the lowest minimum; steps are other minima.
    """
    view, ax = view_of(data), axes(ax)
    a, f = chosen_amplitude(view, amplitude), chosen_fmax(view, fmax)
    cube = view.cube.sel(amplitude=a, fmax=f).isel(realization=slice(0, MOST_CURVES))
    cost = cube["cost"].where(usable(cube)).transpose("realization", "start").values
    for row, starts in zip(cost, attempted(cube).sum("start").values, strict=True):
        row = np.sort(row[np.isfinite(row)])
        if row.size:
            ratio = (row + COST_FLOOR) / (row[0] + COST_FLOOR)
            share = 100 * np.arange(1, row.size + 1) / starts
            keep = _corners(np.log10(ratio))
            ax.step(share[keep], ratio[keep], where="pre", color=COLOURS["blue"], linewidth=0.8, alpha=0.45)
    log_axis(ax.yaxis)
    ax.set_xlim(0, 100)
    ax.set_xlabel("starts, sorted by cost (%)")
    ax.set_ylabel("cost / lowest cost")
    ax.set_title(cell_label(view, a, f))
    return ax


def _corners(y: np.ndarray) -> np.ndarray:
    """Indices of the points that a staircase needs: ends, and both sides of every visible step."""
    step = np.abs(np.diff(y)) > 1e-3 * max(float(np.ptp(y)), 1e-12)
    keep = np.zeros(y.size, dtype=bool)
    keep[[0, -1]] = True
    keep[:-1] |= step
    keep[1:] |= step
    return np.flatnonzero(keep)
