"""A growing cube is read once, chunk by chunk, and its headline is what the analysis says of what is complete."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from mcstudy import open_results
from mcstudy.analysis import accuracy, selection
from mcstudy.study.cube.store import Cube
from mcstudy.study.watch import RunningErrors, Watch


@pytest.fixture
def cube(tiny_copy: Path) -> Path:
    return tiny_copy


def test_the_headline_is_the_bias_of_the_analysis(cube: Path) -> None:
    watch = Watch(Cube.open(cube))
    watch.look()
    cells = selection.best(open_results(cube, lazy=False)["noisy"].to_dataset())
    expected = accuracy.mean_absolute_bias_percent(cells).sel(amplitude=5.0)
    lines = [line for line in watch.headlines() if line.startswith("noisy")]
    assert len(lines) == 2
    for line, f in zip(lines, (0.41, 1.2), strict=True):
        found = re.fullmatch(rf"noisy, 5 N m, {f} Hz: mean \|bias\| (\S+) ± (\S+) % \(MCSE; 5 realizations\)", line)
        assert found is not None, line
        assert float(found[1]) == pytest.approx(float(expected["value"].sel(fmax=f)), rel=0.01)
        # first order here; the analysis' jackknife also lets a small bias change its sign
        assert float(found[2]) == pytest.approx(float(expected["mcse"].sel(fmax=f)), rel=0.3)


def test_rows_added_in_parts_are_rows_added_at_once() -> None:
    x = np.random.default_rng(3).standard_normal((40, 3))
    once, parts = RunningErrors(), RunningErrors()
    once.add(x)
    for part in (x[:1], x[1:7], x[7:7], x[7:]):
        parts.add(part)
    np.testing.assert_allclose(parts.mean, x.mean(axis=0))
    np.testing.assert_allclose(parts.square, (40 - 1) * np.cov(x.T))
    np.testing.assert_allclose(parts.mean_absolute_bias(), once.mean_absolute_bias())


def test_only_complete_chunks_count_for_the_headline_and_each_is_read_once(
    cube: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = Cube.open(cube)
    store = opened.groups["noisy"]
    half, gone, *_ = store.layout.chunks
    data = store.existing(half)
    data["status"][..., -1] = 0
    store.write(half, data)
    hidden = store.chunk_file("status", gone).rename(cube.parent / "hidden")
    watch = Watch(opened)
    watch.look()
    assert watch.done == 128 - data["status"].shape[1] * data["status"].shape[2] - store.layout.fits(gone)
    assert watch.chunks_done == watch.chunks - 2
    hidden.rename(store.chunk_file("status", gone))
    reads: list[str] = []
    read = type(store).read
    monkeypatch.setattr(type(store), "read", lambda self, name, chunk: reads.append(name) or read(self, name, chunk))
    watch.look()
    assert reads == ["status", "cost", "estimate"]
    assert watch.chunks_done == watch.chunks - 1
    assert watch.failed == 0


def test_a_damaged_chunk_does_not_stop_the_watching(cube: Path) -> None:
    opened = Cube.open(cube)
    store = opened.groups["noisy"]
    file = store.chunk_file("estimate", store.layout.chunks[0])
    content = bytearray(file.read_bytes())
    content[10] ^= 1
    file.write_bytes(content)
    watch = Watch(opened)
    watch.look()
    assert watch.chunks_done == watch.chunks - 1


def test_a_look_without_time_reads_nothing(cube: Path) -> None:
    watch = Watch(Cube.open(cube))
    watch.look(-1.0)
    assert watch.done == 0
