"""The p-value of any gap: the residual with its margin, contrasts with their share of the level."""

from __future__ import annotations

from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import pytest

from mcstudy.gap.questions import any_gap
from mcstudy.gap.questions.any_gap import CONTRAST_SHARE, MARGIN
from mcstudy.gap.verdict import CAPPED, p_words


def with_p_values(residual: float, *contrasts: float, draws: int = 999) -> any_gap.GapTest:
    """Outcome whose residual and contrasts have these p-values."""
    parts: dict[str, Any] = dict.fromkeys(f.name for f in fields(any_gap.GapTest))
    parts["detection"] = SimpleNamespace(p_value=residual, draws=draws)
    parts["contrasts"] = [SimpleNamespace(p_value=p, changes=(object(),)) for p in contrasts]
    return any_gap.GapTest(**parts)


def test_without_contrasts_the_residual_has_the_whole_level_and_its_margin() -> None:
    assert with_p_values(0.02).p_value == pytest.approx(0.02 * MARGIN)
    assert with_p_values(0.9).p_value == 1.0


def test_every_contrast_has_an_equal_part_of_its_share_and_the_smallest_decides() -> None:
    assert with_p_values(0.5, 0.001).p_value == pytest.approx(0.001 / CONTRAST_SHARE)
    assert with_p_values(0.5, 0.3, 0.001).p_value == pytest.approx(0.002 / CONTRAST_SHARE)
    assert with_p_values(0.01, 0.3, 0.9).p_value == pytest.approx(0.01 * MARGIN / (1 - CONTRAST_SHARE))


def test_independent_uniform_p_values_pass_five_percent_less_often_than_five_times_of_a_hundred() -> None:
    level = 0.05
    alarms = 1 - (1 - level * (1 - CONTRAST_SHARE) / MARGIN) * (1 - level * CONTRAST_SHARE)
    residual = level * (1 - CONTRAST_SHARE) / MARGIN
    assert with_p_values(residual, 1.0).p_value == pytest.approx(level)
    assert with_p_values(1.0, level * CONTRAST_SHARE).p_value == pytest.approx(level)
    assert 0.03 < alarms < 0.04


@pytest.mark.parametrize("contrasts", [(), (0.8,)])
def test_the_least_p_value_is_written_as_a_bound(contrasts: tuple[float, ...]) -> None:
    least = with_p_values(1 / 1000, *contrasts)
    assert p_words(least.p_value, least.p_least).startswith("p < ")
    next_to_it = with_p_values(2 / 1000, *contrasts)
    assert p_words(next_to_it.p_value, next_to_it.p_least).startswith("p = ")


def test_a_p_value_cut_off_at_one_is_told_as_the_limit_that_it_is() -> None:
    assert p_words(1.0, 0.01) == f"p > {CAPPED:g}"
    assert p_words(0.99, 0.01) == "p = 0.99"
    assert (1 - CONTRAST_SHARE) / MARGIN > CAPPED
