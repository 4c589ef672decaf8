"""The versioned JSON schemas of what the program writes, and validation against them.

The schemas live in ``results_schema/`` at the top of the source tree and travel inside the wheel.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from mcstudy.errors import StoreError

VERSION = "1.0.0"


@cache
def load(name: str) -> dict[str, Any]:
    """The schema ``name`` (e.g. ``"study_cube"``) of the current version."""
    package = Path(__file__).resolve().parent.parent
    for folder in (package / "results_schema", package.parent / "results_schema"):
        file = folder / VERSION / f"{name}.json"
        if file.is_file():
            return dict(json.loads(file.read_text(encoding="utf-8")))
    raise FileNotFoundError(f"results_schema/{VERSION}/{name}.json is missing from this installation")


def identifier(name: str) -> str:
    """The identifier an artefact carries, ``$id`` of its schema."""
    return str(load(name)["$id"])


@cache
def _validator(name: str) -> Any:
    from jsonschema import Draft202012Validator  # type: ignore[import-untyped]  # slow to import, and not needed for the command line's help

    return Draft202012Validator(load(name))


def validate(name: str, value: Any, where: str) -> None:
    """Raise `StoreError`, one line with ``where`` and the place in ``value``, if ``value`` does not conform."""
    error = next(iter(sorted(_validator(name).iter_errors(value), key=lambda e: list(map(str, e.absolute_path)))), None)
    if error is not None:
        place = ".".join(map(str, error.absolute_path)) or "top level"
        message = " ".join(error.message.split())
        shown = message if len(message) <= 200 else message[:197] + "..."
        raise StoreError(f"{where}: {place}: expected {name} of {VERSION}: {shown}")
