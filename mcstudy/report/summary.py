"""A study in a notebook: the tables of ``mcstudy show``, as a cell shows them."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from mcstudy.analysis.tables import report_of
from mcstudy.report.context import Context
from mcstudy.report.html import escape
from mcstudy.report.words import groups, headline, introduction
from mcstudy.study.results import open_results

_STYLE = (
    ".mcstudy table{border-collapse:collapse;margin:.5em 0}.mcstudy caption{text-align:left;font-weight:600}"
    ".mcstudy th,.mcstudy td{padding:.2em .7em;text-align:left;vertical-align:top;border-bottom:1px solid #8884}"
    ".mcstudy .numbers td{text-align:right}.mcstudy .scroll{overflow-x:auto}"
)


class StudySummary:
    """Tables of an open study; shows itself in a notebook, and as text elsewhere."""

    def __init__(self, tree: xr.DataTree) -> None:
        self.context = Context(tree)

    def __repr__(self) -> str:
        return report_of(self.context.tree).text()

    def _repr_html_(self) -> str:
        c = self.context
        return (
            f'<div class="mcstudy"><style>{_STYLE}</style><h2>{escape(c.name)}</h2>{introduction(c)}'
            f"{headline(c)}{groups(c)}</div>"
        )


def summary(study: xr.DataTree | str | Path) -> StudySummary:
    """Summary of a study: what `mcstudy.open_results` returned, or the path of a cube."""
    return StudySummary(study if isinstance(study, xr.DataTree) else open_results(study))
