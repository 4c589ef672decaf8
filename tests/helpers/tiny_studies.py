"""A study small enough to run in a test."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import quick_solver

from mcstudy.files.durable import log_folder

TINY = """
[study]
name = "tiny"
seed = 7

[group.noisy]
realizations = 5
starts = 6
fmax = [0.41, 1.2]
amplitude = [3.0, 5.0]

[group.ideal]
simulator = "none"
realizations = 2
starts = 4
fmax = [8.0]
amplitude = [5.0]
"""

EIGHT_FITS = """
[study]
name = "tiny"
seed = 7

[group.noisy]
realizations = 2
starts = 4
fmax = [1.2]
amplitude = [5.0]
"""


SMALL = quick_solver.lm(fits_a_chunk=(24, 24))
"""What makes chunks of about 24 fits."""


@pytest.fixture(scope="session")
def tiny() -> str:
    """Text of a study file with 128 fits."""
    return TINY


@pytest.fixture
def tiny_file(tmp_path: Path) -> Path:
    """That study as a file."""
    file = tmp_path / "tiny.toml"
    file.write_text(TINY)
    return file


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chunks of about 24 fits, so that a tiny study has many."""
    monkeypatch.setitem(*SMALL)


@pytest.fixture(scope="session")
def tiny_cube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That study, run in small chunks by one worker; a copy of it is what is changed."""
    from mcstudy.scheduler.cluster import ClusterOptions
    from mcstudy.study.run import run_study
    from mcstudy.study.study_file import parse_study

    out = tmp_path_factory.mktemp("tiny") / "out.zarr"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(*SMALL)
        run_study(parse_study(TINY), out, ClusterOptions(workers=1))
    return out


def copied(cube: Path, folder: Path) -> Path:
    """A cube with its log, copied into a folder."""
    shutil.copytree(log_folder(cube), log_folder(folder / cube.name))
    return shutil.copytree(cube, folder / cube.name)


@pytest.fixture
def tiny_copy(tmp_path: Path, tiny_cube: Path) -> Path:
    """A copy of that cube and its log."""
    return copied(tiny_cube, tmp_path)
