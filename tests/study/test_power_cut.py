"""After a power cut at any moment of a run or an extension, nothing that was reported done is missing.

A disk is modelled by what was synced: of a file the bytes it had when it was last synced, of a folder the names it had.
Whatever else a power cut leaves is a subset of what was not synced, of which three are tried: nothing; every name but
no content (a file nobody synced is empty); and the names of ``status`` alone, which says that the rest is there.
"""

from __future__ import annotations

import functools
import os
import shutil
import stat
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import quick_solver

from mcstudy.files import durable
from mcstudy.files.durable import log_folder, tree_digest
from mcstudy.scheduler.cluster import ClusterOptions
from mcstudy.study.cube.run_log import reported
from mcstudy.study.cube.store import Cube
from mcstudy.study.design import Study
from mcstudy.study.execution import tasks
from mcstudy.study.extend import Growth, extend
from mcstudy.study.run import run_study
from mcstudy.study.study_file import parse_study

TEXT = """
[study]
name = "cut"
seed = 5

[group.noisy]
realizations = {}
starts = 2
fmax = [0.41]
amplitude = [5.0]
"""
SMALL, LARGE = parse_study(TEXT.format(4)), parse_study(TEXT.format(7))
ONE = ClusterOptions(workers=1)
RESUMED = 10
"""Cuts, spread evenly over all different trees, that are resumed; every cut is compared with what was reported."""

Names = dict[str, int]
Tree = dict[str, bytes]
KEEP: dict[str, Callable[[str], bool]] = {
    "nothing": lambda _: False,
    "names": lambda _: True,
    "status": lambda folder: folder.endswith("/status"),
}
"""Folders whose names survive though they were not synced, by kind of cut."""


@dataclass
class Cut:
    """What a power cut may leave, by kind, and what had been reported by then."""

    trees: dict[str, Tree]
    done: set[tuple[str, int, int]]


@dataclass
class Disk:
    """Everything below ``root`` that was synced, by inode; each is held open, so that its number is not given again."""

    root: Path
    files: dict[int, bytes] = field(default_factory=dict)
    folders: dict[int, Names] = field(default_factory=dict)
    kinds: dict[int, bool] = field(default_factory=dict)
    held: list[int] = field(default_factory=list)
    cuts: list[Cut] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def hold(self, handle: int) -> None:
        """Take what an open file or folder is now as being on the disk."""
        status = os.fstat(handle)
        if status.st_ino not in self.kinds:
            self.held.append(os.dup(handle))
            self.kinds[status.st_ino] = stat.S_ISDIR(status.st_mode)
        if stat.S_ISDIR(status.st_mode):
            self.folders[status.st_ino] = self.names(handle)
        else:
            self.files[status.st_ino] = Path(f"/proc/self/fd/{handle}").read_bytes()

    def names(self, handle: int) -> Names:
        """The entries of a folder; each of them is held, or it could be another one later."""
        found: Names = {}
        for name in os.listdir(handle):
            try:
                inner = os.open(name, os.O_RDONLY | os.O_NOFOLLOW, dir_fd=handle)
            except FileNotFoundError:
                continue  # renamed by another thread meanwhile
            status = os.fstat(inner)
            if status.st_ino in self.kinds:
                os.close(inner)
            else:
                self.held.append(inner)
                self.kinds[status.st_ino] = stat.S_ISDIR(status.st_mode)
            found[name] = status.st_ino
        return found

    def tree(self, keep: Callable[[str], bool]) -> Tree:
        """Files and their contents after a cut now; a name that ends in ``/`` is a folder."""
        live = {os.stat(folder).st_ino: Path(folder) for folder, _, _ in os.walk(self.root)}
        out: Tree = {}

        def visit(inode: int, prefix: str) -> None:
            names = self.folders.get(inode, {})
            if inode in live and keep(prefix.rstrip("/")):
                handle = os.open(live[inode], os.O_RDONLY)
                names = self.names(handle)
                os.close(handle)
            for name, inner in names.items():
                if self.kinds[inner]:
                    out[f"{prefix}{name}/"] = b""
                    visit(inner, f"{prefix}{name}/")
                else:
                    out[prefix + name] = self.files.get(inner, b"")

        visit(os.stat(self.root).st_ino, "")
        return out

    def close(self) -> None:
        for handle in self.held:
            os.close(handle)


@contextmanager
def recorded(root: Path, out: Path, study: Study) -> Iterator[list[Cut]]:
    """Every cut that can happen below ``root`` while something runs: one before each sync, and one at the end."""
    disk, sync = Disk(root), os.fsync
    for folder, _, files in os.walk(root):
        for path in (Path(folder), *(Path(folder) / name for name in files)):
            handle = os.open(path, os.O_RDONLY)
            disk.hold(handle)
            os.close(handle)

    def cut() -> None:
        done = reported(out, study.fingerprint)  # before the trees: what is reported must be there already
        disk.cuts.append(Cut({kind: disk.tree(keep) for kind, keep in KEEP.items()}, done))

    def watched(handle: int) -> None:
        with disk.lock:
            cut()
            sync(handle)
            disk.hold(handle)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", watched)
        try:
            yield disk.cuts
            cut()
        finally:
            disk.close()


@pytest.fixture(autouse=True)
def tiny_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    tasks.open_group.cache_clear()
    monkeypatch.setitem(*quick_solver.lm(fits_a_chunk=(4, 4)))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Cubes of both studies that nothing ever happened to, by fingerprint."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(*quick_solver.lm(fits_a_chunk=(4, 4)))
        cubes = {study.fingerprint: folder / f"{study.fits}.zarr" for study in (SMALL, LARGE)}
        for study in (SMALL, LARGE):
            run_study(study, cubes[study.fingerprint], ONE)
    return cubes


def recorded_run(root: Path) -> list[Cut]:
    """A new cube in a folder that is new, too."""
    root.mkdir()
    out = root / "results" / "out.zarr"
    with recorded(root, out, SMALL) as cuts:
        run_study(SMALL, out, ONE)
    return cuts


def recorded_extension(root: Path, small: Path) -> list[Cut]:
    """A finished cube that grows."""
    out = root / "results" / "out.zarr"
    shutil.copytree(small, out)
    shutil.copytree(log_folder(small), log_folder(out))
    with recorded(root, out, LARGE) as cuts:
        extend(out, Growth(realizations=7), ONE)
    return cuts


def lost(cuts: list[Cut], whole: Path) -> list[str]:
    """Chunk files that had been reported and that a cut leaves missing or different."""
    (store,) = Cube.open(whole).groups.values()

    @functools.cache
    def files(amplitude: int, block: int) -> dict[str, bytes]:
        (chunk,) = (c for c in store.layout.chunks if (c.amplitude, c.block) == (amplitude, block))
        paths = [store.chunk_file(name, chunk) for name in store.layout.results]
        return {f"results/out.zarr/{path.relative_to(whole)}": path.read_bytes() for path in paths}

    return [
        f"cut {k}, {kind}: {file}"
        for k, cut in enumerate(cuts)
        for kind, tree in cut.trees.items()
        for _, amplitude, block in cut.done
        for file, content in files(amplitude, block).items()
        if tree.get(file) != content
    ]


def build(tree: Tree, root: Path) -> Path:
    """Write what a cut left; the cube's place in it."""
    root.mkdir(parents=True)
    for name, content in sorted(tree.items()):
        path = root / name
        if name.endswith("/"):
            path.mkdir(parents=True, exist_ok=True)
        else:
            path.write_bytes(content)
    return root / "results" / "out.zarr"


def some_trees(cuts: list[Cut]) -> list[Tree]:
    """Different trees, evenly spread over all of them."""
    trees = list({tuple(sorted(t.items())): t for cut in cuts for t in cut.trees.values()}.values())
    return [trees[k * (len(trees) - 1) // (RESUMED - 1)] for k in range(RESUMED)]


def test_a_run_cut_short_at_any_sync_resumes_to_the_same_bytes(tmp_path: Path, whole: dict[str, Path]) -> None:
    cuts = recorded_run(tmp_path / "disk")
    sound = whole[SMALL.fingerprint]
    assert len(cuts[-1].done) == 2
    assert not lost(cuts, sound)
    assert tree_digest(build(cuts[-1].trees["nothing"], tmp_path / "end")) == tree_digest(sound)
    for k, tree in enumerate(some_trees(cuts)):
        out = build(tree, tmp_path / str(k))
        run_study(SMALL, out, ONE)
        assert tree_digest(out) == tree_digest(sound)


def test_an_extension_cut_short_at_any_sync_keeps_the_old_cube_or_the_new(
    tmp_path: Path, whole: dict[str, Path]
) -> None:
    small, large = whole[SMALL.fingerprint], whole[LARGE.fingerprint]
    cuts = recorded_extension(tmp_path / "disk", small)
    assert cuts[-1].done
    assert not lost(cuts, large)
    for k, tree in enumerate(some_trees(cuts)):
        out = build(tree, tmp_path / str(k))
        durable.recover(out)
        (old,) = Cube.open(out).groups.values()
        kept = sum(old.layout.fits(chunk) - old.pending(chunk) for chunk in old.layout.chunks)
        assert kept >= SMALL.fits
        extend(out, Growth(realizations=7), ONE)
        assert tree_digest(out) == tree_digest(large)


def unsynced_write(path: Path, content: bytes | memoryview) -> None:
    """A file renamed into place without its content being synced."""
    partial = path.with_name(path.name + durable.PARTIAL)
    partial.write_bytes(content)
    partial.replace(path)


@pytest.mark.parametrize(
    ("place", "broken"),
    [
        ("mcstudy.files.durable.write", unsynced_write),
        ("mcstudy.study.cube.store.sync_folder", lambda _: None),
        ("mcstudy.study.cube.store.sync_tree", lambda _: None),
    ],
)
def test_a_sync_left_out_would_be_noticed(
    tmp_path: Path,
    whole: dict[str, Path],
    monkeypatch: pytest.MonkeyPatch,
    place: str,
    broken: Callable[..., None],
) -> None:
    monkeypatch.setattr(place, broken)
    assert lost(recorded_run(tmp_path / "disk"), whole[SMALL.fingerprint])
