"""Convert a matplotlib figure to inline SVG of a page: themed, small, labelled, reproducible to the byte."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mcstudy.report.frame import frame, place
from mcstudy.report.readings import readings
from mcstudy.report.style import COLOURS, SETTINGS

_NUMBER = re.compile(r"(?<=\d\.\d\d)\d+")
_TAG = re.compile(r"<[^>]*>")
_REFERENCE = re.compile(r"""(?:xlink:href="#|url\(#)([^")]+)""")


def drawn(drawing: Callable[[Axes], object], size: tuple[float, float] = (4.3, 3.2)) -> Axes:
    """Axes of their own figure, filled by ``drawing``; `rendered` makes them a picture.

    ``size``: width and height in inches; text is sized so that 4.3 inches fit a telephone. To be called within `style`.
    """
    figure = Figure(figsize=size, dpi=72)  # so that pixels are points, here and in the SVG
    FigureCanvasAgg(figure)  # measures text
    ax = figure.add_axes((0.15, 0.2, 0.75, 0.7))
    drawing(ax)
    return ax


def rendered(ax: Axes, key: str, title: str, described_by: str, left: float = 0.0) -> tuple[str, dict[str, Any]]:
    """Inline SVG of what `drawn` made, and its `mcstudy.report.readings`; within `style`, as `drawn`.

    The frame is written by `mcstudy.report.frame`, matplotlib draws the data.

    Parameters
    ----------
    key: prefix of all ids; must be unique on the page, made of letters, digits and ``-``.
    title: what a screen reader says. described_by: id of the element that says more.
    left: room at the left in points, at least, so that panels one above the other line up.
    """
    figure = ax.figure
    assert isinstance(figure, Figure)
    place(ax, figure.canvas.get_renderer(), left)  # type: ignore[attr-defined]
    outside, numbers = frame(ax), readings(ax)
    ax.set_axis_off()
    for part in (ax.patch, figure.patch, ax.title):
        part.set_visible(False)
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return inline(buffer.getvalue(), key, title, described_by, outside), numbers


def style() -> AbstractContextManager[None]:
    """The report's settings, whatever the user's own are; a place for titles keeps matplotlib from measuring them.

    Once for all panels of a figure: matplotlib checks each of three hundred settings, twice.
    """
    settings = {"backend": matplotlib.rcParams["backend"], **SETTINGS, "figure.constrained_layout.use": False}
    return matplotlib.rc_context({**matplotlib.rcParamsDefault, **settings, "axes.titley": 1.0})


def inline(text: str, key: str, title: str, described_by: str, below: str = "") -> str:
    """matplotlib's SVG document as an element of a page, drawn over the SVG elements ``below``."""
    body = text[text.index("<svg") :]
    viewbox = re.search(r'viewBox="([^"]+)"', body)
    assert viewbox is not None  # matplotlib always writes one
    body = body[body.index(">") + 1 : body.rindex("</svg>")]
    body = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->|<defs>\s*</defs>", "", body, flags=re.S)
    body = _themed(_unique_ids(body, key))
    # Coordinates, never labels, to a hundredth of a point: a fiftieth of a pixel on most screens.
    body = _TAG.sub(lambda tag: _NUMBER.sub("", tag.group()), body)
    body = re.sub(r"\s*\n\s*", " ", body)
    body = re.sub(r"> <", "><", body)
    body = re.sub(r'<g id="[^"]*">|<g class="[^"]*">', "<g>", body) if not _REFERENCE.search(body) else body
    labelled = (
        f'<svg class="plot" viewBox="{viewbox.group(1)}" role="img" aria-label="{html.escape(title)}" '
        f'aria-describedby="{described_by}" xmlns="http://www.w3.org/2000/svg">'
    )
    return labelled + below + body.strip() + "</svg>"


def _unique_ids(body: str, key: str) -> str:
    """Ids that something refers to get the panel's prefix, the others go: a page holds many panels."""
    used = dict.fromkeys(_REFERENCE.findall(body))
    short = {name: f"{key}-{i}" for i, name in enumerate(used)}

    def renamed(match: re.Match[str]) -> str:
        name = match.group(1)
        return f' id="{short[name]}"' if name in short else ""

    body = re.sub(r'\sid="([^"]*)"', renamed, body)
    body = re.sub(r'xlink:href="#([^"]+)"', lambda m: f'href="#{short[m.group(1)]}"', body)
    return re.sub(r"url\(#([^)]+)\)", lambda m: f"url(#{short[m.group(1)]})", body)


def _themed(body: str) -> str:
    for name, colour in COLOURS.items():
        body = body.replace(colour, f"var(--{name})")
    # The page's own font is narrower than the one the layout was made with, so that nothing overflows.
    return re.sub(r"font: (?:[a-z]+ )?([\d.]+)px [^;\"]*", r"font-size: \1px", body)
