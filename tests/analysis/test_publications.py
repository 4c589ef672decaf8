"""The paper's numbers, against the text of the paper where it is at hand."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from mcstudy_goodworth2018.paper import published
from mcstudy_goodworth2018.paper.statements import RESULTS

from mcstudy.stance.body import two_segment

TEXT = Path(__file__).parents[3] / "shared" / "paper.txt"


def test_names_are_parameters_of_the_model() -> None:
    names = set(two_segment().names)
    for group in (published.LOWEST_CV, published.HIGHEST_CV, published.LEAST_INFLUENTIAL, published.LARGEST_BIAS):
        assert set(group) <= names
        assert len(set(group)) == 3
    assert set(published.BETTER_AT_8HZ) | set(published.WORSE_AT_8HZ) == names


def test_every_result_says_where_it_stands_and_how_it_is_judged() -> None:
    assert len({r.label for r in RESULTS.values()}) == len(RESULTS)
    margins = {margin for margin, _ in published.MARGINS.values()}
    for key, result in RESULTS.items():
        assert result.key == key
        assert result.where
        assert np.isfinite(result.value) == (result.criterion != "none")
        assert (result.margin in margins) == (result.criterion == "equal")


@pytest.mark.skipif(not TEXT.is_file(), reason="the paper's text is not here")
@pytest.mark.parametrize(
    "statement",
    [
        r"11\.6% and 5\.8% for 0\.41 Hz and 1\.2 Hz",
        r"average of 20% error",
        r"7\.6% and 4\.4% for Fmax=0\.4 Hz and 1\.2 Hz",
        r"combined parameter bias error was 11\.8%",
        r"low at 1\.3%, and 1\.9%",
        r"10% lower compared to Fmax=0\.41 Hz",
        r"variability 41% lower",
        r"38%, 21%, and 9\.4% lower",
        r"about 0\.008%",
        r"small overall at 0\.039%",
        r"about 20 different initial random parameter",
        r"typically less than 5%",
        r"bias errors over 5% either had very small influences",
        r"~0\.11 deg and ~0\.08 deg",
        r"CV's that were about half of",
        r"had a large influence across high frequencies but essentially\s+no influence over lower",
        r"became weaker when signal-to-noise decreased",
        r"passive stiffness parameters exhibited large bias errors and variability",
        r"time delays and passive parameters had lower variability in fits to 8Hz",
    ],
)
def test_the_numbers_stand_in_the_paper(statement: str) -> None:
    assert re.search(statement, TEXT.read_text(encoding="utf-8"))
    numbers = {float(x) for x in re.findall(r"\d+(?:\.\d+)?(?=%)", statement.replace("\\", ""))}
    known = {r.value for r in RESULTS.values()} | {published.SMALL_BIAS_PERCENT}
    assert numbers <= known
