"""A figure of the page: panels, caption, the numbers behind it and the command that makes it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from matplotlib.axes import Axes

from mcstudy.report.html import Table, details, escape, table
from mcstudy.report.svg import draw


@dataclass(frozen=True)
class Panel:
    """One drawing of a figure: what it shows, and the function that fills its axes."""

    title: str
    drawing: Callable[[Axes], object]
    size: tuple[float, float] = (4.3, 3.2)


@dataclass(frozen=True)
class Figure:
    """One figure of the page.

    Attributes
    ----------
    key: id on the page. number: the paper's number, e.g. ``"Fig. 3A"``, or empty. title: what it is about.
    text: what it shows and how to read it. panels: the drawings. tables: the numbers behind them.
    published: keys of the paper's results that belong here. python: the call that draws it.
    small: whether panels are small (many in a row). legend: (palette name, label) shared by all panels.
    """

    key: str
    number: str
    title: str
    text: Sequence[str]
    panels: Sequence[Panel]
    tables: Sequence[Table] = ()
    published: Sequence[str] = ()
    python: str = ""
    small: bool = False
    legend: Sequence[tuple[str, str]] = field(default_factory=tuple)


@dataclass(frozen=True)
class Missing:
    """A figure that this study cannot fill, and why."""

    number: str
    title: str
    reason: str


def figure(content: Figure, beside_paper: str, command: str) -> str:
    """A figure with its panels, caption, numbers and the command that makes it."""
    heading = f"{content.number} · {content.title}" if content.number else content.title
    panels = "".join(
        '<div class="panel">'
        + draw(p.drawing, f"{content.key}-{i}", f"{heading}: {p.title}", " ".join(content.text), p.size)
        + "</div>"
        for i, p in enumerate(content.panels)
    )
    keys = "".join(
        f'<li><span class="swatch" style="background:var(--{name})"></span>{escape(label)}</li>'
        for name, label in content.legend
    )
    legend = f'<ul class="legend">{keys}</ul>' if keys else ""
    text = "".join(f"<p>{escape(t)}</p>" for t in content.text)
    numbers = details("Numbers", "".join(table(t) for t in content.tables)) if content.tables else ""
    how = f'<p class="how">Made by <code>{escape(command)}</code>'
    how += f"; in Python <code>{escape(content.python)}</code></p>" if content.python else "</p>"
    few = ' class="few"' if len(content.panels) <= 2 else ""
    return (
        f'<figure id="{content.key}"{few} aria-labelledby="{content.key}-h">'
        f'<h3 id="{content.key}-h">{escape(heading)}</h3>'
        f'{legend}<div class="panels{" small" if content.small else ""}">{panels}</div>'
        f"<figcaption>{text}{beside_paper}{numbers}{how}</figcaption></figure>"
    )


def missing(items: Iterable[Missing]) -> str:
    """One line for every figure that is left out."""
    lines = "".join(f"<li>{escape(f'{m.number} {m.title}'.strip())}: {escape(m.reason)}</li>" for m in items)
    return f'<h3>Not shown</h3><ul class="missing">{lines}</ul>' if lines else ""
