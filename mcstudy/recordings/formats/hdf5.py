"""HDF5 files as `mcstudy.files.reading_process` reads them: only there is HDF5 opened.

HDF5 files can hold links to other files and datasets whose bytes lie in other files. These are refused, and sizes are
checked, before any data is read.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np

from mcstudy.errors import RecordingError
from mcstudy.files.reading_process import Answer
from mcstudy.recordings.guards import check_size

FILTERS = ("gzip", "lzf", None)

CODED = {"scale_factor", "add_offset", "missing_value", "_Unsigned", "_Encoding", "dtype"}
"""Attributes by which the CF conventions, or xarray, say that a variable is stored in another form."""

MOST_ATTRIBUTE = 10_000
"""Most numbers of an attribute."""


def netcdf(path: Path) -> Answer:
    """Variables (name, dims, shape, dtype, chunk, attributes) and attributes of a file; whether all are stored as is.

    None instead of the variables when some need decoding, which `mcstudy.recordings.formats.packed_netcdf` does.
    """
    check_hdf5(path)
    with h5netcdf.File(path, "r", decode_vlen_strings=True) as file:
        if not all(map(_stored_as_is, file.variables.values())):
            return None, []
        variables = [
            [name, v.dimensions, v.shape, np.dtype(v.dtype).str, v.chunks or (), plain(v.attrs)]
            for name, v in file.variables.items()
        ]
        return [variables, plain(file.attrs)], []


def values(path: Path, name: str) -> Answer:
    """The values of a dataset: an array of numbers, or texts in a list."""
    with h5py.File(path, "r") as file:
        data = file[name]
        if h5py.check_string_dtype(data.dtype) is not None:
            return np.asarray(data.asstr("utf-8", "replace")[()]).tolist(), []
        return None, [np.asarray(data[()])]


def check_hdf5(path: Path) -> None:
    """Refuse a NetCDF file that links to other files, or declares too large a size."""
    close_left_open()
    with h5py.File(path, "r") as file:
        for name in file:
            link = file.get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
                raise RecordingError(f"{path}: {name}: expected data, found a link")
            data = file[name]
            if isinstance(data, h5py.Dataset):
                check_dataset(data, f"{path}: {name}")


def check_dataset(data: Any, where: str) -> None:
    """Refuse a dataset whose bytes lie elsewhere, that needs a filter of strangers, or declares too large a size."""
    if data.external or data.is_virtual:
        raise RecordingError(f"{where}: expected data in this file, found a reference to another one")
    if data.compression not in FILTERS:
        raise RecordingError(f"{where}: compression: expected gzip, lzf or none, found {data.compression!r}")
    check_size(data.shape or (), data.chunks or (), data.dtype.itemsize, where)


def close_left_open() -> None:
    """Close what a read that failed has left open: HDF5 would take a file of the same name for the open one."""
    for file in h5py.h5f.get_obj_ids(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_FILE):
        h5py.File(file).close()


def _stored_as_is(variable: h5netcdf.Variable) -> bool:
    """Whether a variable holds numbers, or text, that need no decoding."""
    fill = variable.attrs.get("_FillValue")
    kept = fill is None or (variable.dtype.kind == "f" and bool(np.isnan(fill).all()))
    text = h5py.check_string_dtype(variable.dtype)
    as_is = variable.dtype.kind in "fiu" if text is None else text.length is None
    return as_is and kept and CODED.isdisjoint(variable.attrs)


def plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes as texts, numbers and lists of them; others as words that say so."""
    return {str(name): _plain(np.asarray(value)) for name, value in attributes.items()}


def _plain(value: np.ndarray) -> Any:
    if value.size <= MOST_ATTRIBUTE:
        if value.dtype.kind in "biuf":
            return (value.astype(float) if value.dtype.kind == "f" else value).tolist()
        if value.dtype.kind in "SUO":
            texts = [v.decode("utf-8", "replace") if isinstance(v, bytes) else v for v in value.ravel().tolist()]
            if all(isinstance(t, str) for t in texts):
                return texts if value.ndim else texts[0]
    return f"{value.size} values of type {value.dtype}"[:100]
