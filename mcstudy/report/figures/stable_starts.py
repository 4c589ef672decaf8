"""Success of starts by whether the loop is stable at the start."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from mcstudy.report.axes import axes, legend_below
from mcstudy.report.style import SERIES


def hit_rate_bars(rate: xr.Dataset, title: str = "", ax: Axes | None = None) -> Axes:
    """Fraction of starts that reach the lowest minimum by Fmax, for stable and unstable loops at the start, ± MCSE.

    ``rate``: `mcstudy.analysis.search.stable_starts.hit_rate_by_start` at one amplitude.
    """
    ax = axes(ax)
    fmax = rate["fmax"].values
    for i, loop in enumerate(("stable", "unstable")):
        rates = rate.sel(loop=loop)
        x = np.arange(len(fmax)) + (i - 0.5) * 0.38
        value, error = 100 * rates["value"].values, 100 * rates["mcse"].fillna(0.0).values
        hatch = "" if i == 0 else "///"
        ax.bar(x, value, 0.36, yerr=error, color=SERIES[i], alpha=0.8, hatch=hatch, label=f"{loop} start", capsize=3)
        for k, v in enumerate(value):
            text = "none" if not np.isfinite(v) else f"{v:.0f}"
            at = 0.0 if not np.isfinite(v) else min(v + error[k], 108.0)
            ax.annotate(text, (x[k], at), (0, 3), textcoords="offset points", ha="center", fontsize=9)
    ax.set_xticks(range(len(fmax)), [f"{f:g} Hz" for f in fmax])
    ax.set_ylim(0, 119)
    ax.set_yticks([0, 25, 50, 75, 100])
    ax.set_ylabel("starts reaching the minimum (%)")
    ax.set_title(title)
    ax.grid(axis="x", visible=False)
    legend_below(ax, 2, -0.1)
    return ax
