"""TOML files that a user writes: read with a limit of size, and one line for every mistake."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mcstudy.errors import DesignError
from mcstudy.files.untrusted import toml

MAX_BYTES = 1_000_000
"""A file larger than this is refused before it is parsed."""


def read_text(path: Path, what: str) -> str:
    """The text of a TOML file of at most `MAX_BYTES`; raises `DesignError` with one line."""
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise DesignError(f"{path}: expected a readable {what} ({error.strerror})") from None
    if len(content) > MAX_BYTES:
        raise DesignError(f"{path}: expected at most {MAX_BYTES} bytes")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise DesignError(f"{path}: expected UTF-8 text") from None


def parse_toml(text: str, what: str) -> dict[str, Any]:
    """The tables of a TOML text; raises `DesignError` with one line."""
    if len(text) > MAX_BYTES:
        raise DesignError(f"expected a {what} of at most {MAX_BYTES} characters")
    try:
        return toml(text)
    except ValueError as error:
        raise DesignError(f"not valid TOML: {error}") from None


def toml_lines(path: str, table: Mapping[str, Any]) -> Iterator[str]:
    """The lines of a table called ``path`` ("" for the whole file) of plain values; a list of tables has one a line."""
    plain = {k: v for k, v in table.items() if not isinstance(v, dict)}
    if path and (plain or not table):
        yield f"\n[{path}]"
    for key, value in plain.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            yield f"{key} = ["
            for row in value:
                yield "  { " + ", ".join(f"{k} = {_value(v)}" for k, v in row.items() if v is not None) + " },"
            yield "]"
        else:
            yield f"{key} = {_value(value)}"
    for key, value in table.items():
        if isinstance(value, dict):
            yield from toml_lines(f"{path}.{key}" if path else key, value)


def _value(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
