"""Durable files: after a power cut, a file is either complete or absent.

Zarr's local store renames a finished file into place but never syncs it to disk. Here the content of a file is synced
before the rename, and folders are synced before anything is written that relies on their files.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import hashlib
import os
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from mcstudy.errors import StoreError
from mcstudy.files.unfinished import unfinished

PARTIAL = ".partial"
"""Suffix of a file that is being written; the next run removes such leftovers of a killed run."""


def write(path: Path, content: bytes | memoryview) -> None:
    """Write one file atomically and sync its content; never creates a folder (a deleted store must not reappear)."""
    with replacing(path) as file:
        file.write(content)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A new file that replaces ``path``, synced, when the block ends; it is removed when the block fails."""
    partial = partial_name(path)
    with unfinished(partial, lambda: partial.open("xb")) as file:
        try:
            yield file
            file.flush()
            sync(file.fileno())
        except BaseException:
            with contextlib.suppress(OSError):  # what is still buffered does not fit either
                file.close()
            raise
        file.close()
        partial.replace(path)


def partial_name(path: Path) -> Path:
    """A unique name next to ``path`` for a file that is being written."""
    return path.with_name(f"{path.name}.{uuid.uuid4().hex}{PARTIAL}")


def sync(handle: int) -> None:
    """Sync an open file or folder to disk."""
    if hasattr(fcntl, "F_FULLFSYNC"):  # macOS, where fsync leaves the content in the drive's own memory
        with contextlib.suppress(OSError):  # unsupported by the file system: use fsync
            fcntl.fcntl(handle, fcntl.F_FULLFSYNC)
            return
    os.fsync(handle)


def sync_folder(path: Path) -> None:
    """Make the names in a folder survive a power cut."""
    handle = os.open(path, os.O_RDONLY)
    try:
        sync(handle)
    finally:
        os.close(handle)


def make_folder(path: Path) -> None:
    """Make a folder and its parents, all of which survive a power cut."""
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    path.mkdir(parents=True, exist_ok=True)
    for folder in reversed(missing):
        sync_folder(folder.parent)


def sync_tree(root: Path) -> None:
    """Sync every file and folder below ``root``, and its entry in the parent folder."""
    for folder, _, files in os.walk(root):
        for name in files:
            with (Path(folder) / name).open("rb") as file:
                sync(file.fileno())
        sync_folder(Path(folder))
    sync_folder(root.parent)


def replace_tree(old: Path, new: Path) -> None:
    """Replace the folder ``old`` by ``new``; a stop at any moment leaves one of them complete.

    Where the system cannot exchange two names in one step, `recover` completes an exchange that a kill interrupted.
    """
    sync_tree(new)
    if _exchange(old, new):
        sync_folder(old.parent)
        shutil.rmtree(new, ignore_errors=True)
        return
    aside = _aside(old)
    shutil.rmtree(aside, ignore_errors=True)
    old.rename(aside)
    new.rename(old)
    sync_folder(old.parent)
    shutil.rmtree(aside, ignore_errors=True)


def recover(path: Path) -> None:
    """Restore the folder that a kill inside `replace_tree` left without its name; does nothing otherwise."""
    aside = _aside(path)
    if not aside.exists():
        return
    if path.exists():
        shutil.rmtree(aside, ignore_errors=True)
    else:
        aside.rename(path)
        sync_folder(path.parent)


def _aside(path: Path) -> Path:
    return path.with_name(f".{path.name}.replaced")


def _exchange(a: Path, b: Path) -> bool:
    """Exchange two names in one step (Linux ``renameat2``); returns whether the system supports it."""
    here, exchange = -100, 2
    try:
        renameat2 = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    return bool(renameat2(here, os.fsencode(a), here, os.fsencode(b), exchange) == 0)


def sweep(root: Path) -> int:
    """Remove unfinished files of a killed run below ``root``; returns how many."""
    leftovers = [path for path in root.rglob(f"*{PARTIAL}") if path.is_file()]
    for path in leftovers:
        path.unlink(missing_ok=True)
    return len(leftovers)


def tree_digest(root: Path) -> str:
    """SHA-256 over names and contents of all finished files below ``root``; equal for equal cubes."""
    digest = hashlib.sha256()
    for file in sorted(p for p in root.rglob("*") if _counts(p)):
        content = file.read_bytes()
        digest.update(f"{file.relative_to(root).as_posix()}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()


def _counts(path: Path) -> bool:
    return path.is_file() and not path.is_symlink() and path.suffix != PARTIAL


def log_folder(path: Path) -> Path:
    """Folder next to a cube for files that are not results: lock, run log."""
    return path.with_name(path.name + ".log")


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock a cube for writing; raises `StoreError` when another process has locked it.

    The kernel holds the lock, so it ends with the process, however the process ends.
    """
    folder = log_folder(path)
    try:
        make_folder(folder)
        handle = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise StoreError(f"{path}: expected a writable folder ({error.strerror})") from None
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise StoreError(f"{path}: another run is writing to this cube; wait until it has ended") from None
        yield
    finally:
        os.close(handle)
