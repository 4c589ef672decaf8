"""Tables that a person fills in, in a file or in Python: validated in one way, refused in one line of plain words.

A `Section` built in Python goes the way of a table of a file: NumPy's numbers and arrays, tuples and other sections
become plain numbers, lists and tables first, so that both accept and refuse the same, in the same words.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
)

from mcstudy.study.plain_errors import validated

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
"""A name that is also a safe folder name."""

Positive = Annotated[float, Field(gt=0)]


class _FromPython(ModelMetaclass):
    """Makes ``Section(...)`` read its arguments as a file's table is read; pydantic itself does not come this way."""

    def __call__(cls, **fields: Any) -> Any:
        return validated(cls, fields, whole=cls.__name__)


class Section(BaseModel, metaclass=_FromPython):
    """A table of a study file: unknown keys, coerced types, NaN and infinity are errors.

    Raises `DesignError`, one line that starts with the field.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
