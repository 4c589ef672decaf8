"""The look of every figure: one palette, one set of matplotlib settings.

Each colour of the palette is a different hex value, so that `mcstudy.report.svg` can tell them apart in matplotlib's
output and replace them by the page's CSS variables; the page then has a light and a dark version of every figure.
"""

from __future__ import annotations

from typing import Any

from mcstudy.errors import InputError

COLOURS: dict[str, str] = {
    "ink": "#1b1f24",
    "muted": "#57606a",
    "grid": "#d8dee4",
    "panel": "#fefefe",
    "blue": "#08467f",
    "orange": "#c2540c",
    "green": "#11775a",
    "purple": "#8f3f97",
    "ochre": "#7a5d00",
    "sky": "#3a86b0",
}
"""Name to colour in the light version; the names are CSS variables of the page, ``--blue`` and so on. Blue and orange,
the two colours of most figures, differ in grey too."""

DARK: dict[str, str] = {
    "ink": "#e6edf3",
    "muted": "#a3b0bd",
    "grid": "#343c46",
    "panel": "#171b21",
    "blue": "#a3d2ff",
    "orange": "#e8823c",
    "green": "#57d3a4",
    "purple": "#d8a0e8",
    "ochre": "#e3c04b",
    "sky": "#5fa8cf",
}
"""The same names in the dark version."""

SERIES = tuple(COLOURS[name] for name in ("blue", "orange", "green", "purple", "ochre", "sky"))
"""Colours of data series, in order."""

MARKERS = ("o", "s", "^", "D", "v", "P")
"""Markers of data series, in order: no series is told by colour alone."""

HATCHES = ("", "////", "....", "xxxx")
"""Hatches of bars, in order: bars differ in grey and to the colour-blind."""

DASHES = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)))
"""Line styles of data series, in order."""

SETTINGS: Any = {
    "svg.fonttype": "none",
    "hatch.linewidth": 1.2,
    "svg.hashsalt": "mcstudy",
    "path.simplify_threshold": 0.2,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "axes.labelsize": 10.0,
    "xtick.labelsize": 9.5,
    "ytick.labelsize": 9.5,
    "legend.fontsize": 9.0,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": COLOURS["grid"],
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "lines.markersize": 4.0,
    "text.color": COLOURS["ink"],
    "axes.labelcolor": COLOURS["ink"],
    "axes.edgecolor": COLOURS["muted"],
    "axes.titlecolor": COLOURS["ink"],
    "xtick.color": COLOURS["muted"],
    "ytick.color": COLOURS["muted"],
    "xtick.labelcolor": COLOURS["ink"],
    "ytick.labelcolor": COLOURS["ink"],
    "figure.facecolor": COLOURS["panel"],
    "axes.facecolor": COLOURS["panel"],
    "savefig.facecolor": COLOURS["panel"],
    "axes.unicode_minus": True,
    "figure.constrained_layout.use": True,
}
"""matplotlib's settings for all figures (a dict; its keys are typed differently from version to version)."""


def require_matplotlib() -> None:
    """Raise `InputError` with the cure when matplotlib is not installed."""
    try:
        import matplotlib  # noqa: F401 - only whether it is there
    except ModuleNotFoundError:
        raise InputError("report: matplotlib is not installed; pip install matplotlib") from None
