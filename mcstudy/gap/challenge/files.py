"""The files of a challenge: data with their manifest, the key apart from them, answers, and their digests.

    DATA/manifest.json          what was asked, the digest of the key, the digest of every recording
    DATA/case0001.nc ...        the recordings
    KEY.json                    the truth of every case; must not lie inside DATA
    ANSWERS.json                one answer per case, with the digest of the manifest they belong to

The manifest publishes the key's SHA-256 before anyone has answered, so a key that was changed afterwards shows; answers
carry the manifest's, so they cannot be scored against another challenge.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mcstudy.errors import StoreError
from mcstudy.study import schema
from mcstudy.study.durable import PARTIAL, write
from mcstudy.study.untrusted import json_document, real_bytes

MANIFEST = "manifest.json"

CASE = re.compile("case[0-9]+")
"""Name of a case."""

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
    return _write(path, json_text(value, kind, str(path)))


def _write(path: Path, text: str) -> str:
    content = f"{text}\n".encode()
    make_folder(path.parent)
    try:
        write(path, content)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror or error}") from None
    return hashlib.sha256(content).hexdigest()


def write_text(path: Path, text: str) -> None:
    """Write text atomically."""
    _write(path, text)


def make_folder(path: Path) -> None:
    """Make a folder with its parents, if it is not there."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{path}: expected a folder that can be made ({error.strerror})") from None


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


def read_answers(path: Path) -> dict[str, Any]:
    """Answers that conform to their schema; `StoreError` names the file, the case and the field."""
    value = read_document(path)
    if not isinstance(value, dict) or not isinstance(value.get("answers"), list):
        schema.validate("challenge_answers", value, str(path))
    schema.validate("challenge_answers", {**value, "answers": []}, str(path))
    for k, given in enumerate(value["answers"]):
        name = given.get("name") if isinstance(given, dict) else None
        case = name if isinstance(name, str) and CASE.fullmatch(name) else f"answers.{k}"
        schema.validate("challenge_answers", given, f"{path}: {case}", ("properties", "answers", "items"))
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
    for name in manifest["files"]:
        if not CASE.fullmatch(name.removesuffix(".nc")):  # a schema's "$" lets a line end follow
            raise StoreError(f"{path}: files: expected names such as case1.nc, found {name[:60]!r}")
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


PARTS = {"challenge_key": ("truth", "cases"), "challenge_answers": ("answer", "answers")}
"""What a part holds besides its header, and where the whole file keeps it, by the schema of the whole file."""


def write_part(path: Path, kind: str, header: Mapping[str, Any], content: Mapping[str, Any]) -> None:
    """Write the finished part of a file for one case, checked against its place in the schema of the whole."""
    field, many = PARTS[kind]
    file = partial_folder(path) / f"{content['name']}.json"
    schema.validate(kind, content, str(file), ("properties", many, "items"))
    _write(file, json.dumps({**header, field: content}, indent=1, allow_nan=False, ensure_ascii=False))


def read_parts(path: Path, kind: str) -> dict[str, dict[str, Any]]:
    """Finished parts of a file by case name; what is no such part is left out and done again."""
    field, many = PARTS[kind]
    out = {}
    folder = partial_folder(path)
    for file in sorted(folder.glob("*.json")) if folder.is_dir() else ():
        try:
            part = read_document(file)
            content: Any = part.get(field) if isinstance(part, dict) else None
            schema.validate(kind, content, str(file), ("properties", many, "items"))
        except StoreError:
            continue
        if content["name"] == file.stem:
            out[file.stem] = part
    return out


def drop_parts(path: Path) -> None:
    """Remove the parts of a file that is whole, and their folder unless something else lies in it."""
    folder = partial_folder(path)
    if folder.is_dir():
        with contextlib.suppress(OSError):
            for file in folder.iterdir():
                if file.is_file() and file.suffix in (".json", PARTIAL):
                    file.unlink()
            folder.rmdir()
