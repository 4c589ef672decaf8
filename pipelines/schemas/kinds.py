"""Kinds of values that documents have."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, TypeVar

from pydantic import ConfigDict, Field, with_config

Probability = Annotated[float, Field(ge=0, le=1)]
Share = Annotated[float, Field(ge=0, le=1.000001)]
"""A sum of probabilities, with its rounding."""
NonNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=0)]
Number = Annotated[int, Field(ge=1)]
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]

Record = TypeVar("Record", bound=type)

_DESCRIBED = ConfigDict(use_attribute_docstrings=True)


def further(rules: dict[str, Any]) -> Callable[[Record], Record]:
    """A record that may have further keys, with rules of JSON Schema that types do not express."""
    return with_config(ConfigDict(json_schema_extra=rules, **_DESCRIBED))


def closed(record: Record) -> Record:
    """A record with the keys that it declares and no others."""
    return with_config(ConfigDict(extra="forbid", **_DESCRIBED))(record)


def open_ended(record: Record) -> Record:
    """A record that may have further keys."""
    return with_config(_DESCRIBED)(record)
