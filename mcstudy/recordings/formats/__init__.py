"""File formats of laboratories: which there are, and the variables of a file.

A format is a module of this folder with a function ``source(path, dialect)``, which recognises the bytes of a file,
lists its variables with their units and rates (`Source`; values are read when they are asked for), and refuses in one
line what it cannot read. It is listed in `FORMATS` with the endings of its files; nothing else has to know it.
Recordings as mcstudy itself writes them are in `mcstudy.recordings.formats.netcdf_zarr`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from pathlib import Path

    from mcstudy.recordings.formats.source import Source
    from mcstudy.recordings.formats.text_layout import Dialect


class Format(NamedTuple):
    """A format: its name for people, the endings of its files, and its module in this folder."""

    name: str
    endings: tuple[str, ...]
    module: str


FORMATS = (
    Format("MATLAB", (".mat",), "matlab"),
    Format("C3D", (".c3d",), "c3d"),
)

TEXT = Format("text with columns", (), "text")
"""What a file with any other ending is, OpenSim's ``.mot``, ``.sto`` and ``.trc`` among them."""


def accepted() -> str:
    """The formats in words."""
    return ", ".join(f"{f.name} ({', '.join(f.endings)})" for f in FORMATS) + f" or {TEXT.name}"


def open_source(path: Path, dialect: Dialect) -> Source:
    """The variables of a file; raises `RecordingError`."""
    from importlib import import_module

    from mcstudy.errors import RecordingError
    from mcstudy.recordings.guards import regular

    ending = path.suffix.lower()
    known = next((f for f in FORMATS if ending in f.endings), TEXT)
    if known is not TEXT:
        regular(path)
        if path.is_dir():
            raise RecordingError(f"{path}: expected a file, found a folder")
    source: Source = import_module(f"{__name__}.{known.module}").source(path, dialect)
    return source
