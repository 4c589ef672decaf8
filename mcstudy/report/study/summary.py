"""A study in a notebook: the first screen of ``mcstudy show``, with its tables below."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import xarray as xr
from markupsafe import Markup

from mcstudy.analysis.show.tables import Report
from mcstudy.report.html import html
from mcstudy.report.study.context import Context
from mcstudy.report.study.tables import group_overviews, headline, introduction
from mcstudy.text_tables import unfolded

_STYLE = (
    ".mcstudy table{border-collapse:collapse;margin:.5em 0}.mcstudy caption{text-align:left;font-weight:600}"
    ".mcstudy th,.mcstudy td{padding:.2em .7em;text-align:left;vertical-align:top;border-bottom:1px solid #8884}"
    ".mcstudy .numbers td{text-align:right}.mcstudy .scroll{overflow-x:auto}"
)


class StudySummary:
    """What a study says, as text at a prompt and, with its tables, in a notebook; `mcstudy.summary` makes one.

    Parameters
    ----------
    report
        The tables.
    tree
        Opens the study, which only the HTML needs.
    """

    def __init__(self, report: Report, tree: Callable[[], xr.DataTree]) -> None:
        self._report, self._tree = report, tree

    def __repr__(self) -> str:
        return self._report.text()

    def details(self) -> str:
        """All tables as text, what ``mcstudy show OUT --all`` prints."""
        return self._report.details()

    def to_dict(self) -> dict[str, Any]:
        """All numbers as plain JSON data, valid under ``results_schema/2.0.0/show.json``."""
        return self._report.data

    @cached_property
    def context(self) -> Context:
        """The study and its numbers."""
        return Context(self._tree(), lambda _: self._report.data)

    def _repr_html_(self) -> str:
        c = self.context
        with unfolded():
            first = self._report.text()
        tables = introduction(c) + headline(c) + group_overviews(c)
        folded = html("<details><summary>All tables</summary>{}</details>", tables)
        return str(html('<div class="mcstudy"><style>{}</style><pre>{}</pre>{}</div>', Markup(_STYLE), first, folded))
