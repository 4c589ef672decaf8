"""The data files that one description names, each opened once."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from mcstudy.recordings.formats import open_source
from mcstudy.recordings.formats.source import Source
from mcstudy.recordings.formats.text_layout import Dialect
from mcstudy.recordings.guards import inside


class Files:
    """The data files of one description, each opened once.

    ``folder``: where the files are that the description names, and out of which no name may lead. ``user_names``: those
    that the user gave himself, which may lead anywhere.
    """

    def __init__(self, folder: Path, dialect: Dialect, where: str, user_names: Iterable[str] = ()) -> None:
        self._folder, self._dialect, self._where, self._own = folder, dialect, where, frozenset(user_names)
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
