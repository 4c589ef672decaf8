"""Reading inference files.

An inference file is TOML: a table ``[inference]`` and, optionally, ``[prior]`` with ``NAME = [lowest, highest]`` for
true values and the noise. Every mistake gives one line: ``file: field: what was expected``.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from mcstudy.errors import DesignError
from mcstudy.files.plain_errors import validated
from mcstudy.files.sections import Name, Section
from mcstudy.study.catalogue import read_file
from mcstudy.study.study_file import check_tables
from mcstudy_goodworth2018.lost_table.rows import ROWS
from mcstudy_goodworth2018.lost_table.unknowns import Prior

KIND = "inference"

Pair = Annotated[list[float], Field(min_length=2, max_length=2)]

Count = Annotated[int, Field(ge=1, le=100_000)]


class Inference(Section):
    """What is computed.

    Attributes
    ----------
    name, seed, description: as in a study file.
    realizations: noise realizations of a simulated study; the paper's 50.
    prior_studies: studies simulated at points of the prior, from which the emulator is made.
    waves: studies simulated in each further wave, at points of the posterior found so far.
    search: studies simulated in each round of the directed search, which follows the waves.
    aimed: studies simulated for each printed number that the best configuration misses, where it is met first.
    papers: simulated papers with known tables by which the inference is checked: the first studies of the prior.
    particles: points that represent a posterior.
    """

    name: Name
    seed: int = Field(ge=0, lt=2**63)
    description: str = ""
    realizations: int = Field(default=50, ge=3, le=10_000)
    prior_studies: Count
    waves: list[Count] = Field(default_factory=list, max_length=20)
    search: list[Count] = Field(default_factory=list, max_length=20)
    aimed: int = Field(default=0, ge=0, le=10_000)
    papers: int = Field(default=0, ge=0, le=10_000)
    particles: int = Field(default=600, ge=50, le=100_000)


class InferenceFile(Section):
    """An inference file with every setting explicit; ``prior``: ranges that replace the defaults."""

    inference: Inference
    prior: dict[str, Pair] = Field(default_factory=dict)

    @property
    def fingerprint(self) -> str:
        """SHA-256 of all settings but the description, and of the printed numbers."""
        plain = self.model_dump(mode="json", exclude={"inference": {"description"}})
        plain["prior"] = {x.name: [x.low, x.high] for x in Prior(self.prior).unknowns if not x.choices}
        plain["rows"] = [[row.key, row.kind, row.value, row.half] for row in ROWS]
        return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def read_inference(path: str | Path) -> InferenceFile:
    """The inference of a file, or of a shipped one by name; raises `DesignError` with one line."""
    return read_file(path, KIND, parse_inference)


def parse_inference(raw: dict[str, Any]) -> InferenceFile:
    """The inference of a parsed file; the one-line `DesignError` starts with the field."""
    check_tables(raw, (KIND, "prior"))
    if KIND not in raw:
        raise DesignError(f"{KIND}: missing, expected a table [{KIND}] with name, seed and prior_studies")
    file: InferenceFile = validated(InferenceFile, raw)
    Prior(file.prior)
    return file
