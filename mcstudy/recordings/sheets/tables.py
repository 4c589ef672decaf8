"""What descriptions of recordings and of groups share: strict tables, and one line for every mistake."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from mcstudy.errors import RecordingError
from mcstudy.files.plain_errors import one_line
from mcstudy.recordings.refusals import require_known
from mcstudy.stance.body import STIMULI


class Table(BaseModel):
    """A table of a description; unknown keys, NaN and infinity are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Description(Table):
    """A whole description: what every kind of it states."""

    stimulus: str


D = TypeVar("D", bound=Description)


def described(kind: type[D], content: Mapping[str, Any], where: str) -> D:
    """The description in a TOML document; raises `RecordingError`, one line that names ``where`` and the field."""
    try:
        sheet = kind.model_validate(content)
    except ValidationError as error:
        raise RecordingError(f"{where}: {one_line(error, kind)}") from error
    require_known(sheet.stimulus, STIMULI, f"{where}: stimulus")
    return sheet
