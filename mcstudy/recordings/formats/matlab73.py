"""MATLAB files of version 7.3 (``save -v7.3``), which are HDF5: numbers in variables, structs and cells.

Arrays are stored with their dimensions in reverse. A struct is a group; a struct array is a group whose fields are
datasets of references, a cell array is one dataset of references. Text and empty arrays are skipped; objects (tables,
categories, ...), sparse and complex arrays are named with their class. Links and references out of the file are
refused, and sizes are checked before anything is read. It is read in a process of its own
(`mcstudy.files.reading_process`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.files.reading_process import Answer
from mcstudy.recordings.formats.hdf5 import check_dataset, close_left_open
from mcstudy.recordings.formats.source import MOST_VARIABLES, Listing
from mcstudy.recordings.refusals import refused

HIDDEN = ("#refs#", "#subsystem#")
"""Groups that hold what references point to."""

NUMBERS = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
"""Classes of numbers; programs other than MATLAB state none."""

TEXT = ("char", "FileWrapper__")


Arrays = Listing[tuple[tuple[int, ...], str]]
"""Shape and dataset of every array."""


def matlab(path: Path) -> Answer:
    """All numeric variables of a file, [name, shape, dataset] each, and the class of others by name."""
    close_left_open()
    listing: Arrays = Listing()
    with h5py.File(path, "r") as file, refused(RecordingError, where=path):
        for name in file:
            if name not in HIDDEN:
                _member(file, file, name, name, listing, 0)
    return [[[name, *array] for name, array in listing.numbers.items()], listing.others], []


def _member(file: h5py.File, group: Any, key: str, name: str, listing: Arrays, depth: int) -> None:
    if not isinstance(group.get(key, getlink=True), h5py.HardLink):
        raise RecordingError(f"{name}: expected data, found a link")
    _object(file, group[key], name, listing, depth)


def _object(file: h5py.File, item: Any, name: str, listing: Arrays, depth: int) -> None:
    listing.refuse_deeper(depth, name)
    kind = _class(item)
    if "MATLAB_sparse" in item.attrs:
        listing.add_other(name, "sparse")
    elif isinstance(item, h5py.Group):
        for key in item:
            _field(file, item, key, name, listing, depth)
    elif not isinstance(item, h5py.Dataset) or kind in TEXT or item.attrs.get("MATLAB_empty", 0):
        return
    elif "MATLAB_object_decode" in item.attrs or kind not in ("", "cell", *NUMBERS):
        listing.add_other(name, kind or "object")
    else:
        _dataset(file, item, name, listing, depth)


def _dataset(file: h5py.File, item: Any, name: str, listing: Arrays, depth: int) -> None:
    check_dataset(item, name)
    if h5py.check_ref_dtype(item.dtype) is h5py.Reference:
        for k, inner in enumerate(_references(item, name)):
            _object(file, file[inner], f"{name}[{k}]", listing, depth + 1)
    elif item.dtype.names == ("real", "imag"):
        listing.add_other(name, "complex")
    elif item.dtype.kind in "fiu" and item.shape and 0 not in item.shape:
        listing.add(name, (item.shape[::-1], item.name))


def _field(file: h5py.File, group: Any, key: str, name: str, listing: Arrays, depth: int) -> None:
    """A field of a struct, or of every element of a struct array."""
    item = group.get(key)
    if isinstance(item, h5py.Dataset) and h5py.check_ref_dtype(item.dtype) is h5py.Reference and _class(item) != "cell":
        check_dataset(item, f"{name}.{key}")
        for k, inner in enumerate(_references(item, f"{name}.{key}")):
            _object(file, file[inner], f"{name}[{k}].{key}", listing, depth + 1)
    else:
        _member(file, group, key, f"{name}.{key}", listing, depth + 1)


def _references(item: Any, name: str) -> Any:
    if item.size > MOST_VARIABLES:
        raise RecordingError(f"{name}: expected at most {MOST_VARIABLES} elements, got {item.size}")
    return np.asarray(item[()]).ravel()  # stored in reverse: C order here is column order there


def _class(item: Any) -> str:
    name = item.attrs.get("MATLAB_class", b"")
    return name.decode("utf-8", "replace") if isinstance(name, bytes) else str(name)
