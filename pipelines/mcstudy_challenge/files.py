"""The files of a challenge: data with their manifest, the separate key, answers, and their digests.

    DATA/manifest.json          the task, the digest of the key, the digest of every recording
    DATA/case0001.nc ...        the recordings
    KEY.json                    the truth of every case; must not lie inside DATA
    ANSWERS.json                one answer per case, with the digest of the manifest they belong to

The manifest publishes the SHA-256 of the key before anyone answers, so a later change of the key is detected. Answers
hold the SHA-256 of the manifest, so they cannot be scored against another challenge.
"""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mcstudy.errors import StoreError
from mcstudy.files import schema
from mcstudy.files.durable import PARTIAL
from mcstudy.files.json_files import digest, read_document, read_json, write_text

MANIFEST = "manifest.json"

CASE = re.compile("case[0-9]+")
"""Name of a case."""


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
            raise StoreError(f"{data / strange}: answer key found in the data folder; move it elsewhere")
        raise StoreError(f"{data / strange}: not in the manifest; expected only the recordings")
    if whole and (missing := sorted(listed - present)):
        raise StoreError(f"{data}: {missing[0]} is missing ({len(missing)} missing in total)")
    return manifest, digest(path)


def partial_folder(path: Path) -> Path:
    """Folder for the parts of a file until the file is complete."""
    return path.with_name(path.name + ".parts")


PARTS = {"challenge_key": ("truth", "cases"), "challenge_answers": ("answer", "answers")}
"""Content of a part besides its header, and its position in the complete file, by the schema of the file."""


def write_part(path: Path, kind: str, header: Mapping[str, Any], content: Mapping[str, Any]) -> None:
    """Write the part of a file for one case, after a check against that part of the file's schema."""
    field, many = PARTS[kind]
    file = partial_folder(path) / f"{content['name']}.json"
    schema.validate(kind, content, str(file), ("properties", many, "items"))
    write_text(file, json.dumps({**header, field: content}, indent=1, allow_nan=False, ensure_ascii=False))


def read_parts(path: Path, kind: str) -> dict[str, dict[str, Any]]:
    """Finished parts of a file by case name; invalid parts are left out and made again."""
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
    """Remove the parts of a complete file, and their folder unless it holds other files."""
    folder = partial_folder(path)
    if folder.is_dir():
        with contextlib.suppress(OSError):
            for file in folder.iterdir():
                if file.is_file() and file.suffix in (".json", PARTIAL):
                    file.unlink()
            folder.rmdir()
