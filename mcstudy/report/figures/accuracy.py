"""Accuracy of each parameter: bias (Fig. 7A), variability (Fig. 7B), influence (Fig. 7C)."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from mcstudy.analysis.accuracy import absolute_bias_of, absolute_bias_percent, cv_of, statistic_of
from mcstudy.analysis.montecarlo import Moments
from mcstudy.analysis.sensitivity import RANGES, sensitivity
from mcstudy.analysis.view import GroupView
from mcstudy.errors import InputError
from mcstudy.report.axes import axes, fixed_ticks, legend_below
from mcstudy.report.figures.common import GroupLike, chosen_fmax, view_of
from mcstudy.report.labels import fmax_label
from mcstudy.report.style import COLOURS, HATCHES


@lru_cache(maxsize=16)
def bias_at(view: GroupView, fmax: float) -> xr.Dataset:
    """|bias| in percent of the truth, averaged over amplitudes, with ``floor``; parameters and derived quantities."""
    return _both(view, fmax, _bias)


@lru_cache(maxsize=16)
def cv_at(view: GroupView, fmax: float) -> xr.Dataset:
    """Coefficient of variation averaged over amplitudes; parameters and derived quantities."""
    return _both(view, fmax, _cv)


def _bias(cells: xr.Dataset) -> xr.Dataset:
    out = statistic_of(cells, lambda m: absolute_bias_of(m).mean("amplitude"))
    return out.assign(floor=absolute_bias_percent(cells)["floor"].mean("amplitude"))


def _cv(cells: xr.Dataset) -> xr.Dataset:
    def statistic(m: Moments[xr.DataArray]) -> xr.DataArray:
        return cv_of(m).mean("amplitude")

    return statistic_of(cells, statistic)


def _both(view: GroupView, fmax: float, statistic: Callable[[xr.Dataset], xr.Dataset]) -> xr.Dataset:
    single = statistic(view.cells.sel(fmax=fmax, drop=True))
    if view.derived is None:
        return single
    parts = [x.reset_coords(drop=True) for x in (single, statistic(view.derived.sel(fmax=fmax, drop=True)))]
    return xr.concat([p.assign_coords(parameter=[str(n) for n in p["parameter"].values]) for p in parts], "parameter")


def bias_bars(data: GroupLike, fmax: float | None = None, ax: Axes | None = None) -> Axes:
    """Fig. 7A: |bias| of every parameter ± MCSE; the tick is the |bias| expected from chance alone."""
    view, ax = view_of(data), axes(ax, (4.3, 4.2))
    fmax = chosen_fmax(view, fmax)
    result = _in_order_of_cv(view, fmax, bias_at(view, fmax))
    _bars(ax, view, result)
    y = np.arange(result.sizes["parameter"])
    ax.plot(result["floor"], y, "|", color=COLOURS["panel"], markersize=14, markeredgewidth=5.0)  # edges, for grey
    ax.plot(
        result["floor"],
        y,
        "|",
        color=COLOURS["orange"],
        markersize=12,
        markeredgewidth=2.2,
        label="expected from chance",
    )
    ax.set_xlabel("|bias| (% of true value)")
    ax.set_title(f"Fmax {fmax_label(fmax)}")
    legend_below(ax)
    return ax


def cv_bars(data: GroupLike, fmax: float | None = None, ax: Axes | None = None) -> Axes:
    """Fig. 7B: coefficient of variation of every parameter ± MCSE, smallest first."""
    view, ax = view_of(data), axes(ax, (4.3, 4.2))
    fmax = chosen_fmax(view, fmax)
    _bars(ax, view, _in_order_of_cv(view, fmax, cv_at(view, fmax)))
    ax.set_xlabel("coefficient of variation (SD / mean)")
    ax.set_title(f"Fmax {fmax_label(fmax)}")
    legend_below(ax)
    return ax


def influence_shares(data: GroupLike) -> xr.Dataset:
    """`mcstudy.analysis.sensitivity.sensitivity` at the group's truth and frequencies."""
    return _shares_of(view_of(data))


@lru_cache(maxsize=8)
def _shares_of(view: GroupView) -> xr.Dataset:
    return sensitivity(view.model, view.model.truth, view.cube["frequency"].values)


def sensitivity_bars(data: GroupLike, frequencies: str = "low", ax: Axes | None = None) -> Axes:
    """One pie of Fig. 7C as bars: share of each parameter in what a ±10 % change does to the FRFs.

    ``frequencies``: a range of `mcstudy.analysis.sensitivity.RANGES`. Raises `InputError` when the group has no
    frequency in it.
    """
    view, ax = view_of(data), axes(ax, (4.3, 3.6))
    result = influence_shares(view)
    if frequencies not in result["range"].values:
        raise InputError(f"frequencies: expected one of {', '.join(map(str, result['range'].values))}")
    share = 100 * result["share"].sel(range=frequencies)
    y = np.arange(share.size)
    ax.barh(y, share, color=COLOURS["blue"], height=0.7)
    _names(ax, [str(n) for n in share["parameter"].values])
    for i, v in enumerate(share.values):
        ax.annotate(f"{v:.1f}" if v >= 0.05 else "0", (v, i), xytext=(3, 0), textcoords="offset points", va="center")
    ax.margins(x=0.14)
    ax.set_xlabel("share of influence (%)")
    low, high = RANGES[frequencies]
    ax.set_title(f"{frequencies} frequencies, {low:g} to {high:g} Hz")
    return ax


def _in_order_of_cv(view: GroupView, fmax: float, result: xr.Dataset) -> xr.Dataset:
    """Same order in both figures: least variable on top."""
    cv = cv_at(view, fmax)["value"]
    order = np.argsort(np.where(np.isfinite(cv), cv, np.inf), kind="stable")
    return result.isel(parameter=order)


def _bars(ax: Axes, view: GroupView, result: xr.Dataset) -> None:
    names = [str(n) for n in result["parameter"].values]
    y = np.arange(len(names))
    single = np.array([n in view.model.names for n in names])
    error = result["mcse"].fillna(0.0).values
    kinds = ((single, "blue", "single"), (~single, "green", "active + passive"))
    for (chosen, colour, label), hatch in zip(kinds, HATCHES, strict=False):
        if chosen.any():
            ax.barh(
                y[chosen],
                result["value"].values[chosen],
                xerr=error[chosen],
                height=0.7,
                color=COLOURS[colour],
                hatch=hatch,
                edgecolor=COLOURS["panel"],
                linewidth=0,
                error_kw={"ecolor": COLOURS["ink"], "elinewidth": 1.1, "capsize": 2.5},
                label=label,
            )
    _names(ax, names)
    ax.set_xlim(left=0)


def _names(ax: Axes, names: list[str]) -> None:
    fixed_ticks(ax.yaxis, range(len(names)), names)
    ax.invert_yaxis()
    ax.grid(axis="y", visible=False)
