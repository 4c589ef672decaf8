"""The file of a chunk holds the very bytes that Zarr itself would write."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import zarr

from mcstudy.study.cube.store import Cube
from mcstudy.study.study_file import parse_study


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("group", ["noisy", "ideal"])
@pytest.mark.parametrize("block", [0, -1])
def test_a_chunk_is_written_as_zarr_writes_it(tmp_path: Path, tiny: str, group: str, block: int) -> None:
    store = Cube.create(tmp_path / "out.zarr", parse_study(tiny)).groups[group]
    chunk = store.layout.chunks[block]
    rng = np.random.default_rng(0)
    for name in store.layout.results:
        values = store.layout.empty(chunk)[name]
        values.reshape(-1)[::2] = rng.integers(0, 100, values.size)[::2]
        store.put(name, chunk, values)
        ours = store.chunk_file(name, chunk).read_bytes()
        array = zarr.open_array(tmp_path / "out.zarr" / group / name, mode="r+", zarr_format=3)
        held, dims = store.layout.realizations(chunk), store.layout.arrays[name].dims
        at = {"amplitude": slice(chunk.amplitude, chunk.amplitude + 1), "realization": slice(held.start, held.stop)}
        array.with_config({"write_empty_chunks": True})[tuple(at.get(dim, slice(None)) for dim in dims)] = values
        assert store.chunk_file(name, chunk).read_bytes() == ours


@pytest.mark.usefixtures("small_chunks")
def test_the_last_chunk_of_the_test_above_is_not_full(tmp_path: Path, tiny: str) -> None:
    layout = Cube.create(tmp_path / "out.zarr", parse_study(tiny)).groups["noisy"].layout
    assert len(layout.realizations(layout.chunks[-1])) < layout.realizations_a_chunk
