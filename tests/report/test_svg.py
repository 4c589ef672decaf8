"""Inline SVG: themed, labelled, small, and the same bytes every time."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.axes import Axes

from mcstudy.report import frame
from mcstudy.report.readings import as_json
from mcstudy.report.style import COLOURS, DARK
from mcstudy.report.svg import drawn, rendered, style


@pytest.fixture(autouse=True)
def _in_the_style_of_the_page() -> Iterator[None]:
    with style():
        yield


def _curve(ax: Axes) -> None:
    ax.plot(np.linspace(0, 1, 50), np.sin(np.linspace(0, 1, 50)), "o-", color=COLOURS["blue"], label="sine")
    ax.set_yticks([0.125, 0.625], ["0.125", "0.6250"])
    ax.legend()


def _svg(key: str = "a") -> str:
    return rendered(drawn(_curve), key, "A <sine>", "caption")[0]


def test_the_same_drawing_gives_the_same_bytes() -> None:
    assert _svg() == _svg()


def test_colours_are_variables_of_the_page_and_no_colour_is_left_behind() -> None:
    text = _svg()
    assert "var(--blue)" in text
    assert "var(--ink)" in text
    assert not re.findall(r"#[0-9a-fA-F]{6}\b", text)


def test_light_and_dark_name_the_same_colours_each_only_once() -> None:
    assert COLOURS.keys() == DARK.keys()
    assert len(set(COLOURS.values())) == len(COLOURS)


def test_every_reference_resolves_and_every_id_carries_the_panels_key() -> None:
    text = _svg("fig9-3")
    ids = re.findall(r'\sid="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    assert all(i.startswith("fig9-3-") for i in ids)
    references = re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)', text)
    assert {a or b for a, b in references} <= set(ids)


def test_a_screen_reader_hears_title_and_description() -> None:
    text = _svg()
    assert 'role="img" aria-label="A &lt;sine&gt;" aria-describedby="caption"' in text


def test_nothing_global_leaks_out_of_a_drawing() -> None:
    text = _svg()
    assert "<style" not in text
    assert "<metadata" not in text
    assert "width=" not in text[: text.index(">")]


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_every_label_lies_within_the_drawing_and_every_tick_within_the_axes(scale: str) -> None:
    def steep(ax: Axes) -> None:
        ax.barh([1, 2], [3e-20, 40.0])
        ax.set(xscale=scale, xlabel="length", ylabel="name", title="steep")
        ax.set_yticks([1, 2], ["K11+Kpas1", "two\nlines"])

    text, numbers = rendered(drawn(steep), "a", "steep", "caption")
    width, height = map(float, re.findall(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', text)[0])
    frame = text[text.index('<g class="frame">') : text.index("</g></g>")]
    for x, y in re.findall(r'<text x="([-\d.]+)" y="([-\d.]+)"', frame):
        assert 0 <= float(x) <= width
        assert 0 <= float(y) <= height
    x0, x1 = numbers["x"][:2]
    ticks = [float(x) for x in re.findall(r"M([-\d.]+) [\d.]+v", frame)]
    assert len(ticks) >= 3
    assert all(x0 - 0.1 <= t <= x1 + 0.1 for t in ticks)
    for label in ("K11+Kpas1", "two", "lines", "length", "name", "steep"):
        assert f">{label}</text>" in frame


def test_the_readings_are_what_was_plotted() -> None:
    def bars(ax: Axes) -> None:
        ax.bar([0, 1], [2.0, 3.0], yerr=[0.5, 0.25], label="mean <SD>")
        ax.plot([0.0, np.nan, 1.0], [1.0, 2.0, 4.0], label="line")
        ax.plot([0, 1], [0, 1])  # without a name: a guide, no data
        ax.set_xticks([0, 1], ["K11", "K12"])

    _, numbers = rendered(drawn(bars), "a", "bars", "caption")
    first, second = numbers["series"]
    assert first == {"n": "mean <SD>", "x": [0.0, 1.0], "y": [2.0, 3.0], "e": [0.5, 0.25], "on": "y"}
    assert second == {"n": "line", "x": [0.0, 1.0], "y": [1.0, 4.0]}
    assert numbers["names"]["x"] == [[0.0, "K11"], [1.0, "K12"]]
    assert "<" not in as_json([numbers])


def test_coordinates_are_rounded_and_labels_are_not() -> None:
    text = _svg()
    assert ">0.125<" in text
    assert ">0.6250<" in text
    assert not re.findall(r'd="[^"]*\d\.\d{3}', text)


def test_the_last_label_of_an_axis_is_inside_the_drawing() -> None:
    ax = drawn(lambda ax: ax.set_xlim(0, 1000), (2.0, 2.0))
    rendered(ax, "key", "title", "text")
    room = 144 - frame.edges(ax)[1]
    assert room >= frame._width("1000", frame._TICK_SIZE) / 2
