"""``mcstudy show``: the tables of a results cube and the comparison with the paper."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcstudy.analysis.cache import kept
from mcstudy.analysis.show import SCHEMA
from mcstudy.analysis.show.text import render
from mcstudy.files.local_path import local_path
from mcstudy.files.schema import validate
from mcstudy.study.cube.replacement import settled

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Report:
    """The tables of a cube; ``data`` conforms to ``results_schema/<version>/show.json``."""

    data: dict[str, Any]

    def text(self) -> str:
        """Tables for a terminal."""
        return render(self.data)

    def json(self) -> str:
        """The same as JSON, validated."""
        return json.dumps(self.data, indent=1, ensure_ascii=False, allow_nan=False)


def show(path: str | Path, reference: str | Path | None = None) -> Report:
    """Tables of the cube at ``path``, which may be incomplete (missing fits are counted as left out).

    ``reference``: another cube; if given, groups are compared with its groups of the same name. The statistics are
    computed once and kept (`mcstudy.analysis.cache`).
    Raises `StoreError` when one is not a cube of this version, `InputError` when none of their groups can be compared.
    """

    def compute() -> dict[str, Any]:
        from mcstudy.analysis.results import open_for_tables  # slow to import, and not needed for kept statistics

        tree = open_for_tables(path)
        if reference is None:
            return report_of(tree).data
        return report_of(tree, open_for_tables(reference), str(reference)).data

    others = [] if reference is None else [str(reference)]
    cubes = [local_path(path), *map(local_path, others)]
    return Report(settled(cubes, lambda: kept(SCHEMA, cubes, others, compute)))


def report_of(tree: xr.DataTree, reference: xr.DataTree | None = None, name: str = "the reference") -> Report:
    """Tables of an open cube; ``reference``: another cube to compare with, called ``name``."""
    from mcstudy.analysis.show.summary import show_data  # imports every statistic
    from mcstudy.analysis.view import StudyView

    data = show_data(StudyView(tree), None if reference is None else StudyView(reference), name)
    validate(SCHEMA, data, "show")
    return Report(data)
