"""The manifest of an environment names the thread settings, and what differs between two of them is said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mcstudy.files.durable import tree_digest
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.repair import repair
from mcstudy.study.cube.store import Cube
from mcstudy.study.environment import THREADS, differences, environment
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study


@pytest.fixture
def settings(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """No thread setting is set."""
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
    return monkeypatch


def test_thread_settings_are_noted_as_they_are_set(settings: pytest.MonkeyPatch) -> None:
    assert environment()["threads"] == {}
    settings.setenv("NUMBA_NUM_THREADS", "2")
    settings.setenv("OMP_NUM_THREADS", "4,2")
    assert environment()["threads"] == {"NUMBA_NUM_THREADS": "2", "OMP_NUM_THREADS": "4,2"}


@pytest.mark.parametrize(
    ("before", "after", "lines"),
    [
        ({}, {}, []),
        ({"OMP_NUM_THREADS": "1"}, {"OMP_NUM_THREADS": "1"}, []),
        ({"OMP_NUM_THREADS": "1"}, {"OMP_NUM_THREADS": "2"}, ["threads.OMP_NUM_THREADS: 1 -> 2"]),
        ({"MKL_NUM_THREADS": "1"}, {}, ["threads.MKL_NUM_THREADS: 1 -> unset"]),
        ({}, {"OPENBLAS_NUM_THREADS": "3"}, ["threads.OPENBLAS_NUM_THREADS: unset -> 3"]),
        (None, {"NUMBA_NUM_THREADS": "3"}, ["not stored: threads"]),
        (None, {}, ["not stored: threads"]),
    ],
)
def test_thread_settings_that_differ_are_named(
    before: dict[str, str] | None, after: dict[str, str], lines: list[str]
) -> None:
    here = environment()
    old: dict[str, Any] = {**here, "threads": before}
    if before is None:
        del old["threads"]
    assert differences(old, {**here, "threads": after}) == lines


def test_one_and_two_workers_note_the_same_whatever_is_set(
    tmp_path: Path, tiny: str, settings: pytest.MonkeyPatch
) -> None:
    settings.setenv("NUMBA_NUM_THREADS", "2")
    for workers in (1, 2):
        run_study(parse_study(tiny), tmp_path / f"{workers}.zarr", ClusterOptions(workers=workers))
    assert Cube.open(tmp_path / "1.zarr").attributes["environment"]["threads"] == {"NUMBA_NUM_THREADS": "2"}
    assert tree_digest(tmp_path / "1.zarr") == tree_digest(tmp_path / "2.zarr")


def test_a_cube_from_before_thread_settings_were_noted_opens_and_is_left_as_it_is(tmp_path: Path, tiny: str) -> None:
    made_in = environment()
    del made_in["threads"]
    study, out = parse_study(tiny), tmp_path / "old.zarr"
    Cube.create(out, study, made_in)
    before = tree_digest(out)
    assert "threads" not in Cube.open(out).attributes["environment"]
    assert repair(out, study)[1].written == []
    assert tree_digest(out) == before
