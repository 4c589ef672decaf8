"""What an experiment tells of each parameter: mean and SD of the estimates about the true value, on one scale."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from mcstudy.analysis import accuracy
from mcstudy.analysis.determined import determined, lost
from mcstudy.analysis.view import GroupView
from mcstudy.report.axes import axes, fixed_ticks, legend_below
from mcstudy.report.figures.common import GroupLike, chosen_amplitude, chosen_fmax, view_of
from mcstudy.report.labels import cell_label
from mcstudy.report.style import COLOURS

_KINDS = {"determined": ("o", "green"), "weakly": ("s", "ochre"), "not": ("D", "muted")}
"""Marker and colour of each kind."""

WIDEST = 120.0
"""Largest distance from the truth that is drawn, in percent of it."""


def determined_dots(
    data: GroupLike, fmax: float | None = None, amplitude: float | None = None, ax: Axes | None = None
) -> Axes:
    """Mean ± SD of the estimates of every parameter and derived quantity, in percent of its true value.

    Determined: CV below 20 % and hardly any estimate on a bound; not: half of them on a bound, or a CV of 50 %.
    ``fmax`` in Hz and ``amplitude`` in the unit of the stimulus: by default 1.2 Hz or the nearest, and the largest.
    """
    view, ax = view_of(data), axes(ax, (4.3, 4.2))
    fmax, amplitude = chosen_fmax(view, fmax), chosen_amplitude(view, amplitude)
    names, bias, sd, kinds = _numbers(view, fmax, amplitude)
    y = np.arange(len(names))
    for label, (marker, name) in _KINDS.items():
        chosen, colour = kinds == label, COLOURS[name]
        face = colour if label == "determined" else COLOURS["panel"]
        ax.errorbar(
            bias[chosen], y[chosen], xerr=sd[chosen], fmt=marker, color=colour, markerfacecolor=face, capsize=2,
            label=label,
        )  # fmt: skip
    ax.axvline(0.0, color=COLOURS["ink"], linewidth=0.8, linestyle=(0, (5, 2)))
    fixed_ticks(ax.yaxis, y, names)
    ax.set_ylim(len(names) - 0.4, -0.6)
    most = min(float(np.nanmax(np.abs(bias) + sd, initial=10.0)) * 1.05, WIDEST)
    ax.set_xlim(-most, most)
    ax.set_xlabel("mean ± SD (% from the true value)")
    ax.set_title(cell_label(view, amplitude, fmax))
    legend_below(ax, columns=3)
    return ax


def _numbers(view: GroupView, fmax: float, amplitude: float) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray]:
    """Names, bias and SD in percent of the truth, and of `_KINDS` which each is."""
    parts = [part for part in (view.cells, view.derived) if part is not None]
    columns = [_of(part.sel(fmax=[fmax], amplitude=[amplitude])) for part in parts]
    names = [str(n) for part in parts for n in part["parameter"].values]
    bias, sd, cv = (np.concatenate([c[k] for c in columns]) for k in range(3))
    shares = accuracy.at_bound(view.cells.sel(fmax=[fmax], amplitude=[amplitude]))["value"].sum("side").values.ravel()
    on_bound = np.pad(shares, (0, len(names) - shares.size))  # quantities that follow have no bounds
    held = list(zip(cv, on_bound, strict=True))
    kinds = ["determined" if determined(*h) else "not" if lost(*h) else "weakly" for h in held]
    return names, bias, sd, np.array(kinds)


def _of(cells: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    scale = 100.0 / np.abs(cells["truth"].values)
    bias, sd, cv = (
        accuracy.statistic_of(cells, of)["value"].values.ravel()
        for of in (accuracy.bias_of, accuracy.sd_of, accuracy.cv_of)
    )
    return scale * bias, scale * sd, cv
