"""One figure of a study as a file of its own: a picture in the size and style of a paper or a talk, or its numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from matplotlib.figure import Figure as Picture
from matplotlib.patches import Patch

from mcstudy.analysis.cache import looking
from mcstudy.errors import InputError
from mcstudy.files.csv_text import csv_text
from mcstudy.report.axes import picture, styled
from mcstudy.report.figure import Figure, Missing, numbers, share_axes
from mcstudy.report.study.context import context_of
from mcstudy.report.study.items import group_figures, main_figures
from mcstudy.report.style import COLOURS, HATCHES
from mcstudy.text_tables import similar

MM = 25.4
"""Millimetres of an inch."""

STYLES = {"page": (1.0, 0.0), "paper": (0.8, 85.0), "talk": (1.7, 280.0)}
"""Size of text and lines against the page's, and usual width in mm; 0: as wide as its panels are on the page."""


def all_figures(path: Any) -> tuple[dict[str, Figure], dict[str, str]]:
    """Figures of the cube at ``path`` by name, and why others cannot be drawn.

    Raises `StoreError` when it is not a cube of this version.
    """
    with looking(path) as look:
        context = context_of(path, look)
        items = [*main_figures(context), *(item for _, group in group_figures(context) for item in group)]
    drawn = {item.key: item for item in items if isinstance(item, Figure)}
    return drawn, {item.key: item.reason for item in items if isinstance(item, Missing)}


def one_figure(path: Any, name: str) -> Figure:
    """The figure of the cube at ``path`` that is called ``name``, or drawn by the function of this name.

    Raises `InputError` when it has no such figure.
    """
    drawn, missing = all_figures(path)
    if name in missing:
        raise InputError(f"{name}: cannot be drawn: {missing[name]}")
    found = next((f for key, f in drawn.items() if key == name or f.python.startswith(f"figures.{name}(")), None)
    if found is None:
        raise InputError(f"{name}: expected one of {', '.join(drawn)}{similar(name, drawn)}")
    return found


def drawn_alone(content: Figure, style: str = "page", width: float | None = None) -> Picture:
    """The picture; ``style``: of `STYLES`; ``width``: mm, else that of the style."""
    scale, usual = STYLES[style]
    broad, high = (max(p.size[k] for p in content.panels) * scale for k in (0, 1))
    n = len(content.panels)
    room = (width or usual) / MM or min(n, 3) * broad
    columns = min(n, max(int(room / broad + 0.25), 1))
    each = room / columns
    new = picture([p.drawing for p in content.panels], content.title, columns, (each, high * each / broad), scale)
    share_axes(content.panels, new.axes)
    with styled(scale):
        _add_legend(new, content)
    return new


def _add_legend(new: Picture, content: Figure) -> None:
    keys = [
        Patch(facecolor=COLOURS[colour], edgecolor="white", hatch=HATCHES[1] if hatched else None, label=label)
        for name, label in content.legend
        for colour, _, hatched in [name.partition(" ")]
    ]
    if keys:
        new.legend(handles=keys, loc="outside lower center", ncols=min(len(keys), 4))


def numbers_of(content: Figure) -> str:
    """The plotted numbers as CSV, as the page saves them."""
    header = ["panel", "series", "x is", "x", "y is", "y", "error bar on", "error bar"]
    return csv_text(header, (row for panel in numbers(content) for row in _rows(panel))) + "\n"


def _rows(panel: dict[str, Any]) -> Iterator[list[Any]]:
    for series in panel["series"]:
        errors = series.get("e") or [None] * len(series["x"])
        for x, y, error in zip(series["x"], series["y"], errors, strict=True):
            at = {"x": x, "y": y}
            named = [next((word for v, word in panel["names"][k] if v == at[k]), panel[k][5]) for k in ("x", "y")]
            yield [panel["title"], series["n"], named[0], x, named[1], y, series.get("on") or "", error]
