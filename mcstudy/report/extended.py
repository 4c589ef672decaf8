"""Results of lower rooms with methods that need figures or pages."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

T = TypeVar("T")


def extended(cls: type[T], found: Any) -> T:
    """The result ``found`` as ``cls``, a subclass of its class with the same fields."""
    return cls(**{f.name: getattr(found, f.name) for f in fields(found)})
