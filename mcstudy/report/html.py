"""Pieces of the page as HTML text; everything that comes from a study is escaped here and nowhere else."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from matplotlib.axes import Axes

from mcstudy.report.svg import draw


@dataclass(frozen=True)
class Table:
    """A table; the first column names its rows."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


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
    small: whether panels are small (many beside each other). legend: (palette name, label) shared by all panels.
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


def escape(text: object) -> str:
    """Text for an element or an attribute."""
    return html.escape(str(text))


def table(content: Table, kind: str = "numbers") -> str:
    """A table in a box of its own that scrolls when the window is narrow."""
    head = "".join(f'<th scope="col">{escape(h)}</th>' for h in content.header)
    body = "".join(
        f'<tr><th scope="row">{escape(row[0])}</th>' + "".join(f"<td>{escape(c)}</td>" for c in row[1:]) + "</tr>"
        for row in content.rows
    )
    return (
        f'<div class="scroll" role="region" tabindex="0" aria-label="{escape(content.caption)}">'
        f'<table class="{kind}"><caption>{escape(content.caption)}</caption>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def details(summary: str, content: str) -> str:
    """Content that opens on demand, and in print."""
    return f"<details><summary>{escape(summary)}</summary>{content}</details>"


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
