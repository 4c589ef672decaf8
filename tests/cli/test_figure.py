"""``mcstudy figure``: a picture of one figure for a paper or a talk, or its numbers."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from PIL import Image

from mcstudy.cli import main
from mcstudy.cli.verbs.figure import width
from mcstudy.exits import Exit
from tests.helpers.commands import refused, told


def test_figures_are_listed_by_name_and_why_others_cannot_be_drawn(tiny_cube: Path) -> None:
    shown = told("figure", tiny_cube)
    assert "estimates" in shown
    assert "not drawn: efficiency: in every condition more than 10 % of the fits end on a bound" in " ".join(
        shown.split()
    )


@pytest.mark.parametrize(("given", "mm"), [("85mm", 85.0), ("8.5cm", 85.0), ("85", 85.0), ("4in", 101.6)])
def test_a_width_has_a_unit(given: str, mm: float) -> None:
    assert width(given) == pytest.approx(mm)


def test_a_picture_for_a_paper_has_the_width_asked_for(tiny_cube: Path, tmp_path: Path) -> None:
    told("figure", tiny_cube, "variability", "-o", tmp_path / "v.png", "--style", "paper", "--width", "85mm")
    with Image.open(tmp_path / "v.png") as picture:
        assert picture.width == pytest.approx(85 / 25.4 * 300, abs=1)


def test_the_numbers_of_a_figure_are_those_that_it_plots(tiny_cube: Path, tmp_path: Path) -> None:
    told("figure", tiny_cube, "cv_bars", "-o", tmp_path / "v.csv")
    with (tmp_path / "v.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["y is"] for row in rows} >= {"K11", "Kpas1"}
    assert all(float(row["x"]) >= 0 for row in rows)


def test_a_figure_that_a_study_does_not_have_is_refused_with_what_it_has(tiny_cube: Path, tmp_path: Path) -> None:
    assert "(similar: variability)" in refused("figure", tiny_cube, "variabilty", "-o", tmp_path / "v.png")
    assert "cannot be drawn: " in refused("figure", tiny_cube, "efficiency", "-o", tmp_path / "v.png")
    assert "expected a name ending in" in refused("figure", tiny_cube, "bias", "-o", tmp_path / "v.gif")


def test_the_same_figure_has_the_same_bytes(tiny_cube: Path, tmp_path: Path) -> None:
    for name in ("a.svg", "b.svg"):
        assert main(["figure", str(tiny_cube), "bias", "-o", str(tmp_path / name)]) == Exit.DONE
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
