"""Opening the files of a laboratory by their content: MATLAB, C3D, or text with columns."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from mcstudy.errors import RecordingError
from mcstudy.recordings import c3d_file, matlab5, matlab73
from mcstudy.recordings.columns import content, text_source
from mcstudy.recordings.guards import inside, regular
from mcstudy.recordings.layout import Dialect
from mcstudy.recordings.variables import Source

MATLAB, C3D = ".mat", ".c3d"


def open_source(path: Path, dialect: Dialect) -> Source:
    """The variables of a file; raises `RecordingError`, and `InputError` when C3D's library is missing."""
    ending = path.suffix.lower()
    if ending not in (MATLAB, C3D):
        return text_source(path, dialect)
    regular(path)
    if path.is_dir():
        raise RecordingError(f"{path}: expected a file, found a folder")
    if ending == C3D:
        return Source(path, "C3D", c3d_file.variables_of(path))
    with path.open("rb") as file:
        head = file.read(matlab5.HEADER)
    if matlab5.is_matlab5(head):
        return Source(path, "MATLAB 5 to 7", matlab5.variables_of(content(path, matlab5.LARGEST), path))
    if matlab73.is_hdf5(path):
        return Source(path, "MATLAB 7.3", matlab73.variables_of(path))
    raise RecordingError(f"{path}: expected a MATLAB file of version 5 or later (save it again with -v7 or -v7.3)")


class Files:
    """The data files of one description, each opened once.

    ``folder``: where the files are that the description names, and out of which no name may lead. ``own``: names that
    the user gave himself, which may lead anywhere.
    """

    def __init__(self, folder: Path, dialect: Dialect, where: str, own: Iterable[str] = ()) -> None:
        self._folder, self._dialect, self._where, self._own = folder, dialect, where, frozenset(own)
        self._sources: dict[str, Source] = {}

    def source(self, name: str) -> Source:
        """The variables of a file; raises `RecordingError`."""
        if name not in self._sources:
            self._sources[name] = open_source(self._path(name), self._dialect)
        return self._sources[name]

    def remarks(self) -> tuple[str, ...]:
        """What was left out of the opened files, in words that name the file."""
        return tuple(f"{source.path.name}: {r}" for source in self._sources.values() for r in source.remarks)

    def _path(self, name: str) -> Path:
        return Path(name) if name in self._own else inside(self._folder, name, self._where)
