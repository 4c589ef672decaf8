"""Files in a cube's folder that do not belong to the cube: `verify` and `run` list them, and `run` can set them aside.

Nothing is ever deleted: files set aside keep their name and relative path in a folder next to the cube.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from mcstudy.files.durable import PARTIAL, make_folder, sync_folder, unwritable
from mcstudy.study.cube.store import Cube

NOT_PART = "not part of the cube (mcstudy run --quarantine sets it aside)"
"""Message about a stray file or folder, printed after its name."""


@dataclass(frozen=True)
class Stray:
    """A file or folder of a cube's tree, relative to the cube.

    ``in_the_way``: a folder where a file of the cube should be, or a file where a folder should be.
    """

    path: Path
    in_the_way: bool


def parts(cube: Cube, skeleton: Collection[Path]) -> set[Path]:
    """Every file that may be in a cube, relative to it; ``skeleton``: the files of an empty cube."""
    out = set(skeleton)
    for store in cube.groups.values():
        for chunk in store.layout.chunks:
            out.update(Path(file) for file in store.files(chunk))
            out.add(Path(store.name) / store.layout.note(chunk))
    return out


def strays(root: Path, files: set[Path]) -> Iterator[Stray]:
    """Everything in the tree ``root`` except ``files``; a folder that does not belong is listed without its content."""
    folders = {folder for file in files for folder in file.parents}
    for place, below, names in os.walk(root):
        here = Path(place).relative_to(root)
        for name in sorted([*below, *names]):
            path = here / name
            is_folder = name in below and not (root / path).is_symlink()
            if path in (folders if is_folder else files) or (name in names and name.endswith(PARTIAL)):
                continue
            yield Stray(path, path in (files if is_folder else folders))
        below[:] = [name for name in below if here / name in folders]


def aside_folder(root: Path) -> Path:
    """Folder next to a cube for files that were found in it but do not belong to it."""
    return root.with_name(root.name + ".aside")


def set_aside(root: Path, stray_files: Collection[Stray]) -> Path:
    """Move strays into a new folder below `aside_folder`, and return it."""
    beside = aside_folder(root)
    try:
        make_folder(beside)
        taken = [int(p.name) for p in beside.iterdir() if p.name.isdecimal()]
        target = beside / str(max(taken, default=0) + 1)
        for stray in stray_files:
            place = target / stray.path
            make_folder(place.parent)
            (root / stray.path).rename(place)
            sync_folder(place.parent)
            sync_folder((root / stray.path).parent)
    except OSError as error:
        raise unwritable(beside, "a writable folder", error) from None
    return target
