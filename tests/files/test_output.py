"""A file that was asked for is whole, or the old one is kept, and one line says why."""

from __future__ import annotations

import errno
import os
import resource
from pathlib import Path
from typing import IO

import pytest

from mcstudy.cli.figure_file import write_figure
from mcstudy.errors import StoreError
from mcstudy.files.json_files import write_text
from mcstudy.files.output import write_file
from mcstudy.report.document import write_page


class Picture:
    """A large figure."""

    def savefig(self, file: IO[bytes], **_: object) -> None:
        file.write(b"new" * 100_000)


WRITERS = {
    "file": lambda path: write_file(path, lambda: b"new" * 100_000),
    "text": lambda path: write_text(path, "new" * 100_000),
    "page": lambda path: write_page(path, lambda: "new" * 100_000),
    "figure": lambda path: write_figure(Picture(), path),
}


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS])
@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize(("owner", "name"), [(os, "fsync"), (Path, "replace"), (Path, "open")])
def test_a_disk_that_fails_is_one_line_and_keeps_the_old_file(
    writer: str, number: int, owner: object, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "a.svg"
    file.write_text("old")

    def fail(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number), "hidden.partial")

    monkeypatch.setattr(owner, name, fail)
    with pytest.raises(StoreError) as error:
        WRITERS[writer](file)
    monkeypatch.undo()
    assert str(error.value) == f"{file}: cannot be written: {os.strerror(number)}"
    assert file.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.svg"]


@pytest.mark.parametrize("writer", WRITERS)
def test_a_file_that_has_no_room_for_its_end_is_not_begun(writer: str, tmp_path: Path) -> None:
    """The system takes the first part, refuses the next, and refuses again what is still buffered on closing."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (250_000, limits[1]))
    try:
        with pytest.raises(StoreError, match="cannot be written: File too large"):
            WRITERS[writer](tmp_path / "a.svg")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []


def test_an_error_of_the_content_is_its_own(tmp_path: Path) -> None:
    def content() -> bytes:
        raise OSError(errno.EIO, "of something else")

    with pytest.raises(OSError, match="of something else"):
        write_file(tmp_path / "a", content)
    assert list(tmp_path.iterdir()) == []


def test_a_link_stays_one_and_missing_folders_are_made(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write_file(tmp_path / "link", lambda: b"x")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_bytes() == b"x"
    write_file(tmp_path / "new" / "folder" / "a", lambda: b"x")
    assert (tmp_path / "new" / "folder" / "a").read_bytes() == b"x"


@pytest.mark.parametrize("name", ["loop", "folder", "file/below", "x" * 300, "null\0"])
def test_a_place_where_no_file_can_be_is_one_line(name: str, tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match="cannot be written") as error:
        write_file(tmp_path / name, lambda: b"x")
    assert "\n" not in str(error.value)


def test_a_pipe_is_written_to_and_stays_one(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_file(tmp_path / "pipe", lambda: b"x")
        assert os.read(reader, 10) == b"x"
    finally:
        os.close(reader)
    assert (tmp_path / "pipe").is_fifo()
    assert [p.name for p in tmp_path.iterdir()] == ["pipe"]
