"""JSON documents on disk: written whole or not at all, checked against their schema on the way out and in."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mcstudy.errors import StoreError
from mcstudy.files import schema
from mcstudy.files.durable import PARTIAL
from mcstudy.files.output import write_file
from mcstudy.files.untrusted import json_document, real_bytes

LARGEST = 1 << 30
"""Bytes of a JSON file that is read at most."""


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror or error}") from None


def json_text(value: Mapping[str, Any], kind: str, where: str) -> str:
    """A document as it is printed or written, checked against the schema ``kind`` first."""
    schema.validate(kind, value, where)
    try:
        return json.dumps(value, indent=1, sort_keys=False, allow_nan=False, ensure_ascii=False)
    except ValueError:  # a schema's "number" includes them
        raise StoreError(f"{where}: expected finite numbers, found NaN or an infinity") from None


def write_json(path: Path, value: Mapping[str, Any], kind: str) -> str:
    """Write JSON atomically, checked against the schema ``kind``; returns its SHA-256."""
    return write_text(path, json_text(value, kind, str(path)))


def write_text(path: Path, text: str) -> str:
    """Write text and a line end atomically; returns the SHA-256 of the file."""
    content = f"{text}\n".encode("utf-8", "backslashreplace")  # names of files may hold bytes that are no character
    write_file(path, lambda: content)
    return hashlib.sha256(content).hexdigest()


def ensure_folder(path: Path) -> None:
    """Make a folder with its parents, if it is not there."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{path}: expected a folder that can be made ({error.strerror})") from None


def own_folder(path: Path, mark: str, what: str) -> None:
    """Refuse (`StoreError`) to write ``what`` into a folder that holds other files; changes nothing.

    It may be absent or empty, or hold the file ``mark``, which is written first.
    """
    try:
        held = sorted(entry.name for entry in path.iterdir() if not entry.name.endswith(PARTIAL))
    except FileNotFoundError:
        return
    except OSError as error:
        raise StoreError(f"{path}: expected a folder for {what} ({error.strerror})") from None
    if held and mark not in held:
        raise StoreError(f"{path}: expected a new or empty folder, or one of {what}, found {held[0]} and no {mark}")


def read_document(path: Path) -> Any:
    """The JSON document of a file, not checked against any schema."""
    try:
        return json_document(real_bytes(path, LARGEST, follow=True))
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise StoreError(f"{path}: expected JSON: {' '.join(str(error).split())}") from None


def read_json(path: Path, kind: str) -> dict[str, Any]:
    """Read JSON checked against the schema ``kind``; `StoreError` names the file and the place."""
    value = read_document(path)
    schema.validate(kind, value, str(path))
    return dict(value)


def plain(x: Any) -> Any:
    """Convert to builtin types, records to their fields; numbers that are not finite become None."""
    if is_dataclass(x) and not isinstance(x, type):
        return plain(named(x))
    if isinstance(x, dict):
        return {str(k): plain(v) for k, v in x.items()}
    if isinstance(x, list | tuple):
        return [plain(v) for v in x]
    if isinstance(x, np.ndarray):
        return plain(x.tolist())
    if isinstance(x, np.generic):
        return plain(x.item())
    if isinstance(x, float) and not math.isfinite(x):
        return None
    return x


def named(record: Any, *names: str) -> dict[str, Any]:
    """Attributes of a record by name; all fields of a dataclass without ``names``."""
    return {name: getattr(record, name) for name in names or (f.name for f in fields(record))}
