"""A diagnosis with its figures and its page."""

from __future__ import annotations

from functools import cached_property

from mcstudy.gap.diagnosis import DiagnosisRecord
from mcstudy.report.diagnosis.plots import Plots
from mcstudy.results.record import PagedResult


class Diagnosis(PagedResult, DiagnosisRecord):
    """Diagnosis of the gap between the body in one recording and the model."""

    more = "verdict(), plot, to_html(path), to_xarray(), to_dict()"

    @cached_property
    def plot(self) -> Plots:
        """Its figures (`Plots`), e.g. ``diagnosis.plot.misfit_gain(angle=1)``; `InputError` without matplotlib."""
        return Plots(self)

    def _page(self) -> str:
        from mcstudy.report.diagnosis.page import gap_page

        return gap_page(self)
