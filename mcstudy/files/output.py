"""Files that a user asked for: begun before their content is computed, written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Callable, Iterator
from pathlib import Path

from mcstudy.errors import StoreError
from mcstudy.files.durable import replacing


def write_file(path: str | Path, content: Callable[[], bytes]) -> Path:
    """Write what ``content`` makes; nobody should wait for a file that cannot be kept.

    Folders that are missing are made. A link stays one; what is no file, such as ``/dev/stdout``, is written to.
    Raises `StoreError`, one line, where the file cannot be written; an existing one then is as it was.
    """
    path = Path(path)
    with contextlib.ExitStack() as stack:
        with _told(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            there = _mode(path)
            if there is None or stat.S_ISREG(there):
                place = Path(os.path.realpath(path))
                if there is not None:
                    place.open("ab").close()  # a file that is write-protected is not replaced
                file = stack.enter_context(replacing(place))
            else:
                file = stack.enter_context(path.open("wb", buffering=0))
        made = memoryview(content())
        with _told(path):
            while made:
                made = made[file.write(made) :]
            stack.close()
    return path


def _mode(path: Path) -> int | None:
    """Type of what has this name, None for nothing."""
    try:
        return path.stat().st_mode
    except FileNotFoundError:
        return None


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror or error}") from None
    except ValueError as error:  # a null character in the name
        raise StoreError(f"{str(path)!r}: cannot be written: {error}") from None
