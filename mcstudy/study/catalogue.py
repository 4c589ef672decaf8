"""The study and challenge files that come with mcstudy, found by name."""

from __future__ import annotations

import difflib
import os
import re
from pathlib import Path

from mcstudy.errors import DesignError
from mcstudy.files.packaged import packaged
from mcstudy.files.untrusted import toml


def shipped(kind: str = "study") -> dict[str, Path]:
    """Shipped files with a table [study] or [challenge], by name, in alphabetical order."""
    files = sorted(packaged("pipelines").glob("*.toml"))
    table = re.compile(rf"^\[{kind}\]", re.MULTILINE)
    return {file.stem: file for file in files if table.search(file.read_text("utf-8"))}


def question(file: Path) -> str:
    """What the study in a shipped file answers: its own description, in one line."""
    description: str = toml(file.read_text("utf-8"))["study"]["description"]
    return description


def located(name: str | Path, kind: str = "study") -> Path:
    """The file of a study or challenge: a path that ends in .toml or names a folder, otherwise a shipped file's name.

    Raises `DesignError` (one line, with similar names) if there is neither a file nor a shipped one.
    """
    path, known = Path(name), shipped(kind)
    if os.path.exists(path) and (path.suffix or path.name != str(name)):
        return path
    if str(name) in known:
        return known[str(name)]
    near = difflib.get_close_matches(path.stem, known, n=3)
    hint = f"similar: {', '.join(near)}" if near else f"all: {', '.join(known)}"
    raise DesignError(f"{name}: expected a {kind} file (.toml) or the name of a {kind} shipped with mcstudy ({hint})")
