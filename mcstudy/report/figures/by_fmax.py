"""A statistic of the best fits by Fmax and amplitude."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from mcstudy.analysis.statistics import CELL_STATISTICS, cell_statistic
from mcstudy.errors import InputError
from mcstudy.report.axes import axes, fixed_ticks, legend_below
from mcstudy.report.figures.common import GroupLike, view_of
from mcstudy.report.labels import amplitude_label
from mcstudy.report.style import MARKERS, SERIES


def statistic_by_fmax(data: GroupLike, statistic: str, ax: Axes | None = None) -> Axes:
    """A statistic of the best fits ± MCSE by Fmax, one line per amplitude.

    ``statistic``: a key of `mcstudy.analysis.statistics.CELL_STATISTICS`, e.g. ``"unstable"``.
    """
    if statistic not in (s.key for s in CELL_STATISTICS):
        raise InputError(f"statistic: expected one of {', '.join(s.key for s in CELL_STATISTICS)}, got {statistic}")
    view, ax, declared = view_of(data), axes(ax, (4.3, 3.2)), cell_statistic(statistic)
    result: xr.Dataset = declared.load()(view.cells) * declared.factor
    x = np.arange(result.sizes["fmax"])
    for i, amplitude in enumerate(result["amplitude"].values):
        curve = result.sel(amplitude=amplitude)
        error = curve["mcse"].fillna(0.0).values
        colour, marker = SERIES[i % len(SERIES)], MARKERS[i % len(MARKERS)]
        label = amplitude_label(view, float(amplitude))
        ax.errorbar(x, curve["value"].values, yerr=error, fmt=f"{marker}-", color=colour, label=label)
    fixed_ticks(ax.xaxis, x, [f"{f:g}" for f in result["fmax"].values])
    ax.set_xlabel("Fmax (Hz)")
    ax.set_ylabel(declared.page or declared.head)
    legend_below(ax)
    return ax
