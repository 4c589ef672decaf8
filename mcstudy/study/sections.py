"""Tables that a person fills in, in a file or in Python: validated in one way, refused in one line of plain words.

A `Section` built in Python goes the way of a table of a file: NumPy's numbers and arrays, tuples and other sections
become plain numbers, lists and tables first, so that both accept and refuse the same, in the same words.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    StringConstraints,
)
from pydantic_core import CoreSchema, core_schema

from mcstudy.errors import InputError
from mcstudy.study.plain_errors import validated

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
"""A name that is also a safe folder name."""

Positive = Annotated[float, Field(gt=0)]


@dataclass(frozen=True)
class Range:
    """What a number may be: far beyond any person or robot, and still within what floating point can compute with.

    Attributes
    ----------
    low, high: smallest and largest value, or size with ``signed``. unit: of both, for people.
    or_zero: whether 0 is allowed below ``low``. signed: whether minus the value is allowed where the value is.
    """

    low: float
    high: float
    unit: str = ""
    or_zero: bool = False
    signed: bool = False

    def __str__(self) -> str:
        zero, sign = "0 or " if self.or_zero else "", " of either sign" if self.signed else ""
        return f"{zero}a number from {self.low:g} to {self.high:g}{self.unit and ' ' + self.unit}{sign}"

    def __contains__(self, value: float) -> bool:
        size = abs(value) if self.signed else value
        return self.low <= size <= self.high or (self.or_zero and value == 0)

    def check(self, value: float) -> float:
        """The value; raises `ValueError` when it lies outside."""
        if value not in self:
            raise ValueError(f"expected {self}")
        return value

    def require(self, value: float, where: str) -> float:
        """The value of an option or argument called ``where``; raises `InputError`, one line, when it lies outside."""
        if value not in self:
            raise InputError(f"{where}: expected {self}, got {value}")
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_after_validator_function(self.check, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {**handler(schema), "description": str(self)}


class _FromPython(ModelMetaclass):
    """Makes ``Section(...)`` read its arguments as a file's table is read; pydantic itself does not come this way."""

    def __call__(cls, **fields: Any) -> Any:
        return validated(cls, fields, whole=cls.__name__)


class Section(BaseModel, metaclass=_FromPython):
    """A table of a study file: unknown keys, coerced types, NaN and infinity are errors.

    Raises `DesignError`, one line that starts with the field.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
