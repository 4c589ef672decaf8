"""Folders that lie at the top of the source tree and, in a wheel, inside the package."""

from __future__ import annotations

from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent


@cache
def packaged(name: str) -> Path:
    """The folder ``results_schema``, ``pipelines`` or ``docs``; raises `FileNotFoundError` when it is missing."""
    for folder in (PACKAGE / name, PACKAGE.parent / name):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"{name} is missing from this installation of mcstudy")
