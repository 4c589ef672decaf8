"""A study: groups with every setting explicit, checked and written out in full.

A `Study` read from a file (`mcstudy.study.study_file`) and one built in Python are treated alike: the same mistakes
give the same one-line error, and the same settings give the same fingerprint.
"""

from __future__ import annotations

import hashlib
import html
import json
from collections.abc import Iterable
from typing import Any

from pydantic import Field, model_validator

from mcstudy.errors import DesignError
from mcstudy.files.plain_errors import shown, validated
from mcstudy.files.sections import Name, Positive, Section
from mcstudy.files.toml_files import toml_lines
from mcstudy.models.catalogue import spelled_out
from mcstudy.study.checks import checked
from mcstudy.study.group import (
    FITTED,
    SECTIONS,
    BoundsSection,
    FitSection,
    Group,
    ModelSection,
    NoiseSection,
    SpectraSection,
    StimulusSection,
    StoreSection,
    StudySection,
    with_lists,
)
from mcstudy.study.models import with_model_values
from mcstudy.study.sweep import expanded
from mcstudy.text_tables import Table, counted

__all__ = [
    "FITTED",
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
    "StoreSection",
    "Study",
    "StudySection",
]


class Study(Section):
    """A study: what is simulated and fitted, with every setting explicit.

    ``Study("pilot", seed=1)`` begins one in Python, and `group` adds a group to it; `mcstudy.read_study` reads one from
    a file. It cannot be changed afterwards.

    Attributes
    ----------
    study
        Name, seed and description: the table ``[study]`` of a study file.
    groups
        The groups by name: the tables ``[group.NAME]``.

    Raises
    ------
    DesignError
        A setting is not allowed; the same line that a study file gets.
    """

    study: StudySection
    groups: dict[Name, Group] = Field(alias="group", min_length=1, max_length=1000)

    @classmethod
    def from_python(cls, name: str | None = None, /, **fields: Any) -> Any:
        """``Study(name, seed=, description=, regenerates=)``, without groups; or a whole one from its sections."""
        if name is None:
            return super().from_python(**fields)
        return cls.model_construct(study=StudySection(name=name, **fields), groups={})

    def group(self, name: str, /, **fields: Any) -> Study:
        """This study with one more group: a new study, this one stays as it is.

        Parameters
        ----------
        name
            Name of the group, and of its folder in the cube.
        **fields
            Those of a ``[group.NAME]`` table of a study file: ``realizations``, ``starts`` (a number, or
            ``"until certain"`` with ``most_starts``), ``fmax`` (list, Hz), ``amplitude`` (list, N m or m),
            ``simulator``, and the sections ``model``, ``stimulus``, ``noise``, ``spectra``, ``fit``, ``effects`` and
            ``store`` as dicts; ``sweep``, a dict of settings that become axes, with a group for each combination of
            their values; ``model`` may also be a `Model`, a name of ``mcstudy models``, or the path of a model
            file.

        Raises
        ------
        DesignError
            The name is taken, or a field is not allowed.
        """
        cells = expanded(name, with_lists(fields))
        if taken := cells.keys() & self.groups.keys():
            raise DesignError(f"group.{min(taken)}: the study already has a group of this name")
        for cell, own in cells.items():
            if "model" in own:
                try:
                    own["model"] = spelled_out(own["model"])
                except DesignError as error:
                    raise DesignError(f"group.{shown(cell)}.model: {error}") from None
            validated(Group, own, f"group.{shown(cell)}")
        return Study(study=self.study, group={**self.groups, **cells})

    @model_validator(mode="after")
    def _resolved(self) -> Study:
        """This study with the values of its models written out; `DesignError` when a check of the physics fails."""
        groups = {}
        for name, group in self.groups.items():
            try:
                groups[name] = with_model_values(checked(group))
            except DesignError as error:
                raise DesignError(f"group.{name}.{error}") from None
        return self.model_copy(update={"groups": groups})

    @property
    def fits(self) -> int:
        """Number of fits of all groups."""
        return sum(group.fits for group in self.groups.values())

    def __repr__(self) -> str:
        rows = [
            f"  {name}: {counted(g.realizations, 'realization')} x {g.starts_in_words}, "
            f"fmax {_listed(g.fmax)} Hz, amplitude {_listed(g.amplitude)}, model {g.model.title}, "
            f"cost {g.fit.cost}: {counted(g.fits, 'fit')}"
            for name, g in self.groups.items()
        ]
        return "\n".join([f"Study {self.study.name}, seed {self.study.seed}: {counted(self.fits, 'fit')}", *rows])

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Notebook display: the groups and their numbers of fits."""
        rows = [
            [
                name,
                str(g.realizations),
                g.starts_in_words if g.until_certain else str(g.starts),
                *(_listed(g.fmax), _listed(g.amplitude), g.model.title, f"{g.fit.cost}, {g.fit.solver}", str(g.fits)),
            ]
            for name, g in self.groups.items()
        ]
        columns = ("group", "realizations", "starts", "Fmax (Hz)", "amplitude", "model", "fit", "fits")
        note = f"{self.fits} fits, seed {self.study.seed}, fingerprint {self.fingerprint[:12]}"
        head = f"<h3>Study {html.escape(self.study.name)}</h3><p>{html.escape(self.study.description)}</p>"
        return head + Table("", columns, rows, note).html()

    def numbers(self) -> dict[str, Any]:
        """All settings that change a number of the cube, as plain JSON values (without the description)."""
        return self.model_dump(mode="json", exclude={"study": {"description", "regenerates"}})

    @property
    def fingerprint(self) -> str:
        """SHA-256 of all settings but ``description`` and ``regenerates``; equal studies have equal cubes."""
        canonical = json.dumps(self.numbers(), sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(canonical.encode()).hexdigest()

    def to_toml(self) -> str:
        """The canonical study file: defaults filled in, comments gone. Reading it gives the same study."""
        plain = self.model_dump(mode="json")
        return "\n".join(toml_lines("", {"study": plain["study"], "group": plain["group"]})).lstrip("\n") + "\n"

    def to_json(self) -> str:
        """Lossless text for a task; `from_json` reads it."""
        return self.model_dump_json()

    @classmethod
    def from_json(cls, text: str) -> Study:
        """Inverse of `to_json`."""
        return cls.model_validate_json(text)


def _listed(values: Iterable[float]) -> str:
    return ", ".join(f"{v:g}" for v in values)
