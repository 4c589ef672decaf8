"""The frame of a panel as SVG text: grid, ticks, labels and titles, and the margins that these need.

matplotlib makes five artists of every tick and measures each label several times to lay a panel out; that took two
thirds of the time of a page and half of its size. Here matplotlib only says where ticks are and how they read.
Figures have 72 dpi, so that matplotlib's pixels are points.
"""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.ticker import FixedLocator

from mcstudy.report.axes import fixed_ticks, log_axis
from mcstudy.report.style import SETTINGS

_TICK, _MINOR, _GAP = 3.5, 2.0, 3.0  # pt
_EM = 0.65
"""Mean width of a character relative to the size of the type; generous, so that nothing overflows."""

_TICK_SIZE, _LABEL_SIZE, _TITLE_SIZE = (
    float(SETTINGS[key]) for key in ("ytick.labelsize", "axes.labelsize", "axes.titlesize")
)


def share(panels: Sequence[Axes], name: str) -> None:
    """Give panels the same limits and ticks on their ``"x"`` or ``"y"`` axes, so that they compare."""
    if len(panels) > 1:
        axes: list[Any] = [getattr(ax, f"{name}axis") for ax in panels]
        limits = np.array([axis.get_view_interval() for axis in axes])
        low, high = limits.min(), limits.max()
        backwards = axes[0].get_inverted()
        for axis in axes:
            axis.axes.set(**{f"{name}lim": (high, low) if backwards else (low, high)})
        if all(isinstance(axis.get_major_locator(), FixedLocator) for axis in axes):
            labels = {float(t): label for axis in axes for t, label in _labels(axis)}
            for axis in axes:
                fixed_ticks(axis, list(labels), list(labels.values()))
        elif axes[0].get_scale() == "log":
            for axis in axes:
                log_axis(axis)


def left_margin(ax: Axes) -> float:
    """Room that the labels of the vertical axis need, in points."""
    ax.set_position((0.15, 0.2, 0.75, 0.7))  # how many ticks an axis has depends on its length
    left = _TICK + _GAP + max((_width(t, _TICK_SIZE) for _, t in _labels(ax.yaxis)), default=0.0)
    return left + (1.5 * _LABEL_SIZE if ax.get_ylabel() else 0.0)


def place(ax: Axes, renderer: RendererBase, left: float = 0.0) -> None:
    """Move the axes to where their labels, title, legend and outer texts have room, ``left`` points at the left."""
    left = max(left, left_margin(ax))
    width, height = (72 * inches for inches in ax.figure.get_size_inches())  # type: ignore[union-attr]
    names = [t for _, t in _labels(ax.xaxis)]
    upright = max((_width(t, _TICK_SIZE) for t in names), default=0.0)
    lines = max((t.count("\n") + 1 for t in names), default=0)
    bottom = _TICK + _GAP + (upright if _rotated(ax) else 1.2 * _TICK_SIZE * lines)
    bottom += 1.6 * _LABEL_SIZE if ax.get_xlabel() else 0.0
    top = 1.7 * _TITLE_SIZE if ax.get_title() else 0.6 * _TICK_SIZE
    right = max(0.8 * _TICK_SIZE, _beyond(ax, width - left))
    box = ax.get_window_extent(renderer)
    for text in ax.texts:
        extent = text.get_window_extent(renderer)
        right = max(right, (extent.x1 - box.x1) + 2)
        top = max(top, (extent.y1 - box.y1) + (1.7 * _TITLE_SIZE if ax.get_title() else 2))
    legend, hanging = ax.get_legend(), 0.0
    if legend is not None and legend.get_bbox_to_anchor().y1 < box.y0:
        hanging = legend.get_window_extent(renderer).height
        legend.set_bbox_to_anchor((0.5, hanging / height), ax.figure.transSubfigure)
    bottom += hanging
    ax.set_position((left / width, bottom / height, 1 - (left + right) / width, 1 - (bottom + top) / height))


def _beyond(ax: Axes, width: float) -> float:
    """How far the x axis' labels reach beyond axes of this width at the right, points."""
    if _rotated(ax):
        return 0.0
    reach = 0.0
    for value, text in _labels(ax.xaxis):
        x, _ = ax.transAxes.inverted().transform(ax.transData.transform((value, ax.get_ylim()[0])))
        half = max(_width(line, _TICK_SIZE) for line in text.split("\n")) / 2
        reach = max(reach, half - (1 - x) * width)
    return reach


def edges(ax: Axes) -> tuple[float, float, float, float]:
    """Left, right, lower and upper edge of placed axes, in points from the top left of the drawing."""
    box = ax.get_position().transformed(ax.figure.transSubfigure)
    return box.x0, box.x1, _height(ax) - box.y0, _height(ax) - box.y1


def _height(ax: Axes) -> float:
    return 72 * float(ax.figure.get_size_inches()[1])  # type: ignore[union-attr]


def frame(ax: Axes) -> str:
    """Grid, axis lines, ticks, labels and title of placed axes, in points from the top left of the drawing."""
    x0, x1, y0, y1 = edges(ax)
    height = _height(ax)

    def at(axis: Any, values: Iterable[float]) -> list[float]:
        column = 0 if axis.axis_name == "x" else 1
        points = np.zeros((len(list(values)), 2))
        points[:, column] = list(values)
        points[:, 1 - column] = ax.get_ylim()[0] if column == 0 else ax.get_xlim()[0]
        pixels = ax.transData.transform(points)[:, column]
        return [float(p) for p in (pixels if column == 0 else height - pixels)]

    xs, ys = _labels(ax.xaxis), _labels(ax.yaxis)
    x, y = at(ax.xaxis, [t for t, _ in xs]), at(ax.yaxis, [t for t, _ in ys])
    grid = "".join(f"M{p:.2f} {y0:.2f}V{y1:.2f}" for p in x if _has_grid(ax.xaxis))
    grid += "".join(f"M{x0:.2f} {p:.2f}H{x1:.2f}" for p in y if _has_grid(ax.yaxis))
    ticks = "".join(f"M{p:.2f} {y0:.2f}v{_TICK}" for p in x) + "".join(f"M{x0:.2f} {p:.2f}h-{_TICK}" for p in y)
    minor = "".join(f"M{p:.2f} {y0:.2f}v{_MINOR}" for p in at(ax.xaxis, _minor(ax.xaxis)))
    minor += "".join(f"M{x0:.2f} {p:.2f}h-{_MINOR}" for p in at(ax.yaxis, _minor(ax.yaxis)))
    below, middle = y0 + _TICK + _GAP, 0.36 * _TICK_SIZE  # from the middle of a line of type to its base
    if _rotated(ax):
        under = "".join(
            f'<text transform="translate({p + middle:.2f} {below:.2f}) rotate(-90)">{html.escape(t)}</text>'
            for p, (_, t) in zip(x, xs, strict=True)
        )
    else:
        shown = [t for _, t in xs] if isinstance(ax.xaxis.get_major_locator(), FixedLocator) else _apart(x, xs)
        under = "".join(_lines(t, p, below + 0.8 * _TICK_SIZE, 1.2) for p, t in zip(x, shown, strict=True))
    beside = "".join(
        _lines(t, x0 - _TICK - _GAP, p + middle - 0.55 * _TICK_SIZE * t.count("\n"), 1.1)
        for p, (_, t) in zip(y, ys, strict=True)
    )
    lines_below = max((t.count("\n") + 1 for _, t in xs), default=0)
    drop = max((_width(t, _TICK_SIZE) for _, t in xs), default=0.0) if _rotated(ax) else 1.2 * _TICK_SIZE * lines_below
    names = _text(ax.get_xlabel(), f'x="{(x0 + x1) / 2:.2f}" y="{below + drop + 1.1 * _LABEL_SIZE:.2f}"')
    names += _text(ax.get_ylabel(), f'transform="translate({0.9 * _LABEL_SIZE:.2f} {(y0 + y1) / 2:.2f}) rotate(-90)"')
    title = _text(ax.get_title(), f'x="{(x0 + x1) / 2:.2f}" y="{y1 - 0.5 * _TITLE_SIZE:.2f}"')
    return (
        f'<g class="frame"><path d="{grid}" style="fill:none;stroke:var(--grid);stroke-width:.6"/>'
        f'<path d="{ticks}M{x0:.2f} {y1:.2f}V{y0:.2f}H{x1:.2f}" style="fill:none;stroke:var(--muted);stroke-width:.8"/>'
        f'<path d="{minor}" style="fill:none;stroke:var(--muted);stroke-width:.6"/>'
        f"{_group(under, 'end' if _rotated(ax) else 'middle', _TICK_SIZE)}{_group(beside, 'end', _TICK_SIZE)}"
        f"{_group(names, 'middle', _LABEL_SIZE)}{_group(title, 'middle', _TITLE_SIZE)}</g>"
    )


def _apart(at: Sequence[float], labels: Sequence[tuple[float, str]]) -> list[str]:
    """Texts of ticks at these places, points: every one, or every second, third, ... so that none touches the next."""
    texts = [t for _, t in labels]
    half = [_width(t, _TICK_SIZE) / 2 for t in texts]
    for step in range(1, len(texts)):
        kept = range(0, len(texts), step)
        if all(abs(at[b] - at[a]) > half[a] + half[b] for a, b in pairwise(kept)):
            return [t if k % step == 0 else "" for k, t in enumerate(texts)]
    return texts


def _labels(axis: Any) -> list[tuple[float, str]]:
    """Visible major ticks of an axis and their labels."""
    at = np.asarray(axis.get_majorticklocs(), dtype=float)
    texts = axis.get_major_formatter().format_ticks(at)
    return [(float(t), text) for t, text in zip(at, texts, strict=True) if _visible(axis, t)]


def _minor(axis: Any) -> list[float]:
    return [float(t) for t in axis.get_minorticklocs() if _visible(axis, t)]


def _visible(axis: Any, value: float) -> bool:
    if value <= 0 and axis.get_scale() == "log":
        return False
    low, high, at = axis.get_transform().transform(np.array([*sorted(axis.get_view_interval()), value]))
    edge = 1e-9 * (high - low)
    return bool(low - edge <= at <= high + edge)


def _has_grid(axis: Any) -> bool:
    return bool(axis.get_tick_params().get("gridOn", True))


def _rotated(ax: Axes) -> bool:
    return bool(ax.xaxis.get_tick_params().get("rotation", 0))


def _width(text: str, size: float) -> float:
    return _EM * size * max(len(line) for line in text.split("\n"))


def _text(text: str, place: str) -> str:
    return f"<text {place}>{html.escape(text)}</text>" if text else ""


def _lines(text: str, x: float, y: float, spacing: float) -> str:
    """One text element per line: the first at (x, y)."""
    return "".join(
        _text(line, f'x="{x:.2f}" y="{y + i * spacing * _TICK_SIZE:.2f}"') for i, line in enumerate(text.split("\n"))
    )


def _group(content: str, anchor: str, size: float) -> str:
    return f'<g style="fill:var(--ink);font-size:{size:g}px;text-anchor:{anchor}">{content}</g>' if content else ""
