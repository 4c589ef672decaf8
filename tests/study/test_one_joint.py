"""A cube of one joint holds one angle; those that version 0.1.0 made hold an empty second one and stay usable."""

from __future__ import annotations

import json
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

import mcstudy as mc
from mcstudy.cli import main
from mcstudy.study.cube.store import Cube
from mcstudy.study.verify import verify

MADE_BY_0_1_0 = Path(__file__).with_name("one_joint_0_1_0.zip")
FINGERPRINT = "24a9dce7fc4c8f388dacf9acdd365358494a1bccd7aab73f2b820b221080f3d2"


@pytest.fixture
def older(tmp_path: Path) -> Path:
    """Two realizations of a single pendulum at two amplitudes, with two starts each."""
    with ZipFile(MADE_BY_0_1_0) as packed:
        packed.extractall(tmp_path)
    return tmp_path / "one_joint.zarr"


def angles_on_disk(cube: Path) -> list[int]:
    """Length of the axis of angles in the files."""
    return [json.loads((cube / "one" / name / "zarr.json").read_text())["shape"][-1] for name in ("angle", "true_frf")]


def test_an_older_cube_opens_with_the_one_angle_that_there_is(older: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cube = mc.open_results(older)["one"].to_dataset().load()
    assert angles_on_disk(older) == [2, 2]
    assert cube["angle"].values.tolist() == ["theta1"]
    assert cube["noise_covariance"].sizes == {
        "amplitude": 2, "realization": 2, "frequency": 28, "angle": 1, "angle_2": 1,
    }  # fmt: skip
    assert main(["show", str(older)]) == 0
    assert "Kpas" in capsys.readouterr().out


def test_an_older_cube_is_verified(older: Path) -> None:
    found = verify(older, cells=10)
    assert (found.damage, found.beyond, found.pending, found.recomputed) == ([], [], 0, 4)
    (older / "one" / "angle" / "c.0").unlink()
    assert set(verify(older, cells=0).damage) == {f"{older / 'one' / 'angle' / 'c.0'}: missing"}


def test_an_older_cube_is_repaired_and_resumed_in_its_own_form(older: Path) -> None:
    cube = Cube.open(older)
    assert cube.study.fingerprint == FINGERPRINT
    whole = mc.open_results(older, lazy=False)["one"].to_dataset()
    store = cube.groups["one"]
    store.forget(store.layout.chunks[1])
    (older / "one" / "angle" / "zarr.json").unlink()
    resumed = mc.run(cube.study, older)["one"].to_dataset()
    assert angles_on_disk(older) == [2, 2]
    for name in ("frf", "estimate", "cost"):
        np.testing.assert_allclose(resumed[name].values, whole[name].values, rtol=1e-9, err_msg=name)
    found = verify(older, cells=10)
    assert (found.damage, found.beyond, found.pending) == ([], [], 0)


def test_an_older_cube_that_is_extended_has_the_form_of_new_ones(older: Path) -> None:
    first = mc.open_results(older, lazy=False)["one"].to_dataset()
    grown = mc.extend(older, realizations=3)["one"].to_dataset().load()
    assert angles_on_disk(older) == [1, 1]
    assert grown.sizes["realization"] == 3
    for name in ("frf", "estimate", "noise_covariance"):
        np.testing.assert_array_equal(grown[name].isel(realization=slice(2)).values, first[name].values, err_msg=name)
    assert verify(older, cells=10).damage == []


def test_a_new_cube_of_the_same_study_holds_one_angle_and_the_same_fits(older: Path, tmp_path: Path) -> None:
    study, first = Cube.open(older).study, mc.open_results(older, lazy=False)["one"].to_dataset()
    new = mc.run(study, tmp_path / "new.zarr")["one"].to_dataset().load()
    assert angles_on_disk(tmp_path / "new.zarr") == [1, 1]
    assert study.fingerprint == FINGERPRINT
    for name in ("true_frf", "frf", "estimate", "cost"):
        np.testing.assert_allclose(new[name].values, first[name].values, rtol=1e-9, err_msg=name)
