"""Publications whose numbers a study is compared with: each is declared by a package of its own.

A package names its `Publication` in the entry point group ``mcstudy.comparisons``. Tables, JSON and page compare a
study with the publication that has most statements about it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mcstudy.analysis.published.sampling import Value
    from mcstudy.analysis.published.statement import Published, Variant
    from mcstudy.analysis.published.verdict import Verdict
    from mcstudy.analysis.view import GroupView, StudyView

GROUP = "mcstudy.comparisons"

PageTable = tuple[str, list[str], list[list[str]]]
"""Title, header and rows of a table."""


@dataclass(frozen=True)
class Row:
    """A published statement, our value and the verdict.

    Attributes
    ----------
    published: the statement. ours: our value. group: the group it comes from. verdict: see `Verdict`.
    floor: mean |bias| expected from chance alone, for unbiased estimates of the published number of realizations; else
    NaN. note: explanation for a row that differs, else empty.
    """

    published: Published
    ours: Value
    group: str
    verdict: Verdict
    floor: float = float("nan")
    note: str = ""


@dataclass(frozen=True)
class Publication:
    """What a publication says about studies.

    Attributes
    ----------
    reference: citation. rows: all statements that a study can be compared with.
    needs: sentence on which groups can be compared. reading: paragraphs on how the table of rows is read.
    claims: claims about a changed setting. claims_about: whether they are about a group.
    group: the group that figures show, by role and study: ``estimates`` and ``pools`` (with noise), ``theory`` and
        ``free_pools`` (without); None where the study has none.
    fmax: Hz, of the published figures. settings: published settings, (value, unit, place).
    table: table of the page that lays rows (by key, as JSON) out as the publication does; None for none.
    section: key, title and content of a section of the page about a study (`mcstudy.report.study.context.Context`) and
        the files beside it, each with the study of its cube or None; None for none.
    """

    reference: str
    rows: Callable[[StudyView], list[Row]] = lambda _: []
    needs: str = ""
    reading: Sequence[str] = ()
    claims: Sequence[Variant] = ()
    claims_about: Callable[[GroupView], bool] = lambda _: False
    group: Callable[[str, StudyView], GroupView | None] = lambda _, __: None
    fmax: tuple[float, ...] = ()
    settings: Mapping[str, tuple[Any, str, str]] = field(default_factory=dict)
    table: Callable[[Mapping[str, dict[str, Any]]], PageTable | None] = lambda _: None
    section: Callable[[Any, Sequence[tuple[Path, Any]]], tuple[str, str, str] | None] = lambda _, __: None


NONE = Publication("")
"""Where no publication is installed."""


@cache
def publications() -> tuple[Publication, ...]:
    """Publications of the installed packages, in the order of their names."""
    return tuple(point.load() for point in sorted(entry_points(group=GROUP)))


def compared(study: StudyView) -> tuple[Publication, list[Row]]:
    """The publication with most statements about a study, the first of several, and the rows."""
    found = [(publication, publication.rows(study)) for publication in publications()]
    return max(found, key=lambda pair: len(pair[1]), default=(NONE, []))


def cited(reference: str) -> Publication:
    """The publication with a citation."""
    return next((p for p in publications() if p.reference == reference), NONE)
