"""Reading and writing study files.

A study file is TOML. Sections at the top level hold for every group; ``[group.NAME]`` gives a group its axes and may
hold the same sections again (``[group.NAME.fit]``) to override single keys. Every mistake is one line:
``file: field: what was expected``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from mcstudy.errors import DesignError
from mcstudy.study.checks import check
from mcstudy.study.design import SECTIONS, Group, Study, StudySection
from mcstudy.study.models import with_model_values
from mcstudy.study.untrusted import toml

MAX_BYTES = 1_000_000
"""A study file larger than this is refused before it is parsed."""


def read_study(path: str | Path) -> Study:
    """The resolved study of a file; raises `DesignError` with one line."""
    path = Path(path)
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise DesignError(f"{path}: expected a readable study file ({error.strerror})") from None
    if len(content) > MAX_BYTES:
        raise DesignError(f"{path}: expected at most {MAX_BYTES} bytes")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        raise DesignError(f"{path}: expected UTF-8 text") from None
    try:
        return parse_study(text)
    except DesignError as error:
        raise DesignError(f"{path}: {error}") from None


def parse_study(text: str) -> Study:
    """The resolved study of a study file's text; the one-line `DesignError` starts with the field."""
    if len(text) > MAX_BYTES:
        raise DesignError(f"expected a study file of at most {MAX_BYTES} characters")
    try:
        raw = toml(text)
    except ValueError as error:
        raise DesignError(f"not valid TOML: {error}") from None
    known = ("study", *SECTIONS, "group")
    for key, value in raw.items():
        if key not in known:
            raise DesignError(f"{key}: unknown key, expected one of {', '.join(known)}")
        if not isinstance(value, dict):
            raise DesignError(f"{key}: expected a table [{key}], got {_short(value)}")
    if "study" not in raw:
        raise DesignError("study: missing, expected a table [study] with name and seed")
    if not raw.get("group"):
        raise DesignError("group: missing, expected at least one table [group.NAME]")
    _validate(StudySection, raw["study"], "study")
    shared = {key: raw[key] for key in SECTIONS if key in raw}
    for key, value in shared.items():
        _validate(Group.model_fields[key].annotation, value, key)
    groups = {}
    for name, own in raw["group"].items():
        if not isinstance(own, dict):
            raise DesignError(f"group.{name}: expected a table [group.{name}], got {_short(own)}")
        for key in SECTIONS:
            if not isinstance(own.get(key, {}), dict):
                raise DesignError(f"group.{name}.{key}: expected a table, got {_short(own[key])}")
        groups[name] = _merge(shared, own)
        _validate(Group, groups[name], f"group.{name}")
    study = _validate(Study, {"study": raw["study"], "group": groups}, "")
    resolved = {}
    for name, group in study.group.items():
        try:
            check(group)
            resolved[name] = with_model_values(group)
        except DesignError as error:
            raise DesignError(f"group.{name}.{error}") from None
    return study.model_copy(update={"group": resolved})


def _merge(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with the keys of ``own`` over it, table by table."""
    merged = dict(base)
    for key, value in own.items():
        old = merged.get(key)
        merged[key] = _merge(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return merged


def _validate(model: Any, value: Mapping[str, Any], where: str) -> Any:
    try:
        # through JSON because strict validation of JSON takes a list for a tuple and nothing else for anything else
        return model.model_validate_json(json.dumps(value))
    except TypeError:
        raise DesignError(f"{where}: expected numbers, text, lists and tables only (no dates)") from None
    except ValidationError as error:
        raise DesignError(_one_line(error, model, where)) from None


_FIELD_NAME = re.compile(r"^(\w+): ")


def _one_line(error: ValidationError, model: type[BaseModel], where: str) -> str:
    """The first of pydantic's errors as ``field: expected ..., got ...``."""
    errors = error.errors(include_url=False)
    first = min(errors, key=lambda e: e["type"] != "extra_forbidden")  # a misspelt key also makes another one missing
    loc = [str(part) for part in first["loc"] if part != "[key]"]
    field = ".".join([where, *loc] if where else loc)
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    if first["type"] == "extra_forbidden":
        keys = _keys(model, loc[:-1])
        return f"{field}: unknown key, expected {'one of ' + ', '.join(keys) if keys else 'none here'}{more}"
    if first["type"] == "missing":
        return f"{field}: missing{more}"
    message = first["msg"].removeprefix("Value error, ")
    message = re.sub(r"^(Input|String|Tuple|Dictionary) should (be|have|match)( a valid)?", _expected, message)
    if not message.startswith("expected"):
        message = f"expected {message[0].lower()}{message[1:]}"
    for theirs, ours in _WORDING:
        message = message.replace(theirs, ours)
    return f"{field}: {message}, got {_short(first['input'])}{more}"


def _expected(match: re.Match[str]) -> str:
    verb = {"be": "", "have": " with", "match": " text matching"}[match.group(2)]
    return f"expected{verb}{' a' if match.group(3) else ''}"


_WORDING = (
    ("expected a integer", "expected a whole number"),
    ("expected a array", "expected a list"),
    ("expected a dictionary", "expected a table"),
    ("expected an object", "expected a table"),
    (" after validation, not 0", ""),
    ("greater than or equal to", "at least"),
    ("less than or equal to", "at most"),
)


def _keys(model: type[BaseModel], loc: list[str]) -> list[str]:
    """Keys a table may have, followed down from ``model``."""
    for part in loc:
        field = model.model_fields.get(part)
        annotation = field.annotation if field else None
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return []
        model = annotation
    return list(model.model_fields)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def to_toml(study: Study) -> str:
    """The canonical study file: defaults filled in, comments gone. Reading it gives the same study."""
    plain = study.model_dump(mode="json")
    return "\n".join(_table("", {"study": plain["study"], "group": plain["group"]})).lstrip("\n") + "\n"


def _table(path: str, table: Mapping[str, Any]) -> Iterator[str]:
    scalars = {k: v for k, v in table.items() if not isinstance(v, dict)}
    if path and (scalars or not table):
        yield f"\n[{path}]"
    for key, value in scalars.items():
        yield f"{key} = {json.dumps(value, ensure_ascii=False)}"
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _table(f"{path}.{key}" if path else key, value)


def changes(old: Study, new: Study) -> list[str]:
    """What differs between two studies, as ``field: old -> new`` lines, in the order of the file."""
    before, after = dict(_flat("", old.numbers())), dict(_flat("", new.numbers()))
    lines = []
    for field in [*before, *(f for f in after if f not in before)]:
        if before.get(field) != after.get(field):
            sides = (_short(side[field]) if field in side else "(absent)" for side in (before, after))
            lines.append(f"{field}: {' -> '.join(sides)}")
    return lines


def _flat(path: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{path}.{key}" if path else key, inner)
    else:
        yield path, value
