"""Bias of every parameter in every cell of a sweep: a map, in standard deviations or in percent of the truth."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes

from mcstudy.report.axes import axes, fixed_ticks

Unit = Literal["sd", "percent"]
ENDS: dict[Unit, float] = {"sd": 3.0, "percent": 100.0}
"""Bias at which the colour is full."""


def size_of_map(cells: list[dict[str, Any]]) -> tuple[float, float]:
    """Inches that `bias_map` needs."""
    return 3.0 + 0.42 * len(parameters_of(cells)), 1.1 + 0.2 * len(cells)


def parameters_of(cells: list[dict[str, Any]]) -> list[str]:
    """Names of the parameters of all cells, and of what they derive."""
    return list(dict.fromkeys(p["name"] for c in cells for p in c["cells"][-1]["parameters"]))


def bias_map(cells: list[dict[str, Any]], condition: int, unit: Unit, ax: Axes | None = None) -> Axes:
    """Signed bias of each parameter (columns) in each cell of a sweep (rows), written and coloured.

    ``cells``: the groups of a sweep in the data of ``mcstudy show --json``. ``condition``: position of an amplitude and
    Fmax among those of a group, -1 for the last. ``unit``: standard deviations of the estimates of the cell, or percent
    of the truth. Orange is too large, violet too small; a bias within two Monte Carlo errors has brackets, no colour.
    """
    ax = axes(ax, size_of_map(cells))
    names = parameters_of(cells)
    value, error = relative_bias(cells, condition, names, unit)
    sure = np.abs(value) > 2 * error
    shown = np.where(sure, np.clip(value / ENDS[unit], -1, 1), 0.0)
    ax.imshow(-np.where(np.isnan(shown), 0.0, shown), cmap="PuOr", vmin=-1.4, vmax=1.4, aspect="auto")
    for (i, j), x in np.ndenumerate(value):
        if np.isfinite(x):
            text = f"{x:.1f}" if unit == "sd" else f"{x:.0f}"
            ax.text(j, i, text if sure[i, j] else f"({text})", fontsize=7, ha="center", va="center")
    fixed_ticks(ax.xaxis, range(len(names)), names)
    fixed_ticks(ax.yaxis, range(len(cells)), [" ".join(map(str, c["cell"]["at"].values())) for c in cells])
    ax.tick_params(axis="x", labelrotation=90)
    ax.grid(visible=False)
    return ax


def relative_bias(
    cells: list[dict[str, Any]], condition: int, names: list[str], unit: Unit
) -> tuple[np.ndarray, np.ndarray]:
    """Bias of the named parameters in every cell (C, P), and its Monte Carlo errors; NaN where there is none."""
    value, error = (np.array([_row(c, condition, names, unit, k) for c in cells]) for k in ("value", "mcse"))
    return value, error


def _row(cell: dict[str, Any], condition: int, names: list[str], unit: Unit, key: str) -> list[float]:
    held = {p["name"]: p for p in cell["cells"][condition]["parameters"]}
    return [_scaled(held[n], unit, key) if n in held else np.nan for n in names]


def _scaled(p: dict[str, Any], unit: Unit, key: str) -> float:
    """A number of the bias in its unit; NaN where there is none."""
    bias = p["bias"][key]
    scale = p["sd"]["value"] if unit == "sd" else abs(p["truth"] or 0.0) / 100
    return float(bias) / float(scale) if bias is not None and scale else np.nan
