"""The study files that come with mcstudy, found by name."""

from __future__ import annotations

import difflib
import os
import re
from pathlib import Path

from mcstudy.errors import DesignError
from mcstudy.files.packaged import packaged
from mcstudy.files.untrusted import toml


def shipped_studies() -> dict[str, Path]:
    """Study files by name, in alphabetical order; the challenge files beside them are not among them."""
    files = sorted(packaged("pipelines").glob("*.toml"))
    return {file.stem: file for file in files if re.search(r"^\[study\]", file.read_text("utf-8"), re.MULTILINE)}


def question(file: Path) -> str:
    """What the study in a shipped file answers: its own description, in one line."""
    description: str = toml(file.read_text("utf-8"))["study"]["description"]
    return description


def located(study: str | Path) -> Path:
    """The file of a study: a path that ends in .toml or names a folder, otherwise the name of a shipped study.

    Raises `DesignError` (one line, with similar names) if there is neither a file nor a shipped study.
    """
    path = Path(study)
    if os.path.exists(path) and (path.suffix or path.name != str(study)):
        return path
    shipped = shipped_studies()
    if str(study) in shipped:
        return shipped[str(study)]
    near = difflib.get_close_matches(path.stem, shipped, n=3)
    hint = f"shipped with mcstudy: {', '.join(near)}" if near else "list of shipped studies: mcstudy studies"
    raise DesignError(f"{study}: expected a study file (.toml) or the name of a shipped study ({hint})")
