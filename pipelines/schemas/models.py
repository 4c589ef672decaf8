"""Model files, from the records that read them."""

from __future__ import annotations

from typing_extensions import TypedDict

from mcstudy.models.record import ModelTable
from pipelines.schemas.kinds import open_ended


@open_ended
class ModelFile(TypedDict):
    """A model as a file declares it. TOML; the table `model` of a study file conforms to the same rules, and may also
    state `kind`, `truth` and `bounds`. Numbers may be arithmetic of the constants."""

    model: ModelTable
