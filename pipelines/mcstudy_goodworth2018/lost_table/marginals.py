"""The marginals of an inference of the lost table: what was known before, and what the printed numbers add."""

from __future__ import annotations

from functools import partial

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mcstudy.report.axes import picture
from mcstudy.report.style import COLOURS, DASHES
from mcstudy_goodworth2018.lost_table.unknowns import UNKNOWNS, Unknown

COLUMNS, SIZE = 4, (2.4, 1.6)
BINS = 16


def marginals_picture(result: xr.Dataset) -> Figure:
    """One panel per unknown, see `marginal`."""
    status = str(result.attrs["status"]).capitalize()
    title = f"Bars: posterior. Grey: prior. Solid line: best configuration. Dashed: stand-in. {status}."
    drawings = [partial(marginal, result.sel(unknown=unknown.name), unknown) for unknown in UNKNOWNS]
    return picture(drawings, title, COLUMNS, SIZE)


def marginal(result: xr.Dataset, unknown: Unknown, ax: Axes) -> None:
    """Prior (flat on the axis) and posterior of one unknown as bars; best configuration and stand-in as lines."""
    if unknown.choices:
        edges = np.arange(len(unknown.choices) + 1) - 0.5
        ax.set_xticks(range(len(unknown.choices)), unknown.choices)
    else:
        edges = np.geomspace(unknown.low, unknown.high, BINS + 1)
        ax.set_xscale("log")
        ax.set_xticks([unknown.low, unknown.high], [f"{unknown.low:g}", f"{unknown.high:g}"])
        ax.set_xticks([], minor=True)
    values = np.clip(result["posterior"].values, edges[0], edges[-1])
    share = np.histogram(values, edges)[0] / values.size
    ax.stairs(np.full(share.size, 1 / share.size), edges, fill=True, color=COLOURS["grid"])
    ax.stairs(share, edges, fill=True, color=COLOURS["blue"], alpha=0.75)
    for name, dash in zip(("best", "stand_in"), DASHES, strict=False):
        ax.axvline(np.clip(float(result[name]), edges[0], edges[-1]), color=COLOURS["orange"], linestyle=dash)
    ax.set_xlim(edges[0], edges[-1])
    ax.set_yticks([])
    ax.set_title(unknown.name + (f" ({unknown.unit})" if unknown.unit not in ("", "1") else ""))
