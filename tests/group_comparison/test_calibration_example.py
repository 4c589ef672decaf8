"""The calibration of named causes, and the naming from known laws, on few cases."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from examples import module

from mcstudy.group_comparison.changes import NOTHING
from mcstudy.stance.body import two_segment
from mcstudy.stance.stability import growth_rate


@pytest.fixture(autouse=True)
def beside_its_neighbour(monkeypatch: pytest.MonkeyPatch) -> None:
    """The example takes its people from the one beside it, as when it is run by its path."""
    monkeypatch.setitem(sys.modules, "group_differences", module("group_differences"))


@pytest.mark.parametrize("common", [False, True])
def test_groups_of_the_calibration_differ_in_the_named_parameters_and_stand(common: bool) -> None:
    script, model = module("group_calibration"), two_segment(stimulus="surface_tilt")
    before, after = script.drawn(np.random.default_rng(2), ("K11", "B11"), common)
    changed = [name for name in model.names if before[name] != after[name]]
    assert changed == ["K11", "B11"]
    if common:
        assert after["K11"] / before["K11"] == pytest.approx(after["B11"] / before["B11"])
    theta = np.array([[own[name] for name in model.names] for own in (before, after)]) * model.truth
    assert (growth_rate(model, theta) < 0).all()


def test_a_case_of_the_calibration_has_probabilities_of_all_causes() -> None:
    truth, probability = module("group_calibration").answer(9, (0.1, 0.8), False)
    assert truth == NOTHING
    assert sum(probability.values()) == pytest.approx(1)
    assert max(probability, key=lambda cause: probability[cause]) == NOTHING


def test_known_laws_name_conditions_that_are_far_apart() -> None:
    script, rng = module("relabel_people"), np.random.default_rng(0)
    x = 5 * np.arange(4)[:, None] * np.ones(6) + rng.normal(size=(20, 4, 6))
    pairs = {"same": [(k, k) for k in range(4)], "amplitude": [(0, 1), (2, 3)], "vision": [(0, 2), (1, 3)]}
    people = script.People(x, np.arange(6.0), pairs)
    found = script.laws(people, people, False, 60, 8, 1)
    assert found.total() == 60
    assert all(truth == named for truth, named in found)
