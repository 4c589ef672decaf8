"""Every kind of damage is found and named, and a sound cube is called sound."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from mcstudy.study import environment
from mcstudy.study.cube.store import Cube
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify


@pytest.fixture
def copy(tmp_path: Path, tiny_cube: Path) -> Path:
    """Without its log."""
    return shutil.copytree(tiny_cube, tmp_path / "out.zarr")


def test_a_sound_cube_is_sound_and_its_fits_come_out_the_same_again(tiny_cube: Path) -> None:
    verdict = verify(tiny_cube, cells=100)
    assert verdict.damage == []
    assert (verdict.chunks, verdict.pending) == (7, 0)
    assert verdict.recomputed == 6 * 2 * 4 + 4


def test_an_edited_attribute_is_named_with_what_it_should_be(copy: Path) -> None:
    file = copy / "noisy" / "truth" / "zarr.json"
    document = json.loads(file.read_text())
    document["attributes"]["provenance"] = "measured"
    file.write_text(json.dumps(document))
    (line,) = verify(copy, cells=0).damage
    assert str(file) in line
    assert "provenance" in line
    assert "found 'measured'" in line


@pytest.mark.parametrize("name", ["estimate", "cost", "frf", "growth_rate", "initial"])
def test_a_forged_number_with_a_right_checksum_is_found_by_recomputing(copy: Path, name: str) -> None:
    store = Cube.open(copy).groups["ideal"]
    (chunk,) = store.layout.chunks
    data = store.existing(chunk)
    data[name] = np.where(True, data[name] * (1 - 2**-50), 0)
    store.write(chunk, data)
    (line,) = [line for line in verify(copy, cells=100).damage if "recomputed" in line]
    assert str(store.path) in line
    assert name in line


@pytest.mark.parametrize("far", [1e9, -1e9])
def test_an_impossible_number_with_a_right_checksum_is_found_without_recomputing(copy: Path, far: float) -> None:
    store = Cube.open(copy).groups["noisy"]
    chunk = store.layout.chunks[0]
    data = store.existing(chunk)
    data["estimate"][..., 0] = far
    data["cost"][:] = -1.0
    store.write(chunk, data)
    damage = "\n".join(verify(copy, cells=0).damage)
    assert "an estimate outside the bounds" in damage
    assert "a negative or missing cost" in damage


def test_a_cube_from_another_environment_is_noted_and_not_damaged(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = environment.environment()
    other = {**here, "versions": {**here["versions"], "zarr": "9.9"}}
    monkeypatch.setattr(environment, "environment", lambda: other)
    verdict = verify(copy, cells=0)
    assert verdict.damage == []
    was = here["versions"]["zarr"]
    assert verdict.notes == [f"made in another environment: versions.zarr: {was} -> 9.9"]


def test_what_was_not_run_is_pending_and_not_damaged(tmp_path: Path, tiny: str) -> None:
    Cube.create(tmp_path / "new.zarr", parse_study(tiny))
    verdict = verify(tmp_path / "new.zarr")
    assert (verdict.damage, verdict.pending, verdict.recomputed) == ([], 128, 0)


def test_a_chunk_that_was_reported_and_is_gone_is_damage_and_not_merely_not_run(tiny_copy: Path) -> None:
    store = Cube.open(tiny_copy).groups["ideal"]
    for name in store.layout.results:
        store.chunk_file(name, store.layout.chunks[0]).unlink()
    (line,) = verify(tiny_copy, cells=0).damage
    assert "ideal/status" in line
    assert "missing, though a run has reported the chunk as complete" in line
