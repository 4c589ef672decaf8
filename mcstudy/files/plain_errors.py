"""Translate pydantic's errors into one plain line: ``field: expected ..., got ...``.

It is used for study files, challenge files, recording sheets and the settings of `mcstudy.own_model`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from mcstudy.errors import DesignError
from mcstudy.text_tables import similar


def validated(model: Any, value: Any, where: str = "", whole: str = "file") -> Any:
    """``value``, plain tables and lists, as a strict ``model`` (a class of pydantic).

    Raises `DesignError`, one line that starts with the field. ``where`` is a prefix of the field; ``whole`` replaces
    the field when the error concerns the whole document.
    """
    try:
        # by way of JSON, because strict validation of JSON accepts a list for a tuple but no other conversion
        return model.model_validate_json(json.dumps(value, default=_plain))
    except TypeError:
        raise DesignError(f"{where or whole}: expected numbers, text, lists and tables only (no dates)") from None
    except ValidationError as error:
        raise DesignError(one_line(error, model, where, whole)) from None
    except (ValueError, RecursionError):  # pydantic's own error is a ValueError too, and came first
        raise DesignError(f"{where or whole}: a number has too many digits, or tables are nested too deeply") from None


def _plain(value: Any) -> Any:
    """A section or an array in the form it has in a file."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if isinstance(value, Mapping):
        return dict(value)
    if hasattr(value, "__array__"):
        return np.asarray(value).tolist()
    raise TypeError(type(value).__name__)


def one_line(error: ValidationError, model: type[BaseModel], where: str = "", whole: str = "file") -> str:
    """The first of pydantic's errors about a ``model`` as one line; ``where`` is put before the field."""
    errors = error.errors(include_url=False)
    places = [e["loc"] for e in errors]
    # pydantic also reports a list with refused items as too short
    errors = [e for e in errors if not any(len(p) > len(e["loc"]) and p[: len(e["loc"])] == e["loc"] for p in places)]
    first = min(errors, key=lambda e: e["type"] != "extra_forbidden")  # a misspelt key also makes another one missing
    loc, table = _place(model, first["loc"])
    field = ".".join([where, *loc] if where else loc) or whole
    others = [e for e in errors if _place(model, e["loc"])[0] != loc]
    more = f" (and {len(others)} more)" if others else ""
    if first["type"] == "extra_forbidden":
        known = _fields(table) if table else []
        keys = f"one of {', '.join(known)}{similar(str(loc[-1]), known)}" if known else "none here"
        return f"{field}: unknown key, expected {keys}{more}"
    if first["type"] == "missing":
        return f"{field}: missing{more}"
    # A union has one error per member, all of the same field.
    expected = dict.fromkeys(_expected(e) for e in errors if e not in others)
    first_of, *alternatives = expected
    words = " or ".join([first_of, *(a.removeprefix("expected ") for a in alternatives)])
    return f"{field}: {words}, got {short(first['input'])}{more}"


def shown(name: str) -> str:
    """A name from untrusted input, unchanged unless it is too long for a line or holds control characters."""
    return name if name.isprintable() and len(name) <= 60 else short(name)


def short(value: object, most: int = 60) -> str:
    """``value`` as it is written, cut to ``most`` characters."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a number of thousands of digits, or hundreds of lists in each other
        return "a value too long to show"
    return text if len(text) <= most else text[: most - 3] + "..."


_BY_TYPE = {
    "int_parsing_size": "expected a whole number of at most 19 digits",
    "int_from_float": "expected a whole number",
    "int_parsing": "expected a whole number",
    "float_parsing": "expected a number",
    "model_type": "expected a table",
    "dict_type": "expected a table",
    "tuple_type": "expected a list",
    "list_type": "expected a list",
    "int_type": "expected a whole number",
    "float_type": "expected a number",
    "string_type": "expected a string",
    "bool_type": "expected a boolean",
    "finite_number": "expected a finite number",
    "json_invalid": "expected text that UTF-8 can hold, and tables less deeply nested",
}

_BY_LIMIT = {
    "greater_than_equal": "expected at least {ge}",
    "less_than_equal": "expected at most {le}",
    "greater_than": "expected greater than {gt}",
    "less_than": "expected less than {lt}",
    "literal_error": "expected {expected}",
    "string_pattern_mismatch": "expected text matching pattern '{pattern}'",
    "string_too_short": "expected at least {min_length} character{s}",
    "string_too_long": "expected at most {max_length} character{s}",
    "too_short": "expected a {kind} with at least {min_length} item{s}",
    "too_long": "expected a {kind} with at most {max_length} item{s}",
}
"""What is expected, with the limits that an error states."""


def _expected(error: ErrorDetails) -> str:
    """From the type of an error and its limits; never from pydantic's words, which may change."""
    kind, limits = error["type"], error.get("ctx", {})
    if kind in _BY_TYPE:
        return _BY_TYPE[kind]
    if kind == "value_error":  # our own validators give the expected value
        text = str(limits["error"])
        return text if text.startswith("expected") else f"expected {text[0].lower()}{text[1:]}"
    if kind in _BY_LIMIT:
        counted = limits.get("min_length", limits.get("max_length"))
        words = {name: _shown(value) for name, value in limits.items()}
        collection = "table" if limits.get("field_type") == "Dictionary" else "list"
        return _BY_LIMIT[kind].format(**words, kind=collection, s="" if counted == 1 else "s")
    return f"expected another value ({kind.replace('_', ' ')})"


def _shown(limit: Any) -> str:
    """A limit with all its digits."""
    return np.format_float_positional(limit, trim="-") if isinstance(limit, float) else str(limit)


def _place(model: type[BaseModel], loc: tuple[int | str, ...]) -> tuple[tuple[str, ...], type[BaseModel] | None]:
    """The field as it stands in the file, without pydantic's names of a union's members, and the table it is in."""
    here: Any = model
    table: type[BaseModel] | None = None
    out: list[str] = []
    for part in loc:
        if part == "[key]":
            continue
        members = list(_members(here))
        inside = next((x for x in [_inside(a, part) for a in members] if x is not None), None)
        tables = [a for a in members if isinstance(a, type) and issubclass(a, BaseModel)]
        table = tables[0] if tables else None
        if inside is None and not tables:
            continue  # the name of a member of a union
        out.append(shown(str(part)))
        here = inside
    return tuple(out), table


def _members(annotation: Any) -> Iterator[Any]:
    """The alternatives of an annotation, `Annotated` taken off."""
    origin = get_origin(annotation)
    if origin is Annotated:
        yield from _members(get_args(annotation)[0])
    elif origin in (Union, UnionType):
        for member in get_args(annotation):
            yield from _members(member)
    elif annotation is not None:
        yield annotation


def _fields(table: type[BaseModel]) -> dict[str, FieldInfo]:
    """Fields by the names that a file has for them."""
    return {field.alias or name: field for name, field in table.model_fields.items()}


def _inside(annotation: Any, part: int | str) -> Any:
    """Annotation of one field or element, None when there is no such."""
    arguments = get_args(annotation)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        field = _fields(annotation).get(str(part))
        return field.annotation if field else None
    if isinstance(part, int) and get_origin(annotation) in (tuple, list):
        return arguments[part] if part < len(arguments) and Ellipsis not in arguments else arguments[0]
    if isinstance(part, str) and get_origin(annotation) is dict:
        return arguments[1]
    return None
