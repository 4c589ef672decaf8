"""Sections that a user fills in, in a file or in Python, with one validation and one-line errors for both.

A `Section` built in Python is treated like a table of a file: NumPy numbers and arrays, tuples and other sections are
first converted to plain numbers, lists and tables. Both forms accept the same values and give the same errors.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from mcstudy.files.plain_errors import validated

if TYPE_CHECKING:  # pydantic has no public name for it
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
"""A name that is safe as a folder name."""

Positive = Annotated[float, Field(gt=0)]


class _FromPython(ModelMetaclass):
    """Makes ``Section(...)`` validate its arguments like a table of a file; pydantic's own calls bypass this."""

    def __call__(cls, *words: Any, **fields: Any) -> Any:
        return cls.from_python(*words, **fields)  # type: ignore[attr-defined]


class Section(BaseModel, metaclass=_FromPython):
    """A table of a study file; unknown keys, values of another type, NaN and infinity are errors.

    Raises `DesignError`, one line that starts with the field.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, serialize_by_alias=True)

    @classmethod
    def from_python(cls, **fields: Any) -> Any:
        """What ``Section(...)`` returns."""
        return validated(cls, fields, whole=cls.__name__)


def without_defaults(section: Section, plain: dict[str, Any], names: Collection[str]) -> dict[str, Any]:
    """The ``plain`` form of a section without those of ``names`` that have their default.

    A key that is new is named here, so that it changes no design and no fingerprint where it is not used.
    """
    fields = type(section).model_fields
    return {n: value for n, value in plain.items() if n not in names or getattr(section, n) != fields[n].default}


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """(``table.key``, value) of everything in a table and the tables inside it; an empty table is a value."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from leaves(inner, f"{path}.{key}" if path else key)
    else:
        yield path, value
