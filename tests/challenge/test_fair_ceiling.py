"""The ideal method that expects all kinds of cases: its shares, and what they cost where one effect is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcstudy_challenge.challenge_file import resolve
from mcstudy_challenge.design import Series

from pipelines.validation.fair_bound import Ideal, ideal
from tests.helpers.examples import run_with_file

RAW: dict[str, Any] = {
    "challenge": {"name": "tiny", "seed": 5, "cases": 1},
    "sizes": {"effects": ["stimulus_gain", "integral_ankle"], "outsiders": ["lumbar_relaxation"]},
    "protocol": {"amplitudes": [5.0], "cycles": 3},
}


def series(**mix: float) -> Series:
    return resolve({**RAW, "mix": mix}).series["main"]


@pytest.fixture(scope="module")
def both() -> Ideal:
    return ideal(series(), np.random.default_rng(0))


def test_the_shares_are_those_of_the_challenge(both: Ideal) -> None:
    groups, prior = len(both.around.groups), both.fair.prior
    assert prior.sum() == pytest.approx(1.0)
    assert prior[0] == pytest.approx(0.30)  # nothing missing, and parameters far off
    assert prior[1 : 1 + groups].sum() == pytest.approx(0.45)
    assert prior[1 + groups] == pytest.approx(0.15)
    assert prior[2 + groups :].sum() == pytest.approx(0.10)
    for group in range(prior.size - 1):
        assert both.fair.share[both.fair.group == group].sum() == pytest.approx(1.0)
    assert both.fair.weight.sum(axis=1) == pytest.approx(np.ones(len(both.fair.weight)))


def test_expecting_more_costs_probability_where_one_effect_is_missing(both: Ideal) -> None:
    narrow, fair = both.figures(np.random.default_rng(1), 6.0, 200)
    assert fair.probability < narrow.probability - 0.01
    assert fair.set_size > narrow.set_size
    assert fair.top > 0.8


def test_where_nothing_else_is_to_be_expected_both_methods_are_one() -> None:
    same = ideal(series(none=0.4, known=0.6, outsider=0.0, pair=0.0, shifted=0.0), np.random.default_rng(0))
    narrow, fair = same.figures(np.random.default_rng(1), 4.0, 400)
    for name in ("detected", "top", "probability", "covered"):
        assert getattr(fair, name) == pytest.approx(getattr(narrow, name), abs=0.04)  # 400 draws, and other sizes


def test_the_example_prints_both_bounds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (
        '[challenge]\nname = "tiny"\nseed = 5\ncases = 1\n[sizes]\neffects = ["stimulus_gain", "integral_ankle"]\n'
        'outsiders = ["lumbar_relaxation"]\n[protocol]\namplitudes = [5.0]\ncycles = 3\n'
    )
    example = run_with_file("fair_ceiling", tmp_path / "tiny.toml", text, monkeypatch, 2)
    said = capsys.readouterr().out
    assert said.count("+-") == 2 * len(example.ROWS)
