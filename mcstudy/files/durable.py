"""Durable files: after a power cut, a file is either complete or absent.

Zarr's local store renames a finished file into place but never syncs it to disk. Here the content of a file is synced
before the rename, and folders are synced before anything is written that relies on their files.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import hashlib
import os
import shutil
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from mcstudy.errors import Interrupted, StoreError
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


def append_line(path: Path, content: bytes) -> None:
    """Append one line, synced; a stop that left half a line costs that line alone, because the next begins a new one.

    Raises `OSError` when the line is not on disk.
    """
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    try:
        size = os.fstat(handle).st_size
        torn = size > 0 and os.pread(handle, 1, size - 1) != b"\n"
        left = memoryview(b"\n" * torn + content + b"\n")
        while left:
            left = left[os.write(handle, left) :]
        sync(handle)
    finally:
        os.close(handle)
    if not size:
        sync_folder(path.parent)


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
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # a shared file system that syncs files only
            raise
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


def recoverable(path: Path) -> bool:
    """Whether a kill inside `replace_tree` left something for `recover` to do."""
    return _aside(path).exists()


def recover(path: Path) -> None:
    """Restore the folder that a kill inside `replace_tree` left without its name; does nothing otherwise."""
    aside = _aside(path)
    if not recoverable(path):
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


FULL = (errno.ENOSPC, errno.EDQUOT, errno.EIO)
"""Errors of a disk on which the same work can be done later."""


def unwritable(path: Path, expected: str, error: OSError) -> StoreError | Interrupted:
    """What a failed write is for who asked for it: one line, and resumable where the disk is full or failing."""
    line = f"{path}: expected {expected} ({error.strerror or error})"
    return Interrupted(f"{line}; run the same command again to resume") if error.errno in FULL else StoreError(line)


@contextlib.contextmanager
def resumable(path: Path) -> Iterator[None]:
    """Work on a cube that the same call resumes: whatever cannot be read or written ends it in one line."""
    try:
        yield
    except OSError as error:
        why = error.strerror or str(error)
        raise Interrupted(
            f"{path}: the results folder is not writable ({why}); run the same command again to resume"
        ) from None


def log_folder(path: Path) -> Path:
    """Folder next to a cube for files that are not results: lock, run log."""
    return path.with_name(path.name + ".log")


NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL)
"""Errors of a file system that cannot lock files, as some shared ones are mounted."""


@contextlib.contextmanager
def locked(path: Path) -> Iterator[list[str]]:
    """Lock a cube for writing; raises `StoreError` when another process has locked it.

    The kernel holds the lock, so it ends with the process, however the process ends. Where the file system has no
    locks there is none, of which the block is given a line to be shown.
    """
    folder = log_folder(path)
    try:
        make_folder(folder)
        handle = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise unwritable(path, "a writable folder", error) from None
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StoreError(f"{path}: another run is writing to this cube; wait until it has ended") from None
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise unwritable(folder / "lock", "a file that can be locked", error) from None
            yield [f"warning: {path}: this file system has no locks; start no other run that writes to this cube"]
        else:
            yield []
    finally:
        os.close(handle)
