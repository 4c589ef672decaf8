"""Explanations say where they come from, and only of rows and files that exist."""

import re
from pathlib import Path

from mcstudy.analysis.paper import published
from mcstudy.analysis.paper.explanations import _REASONS, explain_row

TOP = Path(__file__).parents[2]


def test_every_explained_row_exists() -> None:
    assert set(_REASONS) <= set(published.RESULTS)


def test_every_pipeline_and_example_an_explanation_names_exists() -> None:
    named = {name for reason in _REASONS.values() for name in re.findall(r"pipelines/[\w/]+\.(?:toml|py)", reason)}
    assert len(named) >= 4
    for name in named:
        assert (TOP / name).is_file(), name


def test_a_row_without_a_reason_of_its_own_points_at_the_stand_in_truth() -> None:
    assert "stand-in" in explain_row("bias_12_1.2", within_both=False)
    assert "both" not in explain_row("bias_12_8", within_both=False)
    assert explain_row("bias_12_8", within_both=True).startswith(explain_row("bias_12_8", within_both=False))
