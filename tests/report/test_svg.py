"""Inline SVG: themed, labelled, small, and the same bytes every time."""

from __future__ import annotations

import re

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.axes import Axes

from mcstudy.report.style import COLOURS, DARK
from mcstudy.report.svg import drawn, rendered


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


def test_coordinates_are_rounded_and_labels_are_not() -> None:
    text = _svg()
    assert ">0.125<" in text
    assert ">0.6250<" in text
    assert not re.findall(r'd="[^"]*\d\.\d{3}', text)
