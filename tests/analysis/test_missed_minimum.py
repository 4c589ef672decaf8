"""The chance of a missed minimum is told no more precisely than it is known."""

from __future__ import annotations

from typing import Any

import pytest

from mcstudy.analysis.show.missed_minimum import missed_percent, missed_words


def cell(chance: float | None, upper: float | None, realizations: int) -> dict[str, Any]:
    return {
        "missed_minimum": {"value": chance, "mcse": 0.002},
        "missed_minimum_upper": {"value": upper, "mcse": None},
        "realizations": {"used": realizations - 1, "unstable": 1} if realizations > 1 else {"used": 1},
    }


@pytest.mark.parametrize("chance", [0.0, 1e-9, 0.00004, 0.0099])
def test_a_chance_below_the_one_percent_that_the_rule_promises_is_a_limit(chance: float) -> None:
    assert missed_percent(chance) == "< 1"
    assert missed_words(cell(chance, 0.01, 80)) == "< 1"
    assert missed_words(cell(chance, 0.01, 80), error=True) == "< 1"


def test_a_chance_above_it_is_right_on_average_over_realizations() -> None:
    assert missed_words(cell(0.027, 0.08, 80)) == "2.7"
    assert missed_words(cell(0.027, 0.08, 80), error=True) == "2.70 ± 0.20"


def test_a_single_realization_has_the_upper_end_of_its_interval_as_a_limit() -> None:
    assert missed_words(cell(0.005, 0.11, 1)) == "< 11"
    assert missed_words(cell(1e-6, 0.01, 1)) == "< 1"
    assert missed_words(cell(0.25, 0.4, 1)) == "< 40"


def test_no_chance_is_stated_where_no_start_found_a_minimum() -> None:
    assert missed_words(cell(None, None, 4)) == missed_percent(float("nan")) == "-"
