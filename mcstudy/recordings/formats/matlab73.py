"""MATLAB files of version 7.3 (``save -v7.3``), which are HDF5: numbers in variables, structs and cells.

Arrays are stored with their dimensions in reverse. A struct is a group; a struct array is a group whose fields are
datasets of references, a cell array is one dataset of references. Text and empty arrays are skipped; objects (tables,
categories, ...), sparse and complex arrays are named with their class. Links and references out of the file are
refused, and sizes are checked before anything is read. It is read in a process of its own
(`mcstudy.files.reading_process`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.files.reading_process import Answer
from mcstudy.recordings.formats.hdf5 import check_dataset, close_left_open
from mcstudy.recordings.formats.source import MOST_VARIABLES

DEEPEST = 16
"""Deepest nesting of structs and cells."""

HIDDEN = ("#refs#", "#subsystem#")
"""Groups that hold what references point to."""

NUMBERS = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
"""Classes of numbers; programs other than MATLAB state none."""

TEXT = ("char", "FileWrapper__")


@dataclass
class _Listing:
    """What a file holds: datasets of numbers (name, shape, dataset), and classes of what is no array of numbers."""

    path: Path
    numbers: dict[str, tuple[tuple[int, ...], str]] = field(default_factory=dict)
    others: dict[str, str] = field(default_factory=dict)


def matlab(path: Path) -> Answer:
    """All numeric variables of a file, [name, shape, dataset] each, and the class of others by name."""
    close_left_open()
    found = _Listing(path)
    with h5py.File(path, "r") as file:
        for name in file:
            if name not in HIDDEN:
                _member(file, file, name, name, found, 0)
    return [[[n, *of] for n, of in found.numbers.items()], found.others], []


def _member(file: h5py.File, group: Any, key: str, name: str, found: _Listing, depth: int) -> None:
    if not isinstance(group.get(key, getlink=True), h5py.HardLink):
        raise RecordingError(f"{found.path}: {name}: expected data, found a link")
    _object(file, group[key], name, found, depth)


def _object(file: h5py.File, item: Any, name: str, found: _Listing, depth: int) -> None:
    if depth > DEEPEST:
        raise RecordingError(f"{found.path}: {name[:60]}: expected structs and cells nested at most {DEEPEST} deep")
    if len(found.numbers) + len(found.others) >= MOST_VARIABLES:
        raise RecordingError(f"{found.path}: expected at most {MOST_VARIABLES} variables")
    kind = _class(item)
    if "MATLAB_sparse" in item.attrs:
        found.others[name] = "sparse"
    elif isinstance(item, h5py.Group):
        for key in item:
            _field(file, item, key, name, found, depth)
    elif not isinstance(item, h5py.Dataset) or kind in TEXT or item.attrs.get("MATLAB_empty", 0):
        return
    elif "MATLAB_object_decode" in item.attrs or kind not in ("", "cell", *NUMBERS):
        found.others[name] = kind or "object"
    else:
        _dataset(file, item, name, found, depth)


def _dataset(file: h5py.File, item: Any, name: str, found: _Listing, depth: int) -> None:
    check_dataset(item, f"{found.path}: {name}")
    if h5py.check_ref_dtype(item.dtype) is h5py.Reference:
        for k, inner in enumerate(_references(item, f"{found.path}: {name}")):
            _object(file, file[inner], f"{name}[{k}]", found, depth + 1)
    elif item.dtype.names == ("real", "imag"):
        found.others[name] = "complex"
    elif item.dtype.kind in "fiu" and item.shape and 0 not in item.shape:
        found.numbers[name] = (item.shape[::-1], item.name)


def _field(file: h5py.File, group: Any, key: str, name: str, found: _Listing, depth: int) -> None:
    """A field of a struct, or of every element of a struct array."""
    item = group.get(key)
    if isinstance(item, h5py.Dataset) and h5py.check_ref_dtype(item.dtype) is h5py.Reference and _class(item) != "cell":
        check_dataset(item, f"{found.path}: {name}.{key}")
        for k, inner in enumerate(_references(item, f"{found.path}: {name}.{key}")):
            _object(file, file[inner], f"{name}[{k}].{key}", found, depth + 1)
    else:
        _member(file, group, key, f"{name}.{key}", found, depth + 1)


def _references(item: Any, where: str) -> Any:
    if item.size > MOST_VARIABLES:
        raise RecordingError(f"{where}: expected at most {MOST_VARIABLES} elements, got {item.size}")
    return np.asarray(item[()]).ravel()  # stored in reverse: C order here is column order there


def _class(item: Any) -> str:
    name = item.attrs.get("MATLAB_class", b"")
    return name.decode("utf-8", "replace") if isinstance(name, bytes) else str(name)
