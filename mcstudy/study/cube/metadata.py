"""The metadata documents of a cube (``zarr.json``), read without Zarr and compared with the expected content."""

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
from mcstudy.files.plain_errors import short
from mcstudy.files.untrusted import LARGEST_METADATA, check_chunk, real_bytes, refuse_links, zstd_claim
from mcstudy.study.cube.layout import ArraySpec, Layout

KEYS: Any = {"name": "default", "configuration": {"separator": "."}}
"""Naming of chunk files: one folder per array, so that a chunk needs one file and one folder entry to be synced."""


def describe(path: Path) -> dict[str, Any]:
    """The metadata documents of a cube as one JSON value, as the schema describes it.

    ``{"attributes": ..., "groups": {name: {"attributes": ..., "arrays": {name: document}}}}``
    """
    root = own_document(path)
    refuse_links(path)
    groups = {}
    for folder in folders(path):
        arrays = {array.name: own_document(array) for array in folders(folder)}
        groups[folder.name] = {"attributes": own_document(folder).get("attributes"), "arrays": arrays}
    return {"attributes": root.get("attributes", {}), "groups": groups}


def folders(path: Path) -> list[Path]:
    """The folders of a folder, by name."""
    return sorted(p for p in path.iterdir() if p.is_dir())


def own_document(path: Path) -> dict[str, Any]:
    """The metadata document of a folder of a cube, without its consolidated copy; raises `StoreError`."""
    document = whole_document(path)
    document.pop("consolidated_metadata", None)
    return document


def whole_document(path: Path) -> dict[str, Any]:
    """The metadata document of a folder of a cube; raises `StoreError`."""
    try:
        document = json.loads(real_bytes(path / "zarr.json", LARGEST_METADATA))
    except NotADirectoryError:
        study = f"; to run a study: mcstudy run {path} -o {path.with_suffix('.zarr')}" if path.suffix == ".toml" else ""
        packed = f"; unpack it first: unzip {path} -d {path.with_suffix('.zarr')}" if path.suffix == ".zip" else ""
        raise StoreError(f"{path}: expected the folder of a results cube, found a file{packed}{study}") from None
    except OSError as error:
        near = Path(f"{path}.zarr")
        hint = f"; similar: {near}" if near.exists() else ""
        raise StoreError(f"{path / 'zarr.json'}: expected a results cube ({error.strerror}){hint}") from None
    except (ValueError, RecursionError):
        raise StoreError(f"{path / 'zarr.json'}: expected a JSON document") from None
    if not isinstance(document, dict) or not isinstance(document.get("attributes", {}), dict):
        raise StoreError(f"{path / 'zarr.json'}: expected Zarr metadata")
    return document


def depth_votes(path: Path) -> dict[str, int]:
    """Realizations per chunk for each group of a cube that may be damaged, by majority of its documents."""
    votes = {folder.name: Counter(_votes(folder)) for folder in folders(path)}
    return {name: counts.most_common(1)[0][0] for name, counts in votes.items() if counts}


def _votes(folder: Path) -> Iterator[int]:
    with contextlib.suppress(StoreError, KeyError, TypeError, ValueError):
        yield _positive(own_document(folder)["attributes"]["realizations_a_chunk"])
    for name in ("status", "cost", "estimate", "frf", "growth_rate"):
        try:
            document = own_document(folder / name)
            axis = document["dimension_names"].index("realization")
            yield _positive(document["chunk_grid"]["configuration"]["chunk_shape"][axis])
        except (StoreError, KeyError, TypeError, ValueError, IndexError, AttributeError):
            continue


def holds_empty_angle(folder: Path) -> bool:
    """Whether a group of one joint, which may be damaged, has the second angle of earlier versions, by majority."""
    votes: Counter[bool] = Counter()
    for name in ("frf", "angle", "angle_2", "true_frf", "noise_covariance"):
        with contextlib.suppress(StoreError, KeyError, TypeError, IndexError):
            votes[own_document(folder / name)["shape"][-1] == 2] += 1
    return votes[True] > votes[False]


def _positive(value: Any) -> int:
    if int(value) < 1:
        raise ValueError
    return int(value)


def chunk_bytes(layout: Layout) -> int:
    """Bytes of a chunk, all results together, uncompressed."""
    specs = [layout.arrays[name] for name in layout.results]
    return sum(math.prod(spec.chunks) * np.dtype(spec.dtype).itemsize for spec in specs)


def check_array(path: Path, description: dict[str, Any], spec: ArraySpec) -> None:
    """Check what the schema leaves open: shape, chunks, chunk file names. `StoreError` names array and field."""
    expected = {
        "shape": list(spec.shape),
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": list(spec.chunks)}},
        "chunk_key_encoding": KEYS,
        "storage_transformers": [],
    }
    for field, value in expected.items():
        if description.get(field, value) != value:
            raise StoreError(f"{path / 'zarr.json'}: {field}: expected {value}, found {short(description[field], 100)}")
    if spec.values is None:
        return
    file = path / ".".join(["c", *("0" for _ in spec.dims)])
    if not file.is_file():
        raise StoreError(f"{file}: missing")  # Zarr would return fill values
    if spec.dtype == "string":
        _check_strings(file, math.prod(spec.shape))


def _check_strings(file: Path, expected: int) -> None:
    """Check the number of strings in an array of text, because its decoder allocates memory by that number."""
    try:
        content = real_bytes(file, LARGEST_METADATA)
        check_chunk(file, content)
        decoded = bytes(zstd.decompress(content[:-4])) if zstd_claim(content) is not None else b""
    except (OSError, RuntimeError, ValueError):
        return  # missing or damaged, which is found when it is read
    if decoded and int.from_bytes(decoded[:4], "little") != expected:
        raise StoreError(f"{file}: expected {expected} strings")
