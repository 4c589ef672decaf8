"""``mcstudy show``: the tables of a results cube and the comparison with the paper."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcstudy.analysis.cache import kept
from mcstudy.analysis.show import SCHEMA
from mcstudy.analysis.show.answer import answer
from mcstudy.analysis.show.selection import Selection, selected
from mcstudy.analysis.show.text import differences, everything, groups, publication, starts
from mcstudy.errors import InputError
from mcstudy.files.local_path import local_path
from mcstudy.files.schema import validate
from mcstudy.study.cube.replacement import settled
from mcstudy.text_tables import folded

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Report:
    """The tables of a cube; ``data`` conforms to ``results_schema/<version>/show.json``.

    ``compared``: whether they hold the differences from another cube.
    """

    data: dict[str, Any]
    compared: bool = False

    def text(self) -> str:
        """The first screen: the differences where studies are compared, else what the study determines."""
        return differences(self.data) if self.compared else answer(self.data)

    def details(self) -> str:
        """All tables."""
        return everything(self.data)

    def groups(self) -> str:
        """The tables of each group."""
        return groups(self.data)

    def starts(self) -> str:
        """How many starts a fit needs in each condition."""
        return starts(self.data)

    def publication(self) -> str:
        """The comparison with a publication, statement by statement; raises `InputError` where there is none."""
        if not self.data["paper"]["rows"]:
            raise InputError(f"{self.data['study']['title']}: no publication makes statements on this study")
        return folded(publication(self.data))

    def selected(self, wanted: Selection) -> Report:
        """The tables of what is wanted; raises `InputError` when something wanted is in none of them."""
        return replace(self, data=selected(self.data, wanted)) if wanted else self

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
    return Report(settled(cubes, lambda: kept(SCHEMA, cubes, others, compute)), reference is not None)


def report_of(tree: xr.DataTree, reference: xr.DataTree | None = None, name: str = "the reference") -> Report:
    """Tables of an open cube; ``reference``: another cube to compare with, called ``name``."""
    from mcstudy.analysis.show.summary import show_data  # imports every statistic
    from mcstudy.analysis.view import StudyView

    data = show_data(StudyView(tree), None if reference is None else StudyView(reference), name)
    validate(SCHEMA, data, "show")
    return Report(data, reference is not None)
