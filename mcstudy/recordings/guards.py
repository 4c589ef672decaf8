"""Untrusted recordings: they may not name files elsewhere, or declare more memory than is allowed.

Zarr stores name their codecs; TOML files name data files. These are checked before any data is read, as HDF5 files are
in `mcstudy.recordings.formats.hdf5`.
"""

from __future__ import annotations

import math
import os
import re
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from mcstudy.errors import RecordingError, StoreError
from mcstudy.files.untrusted import LARGEST_METADATA, check_chunk, json_document, real_bytes, refuse_links, sealed
from mcstudy.recordings.refusals import refused

LARGEST = 1 << 31
"""Bytes a recording may hold in memory; a header that declares more is refused before anything is read."""

CODECS = ("bytes", "zstd", "crc32c")
"""Codecs of a Zarr recording: those that xarray writes and whose memory use can be limited."""

MOST_CHUNKS = 100_000
"""Most chunk files of an array of a Zarr recording."""

CHUNK = re.compile(r"(?:c|c/|c\.)?\d*(?:[/.]\d+)*")
"""Names of chunks inside the folder of an array."""


def regular(path: str | Path) -> None:
    """Raise `RecordingError` unless the path is a regular file or a folder; opening a pipe would block."""
    try:
        mode = Path(path).stat().st_mode
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise RecordingError(f"{path}: expected a regular file or a Zarr folder, found a pipe, socket or device")


def content(path: Path, most: int) -> bytes:
    """Bytes of a file of at most ``most``; raises `RecordingError` for anything else."""
    try:
        with refused(StoreError):
            return real_bytes(path, most, follow=True)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error


def inside(folder: str | Path, name: str, where: str) -> Path:
    """The file ``name`` of ``folder``; `RecordingError` when it lies elsewhere."""
    folder = Path(folder)
    path = folder / name
    try:
        within = path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        within = False
    if not within:
        raise RecordingError(f"{where}: file: expected a name inside {folder}, got {name!r}"[:500])
    return path


def check_zarr(path: str | Path) -> None:
    """Refuse a Zarr store with links in it, of another format or other codecs, or that declares too large a size."""
    path = Path(path)
    try:
        with refused(StoreError):
            refuse_links(path)
            _document(path, "group")
            for folder in sorted(p for p in path.iterdir() if p.is_dir()):
                _check_array(folder, _document(folder, "array"))
    except OSError as error:
        raise RecordingError(f"{path}: expected a Zarr folder: {error.strerror}") from None


def _document(folder: Path, kind: str) -> dict[str, Any]:
    """The metadata of a group or an array."""
    file = folder / "zarr.json"
    try:
        document = json_document(real_bytes(file, LARGEST_METADATA))
    except ValueError as error:
        raise RecordingError(f"{file}: expected JSON: {error}") from None
    except FileNotFoundError:
        raise RecordingError(f"{folder}: expected {kind}s of Zarr version 3, found no zarr.json") from None
    if not isinstance(document, dict):
        raise RecordingError(f"{file}: expected a JSON object")
    stated = {**document, "attributes": type(document.get("attributes", {})).__name__}
    for key, expected in {"zarr_format": 3, "node_type": kind, "attributes": "dict"}.items():
        if type(stated.get(key)) is not type(expected) or stated[key] != expected:
            raise RecordingError(f"{file}: {key}: expected {expected!r}, found {stated.get(key)!r}"[:300])
    return document


def _check_array(folder: Path, document: dict[str, Any]) -> None:
    where = f"{folder.parent}: {folder.name}"

    def stated(*keys: str) -> Any:
        value: Any = document
        for key in keys:
            value = value.get(key) if isinstance(value, dict) else None
        return value

    shape, chunks = stated("shape"), stated("chunk_grid", "configuration", "chunk_shape")
    for name, sizes, least in (("shape", shape, 0), ("chunk_shape", chunks, 1)):
        if not (isinstance(sizes, list) and all(type(n) is int and n >= least for n in sizes)):
            raise RecordingError(f"{where}: {name}: expected whole numbers from {least}, found {sizes!r}"[:300])
    dims = document.get("dimension_names")
    if not (isinstance(dims, list) and len(dims) == len(shape) == len(chunks)):
        raise RecordingError(
            f"{where}: expected dimension_names and chunk_shape as long as shape, found {dims!r}"[:300]
        )
    named = document.get("codecs")
    codecs = [str(isinstance(c, dict) and c.get("name")) for c in (named if isinstance(named, list) else [named])]
    if codecs[:1] != ["bytes"] or len(codecs) > len(CODECS) or not set(codecs) <= set(CODECS):
        raise RecordingError(f"{where}: codecs: expected {', '.join(CODECS)}, found {named!r}"[:300])
    for key, *expected in (("chunk_grid", "regular"), ("chunk_key_encoding", "default", "v2")):
        if stated(key, "name") not in expected:
            raise RecordingError(f"{where}: {key}: expected {' or '.join(expected)}, found {stated(key)!r}"[:300])
    separator = stated("chunk_key_encoding", "configuration", "separator")
    if separator not in (None, "/", "."):
        raise RecordingError(f"{where}: chunk_key_encoding: separator: expected / or ., found {separator!r}"[:300])
    if document.get("storage_transformers"):
        raise RecordingError(f"{where}: storage_transformers: expected none")
    itemsize = _item_bytes(document.get("data_type"), where)
    check_size(shape, chunks, itemsize, where)
    # Zarr reads chunks in parallel; if one fails, errors of the others would follow the one-line message.
    for file in _chunk_files(folder, where):
        _check_decodes(file, codecs, itemsize * math.prod(int(n) for n in chunks))


def _chunk_files(folder: Path, where: str) -> Iterator[Path]:
    count = 0
    for parent, folders, files in os.walk(folder):
        folders.sort()
        for name in (*folders, *sorted(files)):
            path = Path(parent, name)
            if path.is_symlink():
                raise RecordingError(f"{path}: expected a file or a folder, found a link")
        for name in sorted(files):
            path = Path(parent, name)
            if CHUNK.fullmatch(path.relative_to(folder).as_posix()):
                yield path
                count += 1
        if count > MOST_CHUNKS:
            raise RecordingError(f"{where}: expected at most {MOST_CHUNKS} chunks")


def _check_decodes(path: Path, codecs: Sequence[str], size: int) -> None:
    """Refuse a chunk that does not decode to ``size`` bytes."""
    from numcodecs import Zstd  # a tenth of a second to import, which NetCDF does not need

    try:
        content = real_bytes(path)
        check_chunk(path, content)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    for codec in reversed(codecs[1:]):
        if codec == "crc32c":
            if not sealed(content):
                raise RecordingError(f"{path}: checksum does not match (a changed byte or a truncated file)")
            content = content[:-4]
        else:
            try:
                content = Zstd().decode(content)
            except (RuntimeError, ValueError) as error:
                raise RecordingError(f"{path}: cannot be decoded: {error}") from error
    if len(content) != size:
        raise RecordingError(f"{path}: expected a chunk of {size} bytes, found {len(content)}")


def _item_bytes(kind: Any, where: str) -> int:
    number = re.fullmatch(r"(?:float|u?int)(8|16|32|64)", kind) if isinstance(kind, str) else None
    if number:
        return int(number[1]) // 8
    if isinstance(kind, dict) and kind.get("name") == "fixed_length_utf32":
        length = kind["configuration"].get("length_bytes") if isinstance(kind.get("configuration"), dict) else None
        if type(length) is int and length > 0 and length % 4 == 0:
            return length
    raise RecordingError(f"{where}: data_type: expected numbers, found {kind!r}"[:300])


def check_size(shape: Any, chunks: Any, itemsize: int, where: str) -> None:
    """Refuse (`RecordingError`) an array that declares more than `LARGEST` bytes."""
    declared = itemsize * max(math.prod(int(n) for n in shape), math.prod(int(n) for n in chunks))
    if declared > LARGEST:
        raise RecordingError(f"{where}: declares {declared} bytes; expected less than {LARGEST}")
