"""Study, challenge, design and inference files: found by path, or by name where they come with mcstudy, and read."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from mcstudy.errors import DesignError
from mcstudy.files.local_path import local_path
from mcstudy.files.packaged import packaged
from mcstudy.files.toml_files import parse_toml, read_text
from mcstudy.files.untrusted import toml

T = TypeVar("T")


def shipped(kind: str = "study") -> dict[str, Path]:
    """Shipped files with a table [KIND], such as [study] or [challenge], by name, in alphabetical order."""
    files = sorted(packaged("pipelines").glob("*.toml"))
    table = re.compile(rf"^\[{kind}\]", re.MULTILINE)
    return {file.stem: file for file in files if table.search(file.read_text("utf-8"))}


def question(file: Path) -> str:
    """What the study in a shipped file answers: its own description, in one line."""
    description: str = toml(file.read_text("utf-8"))["study"]["description"]
    return description


def located(name: str | Path, kind: str = "study") -> Path:
    """The file of a study or another ``kind``: a path that ends in .toml or names a folder, or a shipped file's name.

    Raises `DesignError` (one line, with similar names) if there is neither a file nor a shipped one.
    """
    path, known = local_path(name), shipped(kind)
    if os.path.exists(path) and (path.suffix or path.name != str(name)):
        return path
    if str(name) in known:
        return known[str(name)]
    near = difflib.get_close_matches(path.stem, known, n=3)
    hint = f"similar: {', '.join(near)}" if near else f"all: {', '.join(known)}"
    raise DesignError(f"{name}: expected a {kind} file (.toml) or the name of a {kind} shipped with mcstudy ({hint})")


def read_file(path: str | Path, kind: str, parse: Callable[[dict[str, Any]], T]) -> T:
    """What ``parse`` makes of the tables of a file, or of a shipped one by name.

    Raises `DesignError`, one line that names the file, and as ``parse`` raises it.
    """
    path, what = located(path, kind), f"{kind} file"
    text = read_text(path, what)
    try:
        return parse(parse_toml(text, what))
    except DesignError as error:
        raise DesignError(f"{path}: {error}") from None
