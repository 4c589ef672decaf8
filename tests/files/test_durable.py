"""A file is on disk whole, or it is not there."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mcstudy.errors import StoreError
from mcstudy.files import durable


def test_a_failed_write_leaves_the_old_content_and_no_leftover(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "f"
    durable.write(file, b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        durable.write(file, b"new")
    assert [p.name for p in tmp_path.iterdir()] == ["f"]
    assert file.read_bytes() == b"old"


def test_a_file_is_synced_before_it_gets_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    real = os.fsync

    def watch(handle: int) -> None:
        seen.append((tmp_path / "f").exists())
        real(handle)

    monkeypatch.setattr(os, "fsync", watch)
    durable.write(tmp_path / "f", b"x")
    assert seen == [False]


def test_a_deleted_folder_does_not_come_back(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        durable.write(tmp_path / "gone" / "f", b"x")


def test_leftovers_of_a_killed_run_are_swept_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / f"c.0.123{durable.PARTIAL}").write_bytes(b"half")
    (tmp_path / "a" / "c.0").write_bytes(b"whole")
    assert durable.sweep(tmp_path) == 1
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["c.0"]


def test_the_digest_tells_names_contents_and_not_leftovers(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"1")
    before = durable.tree_digest(tmp_path)
    (tmp_path / f"x{durable.PARTIAL}").write_bytes(b"2")
    assert durable.tree_digest(tmp_path) == before
    (tmp_path / "a").rename(tmp_path / "b")
    renamed = durable.tree_digest(tmp_path)
    (tmp_path / "b").write_bytes(b"2")
    assert len({before, renamed, durable.tree_digest(tmp_path)}) == 3


def test_a_second_process_cannot_hold_the_lock_and_gets_it_once_the_first_is_gone(tmp_path: Path) -> None:
    store = tmp_path / "out.zarr"
    script = f"""
from pathlib import Path
from mcstudy.errors import StoreError
from mcstudy.files.durable import locked
try:
    with locked(Path({str(store)!r})):
        print("held")
except StoreError as error:
    print("refused", "\\n" in str(error))
"""

    def other() -> str:
        return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.strip()

    with durable.locked(store):
        assert other() == "refused False"
    assert other() == "held"


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(StoreError, match=r"expected a writable folder"),
        durable.locked(tmp_path / "file" / "out.zarr"),
    ):
        pass


def test_where_fsync_does_not_reach_the_disk_the_call_that_does_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on macOS; a file system that does not know it gets what there is."""
    asked: list[int] = []
    synced: list[int] = []

    def control(_: int, command: int) -> int:
        asked.append(command)
        if len(asked) > 2:
            raise OSError(errno.ENOTSUP, "not supported")
        return 0

    monkeypatch.setattr(fcntl, "F_FULLFSYNC", 51, raising=False)
    monkeypatch.setattr(fcntl, "fcntl", control)
    monkeypatch.setattr(os, "fsync", synced.append)
    durable.write(tmp_path / "f", b"x")
    durable.sync_folder(tmp_path)
    assert (asked, synced) == ([51, 51], [])
    durable.write(tmp_path / "f", b"y")
    assert len(asked) == 3
    assert len(synced) == 1
