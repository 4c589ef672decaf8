"""A figure of the page: panels, caption, the numbers behind it and the command that makes it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from matplotlib.axes import Axes

from mcstudy.report.frame import left_margin, share
from mcstudy.report.html import Table, details, escape, table
from mcstudy.report.readings import as_json
from mcstudy.report.svg import drawn, rendered, style


@dataclass(frozen=True)
class Panel:
    """One drawing of a figure.

    Attributes
    ----------
    title: what it shows. drawing: fills its axes. size: inches; a panel wider than `WIDE` has a row of its own.
    share: axes on which it compares with the figure's other panels of the same labels, e.g. ``"xy"``.
    letter: the paper's letter of the panel, written before the title of the drawing.
    """

    title: str
    drawing: Callable[[Axes], object]
    size: tuple[float, float] = (4.3, 3.2)
    share: str = ""
    letter: str = ""


@dataclass(frozen=True)
class Figure:
    """One figure of the page.

    Attributes
    ----------
    key: id on the page. number: the paper's number, e.g. ``"Fig. 3A"``, or empty. title: what it is about.
    text: what it shows and how to read it. panels: the drawings. tables: the numbers behind them.
    published: keys of the paper's results that belong here. python: the call that draws it.
    small: whether panels are small (many in a row). legend: (palette name, label) shared by all panels; a
    name may end in " hatched".
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


def of_part(shown: Figure, k: int, label: str, owner: str) -> Figure:
    """A figure about part ``k`` of a joint result, which ``owner`` draws (``"fit"``): with its own id and title."""
    return replace(
        shown,
        key=f"{shown.key}_{k + 1}",
        title=f"{shown.title}: {label}",
        python=shown.python.replace(f"{owner}.plot", f"{owner}.parts[{k}].plot"),
    )


@dataclass(frozen=True)
class Missing:
    """A figure that this study cannot fill, and why."""

    number: str
    title: str
    reason: str


WIDE = 6.0


def figure(content: Figure, beside_paper: str, command: str) -> str:
    """A figure with its panels, caption, numbers and the command that makes it."""
    heading = f"{content.number} · {content.title}" if content.number else content.title
    with style():
        pictures, numbers = _pictures(content, heading)
    panels = "".join(pictures)
    data = f'<script type="application/json" class="readings">{as_json(numbers)}</script>'
    keys = "".join(
        f'<li><span class="swatch {fill}" style="background-color:var(--{colour})"></span>{escape(label)}</li>'
        for name, label in content.legend
        for colour, _, fill in [name.partition(" ")]
    )
    legend = f'<ul class="legend">{keys}</ul>' if keys else ""
    text = "".join(f"<p>{escape(t)}</p>" for t in content.text)
    tables = details("Numbers", "".join(table(t) for t in content.tables)) if content.tables else ""
    how = f'<p class="how">Made by <code>{escape(command)}</code>'
    how += f"; in Python <code>{escape(content.python)}</code></p>" if content.python else "</p>"
    narrow = all(p.size[0] <= WIDE for p in content.panels)
    beside = ["few"] if len(content.panels) <= 2 and narrow else []  # where the text stands on a wide screen
    beside += ["twos"] if len(content.panels) in (2, 4) and narrow and not content.small else []
    classes = f' class="{" ".join(beside)}"' if beside else ""
    kind = " small" if content.small else " thirds" if len(content.panels) % 3 == 0 else ""
    return (
        f'<figure id="{content.key}"{classes} aria-labelledby="{content.key}-h">'
        f'<h3 id="{content.key}-h">{escape(heading)}</h3>'
        f'{legend}<div class="panels{kind}">{panels}</div>{data}'
        f'<figcaption><div id="{content.key}-text">{text}</div>{beside_paper}{tables}{how}</figcaption></figure>'
    )


def _pictures(content: Figure, heading: str) -> tuple[list[str], list[dict[str, Any]]]:
    """Elements of the panels, and their readings."""
    axes = [drawn(p.drawing, p.size) for p in content.panels]
    for p, ax in zip(content.panels, axes, strict=True):
        if p.letter:
            ax.set_title(f"{p.letter} · {ax.get_title()}")
    _share(content.panels, axes)
    margin = max((left_margin(ax) for p, ax in zip(content.panels, axes, strict=True) if p.size[0] > WIDE), default=0.0)
    pictures, numbers = [], []
    for i, (p, ax) in enumerate(zip(content.panels, axes, strict=True)):
        left = margin if p.size[0] > WIDE else 0.0
        picture, series = rendered(ax, f"{content.key}-{i}", f"{heading}: {p.title}", f"{content.key}-text", left)
        pictures.append(f'<div class="panel{" wide scroll" if p.size[0] > WIDE else ""}">{picture}</div>')
        numbers.append({"title": p.title, **series})
    return pictures, numbers


def _share(panels: Sequence[Panel], axes: Sequence[Axes]) -> None:
    alike: dict[tuple[str, str], list[Axes]] = {}
    for p, ax in zip(panels, axes, strict=True):
        for which in p.share:
            alike.setdefault((which, ax.get_xlabel() if which == "x" else ax.get_ylabel()), []).append(ax)
    for (which, _), members in alike.items():
        share(members, which)


def missing(items: Iterable[Missing]) -> str:
    """One line for every figure that is left out."""
    lines = "".join(f"<li>{escape(f'{m.number} {m.title}'.strip())}: {escape(m.reason)}</li>" for m in items)
    return f'<h3>Not shown</h3><ul class="missing">{lines}</ul>' if lines else ""
