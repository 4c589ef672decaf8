"""``mcstudy show``: the tables of a results cube, beside the paper's where it has something to say."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from mcstudy.analysis.summary import SCHEMA, summary
from mcstudy.analysis.text import render
from mcstudy.analysis.view import StudyView
from mcstudy.study.results import open_results
from mcstudy.study.schema import validate


@dataclass(frozen=True)
class Report:
    """What a cube says; ``data`` conforms to ``results_schema/<version>/show.json``."""

    data: dict[str, Any]

    def text(self) -> str:
        """Tables for a terminal."""
        return render(self.data)

    def json(self) -> str:
        """The same as JSON, validated."""
        return json.dumps(self.data, indent=1, ensure_ascii=False, allow_nan=False)


def show(path: str | Path, reference: str | Path | None = None) -> Report:
    """Tables of the cube at ``path``; complete or not (what is missing is counted as left out).

    ``reference``: another cube; its groups are compared with those of the same name, instead of these among themselves.
    Raises `StoreError` when one is not a cube of this version, `InputError` when none of their groups can be compared.
    """
    tree = open_results(path, lazy=None)
    if reference is None:
        return report_of(tree)
    return report_of(tree, open_results(reference, lazy=None), str(reference))


def report_of(tree: xr.DataTree, reference: xr.DataTree | None = None, name: str = "the reference") -> Report:
    """Tables of an open cube, compared with another one, called ``name``, if there is one."""
    data = summary(StudyView(tree), None if reference is None else StudyView(reference), name)
    validate(SCHEMA, data, "show")
    return Report(data)
