"""The ideal method on drawn forms: certain where mechanisms are far apart, a guess where they are the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcstudy_challenge.challenge_file import resolve
from mcstudy_challenge.design import Mix

from pipelines.validation.form_bound import Imagined, imagine, reached
from tests.helpers.examples import run_with_file


def drawn(angle_deg: float, delta: float) -> Imagined:
    """Two mechanisms with one form each, ten draws per form in one direction; ``angle_deg`` between them."""
    a = np.deg2rad(angle_deg)
    rows = [[delta, 0.0, 0.0]] * 10 + [[delta * np.cos(a), delta * np.sin(a), 0.0]] * 10
    names = ("one",) * 10 + ("two",) * 10
    return Imagined(names, names, np.array(rows), {n: frozenset((n,)) for n in ("one", "two")})


def test_far_apart_the_ideal_method_is_right_with_and_without_the_true_form() -> None:
    for own in (False, True):
        found = reached(drawn(90.0, 12.0), np.random.default_rng(0), own)
        assert found.top.mean() > 0.99
        assert found.probability.mean() > 0.99
        assert found.covered.mean() > 0.99


def test_the_same_direction_leaves_a_guess() -> None:
    found = reached(drawn(0.0, 12.0), np.random.default_rng(0), True)
    assert found.probability.mean() == pytest.approx(0.5, abs=1e-6)


def test_in_between_it_is_right_as_often_as_two_points_of_this_distance_allow() -> None:
    # the likelihood ratio of two known points at distance d is right with probability Phi(d / 2); here d = 2
    delta = 10.0
    angle = float(np.rad2deg(2 * np.arcsin(1.0 / delta)))
    found = reached(drawn(angle, delta), np.random.default_rng(0), True)
    assert found.top.mean() == pytest.approx(0.841, abs=0.08)


def test_draws_are_those_of_the_challenge() -> None:
    raw = {
        "challenge": {"name": "tiny", "seed": 5, "cases": 1},
        "mix": {**dict.fromkeys(Mix.model_fields, 0.0), "misshapen": 1.0},
        "sizes": {
            "effects": ["acceleration_feedback"],
            "forms": ["acceleration_smoothed", "dead_angle_only"],
            "strata": [{"share": 1.0, "low": 6.0, "high": 9.0}],
        },
    }
    found = imagine(resolve(raw).series["main"], np.random.default_rng(0), 2)
    assert set(found.form) == {"acceleration_smoothed"}  # the other one is a rule and has no direction
    assert ((found.delta > 5.4) & (found.delta < 9.9)).all()
    assert found.share.sum() == pytest.approx(1.0)
    assert "acceleration_feedback" in found.right["acceleration_feedback"]


def test_the_example_prints_both_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    zero = "".join(f"{name} = 0.0\n" for name in Mix.model_fields if name != "misshapen")
    text = (
        f'[challenge]\nname = "tiny"\nseed = 5\ncases = 1\n[mix]\n{zero}misshapen = 1.0\n[sizes]\n'
        'effects = ["acceleration_feedback", "integral_ankle"]\n'
        'forms = ["acceleration_smoothed", "integral_of_both_joints"]\n'
        "strata = [{share = 1.0, low = 6.0, high = 9.0}]\n"
    )
    run_with_file("misshapen_ceiling", tmp_path / "tiny.toml", text, monkeypatch, 2)
    said = capsys.readouterr().out
    assert "forms of 2 mechanisms" in said
    assert said.count("right mechanism first at delta >= 6: ") == 2
