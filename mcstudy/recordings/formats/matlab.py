"""MATLAB files of version 5 and later, told apart by their bytes; what to do about variables that are no numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.files.reading_process import Unreadable, answer
from mcstudy.recordings.formats import matlab5
from mcstudy.recordings.formats.source import Source, Variable
from mcstudy.recordings.formats.text_layout import Dialect
from mcstudy.recordings.guards import content
from mcstudy.text_tables import printable

HDF5 = b"\x89HDF\r\n\x1a\n"


def source(path: Path, dialect: Dialect) -> Source:  # noqa: ARG001 - nothing about text applies
    """The variables of a MATLAB file; raises `RecordingError`."""
    with path.open("rb") as file:
        head = file.read(matlab5.HEADER)
    if matlab5.is_matlab5(head):
        listing = matlab5.variables_of(content(path, matlab5.LARGEST), path)
        return Source(path, "MATLAB 5 to 7", listing.numbers, others=with_remedies(listing.others))
    if is_hdf5(path):
        return _version73(path)
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


def _version73(path: Path) -> Source:
    try:
        (numbers, others), _ = answer("mcstudy.recordings.formats.matlab73:matlab", path)
    except Unreadable as error:
        raise RecordingError(f"{path}: expected a MATLAB file: {error}") from None

    def values(dataset: str, shape: tuple[int, ...]) -> np.ndarray:
        _, (array,) = answer("mcstudy.recordings.formats.hdf5:values", path, dataset, expected=8 * math.prod(shape))
        return np.asarray(array, dtype=float).T

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
