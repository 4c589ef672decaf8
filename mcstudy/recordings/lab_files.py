"""Opening the files of a laboratory by their content: MATLAB, C3D, or text with columns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.files.reading_process import Unreadable, answer
from mcstudy.recordings import c3d_file, matlab5
from mcstudy.recordings.columns import content, text_source
from mcstudy.recordings.guards import inside, regular
from mcstudy.recordings.layout import Dialect
from mcstudy.recordings.variables import Source, Variable
from mcstudy.text_tables import printable

MATLAB, C3D = ".mat", ".c3d"

HDF5 = b"\x89HDF\r\n\x1a\n"


def open_source(path: Path, dialect: Dialect) -> Source:
    """The variables of a file; raises `RecordingError`."""
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
        found, others = matlab5.variables_of(content(path, matlab5.LARGEST), path)
        return Source(path, "MATLAB 5 to 7", found, others=with_remedies(others))
    if is_hdf5(path):
        return _matlab73(path)
    raise RecordingError(f"{path}: expected a MATLAB file of version 5 or later (save it again with -v7 or -v7.3)")


def is_hdf5(path: Path) -> bool:
    """Whether a file holds HDF5; its signature is at the front, or behind 512 bytes, 1024, 2048, ..."""
    with path.open("rb") as file:
        size, at = path.stat().st_size, 0
        while at < size:
            file.seek(at)
            if file.read(len(HDF5)) == HDF5:
                return True
            at = 2 * at or 512
    return False


def _matlab73(path: Path) -> Source:
    try:
        (numbers, others), _ = answer("mcstudy.recordings.matlab73:matlab", path)
    except Unreadable as error:
        raise RecordingError(f"{path}: expected a MATLAB file: {error}") from None

    def values(dataset: str, shape: tuple[int, ...]) -> np.ndarray:
        _, (found,) = answer("mcstudy.recordings.hdf5_files:values", path, dataset, expected=8 * math.prod(shape))
        return np.asarray(found, dtype=float).T

    variables = {n: Variable(n, tuple(shape), partial(values, at, tuple(shape))) for n, shape, at in numbers}
    return Source(path, "MATLAB 7.3", variables, others=with_remedies(others))


REMEDIES = {
    "table": "table2struct({0}, 'ToScalar', true)",
    "timetable": "table2struct(timetable2table({0}), 'ToScalar', true)",
    "timeseries": "struct('time', {0}.Time, 'data', {0}.Data)",
    "categorical": "double({0})",
    "datetime": "seconds({0} - {0}(1))",
    "duration": "seconds({0})",
    "string": "double({0})",
    "sparse": "full({0})",
    "complex": "struct('re', real({0}), 'im', imag({0}))",
}
"""The numbers in a variable, by its class, as MATLAB computes them."""


def with_remedies(others: Mapping[str, str]) -> dict[str, str]:
    """What is said of variables that are no arrays of numbers, from their classes."""
    out = {}
    for name, kind in others.items():
        shown = printable(name)
        numbers = REMEDIES.get(kind, "struct({0})").format(shown)
        what = f"of class {kind}" if kind.isidentifier() else "an object"
        out[name] = f"{shown} is {what}, not an array of numbers; in MATLAB: S = {numbers}; save('numbers.mat', 'S')"
    return out


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
