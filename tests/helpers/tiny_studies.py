"""A study small enough to run in a test."""

from __future__ import annotations

from pathlib import Path

import pytest
import quick_solver

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
    monkeypatch.setitem(*quick_solver.lm(fits_a_chunk=(24, 24)))
