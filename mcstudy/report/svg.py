"""Convert a matplotlib figure to inline SVG of a page: themed, small, labelled, reproducible to the byte."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Callable

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from mcstudy.report.style import COLOURS, SETTINGS

_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_TAG = re.compile(r"<[^>]*>")
_REFERENCE = re.compile(r"""(?:xlink:href="#|url\(#)([^")]+)""")
_DECIMALS = 2  # of a point: a fiftieth of a pixel on most screens


def draw(
    drawing: Callable[[Axes], object], key: str, title: str, description: str, size: tuple[float, float] = (4.3, 3.2)
) -> str:
    """Inline SVG of one panel.

    Parameters
    ----------
    drawing: fills the axes it is given.
    key: prefix of all ids; must be unique on the page, made of letters, digits and ``-``.
    title, description: what a screen reader says.
    size: width and height in inches; text is sized so that 4.3 inches fit a telephone.
    """
    own = {"backend": matplotlib.rcParams["backend"], **SETTINGS, "figure.constrained_layout.use": False}
    with matplotlib.rc_context({**matplotlib.rcParamsDefault, **own}):
        figure = Figure(figsize=size, layout="constrained")
        FigureCanvasSVG(figure)
        drawing(figure.add_subplot())
        # What is laid out already is drawn once: `savefig` draws a figure that has a layout engine twice.
        layout = figure.get_layout_engine()
        assert layout is not None
        layout.execute(figure)
        figure.set_layout_engine(None)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return inline(buffer.getvalue(), key, title, description)


def inline(text: str, key: str, title: str, description: str) -> str:
    """matplotlib's SVG document as an element of a page."""
    body = text[text.index("<svg") :]
    viewbox = re.search(r'viewBox="([^"]+)"', body)
    assert viewbox is not None  # matplotlib always writes one
    body = body[body.index(">") + 1 : body.rindex("</svg>")]
    body = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->|<defs>\s*</defs>", "", body, flags=re.S)
    body = _themed(_unique_ids(body, key))
    body = _TAG.sub(lambda tag: _NUMBER.sub(_short, tag.group()), body)  # coordinates, never labels
    body = re.sub(r"\s*\n\s*", " ", body)
    body = re.sub(r"> <", "><", body)
    body = re.sub(r'<g id="[^"]*">|<g class="[^"]*">', "<g>", body) if not _REFERENCE.search(body) else body
    labelled = (
        f'<svg class="plot" viewBox="{viewbox.group(1)}" role="img" aria-labelledby="{key}-t {key}-d" '
        f'xmlns="http://www.w3.org/2000/svg"><title id="{key}-t">{html.escape(title)}</title>'
        f'<desc id="{key}-d">{html.escape(description)}</desc>'
    )
    return labelled + body.strip() + "</svg>"


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


def _short(match: re.Match[str]) -> str:
    number = f"{float(match.group()):.{_DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if number in ("-0", "") else number
