"""File systems that are full, shared or unusual: a run ends in one line and resumes, or says what is missing."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from mcstudy.cli import main
from mcstudy.errors import Interrupted, StoreError
from mcstudy.exits import Exit
from mcstudy.files import durable
from mcstudy.files.durable import tree_digest
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.store import Cube, GroupStore
from mcstudy.study.extend import Growth, extend
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study
from mcstudy.study.verify import verify

pytestmark = pytest.mark.usefixtures("small_chunks")
ONE = ClusterOptions(workers=1)
TWO_CASES = """
[study]
name = "cases"
seed = 1

[group.noisy]
realizations = 1
starts = 2
fmax = [1.2]
amplitude = [5.0]

[group.NOISY]
realizations = 1
starts = 2
fmax = [1.2]
amplitude = [5.0]
"""


@pytest.fixture(scope="module")
def whole(tiny_cube: Path) -> str:
    """Digest of an undisturbed run."""
    return tree_digest(tiny_cube)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own."""
    if (
        os.geteuid()
        or subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "nr_inodes=100000", "tmpfs", str(tmp_path)], check=False
        ).returncode
    ):
        pytest.skip("needs the right to mount")
    yield tmp_path
    subprocess.run(["umount", str(tmp_path)], check=True)


def limit(disk: Path, **limits: int) -> None:
    words = ",".join(["remount", *(f"{name}={value}" for name, value in limits.items())])
    subprocess.run(["mount", "-o", words, str(disk)], check=True)


@pytest.mark.parametrize("begun", [False, True])
@pytest.mark.parametrize("limits", [{"nr_inodes": 12}, {"size": 40 << 10}])
def test_a_disk_without_room_or_inodes_ends_a_run_in_one_line_which_resumes_once_there_are(
    disk: Path, whole: str, limits: dict[str, int], begun: bool, capsys: pytest.CaptureFixture[str], tiny: str
) -> None:
    file = disk / "tiny.toml"
    file.write_text(tiny)
    words = ["run", str(file), "-o", str(disk / "deep" / "out.zarr"), "--workers", "1"]
    if begun:
        Cube.create(disk / "deep" / "out.zarr", parse_study(tiny))
    held = os.statvfs(disk)
    used = {"nr_inodes": held.f_files - held.f_ffree, "size": (held.f_blocks - held.f_bfree) * held.f_frsize}
    limit(disk, **{name: used[name] + more for name, more in limits.items()})
    assert main(words) == Exit.INTERRUPTED
    *_, last = capsys.readouterr().err.splitlines()
    assert last.startswith("mcstudy: ")
    assert "No space left on device" in last
    assert last.endswith(f"run the same command again to resume: mcstudy {' '.join(words)}")
    limit(disk, nr_inodes=100_000, size=1 << 26)
    assert main(words) == Exit.DONE
    assert tree_digest(disk / "deep" / "out.zarr") == whole


@pytest.mark.parametrize("code", [errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS])
def test_a_file_system_without_locks_is_warned_of(
    tmp_path: Path,
    tiny: str,
    whole: str,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def none(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(fcntl, "flock", none)
    out = tmp_path / "out.zarr"
    run_study(parse_study(tiny), out, ONE)
    assert f"warning: {out}: this file system has no locks" in capsys.readouterr().err
    assert tree_digest(out) == whole
    extend(out, Growth(realizations=6), ONE)
    assert "this file system has no locks" in capsys.readouterr().err


def test_a_lock_that_fails_otherwise_is_no_other_run(
    tmp_path: Path, tiny: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(fcntl, "flock", broken)
    with pytest.raises(Interrupted, match="Input/output error"):
        run_study(parse_study(tiny), tmp_path / "out.zarr", ONE)


def test_a_file_system_that_cannot_sync_folders_holds_a_cube(
    tmp_path: Path, tiny: str, whole: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sync = os.fsync

    def files_only(handle: int) -> None:
        if os.path.isdir(f"/proc/self/fd/{handle}"):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        sync(handle)

    monkeypatch.setattr(durable, "sync", files_only)
    run_study(parse_study(tiny), tmp_path / "out.zarr", ONE)
    assert tree_digest(tmp_path / "out.zarr") == whole


def test_groups_that_a_file_system_takes_for_one_are_refused_there_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = parse_study(TWO_CASES)
    run_study(study, tmp_path / "apart.zarr", ONE)
    assert verify(tmp_path / "apart.zarr").damage == []
    exists = Path.exists

    def folded(self: Path) -> bool:
        return exists(self) or (exists(self.parent) and self.name.lower() in map(str.lower, os.listdir(self.parent)))

    before = sorted(os.listdir(tmp_path))
    monkeypatch.setattr(Path, "exists", folded)
    with pytest.raises(
        StoreError, match=r"group\.NOISY: expected names that this file system can tell apart, got noisy"
    ):
        Cube.create(tmp_path / "one.zarr", study)
    assert sorted(os.listdir(tmp_path)) == before


@pytest.mark.parametrize("code", [errno.EIO, errno.EDQUOT, errno.EROFS])
@pytest.mark.parametrize("place", ["recover", "sweep", "repair", "note", "extension"])
def test_a_write_that_fails_anywhere_in_a_run_is_resumable(
    tiny_copy: Path, tiny: str, monkeypatch: pytest.MonkeyPatch, code: int, place: str
) -> None:
    study, out = parse_study(tiny), tiny_copy
    store = Cube.open(out).groups["noisy"]
    chunk = store.layout.chunks[0]
    before = tree_digest(out)

    def fails(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    with monkeypatch.context() as patch:
        if place == "note":
            store.note_file(chunk).unlink()
            patch.setattr(GroupStore, "annotate", fails)
        elif place == "repair":
            (out / "zarr.json").write_bytes((out / "zarr.json").read_bytes() + b" ")
            patch.setattr("mcstudy.study.cube.repair.write", fails)
        else:
            patch.setattr(f"mcstudy.study.extend.{'replace_tree' if place == 'extension' else place}", fails)
        work = partial(extend, out, Growth(realizations=6), ONE)
        if place in ("note", "repair"):
            work = partial(run_study, study, out, ONE)
        with pytest.raises((Interrupted, StoreError), match=rf"^[^\n]*{os.strerror(code)}[^\n]*$"):
            work()
    run_study(study, out, ONE)
    assert tree_digest(out) == before
