"""Unfinished files and folders: removed when writing them fails or when the process ends before they are complete.

Imports no slow module, because the command line imports it before anything else (`mcstudy.cli.stop`).
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

Made = TypeVar("Made")

LOCK_S = 0.2
"""Seconds that an ending process waits for a file that is just being created."""

TRIES = 5
"""Number of attempts to remove a folder into which another thread was just writing."""

_changing = threading.Lock()
_unfinished: set[Path] = set()


@contextlib.contextmanager
def unfinished(path: Path, make: Callable[[], Made]) -> Iterator[Made]:
    """Create a file or folder at ``path`` with ``make``; it is removed unless the block gives it its final name."""
    with _changing:
        _unfinished.add(path)
        try:
            made = make()
        except BaseException:
            _unfinished.discard(path)
            raise
    try:
        yield made
    except BaseException:
        _remove(path)
        raise
    finally:
        with _changing:
            _unfinished.discard(path)


@contextlib.contextmanager
def scratch_folder(prefix: str, within: Path | None = None) -> Iterator[Path]:
    """A temporary folder that exists during the block, readable by this user only; ``within``: where it lies."""
    import tempfile  # slow to import

    with _changing:
        path = Path(tempfile.mkdtemp(prefix=prefix, dir=within))
        _unfinished.add(path)
    try:
        yield path
    finally:
        _remove(path)
        with _changing:
            _unfinished.discard(path)


def remove_unfinished() -> None:
    """Remove everything unfinished, and block further creation: the process is about to end."""
    _changing.acquire(timeout=LOCK_S)
    for path in list(_unfinished):
        _remove(path)


def _remove(path: Path) -> None:
    if not path.is_dir() or path.is_symlink():
        with contextlib.suppress(OSError):
            path.unlink()
        return
    import shutil  # already imported if any folder was created

    # Under another name, other threads that write into the folder by its path no longer find it; a library may make it
    # anew.
    aside = path.with_name(path.name + ".removed")
    for _ in range(TRIES):
        try:
            path.rename(aside)
        except OSError:
            shutil.rmtree(path, ignore_errors=True)
        shutil.rmtree(aside, ignore_errors=True)
        if not os.path.lexists(aside) and not os.path.lexists(path):
            return
