"""MATLAB files of version 7.3 (``save -v7.3``), which are HDF5: numbers in variables, structs and cells.

Arrays are stored with their dimensions in reverse. A struct is a group; a struct array is a group whose fields are
datasets of references, a cell array is one dataset of references. Text, empty arrays, objects and complex numbers are
skipped. Links and references out of the file are refused, and sizes are checked before anything is read.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.recordings.guards import check_dataset
from mcstudy.recordings.variables import MOST_VARIABLES, Variable

DEEPEST = 16
"""Deepest nesting of structs and cells."""

HIDDEN = ("#refs#", "#subsystem#")
"""Groups that hold what references point to."""

_SKIPPED = ("char", "function_handle", "string", "FileWrapper__", "sparse")


def is_hdf5(path: Path) -> bool:
    """Whether a regular file holds HDF5, with or without MATLAB's header in front."""
    return bool(h5py.is_hdf5(path))


def variables_of(path: Path) -> dict[str, Variable]:
    """All numeric variables of a file by name (``struct.field``, ``cell[0]``); raises `RecordingError`."""
    found: dict[str, Variable] = {}
    try:
        with h5py.File(path, "r") as file:
            for name in file:
                if name not in HIDDEN:
                    _member(file, file, name, name, path, found, 0)
    except RecordingError:
        raise
    except Exception as error:  # h5py raises different errors for damaged files
        reason = (str(error).splitlines() or [type(error).__name__])[0][:300]
        raise RecordingError(f"{path}: expected a MATLAB file: {reason}") from None
    return found


def _member(
    file: h5py.File, group: Any, key: str, name: str, path: Path, found: dict[str, Variable], depth: int
) -> None:
    if not isinstance(group.get(key, getlink=True), h5py.HardLink):
        raise RecordingError(f"{path}: {name}: expected data, found a link")
    _object(file, group[key], name, path, found, depth)


def _object(file: h5py.File, item: Any, name: str, path: Path, found: dict[str, Variable], depth: int) -> None:
    if depth > DEEPEST:
        raise RecordingError(f"{path}: {name[:60]}: expected structs and cells nested at most {DEEPEST} deep")
    if len(found) >= MOST_VARIABLES:
        raise RecordingError(f"{path}: expected at most {MOST_VARIABLES} variables")
    if isinstance(item, h5py.Group):
        for key in item:
            _field(file, item, key, name, path, found, depth)
        return
    if not isinstance(item, h5py.Dataset) or _class(item) in _SKIPPED or item.attrs.get("MATLAB_empty", 0):
        return
    check_dataset(item, f"{path}: {name}")
    if h5py.check_ref_dtype(item.dtype) is h5py.Reference:
        for k, inner in enumerate(_references(item, f"{path}: {name}")):
            _object(file, file[inner], f"{name}[{k}]", path, found, depth + 1)
    elif item.dtype.kind in "fiu" and item.shape and 0 not in item.shape:
        found[name] = Variable(name, item.shape[::-1], partial(_values, path, item.name))


def _field(
    file: h5py.File, group: Any, key: str, name: str, path: Path, found: dict[str, Variable], depth: int
) -> None:
    """A field of a struct, or of every element of a struct array."""
    item = group.get(key)
    if isinstance(item, h5py.Dataset) and h5py.check_ref_dtype(item.dtype) is h5py.Reference and _class(item) != "cell":
        check_dataset(item, f"{path}: {name}.{key}")
        for k, inner in enumerate(_references(item, f"{path}: {name}.{key}")):
            _object(file, file[inner], f"{name}[{k}].{key}", path, found, depth + 1)
    else:
        _member(file, group, key, f"{name}.{key}", path, found, depth + 1)


def _references(item: Any, where: str) -> Any:
    if item.size > MOST_VARIABLES:
        raise RecordingError(f"{where}: expected at most {MOST_VARIABLES} elements, got {item.size}")
    return np.asarray(item[()]).ravel()  # stored in reverse: C order here is column order there


def _class(item: Any) -> str:
    name = item.attrs.get("MATLAB_class", b"")
    return name.decode("utf-8", "replace") if isinstance(name, bytes) else str(name)


def _values(path: Path, name: str) -> np.ndarray:
    with h5py.File(path, "r") as file:
        return np.asarray(file[name][()], dtype=float).T
