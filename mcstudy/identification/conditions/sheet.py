"""A file that lists the recordings of one person by condition, and what the conditions share.

model = "sensorimotor_integration"    # of all recordings; a condition may name its own
per = ["Wp"]                          # or shared = [...], as on the command line

[[condition]]
name = "small"
files = ["small.nc"]                  # relative to this file

[[condition]]
...
"""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from mcstudy.errors import DesignError, InputError
from mcstudy.files.plain_errors import validated
from mcstudy.files.sections import Section
from mcstudy.recordings.columns import model_of
from mcstudy.recordings.frf import FrfRecording
from mcstudy.recordings.io import read_recording
from mcstudy.recordings.recording import Recording
from mcstudy.recordings.sheets.recording_sheet import toml_file


class Condition(Section):
    """One condition: its name, its recordings, and their model if it is not that of the others."""

    name: str = Field(min_length=1)
    files: tuple[str, ...] = Field(min_length=1)
    model: str = ""


class ConditionsSheet(Section):
    """All conditions; see the module."""

    condition: tuple[Condition, ...] = Field(min_length=2)
    per: tuple[str, ...] = ()
    shared: tuple[str, ...] = ()
    model: str = ""

    @classmethod
    def read(cls, path: Path) -> ConditionsSheet:
        """From a TOML file; raises `InputError`, one line that names file and field."""
        try:
            sheet: ConditionsSheet = validated(cls, toml_file(path))
        except DesignError as error:
            raise InputError(f"{path}: {error}") from None
        return sheet

    def recordings(self, folder: Path, data: Path | None = None) -> tuple[list[Recording | FrfRecording], list[str]]:
        """The recordings, whose files are in ``folder``, and the condition of each."""
        read, names = [], []
        for c in self.condition:
            model = model_of(c.model or self.model or None, folder)
            read += [read_recording(folder / file, data=data, model=model) for file in c.files]
            names += [c.name] * len(c.files)
        return read, names
