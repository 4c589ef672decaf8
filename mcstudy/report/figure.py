"""A figure of the page: panels, caption, the numbers behind it and the command that makes it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from markupsafe import Markup
from matplotlib.axes import Axes

from mcstudy.analysis.publications.publication import ALONE, Counterpart
from mcstudy.report.frame import left_margin, share
from mcstudy.report.html import html, joined, templates
from mcstudy.report.readings import as_json
from mcstudy.report.svg import drawn, rendered, style
from mcstudy.text_tables import Table


@dataclass(frozen=True)
class Panel:
    """One drawing of a figure.

    Attributes
    ----------
    title: what it shows. drawing: fills its axes. size: inches; a panel wider than `WIDE` has a row of its own.
    share: axes on which it compares with the figure's other panels of the same labels, e.g. ``"xy"``.
    """

    title: str
    drawing: Callable[[Axes], object]
    size: tuple[float, float] = (4.3, 3.2)
    share: str = ""


@dataclass(frozen=True)
class Figure:
    """One figure of the page.

    Attributes
    ----------
    key: id on the page. title: what it is about.
    text: what it shows and how to read it. panels: the drawings. tables: the numbers behind them.
    python: the call that draws it. small: whether panels are small (many in a row).
    legend: (palette name, label) shared by all panels; a name may end in " hatched".
    """

    key: str
    title: str
    text: Sequence[str]
    panels: Sequence[Panel]
    tables: Sequence[Table] = ()
    python: str = ""
    small: bool = False
    legend: Sequence[tuple[str, str]] = field(default_factory=tuple)


def by_angle(data: object, angles: Iterable[tuple[int, str]], **drawings: Callable[..., object]) -> list[Panel]:
    """Panels of ``data`` for every angle (its number and name), of ``drawings`` by the word for what they show."""
    return [
        Panel(f"{what} of {name}", partial(drawing, data, k))
        for k, name in angles
        for what, drawing in drawings.items()
    ]


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
    """A figure that cannot be filled, and why; ``key``: its id if it could."""

    title: str
    reason: str
    key: str


WIDE = 6.0


def figure(content: Figure, command: str, counterpart: Counterpart = ALONE, beside: str = "") -> Markup:
    """A figure with its panels, caption, numbers and the command that makes it; ``beside``: after the caption."""
    heading = counterpart.heading(content.title)
    with style():
        panels, numbers = _pictures(content, heading, counterpart.letters)
    n, narrow = len(content.panels), all(p.size[0] <= WIDE for p in content.panels)
    # where the text is on a wide screen, and how many panels are in a row
    classes = [*["few"] * (n <= 2 and narrow), *["twos"] * (n in (2, 4) and narrow and not content.small)]
    kind = " small" if content.small else " thirds" if n % 3 == 0 else ""
    texts, readings = [*content.text, *counterpart.text], Markup(as_json(numbers))
    shown = templates().figure
    return Markup(shown(content, heading, " ".join(classes), kind, panels, readings, texts, beside, command))


def figures(items: Iterable[Figure | Missing], command: str) -> Markup:
    """Figures, and below them one line for every one that is left out."""
    held = list(items)
    shown = joined(figure(item, command) for item in held if isinstance(item, Figure))
    return shown + missing(item for item in held if isinstance(item, Missing))


def _pictures(
    content: Figure, heading: str, letters: Sequence[str]
) -> tuple[list[tuple[bool, Markup]], list[dict[str, Any]]]:
    """Of each panel, whether it has a row of its own and its picture; and its readings."""
    axes = [drawn(p.drawing, p.size) for p in content.panels]
    for letter, ax in zip(letters, axes, strict=False):
        ax.set_title(f"{letter} · {ax.get_title()}")
    share_axes(content.panels, axes)
    wide = [p.size[0] > WIDE for p in content.panels]
    margin = max((left_margin(ax) for broad, ax in zip(wide, axes, strict=True) if broad), default=0.0)
    pictures, numbers = [], []
    for i, (p, ax) in enumerate(zip(content.panels, axes, strict=True)):
        left = margin if wide[i] else 0.0
        picture, series = rendered(ax, f"{content.key}-{i}", f"{heading}: {p.title}", f"{content.key}-text", left)
        pictures.append((wide[i], Markup(picture)))
        numbers.append({"title": p.title, **series})
    return pictures, numbers


def numbers(content: Figure) -> list[dict[str, Any]]:
    """What each panel plots: its title and its `mcstudy.report.readings.readings`."""
    with style():
        return _pictures(content, content.title, ())[1]


def share_axes(panels: Sequence[Panel], axes: Sequence[Axes]) -> None:
    """Give panels that compare the same limits and ticks; ``axes``: of each panel."""
    alike: dict[tuple[str, str], list[Axes]] = {}
    for p, ax in zip(panels, axes, strict=True):
        for axis in p.share:
            alike.setdefault((axis, ax.get_xlabel() if axis == "x" else ax.get_ylabel()), []).append(ax)
    for (axis, _), members in alike.items():
        share(members, axis)


def missing(items: Iterable[Missing], counterparts: Mapping[str, Counterpart] | None = None) -> Markup:
    """One line for every figure that is left out."""
    numbers = {m: (counterparts or {}).get(m.key, ALONE).number for m in items}
    lines = joined(html("<li>{}: {}</li>", f"{number} {m.title}".strip(), m.reason) for m, number in numbers.items())
    return lines and html('<h3>Not shown</h3><ul class="missing">{}</ul>', lines)
