"""The paper as mcstudy compares studies with it: its statements, claims, settings and groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcstudy.analysis.publications.publication import Publication, Row
from mcstudy.analysis.show.text import ours
from mcstudy.text_tables import Table
from mcstudy_goodworth2018.counterparts import COUNTERPARTS, HEADLINE
from mcstudy_goodworth2018.paper.published import (
    AMPLITUDES_NM,
    CONVERGENCE_FMAX_HZ,
    FMAX_HZ,
    MARGINS,
    METHODS,
    PAPER,
    STARTS,
    VARIANTS,
)

if TYPE_CHECKING:
    from mcstudy.analysis.view import GroupView, StudyView
    from mcstudy.report.document import Section
    from mcstudy.report.study.context import Context

_READING = (
    "z: difference, minus the rounding of the paper's number, in standard errors of both studies. Ours is the mean "
    "over blocks of the paper's 50 realizations; the paper's error is that of one such block.",
    "agrees: the 90 % interval of the difference is within {bias:g} % of the truth for a bias, {spread:g} percentage "
    "points for a reduction of SD or CV, {ratio:.2g} for a ratio, {sway:g} deg for sway, {starts:g} starts. differs: "
    "more than 3 errors apart (3.75 from fewer than 20 blocks, whose error is itself an estimate).",
    "cannot tell: neither; n: realizations needed to decide, if our value does not change. (paper's error): "
    "none would, because the paper's own error does not shrink. (definition): the paper does not say how it counts.",
    "'> 0', '> 50' and the like: a ranking or a majority; ours is the margin or the share, and 'agrees' means that it "
    "holds. (reading): the same words, read in another way. '-': the paper gives nothing to compare with.",
)

_SETS = {
    "bias_12": "all 12 parameters",
    "bias_10": "stiffness combined (10)",
    "bias_2": "the 2 combined stiffnesses",
}
"""Sets of parameters of Table II."""


def _table_ii(published: Mapping[str, dict[str, Any]]) -> Table | None:
    """Mean |bias| as the paper's Table II lays it out: sets of parameters by Fmax."""
    if not published:
        return None
    lines = []
    for key, what in _SETS.items():
        cells = [published.get(f"{key}_{f:g}") for f in FMAX_HZ]
        lines.append([what, *(x for r in cells for x in ((r["paper_text"], ours(r)) if r else ("–", "–")))])
    header = ["mean |bias| (%)", *(x for f in FMAX_HZ for x in (f"{f:g} Hz: paper", "ours ± MCSE"))]
    return Table("Table II · Bias by Fmax, mean of 3 and 5 N·m", header, lines)


def _rows(study: StudyView) -> list[Row]:
    from mcstudy_goodworth2018.paper.rows import rows

    return rows(study)


def _claims_about(group: GroupView) -> bool:
    from mcstudy_goodworth2018.paper.groups import comparable

    return comparable(group, [], [])


def _group(role: str, study: StudyView) -> GroupView | None:
    from mcstudy_goodworth2018.paper import groups
    from mcstudy_goodworth2018.paper.rows import LEAST_POOL

    if role == "estimates":
        return groups.accuracy(study, FMAX_HZ, AMPLITUDES_NM)
    if role == "pools":
        return groups.pools(study, CONVERGENCE_FMAX_HZ, AMPLITUDES_NM[0], LEAST_POOL)
    fmax, least = (FMAX_HZ[-1], STARTS) if role == "theory" else (CONVERGENCE_FMAX_HZ, LEAST_POOL)
    return groups.noise_free(study, fmax, least)


def _section(_: Context, beside: Sequence[tuple[Path, Context | None]]) -> Section:
    from mcstudy_goodworth2018.alternatives.sections import alternatives

    return alternatives(beside)


provider = Publication(
    reference=PAPER,
    name="the paper",
    rows=_rows,
    reading=[text.format(**{kind: margin for kind, (margin, _) in MARGINS.items()}) for text in _READING],
    claims=VARIANTS,
    claims_about=_claims_about,
    group=_group,
    settings=METHODS,
    counterparts=COUNTERPARTS,
    headline=HEADLINE,
    table=_table_ii,
    section=_section,
)
"""Functions import what they need: tables of a study whose numbers are kept are printed without loading NumPy."""
