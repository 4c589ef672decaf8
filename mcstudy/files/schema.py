"""The versioned JSON schemas of the files that the program writes, and validation against them.

The schemas live in ``results_schema/`` at the top of the source tree and travel inside the wheel.
"""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from mcstudy.errors import StoreError
from mcstudy.files.packaged import packaged


@cache
def versions() -> dict[str, str]:
    """The newest version of every schema, by its name."""
    folders = [folder for folder in packaged("results_schema").iterdir() if folder.is_dir()]
    folders.sort(key=lambda folder: tuple(map(int, folder.name.split("."))))
    return {file.stem: folder.name for folder in folders for file in folder.glob("*.json")}


@cache
def load(name: str) -> dict[str, Any]:
    """The schema ``name`` (e.g. ``"study_cube"``), in its newest version."""
    file = packaged("results_schema") / versions()[name] / f"{name}.json"
    return dict(json.loads(file.read_text(encoding="utf-8")))


@cache
def names() -> frozenset[str]:
    """Names of all schemas."""
    return frozenset(versions())


def identifier(name: str) -> str:
    """The identifier that a file carries: ``$id`` of its schema."""
    return str(load(name)["$id"])


@cache
def _validator(name: str, at: tuple[str, ...]) -> Any:
    from jsonschema import Draft202012Validator  # type: ignore[import-untyped]  # slow to import, and not needed for the command line's help

    whole = load(name)
    part = whole
    for key in at:
        part = part[key]
    return Draft202012Validator({"$defs": whole.get("$defs", {}), **part})


def validate(name: str, value: Any, where: str, at: tuple[str, ...] = ()) -> None:
    """Raise `StoreError`, one line with ``where`` and the position in ``value``, if ``value`` does not conform.

    ``at``: keys that lead to the part of the schema for ``value``; none for a whole document.
    """
    errors = sorted(_validator(name, at).iter_errors(value), key=lambda e: list(map(str, e.absolute_path)))
    if errors:
        place, words = _explained(_innermost(errors[0]))
        raise StoreError(f"{where}: {'.'.join(place) or 'top level'}: {words} ({name} {versions()[name]})")


def _innermost(error: Any) -> Any:
    """The error inside the alternative that fits best, that is, down to the deepest position."""
    while error.context:
        error = max(error.context, key=lambda e: (len(e.absolute_path), e.validator != "type", e.schema_path[0]))
    return error


_TYPES = {
    "number": "a number",
    "integer": "a whole number",
    "string": "text",
    "boolean": "true or false",
    "array": "a list",
    "object": "a table",
    "null": "null",
}

_LIMITS = {
    "minimum": "at least {}",
    "maximum": "at most {}",
    "exclusiveMinimum": "more than {}",
    "exclusiveMaximum": "less than {}",
    "pattern": "text matching {}",
    "const": "{!r}",
    "minLength": "text of at least {} characters",
    "maxLength": "text of at most {} characters",
    "minItems": "at least {} items",
    "maxItems": "at most {} items",
    "minProperties": "at least {} keys",
    "maxProperties": "at most {} keys",
}


def _explained(error: Any) -> tuple[list[str], str]:
    """Position of an error of jsonschema, and what was expected and found there."""
    from mcstudy.files.plain_errors import short, shown

    place = [shown(str(k)) for k in error.absolute_path]
    rule, limit, value = error.validator, error.validator_value, error.instance
    if rule == "required":
        return [*place, next(k for k in limit if k not in value)], "missing"
    if rule == "additionalProperties" and limit is False:
        known = error.schema.get("properties", {})
        strange = next(k for k in value if k not in known)
        return place, f"expected only the keys {', '.join(known)}, found {short(strange)}"
    if rule == "type":
        expected = " or ".join(_TYPES[t] for t in ([limit] if isinstance(limit, str) else limit))
    elif rule == "enum":
        expected = "one of " + ", ".join(map(repr, limit))
    elif rule in _LIMITS:
        expected = _LIMITS[rule].format(limit)
        expected = expected.removesuffix("s") if limit == 1 and rule.endswith(("Items", "Length", "ties")) else expected
    else:
        expected = f"a value allowed by {rule}"
    return place, f"expected {expected}, found {short(value)}"
