"""The run log tells a chunk that was lost from one that has not been run, whatever stopped the runs that wrote it."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from mcstudy.errors import Interrupted
from mcstudy.files import durable
from mcstudy.files.durable import log_folder
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube import run_log
from mcstudy.study.cube.run_log import RunLog
from mcstudy.study.cube.store import Cube
from mcstudy.study.extend import Growth, extend
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

pytestmark = pytest.mark.usefixtures("small_chunks")
ONE = ClusterOptions(workers=1)


@pytest.fixture
def out(tiny_copy: Path) -> Path:
    return tiny_copy


def lose(out: Path, group: str, chunk: int = 0) -> str:
    """Remove every file of a chunk; returns the name of its status."""
    store = Cube.open(out).groups[group]
    place = store.layout.chunks[chunk]
    for file in (*(store.chunk_file(name, place) for name in store.layout.results), store.note_file(place)):
        file.unlink()
    return str(store.chunk_file("status", place))


def tear(out: Path, keep: Callable[[bytes], int]) -> None:
    """Cut the log."""
    content = run_log.file(out).read_bytes()
    run_log.file(out).write_bytes(content[: keep(content)])


def test_an_event_begins_on_a_line_of_its_own(tmp_path: Path) -> None:
    out = tmp_path / "out.zarr"
    log_folder(out).mkdir()
    run_log.file(out).write_bytes(b'{"time": "2026-01-01", "event": "bl')
    log = RunLog(out, "r", "f")
    log.add("begin")
    log.add("block", group="g", chunks=[[0, 0]], complete=True)
    assert [event["event"] for event in run_log.events(out)] == ["begin", "block"]
    assert run_log.unreadable(out) == 1
    assert run_log.reported(out, "f") == {("g", 0, 0)}


def test_what_an_older_program_wrote_behind_half_a_line_is_read(tmp_path: Path) -> None:
    out = tmp_path / "out.zarr"
    log_folder(out).mkdir()
    block = {"time": "t", "run": "r", "event": "block", "group": "g", "chunks": [[0, 1]], "complete": True}
    begin = {"time": "t", "run": "r", "event": "begin", "fingerprint": "f"}
    lines = f"{json.dumps(begin)[:25]}{json.dumps(begin)}\n{json.dumps(block)}\n"
    run_log.file(out).write_text(lines)
    assert run_log.reported(out, "f") == {("g", 0, 1)}
    assert run_log.reported(out, "another") == set()
    assert run_log.unreadable(out) == 1


@pytest.mark.parametrize("event", ["block", "present", "taken_back"])
@pytest.mark.parametrize("chunk", [[1e999, 0], ["noisy", 1e999, 0], [float("nan"), 0], ["noisy", {}, 0], [], 5, None])
def test_a_line_with_chunks_that_no_cube_has_reports_nothing(tmp_path: Path, event: str, chunk: object) -> None:
    out = tmp_path / "out.zarr"
    log = RunLog(out, "one", "f")
    run_log.file(out).parent.mkdir()
    log.add("block", complete=True, group="noisy", chunks=[[0, 1]])
    log.add(event, complete=True, group="noisy", chunks=[chunk])
    assert run_log.reported(out, "f") == {("noisy", 0, 1)}


def test_every_line_is_on_disk_when_it_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log_folder(tmp_path / "out.zarr").mkdir()
    synced: list[bytes] = []
    monkeypatch.setattr(durable, "sync", lambda handle: synced.append(os.pread(handle, 1000, 0)))
    monkeypatch.setattr(durable, "sync_folder", lambda folder: synced.append(folder.name.encode()))
    log = RunLog(tmp_path / "out.zarr", "r", "f")
    log.add("begin")
    log.add("end")
    assert [content.count(b"\n") for content in synced] == [1, 0, 2]  # the line, the name of the new file, the line
    assert synced[1] == b"out.zarr.log"


def test_a_chunk_reported_by_a_run_after_half_a_line_is_damage_when_it_is_lost(out: Path, tiny: str) -> None:
    tear(out, lambda _: 200)  # within the first line
    store = Cube.open(out).groups["ideal"]
    store.chunk_file("status", store.layout.chunks[0]).unlink()
    run_study(parse_study(tiny), out, ONE)
    for group in ("ideal", "noisy"):  # one that this run wrote, and one that it found
        status = lose(out, group)
        findings = verify(out, cells=0)
        assert any(line.startswith(f"{status}: missing, though a run has reported") for line in findings.damage)
    assert any("1 line cannot be read" in note for note in findings.notes)


def test_half_a_line_is_noted_and_is_no_damage(out: Path) -> None:
    assert verify(out, cells=0).notes == []
    tear(out, lambda content: len(content) - 20)
    findings = verify(out, cells=0)
    assert findings.damage == []
    assert findings.notes == [
        f"{run_log.file(out)}: 1 line cannot be read (a stop in the middle, or damage): a chunk that was reported "
        "there alone, and is lost, counts as not run yet"
    ]


def test_a_chunk_that_an_extension_took_over_is_damage_when_it_is_lost(out: Path) -> None:
    extend(out, Growth(amplitude=(7.0,), groups=("noisy",)), ONE)
    status = lose(out, "ideal")
    assert [line.partition(": ")[0] for line in verify(out, cells=0).damage] == [status]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
@pytest.mark.parametrize("event", ["begin", "block", "end"])
def test_a_log_that_cannot_be_written_stops_the_run_which_the_next_one_completes(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch, code: int, event: str
) -> None:
    append = durable.append_line

    def full(path: Path, content: bytes) -> None:
        if json.loads(content)["event"] == event:
            append(path, content[:30])
            raise OSError(code, os.strerror(code))
        append(path, content)

    study, out = parse_study(tiny), tmp_path / "out.zarr"
    with monkeypatch.context() as patch:
        patch.setattr(run_log, "append_line", full)
        with pytest.raises(Interrupted, match=rf"^[^\n]*{os.strerror(code)}[^\n]*resume$"):
            run_study(study, out, ONE)
    run_study(study, out, ONE)
    assert verify(out, cells=0).damage == []
    assert len(run_log.reported(out, study.fingerprint)) == sum(
        len(store.layout.chunks) for store in Cube.open(out).groups.values()
    )
