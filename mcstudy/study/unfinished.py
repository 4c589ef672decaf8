"""Files and folders that are being made: taken away when their making fails, or when the process ends in the middle.

Imports nothing that is slow: the command line has it before anything else (`mcstudy.cli.stop`).
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
"""How long an ending process waits for a file that is just being made."""

TRIES = 5
"""Times a folder is removed into which other threads may still write."""

_changing = threading.Lock()
_unfinished: set[Path] = set()


@contextlib.contextmanager
def unfinished(path: Path, make: Callable[[], Made]) -> Iterator[Made]:
    """What ``make`` makes at ``path`` (a file, a folder); the block gives it its final name, or it is removed."""
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
def scratch_folder(prefix: str) -> Iterator[Path]:
    """A folder that is there for the block."""
    import tempfile  # takes its time

    with _changing:
        path = Path(tempfile.mkdtemp(prefix=prefix))
        _unfinished.add(path)
    try:
        yield path
    finally:
        _remove(path)
        with _changing:
            _unfinished.discard(path)


def remove_unfinished() -> None:
    """Take away what is being made, and let nobody begin or end anything: the process is about to end."""
    _changing.acquire(timeout=LOCK_S)
    for path in list(_unfinished):
        _remove(path)


def _remove(path: Path) -> None:
    if not path.is_dir() or path.is_symlink():
        with contextlib.suppress(OSError):
            path.unlink()
        return
    import shutil  # whoever made a folder in Python has it already

    for _ in range(TRIES):
        shutil.rmtree(path, ignore_errors=True)
        if not os.path.lexists(path):
            return
