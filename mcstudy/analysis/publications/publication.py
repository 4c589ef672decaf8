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

from mcstudy.text_tables import Table

if TYPE_CHECKING:
    from mcstudy.analysis.publications.sampling import Value
    from mcstudy.analysis.publications.statement import Published, Variant
    from mcstudy.analysis.publications.verdict import Verdict
    from mcstudy.analysis.view import GroupView, StudyView

GROUP = "mcstudy.comparisons"


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
class Counterpart:
    """What a publication has for a figure or table of a page.

    Attributes
    ----------
    number: its number there, e.g. ``"Fig. 3A"``, or empty. text: what it says of it, in paragraphs.
    rows: keys of the statements that belong to it. letters: of its panels.
    """

    number: str = ""
    text: Sequence[str] = ()
    rows: Sequence[str] = ()
    letters: Sequence[str] = ()

    def heading(self, title: str) -> str:
        """A title behind the number."""
        return f"{self.number} · {title}" if self.number else title


ALONE = Counterpart()
"""Where a publication has nothing of the kind."""


@dataclass(frozen=True)
class Publication:
    """What a publication says about studies.

    Attributes
    ----------
    reference: citation. name: what sentences call it. rows: all statements that a study can be compared with.
    reading: paragraphs on how the table of rows is read.
    claims: claims about a changed setting. claims_about: whether they are about a group.
    group: the group that figures show, by role and study: ``estimates`` and ``pools`` (with noise), ``theory`` and
        ``free_pools`` (without); None where the study has none.
    settings: published settings, (value, unit, place).
    counterparts: what it has for figures and tables of the page, by their ids.
    headline: keys of the rows whose numbers the first screen gives beside its own: ``largest_error`` (without noise)
        and ``bias``, which may name the ``{fmax}``.
    table: table of the page that lays rows (by key, as JSON) out as the publication does; None for none.
    section: key, title and content of a section of the page about a study (`mcstudy.report.study.context.Context`) and
        the files beside it, each with the study of its cube or None; None for none.
    """

    reference: str
    name: str = "the publication"
    rows: Callable[[StudyView], list[Row]] = lambda _: []
    reading: Sequence[str] = ()
    claims: Sequence[Variant] = ()
    claims_about: Callable[[GroupView], bool] = lambda _: False
    group: Callable[[str, StudyView], GroupView | None] = lambda _, __: None
    settings: Mapping[str, tuple[Any, str, str]] = field(default_factory=dict)
    counterparts: Mapping[str, Counterpart] = field(default_factory=dict)
    headline: Mapping[str, str] = field(default_factory=dict)
    table: Callable[[Mapping[str, dict[str, Any]]], Table | None] = lambda _: None
    section: Callable[[Any, Sequence[tuple[Path, Any]]], tuple[str, str, Any] | None] = lambda _, __: None


NONE = Publication("")
"""Where no publication has a statement about the study."""


@cache
def publications() -> tuple[Publication, ...]:
    """Publications of the installed packages, in the order of their names."""
    return tuple(point.load() for point in sorted(entry_points(group=GROUP)))


def compared(study: StudyView) -> tuple[Publication, list[Row]]:
    """The publication with most statements about a study, the first of several, and the rows; `NONE` without any."""
    pairs = [(publication, publication.rows(study)) for publication in publications()]
    return max((pair for pair in pairs if pair[1]), key=lambda pair: len(pair[1]), default=(NONE, []))


def cited(reference: str) -> Publication:
    """The publication with a citation."""
    return next((p for p in publications() if p.reference == reference), NONE)
