"""What a recording from a stranger may not do: name files elsewhere, or claim more memory than it may have.

HDF5 files can hold links to other files and datasets whose bytes lie in other files; Zarr stores name their codecs;
TOML files name data files. All of that is refused before anything is read.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import h5py

from mcstudy.errors import RecordingError, StoreError
from mcstudy.study.untrusted import LARGEST_METADATA, real_bytes, refuse_links

LARGEST = 1 << 31
"""Bytes a recording may hold in memory; a header that claims more is refused before anything is read."""

CODECS = ("bytes", "zstd", "crc32c")
"""Codecs of a Zarr recording: what xarray writes, and what can be told not to allocate without bound."""

FILTERS = ("gzip", "lzf", None)


def inside(folder: Path, name: str, where: str) -> Path:
    """The file ``name`` of ``folder``; `RecordingError` when it lies elsewhere."""
    path = folder / name
    try:
        within = path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        within = False
    if not within:
        raise RecordingError(f"{where}: file: expected a name inside {folder}, got {name!r}"[:500])
    return path


def check_hdf5(path: Path) -> None:
    """Refuse a NetCDF file that links to other files, or claims too much."""
    with h5py.File(path, "r") as file:
        for name in file:
            link = file.get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
                raise RecordingError(f"{path}: {name}: expected data, found a link")
            data = file[name]
            if isinstance(data, h5py.Dataset):
                _check_dataset(data, f"{path}: {name}")


def _check_dataset(data: Any, where: str) -> None:
    if data.external or data.is_virtual:
        raise RecordingError(f"{where}: expected data in this file, found a reference to another one")
    if data.compression not in FILTERS:
        raise RecordingError(f"{where}: compression: expected gzip, lzf or none, found {data.compression!r}")
    _check_size(data.shape or (), data.chunks or (), data.dtype.itemsize, where)


def check_zarr(path: Path) -> None:
    """Refuse a Zarr store with links in it, of another format or other codecs, or that claims too much."""
    try:
        refuse_links(path)
        for folder in sorted(p for p in path.iterdir() if p.is_dir()):
            _check_array(json.loads(real_bytes(folder / "zarr.json", LARGEST_METADATA)), f"{path}: {folder.name}")
    except StoreError as error:
        raise RecordingError(str(error)) from None


def _check_array(document: Any, where: str) -> None:
    shape, codecs = document["shape"], [codec["name"] for codec in document["codecs"]]
    chunks = document["chunk_grid"]["configuration"]["chunk_shape"]
    if not set(codecs) <= set(CODECS):
        raise RecordingError(f"{where}: codecs: expected {', '.join(CODECS)}, found {', '.join(map(str, codecs))}")
    _check_size(shape, chunks, _item_bytes(document["data_type"], where), where)


def _item_bytes(kind: Any, where: str) -> int:
    number = re.fullmatch(r"(?:float|u?int)(8|16|32|64)", kind) if isinstance(kind, str) else None
    if number:
        return int(number[1]) // 8
    if isinstance(kind, dict) and kind.get("name") == "fixed_length_utf32":
        return int(kind["configuration"]["length_bytes"])
    raise RecordingError(f"{where}: data_type: expected numbers, found {kind!r}"[:300])


def _check_size(shape: Any, chunks: Any, itemsize: int, where: str) -> None:
    claimed = itemsize * max(math.prod(int(n) for n in shape), math.prod(int(n) for n in chunks))
    if claimed > LARGEST:
        raise RecordingError(f"{where}: claims {claimed} bytes; expected less than {LARGEST}")
