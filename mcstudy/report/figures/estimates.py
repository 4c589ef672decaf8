"""Estimates and true values: Fig. 5 (every parameter) and Fig. 6 (active and passive stiffness combined)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from mcstudy.analysis.montecarlo import Moments, moments
from mcstudy.analysis.view import GroupView
from mcstudy.errors import InputError
from mcstudy.report.axes import axes, colour_of, fixed_ticks
from mcstudy.report.figures.common import GroupLike, view_of
from mcstudy.report.labels import amplitude_label, with_units
from mcstudy.report.style import COLOURS, HATCHES


def parameter_bars(data: GroupLike, parameter: str, ax: Axes | None = None) -> Axes:
    """One panel of Fig. 5 or 6: true value, then mean ± SD of the best fits by Fmax and amplitude, the largest first.

    ``parameter`` may be a derived quantity, such as a sum of stiffnesses, ``"K11+Kpas1"``. Raises `InputError` when
    there is no such parameter.
    """
    view = view_of(data)
    ax = axes(ax, (2.4, 2.0))
    cells = cells_with(view.cells, view.derived, parameter)
    summary = _moments_of(view, cells is view.derived)
    truth, amplitudes = float(summary.truth.sel(parameter=parameter)), cells["amplitude"].values
    means, sds = (x.sel(parameter=parameter) for x in (summary.mean, summary.sd.fillna(0.0)))
    width = 0.8 / len(amplitudes)
    ax.bar(-1, truth, width=0.6, color=COLOURS["muted"])
    for i, a in enumerate(amplitudes):
        x = np.arange(cells.sizes["fmax"]) + ((len(amplitudes) - 1) / 2 - i) * width
        mean, sd = means.sel(amplitude=a).values, sds.sel(amplitude=a).values
        ax.bar(
            x,
            mean,
            yerr=sd,
            width=width * 0.92,
            color=colour_of(amplitudes, a),
            hatch=HATCHES[i % len(HATCHES)],
            edgecolor=COLOURS["panel"],
            linewidth=0,
            error_kw={"ecolor": COLOURS["ink"], "elinewidth": 1.1, "capsize": 2.5},
            label=amplitude_label(view, a),
        )
    ax.axhline(truth, color=COLOURS["ink"], linewidth=0.9, linestyle=(0, (4, 3)))
    fixed_ticks(ax.xaxis, range(-1, cells.sizes["fmax"]), ["true", *(f"{f:g}" for f in cells["fmax"].values)])
    ax.grid(axis="x", visible=False)
    ax.set_xlabel("Fmax (Hz)")
    ax.set_ylim(0 if truth >= 0 else None, None if truth >= 0 else 0)
    ax.set_title(f"{parameter} ({with_units(view.units[parameter])})")
    ax.margins(y=0.08)
    return ax


@lru_cache(maxsize=8)
def _moments_of(view: GroupView, derived: bool) -> Moments[xr.DataArray]:
    """Moments of all parameters of a group; kept, because there is a panel for each."""
    cells = view.derived if derived and view.derived is not None else view.cells
    return moments(cells["estimate"], cells["truth"])


def cells_with(cells: xr.Dataset, derived: xr.Dataset | None, parameter: str) -> xr.Dataset:
    """The best fits that hold ``parameter``: single, or a quantity derived from them."""
    for held in (cells, derived):
        if held is not None and parameter in held["parameter"].values:
            return held
    names = ", ".join(str(n) for n in cells["parameter"].values)
    raise InputError(f"parameter: expected one of {names} or a derived quantity, got {parameter!r}")
