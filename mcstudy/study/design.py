"""What a study is: groups with nothing left to default, checked and written out in full.

`Study` is the same whether it was read from a file (`mcstudy.study.study_file`) or built in Python: the same mistakes
are refused in the same line, and the same choices have the same fingerprint.
"""

from __future__ import annotations

import hashlib
import html
import json
from typing import Any

from pydantic import Field, model_validator

from mcstudy.errors import DesignError
from mcstudy.study.checks import check
from mcstudy.study.group import (
    SECTIONS,
    BoundsSection,
    FitSection,
    Group,
    ModelSection,
    NoiseSection,
    SpectraSection,
    StimulusSection,
    StudySection,
)
from mcstudy.study.models import with_model_values
from mcstudy.study.sections import Name, Positive, Section

__all__ = [
    "SECTIONS",
    "BoundsSection",
    "FitSection",
    "Group",
    "ModelSection",
    "Name",
    "NoiseSection",
    "Positive",
    "Section",
    "SpectraSection",
    "StimulusSection",
    "Study",
    "StudySection",
]


class Study(Section):
    """A fully resolved study: nothing is left to a default."""

    study: StudySection
    group: dict[Name, Group] = Field(min_length=1, max_length=200)

    @model_validator(mode="after")
    def _resolved(self) -> Study:
        """This study with the values of its models written out; `DesignError` for what the physics refuses."""
        groups = {}
        for name, group in self.group.items():
            try:
                check(group)
                groups[name] = with_model_values(group)
            except DesignError as error:
                raise DesignError(f"group.{name}.{error}") from None
        return self.model_copy(update={"group": groups})

    @property
    def fits(self) -> int:
        """Number of fits of all groups."""
        return sum(group.fits for group in self.group.values())

    def _repr_html_(self) -> str:
        """What a notebook shows: the groups and what they cost in fits."""
        rows = "".join(
            f"<tr><th scope='row'>{html.escape(name)}</th><td>{g.realizations}</td><td>{g.starts}</td>"
            f"<td>{', '.join(f'{f:g}' for f in g.fmax)}</td><td>{', '.join(f'{a:g}' for a in g.amplitude)}</td>"
            f"<td>{html.escape(g.model.kind)}</td><td>{g.fit.cost}, {g.fit.solver}</td><td>{g.fits}</td></tr>"
            for name, g in self.group.items()
        )
        columns = ("group", "realizations", "starts", "Fmax (Hz)", "amplitude", "model", "fit", "fits")
        head = "".join(f"<th scope='col'>{c}</th>" for c in columns)
        return (
            f"<h3>Study {html.escape(self.study.name)}</h3><p>{html.escape(self.study.description)}</p>"
            f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
            f"<p>{self.fits} fits, seed {self.study.seed}, fingerprint {self.fingerprint[:12]}</p>"
        )

    def numbers(self) -> dict[str, Any]:
        """Everything that changes a number of the cube, as plain JSON values (the prose left out)."""
        return self.model_dump(mode="json", exclude={"study": {"description", "regenerates"}})

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the canonical JSON of `numbers`."""
        canonical = json.dumps(self.numbers(), sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(canonical.encode()).hexdigest()

    def to_json(self) -> str:
        """Lossless text for a task; `from_json` reads it."""
        return self.model_dump_json()

    @classmethod
    def from_json(cls, text: str) -> Study:
        """Inverse of `to_json`."""
        return cls.model_validate_json(text)
