"""The numbers a panel draws, for reading them with a pointer and for files of numbers: what was plotted, as JSON."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.ticker import FixedLocator

from mcstudy.report.frame import edges

_DIGITS = 4


def readings(ax: Axes) -> dict[str, Any]:
    """Series and scales of placed axes; see `mcstudy.report.frame`.

    Returns
    -------
    ``x``, ``y``: per axis [start, end (of the view box), value at start, value at end, "log" or "linear", label].
    ``names``: per axis with words for ticks, [value, word] of each. ``series``: of every labelled line and of all bars
    ``n`` (name), ``x``, ``y`` (numbers), and ``e``, half the length of the error bars, on the axis ``on``.
    """
    x0, x1, y0, y1 = edges(ax)
    axes = {
        "x": [*_round([x0, x1, *ax.get_xlim()], 6), ax.get_xscale(), ax.get_xlabel()],
        "y": [*_round([y0, y1, *ax.get_ylim()], 6), ax.get_yscale(), ax.get_ylabel()],
    }
    return {**axes, "names": {n: _words(axis) for n, axis in (("x", ax.xaxis), ("y", ax.yaxis))}, "series": _series(ax)}


def as_json(panels: list[dict[str, Any]]) -> str:
    """JSON that may stand in an element of a page."""
    return json.dumps(panels, ensure_ascii=False, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _series(ax: Axes) -> list[dict[str, Any]]:
    out: list[dict[str, Any]] = []
    done: set[int] = set()
    for container in ax.containers:
        done.update(map(id, container.get_children()))
        name = _name(container)
        if isinstance(container, ErrorbarContainer) and container.lines[0] is not None:
            out.append(_entry(name, container.lines[0].get_xydata(), container))
        elif isinstance(container, BarContainer):
            errors = container.errorbar
            done.update(map(id, errors.get_children() if errors else ()))
            flat = container.orientation == "horizontal"
            ends = [
                (b.get_x() + b.get_width(), b.get_y() + b.get_height() / 2)
                if flat
                else (b.get_x() + b.get_width() / 2, b.get_y() + b.get_height())
                for b in container.patches
            ]
            out.append(_entry(name, np.array(ends).reshape(-1, 2), errors))
    for line in ax.lines:
        if id(line) not in done and _name(line):
            out.append(_entry(_name(line), line.get_xydata()))
    return [entry for entry in out if entry["x"]]


def _entry(name: str, points: Any, errors: ErrorbarContainer | None = None) -> dict[str, Any]:
    points = np.asarray(points, dtype=float).reshape(-1, 2)
    kept = np.isfinite(points).all(axis=1)
    entry: dict[str, Any] = {"n": name, "x": _round(points[kept, 0]), "y": _round(points[kept, 1])}
    bars = errors.lines[2] if errors is not None else ()
    if bars:
        segments = [np.ptp(s, axis=0) / 2 if len(s) else (np.nan, np.nan) for s in bars[0].get_segments()]
        lengths = np.array(segments).reshape(-1, 2)
        on = int(np.nansum(lengths[:, 1]) > np.nansum(lengths[:, 0]))
        if len(lengths) == len(points) and np.isfinite(lengths[kept, on]).all():
            entry |= {"e": _round(lengths[kept, on], 3), "on": "xy"[on]}
    return entry


def _words(axis: Any) -> list[list[Any]]:
    """Ticks that are named, e.g. by a parameter; empty for an axis of numbers."""
    if not isinstance(axis.get_major_locator(), FixedLocator):
        return []
    at = [float(t) for t in axis.get_majorticklocs()]
    texts = axis.get_major_formatter().format_ticks(at)
    named = list(zip(at, texts, strict=True))
    return [] if all(text in ("", f"{t:g}") for t, text in named) else [[t, text] for t, text in named]


def _name(artist: Any) -> str:
    label = str(artist.get_label())
    return "" if label.startswith("_") else label


def _round(values: Any, digits: int = _DIGITS) -> list[float]:
    return [float(f"{v:.{digits}g}") for v in np.asarray(values, dtype=float)]
