"""The metadata documents of a cube (``zarr.json``), read without Zarr and compared with what they should say."""

from __future__ import annotations

import contextlib
import json
import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numcodecs import zstd

from mcstudy.errors import StoreError
from mcstudy.study.layout import ArraySpec, Layout
from mcstudy.study.untrusted import LARGEST_METADATA, check_chunk, real_bytes, refuse_links, zstd_claim

KEYS: Any = {"name": "default", "configuration": {"separator": "."}}
"""Names of chunk files: one folder an array, so that a chunk costs one file and one folder entry to sync."""


def describe(path: Path) -> dict[str, Any]:
    """The metadata documents of a cube as one JSON value: what the schema describes.

    ``{"attributes": ..., "groups": {name: {"attributes": ..., "arrays": {name: document}}}}``
    """
    root = document(path)
    refuse_links(path)
    groups = {}
    for folder in folders(path):
        arrays = {array.name: document(array) for array in folders(folder)}
        groups[folder.name] = {"attributes": document(folder).get("attributes"), "arrays": arrays}
    return {"attributes": root.get("attributes", {}), "groups": groups}


def folders(path: Path) -> list[Path]:
    """The folders of a folder, by name."""
    return sorted(p for p in path.iterdir() if p.is_dir())


def document(path: Path) -> dict[str, Any]:
    """The metadata document of a folder of a cube, without its consolidated copy; raises `StoreError`."""
    found = whole_document(path)
    found.pop("consolidated_metadata", None)
    return found


def whole_document(path: Path) -> dict[str, Any]:
    """The metadata document of a folder of a cube; raises `StoreError`."""
    try:
        document = json.loads(real_bytes(path / "zarr.json", LARGEST_METADATA))
    except OSError as error:
        raise StoreError(f"{path / 'zarr.json'}: expected a results cube ({error.strerror})") from None
    except (ValueError, RecursionError):
        raise StoreError(f"{path / 'zarr.json'}: expected a JSON document") from None
    if not isinstance(document, dict) or not isinstance(document.get("attributes", {}), dict):
        raise StoreError(f"{path / 'zarr.json'}: expected Zarr metadata")
    return document


def depth_votes(path: Path) -> dict[str, int]:
    """Realizations a chunk, for each group of a cube that may be damaged: what most of its documents agree on."""
    votes = {folder.name: Counter(_votes(folder)) for folder in folders(path)}
    return {name: found.most_common(1)[0][0] for name, found in votes.items() if found}


def _votes(folder: Path) -> Iterator[int]:
    with contextlib.suppress(StoreError, KeyError, TypeError, ValueError):
        yield _positive(document(folder)["attributes"]["realizations_a_chunk"])
    for name in ("status", "cost", "estimate", "frf", "growth_rate"):
        try:
            found = document(folder / name)
            axis = found["dimension_names"].index("realization")
            yield _positive(found["chunk_grid"]["configuration"]["chunk_shape"][axis])
        except (StoreError, KeyError, TypeError, ValueError, IndexError, AttributeError):
            continue


def _positive(value: Any) -> int:
    if int(value) < 1:
        raise ValueError
    return int(value)


def chunk_bytes(layout: Layout) -> int:
    """Bytes of a chunk, all results together, uncompressed."""
    specs = [layout.arrays[name] for name in layout.results]
    return sum(math.prod(spec.chunks) * np.dtype(spec.dtype).itemsize for spec in specs)


def check_array(path: Path, found: dict[str, Any], spec: ArraySpec) -> None:
    """What the schema leaves open: shape, chunks, names of chunk files. `StoreError` names the array and the field."""
    expected = {
        "shape": list(spec.shape),
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": list(spec.chunks)}},
        "chunk_key_encoding": KEYS,
        "storage_transformers": [],
    }
    for field, value in expected.items():
        if found.get(field, value) != value:
            raise StoreError(f"{path / 'zarr.json'}: {field}: expected {value}, found {_short(found[field])}")
    if spec.values is None:
        return
    file = path / ".".join(["c", *("0" for _ in spec.dims)])
    if not file.is_file():
        raise StoreError(f"{file}: missing")  # Zarr would make it up from fill values
    if spec.dtype == "string":
        _check_strings(file, math.prod(spec.shape))


def _check_strings(file: Path, expected: int) -> None:
    """The one kind of array whose decoder allocates by a number in the decoded content: how many strings there are."""
    try:
        content = real_bytes(file, LARGEST_METADATA)
        check_chunk(file, content)
        decoded = bytes(zstd.decompress(content[:-4])) if zstd_claim(content) is not None else b""
    except (OSError, RuntimeError, ValueError):
        return  # missing or damaged, which is found when it is read
    if decoded and int.from_bytes(decoded[:4], "little") != expected:
        raise StoreError(f"{file}: expected {expected} strings")


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 100 else text[:97] + "..."
