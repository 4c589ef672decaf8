"""How figures and tables use the page: letters of panels, room for text, columns that fit."""

from __future__ import annotations

import re
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
from matplotlib.axes import Axes

from mcstudy.analysis.publications.publication import Counterpart
from mcstudy.report.figure import Figure, Panel, figure
from mcstudy.report.frame import frame, place
from mcstudy.report.svg import drawn, style


def drawing(title: str, ax: Axes) -> None:
    ax.plot([0.0, 1.0])
    ax.set_title(title)


def shown(n: int, *, small: bool = False, letters: str = "") -> str:
    panels = [Panel(f"panel {k}", partial(drawing, "no noise")) for k in range(n)]
    content = Figure("one", "Title", ["Text."], panels, small=small)
    return figure(content, "mcstudy report OUT", Counterpart("Fig. 9", letters=letters))


def test_a_panel_carries_the_letter_of_the_paper() -> None:
    assert shown(2, letters="AB").count("B · no noise") == 1
    assert "Fig. 9 · Title</h3>" in shown(1)
    assert "· no noise" not in shown(1)


@pytest.mark.parametrize(
    ("n", "small", "twos"),
    [(1, False, False), (2, False, True), (3, False, False), (4, False, True), (2, True, False), (12, True, False)],
)
def test_two_or_four_panels_stand_two_in_a_row_so_that_their_text_can_be_read(n: int, small: bool, twos: bool) -> None:
    opening = shown(n, small=small).split(">")[0]
    assert ("twos" in opening) is twos


def test_headings_of_tables_are_not_broken_within_words() -> None:
    import mcstudy.report

    css = (Path(mcstudy.report.__file__).parent / "page.css").read_text(encoding="utf-8")
    (rule,) = [line for line in css.split("\n") if line.startswith("table.numbers thead th{")]
    assert "overflow-wrap:normal" in rule


def test_labels_of_ticks_that_would_touch_are_left_out_evenly() -> None:
    """A delay of 10 ms ± 0.3 ms has labels of seven characters."""
    with style():
        ax = drawn(lambda ax: ax.plot([0.00999, 0.0106], [0, 1]), (3.0, 2.0))
        place(ax, ax.figure.canvas.get_renderer())  # type: ignore[union-attr]
        texts = re.findall(r'<text x="([\d.]+)" y="[\d.]+">(0\.0\d+)</text>', frame(ax))
        every = [label for label in ax.xaxis.get_major_formatter().format_ticks(ax.get_xticks()) if label]
    ends = [(float(x) - 0.31 * 9.5 * len(t), float(x) + 0.31 * 9.5 * len(t)) for x, t in texts]
    assert 2 <= len(texts) < len(every)
    assert all(a[1] < b[0] for a, b in pairwise(sorted(ends)))
