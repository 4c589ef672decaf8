"""The smallest cube that has every kind of file, and two chunks of every result, for the tests that damage it."""

from __future__ import annotations

from pathlib import Path

import pytest
import quick_solver

from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.store import Cube
from mcstudy.study.execution import tasks
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study

TWO_CHUNKS = parse_study("""
[study]
name = "two_chunks"
seed = 12

[group.noisy]
realizations = 4
starts = 2
fmax = [0.41]
amplitude = [5.0]
""")
ONE = ClusterOptions(workers=1)


@pytest.fixture(scope="module")
def two_chunks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of that study; a copy of it is what is damaged."""
    out = tmp_path_factory.mktemp("two_chunks") / "out.zarr"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(*quick_solver.lm(fits_a_chunk=(4, 4)))
        tasks.open_group.cache_clear()
        run_study(TWO_CHUNKS, out, ONE)
    (group,) = Cube.open(out).groups.values()
    assert len(group.layout.chunks) == 2
    return out
