"""Reading a cube that another process may replace by a larger one meanwhile (`mcstudy.study.extend`)."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from mcstudy.errors import InputError, StoreError

T = TypeVar("T")

Stamp = tuple[int, ...] | None

TRIES = 4
"""Number of times that something is read while it is replaced again and again."""


def stamp(cube: Path) -> Stamp:
    """What differs between a cube and the one that takes its place; None where there is none."""
    try:
        folder, root = os.stat(cube), os.stat(cube / "zarr.json")
    except OSError:
        return None
    return folder.st_dev, folder.st_ino, root.st_ino, root.st_mtime_ns, root.st_size


def settled(cubes: Sequence[str | Path], read: Callable[[], T]) -> T:
    """What ``read`` returns of cubes that are the same at its end as at its beginning; else it is called again.

    Halves of two cubes would look like damage. Raises `StoreError` when they are replaced every time.
    """
    paths = [Path(cube) for cube in cubes]
    for _ in range(TRIES):
        before = [stamp(path) for path in paths]
        try:
            content = read()
        except (InputError, OSError, LookupError, ValueError):
            if [stamp(path) for path in paths] == before:
                raise
            continue
        if [stamp(path) for path in paths] == before:
            return content
    raise StoreError(f"{paths[0]}: replaced {TRIES} times while it was read; repeat this when no run extends the cube")
