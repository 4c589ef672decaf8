"""The files of a challenge: data with their manifest, the key apart from them, answers, and their digests.

    DATA/manifest.json          what was asked, the digest of the key, the digest of every recording
    DATA/case0001.nc ...        the recordings
    KEY.json                    the truth of every case; must not lie inside DATA
    ANSWERS.json                one answer per case, with the digest of the manifest they belong to

The manifest publishes the key's SHA-256 before anyone has answered, so a key that was changed afterwards shows; answers
carry the manifest's, so they cannot be scored against another challenge.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mcstudy.errors import StoreError
from mcstudy.study import schema
from mcstudy.study.durable import PARTIAL, write

MANIFEST = "manifest.json"

LARGEST = 1 << 30
"""Bytes of a JSON file that is read at most."""


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    sha = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            sha.update(block)
    return sha.hexdigest()


def write_json(path: Path, value: Mapping[str, Any], kind: str | None = None) -> str:
    """Write JSON atomically, checked against the schema ``kind``; returns its SHA-256."""
    if kind is not None:
        schema.validate(kind, value, str(path))
    content = (json.dumps(value, indent=1, sort_keys=False, allow_nan=False, ensure_ascii=False) + "\n").encode()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, content)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror or error}") from None
    return hashlib.sha256(content).hexdigest()


def read_json(path: Path, kind: str) -> dict[str, Any]:
    """Read JSON checked against the schema ``kind``; `StoreError` names the file and the place."""
    try:
        if path.stat().st_size > LARGEST:
            raise StoreError(f"{path}: expected less than {LARGEST} bytes")
        value = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise StoreError(f"{path}: expected JSON: {' '.join(str(error).split())}") from None
    schema.validate(kind, value, str(path))
    return dict(value)


def read_manifest(data: Path, whole: bool = True) -> tuple[dict[str, Any], str]:
    """The manifest of a data folder and its SHA-256.

    Refuses (`StoreError`) a folder in which anything lies that the manifest does not list - a key, for example - or,
    when ``whole``, in which a recording is missing.
    """
    path = data / MANIFEST
    if not data.is_dir():
        raise StoreError(f"{data}: expected the data folder of a challenge")
    manifest = read_json(path, "challenge_manifest")
    present = {p.relative_to(data).as_posix() for p in data.rglob("*") if p.is_file() and p.suffix != PARTIAL}
    listed = set(manifest["files"]) | {MANIFEST}
    for strange in sorted(present - listed):
        if digest(data / strange) == manifest["key_sha256"]:
            raise StoreError(f"{data / strange}: this is the key; it must not lie with the data that are answered")
        raise StoreError(f"{data / strange}: not in the manifest; expected nothing but the recordings")
    if whole and (missing := sorted(listed - present)):
        raise StoreError(f"{data}: {missing[0]} is missing ({len(missing)} in all)")
    return manifest, digest(path)


def partial_folder(path: Path) -> Path:
    """Where unfinished parts of a file are kept until it is whole."""
    return path.with_name(path.name + ".parts")


def read_parts(path: Path) -> dict[str, dict[str, Any]]:
    """Finished parts of a file by case name; parts that are damaged are left out and done again."""
    out = {}
    folder = partial_folder(path)
    for file in sorted(folder.glob("*.json")) if folder.is_dir() else ():
        try:
            out[file.stem] = dict(json.loads(file.read_text(encoding="utf-8")))
        except (OSError, ValueError):
            continue
    return out


def drop_parts(path: Path) -> None:
    """Remove the parts of a file that is whole."""
    folder = partial_folder(path)
    if folder.is_dir():
        for file in folder.iterdir():
            file.unlink()
        folder.rmdir()
