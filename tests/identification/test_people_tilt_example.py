"""The example on people who stand on a tilting platform; the people are no part of the project."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from examples import module as example
from many_people import COMTEST, ROOT, needs_comtest

from mcstudy.recordings.frf_group import group_dataset
from mcstudy.stance.body import Body
from pipelines.validation import condition_changes


def four_conditions() -> xr.Dataset:
    frf = np.random.default_rng(0).standard_normal((5, 4, 2, 3)) * (1 + 0.5j)
    conditions = [("open", "1.0"), ("closed", "0.5"), ("closed", "1.0"), ("open", "0.5")]
    people, factors = list("abcde"), ["eyes", "tilt_pp_deg"]
    lines = np.array([0.05, 0.15, 0.25])
    return group_dataset(frf, people, conditions, factors, lines, np.eye(3), "surface_tilt", Body())


def test_pairs_of_conditions_are_found_by_their_factors_in_any_order() -> None:
    assert example("people_tilt").pairs(four_conditions()) == {
        "amplitude, eyes closed": (1, 2),
        "amplitude, eyes open": (3, 0),
        "vision, 0.5 deg": (1, 3),
        "vision, 1.0 deg": (2, 0),
    }


def test_the_hip_reading_adds_the_lower_body_and_leaves_the_group_as_it_is() -> None:
    group = four_conditions()
    before = group["frf"].values.copy()
    read = example("people_tilt").hip_reading(group)["frf"].values
    np.testing.assert_array_equal(read[:, :, 1], before[:, :, 0] + before[:, :, 1])
    np.testing.assert_array_equal(group["frf"].values, before)


def test_an_interval_of_people_holds_their_mean() -> None:
    mean, low, high = example("people_tilt").interval(np.array([1.0, 2.0, 3.0, 6.0])).replace(",", "").replace(
        "[", ""
    ).replace("]", "").split()  # fmt: skip
    assert float(low) < float(mean) == 3.0 < float(high)


@needs_comtest
def test_the_example_draws_the_means_of_the_people(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(condition_changes, "STARTS", 8)
    monkeypatch.setattr(condition_changes, "LINEARISED", 1)
    description = str(ROOT / "pipelines" / "recordings" / "comtest.toml")
    example("people_tilt").main([description, "--data", str(COMTEST), "--only", "figure", "-o", str(tmp_path)])
    assert "49 people, 4 conditions" in capsys.readouterr().out
    assert (tmp_path / "people_tilt.svg").read_text(encoding="utf-8").count("<path") > 100
