"""Efficiency of the estimates relative to the Cramér-Rao bound."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from mcstudy.analysis.efficiency import efficiency
from mcstudy.analysis.view import GroupView
from mcstudy.errors import InputError
from mcstudy.report.axes import axes, legend_below, plain_log_axis
from mcstudy.report.figures.common import GroupLike, chosen_amplitude, view_of
from mcstudy.report.labels import amplitude_label, fmax_label
from mcstudy.report.style import COLOURS, MARKERS, SERIES

SHOWN = (0.01, 100.0)
"""Efficiencies the axis shows; others are drawn as arrows at its ends."""


@lru_cache(maxsize=8)
def efficiency_of(view: GroupView) -> xr.Dataset:
    """`mcstudy.analysis.efficiency.efficiency` of the group, kept for its panels and its table.

    Raises `InputError` where it has no noise covariance.
    """
    if view.bounds_on_sd is None:
        raise InputError("noise_covariance: the group has none, so there is no Cramér-Rao bound")
    return efficiency(view.cells, view.bounds_on_sd)


def efficiency_dots(data: GroupLike, amplitude: float | None = None, ax: Axes | None = None) -> Axes:
    """Efficiency of every parameter by Fmax, ± MCSE: Cramér-Rao variance divided by observed variance.

    Hollow: more than 10 % of the fits end on some bound, so that the Cramér-Rao bound does not apply; shown is the van
    Trees bound within the box of allowed values divided by the mean squared error. Vertical ticks: what the weights of
    the paper's cost can reach to first order.
    """
    view, ax = view_of(data), axes(ax, (4.3, 4.6))
    amplitude = chosen_amplitude(view, amplitude)
    result = efficiency_of(view).sel(amplitude=amplitude)
    names = [str(n) for n in result["parameter"].values]
    fmaxes = result["fmax"].values
    ax.set_xscale("log")
    for i, f in enumerate(fmaxes):
        cells, y = result.sel(fmax=f), np.arange(len(names)) + (i - (len(fmaxes) - 1) / 2) * 0.24
        colour, marker = SERIES[i % len(SERIES)], MARKERS[i % len(MARKERS)]
        face = colour if bool(cells["applies"]) else COLOURS["panel"]
        _dots(ax, cells, y, colour, marker, face)
        ax.plot([], [], marker, color=colour, markerfacecolor=face, label=fmax_label(float(f)))
        if view.group.fit.cost == "paper":
            first_order = (cells["cramer_rao_sd"] / cells["paper_cost_sd"]) ** 2
            ax.plot(np.clip(first_order, *SHOWN), y, "|", color=colour, markersize=6)
    ax.axvline(1.0, color=COLOURS["ink"], linewidth=1.0, linestyle=(0, (4, 3)))
    low, high = ax.get_xlim()
    plain_log_axis(ax.xaxis, [t for t in (0.01, 0.1, 1, 10, 100) if low <= t <= high] or [1.0])
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
    ax.set_xlabel("efficiency (1 = Cramér–Rao bound)")
    ax.set_title(amplitude_label(view, amplitude))
    legend_below(ax, len(fmaxes), -0.13)
    return ax


def _dots(ax: Axes, cells: xr.Dataset, y: np.ndarray, colour: str, marker: str, face: str) -> None:
    names = ("value", "mcse") if bool(cells["applies"]) else ("box", "box_mcse")
    value, error = (cells[name].values for name in names)
    error = np.nan_to_num(error)
    shown = np.isfinite(value) & (value >= SHOWN[0]) & (value <= SHOWN[1])
    below = np.minimum(error, 0.8 * np.where(np.isfinite(value), value, 0.0))  # a log axis has no zero
    bars = [below[shown], np.minimum(error[shown], SHOWN[1] - value[shown])]
    ax.errorbar(value[shown], y[shown], xerr=bars, fmt=marker, color=colour, markerfacecolor=face, elinewidth=1.0)
    for outside, place, arrow in ((value > SHOWN[1], SHOWN[1], ">"), (value < SHOWN[0], SHOWN[0], "<")):
        ax.plot(np.full(int(outside.sum()), place), y[outside], arrow, color=colour, markerfacecolor=face)
